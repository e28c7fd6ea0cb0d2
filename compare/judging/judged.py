"""One hogel of a foreign renderer, compared with a model: the truth, or the author's statements.

In `xfrustum.compare.comparison`, `compare_images` compares a truth with a drawn image that has
surfaces and their points; the arithmetic is the same here. A foreign image may be turned, may
contain triangle numbers that do not exist, or may have only colors. Its model may have two offset
cameras with near planes at the plate; the front camera's image then covers the other image. In this
module colors are right or wrong within a tolerance; in `comparison` their error is measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

from xfrustum.compare.error_maps import (
    Spread,
    SurfaceErrors,
    beyond_storage,
    covered_by,
    existing_triangles,
    floating_pixels,
    hidden_pixels,
    judged_pixels,
    lengths,
    other_surfaces,
    outside_film,
    pixel_centers,
)
from xfrustum.compare.judging.outlines import (
    MAX_EDGE_CONTRAST,
    MIN_EDGE_CONTRAST,
    MIN_STEPS,
    OUTLINE_TOLERANCE_PX,
    contrast,
    missing_outlines,
    outline_displacement,
    seen_outlines,
    steps_of,
    strongest_steps,
    true_outlines,
    unlike_shading,
)
from xfrustum.compare.renderer_model import pictures
from xfrustum.compare.renderer_model.drawn_model import EVEN, Back, Front, RendererModel, unflipped
from xfrustum.compare.rounding.causes import HEADINGS, Causes, DirectionPlate, find_causes
from xfrustum.compare.rounding.triangles import Precision, RoundingCamera
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.files.pictures import Transfer, stored_rgb
from xfrustum.scenes.model.device_model import DeviceModel, safe_model
from xfrustum.scenes.model.images import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DepthFormat, DepthMapping
from xfrustum.tolerances import TOLERANCE_PX

# A foreign device is unknown unless its owner has measured it. A renderer with a near offset is
# assumed to have a usual depth buffer. With cameras in the aperture itself, the ratio of far to
# near is unbounded, so that a fixed-point buffer would be too coarse.
ANY_DEVICE = safe_model()
OFFSET_DEPTH = DepthFormat.D24, DepthMapping.STANDARD
CENTERED_DEPTH = DepthFormat.D32F, DepthMapping.REVERSED

NEAR_PLANE_PER_REACH = 1e-6
"""Distance of the assumed near plane of a camera in the aperture, as a part of the reach."""

MAX_MISSING_OUTLINES = 0.1
"""Largest share of the truth's outlines that may be missing in a right picture with other shading.

An outline is invisible by chance if its two sides have nearly equal grays: of pairs of random grays
in half of the range, 2 x 4/128, or 6 %, differ by less than `MIN_EDGE_CONTRAST`.
"""

MIN_SHADING_RATIO = 2.0
"""Smallest ratio of unexplained variations of brightness: wrong to right composition."""

COMPOSITIONS: tuple[dict[str, Any], ...] = (
    {"front": Front.MISSING},
    {"front": Front.NEAREST},
    {"back": Back.MISSING},
    {"back": Back.FARTHEST},
)
"""Wrong compositions, from which a right picture must differ."""

COLOR_ONLY = ("color", "outlines")  # Values of `HogelNumbers.by` for pictures without surfaces


class MeasuredBy(StrEnum):
    """Means by which a displacement was measured."""

    POINTS = "surface points"
    """Surface point of each pixel, else the point of its triangle that is drawn nearest to it."""
    OUTLINES = "registration of outlines"
    NO_OUTLINES = "no outlines"
    """Too few outlines to register: only colors are judged, by wrong pixels."""
    NOTHING = "nothing"  # The displacement cannot be measured


def _untold(reference: Reference, question: RendererModel, seen: _Compared) -> int:
    """Return the largest number of wrong pixels of a wrong composition that keeps the outlines."""
    scene, answer, worst = reference.scene, seen.answer, 0
    outlines = seen_outlines(scene, answer, true_outlines(scene, answer))
    aperture, known = answer.camera.aperture, pictures.Layers()
    edges = maximum_filter(
        strongest_steps(contrast(seen.upright)), size=2 * OUTLINE_TOLERANCE_PX + 1
    )
    # A missing outline is noticed only if no other edge is near. Other edges are as frequent at
    # missing outlines as anywhere else.
    alone = float((edges < MIN_EDGE_CONTRAST).mean())
    count = int((strongest_steps(outlines) > 0).sum())
    for fields in COMPOSITIONS if question.plain else ():
        model = replace(question, **fields)
        other = pictures.as_image(
            reference, aperture, pictures.drawn(reference, model, aperture, known)
        )
        wrong = seen.shown & wrong_surfaces(reference, question, answer, other, placed=True).wrong
        text = (other.covered != answer.covered).sum() > wrong.sum() / 2
        missing = int(missing_outlines(outlines, true_outlines(scene, other)).sum())
        text |= alone * missing > MAX_MISSING_OUTLINES * count
        left = [unlike_shading(scene, shown, seen.upright, wrong) for shown in (answer, other)]
        if not text and MIN_SHADING_RATIO * left[0] >= left[1]:
            worst = max(worst, int(wrong.sum()))
    return worst


def _moved_outlines(scene: Scene, seen: _Compared) -> tuple[Spread | None, MeasuredBy]:
    """Return the displacement of an image's outlines, and the means by which it was measured.

    If no judged pixel has another label, the outlines are as expected, and their displacement is 0.
    It is also 0 if colors have exactly the expected contrast. Registration would be less certain:
    few or straight outlines do not determine a fraction of a pixel. Colors that are equal only
    within a tolerance are registered, because a dim outline may have moved. If the expected image
    has no outlines, only soft shading, no displacement is visible; surfaces that move into the film
    from outside count as wrong pixels.
    """
    answer, image, by, differs = seen.answer, seen.upright, seen.by, seen.differs
    if by in COLOR_ONLY:
        colored = by == "color"
        # With other shading, creases beside an outline may have more contrast than the outline. The
        # low cap gives all edges equal weight.
        shown = contrast(image, MAX_EDGE_CONTRAST if colored else MIN_EDGE_CONTRAST)
        expected = contrast(answer, MAX_EDGE_CONTRAST)
        if not colored:
            expected = seen_outlines(scene, answer, true_outlines(scene, answer))
    elif by == "object":
        expected, shown = steps_of(answer.object), steps_of(image.object)
    else:
        expected, shown = steps_of(answer.covered), steps_of(covered_by(image))
    # Between colors, a step counts as an outline if its contrast is an edge; between labels, and in
    # true outlines, every step counts.
    edge = MIN_EDGE_CONTRAST if by == "color" else 0.0
    count = sum(int((some > edge).sum()) for some in expected)
    # An image that is judged by outlines may have another shading than the truth, and cannot be
    # judged without enough outlines.
    if count < (MIN_STEPS if by == "outlines" else 1):
        return None, MeasuredBy.NO_OUTLINES
    same = all(np.array_equal(entry, other) for entry, other in zip(expected, shown, strict=True))
    if not differs.any() and (same or by not in COLOR_ONLY):
        return Spread.from_values(np.zeros(1)), MeasuredBy.OUTLINES
    spread = outline_displacement(expected, shown)
    return spread, MeasuredBy.NOTHING if spread is None else MeasuredBy.OUTLINES


def foreign_cameras(
    scene: Scene, model: RendererModel, aperture: Aperture, device: DeviceModel = ANY_DEVICE
) -> tuple[RoundingCamera, ...]:
    """Return the cameras C and C* of a renderer; both may clip at the borders of their films."""
    # Both cameras have the same depth buffer. If one camera is in the aperture, the buffer must
    # suit any ratio of far to near.
    depth, mapping = (
        OFFSET_DEPTH if all(model.camera(side).near for side in (1, -1)) else CENTERED_DEPTH
    )
    precision, cameras = Precision(device=device, depth=depth, mapping=mapping), []
    for side in (1, -1):
        bundle = model.bundle(scene, aperture, side)
        if not model.camera(side).near:
            begin = NEAR_PLANE_PER_REACH * scene.frustum.longest_reach / model.scene_scale
            # A side with a reach of zero still needs a far plane beyond its near plane.
            end = max(2 * begin, *(abs(s) for s in bundle.s_range))
            bundle = replace(bundle, s_range=(begin, end) if side > 0 else (-end, -begin))
        shift = model.camera(side).shift
        cameras.append(RoundingCamera(bundle=bundle, precision=precision, film_shift=shift))
    return tuple(cameras)


class Compared(StrEnum):
    """Property by which pictures without surfaces are judged."""

    COLOR = "color"  # Colors, within a tolerance
    GEOMETRY = "geometry"
    """Covered pixels, and edges along outlines, because shading is left to the renderer."""


@dataclass(frozen=True, kw_only=True)
class Judging:
    """Property by which images are compared, and the tolerance of colors."""

    compared: Compared = Compared.COLOR
    color_tolerance: float = pictures.COLOR_TOLERANCE
    device: DeviceModel = ANY_DEVICE  #: device whose roundings explain wrong pixels
    #: the plate if it was drawn by directions: the cameras of directions then explain wrong pixels
    directions: DirectionPlate | None = None
    # Transfer curve by which pictures are decoded, if not the stated curve. Where the curve is
    # steep, one stored level exceeds the tolerance, and each rounding changes a color by up to half
    # a level.
    transfer: Transfer | None = None

    def tolerance(self, question: RendererModel, image: HogelImage) -> Singles | float:
        """Return the largest color difference due to rounding to levels, for upright pixels."""
        if self.transfer is None:
            return self.color_tolerance
        stored = question.upright(stored_rgb(image) / np.float32(255))
        return np.maximum(self.transfer.step(stored), self.color_tolerance)


WRONG_FIGURES = {
    "triangle": "wrong triangles",
    "object": "wrong objects",
    "coverage": "wrong coverage",
    "color": "wrong colors",
    "outlines": "wrong outlines",
}
"""Name of the figure that `HogelNumbers.wrong` counts, for each value of `HogelNumbers.by`."""

SURFACES = "wrong surfaces"


@dataclass(frozen=True, kw_only=True)
class SurfaceFigures:
    """Pixels that show the wrong surface, their share, and pixels with a point outside the film."""

    wrong: int
    fraction: float
    outside: int


@dataclass(frozen=True, kw_only=True)
class OutlineFigures:
    """Pixels at outlines of the truth, and the pixels among them without an edge in the picture.

    A pixel without an edge is `missing` if any reasonable shading shows the outline
    (`seen_outlines`), else `unknown`. `untold` is the largest number of pixels that a missing half
    or a reversed depth test would make wrong while nearly all outlines stay in their places.
    """

    shown: int
    missing: int
    unknown: int
    untold: int = 0


@dataclass(frozen=True, kw_only=True)
class ColorFigures:
    """Pixels that show the right surface in another color."""

    wrong: int


@dataclass(frozen=True, kw_only=True)
class HogelNumbers:
    """Comparison of one image with the expected image, in numbers, as written to JSON."""

    shown: int  # judged pixels where the image or the expected image shows a surface
    by: str  # what `wrong` counts: triangle, object, color, outlines, or coverage
    wrong: int  # shown pixels that differ in this property
    fraction: float
    surface: SurfaceFigures | None  # None if the image names no surfaces
    invalid: int  # shown pixels that name a triangle or an object which the scene does not have
    displacement_px: Spread | None  # None if it cannot be measured
    displacement_by: MeasuredBy
    radiance: (
        ColorFigures | None
    )  # None if the image lacks surfaces or colors, or colors are not compared
    causes: dict[str, int] | None  # wrong pixels by cause; None if not classified
    outlines: OutlineFigures | None = None  # None if outlines are not compared

    @property
    def blind(self) -> bool:
        """True if no pixel of the image could count as wrong."""
        return self.by != "color" and self.displacement_by is MeasuredBy.NO_OUTLINES

    @property
    def limited(self) -> int:
        """Number of wrong pixels that has a limit: wrong surfaces, or `wrong` without surfaces."""
        return self.wrong if self.surface is None else self.surface.wrong

    @property
    def limited_figure(self) -> str:
        """Name of the figure that `limited` counts."""
        return WRONG_FIGURES[self.by] if self.surface is None else SURFACES

    @property
    def all_wrong(self) -> int:
        """Number of wrong pixels with a limit, including wrong colors of right surfaces."""
        return self.limited + (0 if self.radiance is None else self.radiance.wrong)

    @property
    def judged_fraction(self) -> float:
        """Share of shown pixels that `limited` counts."""
        return self.limited / self.shown if self.shown else 0.0


@dataclass(frozen=True, eq=False)
class Figures:
    """The numbers of an image, with the images in which they were counted."""

    numbers: HogelNumbers
    claimed: int  # number of `shown` pixels that the image itself covers
    cause_masks: Causes | None
    answer: HogelImage  # image that should be shown
    image: HogelImage  # judged image, upright
    error: Mask  # (H, W) pixels with a wrong surface or color, or wrong in the property `by`

    @property
    def rounded(self) -> int:
        """Number of wrong pixels that rounding explains."""
        causes = self.cause_masks
        if causes is None:
            return 0
        return int(
            self.error.flat[causes.pixels[causes.heading < HEADINGS.index("unexplained")]].sum()
        )


def judge(
    reference: Reference,
    question: RendererModel,
    image: HogelImage,
    points: Floats,
    judging: Judging | None = None,
    *,
    explained: bool = False,
) -> Figures:
    """Compare an image with a model's image; `RendererModel()` is the true crossed frustum.

    The image and its surface points (H, W, 3), from `shown_points`, are as decoded, not upright.
    The image's camera is in the aperture of the file's name. Causes are classified if `explained`
    and if the image has triangle numbers.
    """
    reference = pictures.drawn_scene(reference, question)
    judging, scene = judging or Judging(), reference.scene
    seen = _Compared.from_image(reference, question, image, points, judging)
    answer, upright, by, shown = seen.answer, seen.upright, seen.by, seen.shown
    strange: Mask = (image.triangle < NOTHING) | (image.triangle >= len(scene.faces))
    strange |= (image.object < NOTHING) | (image.object >= len(scene.objects))
    invalid = question.upright(strange) & shown
    count, error, surface, radiance = int(shown.sum()), seen.differs, None, None
    if by not in COLOR_ONLY:
        placed = bool(np.isfinite(image.position[..., :2]).any())
        errors = wrong_surfaces(reference, question, answer, upright, placed=placed)
        error = (errors.wrong & shown) | invalid
        wrong, outside = int(error.sum()), int((errors.outside & shown).sum())
        surface = SurfaceFigures(
            wrong=wrong, fraction=wrong / count if count else 0.0, outside=outside
        )
        if image.color is not None and judging.compared is Compared.COLOR:
            right = pictures.reference_colors(reference, question, answer)
            differ = (
                pictures.colors_differ(right, upright, judging.color_tolerance) & shown & ~error
            )
            differ &= answer.triangle == upright.triangle
            radiance, error = ColorFigures(wrong=int(differ.sum())), error | differ
    if by == "triangle" or np.isfinite(upright.position[..., :2]).any():
        length = lengths(_shifts(scene, question, seen))
        known, spread, measured_by = np.isfinite(length), None, MeasuredBy.NOTHING
        # A minority of pixels is not representative.
        if known.any() and 2 * known.sum() >= covered_by(upright).sum():
            spread, measured_by = Spread.from_values(length[known]), MeasuredBy.POINTS
    else:
        spread, measured_by = _moved_outlines(scene, seen)
    causes = seen.causes(reference, question, judging) if explained else None
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
        outlines=seen.outlines
        and replace(seen.outlines, untold=_untold(reference, question, seen)),
    )
    claimed = int((seen.covered & shown).sum())
    return Figures(numbers, claimed, cause_masks=causes, answer=answer, image=upright, error=error)


def _shifts(scene: Scene, question: RendererModel, seen: _Compared) -> Floats:
    """Return the displacements (H, W, 2), px, of an image's points from their places."""
    position = seen.upright.position.astype(np.float64)
    places = question.project(scene, seen.answer.camera.aperture, position)
    return beyond_storage(places - pixel_centers(seen.answer.camera), seen.upright)


def wrong_pixels(
    reference: Reference,
    question: RendererModel,
    image: HogelImage,
    judging: Judging | None = None,
    *,
    explained: bool = False,
) -> tuple[Mask, Mask]:
    """Return upright masks (H, W) of pixels that `judge` counts as wrong: all, and unexplained.

    Unless `explained`, causes are not classified, and both masks are the same. Points without
    triangle numbers are wrong if they show a wrong surface, or are displaced beyond `TOLERANCE_PX`.
    """
    reference = pictures.drawn_scene(reference, question)
    judging = judging or Judging()
    seen = _Compared.from_image(
        reference, question, image, image.position.astype(np.float64), judging
    )
    if seen.by == "coverage":
        errors = wrong_surfaces(reference, question, seen.answer, seen.upright, placed=True)
        moved = lengths(_shifts(reference.scene, question, seen))
        seen = replace(
            seen, differs=seen.differs | seen.shown & (errors.wrong | (moved > TOLERANCE_PX))
        )
    causes = seen.causes(reference, question, judging) if explained else None
    return seen.differs, seen.differs if causes is None else causes.unexplained


@dataclass(frozen=True, kw_only=True, eq=False)
class _Compared:
    """An upright image, the model's image, and the pixels (H, W) that differ."""

    answer: HogelImage
    upright: HogelImage
    by: str
    covered: Mask
    shown: Mask
    differs: Mask
    outlines: OutlineFigures | None = None

    @classmethod
    def from_image(
        cls,
        reference: Reference,
        question: RendererModel,
        image: HogelImage,
        points: Floats,
        judging: Judging,
    ) -> _Compared:
        """Turn an image upright, and compare it with the model's image of its aperture."""
        scene, upright = reference.scene, question.upright
        aperture = question.answers(scene, image.camera.aperture)
        answer = pictures.trace_drawn(reference, question, aperture)
        # Replace negative numbers by a number that is too large: it is as invalid, and as an index
        # it does not count from the end.
        triangle = upright(np.where(image.triangle < NOTHING, len(scene.faces), image.triangle))
        objects = scene.object_of_number[existing_triangles(triangle, scene)]
        turned = HogelImage(
            camera=reference.camera(aperture),
            triangle=triangle.astype(np.int32),
            object=np.where(upright(image.object) != NOTHING, upright(image.object), objects),
            position=upright(points),
            color=None if image.color is None else upright(image.color),
            uncertainty=None if image.uncertainty is None else upright(image.uncertainty),
            storage=image.storage,
        )
        # An image without triangles is judged by objects, else by coverage, else by colors if it
        # has any.
        by = "triangle"
        if not (image.triangle != NOTHING).any():
            if (image.object != NOTHING).any():
                by = "object"
            elif np.isfinite(image.height).any():
                by = "coverage"
            elif image.color is not None:
                by = "color" if judging.compared is Compared.COLOR else "outlines"
        if by in COLOR_ONLY:
            answer = pictures.as_stored(
                pictures.reference_colors(reference, question, answer), image
            )
        covered: Mask = pictures.shows_something(turned) if by in COLOR_ONLY else covered_by(turned)
        shown = judged_pixels(answer) & (answer.covered | covered)
        outlined = None
        if by == "color":
            differs = pictures.colors_differ(answer, turned, judging.tolerance(question, image))
        elif by in ("coverage", "outlines"):
            differs = np.not_equal(answer.covered, covered)
            if by == "outlines":
                outlines = true_outlines(scene, answer)
                # Outlines that the model's image itself does not show, as between equal grays, may
                # be absent.
                absent = missing_outlines(outlines, contrast(turned)) & shown
                missing = absent & (strongest_steps(seen_outlines(scene, answer, outlines)) > 0)
                every = int(((strongest_steps(outlines) > 0) & shown).sum())
                few = int(missing.sum())
                outlined = OutlineFigures(shown=every, missing=few, unknown=int(absent.sum()) - few)
                differs |= missing
        else:
            differs = np.not_equal(getattr(answer, by), getattr(turned, by))
        return cls(
            answer=answer,
            upright=turned,
            by=by,
            covered=covered,
            shown=shown,
            differs=differs & shown,
            outlines=outlined,
        )

    def causes(
        self, reference: Reference, question: RendererModel, judging: Judging
    ) -> Causes | None:
        """Return the causes of the wrong pixels; None if images name no triangles."""
        # Lenses are excluded too: rounding is modeled only for edges that are straight on the film.
        if self.by != "triangle" or question.film != EVEN:
            return None
        scene, device, pixels = reference.scene, judging.device, np.flatnonzero(self.differs)
        # Only the true model can have cameras by direction. Models with defects are candidates of a
        # diagnosis, and have two cameras.
        if judging.directions is not None and question == RendererModel():
            images = self.answer, self.upright
            return judging.directions.explain(reference, device, images, pixels)
        cameras = foreign_cameras(scene, question, self.answer.camera.aperture, device)
        return find_causes(scene.triangles, cameras, self.answer, self.upright, pixels)


def wrong_surfaces(
    reference: Reference,
    question: RendererModel,
    answer: HogelImage,
    image: HogelImage,
    *,
    placed: bool,
) -> SurfaceErrors:
    """Return the pixels that show the wrong surface: see `xfrustum.compare.error_maps`.

    A point belongs outside the film if its own camera draws it beyond the border. It is hidden if
    its own camera's line meets another surface first, or if it lies behind the plate and `answer`
    shows a surface before the plate where the point is drawn. A triangle that neither camera draws
    anywhere shows no point, and is wrong. If the image itself states points (`placed`), they must
    also lie on a surface.
    """
    scene, plate, aperture = reference.scene, question.plate_height, answer.camera.aperture
    wrong = other_surfaces(answer, image, scene)
    pointed = np.isfinite(image.position).all(axis=-1)
    known = pointed & covered_by(image)
    wrong |= (image.triangle != NOTHING) & ~pointed & (image.triangle != answer.triangle)
    if question.film != EVEN:
        # No camera has the lines of an uneven film: only triangle numbers are compared.
        wrong |= image.triangle != answer.triangle
        return SurfaceErrors(wrong=wrong, outside=np.zeros_like(wrong))
    sides = [(0, known & (image.height != plate))]
    if not question.one_pencil:
        sides = [(1, known & (image.height < plate)), (-1, known & (image.height > plate))]
    outside = np.zeros_like(wrong)
    for side, stated in sides:
        outside |= outside_film(
            stated, image, scene, unflipped(question.bundle(scene, aperture, side))
        )
    wrong |= outside
    for side, stated in sides if question.plain else ():

        def hides(points: SurfacePoints, side: int = side) -> Mask:
            bundle = unflipped(question.bundle(scene, aperture, side))
            behind = reference.hidden_from(bundle, points)
            if side != 1:
                return behind
            # A surface before the plate, where `answer` shows it, covers all that C draws there.
            place = question.project(scene, aperture, points.position)
            width, height = answer.camera.resolution
            on_film: Mask = np.all((place > -0.5) & (place < (width - 0.5, height - 0.5)), axis=1)
            column, row = np.rint(np.where(on_film[:, None], place, 0.0)).astype(np.int64).T
            with np.errstate(invalid="ignore"):
                return np.asarray(behind | (on_film & (answer.height[row, column] > plate)))

        wrong |= hidden_pixels(stated & ~wrong, image, scene, hides)
        if placed:
            lines = unflipped(question.bundle(scene, aperture, side))
            hidden = partial(reference.hidden_from, lines)
            wrong |= floating_pixels(stated & ~wrong, answer, image, lines, hidden)
    return SurfaceErrors(wrong=wrong, outside=outside)
