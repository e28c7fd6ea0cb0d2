"""What an effect costs: the same image with and without it, in turn, and the median of the differences."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NoReturn

from tqdm import tqdm

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.transport.transport import PathTracer
from xfrustum.reports.common.timing import Stopwatch, median_interval
from xfrustum.reports.effects.cost_record import Cost
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

SINGLE_SAMPLE = Sampling()
"""One point for each pixel and aperture."""

MEASURED_PATHS = 4
"""Light paths per pixel with which light transport is timed: its time is proportional to their number."""

Image = Callable[[], object]


def cost(with_it: Image, without_it: Image, repeat: int) -> Cost:
    """Return the time that the first of two images takes beyond the second.

    Parameters
    ----------
    with_it, without_it
        Functions that make the images.
    repeat
        Measured pairs, after one that warms up. The images of a pair are made in alternating order: the
        second may find caches filled, or a processor slowed down.
    """
    pairs = [_pair(with_it, without_it, swapped=turn % 2 == 0) for turn in range(repeat + 1)][1:]
    differences = [one - other for one, other in pairs]
    quartiles = statistics.quantiles(differences, n=4) if repeat > 1 else differences * 3
    return Cost(
        seconds=statistics.median(differences),
        spread=(quartiles[2] - quartiles[0]) / 2,
        interval=median_interval(differences),
        repetitions=repeat,
        without=statistics.median(other for _, other in pairs),
    )


def _pair(with_it: Image, without_it: Image, *, swapped: bool) -> tuple[float, float]:
    if swapped:
        other = _seconds(without_it)
        return _seconds(with_it), other
    return _seconds(with_it), _seconds(without_it)


def _seconds(image: Image) -> float:
    watch = Stopwatch()
    with watch.stage("image"):
        image()
    return watch.seconds["image"]


@dataclass(frozen=True, kw_only=True)
class Stopwatches:
    """Measures one aperture's image by both renderers.

    Attributes
    ----------
    scene, aperture, settings, tracer
        Image that is timed.
    repeat
        Measured pairs.
    """

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    tracer: str
    repeat: int

    def of_effects(
        self, with_it: frozenset[Effect], without_it: frozenset[Effect], bar: tqdm[NoReturn]
    ) -> dict[str, Cost]:
        """Return the cost of one set of effects beyond another, by renderer."""
        found = {}
        with Rasterizer(self.scene, with_it) as one, Rasterizer(self.scene, without_it) as other:
            found["raster"] = cost(
                self._raster(one, SINGLE_SAMPLE), self._raster(other, SINGLE_SAMPLE), self.repeat
            )
        bar.update()
        # A true line meets the same surface first, whichever cameras would draw it.
        if (with_it ^ without_it) - {Effect.C, Effect.C_STAR}:
            true, simpler = (Reference(self.scene, self.tracer, some) for some in (with_it, without_it))
            found["reference"] = cost(
                self._trace(true, SINGLE_SAMPLE), self._trace(simpler, SINGLE_SAMPLE), self.repeat
            )
        bar.update()
        return found

    def of_sampling(self, sampling: Sampling, bar: tqdm[NoReturn]) -> dict[str, Cost]:
        """Return the cost of finer sampling beyond one sample, by renderer."""
        found = {}
        with Rasterizer(self.scene) as rasterizer:
            images = (self._raster(rasterizer, sampling), self._raster(rasterizer, SINGLE_SAMPLE))
            found["raster"] = cost(*images, self.repeat)
        bar.update()
        reference = Reference(self.scene, self.tracer)
        found["reference"] = cost(
            self._trace(reference, sampling), self._trace(reference, SINGLE_SAMPLE), self.repeat
        )
        bar.update()
        return found

    def of_transport(self, transport: Transport, bar: tqdm[NoReturn]) -> dict[str, Cost]:
        """Return the cost of Mitsuba's light transport: the whole time of an image of its own."""
        tracer, few = PathTracer(self.scene), replace(transport, samples=MEASURED_PATHS)
        found = cost(lambda: tracer.render(self.aperture, few), lambda: None, self.repeat)
        # Paths are independent of each other: the time is proportional to their number.
        share = transport.samples / MEASURED_PATHS
        bar.update(2)
        low, high = found.interval
        longer = replace(
            found,
            seconds=share * found.seconds,
            spread=share * found.spread,
            interval=(share * low, share * high),
        )
        return {"reference": longer}

    def _raster(self, rasterizer: Rasterizer, sampling: Sampling) -> Image:
        return lambda: rasterizer.render(self.aperture, self.settings, normals=False, sampling=sampling)

    def _trace(self, reference: Reference, sampling: Sampling) -> Image:
        return lambda: reference.trace(self.aperture, sampling)
