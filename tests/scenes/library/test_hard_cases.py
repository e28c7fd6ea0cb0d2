"""The suite of hard cases: the truth is as expected, and no answer ever breaks down."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.library.hard_views import SMALL, Index, companions_of, scene_of, truth_of
from tests.support.exact_brute_force import exact_pixels
from tests.support.long_tail import thinned
from tests.support.views import lines_by_definition
from xfrustum.compare.attribution.budget import explain
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    NOTHING,
    Certainty,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelImage,
    InputError,
    open_scene,
)
from xfrustum.scenes.library import builtin, hard_cases

VIEWS = [
    pytest.param(name, aperture, id=f"{name}-{aperture[0]},{aperture[1]}")
    for name in SMALL
    for aperture in hard_cases.CASES[name].apertures
]
DEPTHS = ((DepthFormat.D24, DepthMapping.STANDARD), (DepthFormat.D32F, DepthMapping.REVERSED))
NEARS = (1e-3, 1e-6)
"""Near offsets as fractions of the reach."""

LINE_ROUNDING = 4 * 2.0**-53
"""Two roundings in a coordinate a + s d of a surface point, relative to its terms, doubled."""

KIB, GIB = 1 << 10, 1 << 30
CHECKED_EXACTLY = 60
"""Pixels of each class that rational arithmetic decides again."""


def test_every_case_is_documented_listed_and_opened_by_its_name() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "hard-cases.md").read_text()
    listed = {entry.name: entry for entry in hard_cases.listing()}
    assert list(listed) == hard_cases.names()
    assert not set(listed) & set(builtin.names())
    for name, case in hard_cases.CASES.items():
        assert f"`{name}`" in page
        assert case.purpose and case.expected and "\n" not in case.purpose + case.expected
    for name in SMALL:
        assert scene_of(name).source == scene_of(name).name == name
        assert listed[name].triangles == len(scene_of(name).faces)
        assert scene_of(name).content_hash == hard_cases.build(name).content_hash
    with pytest.raises(InputError, match="did you mean hard/needles"):
        open_scene("hard/needle")


@pytest.mark.parametrize(("name", "aperture"), VIEWS)
def test_the_truth_is_finite_and_consistent(name: str, aperture: Index) -> None:
    scene, image = scene_of(name), truth_of(name, aperture)
    assert image.normal is not None and image.color is not None
    assert image.certainty is not None and image.companions is not None
    shown = image.triangle != NOTHING
    np.testing.assert_array_equal(image.covered, shown)
    assert np.isfinite(image.position[shown]).all() and np.isnan(image.position[~shown]).all()
    np.testing.assert_allclose(np.linalg.norm(image.normal[shown], axis=-1), 1.0, rtol=1e-12)
    assert np.isnan(image.normal[~shown]).all()
    assert np.isfinite(image.color).all() and not image.color[~shown].any()
    np.testing.assert_array_equal(image.object[shown], scene.object_of_triangle[image.triangle[shown]])
    assert (image.object[~shown] == NOTHING).all()
    viewer, back = scene.frustum.reach
    assert (image.height[shown] <= viewer).all() and (image.height[shown] >= -back).all()

    assert not (image.certainty == Certainty.UNEXAMINED).any()
    ties = companions_of(image)
    assert sorted(ties) == [tuple(index) for index in np.argwhere(image.certainty == Certainty.TIE).tolist()]
    for (row, column), triangles in ties.items():
        assert len(set(triangles)) == len(triangles) >= 2
        assert image.triangle[row, column] == min(triangles)
    # Every surface point lies on the line of its pixel.
    where = scene.plate.aperture(*aperture)
    center = np.array([where.x, where.y, 0.0])
    along = -image.height[..., None] * lines_by_definition(scene, where)
    off = np.abs(image.position - (center + along))[shown]
    assert (off <= LINE_ROUNDING * (np.abs(center) + np.abs(along[shown]))).all()


@pytest.mark.parametrize(("name", "aperture"), thinned((one.values for one in VIEWS), 7))
def test_rational_arithmetic_agrees(name: str, aperture: Index) -> None:
    scene, image = scene_of(name), truth_of(name, aperture)
    assert image.certainty is not None
    random = np.random.default_rng(5)
    classes = [np.flatnonzero(image.certainty.ravel() == kind) for kind in Certainty]
    pixels = np.concatenate([random.permutation(members)[:CHECKED_EXACTLY] for members in classes])
    ties = companions_of(image)
    for pixel, exact in zip(
        pixels.tolist(), exact_pixels(scene, scene.plate.aperture(*aperture), pixels), strict=True
    ):
        row, column = divmod(pixel, scene.frustum.resolution[0])
        assert image.triangle[row, column] == min(exact.winners, default=NOTHING), (row, column)
        assert -image.height[row, column] == pytest.approx(exact.s, rel=1e-12, abs=0, nan_ok=True)
        expected = exact.winners if len(exact.winners) > 1 else []
        assert ties.get((row, column), []) == expected, (row, column)


def bits(image: HogelImage) -> list[bytes]:
    assert image.normal is not None and image.color is not None
    return [a.tobytes() for a in (image.triangle, image.object, image.position, image.normal, image.color)]


@pytest.mark.parametrize("name", thinned(SMALL, 9))
def test_the_rasterizer_is_finite_explained_and_the_same_from_run_to_run(name: str) -> None:
    scene = scene_of(name)
    reference = Reference(scene)
    with Rasterizer(scene) as one, Rasterizer(scene) as other:
        for aperture in hard_cases.CASES[name].apertures:
            where = scene.plate.aperture(*aperture)
            for near in NEARS:
                for depth, mapping in DEPTHS:
                    settings = DoubleFrustum(
                        near=near * scene.frustum.longest_reach, depth=depth, mapping=mapping
                    )
                    drawn = one.render(where, settings)
                    shown = drawn.triangle != NOTHING
                    assert np.isfinite(drawn.position[shown]).all()
                    assert drawn.color is not None and np.isfinite(drawn.color).all()
                    assert bits(drawn) == bits(other.render(where, settings))
                    judged = compare_images(truth_of(name, aperture), drawn, reference)
                    json.dumps(judged.summary(), allow_nan=False)
                    model = reference.trace_model(where, settings)
                    explained = explain(scene, model, drawn, one.model)
                    assert not explained.unexplained.any(), (aperture, settings)


def peak_memory(work: str) -> int:
    """Return the largest memory, bytes, that a process of its own needed for some work."""
    # Not ru_maxrss: a program begins with that of the process that started it.
    measured = f"{work}\nfrom pathlib import Path\nprint(Path('/proc/self/status').read_text())"
    done = subprocess.run([sys.executable, "-c", measured], capture_output=True, text=True, check=True)
    peak = re.search(r"VmHWM:\s*(\d+) kB", done.stdout)
    assert peak, done.stdout
    return int(peak[1]) * KIB


BYTES_PER_TRIANGLE = 512
"""Largest memory: with two triangles a vertex, 132 stay: vertices 12, faces 24, corners 72, normals 24.

Making the normals takes about as much again three times over. An image takes nothing beside that.
"""


GIANTS = {
    "hard/giant-mesh": (
        "image = Reference(scene).trace(scene.plate.middle)\n"
        "assert image.covered.all() and -69 < image.height.min() and image.height.max() < -51\n"
        "assert (image.certainty == Certainty.PROVEN).mean() > 0.999\n",
        BYTES_PER_TRIANGLE * 10_000_000,
    ),
    "hard/giant-image": (
        "bands = list((len(band.triangle), int(band.covered.sum()), int((band.certainty != 0).sum()))\n"
        "    for band in Reference(scene).trace_bands(scene.plate.middle))\n"
        "rows, covered, unproven = map(sum, zip(*bands))\n"
        "assert rows == 8192 and 0.2 < covered / 8192**2 < 0.9 and unproven < 1e-3 * 8192**2\n",
        3 * GIB,
    ),
}
"""What is asserted of each giant, and the largest memory that it may take, bytes."""


@pytest.mark.slow
@pytest.mark.parametrize("name", GIANTS)
def test_giants_are_traced_in_bounded_memory(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    program, limit = GIANTS[name]
    needed = peak_memory(
        "from xfrustum.reference import Reference\nfrom xfrustum.scenes import Certainty, open_scene\n"
        f"scene = open_scene({name!r})\n"
        f"assert len(scene.faces) == {hard_cases.CASES[name].triangles}\n{program}"
    )
    record_property("peak_gib", needed / GIB)
    assert needed < limit


@pytest.mark.parametrize(("name", "aperture"), thinned((one.values for one in VIEWS), 9))
def test_the_truth_is_the_same_again(name: str, aperture: Index) -> None:
    scene, image = scene_of(name), truth_of(name, aperture)
    again = Reference(scene).trace(scene.plate.aperture(*aperture))
    for field in ("triangle", "object", "position", "normal", "color", "certainty", "companions"):
        np.testing.assert_array_equal(getattr(again, field), getattr(image, field), err_msg=field)
