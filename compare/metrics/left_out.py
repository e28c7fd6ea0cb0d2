"""What a rasterizer leaves out: shadows and interreflection, measured by light paths.

The truth is traced with and without them by the same tracer, so that nothing else differs; each image has
its own noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.metrics.noise import compare_with_noise
from xfrustum.reference.transport.transport import PathTracer, RadianceEstimate
from xfrustum.scenes.appearance.sampling import Transport, sub_apertures
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class LeftOutNumbers:
    """What shadows and interreflection do to an image; radiance is positive where the raster lacks light."""

    shadows: bool
    interreflection: bool
    light_paths: int  # per pixel of one of the two truths
    pixels: int  # that change beyond noise
    darker: int  # of these, on the mean of their channels
    brighter: int
    mean: float  # change of radiance over pixels and channels
    mean_of_image: float | None  # over the mean radiance of the image without them; None where that is 0
    rms: float  # of the change, from which the noise is taken off
    rms_noise: float
    alpha: float  # level of the test that tells pixels from noise, for the whole picture


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOut:
    """What shadows and interreflection do to an image."""

    numbers: LeftOutNumbers
    difference: RadianceEstimate  # the truth with them minus the truth without; samples are those of one
    without: Floats  # the truth without them, (H, W, 3)


def transported(
    scene: Scene,
    aperture: Aperture,
    transport: Transport,
    *,
    seed: int = 0,
    done: Callable[[], object] | None = None,
) -> RadianceEstimate:
    """Return the color of an aperture by light paths, averaged over its sub-apertures.

    The scene's sampling says where light paths start; `done` is called after each sub-aperture.
    """
    points = sub_apertures(scene.plate, aperture, scene.sampling.aperture)
    tracer = PathTracer(scene)
    mean, variance = np.zeros(()), np.zeros(())
    for number, point in enumerate(points):
        part = tracer.render(point, transport, seed=seed + number)
        mean = mean + part.mean / len(points)
        variance = variance + part.variance_of_mean / len(points) ** 2
        if done is not None:
            done()
    # The mean of several estimates is nearer to normal than each of them.
    return RadianceEstimate(mean=mean, variance_of_mean=variance, samples=transport.samples)


def measure_left_out(scene: Scene, aperture: Aperture, done: Callable[[], object] | None = None) -> LeftOut:
    """Measure what the light transport that a scene asks for does to an image."""
    local = replace(scene.transport, shadows=False, interreflection=False)
    full = transported(scene, aperture, scene.transport, done=done)
    without = transported(scene, aperture, local, seed=scene.sampling.aperture, done=done)
    # Welch's degrees of freedom are at least the smaller of the two samples' own.
    difference = RadianceEstimate(
        mean=full.mean - without.mean,
        variance_of_mean=full.variance_of_mean + without.variance_of_mean,
        samples=min(full.samples, without.samples),
    )
    # The hypothesis is that they do nothing: what differs is what a rasterizer misses.
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
