"""Hogels judged by a case of the conformance suite: every wrong pixel needs an accepted reason.

The truth has the case's cameras without any rounding. A pixel with another triangle is accepted if
the truth is a tie of both triangles, or if rounding explains the pixel: the classifier of causes
uses the error bounds of edges and depths of the case's cameras. Colors and objects do not identify
triangles: pixels are not judged if rounding can move them across an edge to a neighbor's surface.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.error_maps import existing_triangles
from xfrustum.compare.judging.judged import ANY_DEVICE, foreign_cameras
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    as_image,
    as_stored,
    colors_differ,
    drawn,
    reference_colors,
)
from xfrustum.compare.rounding.causes import find_causes, misplaced_pixels, scattered
from xfrustum.compare.rounding.triangles import Precision, RoundingCamera
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.conformance_suite import Case
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

RADIANCE_TOLERANCE = 1e-4
"""Largest difference of a truth's mean radiance from the frozen mean radiance.

The float32 rounding of sums and of the functions in Phong's model differs among processors by a
thousandth of this.
"""

NEIGHBORS = [
    (down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if (down, right) != (0, 0)
]

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """Numbers of pixels of a hogel, or of all hogels of a case."""

    #: image or truth shows something
    shown: int = 0
    #: shown, and different from the truth
    wrong: int = 0
    #: wrong, but showing a surface of the truth's tie
    tie: int = 0
    #: wrong by rounding at an edge, or too close to an edge to be judged
    edge: int = 0
    #: wrong by rounding of depths
    order: int = 0
    #: wrong by rounding against the cleared depth
    lost: int = 0
    unexplained: int = 0

    def __add__(self, other: Pixels) -> Pixels:
        return Pixels(**{name: n + getattr(other, name) for name, n in vars(self).items()})

    def within(self, case: Case) -> bool:
        """Return whether a case accepts these numbers."""
        return self.unexplained <= case.wrong * self.shown


def renderer_model(case: Case) -> RendererModel:
    """Return the renderer that a case describes."""
    return RendererModel(near=case.near or 0.0)


def trace(case: Case, reference: Reference, aperture: Aperture) -> HogelImage:
    """Return a hogel's certified truth, with the triangles of ties, and with color if judged."""
    model = renderer_model(case)
    layer = drawn(reference, model, aperture)
    truth = as_image(reference, aperture, layer)
    truth = reference_colors(reference, model, truth) if case.colored else truth
    return replace(truth, tied_triangles=layer.tied_triangles)


def digest(truths: Sequence[HogelImage]) -> str:
    """Return the SHA-256 of triangles and ties of some hogels, the same on every machine."""
    content = hashlib.sha256()
    for truth in truths:
        assert truth.tied_triangles is not None
        tied = truth.tied_triangles[np.lexsort(truth.tied_triangles.T[::-1])]
        for numbers in (truth.triangle, tied):
            content.update(np.asarray(numbers.shape, dtype="<i8").tobytes())
            content.update(np.ascontiguousarray(numbers, dtype="<i4").tobytes())
    return content.hexdigest()


def mean_radiance(truths: Sequence[HogelImage]) -> float | None:
    """Return the mean of all true colors; None if there are none."""
    colors = [truth.color for truth in truths if truth.color is not None]
    return float(np.mean([color.mean(dtype=np.float64) for color in colors])) if colors else None


def is_frozen(case: Case, truths: Sequence[HogelImage]) -> bool:
    """Return whether truths have the frozen digest and mean radiance of a case."""
    radiance = mean_radiance(truths)
    if digest(truths) != case.digest:
        return False
    if case.radiance is None or radiance is None:
        return case.radiance == radiance
    return abs(radiance - case.radiance) <= RADIANCE_TOLERANCE


def stored(truth: HogelImage) -> Arrays:
    """Return the arrays that restore a truth without tracing; see `restored`."""
    assert truth.tied_triangles is not None
    arrays: Arrays = {
        "triangle": truth.triangle,
        "companions": truth.tied_triangles.astype(np.int32),
    }
    return arrays if truth.color is None else arrays | {"color": truth.color.astype(np.float32)}


def restored(scene: Scene, camera: HogelCamera, arrays: Mapping[str, NDArray[Any]]) -> HogelImage:
    """Return the truth of `stored`, without positions.

    Raises ValueError, TypeError or LookupError for other arrays.
    """
    # Use the types and shapes of `stored`: an equal digest then means equal arrays.
    triangle = arrays["triangle"].astype(np.int32).reshape(camera.resolution[::-1])
    color = arrays.get("color")
    return HogelImage(
        camera=camera,
        triangle=triangle,
        object=scene.object_of_number[triangle],
        position=np.full((*triangle.shape, 3), np.nan),
        tied_triangles=arrays["companions"].astype(np.int32).astype(np.int64).reshape(-1, 3),
        color=None if color is None else color.astype(np.float32).reshape(*triangle.shape, 3),
    )


def judged(
    case: Case, scene: Scene, truth: HogelImage, image: HogelImage, device: DeviceModel = ANY_DEVICE
) -> Pixels:
    """Count the pixels of an image that differ from the truth, by accepted reason.

    Wrong pixels are explained by the roundings of the device.
    """
    exact = Precision(device=device, depth=case.depth, mapping=case.mapping)
    cameras = tuple(
        replace(camera, precision=exact)
        for camera in foreign_cameras(scene, renderer_model(case), truth.camera.aperture)
    )
    assert truth.tied_triangles is not None
    row, column, number = truth.tied_triangles.T
    if case.encoding == "triangle-id":
        shown = (truth.triangle != NOTHING) | (image.triangle != NOTHING)
        differs = truth.triangle != image.triangle
        # Exact ties have no true triangle: any of their surfaces is right.
        right = image.triangle[row, column] == number
        tied = differs & _marked(differs, row[right], column[right])
        pixels = np.flatnonzero(differs & ~tied)
        causes = find_causes(scene.triangles, cameras, truth, image, pixels)
        # An edge does not excuse a triangle that is not at this edge: the pixel is unexplained.
        placed = ~misplaced_pixels(scene.triangles, cameras, image).reshape(-1)[causes.pixels]
        counts = causes.some(placed).counts()
        misplaced = differs & ~tied & ~scattered(differs.shape, causes.pixels[placed])
        counts["unexplained"] = int((causes.unexplained | misplaced).sum())
        counts["tie"] = int(tied.sum())
    else:
        compared = _compared_colors if case.colored else _compared_objects
        shown, differs = compared(case, scene, truth, image)
        near = _near_edges(scene, cameras, truth, differs) | _marked(differs, row, column)
        counts = {"edge": int((differs & near).sum()), "unexplained": int((differs & ~near).sum())}
    return Pixels(shown=int(shown.sum()), wrong=int(differs.sum()), **counts)


def _marked(like: Mask, row: Indices, column: Indices) -> Mask:
    """Return a mask of some pixels, with the shape of another mask."""
    marks = np.zeros_like(like)
    marks[row, column] = True
    return marks


def _compared_colors(
    case: Case, _: Scene, truth: HogelImage, image: HogelImage
) -> tuple[Mask, Mask]:
    """Return the pixels (H, W) that show something, and the pixels that differ."""
    assert truth.color is not None
    color = np.full_like(truth.color, np.nan) if image.color is None else image.color
    image = replace(image, color=color)
    tolerance = COLOR_TOLERANCE if case.tolerance is None else case.tolerance
    differs = colors_differ(as_stored(truth, image), image, tolerance)
    # Comparisons with NaN are False, so that a pixel without a color counts as wrong.
    shown = (truth.color > 0).any(axis=-1) | ~(color <= 0).all(axis=-1)
    return np.asarray(shown), differs


def _compared_objects(
    _: Case, scene: Scene, truth: HogelImage, image: HogelImage
) -> tuple[Mask, Mask]:
    """Return the pixels (H, W) that show something, and the pixels that differ."""
    objects = image.object
    if not (objects != NOTHING).any():  # OpenEXR files can have only triangle numbers
        objects = scene.object_of_number[existing_triangles(image.triangle, scene)]
    return (truth.object != NOTHING) | (objects != NOTHING), truth.object != objects


def _near_edges(
    scene: Scene, cameras: Sequence[RoundingCamera], truth: HogelImage, pixels: Mask
) -> Mask:
    """Return the given pixels (H, W) at which rounding can show a neighbor's surface."""
    excused = np.zeros_like(pixels)
    inner, padded = slice(1, -1), np.pad(truth.triangle, 1, mode="edge")
    for down, right in NEIGHBORS:
        # An edge within rounding of the pixel's center would show this neighbor's triangle there.
        moved = np.roll(padded, (-down, -right), axis=(0, 1))[inner, inner]
        candidates = np.flatnonzero(pixels & ~excused & (moved != truth.triangle))
        other = replace(truth, triangle=np.ascontiguousarray(moved))
        excused |= find_causes(scene.triangles, cameras, truth, other, candidates).masks["edge"]
    return excused
