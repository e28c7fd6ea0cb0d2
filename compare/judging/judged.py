"""One hogel of a foreign renderer, judged by a question: the truth, or what its author declares.

The arithmetic is that of `xfrustum.compare.metrics`: which pixels are judged, which show another surface or a
hidden point or one from outside the film, where the film shows a point and how far that is from the pixel's
center. The two judges are not one function, because they are asked different things. `compare_images` has a
truth and an image that answer the same question, name surfaces and say where these lie; it also knows that
the true frustum sees the plate through the aperture only. A foreign image may be turned, may name triangles
that do not exist, or show colors alone, and its question may be two offset cameras, which do see the plate,
and of which the front one covers the other. Here colors are right or wrong within a tolerance; there their
error is measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import numpy as np

from xfrustum.compare.judging.image_displacement import (
    COLOR_ONLY,
    MeasuredBy,
    contrast,
    missing_outlines,
    picture_displacement,
    point_displacement,
    true_outlines,
)
from xfrustum.compare.metrics.error_maps import (
    Spread,
    SurfaceErrors,
    covered_by,
    existing_triangles,
    hidden_pixels,
    judged_pixels,
    other_surfaces,
    outside_film,
)
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, unflipped
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    colors_differ,
    reference_colors,
    shows_something,
    trace_drawn,
)
from xfrustum.compare.rounding.cameras import Precision, RoundingCamera
from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.scenes.plate.plate import Aperture

SUBPIXEL_BITS = 4
"""Fewest subpixel bits that OpenGL allows (GL_SUBPIXEL_BITS): every rasterizer has at least so many."""

OFFSET_PRECISION = Precision(
    subpixel_bits=SUBPIXEL_BITS, depth=DepthFormat.D24, mapping=DepthMapping.STANDARD
)
"""Precision of a renderer with a near offset: the usual depth buffer."""

CENTERED_PRECISION = Precision(
    subpixel_bits=SUBPIXEL_BITS, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED
)
"""Precision of a renderer whose cameras stand in the aperture itself: its depth must hold any ratio of near
to far, which no buffer of fixed point does."""

NEAR_PLANE_PER_REACH = 1e-6
"""Near plane of a camera that stands in the aperture, as a part of the reach: such a camera has none, but
depths are stored relative to one."""


def foreign_cameras(scene: Scene, model: DrawnModel, aperture: Aperture) -> tuple[RoundingCamera, ...]:
    """Return C and C* of a renderer, which may have drawn any surface, and may clip at their films' borders.

    Parameters
    ----------
    scene
        Scene that the renderer draws.
    model
        How the renderer draws, as found.
    aperture
        Aperture of the scene that is drawn.
    """
    # One depth buffer serves both cameras: where one of them stands in the aperture, it holds any ratio.
    offset = all(model.camera(side).near for side in (1, -1))
    return tuple(
        RoundingCamera(
            pencil=_with_near_plane(scene, model, aperture, side),
            precision=OFFSET_PRECISION if offset else CENTERED_PRECISION,
            film_shift=model.camera(side).shift,
        )
        for side in (1, -1)
    )


def _with_near_plane(scene: Scene, model: DrawnModel, aperture: Aperture, side: int) -> Pencil:
    """Return the lines of C (side 1) or C* (side -1), which have a near plane even where near is 0."""
    pencil = model.pencil(scene, aperture, side)
    if model.camera(side).near:
        return pencil
    end = max(abs(s) for s in pencil.s_range)
    begin = NEAR_PLANE_PER_REACH * scene.frustum.longest_reach / model.scene_scale
    return replace(pencil, s_range=(begin, end) if side > 0 else (-end, -begin))


class Compared(StrEnum):
    """Property by which pictures without numbers are compared."""

    COLOR = "color"
    GEOMETRY = "geometry"
    """Places where pictures show something, and where outlines run; their shading may be any."""


@dataclass(frozen=True, kw_only=True)
class Judging:
    """How images are judged.

    Attributes
    ----------
    compared
        Property by which pictures without numbers are compared.
    color_tolerance
        Largest difference of linear radiance that is no error.
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
"""Words for what `Figures.wrong` counts, by `Figures.by`."""

SURFACES = "wrong surfaces"


@dataclass(frozen=True, kw_only=True)
class SurfaceFigures:
    """Pixels that show the wrong surface, their share, and those of them that show what belongs outside."""

    wrong: int
    fraction: float
    outside: int


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
        Number of judged pixels where image or answer shows a surface.
    by
        Property that `wrong` counts: triangle, object, color, outlines, or coverage.
    wrong
        Number of shown pixels that differ in it.
    surface
        Number of shown pixels with the wrong surface; None where the image does not say.
    outside
        Number of these whose point belongs outside the film.
    claimed, invalid
        Number of shown pixels where the image shows something, and of those that name a triangle or an object
        which the scene does not have.
    displacement_px
        Spread of the displacement of what the image shows; None where it cannot be known.
    measured_by
        Means by which the displacement was measured.
    radiance
        Number of pixels with the right surface in another color; None where the image does not say both, or
        colors are not compared.
    causes
        Number of wrong pixels by cause; None where that was not asked.
    cause_masks
        These pixels; None likewise.
    answer
        Image that should be shown.
    image
        The image as the question turns it.
    error
        (H, W) pixels with a wrong surface or color, or that differ in `by` where the image says no surfaces.
    """

    shown: int
    by: str
    wrong: int
    surface: int | None
    outside: int
    claimed: int
    invalid: int
    displacement_px: Spread | None
    measured_by: MeasuredBy
    radiance: int | None
    causes: dict[str, int] | None
    cause_masks: Causes | None
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
        """Words for what `limited` counts."""
        return WRONG_WORDS[self.by] if self.surface is None else SURFACES

    @property
    def judged_fraction(self) -> float:
        """Share of shown pixels that `limited` counts."""
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
            surface = SurfaceFigures(wrong=self.surface, fraction=self.judged_fraction, outside=self.outside)
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
        Reference of the scene.
    question
        How the renderer is supposed to draw: `DrawnModel()` is the true crossed frustum.
    image, points
        As found, and the (H, W, 3) surface points that it shows, as found (`shown_points`). Its camera is
        that of the aperture that its file is named after.
    judging
        Property that is compared, and how exactly.
    explained
        Whether to find causes, which needs triangle numbers.
    """
    judging = judging or Judging()
    seen = _compared(reference, question, image, points, judging)
    answer, upright, by, shown = seen.answer, seen.upright, seen.by, seen.shown
    invalid = invalid_claims(reference, question, image) & shown
    surface, outside = None, 0
    if by not in COLOR_ONLY:
        errors = wrong_surfaces(reference, question, answer, upright)
        surface, outside = (errors.wrong & shown) | invalid, int((errors.outside & shown).sum())
    radiance = None
    if surface is not None and image.color is not None and judging.compared is Compared.COLOR:
        radiance = _wrong_colors(reference, question, answer, upright, judging) & shown & ~surface
    spread, measured_by = seen.displacement(reference.scene, question)
    causes = seen.causes(reference.scene, question) if explained else None
    return Figures(
        shown=int(shown.sum()),
        by=by,
        wrong=int(seen.differs.sum()),
        surface=None if surface is None else int(surface.sum()),
        outside=outside,
        claimed=int((seen.covered & shown).sum()),
        invalid=int(invalid.sum()),
        displacement_px=spread,
        measured_by=measured_by,
        radiance=None if radiance is None else int(radiance.sum()),
        causes=None if causes is None else causes.counts(),
        cause_masks=causes,
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
    causes = seen.causes(reference.scene, question) if explained else None
    return seen.differs if causes is None else causes.unexplained


@dataclass(frozen=True, kw_only=True, eq=False)
class _Compared:
    """An image, upright, beside what a question asks for, and where (H, W) the two differ."""

    answer: HogelImage
    upright: HogelImage
    by: str
    covered: Mask
    shown: Mask
    differs: Mask

    def causes(self, scene: Scene, question: DrawnModel) -> Causes | None:
        """Return the causes of the wrong pixels; None where images name no triangles."""
        if self.by != "triangle":
            return None
        cameras = foreign_cameras(scene, question, self.answer.camera.aperture)
        pixels = np.flatnonzero(self.differs)
        return find_causes(scene.triangles, cameras, self.answer, self.upright, pixels)

    def displacement(self, scene: Scene, question: DrawnModel) -> tuple[Spread | None, MeasuredBy]:
        """Return how far what the image shows has moved, and what that was measured by."""
        if self.by == "triangle" or np.isfinite(self.upright.position[..., :2]).any():
            return point_displacement(scene, question, self.answer, self.upright)
        return picture_displacement(self.answer, self.upright, self.by, self.differs)


def _compared(
    reference: Reference, question: DrawnModel, image: HogelImage, points: Floats, judging: Judging
) -> _Compared:
    aperture = question.answers(reference.scene, image.camera.aperture)
    answer = trace_drawn(reference, question, aperture)
    upright = turned(reference, question, image, aperture, points)
    by = _named_by(image, judging.compared)
    if by in COLOR_ONLY:
        answer = reference_colors(reference, question, answer)
    covered: Mask = shows_something(upright) if by in COLOR_ONLY else covered_by(upright)
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
    by_triangle = np.append(scene.object_of_triangle, np.int32(NOTHING))[existing_triangles(triangle, scene)]
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


def wrong_surfaces(
    reference: Reference, question: DrawnModel, answer: HogelImage, image: HogelImage
) -> SurfaceErrors:
    """Return the pixels that show the wrong surface: see `xfrustum.compare.metrics.error_maps`.

    A point belongs outside the film when its own camera draws it beyond the border. It is hidden when its own
    camera's line meets something else first, or when it lies behind the plate and the answer has the viewer's
    half where the point is drawn. A triangle that neither camera draws anywhere shows no point, and is wrong.
    """
    scene, plate = reference.scene, question.plate_height
    wrong = other_surfaces(answer, image, scene)
    pointed = np.isfinite(image.position).all(axis=-1)
    known = pointed & covered_by(image)
    wrong |= (image.triangle != NOTHING) & ~pointed & (image.triangle != answer.triangle)
    sides = [(0, known & (image.height != plate))]
    if not question.one_pencil:
        sides = [(1, known & (image.height < plate)), (-1, known & (image.height > plate))]
    outside = np.zeros_like(wrong)
    for side, asked in sides:
        pencil = unflipped(question.pencil(scene, answer.camera.aperture, side))
        outside |= outside_film(asked, image, scene, pencil)
    wrong |= outside
    for side, asked in sides if question.plain else ():
        hides = partial(_hides, reference, question, answer, side)
        wrong |= hidden_pixels(asked & ~wrong, image, scene, hides)
    return SurfaceErrors(wrong=wrong, outside=outside)


def _hides(
    reference: Reference, question: DrawnModel, answer: HogelImage, side: int, points: SurfacePoints
) -> Mask:
    """Return which surface points a camera, or for C the viewer's half in front of it, does not show."""
    pencil = unflipped(question.pencil(reference.scene, answer.camera.aperture, side))
    behind = reference.hidden_from(pencil, points)
    if side == 1:
        behind |= _covered_by_front(question, reference, answer, points.position)
    return behind


def _covered_by_front(question: DrawnModel, reference: Reference, answer: HogelImage, points: Floats) -> Mask:
    """Return which points behind the plate are drawn where the answer shows the viewer's half."""
    place = question.project(reference.scene, answer.camera.aperture, points)
    width, height = answer.camera.resolution
    on_film: Mask = np.all((place > -0.5) & (place < (width - 0.5, height - 0.5)), axis=1)
    column, row = np.rint(np.where(on_film[:, None], place, 0.0)).astype(np.int64).T
    with np.errstate(invalid="ignore"):
        return np.asarray(on_film & (answer.height[row, column] > question.plate_height))
