"""The configurations whose cost is measured: near, depth, slabs, offset, samples, effects, tracers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from xfrustum.raster import Drawn, Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.cost.trade_off import Option
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import digits
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum, Offset
from xfrustum.scenes.plate.plate import Aperture

NEARS_PER_REACH = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6)
DEPTHS = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
    (DepthFormat.D24, DepthMapping.LINEAR),
)
CUTS_PER_REACH = ((0.1,), (0.03, 0.2), (0.01, 0.05, 0.25))
"""Heights of one, two and three cuts in about geometric progression, as planners place them.

See docs/method.md, "Splitting".
"""
NEARS_PER_CUT = (1e-1, 1e-2)
NEARS_WITHOUT_OFFSET_PER_REACH = (1e-2, 1e-3, 1e-4, 1e-5)
"""Near planes of cameras that stay in the aperture, over the shorter reach: they displace nothing, and
leave a gap of near on both sides of the plate. Their depth buffer is D32F reversed, which needs no
large near."""
USUAL_NEAR_PER_REACH = 1e-3
"""Near plane at which samples and effects are measured: their cost does not depend on it."""


class Way:
    """One way to make a picture, and the seconds of the pictures that were made.

    Parameters
    ----------
    renderer, label, family, configuration
        Renderer and configuration, in words and values; see `trade_off.Option`.
    """

    def __init__(
        self,
        renderer: str,
        label: str,
        family: str,
        configuration: Mapping[str, Any],
        make: Callable[[], HogelImage | Drawn],
    ) -> None:
        self.renderer, self.label, self.family = renderer, label, family
        self._configuration, self._make = {"family": family, **configuration}, make
        self._seconds: dict[str, list[float]] = {"time": [], "gpu": [], "read": []}

    def picture(self) -> HogelImage:
        """Make the picture, which is not timed."""
        made = self._make()
        return made.image if isinstance(made, Drawn) else made

    def take_time(self) -> None:
        """Make the picture, and note what it and its stages took."""
        begun = time.perf_counter()
        made = self._make()
        self._seconds["time"].append(time.perf_counter() - begun)
        if isinstance(made, Drawn):
            self._seconds["gpu"].append(made.times["draw"].gpu_s)
            self._seconds["read"].append(made.times["read"].wall_s)

    def option(self, displacement_p99_px: float, surface_fraction: float) -> Option:
        """Return the way with its error and the times of its pictures."""
        timings = {name: Timing.of(taken) if taken else None for name, taken in self._seconds.items()}
        assert timings["time"] is not None, "a way is timed before it is an option"
        return Option(
            renderer=self.renderer,
            label=self.label,
            family=self.family,
            configuration=self._configuration,
            displacement_p99_px=displacement_p99_px,
            surface_fraction=surface_fraction,
            time_s=timings["time"],
            gpu_s=timings["gpu"],
            read_s=timings["read"],
        )


def drawn(scene: Scene, aperture: Aperture, drawers: dict[str, Rasterizer]) -> Iterator[Way]:
    """Yield nears with depth buffers and mappings, slabs, cameras without an offset, samples, effects."""
    reach, usual = scene.frustum.longest_reach, USUAL_NEAR_PER_REACH * scene.frustum.longest_reach
    once = replace(scene.sampling, aperture=1)
    for depth, mapping in DEPTHS:
        for share in NEARS_PER_REACH:
            settings = DoubleFrustum(near=share * reach, depth=depth, mapping=mapping)
            yield _raster(scene, aperture, drawers["auto"], settings, once)
    for cuts in CUTS_PER_REACH:
        for share in NEARS_PER_CUT:
            slabs = tuple(cut * reach for cut in cuts)
            settings = DoubleFrustum(near=share * slabs[0], slabs=slabs)
            yield _raster(scene, aperture, drawers["auto"], settings, once, family=f"{len(cuts) + 1} slabs")
    for share in NEARS_WITHOUT_OFFSET_PER_REACH:
        settings = DoubleFrustum(
            near=share * min(scene.frustum.reach),
            depth=DepthFormat.D32F,
            mapping=DepthMapping.REVERSED,
            offset=Offset.NONE,
        )
        yield _raster(scene, aperture, drawers["auto"], settings, once, family="no offset")
    samples = scene.sampling.aperture
    for count in sorted({2, samples} if samples > 1 else ()):
        sampling = replace(once, aperture=count)
        settings = DoubleFrustum(near=usual)
        yield _raster(scene, aperture, drawers["auto"], settings, sampling, family="aperture samples")
    if "all" in drawers:
        settings = DoubleFrustum(near=usual)
        yield _raster(scene, aperture, drawers["all"], settings, once, family="all effects")


def _raster(
    scene: Scene,
    aperture: Aperture,
    drawer: Rasterizer,
    settings: DoubleFrustum,
    sampling: Sampling,
    family: str | None = None,
) -> Way:
    reach, units = scene.frustum.longest_reach, scene.units
    label = (
        f"raster, near {digits(settings.near)} {units} ({digits(settings.near / reach)} of the reach) "
        f"with {settings.depth_label} depth"
    )
    if settings.slabs:
        label += f" and cuts at {', '.join(digits(cut) for cut in settings.slabs)}"
    if settings.offset is Offset.NONE:
        label += " and no offset, which leaves a gap at the plate"
    if sampling.aperture > 1:
        label += f", {sampling.aperture} aperture samples"
    if family == "all effects":
        label += ", all effects"
    configuration = {
        "near": settings.near,
        "depth": settings.depth,
        "mapping": settings.mapping,
        "slabs": settings.slabs,
        "offset": settings.offset,
        "aperture_samples": sampling.aperture,
        "effects": sorted(drawer.effects_for(settings), key=list(Effect).index),
    }

    def draw() -> Drawn:
        return drawer.draw(aperture, settings, normals=False, sampling=sampling)

    return Way("raster", label, family or settings.depth_label, configuration, draw)


def traced(aperture: Aperture, tracers: Mapping[str, Reference]) -> Iterator[Way]:
    """Yield each tracer alone, and the certified truth."""
    for name, reference in tracers.items():
        yield Way(
            name, f"{name} alone, float32, nothing proven", name, {}, partial(reference.propose, aperture)
        )
    words, truth = "certified truth", partial(tracers["embree"].trace, aperture)
    yield Way("certified", f"the {words}", words, {"certified": True}, truth)
