"""Causes of wrong pixels, computed by hand for one triangle that the film's border cuts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.views import at, soup, view
from xfrustum.compare.judging.judged import (
    ANY_DEVICE,
    Judging,
    foreign_cameras,
    judge,
    wrong_pixels,
)
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.compare.rounding.causes import find_causes
from xfrustum.compare.rounding.edges import distance_to_segments
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, Frustum, HogelImage, Scene
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.device_model import LLVMPIPE, DeviceModel

SIZE, NEAR = 128, 1.0
SHIFT = (0.375, -0.25)
FRUSTUM = Frustum(resolution=(SIZE, SIZE), reach=(50.0, 50.0), fov=(math.pi / 2, math.pi / 2))
CENTER = at(0.3, -0.2)

PLACES = np.array([(30.0, 12.0), (118.0, 40.0), (47.0, 171.0)])
"""Corners on the film, px from its left and upper border; one corner lies below the film."""

Pictures = tuple[Scene, RendererModel, HogelImage, HogelImage]

SNAP_PX = math.sqrt(2) * ANY_DEVICE.half_step  # largest distance by which a corner snaps, px
CLEAR_PX = 0.5  # distance from edges beyond which rounding explains nothing, px


def scene_of_one_triangle() -> Scene:
    """Return the triangle that C, one unit in front of the plate, draws at `PLACES`."""
    w = np.array([21.0, 31.0, 16.0])
    slopes = PLACES * 2 / SIZE - 1
    x, y = CENTER.x + w * slopes[:, 0], CENTER.y - w * slopes[:, 1]
    return soup(np.stack((x, y, NEAR - w), axis=1)[None], FRUSTUM)


def cut() -> tuple[Floats, Floats]:
    """Return sides (4, 2, 2) and diagonals (2, 2, 2) of the part inside the film."""
    a, b, c = PLACES
    on_bc, on_ca = (p + (c - p) * (SIZE - p[1]) / (c[1] - p[1]) for p in (b, a))
    polygon = np.array([a, b, on_bc, on_ca])
    return np.stack((polygon, np.roll(polygon, -1, axis=0)), axis=1), polygon[[(0, 2), (1, 3)]]


def causes(
    scene: Scene,
    model: RendererModel,
    exact: HogelImage,
    lost: HogelImage,
    wrong: Mask,
    device: DeviceModel = ANY_DEVICE,
) -> dict[str, int]:
    """Return the number of wrong pixels by cause."""
    cameras = foreign_cameras(scene, model, CENTER, device)
    return find_causes(scene.triangles, cameras, exact, lost, np.flatnonzero(wrong)).counts()


@pytest.fixture(scope="module")
def pictures() -> Pictures:
    """Return scene, model, exact picture, and an empty picture."""
    scene, model = scene_of_one_triangle(), RendererModel(near=NEAR, shift=SHIFT)
    exact = trace_drawn(Reference(scene), model, CENTER)
    lost = replace(
        exact,
        triangle=np.full_like(exact.triangle, NOTHING),
        object=np.full_like(exact.object, NOTHING),
        position=np.full_like(exact.position, np.nan),
    )
    return scene, model, exact, lost


def distances(exact: HogelImage) -> tuple[Floats, Floats]:
    """Return distances (H, W) of pixel centers from the nearest side and the nearest diagonal."""
    column, row = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    points = np.stack((column + 0.5 + SHIFT[0], row + 0.5 + SHIFT[1]), axis=-1).reshape(-1, 2)
    side, diagonal = (distance_to_segments(points, lines).reshape(SIZE, SIZE) for lines in cut())
    return np.where(exact.covered, side, 0.0), diagonal


def test_only_holes_next_to_sides_and_clipped_diagonals_lie_on_an_edge(pictures: Pictures) -> None:
    scene, model, exact, lost = pictures
    side, diagonal = distances(exact)
    inside = (side > CLEAR_PX) & (diagonal > CLEAR_PX)
    split = (side > CLEAR_PX) & (diagonal < 0.9 * SNAP_PX)
    pair = (side > CLEAR_PX) & (diagonal > 1.1 * SNAP_PX)
    along = exact.covered & (side < 0.9 * SNAP_PX)
    assert inside.sum() > 1000 and split.sum() > 5 and along.sum() > 5
    nothing = {"order": 0, "lost": 0}
    result = causes(scene, model, exact, lost, inside)
    assert result == {"edge": 0, **nothing, "unexplained": inside.sum()}
    result = causes(scene, model, exact, lost, split | pair)
    assert result == {"edge": split.sum(), **nothing, "unexplained": pair.sum()}
    assert causes(scene, model, exact, lost, along)["edge"] == along.sum()
    # On a device with a finer grid, rounding explains only pixels next to the side.
    near = along & (side < math.sqrt(2) * LLVMPIPE.half_step)
    assert near.sum() < along.sum() / 2
    assert causes(scene, model, exact, lost, along, LLVMPIPE)["edge"] == near.sum()


def test_a_judge_explains_by_the_model_of_the_device_that_drew() -> None:
    reference = Reference(view("asymmetric", (96, 72)))
    truth = reference.trace(reference.scene.plate.middle)
    # The picture is shifted by a pixel, so that pixels beside outlines are wrong. Rounding explains
    # them within half a step of a grid of whole pixels, and rarely on a finer grid.
    moved = replace(truth, triangle=np.roll(truth.triangle, 1, axis=1))
    edges, left = [], []
    for device in (replace(LLVMPIPE, subpixel_bits=0), LLVMPIPE):
        options = reference, RendererModel(), moved
        judging = Judging(device=device)
        points = np.full((*truth.triangle.shape, 3), np.nan)
        result = judge(*options, points, judging, explained=True).numbers.causes
        assert result is not None
        edges += [result["edge"]]
        left += [wrong_pixels(*options, judging, explained=True)[1].sum()]
    assert edges[0] > 2 * edges[1]
    assert left[0] < left[1]


@pytest.mark.slow
def test_a_missing_half_lies_on_no_edge_however_fine_its_mesh() -> None:
    """Cracks between triangles lie along edges; a missing surface has only its outline."""
    count = 2 * SIZE  # four triangles along each side of a pixel
    cells = np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 1, 1, 2)
    halves = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]])
    x, y = np.moveaxis((cells + halves).reshape(-1, 3, 2) * 20 / count - 10, -1, 0)
    scene = soup(np.stack((x, y, np.full_like(x, -20.0)), axis=2), FRUSTUM)
    exact = trace_drawn(Reference(scene), RendererModel(), CENTER)
    here = exact.covered
    missing = replace(exact, triangle=np.full_like(exact.triangle, NOTHING))
    assert causes(scene, RendererModel(), exact, missing, here)["unexplained"] > 0.9 * here.sum()
    some = np.zeros_like(here)
    some[::3, ::3] = here[::3, ::3]
    cracked = replace(exact, triangle=np.where(some, NOTHING, exact.triangle))
    assert causes(scene, RendererModel(), exact, cracked, some)["edge"] > 0.3 * some.sum()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_camera_does_not_order_surfaces_behind_it(side: float) -> None:
    """Place two sheets before the plate and two behind it, a tenth of their height apart.

    C* draws the half before the plate, and C the half behind it. The matrix of the other camera
    also yields depths for sheets behind that camera; they must not count.
    """
    square = np.array([[-90.0, -90.0], [90.0, -90.0], [0.0, 90.0]])
    sheets = [np.column_stack((square, np.full(3, side * height))) for height in (30.0, 33.0)]
    scene = soup(np.stack(sheets), FRUSTUM)
    exact = trace_drawn(Reference(scene), RendererModel(), CENTER)
    covered = exact.triangle != NOTHING
    other = replace(exact, triangle=np.where(covered, 1 - exact.triangle, NOTHING).astype(np.int32))
    result = causes(scene, RendererModel(), exact, other, covered)
    assert result["order"] == result["lost"] == 0
    assert result["unexplained"] > 0.9 * covered.sum() > 0
