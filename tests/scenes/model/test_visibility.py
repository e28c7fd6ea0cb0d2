"""Visible surfaces: no surface of the truth is missed, and invisible scenes are refused."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.commands import Command
from tests.support.long_tail import examples, thinned
from tests.support.scene_file import film, named, part
from tests.support.views import soup
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.text import require_seen, unseen_sentence, warnings
from xfrustum.scenes import (
    DoubleFrustum,
    Frustum,
    Plate,
    Scene,
    SceneObject,
    open_scene,
)
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.model.visibility import (
    Region,
    apertures_drawn,
    apertures_in_view,
    extents,
    share_between,
)
from xfrustum.scenes.plate import Screen

FILM_SIZE: dict[str, Any] = {"resolution": (48, 40), "reach": (10.0, 14.0)}
FRUSTA = pytest.mark.parametrize(
    "frustum",
    [
        Frustum(fov=(math.radians(60), math.radians(50)), **FILM_SIZE),
        Frustum(screen=Screen(height=-8.0, center=(1.0, -2.0), size=(9.0, 8.0)), **FILM_SIZE),
        Frustum(screen=Screen(height=6.0, center=(-1.0, 1.0), size=(9.0, 8.0)), **FILM_SIZE),
    ],
    ids=["centered", "behind", "before"],
)

FILM = film(
    (80.0, 60.0), hogels=(9, 7), resolution=(24, 24), fov_deg=(60.0, 60.0), reach=(150.0, 150.0)
)
COMMANDS = {
    "report": "--near 0.1 --depth d24 --out out --quiet",
    "plan": "--quiet",
    "cost": "--repeat 1 --quiet",
    "budget": "--near 0.1 --quiet",
    "study figure7": "--out out",
    "verify": "{i}-{j}.png --quiet",
    "trace": "--out out.exr --quiet",
    "raster": "--near 0.1 --out out.exr",
    "plate": "--near 0.1 --out out.zarr --quiet",
}


def write(folder: Path, scale: float, translate: tuple[float, float, float]) -> str:
    """Write the file of a scene of one sphere."""
    path = folder / "scene.toml"
    path.write_text(named("scene", "mm") + FILM + part("sphere", scale, translate))
    return str(path)


def triangles(seed: int, count: int, size: float) -> np.ndarray:
    """Return triangles of some size, scattered over more than the frusta contain."""
    random = np.random.default_rng(seed)
    return random.uniform(-13, 13, (count, 1, 3)) + random.normal(0, size, (count, 3, 3))


def scene_object(corners: object) -> SceneObject:
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 3)
    return SceneObject(name="one", vertices=points, faces=np.arange(len(points)).reshape(-1, 3))


@FRUSTA
@pytest.mark.parametrize("size", [0.3, pytest.param(5.0, marks=pytest.mark.slow)])
def test_surfaces_of_the_truth_are_in_view(frustum: Frustum, size: float) -> None:
    """Many triangles in view appear in their own images, so that the test is not trivial."""
    scene = soup(triangles(5, 60, size), frustum)
    shown, claimed = set(), set()
    for index in ((8, 8), (0, 0), (15, 3)):
        aperture = scene.plate.aperture(*index)
        here = ((aperture.x, aperture.x), (aperture.y, aperture.y))
        region = Region(frustum=frustum, apertures=here, reach=frustum.reach)
        # Trace each triangle in view alone: other triangles would hide some.
        for number, corners in enumerate(scene.triangles):
            part = scene_object(corners)
            if region.shows(part):
                claimed.add((index, number))
                alone = Scene(name="one", plate=scene.plate, frustum=frustum, objects=(part,))
                if (Reference(alone).trace(aperture).triangle >= 0).any():
                    shown.add((index, number))
        truth = Reference(scene).trace(aperture).triangle
        assert {(index, int(k)) for k in np.unique(truth[truth >= 0])} <= claimed
    assert len(claimed) > 7
    assert len(shown) > (0.7 if size > 1 else 0.4) * len(claimed)


@FRUSTA
def test_apertures_that_may_draw_something_are_counted_with_none_left_out(frustum: Frustum) -> None:
    """Offset cameras image more than the truth: the truth's hogels are a subset of theirs."""
    plate = Plate(size=(16.0, 16.0), hogels=(6, 6))
    drawn, only_drawn = 0, 0
    for corners in triangles(5, 4, 0.3):
        scene = Scene(name="one", plate=plate, frustum=frustum, objects=(scene_object(corners),))
        settings = DoubleFrustum(near=0.2 * frustum.longest_reach)
        flags = apertures_drawn(scene, [DoubleFrustum(near=1e-3), settings])
        seen = apertures_in_view(scene.objects[0], frustum, plate)
        assert not (seen & ~flags).any() and not flags.all()
        with Rasterizer(scene) as raster:
            for aperture in plate.apertures():
                image = raster.render(aperture, settings, normals=False, color=False)
                covered = bool(image.covered.any())
                assert flags[aperture.row, aperture.column] or not covered
                drawn += covered
                only_drawn += covered and not seen[aperture.row, aperture.column]
    assert drawn > only_drawn > 0


def test_the_apertures_of_a_distant_square_are_those_whose_lines_reach_it() -> None:
    """At depth 10, a field of 2 atan(1/2) extends 5 to each side: apertures within 6 see it."""
    angle = 2 * math.atan(0.5)
    frustum = Frustum(resolution=(64, 64), reach=(20.0, 20.0), fov=(angle, angle))
    plate = Plate(size=(21.0, 21.0), hogels=(21, 21))
    low, high = (-1.0, -1.0, -10.0), (1.0, 1.0, -10.0)
    square = scene_object([low, (1.0, -1.0, -10.0), high, low, high, (-1.0, 1.0, -10.0)])
    scene = Scene(name="square", plate=plate, frustum=frustum, objects=(square,))
    (extent,) = extents(scene)
    assert extent.sight.apertures == 13 * 13 and extent.sight.of == 21 * 21
    assert extent.sight.columns == extent.sight.rows == (4, 16)
    assert extent.sight.middle and not any(extent.sight.corners)


def test_a_surface_that_touches_the_edge_of_a_frustum_is_in_view() -> None:
    screen = Screen(height=2.0, center=(0.0, 0.0), size=(4.0, 4.0))
    frustum = Frustum(resolution=(64, 64), reach=(20.0, 20.0), screen=screen)
    region = Region(frustum=frustum, apertures=((0.0, 0.0), (0.0, 0.0)), reach=frustum.reach)
    touching = np.array([[(1.0, 0.0, 1.0), (2.0, 0.0, 1.0), (2.0, 1.0, 1.0)]])
    assert region.holds(touching).all()
    assert not region.holds(touching + np.array([1e-9, 0.0, 0.0])).any()


@examples(60)
@given(
    st.lists(st.floats(-4, 4), min_size=9, max_size=9),
    st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(sorted),
)
def test_shares_of_a_surface_between_heights_add_up(
    corners: list[float], heights: list[float]
) -> None:
    low, middle, high = heights
    triangle = np.array(corners).reshape(1, 3, 3)
    ends = ((low, high), (low, middle), (middle, high))
    whole, lower, upper = (float(share_between(triangle, *pair)[0]) for pair in ends)
    if np.ptp(triangle[..., 2]) == 0:  # a flat object in the cut is counted on either side
        assert whole == max(lower, upper)
    else:
        assert abs(whole - lower - upper) < 1e-9 and 0 <= whole <= 1


def test_half_way_up_a_triangle_lies_a_quarter_of_its_surface() -> None:
    upright = np.array([[(0.0, 0.0, 2.0), (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]])
    for triangle, upper in ((upright, 0.25), (upright * (1, 1, -1) + (0, 0, 2), 0.75)):
        assert share_between(triangle, 1.0, 2.0)[0] == pytest.approx(upper)
        assert share_between(triangle, -9.0, 1.0)[0] == pytest.approx(1 - upper)
    flat = upright * (1, 1, 0)  # a flat triangle at the height of a cut is counted on either side
    shares = [share_between(flat, *ends)[0] for ends in ((0, 1), (-1, 0), (0.1, 1))]
    assert shares == [1, 1, 0]


@pytest.mark.parametrize(
    "name", thinned((n for n in hard_cases.names(giants=False) if n != "hard/only-out-of-reach"), 7)
)
def test_no_hard_case_is_taken_for_empty(name: str) -> None:
    scene = open_scene(name)
    for index in hard_cases.CASES[name].apertures:
        require_seen(scene, [scene.plate.aperture(*index)])


@pytest.mark.parametrize("name", COMMANDS)
def test_a_scene_that_no_aperture_sees_is_refused_with_sizes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, 1000.0, (0.0, 0.0, -8500.0))
    printed = command(f"{name} scene.toml {COMMANDS[name]}", status=2)
    assert printed.out == "" and printed.err.count("\n") == 1
    message = "(sphere) spans 8,000 to 9,000 mm behind the plate; the reach is 150 mm there"
    assert message in printed.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.parametrize(("x", "side"), [(5000.0, "right"), (-5000.0, "left")])
def test_a_scene_aside_is_refused_with_its_distance(tmp_path: Path, x: float, side: str) -> None:
    scene = open_scene(write(tmp_path, 100.0, (x, 0.0, -80.0)))
    words = f"lies 4,950 to 5,050 mm to the {side} of the plate's middle; at its height"
    assert words in str(unseen_sentence(scene, scene.default_apertures()))


@pytest.mark.parametrize("name", ["trace", "plate"])
def test_a_black_picture_of_an_empty_hogel_is_right_with_a_warning(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, 10.0, (38.0, 0.0, -12.0))
    where = "--apertures" if name == "plate" else "--aperture"
    error = command(f"{name} scene.toml {where} 0,3 {COMMANDS[name]}").err
    assert "warning: scene: aperture 0,3 sees nothing" in error and "to the right" in error


def test_a_mesh_that_the_reach_cuts_is_a_warning_with_the_part_beyond(
    tmp_path: Path, command: Command
) -> None:
    """Equal slices of a sphere have equal areas: 20 of its 120 mm lie beyond the reach, or 1/6."""
    scene = write(tmp_path, 120.0, (0.0, 0.0, -110.0))
    warning = command(f"trace {scene} --out {tmp_path}/out.exr --quiet").err
    assert warning.count("\n") == 1
    words = "object 0 (sphere) spans 50 to 170 mm behind the plate, and the reach is 150 mm"
    assert words in warning
    share = float(warning.rpartition(": ")[2].partition(" %")[0])
    assert share == pytest.approx(100 / 6, abs=0.6)


def test_built_in_scenes_are_visible_and_leave_the_reach_only_on_purpose() -> None:
    for name in builtin.names():
        scene = open_scene(name)
        assert unseen_sentence(scene, scene.default_apertures()) is None
        assert bool(warnings(scene)) == (name == "large-triangles")
