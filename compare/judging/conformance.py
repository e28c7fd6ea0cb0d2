"""A hogel judged by a case of the conformance suite: each wrong pixel needs a reason to be excused.

The truth is that of the case's cameras without any rounding. A pixel that names another triangle is
accepted where the truth is a tie of both, or where rounding explains it: the classifier of causes
knows the bounds of edges and depths of the case's cameras. Colors and objects say nothing of
triangles: pixels that rounding may move across an edge to what a neighbor shows are not judged.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.conformance.suite import Case
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

RADIANCE_TOLERANCE = 1e-4
"""Largest difference of a truth's mean radiance from the frozen one: float32's rounding of sums and of the
functions of Phong's model differs among processors by a thousandth of this."""

AROUND = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if (down, right) != (0, 0)]
"""Rows and columns from a pixel to its eight neighbors, whose surfaces rounding may move across an edge."""

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """Numbers of pixels of one hogel, or of all hogels of a case together."""

    shown: int = 0  #: where image or truth shows something
    wrong: int = 0  #: of these, what is not the truth
    #: of the wrong ones, those that the truth is a tie of, or that an edge excuses from judging
    tie: int = 0
    edge: int = 0
    order: int = 0
    lost: int = 0
    unexplained: int = 0

    def __add__(self, other: Pixels) -> Pixels:
        return Pixels(
            **{one.name: getattr(self, one.name) + getattr(other, one.name) for one in fields(self)}
        )

    @property
    def words(self) -> str:
        """The numbers in words."""
        causes = {
            name: getattr(self, name) for name in ("tie", "edge", "order", "lost", "unexplained")
        }
        told = ", ".join(f"{count:,} {name}" for name, count in causes.items() if count)
        return f"{self.wrong:,} of {self.shown:,} pixels wrong" + (f" ({told})" if told else "")

    def within(self, case: Case) -> bool:
        """Return whether a case accepts them."""
        return self.unexplained <= case.wrong * self.shown


def question(case: Case) -> RendererModel:
    """Return what a case asks a renderer to draw."""
    return RendererModel(near=case.near or 0.0)


def trace(case: Case, reference: Reference, aperture: Aperture) -> HogelImage:
    """Return the truth of a hogel: certified, with the surfaces of each tie, and with color if asked."""
    asked = question(case)
    layer = drawn(reference, asked, aperture)
    answer = as_image(reference, aperture, layer)
    answer = reference_colors(reference, asked, answer) if case.colored else answer
    return replace(answer, tied_triangles=layer.tied_triangles)


def digest(truths: Sequence[HogelImage]) -> str:
    """Return the SHA-256 of triangles and ties of some hogels, which is the same on every machine."""
    content = hashlib.sha256()
    for truth in truths:
        assert truth.tied_triangles is not None
        tied = truth.tied_triangles[np.lexsort(truth.tied_triangles.T[::-1])]
        for numbers in (truth.triangle, tied):
            content.update(np.asarray(numbers.shape, dtype="<i8").tobytes())
            content.update(np.ascontiguousarray(numbers, dtype="<i4").tobytes())
    return content.hexdigest()


def mean_radiance(truths: Sequence[HogelImage]) -> float | None:
    """Return the mean of all true colors; None without any."""
    colors = [truth.color for truth in truths if truth.color is not None]
    return float(np.mean([color.mean(dtype=np.float64) for color in colors])) if colors else None


def agrees(case: Case, truths: Sequence[HogelImage]) -> bool:
    """Return whether truths are those that were frozen with a case."""
    if digest(truths) != case.digest:
        return False
    found = mean_radiance(truths)
    if case.radiance is None or found is None:
        return case.radiance == found
    return abs(found - case.radiance) <= RADIANCE_TOLERANCE


def stored(truth: HogelImage) -> Arrays:
    """Return the arrays by which a truth can be made again without tracing."""
    assert truth.tied_triangles is not None
    found: Arrays = {
        "triangle": truth.triangle,
        "companions": truth.tied_triangles.astype(np.int32),
    }
    return found if truth.color is None else found | {"color": truth.color.astype(np.float32)}


def restored(scene: Scene, camera: HogelCamera, arrays: Mapping[str, NDArray[Any]]) -> HogelImage:
    """Return the truth of `stored`; where its surfaces lie is not kept.

    Raises ValueError, TypeError or LookupError where the arrays are others.
    """
    # Types and shapes are those that `stored` gives: what has the frozen `digest` then differs in
    # nothing.
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


def cameras_of(
    case: Case, scene: Scene, aperture: Aperture, device: DeviceModel = ANY_DEVICE
) -> tuple[RoundingCamera, ...]:
    """Return the cameras of a case, which round as a device does."""
    exact = Precision(device=device, depth=case.depth, mapping=case.mapping)
    cameras = foreign_cameras(scene, question(case), aperture)
    return tuple(replace(camera, precision=exact) for camera in cameras)


def judged(
    case: Case, scene: Scene, truth: HogelImage, image: HogelImage, device: DeviceModel = ANY_DEVICE
) -> tuple[Pixels, Mask]:
    """Compare an image with the truth; return numbers, and the pixels (H, W) that nothing explains."""
    cameras = cameras_of(case, scene, truth.camera.aperture, device)
    if case.asked == "triangle-id":
        shown = (truth.triangle != NOTHING) | (image.triangle != NOTHING)
        differs = truth.triangle != image.triangle
        tied = differs & _ties(truth, image.triangle)
        causes = find_causes(
            scene.triangles, cameras, truth, image, np.flatnonzero(differs & ~tied)
        )
        # An edge excuses no triangle that lies elsewhere.
        kept = ~misplaced_pixels(scene.triangles, cameras, image).reshape(-1)[causes.pixels]
        counts = causes.some(kept).counts()
        left = causes.unexplained | (
            differs & ~tied & ~scattered(differs.shape, causes.pixels[kept])
        )
        counts["unexplained"] = int(left.sum())
        return Pixels(
            shown=int(shown.sum()), wrong=int(differs.sum()), tie=int(tied.sum()), **counts
        ), left
    if case.colored:
        if image.color is None:
            image = replace(
                image, color=np.full((*truth.triangle.shape, 3), np.nan, dtype=np.float32)
            )
        assert truth.color is not None and image.color is not None
        tolerance = COLOR_TOLERANCE if case.tolerance is None else case.tolerance
        differs = colors_differ(as_stored(truth, image), image, tolerance)
        shown = (truth.color > 0).any(axis=-1) | ~(image.color <= 0).all(axis=-1)
    else:
        objects = image.object
        if not (objects != NOTHING).any():  # OpenEXR may name triangles alone
            known = np.where(image.triangle < len(scene.faces), image.triangle, NOTHING)
            objects = scene.object_of_number[known]
        differs = truth.object != objects
        shown = (truth.object != NOTHING) | (objects != NOTHING)
    excused = differs & (_beside_edges(scene, cameras, truth, differs) | _ties(truth))
    left = differs & ~excused
    pixels = Pixels(
        shown=int(shown.sum()),
        wrong=int(differs.sum()),
        edge=int(excused.sum()),
        unexplained=int(left.sum()),
    )
    return pixels, left


def _ties(truth: HogelImage, named: Numbers | None = None) -> Mask:
    """Return the pixels (H, W) whose truth is a tie, or a tie of which an image names a surface."""
    assert truth.tied_triangles is not None
    row, column, number = truth.tied_triangles.T
    found = np.zeros(truth.triangle.shape, dtype=np.bool_)
    same = np.full(len(row), True) if named is None else named[row, column] == number
    found[row[same], column[same]] = True
    return found


def _beside_edges(
    scene: Scene, cameras: Sequence[RoundingCamera], truth: HogelImage, asked: Mask
) -> Mask:
    """Return those of some pixels (H, W) at which rounding may show a neighbor's surface."""
    found = np.zeros_like(asked)
    inner, padded = slice(1, -1), np.pad(truth.triangle, 1, mode="edge")
    for down, right in AROUND:
        moved = np.roll(padded, (-down, -right), axis=(0, 1))[inner, inner]
        pixels: Indices = np.flatnonzero(asked & ~found & (moved != truth.triangle))
        other = replace(truth, triangle=np.ascontiguousarray(moved))
        found |= find_causes(scene.triangles, cameras, truth, other, pixels).masks["edge"]
    return found
