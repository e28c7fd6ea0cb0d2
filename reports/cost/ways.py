"""The configurations whose cost is measured: near, depth, slabs, offset, samples, effects, tracers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from xfrustum.raster import Drawn, Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.cost.trade_off import Option
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


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way to make a picture, and the seconds of the pictures that were made; see `trade_off.Option`."""

    renderer: str
    label: str
    family: str
    make: Callable[[], HogelImage | Drawn]
    configuration: Mapping[str, Any] = field(default_factory=dict)
    #: By name: seconds of whole pictures, and of drawing and reading back.
    seconds: dict[str, list[float]] = field(default_factory=lambda: {"time_s": [], "gpu_s": [], "read_s": []})

    def picture(self) -> HogelImage:
        """Make the picture, which is not timed."""
        made = self.make()
        return made.image if isinstance(made, Drawn) else made

    def take_time(self) -> None:
        """Make the picture, and note what it and its stages took."""
        begun = time.perf_counter()
        made = self.make()
        self.seconds["time_s"].append(time.perf_counter() - begun)
        if isinstance(made, Drawn):
            self.seconds["gpu_s"].append(made.times["draw"].gpu_s)
            self.seconds["read_s"].append(made.times["read"].wall_s)

    def option(self, displacement_p99_px: float, surface_fraction: float) -> Option:
        """Return the way, which was timed at least once, with its error and the times of its pictures."""
        return Option(
            renderer=self.renderer,
            label=self.label,
            family=self.family,
            configuration={"family": self.family, **self.configuration},
            displacement_p99_px=displacement_p99_px,
            surface_fraction=surface_fraction,
            **{name: Timing.of(taken) for name, taken in self.seconds.items() if taken},
        )


def drawn(scene: Scene, aperture: Aperture, drawers: dict[str, Rasterizer]) -> Iterator[Way]:
    """Yield nears with depth buffers and mappings, slabs, cameras without an offset, samples, effects."""
    reach, raster = scene.frustum.longest_reach, partial(_raster, scene, aperture, drawers["auto"])
    usual = DoubleFrustum(near=USUAL_NEAR_PER_REACH * reach)
    for depth, mapping in DEPTHS:
        for share in NEARS_PER_REACH:
            yield raster(DoubleFrustum(near=share * reach, depth=depth, mapping=mapping))
    for cuts in CUTS_PER_REACH:
        for share in NEARS_PER_CUT:
            slabs = tuple(cut * reach for cut in cuts)
            yield raster(DoubleFrustum(near=share * slabs[0], slabs=slabs), family=f"{len(cuts) + 1} slabs")
    stays = replace(usual, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED, offset=Offset.NONE)
    for share in NEARS_WITHOUT_OFFSET_PER_REACH:
        yield raster(replace(stays, near=share * min(scene.frustum.reach)), family="no offset")
    samples = scene.sampling.aperture
    for count in sorted({2, samples} if samples > 1 else ()):
        yield raster(usual, count, family="aperture samples")
    if "all" in drawers:
        yield _raster(scene, aperture, drawers["all"], usual, family="all effects")


def _raster(
    scene: Scene,
    aperture: Aperture,
    drawer: Rasterizer,
    settings: DoubleFrustum,
    samples: int = 1,
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
    if samples > 1:
        label += f", {samples} aperture samples"
    if family == "all effects":
        label += ", all effects"
    configuration = {
        "near": settings.near,
        "depth": settings.depth,
        "mapping": settings.mapping,
        "slabs": settings.slabs,
        "offset": settings.offset,
        "aperture_samples": samples,
        "effects": sorted(drawer.effects_for(settings), key=list(Effect).index),
    }
    return Way(
        renderer="raster",
        label=label,
        family=family or settings.depth_label,
        configuration=configuration,
        make=partial(
            drawer.draw, aperture, settings, normals=False, sampling=replace(scene.sampling, aperture=samples)
        ),
    )


def traced(aperture: Aperture, tracers: Mapping[str, Reference]) -> Iterator[Way]:
    """Yield each tracer alone, and the certified truth."""
    for name, reference in tracers.items():
        label = f"{name} alone, float32, nothing proven"
        yield Way(renderer=name, label=label, family=name, make=partial(reference.propose, aperture))
    yield Way(
        renderer="certified",
        label="the certified truth",
        family="certified truth",
        configuration={"certified": True},
        make=partial(tracers["embree"].trace, aperture),
    )
