"""What a rasterizer leaves out: shadows and interreflection, measured by light paths.

The truth is traced with and without them by the same tracer, so that nothing else differs; each image has
its own noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.metrics.noise import NoiseTest, compare_with_noise
from xfrustum.reference.transport.transport import PathTracer, RadianceEstimate
from xfrustum.scenes.appearance.sampling import Transport, sub_apertures
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class LeftOutNumbers:
    """What shadows and interreflection do to an image, in numbers.

    Radiance is positive where the rasterizer lacks light.

    Attributes
    ----------
    light_paths
        Light paths per pixel of one of the two truths.
    pixels, darker, brighter
        Number of pixels that change beyond noise; of those that get darker and brighter on the mean of
        their channels.
    mean
        Mean change of radiance over pixels and channels.
    mean_of_image
        `mean` over the mean radiance of the image without shadows and interreflection; None where that is 0.
    rms
        Root mean square of the change, from which the noise is taken off.
    alpha
        Level of the test that tells pixels from noise, for the whole picture.
    """

    shadows: bool
    interreflection: bool
    light_paths: int
    pixels: int
    darker: int
    brighter: int
    mean: float
    mean_of_image: float | None
    rms: float
    rms_noise: float
    alpha: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOut:
    """What shadows and interreflection do to an image.

    Attributes
    ----------
    difference
        The truth with them minus the truth without; its samples are light paths of one of the two.
    noise
        Test of the hypothesis that they do nothing: `differs` are the pixels that a rasterizer misses.
    without
        The truth without them, (H, W, 3).
    """

    transport: Transport
    difference: RadianceEstimate
    noise: NoiseTest
    without: Floats

    @property
    def numbers(self) -> LeftOutNumbers:
        """The numbers of the whole image."""
        change, differs = self.difference.mean, self.noise.differs
        brightness = float(np.mean(self.without))
        mean = float(np.mean(change))
        # Noise adds its variance to the mean square, whether or not anything changes.
        noise = float(np.mean(self.difference.variance_of_mean))
        return LeftOutNumbers(
            shadows=self.transport.shadows,
            interreflection=self.transport.interreflection,
            light_paths=self.difference.samples,
            pixels=self.noise.numbers.differ,
            darker=int((differs & (change.mean(axis=-1) < 0)).sum()),
            brighter=int((differs & (change.mean(axis=-1) > 0)).sum()),
            mean=mean,
            mean_of_image=mean / brightness if brightness else None,
            rms=float(np.sqrt(max(float(np.mean(change**2)) - noise, 0.0))),
            rms_noise=float(np.sqrt(noise)),
            alpha=self.noise.numbers.alpha,
        )


def transported(
    scene: Scene,
    aperture: Aperture,
    transport: Transport,
    *,
    seed: int = 0,
    done: Callable[[], object] | None = None,
) -> RadianceEstimate:
    """Return the color of an aperture by light paths, averaged over its sub-apertures.

    Parameters
    ----------
    scene
        Scene whose sampling says where light paths start.
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
    everywhere = np.ones(difference.mean.shape[:2], dtype=np.bool_)
    nothing = np.zeros(difference.mean.shape)
    return LeftOut(
        transport=scene.transport,
        difference=difference,
        noise=compare_with_noise(nothing, difference, everywhere),
        without=without.mean,
    )
