"""One hogel of a foreign renderer, judged by a question: the truth, or what its author declares."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.causes import cause_masks
from xfrustum.compare.displacement import Spread, lengths
from xfrustum.compare.drawn_model import DrawnModel
from xfrustum.compare.drawn_trace import trace_drawn
from xfrustum.compare.error_maps import judged_pixels
from xfrustum.compare.pictures import colors_differ, reference_colors, shows_something
from xfrustum.compare.rounding import position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.visibility import hidden
from xfrustum.scenes.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.plate import Aperture

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """How one image differs from what a question asks for.

    Attributes
    ----------
    shown
        Judged pixels where image or answer shows a surface.
    by
        What `wrong` counts: triangle, object, color, or coverage.
    wrong
        Of these, the ones that differ.
    surface
        Of these, the ones with the wrong surface; None where the image does not say.
    displacement_px
        Of the surface points shown; None where the image does not say.
    radiance
        Pixels with the right surface in another color; None where the image does not say both.
    causes
        Why pixels are wrong; None where that was not asked.
    answer
        What should be shown.
    image
        The image as the question turns it.
    error
        (H, W) pixels that are wrong: of the surface, or whatever can be told.
    unexplained
        (H, W) pixels that `wrong` counts, upright, without those whose cause was asked for and found.
    """

    shown: int
    by: str
    wrong: int
    surface: int | None
    displacement_px: Spread | None
    radiance: int | None
    causes: dict[str, int] | None
    answer: HogelImage
    image: HogelImage
    error: Mask
    unexplained: Mask

    @property
    def fraction(self) -> float:
        """Share of wrong pixels."""
        return self.wrong / self.shown if self.shown else 0.0

    @property
    def judged_fraction(self) -> float:
        """What a limit on wrong pixels is compared with: surfaces, where the image tells them."""
        count = self.wrong if self.surface is None else self.surface
        return count / self.shown if self.shown else 0.0

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `verify --json` prints them."""
        surface = None
        if self.surface is not None:
            surface = {"wrong": self.surface, "fraction": self.judged_fraction}
        return {
            "shown": self.shown,
            "by": self.by,
            "wrong": self.wrong,
            "fraction": self.fraction,
            "surface": surface,
            "displacement_px": asdict(self.displacement_px) if self.displacement_px else None,
            "radiance": None if self.radiance is None else {"wrong": self.radiance},
            "causes": self.causes,
        }


def judge(
    reference: Reference, question: DrawnModel, image: HogelImage, points: Floats, *, explained: bool = False
) -> Figures:
    """Compare an image with what a question asks for.

    Parameters
    ----------
    reference
        Of the scene.
    question
        How the renderer is supposed to draw: `DrawnModel()` is the true crossed frustum.
    image
        As found, its camera that of the aperture that its file is named after.
    points
        (H, W, 3) surface points that it shows, as found (`shown_points`).
    explained
        Whether to find causes, by triangles.
    """
    scene = reference.scene
    aperture = question.answers(scene, image.camera.aperture)
    answer = trace_drawn(reference, question, aperture)
    upright = turned(reference, question, image, aperture, points)
    by = _named_by(image)
    if by == "color":
        answer = reference_colors(reference, question, answer)
        covered: Mask = shows_something(upright)
        differs = colors_differ(answer, upright)
    else:
        covered = covered_by(upright)
        names = "covered" if by == "coverage" else by
        differs = getattr(answer, names) != getattr(upright, names)
    shown = judged_pixels(answer) & (answer.covered | covered)
    differs &= shown
    surface = None if by == "color" else wrong_surfaces(reference, question, answer, upright) & shown
    moved = question.project(scene, aperture, upright.position.astype(np.float64))
    height, width = differs.shape
    moved -= np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    length = lengths(moved)
    radiance = None
    if by != "color" and image.color is not None:
        colored = reference_colors(reference, question, answer)
        radiance = colors_differ(colored, upright) & shown & ~(differs if surface is None else surface)
        radiance &= answer.triangle == upright.triangle
    masks = None
    if explained and by == "triangle":
        masks = cause_masks(scene, question, answer, upright, differs)
    return Figures(
        shown=int(shown.sum()),
        by=by,
        wrong=int(differs.sum()),
        surface=None if surface is None else int(surface.sum()),
        displacement_px=Spread.of(length[np.isfinite(length)]),
        radiance=None if radiance is None else int(radiance.sum()),
        causes=None if masks is None else {name: int(mask.sum()) for name, mask in masks.items()},
        answer=answer,
        image=upright,
        error=(differs if surface is None else surface) | (False if radiance is None else radiance),
        unexplained=differs if masks is None else masks["unexplained"],
    )


def turned(
    reference: Reference, question: DrawnModel, image: HogelImage, aperture: Aperture, points: Floats
) -> HogelImage:
    """Return an image as a question turns it, as that of the aperture which it then answers for."""
    scene, upright = reference.scene, question.orientation.upright
    triangle = upright(image.triangle)
    known = np.where(triangle < len(scene.faces), triangle, NOTHING)
    by_triangle = np.append(scene.object_of_triangle, np.int32(NOTHING))[known]
    objects = upright(image.object)
    return HogelImage(
        camera=reference.camera(aperture),
        triangle=triangle,
        object=np.where(objects != NOTHING, objects, by_triangle),
        position=upright(points),
        color=None if image.color is None else upright(image.color),
    )


def _named_by(image: HogelImage) -> str:
    """Return what an image names its surfaces by; one that shows none at all, by what it could have."""
    if (image.triangle != NOTHING).any():
        return "triangle"
    if (image.object != NOTHING).any():
        return "object"
    if np.isfinite(image.height).any():
        return "coverage"
    return "triangle" if image.color is None else "color"


def covered_by(image: HogelImage) -> Mask:
    """Return the pixels that show a surface, by whichever number or position an image has."""
    return np.asarray(image.covered | (image.object != NOTHING))


def wrong_surfaces(reference: Reference, question: DrawnModel, answer: HogelImage, image: HogelImage) -> Mask:
    """Return the pixels that show the wrong surface, (H, W): see `xfrustum.compare.surface`.

    A point is hidden when its own camera's line meets something else first, or when it lies behind
    the plate and the answer has the viewer's half where the point is drawn.
    """
    covered = covered_by(image)
    # What an image does not say of its objects is taken from the answer.
    objects = np.where(covered & (image.object == NOTHING), answer.object, image.object)
    wrong: Mask = np.asarray((answer.covered != covered) | (answer.object != objects))
    known = np.isfinite(image.position).all(axis=-1) & ~wrong & covered
    if not question.plain:
        return wrong
    scene, aperture = reference.scene, answer.camera.aperture
    plate = question.plate_height
    sides = [(0, known & (image.height != plate))]
    if question.near:
        sides = [(1, known & (image.height < plate)), (-1, known & (image.height > plate))]
    for side, asked in sides:
        position, number = image.position[asked].astype(np.float64), image.triangle[asked]
        number = np.where(number < len(scene.faces), number, NOTHING).astype(np.int32)
        points = SurfacePoints(
            position=position, triangle=number, tolerance=position_tolerance(scene, number, position)
        )
        wrong[asked] |= hidden(reference.tracer, scene, question.pencil(scene, aperture, side), points)
        if side == 1:
            wrong[asked] |= _covered_by_front(question, reference, answer, position)
    return wrong


def _covered_by_front(question: DrawnModel, reference: Reference, answer: HogelImage, points: Floats) -> Mask:
    """Return which points behind the plate are drawn where the answer shows the viewer's half."""
    place = question.project(reference.scene, answer.camera.aperture, points)
    width, height = answer.camera.resolution
    on_film: Mask = np.all((place > -0.5) & (place < (width - 0.5, height - 0.5)), axis=1)
    column, row = np.rint(np.where(on_film[:, None], place, 0.0)).astype(np.int64).T
    with np.errstate(invalid="ignore"):
        return np.asarray(on_film & (answer.height[row, column] > question.plate_height))
