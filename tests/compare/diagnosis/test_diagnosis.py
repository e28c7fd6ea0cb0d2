"""Diagnoses name exactly the defects that a test puts in, with their sizes.

`Faulty` draws with the project's rasterizer. The renderers of `test_wrong_renderers` have all
defects, several times larger.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import xfrustum
from tests.support.foreign_renderers import Faulty, oblong, saying, small
from tests.support.light import with_smooth_normals
from tests.support.scene_file import named, part
from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.diagnosis import diagnose
from xfrustum.compare.diagnosis.encodings import RESAMPLED, IdRepair
from xfrustum.compare.diagnosis.geometry_fit import fit_geometry
from xfrustum.compare.diagnosis.testset import MIN_EXPLAINED_FRACTION, TestSet, claims_of
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.renderer_model.conventions import Orientation
from xfrustum.compare.renderer_model.drawn_model import (
    NUMBERS,
    Culled,
    Film,
    Front,
    Normals,
    Recentering,
    RendererModel,
)
from xfrustum.compare.renderer_model.pictures import colored, drawn_scene, trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification, render_page, table
from xfrustum.scenes import Aperture, HogelImage, Scene, SceneObject, open_scene
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.conformance_suite import chosen
from xfrustum.scenes.files.pictures import Encoding, ForeignImage, Reading, StoredPixels, bytes_of
from xfrustum.scenes.shapes import build_shape

TURNED, REVERSED = Orientation(True, False, True), Orientation(False, True, False)
NOMINAL = RendererModel()
RECENTERED = "asymmetric-recentered"

DEFECTS: dict[str, tuple[dict[str, Any], dict[str, float | str]]] = {
    "orientation": ({"orientation": TURNED}, {"orientation": TURNED.labels[0]}),
    "order": ({"order": REVERSED}, {"aperture-order": REVERSED.labels[1]}),
    "corners": ({"shift": (-0.5, -0.5)}, {"shift-x": -0.5, "shift-y": -0.5}),
    "fov": ({"fov": (1.01, 1.01)}, {"fov-x": 1.01, "fov-y": 1.01}),
    "aspect": ({"fov": (1.0, 0.99)}, {"fov-y": 0.99}),
    "pitch": ({"pitch": 1.02}, {"pitch-x": 1.02, "pitch-y": 1.02}),
    "near": ({"near": 1.5}, {"near": 1.5}),
    "pivot": ({"near": 3.0, "pivot": "camera"}, {"pivot": "camera"}),
    "fit": ({"near": 3.0, "fit": "screen"}, {"fit": "screen"}),
    "missing": ({"front": False}, {"front-missing": "missing"}),
    "covered": ({"overlaid": False}, {"not-overlaid": "back over front"}),
}
"""Options of `Faulty`, and the defects with sizes that must be named, by case."""

# Largest errors of diagnosed sizes: 0.02 px, 0.05 % of field of view and pitch, and 2 % of near.
EXACT = {"shift": 0.02, "fov": 5e-4, "pitch": 5e-4, "near": 0.02 * 1.5}

PAIRS = (
    *("orientation order", "orientation pitch", "orientation near", "order corners", "order fov"),
    *("corners fov", "corners aspect", "corners pitch", "corners missing", "fov pitch", "fov near"),
    *("fov pivot", "aspect fit", "aspect missing", "pitch near", "pitch pivot", "pitch covered"),
    *("near missing", "near covered", "pivot missing", "fit covered", "order fit"),
)
"""Defects that can be combined."""

SIZE = 48
FEW = [(0, 0), (4, 1), (2, 3)]
SOME = [*FEW, (1, 4), (3, 2)]
"""Hogels that include each column and each row of the plate once."""


def by_name(result: Verification) -> dict[str, Defect]:
    return {defect.fault: defect for defect in result.diagnosis.faults}


def of_model(
    scene: Scene,
    model: RendererModel,
    shown: Sequence[str] = ("triangle",),
    apertures: Sequence[tuple[int, int]] | None = None,
) -> Verification:
    """Verify the images of a renderer model, in some hogels of a scene or in all."""
    reference = Reference(scene)
    drawn = drawn_scene(reference, model)

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        image = trace_drawn(drawn, model, model.answers(scene, aperture))
        image = colored(scene, model, image) if "color" in shown else image
        return replace(saying(image, *shown), camera=reference.camera(aperture))

    return xfrustum.verify(scene, draw, apertures=apertures)


def observed(
    scene: Scene, model: RendererModel, apertures: Sequence[tuple[int, int]] = FEW
) -> TestSet:
    """Return the triangles that a renderer model draws in some hogels."""
    reference = Reference(scene)
    images = [trace_drawn(reference, model, scene.plate.aperture(*index)) for index in apertures]
    shown = [saying(image, "triangle", "object") for image in images]
    return TestSet(reference=reference, images=shown, nominal=NOMINAL)


def diagnosed(
    scene: Scene, model: RendererModel, apertures: Sequence[tuple[int, int]] = FEW
) -> dict[str, Defect]:
    faults = diagnose(observed(scene, model, apertures)).diagnosis.faults
    return {defect.fault: defect for defect in faults}


@pytest.mark.parametrize(
    "names",
    [
        *("corners", "missing"),
        *(pytest.param(pair, marks=pytest.mark.slow) for pair in ("near", *PAIRS)),
    ],
)
def test_defects_are_named_with_their_sizes_alone_and_in_pairs(names: str) -> None:
    cases, pair = names.split(), " " in names
    options = {name: value for case in cases for name, value in DEFECTS[case][0].items()}
    expected = {name: size for case in cases for name, size in DEFECTS[case][1].items()}
    # Pivot and fit have no effect without a near offset, which the test states.
    stated = options["near"] if {"pivot", "fit"} & set(cases) else None
    scene = small(size=SIZE) if pair else oblong()
    with Faulty(scene=scene, **options) as renderer:
        apertures = None if pair else FEW
        result = xfrustum.verify(scene, renderer, near=stated, apertures=apertures)
    assert set(by_name(result)) == set(expected)
    for name, size in expected.items():
        defect = by_name(result)[name]
        value, low, high = defect.value, defect.low, defect.high
        if isinstance(size, str):
            assert value == size
            continue
        assert isinstance(value, float) and low is not None and high is not None
        assert value == pytest.approx(size, abs=EXACT[name.split("-")[0]])
        assert low <= value <= high
        assert low - 1e-3 * abs(size) <= size <= high + 1e-3 * abs(size)
    corrected = result.summary()["corrected"]
    assert not result.passed
    # After correction, pixels beside edges may still snap to the other side.
    assert corrected["surface"]["fraction"] < 0.01 and corrected["causes"]["unexplained"] <= 2


@pytest.mark.parametrize("name", [RECENTERED, "asymmetric"])
def test_in_a_renderer_that_is_right_nothing_is_named(name: str) -> None:
    scene = oblong(name, width=SIZE)
    with Faulty(scene=scene) as renderer:
        result = xfrustum.verify(scene, renderer, apertures=FEW)
    as_found = result.summary()["as_found"]
    assert result.diagnosis.faults == () and result.passed
    assert as_found["surface"]["fraction"] < 0.01
    assert as_found["displacement_px"]["worst_p99"] < 0.5


@pytest.mark.slow
def test_a_stated_offset_is_no_defect() -> None:
    scene = small(size=SIZE)
    with Faulty(scene=scene, near=2.0) as renderer:
        stated, unstated, wrongly = (
            xfrustum.verify(scene, renderer, near=near, apertures=SOME) for near in (2.0, None, 1.0)
        )
    assert stated.passed and stated.diagnosis.faults == ()
    for result in (unstated, wrongly):
        assert not result.passed and set(by_name(result)) == {"near"}
        assert by_name(result)["near"].value == pytest.approx(2.0, rel=0.02)


def test_one_hogel_shows_an_orientation_that_may_be_accepted_and_leaves_the_order_open() -> None:
    scene = small(size=32)
    with Faulty(scene=scene, orientation=TURNED) as renderer:
        refused, accepted = (
            xfrustum.verify(scene, renderer, apertures=[(2, 2)], accept=accept)
            for accept in ((), ("orientation",))
        )
    assert set(by_name(refused)) == set(by_name(accepted)) == {"orientation"}
    assert accepted.passed and not refused.passed


@pytest.mark.parametrize(
    ("model", "shown", "name"),
    [
        (RendererModel(film=Film.XY), ["triangle"], "equal-angles"),
        (RendererModel(normals=Normals.FLAT), ["triangle", "color"], "flat-normals"),
    ],
)
def test_a_lens_and_flat_normals_are_named_from_few_small_hogels(
    model: RendererModel, shown: list[str], name: str
) -> None:
    scene = oblong()
    smooth = replace(scene, objects=tuple(map(with_smooth_normals, scene.objects)))
    result = of_model(smooth, model, shown, FEW)
    assert set(by_name(result)) == {name} and not result.passed


# With a recentered frustum, some defects look alike: moved screens, shifts, and wrong shears.


PER_PX = 160.0 / 32
"""Width of a pixel on the screen of `asymmetric-recentered`, mm."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "model", "apertures", "fault", "alternatives"),
    [
        # The first name is the likelier mistake: sampling points lie within their pixels.
        (RECENTERED, {"screen_center": (-0.5 * PER_PX, 0.0)}, FEW, "shift-x", ["screen-center-x"]),
        (RECENTERED, {"screen_center": (-3 * PER_PX, 0.0)}, FEW, "screen-center-x", ["shift-x"]),
        ("asymmetric", {"shift": (3.0, 0.0)}, FEW, "shift-x", []),
        # One hogel leaves the shear open.
        (
            RECENTERED,
            {"recentering": Recentering.NONE},
            FEW[:1],
            "not-recentered",
            ["screen-center-x", "screen-center-y", "shift-x", "shift-y"],
        ),
    ],
)
def test_defects_that_show_the_same_images_name_each_other(
    name: str,
    model: dict[str, Any],
    apertures: list[tuple[int, int]],
    fault: str,
    alternatives: list[str],
) -> None:
    (defect,) = diagnosed(small(name, 32), RendererModel(**model), apertures).values()
    assert (defect.fault, list(defect.alternatives)) == (fault, alternatives)


@pytest.mark.slow
def test_one_side_of_the_plate_leaves_the_shear_open() -> None:
    scene = small(RECENTERED, 32)
    before = replace(scene, frustum=replace(scene.frustum, reach=(scene.frustum.reach[0], 1e-3)))
    model = RendererModel(recentering=Recentering.C_STAR_REVERSED)
    (defect,) = diagnosed(before, model).values()
    assert (defect.fault, defect.value) == ("shear-sign", "C*") and defect.details


@pytest.mark.slow
def test_a_half_that_leaves_the_film_by_a_wrong_shear_is_not_called_missing() -> None:
    """With both shears reversed, the corner hogel shows only surfaces behind the plate."""
    (case,) = chosen(names=["L3-attic-0"])
    model = RendererModel(recentering=Recentering.BOTH_REVERSED)
    defects = diagnosed(case.open(), model, [(0, 0)])
    # A single hogel looks the same with a moved screen.
    assert set(defects) <= {"shear-sign", "screen-center-x", "screen-center-y"}
    assert all("shear-sign" in (name, *of.alternatives) for name, of in defects.items())


@pytest.mark.slow
@settings(max_examples=8)
@given(
    x=st.floats(-6, 6),
    z=st.floats(-3, 3),
    scale=st.floats(0.7, 1.5),
    which=st.sampled_from(["aperture_offset", "scene_offset", "scene_scale"]),
)
def test_the_interval_of_any_offset_contains_it(
    x: float, z: float, scale: float, which: str
) -> None:
    scene = small(size=SIZE)
    numbers = {"aperture_offset": (x, -x), "scene_offset": (x, -x, z), "scene_scale": scale}
    factor = scale if which == "scene_scale" else 1.0
    move = np.array((x, -x, z) if which == "scene_offset" else (0.0, 0.0, 0.0))
    shifted = x if which == "aperture_offset" else 0.0
    parts = [replace(part, vertices=part.vertices * factor + move) for part in scene.objects]
    reference, images = Reference(replace(scene, objects=tuple(parts))), []
    for index in SOME:
        aperture = scene.plate.aperture(*index)
        there = replace(aperture, x=aperture.x + shifted, y=aperture.y - shifted)
        image = reference.trace(there)
        images.append(replace(image, camera=replace(image.camera, aperture=aperture)))
    fit = fit_geometry(claims_of(scene, images), NOMINAL)
    nominal, field = NOMINAL.parameters, {which: numbers[which]}
    expected = replace(NOMINAL, **field).parameters  # type: ignore[arg-type]
    assert np.all(fit.low <= expected + 1e-12) and np.all(fit.high >= expected - 1e-12)
    off = np.flatnonzero((fit.low > nominal) | (fit.high < nominal))
    assert set(off) <= set(np.flatnonzero(expected != nominal))


# Findings explain wrong pixels, or there are no findings. Defects with equal images name each
# other.


@pytest.mark.slow
def test_without_a_named_defect_the_places_of_errors_are_counted() -> None:
    """One hogel of a renderer shows an object in another place."""
    scene = small(size=SIZE)
    *others, bar = scene.objects
    moved = replace(bar, vertices=bar.vertices + np.array([0.0, -6.0, 4.0]))
    right, wrong = (
        Reference(replace(scene, objects=objects)) for objects in (scene.objects, (*others, moved))
    )

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        reference = wrong if aperture.index == (2, 3) else right
        image = saying(trace_drawn(reference, NOMINAL, aperture), "triangle")
        return replace(image, camera=right.camera(aperture))

    result = xfrustum.verify(scene, draw, apertures=SOME)
    assert not result.passed and not result.diagnosis.faults
    where = result.summary()["where"]
    counts = where["shares"]
    pixels = counts["column"]["2"]["wrong"]
    assert pixels == counts["row"]["3"]["wrong"] == sum(where["sides"].values()) > 0
    assert where["hogels"][3][2] == pixels
    assert max(counts["object"], key=lambda name: counts["object"][name]["wrong"]) == "7 (bar)"
    assert "wrong by column of hogels: 2 " in table(result)
    assert "by column of hogels: 2 " in render_page(result)


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (RendererModel(missing=(6,)), {"object-missing": "object 6 (cylinder)"}),
        (
            RendererModel(shows=(((0, 0), ((4, 1),)), ((4, 1), ((0, 0),)), ((2, 3), ((3, 1),)))),
            {
                "stale-hogel": "hogel 2,3 shows 3,1's image",
                "hogels-exchanged": "hogel 0,0 shows 4,1's image; hogel 4,1 shows 0,0's image",
            },
        ),
    ],
)
def test_a_missing_object_and_hogels_with_others_images_are_named(
    model: RendererModel, expected: dict[str, str]
) -> None:
    result = of_model(oblong(), model, apertures=[*FEW, (3, 2), (1, 0), (0, 3)])
    defects = {defect["fault"]: defect for defect in result.defects()}
    assert defects.keys() == expected.keys()
    for name, words in expected.items():
        assert defects[name]["words"].startswith(words) and defects[name]["explains"] == 1.0


@pytest.mark.slow
def test_a_candidate_that_explains_too_little_is_no_finding() -> None:
    """A near offset widens the picture most near the plate; a wrong field of view scales it all."""
    scene = small("asymmetric", SIZE)
    with Faulty(scene=scene, near=8.0, fov=(1.1, 0.95), shown="color") as renderer:
        result = xfrustum.verify(scene, renderer, apertures=SOME)
    guesses = {defect.fault: defect.explains for defect in result.diagnosis.does_not_explain}
    assert not result.passed and result.diagnosis.faults == ()
    assert guesses.keys() >= {"fov-x", "fov-y"}
    assert all(share is not None and share < MIN_EXPLAINED_FRACTION for share in guesses.values())
    summary = result.summary()
    assert summary["corrected"] == summary["as_found"]
    assert "no known fault explains" in table(result)
    assert "No known fault explains what is wrong" in render_page(result)


def alone(part: SceneObject) -> Scene:
    """Return a scene with one object."""
    return replace(small("asymmetric", 32), objects=(part,))


def flat() -> Scene:
    """Return a scene of three triangles side by side, 30 mm behind the plate."""
    corners = (
        *((-24, -9), (-4, -13), (-12, 12), (3, -12), (22, -8)),
        *((5, -1), (-3, 4), (25, 6), (8, 16)),
    )
    vertices = np.array([(x, y, -30.0) for x, y in corners])
    return alone(SceneObject(name="flat", vertices=vertices, faces=np.arange(9).reshape(-1, 3)))


@pytest.mark.parametrize(
    ("model", "names", "size", "alternatives"),
    [
        # The near offset is a sixth of the depth.
        (RendererModel(near=5.0), {"fov-x", "fov-y"}, 7 / 6, ("near",)),
        (
            RendererModel(scene_offset=(1.0, 0.0, 0.0)),
            {"shift-x"},
            -0.924,  # px: 1 mm of 30 mm, of a film 2 tan(30 degrees) wide
            ("scene-offset-x", "aperture-offset-x"),
        ),
    ],
)
def test_defects_that_show_the_same_pictures_at_one_depth_name_each_other(
    model: RendererModel, names: set[str], size: float, alternatives: tuple[str, ...]
) -> None:
    result = of_model(flat(), model, ("color",), [(2, 2), (1, 2), (3, 1), (2, 3)])
    assert set(by_name(result)) == names
    for defect in result.diagnosis.faults:
        assert defect.value == pytest.approx(size, abs=0.01)
        assert defect.alternatives == alternatives
    words = "; ".join(defect["words"] for defect in result.defects())
    assert f"or {alternatives[0]}" in words and "colors cannot tell" in words


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [RendererModel(culled=Culled.COUNTERCLOCKWISE), RendererModel(front=Front.NEAREST)]
)
def test_a_culled_sphere_and_a_wrong_depth_test_name_each_other(
    model: RendererModel,
) -> None:
    sphere = build_shape("sphere")
    scene = alone(replace(sphere, vertices=12 * sphere.vertices + [3.0, -2.0, 25.0]))
    (defect,) = of_model(scene, model, apertures=SOME).diagnosis.faults
    assert (defect.fault, defect.alternatives) == ("front-nearest", ("culling",))


def test_a_pixel_is_wrong_by_the_rules_of_the_verdict() -> None:
    scene = oblong()
    reference, images = Reference(scene), []
    for index in FEW:
        image = reference.trace(scene.plate.aperture(*index))
        assert image.color is not None
        images.append(saying(replace(image, color=0.5 * image.color), "color"))
    test = TestSet(reference=reference, images=images, nominal=NOMINAL)
    wrong = test.wrong(NOMINAL)
    assert wrong > 0 == test.of(images, Judging(color_tolerance=1.0)).wrong(NOMINAL)
    assert test.of(images, Judging(compared=Compared.GEOMETRY)).wrong(NOMINAL) < wrong / 10


@pytest.mark.parametrize(
    "options",
    [
        *({name: "x"} for name in ("max_wrong", "max_displacement_px", "max_color", "accept")),
        *({"near": True}, {"encoding": "banana"}, {"compare": "banana"}),
        *({"apertures": [entry]} for entry in ("x", (0, "x"), 3)),
    ],
)
def test_options_without_a_meaning_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        xfrustum.verify(oblong(), "none_{i}_{j}.png", **options)


@pytest.mark.slow
def test_wrong_hogels_outside_the_sample_are_listed_to_be_diagnosed() -> None:
    """Two hogels of 63 are exchanged; neither is among the 25 diagnosed hogels."""
    scene = oblong()
    scene = replace(scene, plate=replace(scene.plate, hogels=(9, 7)))
    model = RendererModel(shows=(((3, 2), ((7, 5),)), ((7, 5), ((3, 2),))))
    result = of_model(scene, model)
    assert not result.passed and not result.diagnosis.faults
    assert "diagnose some of both, --apertures '3,2;7,5;..'" in table(result)
    others = [(0, 0), (4, 3), (8, 6), (1, 5), (6, 1)]
    again = of_model(scene, model, apertures=[(3, 2), (7, 5), *others])
    assert set(by_name(again)) == {"hogels-exchanged"}


# Recentered frustum with its screen off to the side of the plate

CENTER_X = -26.0  #: x of the screen's center, mm


def torus_and_sphere(folder: Path, hogels: tuple[int, int], resolution: tuple[int, int]) -> Scene:
    """Return a torus in front of the plate and a sphere behind it."""
    text = named("beside", "mm") + (
        f"[plate]\nsize = [30.0, 30.0]\nhogels = {list(hogels)}\n"
        f"[frustum]\nresolution = {list(resolution)}\n"
        f"screen = {{ height = -100.0, center = [{CENTER_X}, 0.0], size = [200.0, 120.0] }}\n"
        "reach = [40.0, 110.0]\n"
    )
    text += part("torus", 14.0, (6.0, 2.0, 20.0), rotate_deg=(20.0, 30.0, 0.0))
    text += part("sphere", 60.0, (-20.0, 5.0, -70.0))
    (folder / "scene.toml").write_text(text)
    return open_scene(str(folder / "scene.toml"))


def test_the_exchanged_center_of_a_screen_is_named(tmp_path: Path) -> None:
    """In a single hogel, a shear of the opposite sign looks the same."""
    scene = torus_and_sphere(tmp_path, (1, 1), (60, 36))
    model = RendererModel(screen_center=(-2 * CENTER_X, 0.0))
    (defect,) = diagnosed(scene, model, [(0, 0)]).values()
    assert defect.fault == "screen-center-x" and defect.explains == 1.0
    assert defect.value == pytest.approx(-CENTER_X, rel=0.02)
    assert "shear-sign" in defect.alternatives


@pytest.mark.slow
def test_vertical_parameters_are_fixed_if_films_have_one_row(tmp_path: Path) -> None:
    """Shuffle the columns of apertures, so that no camera explains the images."""
    scene = torus_and_sphere(tmp_path, (5, 3), (80, 1))
    images = observed(scene, NOMINAL, [(i, j) for j in range(3) for i in range(5)]).images
    shuffled = [replace(images[k], camera=images[7 * k % 15].camera) for k in range(15)]
    fit = fit_geometry(claims_of(scene, shuffled), NOMINAL)
    vertical = np.array([axis == "y" for _, axis, _ in NUMBERS])
    assert (fit.model.parameters == NOMINAL.parameters)[vertical].all()
    assert (fit.low == fit.high)[vertical].all()


def test_numbers_are_restored_from_the_stated_offset_cameras(tmp_path: Path) -> None:
    scene, nominal = torus_and_sphere(tmp_path, (1, 1), (60, 36)), RendererModel(near=6.0)
    (image,), (centered,) = (
        observed(scene, model, [(0, 0)]).images for model in (nominal, NOMINAL)
    )
    assert (image.triangle != centered.triangle).any()
    channels = {name: getattr(image, name) for name in ("triangle", "object", "position")}
    stored = ForeignImage(
        camera=image.camera, stored=StoredPixels(rgb=bytes_of(image.triangle + 1)), **channels
    )
    reading = Reading(encoding=Encoding.TRIANGLE_ID)
    restoring = IdRepair(kind=RESAMPLED, reading=reading, nominal=nominal)
    assert (restoring.read(Reference(scene), stored).triangle == image.triangle).all()
