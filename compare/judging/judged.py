"""One hogel of a foreign renderer, judged by a question: the truth, or what its author declares."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.compare.judging.causes import cause_masks
from xfrustum.compare.judging.outline_shift import (
    Steps,
    contrast,
    missing_outlines,
    outline_displacement,
    steps_of,
    true_outlines,
)
from xfrustum.compare.metrics.displacement import Spread, lengths
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.drawn_trace import trace_drawn
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    colors_differ,
    reference_colors,
    shows_something,
)
from xfrustum.compare.rounding.positions import position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.tracers.visibility import hidden
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.plate.plate import Aperture


class Compared(StrEnum):
    """What pictures without numbers are compared by."""

    COLOR = "color"
    GEOMETRY = "geometry"
    """Where they show something, and where outlines run; their shading may be any."""


class MeasuredBy(StrEnum):
    """What a displacement was measured by."""

    POINTS = "surface points"
    """Of a pixel that names a triangle which its line misses, the point of that triangle drawn nearest to
    it."""
    OUTLINES = "registration of outlines"
    NOTHING = "nothing"
    """It cannot be known."""


@dataclass(frozen=True, kw_only=True)
class Judging:
    """How images are judged.

    Attributes
    ----------
    compared
        What pictures without numbers are compared by.
    color_tolerance
        Difference of linear radiance that is no error.
    """

    compared: Compared = Compared.COLOR
    color_tolerance: float = COLOR_TOLERANCE


WRONG_WORDS = {
    "triangle": "wrong triangles",
    "object": "wrong objects",
    "coverage": "wrong coverage",
    "color": "wrong colors",
    "outlines": "wrong outlines",
}
"""What `Figures.wrong` counts, by `Figures.by`."""

PLAIN = ("color", "outlines")
"""What pictures are judged by that name no surfaces."""

SURFACES = "wrong surfaces"


@dataclass(frozen=True, kw_only=True)
class SurfaceFigures:
    """Pixels that show the wrong surface, and their share."""

    wrong: int
    fraction: float


@dataclass(frozen=True, kw_only=True)
class ColorFigures:
    """Pixels that show the right surface in another color."""

    wrong: int


@dataclass(frozen=True, kw_only=True)
class HogelNumbers:
    """The numbers of one hogel's `Figures`, without its images, as they are written."""

    shown: int
    by: str
    wrong: int
    fraction: float
    surface: SurfaceFigures | None
    invalid: int
    displacement_px: Spread | None
    displacement_by: MeasuredBy
    radiance: ColorFigures | None
    causes: dict[str, int] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """How one image differs from what a question asks for.

    Attributes
    ----------
    shown
        Judged pixels where image or answer shows a surface.
    by
        What `wrong` counts: triangle, object, color, outlines, or coverage.
    wrong
        Of these, the ones that differ.
    surface
        Of these, the ones with the wrong surface; None where the image does not say.
    claimed, invalid
        Pixels where the image shows something, and of these the ones that name a triangle or an object which
        the scene does not have.
    displacement_px
        Of what the image shows; None where it cannot be known.
    measured_by
        What the displacement was measured by.
    radiance
        Pixels with the right surface in another color; None where the image does not say both, or colors are
        not compared.
    causes
        Why pixels are wrong; None where that was not asked.
    answer
        What should be shown.
    image
        The image as the question turns it.
    error
        (H, W) pixels that are wrong: of the surface, or whatever can be told.
    """

    shown: int
    by: str
    wrong: int
    surface: int | None
    claimed: int
    invalid: int
    displacement_px: Spread | None
    measured_by: MeasuredBy
    radiance: int | None
    causes: dict[str, int] | None
    answer: HogelImage
    image: HogelImage
    error: Mask

    @property
    def fraction(self) -> float:
        """Share of wrong pixels."""
        return self.wrong / self.shown if self.shown else 0.0

    @property
    def limited(self) -> int:
        """The count that a limit on wrong pixels is compared with: surfaces, where the image tells them."""
        return self.wrong if self.surface is None else self.surface

    @property
    def limited_words(self) -> str:
        """What that counts, in words."""
        return WRONG_WORDS[self.by] if self.surface is None else SURFACES

    @property
    def judged_fraction(self) -> float:
        """The same as a share."""
        return self.limited / self.shown if self.shown else 0.0

    @property
    def mostly_invalid(self) -> bool:
        """Whether most of what the image shows does not exist."""
        return 2 * self.invalid > self.claimed

    @property
    def numbers(self) -> HogelNumbers:
        """The numbers alone, without the images."""
        surface = None
        if self.surface is not None:
            surface = SurfaceFigures(wrong=self.surface, fraction=self.judged_fraction)
        return HogelNumbers(
            shown=self.shown,
            by=self.by,
            wrong=self.wrong,
            fraction=self.fraction,
            surface=surface,
            invalid=self.invalid,
            displacement_px=self.displacement_px,
            displacement_by=self.measured_by,
            radiance=None if self.radiance is None else ColorFigures(wrong=self.radiance),
            causes=self.causes,
        )


def judge(
    reference: Reference,
    question: DrawnModel,
    image: HogelImage,
    points: Floats,
    judging: Judging | None = None,
    *,
    explained: bool = False,
) -> Figures:
    """Compare an image with what a question asks for.

    Parameters
    ----------
    reference
        Of the scene.
    question
        How the renderer is supposed to draw: `DrawnModel()` is the true crossed frustum.
    image, points
        As found, and the (H, W, 3) surface points that it shows, as found (`shown_points`). Its camera is
        that of the aperture that its file is named after.
    judging
        What is compared, and how exactly.
    explained
        Whether to find causes, by triangles.
    """
    judging = judging or Judging()
    seen = _compared(reference, question, image, points, judging)
    answer, upright, by, shown = seen.answer, seen.upright, seen.by, seen.shown
    invalid = invalid_claims(reference, question, image) & shown
    surface = None
    if by not in PLAIN:
        surface = (wrong_surfaces(reference, question, answer, upright) & shown) | invalid
    radiance = None
    if surface is not None and image.color is not None and judging.compared is Compared.COLOR:
        radiance = _wrong_colors(reference, question, answer, upright, judging) & shown & ~surface
    spread, measured_by = _displacement(reference, question, answer, upright, by)
    masks = seen.causes(reference, question) if explained else None
    return Figures(
        shown=int(shown.sum()),
        by=by,
        wrong=int(seen.differs.sum()),
        surface=None if surface is None else int(surface.sum()),
        claimed=int((seen.covered & shown).sum()),
        invalid=int(invalid.sum()),
        displacement_px=spread,
        measured_by=measured_by,
        radiance=None if radiance is None else int(radiance.sum()),
        causes=None if masks is None else {name: int(mask.sum()) for name, mask in masks.items()},
        answer=answer,
        image=upright,
        error=(seen.differs if surface is None else surface) | (False if radiance is None else radiance),
    )


def wrong_pixels(
    reference: Reference,
    question: DrawnModel,
    image: HogelImage,
    judging: Judging | None = None,
    *,
    explained: bool = False,
) -> Mask:
    """Return the pixels (H, W), upright, that `judge` counts as wrong, and nothing else that it finds out.

    Parameters
    ----------
    reference, question, image, judging
        As for `judge`.
    explained
        Whether to leave out pixels whose cause is rounding.
    """
    # Which surface a pixel shows is asked, not how far its point has moved.
    nowhere = np.full((*image.triangle.shape, 3), np.nan)
    seen = _compared(reference, question, image, nowhere, judging or Judging())
    masks = seen.causes(reference, question) if explained else None
    return seen.differs if masks is None else masks["unexplained"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Compared:
    """An image, upright, beside what a question asks for, and where (H, W) the two differ."""

    answer: HogelImage
    upright: HogelImage
    by: str
    covered: Mask
    shown: Mask
    differs: Mask

    def causes(self, reference: Reference, question: DrawnModel) -> dict[str, Mask] | None:
        """Return which of the wrong pixels have which cause; None where images name no triangles."""
        if self.by != "triangle":
            return None
        return cause_masks(reference.scene, question, self.answer, self.upright, self.differs)


def _compared(
    reference: Reference, question: DrawnModel, image: HogelImage, points: Floats, judging: Judging
) -> _Compared:
    aperture = question.answers(reference.scene, image.camera.aperture)
    answer = trace_drawn(reference, question, aperture)
    upright = turned(reference, question, image, aperture, points)
    by = _named_by(image, judging.compared)
    if by in PLAIN:
        answer = reference_colors(reference, question, answer)
    covered: Mask = shows_something(upright) if by in PLAIN else covered_by(upright)
    shown = judged_pixels(answer) & (answer.covered | covered)
    differs = _differing(answer, upright, covered, by, judging.color_tolerance) & shown
    return _Compared(answer=answer, upright=upright, by=by, covered=covered, shown=shown, differs=differs)


def _wrong_colors(
    reference: Reference, question: DrawnModel, answer: HogelImage, image: HogelImage, judging: Judging
) -> Mask:
    """Return the pixels (H, W) of the right triangle in another color."""
    differ = colors_differ(reference_colors(reference, question, answer), image, judging.color_tolerance)
    return np.asarray(differ & (answer.triangle == image.triangle))


def _differing(answer: HogelImage, image: HogelImage, covered: Mask, by: str, tolerance: float) -> Mask:
    """Return the pixels (H, W) that differ from the answer in what an image is named by."""
    if by == "color":
        return colors_differ(answer, image, tolerance)
    if by == "coverage":
        return np.not_equal(answer.covered, covered)
    if by == "outlines":
        lost = missing_outlines(true_outlines(answer), contrast(image))
        return np.not_equal(answer.covered, covered) | lost
    return np.asarray(getattr(answer, by) != getattr(image, by))


def _displacement(
    reference: Reference, question: DrawnModel, answer: HogelImage, image: HogelImage, by: str
) -> tuple[Spread | None, MeasuredBy]:
    """Return how far what an image shows has moved, and what that was measured by."""
    if by == "triangle" or np.isfinite(image.position[..., :2]).any():
        moved = question.project(reference.scene, answer.camera.aperture, image.position.astype(np.float64))
        height, width = image.triangle.shape
        moved -= np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        length = lengths(moved)
        known = np.isfinite(length)
        # What most pixels do not say, the others do not say for them.
        if 2 * known.sum() < covered_by(image).sum():
            return None, MeasuredBy.NOTHING
        spread = Spread.of(length[known])
        return spread, MeasuredBy.NOTHING if spread is None else MeasuredBy.POINTS
    expected, shown = _outlines(answer, image, by)
    spread = outline_displacement(expected, shown)
    return spread, MeasuredBy.NOTHING if spread is None else MeasuredBy.OUTLINES


SEEN_CONTRAST = 0.1
"""Contrast beyond which one edge counts no more than another, of the square root of the radiance."""


def _outlines(answer: HogelImage, image: HogelImage, by: str) -> tuple[Steps, Steps]:
    """Return where an answer has outlines, and where an image has."""
    if by in PLAIN:
        seen = contrast(image)
        capped = Steps(
            across=np.minimum(seen.across, SEEN_CONTRAST), down=np.minimum(seen.down, SEEN_CONTRAST)
        )
        if by == "outlines":
            return true_outlines(answer), capped
        expected = contrast(answer)
        return Steps(
            across=np.minimum(expected.across, SEEN_CONTRAST), down=np.minimum(expected.down, SEEN_CONTRAST)
        ), capped
    if by == "object":
        return steps_of(answer.object), steps_of(image.object)
    return steps_of(answer.covered.astype(np.int8)), steps_of(covered_by(image).astype(np.int8))


def invalid_claims(reference: Reference, question: DrawnModel, image: HogelImage) -> Mask:
    """Return the pixels (H, W), upright, that name a triangle or an object which the scene does not have."""
    scene = reference.scene
    strange: Mask = (image.triangle < NOTHING) | (image.triangle >= len(scene.faces))
    strange |= (image.object < NOTHING) | (image.object >= len(scene.objects))
    return np.asarray(question.orientation.upright(strange))


def turned(
    reference: Reference, question: DrawnModel, image: HogelImage, aperture: Aperture, points: Floats
) -> HogelImage:
    """Return an image as a question turns it, as that of the aperture which it then answers for."""
    scene, upright = reference.scene, question.orientation.upright
    # A number below every number is as strange as one above them, and safer to look up.
    named = np.where(image.triangle < NOTHING, len(scene.faces), image.triangle).astype(np.int32)
    triangle = upright(named)
    known = np.where((triangle >= 0) & (triangle < len(scene.faces)), triangle, NOTHING)
    by_triangle = np.append(scene.object_of_triangle, np.int32(NOTHING))[known]
    objects = upright(image.object)
    return HogelImage(
        camera=reference.camera(aperture),
        triangle=triangle,
        object=np.where(objects != NOTHING, objects, by_triangle),
        position=upright(points),
        color=None if image.color is None else upright(image.color),
    )


def _named_by(image: HogelImage, compared: Compared) -> str:
    """Return what an image is judged by; one that shows no surface at all, by what it could have."""
    if (image.triangle != NOTHING).any():
        return "triangle"
    if (image.object != NOTHING).any():
        return "object"
    if np.isfinite(image.height).any():
        return "coverage"
    if image.color is None:
        return "triangle"
    return "color" if compared is Compared.COLOR else "outlines"


def covered_by(image: HogelImage) -> Mask:
    """Return the pixels that show a surface, by whichever number or position an image has."""
    return np.asarray(image.covered | (image.object != NOTHING))


def wrong_surfaces(reference: Reference, question: DrawnModel, answer: HogelImage, image: HogelImage) -> Mask:
    """Return the pixels that show the wrong surface, (H, W): see `xfrustum.compare.metrics.surface`.

    A point is hidden when its own camera's line meets something else first, or when it lies behind
    the plate and the answer has the viewer's half where the point is drawn. A triangle that neither
    camera draws anywhere shows no point, and is wrong.
    """
    covered = covered_by(image)
    # What an image does not say of its objects is taken from the answer.
    objects = np.where(covered & (image.object == NOTHING), answer.object, image.object)
    wrong: Mask = np.asarray((answer.covered != covered) | (answer.object != objects))
    known = np.isfinite(image.position).all(axis=-1) & ~wrong & covered
    named_only = (image.triangle != NOTHING) & ~np.isfinite(image.position).all(axis=-1)
    wrong |= named_only & (image.triangle != answer.triangle)
    if not question.plain:
        return wrong
    scene, aperture = reference.scene, answer.camera.aperture
    plate = question.plate_height
    sides = [(0, known & (image.height != plate))]
    if question.near:
        sides = [(1, known & (image.height < plate)), (-1, known & (image.height > plate))]
    for side, asked in sides:
        position, number = image.position[asked].astype(np.float64), image.triangle[asked]
        known_number = (number >= 0) & (number < len(scene.faces))
        number = np.where(known_number, number, NOTHING).astype(np.int32)
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
