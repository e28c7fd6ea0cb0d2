"""Conventions and geometry from pictures without numbers of triangles: registered with the reference's own.

Orientation and order are found by normalized correlation. The sampling point and the field of view are found
by moving a finer picture of the reference until its difference from the image is least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import least_squares, minimize
from scipy.stats import t as student
from scipy.stats.qmc import Halton
from skimage.registration import phase_cross_correlation

from xfrustum.compare.diagnosis.geometry_fit import MAX_SAMPLING_PX, GeometryFit
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.orientations import UPRIGHT, orientations
from xfrustum.compare.renderer_model.pictures import as_gray, picture_of
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene

SUPERSAMPLING = 8
"""Reference pixels for each pixel of an image, along each side; values between them are interpolated."""

PICTURE_FILMS = 1.25
"""Width of the reference's picture in widths of the film: a wider field of view finds surfaces there."""

INTERVAL_CONFIDENCE = 0.99
"""Confidence of the intervals, which are estimated from the spread over hogels."""

MIN_INTERVAL_HOGELS = 3
"""Smallest number of hogels from which an interval is estimated: two give a spread with one degree of
freedom, whose interval at 99 % is 64 standard errors wide to either side."""

MAX_REGISTERED_HOGELS = 16
"""Largest number of hogels used for fitting; more do not change the result."""

DERIVATIVE_STEP_PX = 0.25
"""Step of finite differences in pixels. Outlines are discontinuous, so that smaller steps see no slope; the
reference's own pixels are half as large."""

SHIFT_TOLERANCE_PX = 1e-3
"""Change of the parameters in pixels below which the search for the best shift ends: a fiftieth of the
smallest shift that has a name (`parameters.SMALLEST_SHIFT_PX`)."""

BLUR_PX = 1.5
"""Standard deviation of the filter under which outlines that lie pixels apart still attract each other."""

MAX_BRIGHTNESS_DIFFERENCE = 0.05
"""Largest difference in brightness that is taken for a small error. A pixel with a larger one shows another
surface, and how much brighter this surface is says nothing about the geometry."""

PARAMETER_OFFSET = 1e3
"""Added to every fitted parameter, so that scipy's relative steps become absolute."""

NOMINAL_SHIFT_AND_FOV = np.array([0.0, 0.0, 1.0, 1.0])
"""Shift (columns, rows) in pixels and factors of the field of view (x, y) where nothing is wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """An image, and a finer and wider picture of the same hogel by the reference.

    Attributes
    ----------
    image
        (H, W) brightness of the image, upright.
    wide
        Brightness of the reference's picture, `SUPERSAMPLING` pixels for each pixel of the image.
    offset
        (2,) shift of the picture's grid, columns and rows in pixels of the image, less than one of the
        picture's own pixels. Each hogel has another one: without them, the best shift would always be a whole
        number of the picture's pixels.
    """

    image: Floats
    wide: Floats
    offset: Floats

    def blurred(self) -> _Pair:
        """Return image and picture after the same filter."""
        return _Pair(
            image=gaussian_filter(self.image, BLUR_PX),
            wide=gaussian_filter(self.wide, BLUR_PX * SUPERSAMPLING),
            offset=self.offset,
        )


def register(reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel) -> GeometryFit:
    """Find orientation, order, shift and field of view of pictures.

    Parameters
    ----------
    reference
        Reference of the scene.
    images
        Hogels as found, with colors or numbers of objects; a single hogel leaves order and intervals open.
    nominal
        Model of the renderer by its author's statements.
    """
    # Step 1: leave out pictures of one brightness, which show nothing to register.
    grays = [as_gray(image) for image in images]
    told = [index for index, gray in enumerate(grays) if np.ptp(gray) > 0]
    values = nominal.parameters
    unknown = GeometryFit(model=nominal, low=values, high=values, free=(), noise_px=0.0)
    if not told:
        return unknown
    images, grays = [images[index] for index in told], [grays[index] for index in told]
    # Step 2: orientation and order by correlation.
    model = _conventions(reference, images, grays, nominal)
    # Step 3: the reference's finer picture of each hogel that is fitted, on a grid of its own.
    chosen = np.unique(np.linspace(0, len(images) - 1, MAX_REGISTERED_HOGELS).astype(int))
    # Halton's sequence covers the square evenly, and has no period.
    offsets = (Halton(2, scramble=False).random(len(chosen)) - 0.5) / SUPERSAMPLING
    pairs = [
        _pair(reference, model, images[index], grays[index], offset)
        for index, offset in zip(chosen, offsets, strict=True)
    ]
    # Step 4: shift and field of view, from blurred outlines that attract each other to sharp ones.
    blurred = [pair.blurred() for pair in pairs]
    best = _least(blurred, _start(pairs), DERIVATIVE_STEP_PX)
    best = _closest(pairs, _least(pairs, best, DERIVATIVE_STEP_PX))
    # Step 5: intervals; the four fitted numbers are the first four parameters.
    values, low, high = model.parameters, model.parameters, model.parameters
    half = _uncertainty(pairs, best)
    low[:4], high[:4] = best - half, best + half
    # A number whose interval holds the nominal value keeps the nominal value.
    values[:4] = np.where(np.abs(best - values[:4]) <= half, values[:4], best)
    fit = GeometryFit(
        model=model.with_parameters(values), low=low, high=high, free=("shift", "fov"), noise_px=0.0
    )
    return fit if reference.scene.frustum.screen is None else _or_screen(reference.scene, fit)


def _or_screen(scene: Scene, fit: GeometryFit) -> GeometryFit:
    """Return a fit to pictures of a recentered frustum, in which a moved screen looks like a shift.

    A shift that is within the pixel, or may be by its interval, is kept with the moved screen as an
    alternative; beyond it, the reverse.
    """
    shift = np.asarray(fit.model.shift)
    if not shift.any():
        return fit
    per_px = parameters.screen_lengths(scene)
    x, y = (shift * per_px).tolist()
    moved = replace(fit.model, shift=(0.0, 0.0), screen_center=(x, y))
    of_shift, of_screen = list(parameters.places("shift")), list(parameters.places("screen-center"))
    half = (fit.high - fit.low)[of_shift] / 2
    if (np.abs(shift) - half <= MAX_SAMPLING_PX).all():
        return replace(fit, alternatives=(moved,))
    low, high = fit.low.copy(), fit.high.copy()
    ends = np.sort((low[of_shift] * per_px, high[of_shift] * per_px), axis=0)
    low[of_screen], high[of_screen] = ends
    low[of_shift] = high[of_shift] = 0.0
    free = ("screen-center", "fov")
    return replace(fit, model=moved, low=low, high=high, free=free, alternatives=(fit.model,))


def _conventions(
    reference: Reference, images: Sequence[HogelImage], grays: Sequence[Floats], nominal: DrawnModel
) -> DrawnModel:
    """Return the orientation and order under which images correlate best with the reference."""
    scene = reference.scene
    truths: dict[tuple[int, int], Floats] = {}
    best, found = -np.inf, nominal
    several = len({image.camera.aperture.index for image in images}) > 1
    for order in orientations(scene.plate.hogels) if several else (UPRIGHT,):
        for orientation in orientations(scene.frustum.resolution):
            model = replace(nominal, orientation=orientation, order=order)
            agreement = 0.0
            for image, gray in zip(images, grays, strict=True):
                aperture = model.answers(scene, image.camera.aperture)
                if aperture.index not in truths:
                    truth = reference.trace(aperture)
                    if image.color is None:
                        truth = replace(truth, color=None)
                    truths[aperture.index] = as_gray(truth)
                agreement += _correlation(orientation.upright(gray), truths[aperture.index])
            # Pictures of a symmetric scene agree equally well: the first convention, no change, wins then.
            if agreement > best + 1e-6 * len(images):
                best, found = agreement, model
    return found


def _correlation(a: Floats, b: Floats) -> float:
    """Return the correlation of two pictures, 0 where one of them is uniform."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum()) / norm if norm > 0 else 0.0


def _pair(reference: Reference, model: DrawnModel, image: HogelImage, gray: Floats, offset: Floats) -> _Pair:
    aperture = model.answers(reference.scene, image.camera.aperture)
    shifted = replace(model, shift=(float(offset[0]), float(offset[1])))
    wide = picture_of(reference, shifted, aperture, SUPERSAMPLING, PICTURE_FILMS)
    if image.color is None:
        wide = replace(wide, color=None)
    return _Pair(image=model.orientation.upright(gray), wide=as_gray(wide), offset=offset)


def _start(pairs: Sequence[_Pair]) -> Floats:
    """Return the start values of shift (columns, rows) and fov (x, y), the shift by phase correlation."""
    moved = np.array(
        [
            phase_cross_correlation(pair.image, _sampled(pair, NOMINAL_SHIFT_AND_FOV), upsample_factor=20)[0]
            for pair in pairs
        ]
    )
    # A picture that moved to the right was sampled to the left.
    down, right = -np.median(moved, axis=0)
    # Larger shifts than an eighth of the film are false peaks of the correlation.
    small = min(pairs[0].image.shape) / 8
    return np.array([right if abs(right) < small else 0.0, down if abs(down) < small else 0.0, 1.0, 1.0])


def _least(pairs: Sequence[_Pair], start: Floats, step_px: float) -> Floats:
    """Return shift and fov at which image and picture differ least, found with derivatives.

    Parameters
    ----------
    pairs
        Images and pictures.
    start
        (4,) start values of shift and fov.
    step_px
        Step of the derivatives: the distance by which it moves the borders of the picture, px.
    """
    height, width = pairs[0].image.shape
    scales = step_px / np.array([1.0, 1.0, width / 2, height / 2])

    def at(units: Floats) -> Floats:
        return np.asarray(start + (units - PARAMETER_OFFSET) * scales)

    def differences(units: Floats) -> Floats:
        values = at(units)
        return np.concatenate([(_sampled(pair, values) - pair.image).ravel() for pair in pairs])

    found = least_squares(
        differences,
        np.full(4, PARAMETER_OFFSET),
        jac="3-point",
        diff_step=1 / PARAMETER_OFFSET,
        loss="soft_l1",
        f_scale=MAX_BRIGHTNESS_DIFFERENCE,
        max_nfev=20,
    )
    return at(found.x)


def _closest(pairs: Sequence[_Pair], start: Floats) -> Floats:
    """Return shift and fov at which fewest pixels show another surface, from a start that is nearly right.

    The search needs no derivatives, which discontinuous outlines do not have, and does not interpolate
    between surfaces.
    """
    height, width = pairs[0].image.shape
    scales = 1 / np.array([1.0, 1.0, width / 2, height / 2])

    def different(units: Floats) -> float:
        values = start + units * scales
        errors = [np.abs(_sampled(pair, values, 0) - pair.image) for pair in pairs]
        return float(np.mean([np.minimum(error, MAX_BRIGHTNESS_DIFFERENCE).mean() for error in errors]))

    simplex = np.vstack([np.zeros(4), DERIVATIVE_STEP_PX * np.eye(4)])
    settings = {"initial_simplex": simplex, "xatol": SHIFT_TOLERANCE_PX, "fatol": 1e-9, "maxfev": 300}
    found = minimize(different, np.zeros(4), method="Nelder-Mead", options=settings)
    return np.asarray(start + found.x * scales)


def _uncertainty(pairs: Sequence[_Pair], best: Floats) -> Floats:
    """Return half the width of the intervals by the jackknife over hogels; infinite for too few of them."""
    count = len(pairs)
    if count < MIN_INTERVAL_HOGELS:
        return np.full(4, np.inf)
    # Step 1: the jackknife's variance, from fits that leave out one hogel each.
    without = np.array([_closest([*pairs[:out], *pairs[out + 1 :]], best) for out in range(count)])
    variance = (count - 1) / count * np.square(without - without.mean(axis=0)).sum(axis=0)
    height, width = pairs[0].image.shape
    # Step 2: each fine picture places outlines to within half of its pixels, independently of the others.
    grid = 1 / (2 * SUPERSAMPLING * np.sqrt(count)) / np.array([1.0, 1.0, width / 2, height / 2])
    return np.asarray(grid + student.ppf((1 + INTERVAL_CONFIDENCE) / 2, count - 1) * np.sqrt(variance))


def _sampled(pair: _Pair, values: Floats, order: int = 1) -> Floats:
    """Return the reference's picture at the pixels of an image with some shift and field of view."""
    height, width = pair.image.shape
    fine = []
    for count, total, shift, factor, offset in zip(
        (height, width), pair.wide.shape, values[1::-1], values[:1:-1], pair.offset[::-1], strict=True
    ):
        # Factors act on pixels counted from the film's middle; the result is in the fine picture's pixels.
        place = (np.arange(count) + 0.5 - count / 2 + shift) * factor - offset
        fine.append(place * SUPERSAMPLING + total / 2 - 0.5)
    rows, columns = np.meshgrid(*fine, indexing="ij")
    return np.asarray(map_coordinates(pair.wide, (rows, columns), order=order, mode="nearest"))
