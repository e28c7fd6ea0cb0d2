"""Errors of a raster image against the truth, by pixel and in numbers: surfaces and radiance.

The measures are defined in docs/method.md, "Comparison".

**Radiance** errors are in linear RGB, raster minus truth. FLIP and SSIM compare displayed pictures,
clipped and in sRGB (`representation.encoded`): FLIP in its LDR mode, SSIM with the window of its
publication.

A reference that samples light paths has a mean and the variance of this mean. If a picture equals
the expectation of the mean, (mean - picture) / standard error follows Student's t with one degree
of freedom less than the number of samples; Sidak's correction accounts for the number of pixels.
Shadows and interreflection, which a rasterizer leaves out, are the difference of two such truths,
each with its own noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import flip_evaluator
import numpy as np
import scipy
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from xfrustum.compare import error_maps
from xfrustum.compare.error_maps import judged_pixels
from xfrustum.reference import Reference
from xfrustum.reference.transport import PathTracer, RadianceEstimate
from xfrustum.scenes.appearance import Transport, sub_apertures
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.model.images import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.representation import (
    NO_UNIT,
    SCENE_UNITS,
    Labelled,
    ShortRepr,
    dataset,
    encoded,
)

if TYPE_CHECKING:
    import xarray


#: probability that a test of a whole picture fails although the picture is right
ALPHA = 0.01

PIXELS_PER_DEGREE = 0.7 * (3840 / 0.7) * math.pi / 180
"""Viewing condition of FLIP: a screen 3840 pixels and 0.7 m wide, seen from 0.7 m.

It is valid for a picture on a screen. Through a plate, a viewer does not see the picture of an
aperture as a whole."""

SSIM_SIGMA_PX, SSIM_WINDOW_PX = 1.5, 11
"""Standard deviation and width of the Gaussian window of SSIM (Wang et al., 2004)."""

STEP = 1 / 255
"""One level of 8-bit output in linear radiance: allowed difference of two shaded images."""

#: function called after each part of the work
Done = Callable[[], object]


@dataclass(frozen=True, kw_only=True)
class NoiseNumbers:
    """Numbers of a test of a picture against a noisy reference, as `compare --json` prints them.

    A picture agrees if no pixel differs at the level `alpha` of the whole picture. The p-value is
    the probability of a largest deviation at least as large as measured, if the picture is the
    limit of the reference. It is exact for independent tests, and an upper bound for dependent
    tests, such as the channels of a pixel.
    """

    agrees: bool
    #: number of pixels that differ
    differ: int
    alpha: float
    #: number of tests: pixels times channels
    tests: int
    p_value: float
    #: mean of picture minus reference over the tested pixels
    bias: float
    #: standard error of `bias`, from the variances
    bias_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseTest:
    """Result of a per-pixel test of a picture against a noisy reference."""

    numbers: NoiseNumbers
    #: (H, W) pixels that differ at the level of the whole picture
    differs: Mask


def compare_with_noise(
    picture: NDArray[np.floating],
    estimate: RadianceEstimate,
    judged: Mask,
    rounding: Floats | float = 0.0,
) -> NoiseTest:
    """Test a noise-free picture (H, W, 3) of linear RGB against the limit of a noisy reference.

    `judged` (H, W) marks the tested pixels. Leave out pixels in which a surface may cover less than
    1 - (level of one test)^(1 / samples): all samples may miss this surface by chance, so that
    it affects neither mean nor variance. `rounding` is the radiance by which picture and mean may
    differ for other reasons than noise, such as rounding to float32. It is the only tolerance of
    pixels whose samples do not vary.
    """
    tested = judged & np.isfinite(picture).all(axis=-1) & np.isfinite(estimate.mean).all(axis=-1)
    difference = (np.asarray(picture, dtype=np.float64) - estimate.mean)[tested]
    variance = np.asarray(estimate.variance_of_mean, dtype=np.float64)[tested]
    allowed = np.broadcast_to(rounding, picture.shape)[tested]
    # Rounding is subtracted from the difference before noise is tested.
    excess = np.sign(difference) * np.maximum(np.abs(difference) - allowed, 0.0)
    noisy = variance > 0
    # If no sample varies, any excess is infinitely significant.
    scaled = np.where(excess == 0, 0.0, np.copysign(np.inf, excess))
    np.divide(excess, np.sqrt(variance), out=scaled, where=noisy)
    # Two-sided: a picture may be too dark or too bright.
    chance = 2 * scipy.special.stdtr(estimate.samples - 1, -np.abs(scaled))
    differs = np.zeros(tested.shape, dtype=np.bool_)
    differs[tested] = (chance < single_level(ALPHA, chance.size)).any(axis=-1)
    numbers = NoiseNumbers(
        agrees=not differs.any(),
        differ=int(differs.sum()),
        alpha=ALPHA,
        tests=chance.size,
        p_value=joint_chance(float(chance.min(initial=1.0)), chance.size),
        bias=float(difference.mean()) if len(difference) else 0.0,
        bias_error=float(np.sqrt(variance.sum()) / variance.size) if variance.size else 0.0,
    )
    return NoiseTest(numbers=numbers, differs=differs)


def joint_chance(chance: float, tests: int) -> float:
    """Return the chance that any of `tests` independent p-values is at most `chance` (Sidak)."""
    return 1.0 if chance >= 1 else float(-np.expm1(tests * np.log1p(-chance)))


def single_level(chance: float, tests: int) -> float:
    """Return the level of each test that gives all tests the level `chance` (Sidak)."""
    return float(-np.expm1(np.log1p(-chance) / max(tests, 1)))


@dataclass(frozen=True, kw_only=True)
class LeftOutNumbers:
    """Effect of shadows and interreflection; radiance is positive where the raster lacks light."""

    shadows: bool
    interreflection: bool
    #: samples per pixel of each of the two truths, the smaller number
    light_paths: int
    #: number of pixels that change beyond noise
    pixels: int
    #: numbers of changed pixels whose mean over channels decreases, and increases
    darker: int
    brighter: int
    #: mean change of radiance over pixels and channels
    mean: float
    mean_of_image: (
        float | None
    )  #: `mean` divided by the mean radiance of the image without the effects; None if that is 0
    #: root mean square of the change, with the noise subtracted
    rms: float
    rms_noise: float
    #: level of the test of pixels against noise, for the whole picture
    alpha: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOut:
    """Effect of shadows and interreflection on an image."""

    numbers: LeftOutNumbers
    #: the truth with the effects minus the truth without; `samples` counts the samples of one
    difference: RadianceEstimate
    #: the truth without the effects, (H, W, 3)
    without: Floats


def transported(
    scene: Scene,
    aperture: Aperture,
    transport: Transport,
    *,
    seed: int = 0,
    exact: bool | None = None,
    done: Done = lambda: None,
) -> RadianceEstimate:
    """Return the color of an aperture, as `PathTracer.render` does, over its sub-apertures.

    `done` is called after each sub-aperture.
    """
    points = sub_apertures(scene.plate, aperture, scene.sampling.aperture)
    tracer = PathTracer(scene)
    mean, variance = np.zeros(()), np.zeros(())
    for number, point in enumerate(points):
        part = tracer.render(point, transport, seed=seed + number, exact=exact)
        mean = mean + part.mean / len(points)
        # Sub-apertures are sampled independently: their variances add.
        variance = variance + part.variance_of_mean / len(points) ** 2
        done()
    # The mean of several estimates is closer to a normal distribution than each of them.
    return RadianceEstimate(mean=mean, variance_of_mean=variance, samples=transport.samples)


def measure_left_out(scene: Scene, aperture: Aperture, done: Done = lambda: None) -> LeftOut:
    """Measure the effect of the light transport of a scene on an image."""
    local = replace(scene.transport, shadows=False, interreflection=False)
    full = transported(scene, aperture, scene.transport, done=done)
    # Use the same arithmetic as for `full`, so that pixels without shadows do not differ by
    # rounding.
    exact = not scene.transport.interreflection
    seed = scene.sampling.aperture
    without = transported(scene, aperture, local, seed=seed, exact=exact, done=done)
    # Welch's degrees of freedom are at least the smaller of the two samples' own.
    difference = RadianceEstimate(
        mean=full.mean - without.mean,
        variance_of_mean=full.variance_of_mean + without.variance_of_mean,
        samples=min(full.samples, without.samples),
    )
    # Test the null hypothesis of no effect. Pixels that differ are wrong in a rasterizer's image.
    change = difference.mean
    everywhere = np.ones(change.shape[:2], dtype=np.bool_)
    test = compare_with_noise(np.zeros(change.shape), difference, everywhere)
    brightness, mean = float(np.mean(without.mean)), float(np.mean(change))
    # Noise adds its variance to the mean square, whether or not anything changes.
    noise = float(np.mean(difference.variance_of_mean))
    numbers = LeftOutNumbers(
        shadows=scene.transport.shadows,
        interreflection=scene.transport.interreflection,
        light_paths=difference.samples,
        pixels=test.numbers.differ,
        darker=int((test.differs & (change.mean(axis=-1) < 0)).sum()),
        brighter=int((test.differs & (change.mean(axis=-1) > 0)).sum()),
        mean=mean,
        mean_of_image=mean / brightness if brightness else None,
        rms=float(np.sqrt(max(float(np.mean(change**2)) - noise, 0.0))),
        rms_noise=float(np.sqrt(noise)),
        alpha=test.numbers.alpha,
    )
    return LeftOut(numbers=numbers, difference=difference, without=without.mean)


@dataclass(frozen=True, kw_only=True, eq=False)
class PerceptualDifference:
    """Perceptual difference of two pictures."""

    #: mean FLIP over the picture, 0 (the same) to 1 (Andersson et al., 2020)
    flip: float
    ssim: (
        float | None
    )  #: mean over picture and channels, 1 if equal; None for pictures below the window's size
    #: (H, W) float32
    flip_map: Singles


def perceptual_difference(
    truth: NDArray[np.floating],
    raster: NDArray[np.floating],
    pixels_per_degree: float = PIXELS_PER_DEGREE,
) -> PerceptualDifference:
    """Return the perceptual difference of two pictures (H, W, 3) of linear RGB."""
    shown = [np.ascontiguousarray(encoded(color), dtype=np.float32) for color in (truth, raster)]
    # FLIP's neighborhoods extend over the whole picture, so that no pixel can be left out. The
    # evaluator needs displayed values in sRGB, float32 and contiguous.
    flip_map, _, _ = flip_evaluator.evaluate(
        *shown,
        "LDR",
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": pixels_per_degree},
    )
    flip_map = np.asarray(flip_map, dtype=np.float32)[..., 0]
    ssim = None
    # SSIM is undefined for pictures smaller than its window.
    if min(flip_map.shape) >= SSIM_WINDOW_PX:
        window = {"gaussian_weights": True, "sigma": SSIM_SIGMA_PX, "use_sample_covariance": False}
        ssim = float(structural_similarity(*shown, data_range=1.0, channel_axis=-1, **window))
    return PerceptualDifference(
        flip=float(flip_map.mean(dtype=np.float64)), ssim=ssim, flip_map=flip_map
    )


@dataclass(frozen=True, kw_only=True)
class RadianceSpread:
    """Distribution of the radiance error over some pixels.

    Root mean square and mean are over the pixels' channels; the mean is signed, positive where the
    raster is brighter. 99th percentile and maximum are over the pixels, each with its worst
    channel.
    """

    pixels: int
    rms: float
    mean: float
    p99: float
    max: float
    #: share of pixels with an error above `STEP` in any channel
    above_step: float

    @staticmethod
    def from_errors(error: Floats) -> RadianceSpread | None:
        """Return the spread of signed errors, (3, N) by channel; None if there are none."""
        if error.size == 0:
            return None
        worst = np.abs(error).max(axis=0)
        # Means of channels are taken first: a channel is contiguous in memory.
        return RadianceSpread(
            pixels=worst.size,
            rms=float(np.sqrt(np.square(error).mean(axis=1).mean())),
            mean=float(error.mean(axis=1).mean()),
            p99=float(np.percentile(worst, 99)),
            max=float(worst.max()),
            above_step=float(np.mean(worst > STEP)),
        )


@dataclass(frozen=True, kw_only=True)
class RadianceNumbers(RadianceSpread):
    """The radiance error over all judged pixels with colors, as `compare --json` prints it."""

    away_from_edges: (
        RadianceSpread | None
    )  #: over the pixels that the function `away_from_edges` returns
    #: flip, ssim and pixels_per_degree: None unless requested
    flip: float | None
    ssim: float | None
    pixels_per_degree: float | None
    noise: (
        NoiseNumbers | None
    )  #: whether pixels differ by more than `STEP` and the noise of light paths


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RadianceError(ShortRepr):
    """Errors of the colors of a raster image, in numbers and at judged pixels (H, W)."""

    numbers: RadianceNumbers
    truth: HogelImage
    raster: HogelImage
    judged: Mask

    @cached_property
    def error(self) -> Floats:
        """(H, W, 3) raster minus truth, NaN where not judged; computed at the first access."""
        assert self.raster.color is not None and self.truth.color is not None, "compared colors"
        error = self.raster.color.astype(np.float64) - self.truth.color
        error[~self.judged] = np.nan
        return error


def compare_radiance(
    truth: HogelImage, raster: HogelImage, *, perceptual: bool = False
) -> RadianceError | None:
    """Return the radiance error; None if an image has no color, or nothing is judged."""
    if truth.color is None or raster.color is None:
        return None
    # Use a plane for each channel: NumPy is several times slower along rows of three numbers.
    planes = np.stack(
        [
            np.subtract(raster.color[..., c], truth.color[..., c], dtype=np.float64).ravel()
            for c in range(3)
        ]
    )
    judged = judged_pixels(truth) & np.isfinite(planes).all(axis=0).reshape(truth.triangle.shape)
    spread = RadianceSpread.from_errors(planes if judged.all() else planes[:, judged.ravel()])
    if spread is None:
        return None
    inside = np.flatnonzero(judged & away_from_edges(truth, raster))
    looks = perceptual_difference(truth.color, raster.color) if perceptual else None
    # A truth without light paths has no noise to test against.
    noise, paths = None, truth.camera.light_paths
    if truth.variance is not None and paths is not None:
        mean, variance = (values.astype(np.float64) for values in (truth.color, truth.variance))
        estimate = RadianceEstimate(mean=mean, variance_of_mean=variance, samples=paths)
        noise = compare_with_noise(raster.color, estimate, judged, STEP).numbers
    numbers = RadianceNumbers(
        **vars(spread),
        away_from_edges=RadianceSpread.from_errors(planes.take(inside, axis=1)),
        flip=looks.flip if looks else None,
        ssim=looks.ssim if looks else None,
        pixels_per_degree=PIXELS_PER_DEGREE if looks else None,
        noise=noise,
    )
    return RadianceError(numbers=numbers, truth=truth, raster=raster, judged=judged)


def away_from_edges(truth: HogelImage, raster: HogelImage) -> Mask:
    """Return the pixels (H, W) at which truth and raster show the same triangle."""
    return np.asarray(
        (truth.triangle == raster.triangle) & truth.covered & (truth.triangle != NOTHING)
    )


@dataclass(frozen=True, kw_only=True)
class Share:
    """Number of pixels that are wrong in one respect; the fraction is 0 without judged pixels."""

    wrong: int
    fraction: float


@dataclass(frozen=True, kw_only=True)
class SurfaceShare(Share):
    """Number of judged pixels that show the wrong surface."""

    #: number of wrong pixels whose point belongs outside the true film
    outside: int
    #: number of wrong pixels whose true surface was culled; None without culling
    culled: int | None = None


@dataclass(frozen=True, kw_only=True)
class ComparisonNumbers:
    """Errors of a raster image in numbers: the record that `compare --json` prints."""

    pixels: int
    #: pixels whose truth is not a tie
    judged: int
    #: pixels where the truth shows a surface
    covered: int
    #: raster pixels that show a surface in the plate, where displacement is undefined
    at_plate: int
    #: None if the scene was not available
    surface: SurfaceShare | None
    #: None if the raster image names no triangles
    triangle: Share | None
    displacement_px: error_maps.Spread | None  #: None if the raster shows no surface off the plate
    height: (
        error_maps.HeightError | None
    )  #: None if no pixel shows the same triangle in both images
    #: None if colors were not compared, or an image has none
    radiance: RadianceNumbers | None
    #: number of the truth's pixels by class of certainty
    certainty: dict[str, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(ShortRepr, ComparisonNumbers):
    """Errors of a raster image, in numbers and pixel by pixel."""

    errors: error_maps.PixelErrors
    #: None if colors were not compared
    colors: RadianceError | None

    @property
    def maps(self) -> error_maps.ErrorMaps:
        """Each error as an image."""
        return replace(self.errors.maps, radiance=self.colors.error if self.colors else None)

    @property
    def surface_wrong(self) -> int | None:
        """Number of judged pixels with the wrong surface; None without the scene."""
        return self.surface.wrong if self.surface else None

    @property
    def numbers(self) -> ComparisonNumbers:
        """The numbers without the images."""
        return ComparisonNumbers(
            **{part.name: getattr(self, part.name) for part in fields(ComparisonNumbers)}
        )

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `compare --json` prints them."""
        return asdict(self.numbers)

    def to_xarray(self, units: str = SCENE_UNITS) -> xarray.Dataset:
        """Return the errors as `xarray.Dataset`, lengths in `units`; InputError without xarray."""
        maps, camera = self.maps, self.errors.truth.camera
        moved, surface, radiance = maps.displacement, maps.surface, maps.radiance
        labels: tuple[tuple[str, Any, str, str | None], ...] = (
            ("judged", maps.judged, "judged: no tie", None),
            ("surface", surface, "wrong surface", None),
            ("triangle", maps.triangle, "another triangle", None),
            ("displacement_columns", moved[..., 0], "true minus drawn place, to the right", "px"),
            ("displacement_rows", moved[..., 1], "true minus drawn place, down", "px"),
            ("height_error", maps.height, "height, image minus truth", units),
            ("radiance_error", radiance, "linear radiance, image minus truth", NO_UNIT),
        )
        images = {
            name: None if values is None else Labelled(values=values, meaning=meaning, units=unit)
            for name, values, meaning, unit in labels
        }
        renderers = {"truth": camera.renderer, "image": self.errors.raster.camera.renderer}
        scene = {"scene": camera.scene, "scene_hash": camera.scene_hash}
        return dataset(images, {}, {"aperture": list(camera.aperture.index), **scene, **renderers})


def compare_images(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    *,
    radiance: bool = True,
    perceptual: bool = False,
    cached_errors: error_maps.PixelErrors | None = None,
) -> Comparison:
    """Judge a raster image of an aperture by the truth.

    Parameters
    ----------
    truth
        True image, whose camera is the true frustum; pixels that are ties are not judged.
    raster
        Image of any renderer.
    reference
        Tracer of the same scene; without it `surface` is None.
    radiance, perceptual
        Whether to compare colors, and whether to compare how different the pictures look.
    cached_errors
        Errors of another image by the same truth: pixels that are equal in both images are not
        judged again.

    Raises
    ------
    InputError
        The images differ in size, aperture or scene.
    """
    _check(truth, raster, reference)
    colors = compare_radiance(truth, raster, perceptual=perceptual) if radiance else None
    errors = error_maps.pixel_errors(truth, raster, reference, cached_errors)
    judged = int(np.count_nonzero(errors.judged))

    def share(wrong: Mask) -> dict[str, Any]:
        count = int(np.count_nonzero(wrong))
        return {"wrong": count, "fraction": count / judged if judged else 0.0}

    surface = None
    if errors.surface is not None and errors.outside is not None:
        culled = error_maps.culled_pixels(truth, raster)
        surface = SurfaceShare(
            **share(errors.surface),
            outside=int(np.count_nonzero(errors.outside)),
            culled=None if culled is None else int(np.count_nonzero(culled & errors.surface)),
        )
    classes = {Certainty.UNEXAMINED.name.lower(): truth.triangle.size}
    if truth.certainty is not None:
        counts = np.bincount(truth.certainty.reshape(-1), minlength=len(Certainty))
        classes = {kind.name.lower(): int(counts[kind]) for kind in Certainty}
    return Comparison(
        pixels=errors.judged.size,
        judged=judged,
        covered=int(np.count_nonzero(truth.covered)),
        at_plate=errors.at_plate,
        surface=surface,
        triangle=Share(**share(errors.triangle)) if error_maps.names_triangles(raster) else None,
        displacement_px=errors.spread,
        height=errors.height_error,
        radiance=colors.numbers if colors else None,
        certainty=classes,
        errors=errors,
        colors=colors,
    )


def _check(truth: HogelImage, raster: HogelImage, reference: Reference | None) -> None:
    if truth.camera.settings is not None:
        raise InputError(
            f"the truth was made by a double frustum ({truth.camera.renderer}): "
            "give the traced image first"
        )
    if truth.triangle.shape != raster.triangle.shape:
        (h, w), (rh, rw) = truth.triangle.shape, raster.triangle.shape
        raise InputError(
            f"the truth has {w} x {h} pixels and the raster {rw} x {rh}: "
            "trace and draw the same scene"
        )
    if truth.camera.scene_hash != raster.camera.scene_hash:
        raise InputError(
            "truth and raster show different scenes (content hashes differ): "
            "make both from one file"
        )
    mine, other = truth.camera.aperture, raster.camera.aperture
    if (mine.x, mine.y) != (other.x, other.y):
        raise InputError(
            f"truth and raster show different apertures, {mine.column},{mine.row} and "
            f"{other.column},{other.row}: give both the same --aperture"
        )
    if reference is not None and raster.triangle.max(initial=NOTHING) >= len(reference.scene.faces):
        raise InputError(
            f"the raster names triangle {raster.triangle.max()}, "
            f"the scene has {len(reference.scene.faces)}: "
            "number them from 0 (id.triangle is that number + 1)"
        )
