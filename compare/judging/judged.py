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
from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.compare.rounding.triangles import Precision, RoundingCamera
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.scenes.plate.plate import Aperture

SUBPIXEL_BITS = 4
"""Fewest subpixel bits that OpenGL allows (GL_SUBPIXEL_BITS): every rasterizer has at least so many."""

# A renderer with a near offset has the usual depth buffer. Where cameras stand in the aperture itself, depth
# must hold any ratio of near to far, which no buffer of fixed point does.
OFFSET_PRECISION = Precision(
    subpixel_bits=SUBPIXEL_BITS, depth=DepthFormat.D24, mapping=DepthMapping.STANDARD
)
CENTERED_PRECISION = Precision(
    subpixel_bits=SUBPIXEL_BITS, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED
)

NEAR_PLANE_PER_REACH = 1e-6
"""Near plane of a camera that stands in the aperture, as a part of the reach: such a camera has none, but
depths are stored relative to one."""


def foreign_cameras(scene: Scene, model: DrawnModel, aperture: Aperture) -> tuple[RoundingCamera, ...]:
    """Return C and C* of a renderer, which may have drawn anything, and may clip at their films' borders."""
    # One depth buffer serves both cameras: where one of them stands in the aperture, it holds any ratio.
    offset, cameras = all(model.camera(side).near for side in (1, -1)), []
    for side in (1, -1):
        pencil = model.pencil(scene, aperture, side)
        if not model.camera(side).near:
            end = max(abs(s) for s in pencil.s_range)
            begin = NEAR_PLANE_PER_REACH * scene.frustum.longest_reach / model.scene_scale
            pencil = replace(pencil, s_range=(begin, end) if side > 0 else (-end, -begin))
        precision, shift = OFFSET_PRECISION if offset else CENTERED_PRECISION, model.camera(side).shift
        cameras.append(RoundingCamera(pencil=pencil, precision=precision, film_shift=shift))
    return tuple(cameras)


class Compared(StrEnum):
    """What pictures that name no surfaces are judged by."""

    COLOR = "color"
    """Colors, within a tolerance."""
    GEOMETRY = "geometry"
    """Where they show something, and whether outlines have an edge: shading is the renderer's own."""


@dataclass(frozen=True, kw_only=True)
class Judging:
    """Property that images are compared by, and the difference of colors beyond which they are wrong."""

    compared: Compared = Compared.COLOR
    color_tolerance: float = COLOR_TOLERANCE


WRONG_WORDS = {
    "triangle": "wrong triangles",
    "object": "wrong objects",
    "coverage": "wrong coverage",
    "color": "wrong colors",
    "outlines": "wrong outlines",
}
"""Words for what `HogelNumbers.wrong` counts, by `HogelNumbers.by`."""

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
    """How one image differs from what a question asks for, as it is written."""

    shown: int  # judged pixels where image or answer shows a surface
    by: str  # what `wrong` counts: triangle, object, color, outlines, or coverage
    wrong: int  # shown pixels that differ in it
    fraction: float
    surface: SurfaceFigures | None  # None where the image does not say surfaces
    invalid: int  # shown pixels that name a triangle or an object which the scene does not have
    displacement_px: Spread | None  # None where it cannot be known
    displacement_by: MeasuredBy
    radiance: ColorFigures | None  # None where the image lacks surfaces or colors, or these are not compared
    causes: dict[str, int] | None  # wrong pixels by cause; None where that was not asked

    @property
    def limited(self) -> int:
        """The count that a limit on wrong pixels is compared with: surfaces, where the image tells them."""
        return self.wrong if self.surface is None else self.surface.wrong

    @property
    def limited_words(self) -> str:
        """Words for what `limited` counts."""
        return WRONG_WORDS[self.by] if self.surface is None else SURFACES

    @property
    def judged_fraction(self) -> float:
        """Share of shown pixels that `limited` counts."""
        return self.limited / self.shown if self.shown else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """The numbers of an image beside the images they were counted in.

    `answer` is what should be shown and `image` what is, as the question turns it; `error` (H, W) are the
    pixels with a wrong surface or color, or that differ in `by` where the image says no surfaces; `claimed`
    counts shown pixels where the image shows something.
    """

    numbers: HogelNumbers
    claimed: int
    cause_masks: Causes | None
    answer: HogelImage
    image: HogelImage
    error: Mask


def judge(
    reference: Reference,
    question: DrawnModel,
    image: HogelImage,
    points: Floats,
    judging: Judging | None = None,
    *,
    explained: bool = False,
) -> Figures:
    """Compare an image with what a question asks for; `DrawnModel()` asks for the true crossed frustum.

    Parameters
    ----------
    image, points
        As found, and the (H, W, 3) surface points that it shows, as found (`shown_points`). Its camera is
        that of the aperture that its file is named after.
    explained
        Whether to find causes, which needs triangle numbers.
    """
    judging, scene = judging or Judging(), reference.scene
    seen = _Compared.of(reference, question, image, points, judging)
    answer, upright, by, shown = seen.answer, seen.upright, seen.by, seen.shown
    strange: Mask = (image.triangle < NOTHING) | (image.triangle >= len(scene.faces))
    strange |= (image.object < NOTHING) | (image.object >= len(scene.objects))
    invalid = question.orientation.upright(strange) & shown
    count, error, surface, radiance = int(shown.sum()), seen.differs, None, None
    if by not in COLOR_ONLY:
        errors = wrong_surfaces(reference, question, answer, upright)
        error = (errors.wrong & shown) | invalid
        wrong, outside = int(error.sum()), int((errors.outside & shown).sum())
        surface = SurfaceFigures(wrong=wrong, fraction=wrong / count if count else 0.0, outside=outside)
        if image.color is not None and judging.compared is Compared.COLOR:
            right = reference_colors(reference, question, answer)
            differ = colors_differ(right, upright, judging.color_tolerance) & shown & ~error
            differ &= answer.triangle == upright.triangle
            radiance, error = ColorFigures(wrong=int(differ.sum())), error | differ
    if by == "triangle" or np.isfinite(upright.position[..., :2]).any():
        spread, measured_by = point_displacement(scene, question, answer, upright)
    else:
        spread, measured_by = picture_displacement(answer, upright, by, seen.differs)
    causes = seen.causes(scene, question) if explained else None
    differing = int(seen.differs.sum())
    numbers = HogelNumbers(
        shown=count,
        by=by,
        wrong=differing,
        fraction=differing / count if count else 0.0,
        surface=surface,
        invalid=int(invalid.sum()),
        displacement_px=spread,
        displacement_by=measured_by,
        radiance=radiance,
        causes=None if causes is None else causes.counts(),
    )
    claimed = int((seen.covered & shown).sum())
    return Figures(
        numbers=numbers, claimed=claimed, cause_masks=causes, answer=answer, image=upright, error=error
    )


def wrong_pixels(
    reference: Reference,
    question: DrawnModel,
    image: HogelImage,
    judging: Judging | None = None,
    *,
    explained: bool = False,
) -> Mask:
    """Return the pixels (H, W), upright, that `judge` counts as wrong; if `explained`, not by rounding."""
    # Which surface a pixel shows is asked, not how far its point has moved.
    nowhere = np.full((*image.triangle.shape, 3), np.nan)
    seen = _Compared.of(reference, question, image, nowhere, judging or Judging())
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

    @classmethod
    def of(
        cls, reference: Reference, question: DrawnModel, image: HogelImage, points: Floats, judging: Judging
    ) -> _Compared:
        """Turn an image as a question does, and compare it as that of the aperture which it answers for."""
        scene, upright = reference.scene, question.orientation.upright
        aperture = question.answers(scene, image.camera.aperture)
        answer = trace_drawn(reference, question, aperture)
        # A number below every number is as strange as one above them, and safer to look up.
        triangle = upright(np.where(image.triangle < NOTHING, len(scene.faces), image.triangle))
        objects = np.append(scene.object_of_triangle, np.int32(NOTHING))[existing_triangles(triangle, scene)]
        turned = HogelImage(
            camera=reference.camera(aperture),
            triangle=triangle.astype(np.int32),
            object=np.where(upright(image.object) != NOTHING, upright(image.object), objects),
            position=upright(points),
            color=None if image.color is None else upright(image.color),
        )
        # One that shows no surface at all is judged by what it could have.
        by = "triangle"
        if not (image.triangle != NOTHING).any():
            if (image.object != NOTHING).any():
                by = "object"
            elif np.isfinite(image.height).any():
                by = "coverage"
            elif image.color is not None:
                by = "color" if judging.compared is Compared.COLOR else "outlines"
        if by in COLOR_ONLY:
            answer = reference_colors(reference, question, answer)
        covered: Mask = shows_something(turned) if by in COLOR_ONLY else covered_by(turned)
        shown = judged_pixels(answer) & (answer.covered | covered)
        if by == "color":
            differs = colors_differ(answer, turned, judging.color_tolerance)
        elif by in ("coverage", "outlines"):
            differs = np.not_equal(answer.covered, covered)
            if by == "outlines":
                differs |= missing_outlines(true_outlines(answer), contrast(turned))
        else:
            differs = np.not_equal(getattr(answer, by), getattr(turned, by))
        return cls(
            answer=answer, upright=turned, by=by, covered=covered, shown=shown, differs=differs & shown
        )

    def causes(self, scene: Scene, question: DrawnModel) -> Causes | None:
        """Return the causes of the wrong pixels; None where images name no triangles."""
        if self.by != "triangle":
            return None
        cameras = foreign_cameras(scene, question, self.answer.camera.aperture)
        return find_causes(scene.triangles, cameras, self.answer, self.upright, np.flatnonzero(self.differs))


def wrong_surfaces(
    reference: Reference, question: DrawnModel, answer: HogelImage, image: HogelImage
) -> SurfaceErrors:
    """Return the pixels that show the wrong surface: see `xfrustum.compare.metrics.error_maps`.

    A point belongs outside the film when its own camera draws it beyond the border. It is hidden when its own
    camera's line meets something else first, or when it lies behind the plate and the answer has the viewer's
    half where the point is drawn. A triangle that neither camera draws anywhere shows no point, and is wrong.
    """
    scene, plate, aperture = reference.scene, question.plate_height, answer.camera.aperture
    wrong = other_surfaces(answer, image, scene)
    pointed = np.isfinite(image.position).all(axis=-1)
    known = pointed & covered_by(image)
    wrong |= (image.triangle != NOTHING) & ~pointed & (image.triangle != answer.triangle)
    sides = [(0, known & (image.height != plate))]
    if not question.one_pencil:
        sides = [(1, known & (image.height < plate)), (-1, known & (image.height > plate))]
    outside = np.zeros_like(wrong)
    for side, asked in sides:
        outside |= outside_film(asked, image, scene, unflipped(question.pencil(scene, aperture, side)))
    wrong |= outside
    for side, asked in sides if question.plain else ():

        def hides(points: SurfacePoints, side: int = side) -> Mask:
            pencil = unflipped(question.pencil(scene, aperture, side))
            behind = reference.hidden_from(pencil, points)
            if side != 1:
                return behind
            # The viewer's half, where the answer shows it, covers what C draws there.
            place = question.project(scene, aperture, points.position)
            width, height = answer.camera.resolution
            on_film: Mask = np.all((place > -0.5) & (place < (width - 0.5, height - 0.5)), axis=1)
            column, row = np.rint(np.where(on_film[:, None], place, 0.0)).astype(np.int64).T
            with np.errstate(invalid="ignore"):
                return np.asarray(behind | (on_film & (answer.height[row, column] > plate)))

        wrong |= hidden_pixels(asked & ~wrong, image, scene, hides)
    return SurfaceErrors(wrong=wrong, outside=outside)
