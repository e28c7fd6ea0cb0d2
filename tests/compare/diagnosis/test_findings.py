"""Findings explain wrong pixels, or are none; and defects that show the same images name each
other.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import xfrustum
from tests.support.foreign_renderers import Faulty, oblong, saying, small
from tests.support.light import with_smooth_normals
from tests.support.scene_file import film, named, part
from tests.wrong_renderers.ray_caster import picture
from tests.wrong_renderers.worlds import harbor
from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.geometry_fit import claims_of, fit_geometry
from xfrustum.compare.diagnosis.testset import MIN_EXPLAINED_FRACTION, TestSet
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.renderer_model.drawn_model import (
    Culled,
    Film,
    Front,
    Normals,
    OneCamera,
    RendererModel,
)
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification, render_page, table
from xfrustum.scenes import Aperture, HogelImage, Scene, SceneObject, open_scene
from xfrustum.scenes.errors import InputError

SIZE = 48
CENTERED, RECENTERED = "asymmetric", "asymmetric-recentered"
FEW = [(0, 0), (4, 1), (2, 3)]
SOME = [*FEW, (1, 4), (3, 2)]
BESIDE = [(0, 0), (4, 3), (8, 6), (1, 5), (6, 1)]
Offset = tuple[float, float, float]


def moved(scene: Scene, scale: float = 1.0, offset: Offset = (0.0, 0.0, 0.0)) -> Scene:
    """Return the hogels of a renderer that has the scene elsewhere: the vertices themselves are
    moved.
    """
    parts = [
        replace(part, vertices=part.vertices * scale + np.asarray(offset)) for part in scene.objects
    ]
    return replace(scene, objects=tuple(parts))


def of_model(
    scene: Scene,
    model: RendererModel,
    shown: Sequence[str] = ("triangle", "object"),
    apertures: Sequence[tuple[int, int]] | None = None,
) -> Verification:
    """Verify the images of a model in some hogels of a scene, or in all."""
    reference = Reference(scene)

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        image = trace_drawn(reference, model, aperture)
        return saying(colored(scene, model, image) if "color" in shown else image, *shown)

    return xfrustum.verify(scene, draw, apertures=apertures)


def by_name(result: Verification) -> dict[str, Defect]:
    return {fault.fault: fault for fault in result.diagnosis.faults}


@pytest.mark.parametrize(
    ("model", "shown", "name"),
    [
        (RendererModel(film=Film(angles="xy")), ["triangle"], "equal-angles"),
        (RendererModel(normals=Normals.FLAT), ["triangle", "color"], "flat-normals"),
        pytest.param(
            *(RendererModel(one_camera=OneCamera(1, flip_x=True)), ["triangle"], "back-mirrored"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_film_a_lens_a_shading_and_a_camera_are_named_from_few_small_hogels(
    model: RendererModel, shown: list[str], name: str
) -> None:
    """The table of wrong renderers has all of them, at several times the size."""
    scene = oblong()
    smooth = replace(scene, objects=tuple(with_smooth_normals(part) for part in scene.objects))
    result = of_model(smooth, model, shown, FEW)
    assert set(by_name(result)) == {name} and not result.passed


@pytest.mark.slow
def test_where_points_at_a_moved_object_and_nothing_is_named() -> None:
    scene = small(RECENTERED, SIZE)
    objects = list(scene.objects)
    vertices = objects[1].vertices + np.array([0.0, -6.0, 4.0])
    objects[1] = replace(objects[1], vertices=vertices)
    reference = Reference(replace(scene, objects=tuple(objects)))

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        return saying(trace_drawn(reference, RendererModel(), aperture), "triangle")

    result = xfrustum.verify(scene, draw, apertures=SOME)
    assert not result.passed and not result.diagnosis.faults
    shares = result.summary()["where"]["shares"]["object"]
    worst = max(shares, key=lambda name: shares[name]["fraction"])
    assert worst.startswith("1 (")


@pytest.mark.slow
def test_what_does_not_explain_is_no_finding() -> None:
    # An offset widens the picture most near the plate, a field of view everywhere: neither explains
    # both.
    scene = small(CENTERED, SIZE)
    with Faulty(scene=scene, near=8.0, fov=(1.1, 0.95), shown="color") as renderer:
        result = xfrustum.verify(scene, renderer, apertures=SOME)
    assert not result.passed
    assert result.diagnosis.faults == ()
    doubted = result.diagnosis.does_not_explain
    assert {fault.fault for fault in doubted} >= {"fov-x", "fov-y"}
    for fault in doubted:
        assert fault.explains is not None
        assert fault.explains < MIN_EXPLAINED_FRACTION
    summary = result.summary()
    assert summary["diagnosis"] == []
    phrase = {entry["fault"]: entry["words"] for entry in summary["does_not_explain"]}
    assert all("would explain only" in words for words in phrase.values())
    assert summary["corrected"] == summary["as_found"]
    assert "no known fault explains" in table(result)
    assert "No known fault explains what is wrong" in render_page(result)


@pytest.mark.parametrize(
    ("shown", "witnesses"),
    [("color", "colors"), pytest.param("object", "object numbers", marks=pytest.mark.slow)],
)
def test_a_field_of_view_at_one_depth_may_be_a_near_offset_to_pictures(
    shown: str, witnesses: str
) -> None:
    # Three triangles beside one another, 30 mm behind the plate, where an offset of 5 mm is a
    # sixth.
    corners = [
        (-24, -9),
        (-4, -13),
        (-12, 12),
        (3, -12),
        (22, -8),
        (5, -1),
        (-3, 4),
        (25, 6),
        (8, 16),
    ]
    vertices = np.array([(x, y, -30.0) for x, y in corners])
    part = SceneObject(name="flat", vertices=vertices, faces=np.arange(9).reshape(-1, 3))
    flat = replace(small(CENTERED, 32), objects=(part,))
    with Faulty(scene=flat, near=5.0, shown=shown) as renderer:
        result = xfrustum.verify(flat, renderer, apertures=[(2, 2), (1, 2), (3, 1), (2, 3)])
    assert len(result.diagnosis.faults) == 2
    for fault in result.diagnosis.faults:
        assert fault.fault in ("fov-x", "fov-y")
        assert fault.value == pytest.approx(7 / 6, abs=0.01)
        assert fault.alternatives == ("near",)
    words = "; ".join(defect["words"] for defect in result.defects())
    assert f"or near: {witnesses} cannot tell" in words


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    x=st.floats(-6, 6),
    z=st.floats(-3, 3),
    scale=st.floats(0.7, 1.5),
    which=st.sampled_from(["aperture-offset", "scene-offset", "scene-scale"]),
)
def test_whatever_the_offset_its_interval_contains_it(
    x: float, z: float, scale: float, which: str
) -> None:
    scene = small(RECENTERED, SIZE)
    numbers: dict[str, Any] = {
        "aperture-offset": (x, -x),
        "scene-offset": (x, -x, z),
        "scene-scale": scale,
    }
    offset = (x, -x, z) if which == "scene-offset" else (0.0, 0.0, 0.0)
    reference, images = (
        Reference(moved(scene, scale if which == "scene-scale" else 1.0, offset)),
        [],
    )
    for index in SOME:
        options = scene.plate.aperture(*index)
        there = (
            replace(options, x=options.x + x, y=options.y - x)
            if which == "aperture-offset"
            else options
        )
        image = reference.trace(there)
        images.append(replace(image, camera=replace(image.camera, aperture=options)))
    fit = fit_geometry(claims_of(scene, images), RendererModel())
    nominal = RendererModel().parameters
    off = np.flatnonzero((fit.low > nominal) | (fit.high < nominal))
    field: Any = {which.replace("-", "_"): numbers[which]}
    expected = replace(fit.model.with_parameters(nominal), **field)
    assert np.all(fit.low <= expected.parameters + 1e-12)
    assert np.all(fit.high >= expected.parameters - 1e-12)
    assert set(off) <= set(np.flatnonzero(expected.parameters != nominal))


# Findings rest on wrong pixels: none without them, and all findings together must explain them.


@pytest.mark.slow
def test_a_sphere_whose_near_side_is_left_out_shows_its_far_side_as_if_that_won(
    tmp_path: Path,
) -> None:
    file = tmp_path / "sphere.toml"
    space = film(
        (40.0, 40.0), hogels=(2, 2), resolution=(32, 32), fov_deg=(60.0, 60.0), reach=(50.0, 60.0)
    )
    before = (
        named("a sphere before the plate", "mm") + space + part("sphere", 12.0, (3.0, -2.0, 25.0))
    )
    file.write_text(before)
    scene = open_scene(str(file))
    for model in (
        RendererModel(culled=Culled.COUNTERCLOCKWISE),
        RendererModel(front=Front.NEAREST),
    ):
        result = of_model(scene, model)
        (fault,) = result.diagnosis.faults
        assert fault.fault == "front-nearest"
        assert fault.alternatives == ("culling",)
        assert "or culling: images cannot tell" in result.defects()[0]["words"]


def test_what_counts_as_wrong_is_what_the_verdict_counts() -> None:
    scene = oblong()
    reference, images = Reference(scene), []
    for index in FEW:
        image = reference.trace(scene.plate.aperture(*index))
        assert image.color is not None
        images.append(saying(replace(image, color=0.5 * image.color), "color"))
    test = TestSet(reference=reference, images=images, nominal=RendererModel())
    assert test.wrong(RendererModel()) > 0
    assert replace(test, judging=Judging(color_tolerance=1.0), masks={}).wrong(RendererModel()) == 0
    outlines = replace(test, judging=Judging(compared=Compared.GEOMETRY), masks={})
    assert outlines.wrong(RendererModel()) < test.wrong(RendererModel()) / 10


@pytest.mark.parametrize(
    "options",
    [
        *(
            {name: "x"}
            for name in ("max_wrong", "max_displacement_px", "max_color", "near", "accept")
        ),
        *({"near": True}, {"encoding": "banana"}, {"compare": "banana"}),
        *({"apertures": [entry]} for entry in ("x", (0, "x"), 3)),
    ],
)
def test_options_that_mean_nothing_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        xfrustum.verify(oblong(), "none_{i}_{j}.png", **options)


@pytest.mark.slow
def test_inverted_normals_are_named_of_smooth_and_of_flat_objects() -> None:
    first, *others = (scene := oblong()).objects
    mixed = replace(scene, objects=(with_smooth_normals(first), *others))
    result = of_model(mixed, RendererModel(normals=Normals.INVERTED), ["color"])
    assert set(by_name(result)) == {"inverted-normals"}


@pytest.mark.slow
def test_hogels_that_no_sample_has_are_named_to_be_diagnosed() -> None:
    """Two hogels of 63 are exchanged, none of the 25 diagnosed ones; text names them."""
    scene = oblong()
    scene = replace(scene, plate=replace(scene.plate, hogels=(9, 7)))
    reference, exchanged = Reference(scene), {(3, 2): (7, 5), (7, 5): (3, 2)}

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        shown = scene.plate.aperture(*exchanged.get(aperture.index, aperture.index))
        image = saying(trace_drawn(reference, RendererModel(), shown), "triangle")
        return replace(image, camera=reference.camera(aperture))

    result = xfrustum.verify(scene, draw)
    assert not result.passed and not result.diagnosis.faults
    assert "diagnose some of both, --apertures '3,2;7,5;..'" in table(result)
    again = xfrustum.verify(scene, draw, apertures=[(3, 2), (7, 5), *BESIDE])
    assert set(by_name(again)) == {"hogels-exchanged"}


@pytest.mark.slow
def test_where_nothing_is_named_it_is_said_where_it_is_wrong(tmp_path: Path) -> None:
    width, height = 48, 36
    world = replace(harbor(), resolution=(width, height), drawn={})
    scene = world.write(tmp_path)
    noise = np.random.default_rng(0).integers(0, 3, (height, width, 3), dtype=np.uint8)
    for i, j in world.apertures:
        right = picture(world, i, j, "triangle-id")
        broken = (
            np.where(right.any(axis=2, keepdims=True), noise, right) if (i, j) == (2, 0) else right
        )
        Image.fromarray(broken).save(tmp_path / f"{i}-{j}.png")
    result = xfrustum.verify(str(scene), str(tmp_path / "{i}-{j}.png"), encoding="triangle-id")
    where = result.summary()["where"]
    assert not result.diagnosis.faults
    assert where["shares"]["column"]["0"]["wrong"] == where["shares"]["row"]["1"]["wrong"] == 0
    wrong = where["shares"]["row"]["0"]["wrong"]
    assert where["shares"]["column"]["2"]["wrong"] == sum(where["sides"].values()) == wrong > 0
    assert (
        where["sides"]["front"] > 0
        and where["sides"]["back"] > 0
        and "3 (buoy)" in where["objects"]
    )
    assert where["hogels"] == [
        [wrong if (i, j) == (2, 0) else 0 for i in range(3)] for j in range(2)
    ]
    assert "wrong by column of hogels: 2 " in table(result)
    assert "by column of hogels: 2 " in render_page(result)
