"""Registration: conventions and geometry from pictures without triangle numbers.

Normalized correlation gives orientation and order. The sampling point and the field of view
minimize the difference between the image and a shifted and scaled, finer picture of the
reference.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import least_squares, minimize, minimize_scalar
from scipy.stats import t as student
from scipy.stats.qmc import Halton
from skimage.registration import phase_cross_correlation

from xfrustum.compare.diagnosis.geometry_fit import MAX_SAMPLING_PX, START_NEARS, GeometryFit
from xfrustum.compare.diagnosis.testset import TestSet, spread
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import RendererModel, places, screen_lengths
from xfrustum.compare.renderer_model.pictures import (
    as_gray,
    as_stored,
    picture_of,
)
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene

# Reference pixels per image pixel along each side, with interpolation between them. Ratio of the
# width of the reference's picture to the width of the film: a wider field of view needs surfaces
# outside the film.
SUPERSAMPLING, PICTURE_FILMS = 8, 1.25

# Confidence of the intervals, which are estimated from the spread over hogels. Smallest number of
# hogels: with two, the spread has one degree of freedom, and its 99 % interval extends 64 standard
# errors to either side. Largest number of hogels: more do not change the result.
INTERVAL_CONFIDENCE, MIN_INTERVAL_HOGELS, MAX_REGISTERED_HOGELS = 0.99, 3, 16

# Step of finite differences in pixels: two pixels of the reference's finer picture. Outlines are
# discontinuous, so that smaller steps would measure no slope.
DERIVATIVE_STEP_PX = 0.25

# Change of the parameters in pixels below which the search for the best shift ends: a fiftieth of
# the smallest reported shift (`drawn_model.SMALLEST_SHIFT_PX`).
SHIFT_TOLERANCE_PX = 1e-3

# Relative precision of a near offset.
NEAR_PRECISION = 1e-3

# Standard deviation, in pixels, of the filter that lets outlines several pixels apart attract each
# other.
BLUR_PX = 1.5

# Largest difference in brightness that counts as a small error. A pixel with a larger difference
# shows another surface, and its brightness does not depend on geometry.
MAX_BRIGHTNESS_DIFFERENCE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """Brightness (H, W) of an upright image, and the reference's finer and wider picture.

    The picture's grid is shifted by `offset` (2,), columns and rows in pixels of the image. Each
    hogel has another offset. Without offsets, the best shift would always be a whole number of the
    picture's pixels.
    """

    image: Floats
    wide: Floats
    offset: Floats

    @classmethod
    def from_image(
        cls, reference: Reference, model: RendererModel, image: HogelImage, offset: Floats
    ) -> _Pair:
        """Pair an image with the reference's picture under the orientation and order of a model."""
        aperture = model.answers(reference.scene, image.camera.aperture)
        shifted = replace(model, shift=tuple(offset.tolist()))
        wide = picture_of(reference, shifted, aperture, SUPERSAMPLING, PICTURE_FILMS)
        upright = model.orientation.upright(as_gray(image))
        return cls(image=upright, wide=_gray_like(wide, image), offset=offset)

    def blurred(self) -> _Pair:
        """Return the pair with blurred outlines."""
        image = gaussian_filter(self.image, BLUR_PX)
        wide = gaussian_filter(self.wide, BLUR_PX * SUPERSAMPLING)
        return replace(self, image=image, wide=wide)

    def difference(self, values: Floats, order: int = 1) -> Floats:
        """Return the reference's picture with a shift and fov, minus the image."""
        fine = []
        for axis, count in enumerate(self.image.shape):
            # Pictures have rows first, `values` columns first. Factors scale distances from the
            # film's middle; the result is in pixels of the fine picture.
            shift, factor, offset = values[1 - axis], values[3 - axis], self.offset[1 - axis]
            place = (np.arange(count) + 0.5 - count / 2 + shift) * factor - offset
            fine.append(place * SUPERSAMPLING + self.wide.shape[axis] / 2 - 0.5)
        places = np.meshgrid(*fine, indexing="ij")
        moved = map_coordinates(self.wide, places, order=order, mode="nearest")
        return np.asarray(moved - self.image)


def _gray_like(truth: HogelImage, image: HogelImage) -> Floats:
    """Return the truth in gray: brightness as the image's file stores it, or object numbers."""
    return as_gray(
        as_stored(truth, image) if image.color is not None else replace(truth, color=None)
    )


def register(
    reference: Reference, images: Sequence[HogelImage], nominal: RendererModel
) -> GeometryFit:
    """Find orientation, order, shift and field of view of pictures of colors or objects.

    A single hogel does not determine order and intervals. `nominal` is the model of the renderer
    according to its author.
    """
    # Step 1: leave out uniform pictures, which cannot be registered.
    images = [image for image in images if np.ptp(as_gray(image)) > 0]
    fit = replace(GeometryFit.exact(nominal), by_color=True)
    if not images:
        return fit
    # Step 2: orientation and order by correlation.
    model = _conventions(reference, images, nominal)
    # Step 3: the reference's finer picture of each fitted hogel, each with its own grid offset. The
    # Halton sequence covers the square evenly, without a period.
    chosen = spread(images, MAX_REGISTERED_HOGELS)
    offsets = (Halton(2, scramble=False).random(len(chosen)) - 0.5) / SUPERSAMPLING
    pairs = [
        _Pair.from_image(reference, model, image, offset)
        for image, offset in zip(chosen, offsets, strict=True)
    ]
    # Step 4: shift and field of view, first with blurred outlines, which attract each other, then
    # with sharp outlines.
    best = _closest(pairs, _least(pairs, _least([pair.blurred() for pair in pairs], _start(pairs))))
    # Step 5: intervals. The four fitted parameters are the first four. A parameter is nominal
    # if its interval contains the nominal value.
    half, values = _uncertainty(pairs, best), nominal.parameters
    fit.low[:4], fit.high[:4] = best - half, best + half
    values[:4] = np.where(np.abs(best - values[:4]) <= half, values[:4], best)
    fit = replace(fit, model=model.with_parameters(values))
    return fit if reference.scene.frustum.screen is None else _or_screen(reference.scene, fit)


def with_near(test: TestSet, model: RendererModel) -> RendererModel:
    """Return a candidate with the best near offset in place of another field of view."""
    few, plain = test.few(), replace(model, fov=test.nominal.fov)
    reach = test.reference.scene.frustum.longest_reach

    def wrong(power: float) -> int:
        return few.wrong(replace(plain, near=reach * float(np.exp(power))))

    powers = np.log(START_NEARS[1:])
    first = int(np.argmin([wrong(power) for power in powers.tolist()]))
    around = tuple(powers[np.clip((first - 1, first + 1), 0, len(powers) - 1)].tolist())
    finest = minimize_scalar(
        wrong, bounds=around, method="bounded", options={"xatol": NEAR_PRECISION}
    )
    return replace(plain, near=reach * float(np.exp(finest.x)))


def _or_screen(scene: Scene, fit: GeometryFit) -> GeometryFit:
    """Return a fit that distinguishes a shift from a moved screen, in a recentered frustum.

    The two look alike in pictures. If the shift may lie within one pixel, the fit has the shift,
    with the moved screen as an alternative. Otherwise it has the moved screen, with the shift as an
    alternative.
    """
    shift = np.asarray(fit.model.shift)
    if not shift.any():
        return fit
    per_px = screen_lengths(scene)
    x, y = (shift * per_px).tolist()
    moved = replace(fit.model, shift=(0.0, 0.0), screen_center=(x, y))
    of_shift, of_screen = places("shift"), places("screen-center")
    half = (fit.high - fit.low)[of_shift] / 2
    if (np.abs(shift) - half <= MAX_SAMPLING_PX).all():
        return replace(fit, alternatives=(moved,))
    low, high = fit.low.copy(), fit.high.copy()
    low[of_screen], high[of_screen] = np.sort(
        (low[of_shift] * per_px, high[of_shift] * per_px), axis=0
    )
    low[of_shift] = high[of_shift] = 0.0
    return replace(fit, model=moved, low=low, high=high, alternatives=(fit.model,))


def _conventions(
    reference: Reference, images: Sequence[HogelImage], nominal: RendererModel
) -> RendererModel:
    """Return the orientation and order under which images correlate best with the reference."""
    scene = reference.scene
    several = len({image.camera.aperture.index for image in images}) > 1

    @cache
    def truth(index: tuple[int, int]) -> Floats:
        return _gray_like(reference.trace(scene.plate.aperture(*index)), images[0])

    best, chosen = -np.inf, nominal
    orders = orientations(scene.plate.hogels) if several else (UPRIGHT,)
    for order, orientation in itertools.product(
        orders, list(orientations(scene.frustum.resolution))
    ):
        model, agreement = replace(nominal, orientation=orientation, order=order), 0.0
        for image in images:
            mine = orientation.upright(as_gray(image))
            its = truth(model.answers(scene, image.camera.aperture).index)
            # Correlation with a uniform picture is undefined.
            if np.ptp(its) > 0:
                agreement += float(np.corrcoef(mine.ravel(), its.ravel())[0, 1])
        # In a symmetric scene several conventions agree equally well: the first (no change) wins.
        if agreement > best + 1e-6 * len(images):
            best, chosen = agreement, model
    return chosen


def _start(pairs: Sequence[_Pair]) -> Floats:
    """Return start values of shift (columns, rows), by phase correlation, and fov (x, y)."""
    nominal = np.array([0.0, 0.0, 1.0, 1.0])
    moved = [
        phase_cross_correlation(
            pair.image, pair.difference(nominal) + pair.image, upsample_factor=20
        )[0]
        for pair in pairs
    ]
    # If a picture moved to the right, it was sampled to the left. Shifts of more than an eighth of
    # the film are false peaks of the correlation.
    shift = -np.median(moved, axis=0)[::-1]
    return np.append(
        np.where(np.abs(shift) < min(pairs[0].image.shape) / 8, shift, 0.0), nominal[2:]
    )


def _per_px(pairs: Sequence[_Pair]) -> Floats:
    """Return the changes (4,) of shift and fov that move the picture's border by a pixel."""
    height, width = pairs[0].image.shape
    return 1 / np.array([1.0, 1.0, width / 2, height / 2])


def _least(pairs: Sequence[_Pair], start: Floats) -> Floats:
    """Return shift and fov (4,) that minimize the difference of image and picture."""
    scales = DERIVATIVE_STEP_PX * _per_px(pairs)

    def errors(units: Floats) -> Floats:
        return np.concatenate([pair.difference(start + units * scales).ravel() for pair in pairs])

    def slopes(units: Floats) -> Floats:
        return np.stack(
            [(errors(units + step) - errors(units - step)) / 2 for step in np.eye(4)], axis=1
        )

    options = {"loss": "soft_l1", "f_scale": MAX_BRIGHTNESS_DIFFERENCE, "max_nfev": 20}
    return np.asarray(start + least_squares(errors, np.zeros(4), slopes, **options).x * scales)


def _closest(pairs: Sequence[_Pair], start: Floats) -> Floats:
    """Return shift and fov (4,) at which fewest pixels show another surface, from a close start.

    The search uses no derivatives, which do not exist at discontinuous outlines, and does not
    interpolate between surfaces.
    """
    scales = _per_px(pairs)

    def different(units: Floats) -> float:
        errors = [np.abs(pair.difference(start + units * scales, 0)) for pair in pairs]
        return float(
            np.mean([np.minimum(error, MAX_BRIGHTNESS_DIFFERENCE).mean() for error in errors])
        )

    simplex = np.vstack([np.zeros(4), DERIVATIVE_STEP_PX * np.eye(4)])
    options = {"initial_simplex": simplex, "xatol": SHIFT_TOLERANCE_PX}
    options |= {"fatol": 1e-9, "maxfev": 300}
    result = minimize(different, np.zeros(4), method="Nelder-Mead", options=options)
    return np.asarray(start + result.x * scales)


def _uncertainty(pairs: Sequence[_Pair], best: Floats) -> Floats:
    """Return half the interval widths by the jackknife over hogels; infinite for too few hogels."""
    count = len(pairs)
    if count < MIN_INTERVAL_HOGELS:
        return np.full(4, np.inf)
    # Step 1: variance by the jackknife, from fits that leave out one hogel each.
    without = np.array([_closest([*pairs[:out], *pairs[out + 1 :]], best) for out in range(count)])
    variance = (count - 1) / count * np.square(without - without.mean(axis=0)).sum(axis=0)
    # Step 2: each fine picture locates outlines to within half of its own pixel, independently of
    # the other pictures.
    grid = _per_px(pairs) / (2 * SUPERSAMPLING * np.sqrt(count))
    return np.asarray(
        grid + student.ppf((1 + INTERVAL_CONFIDENCE) / 2, count - 1) * np.sqrt(variance)
    )
