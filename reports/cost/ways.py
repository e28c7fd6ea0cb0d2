"""The configurations whose cost is measured: near, depth, mapping, slabs, samples, effects, tracers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.trade_off.trade_off import certified, near_label
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
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
"""One, two and three cuts in about geometric progression, as planners place them.

See docs/method.md, "Splitting".
"""
NEARS_PER_CUT = (1e-1, 1e-2)
USUAL_NEAR_PER_REACH = 1e-3
"""Where samples and effects are measured, whose cost does not depend on near."""


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """One configuration, ready to make its picture.

    Attributes
    ----------
    renderer, label, configuration
        As in `Option`.
    picture
        Makes it.
    rasterizer
        Who draws it, where somebody does.
    """

    renderer: str
    label: str
    configuration: dict[str, Any]
    picture: Callable[[], HogelImage]
    rasterizer: Rasterizer | None = None


def drawn(scene: Scene, aperture: Aperture, drawers: dict[str, Rasterizer]) -> Iterator[Contestant]:
    """Yield near planes with depth buffers and mappings, slabs, samples of the aperture, effects."""
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
) -> Contestant:
    label = near_label(settings.near, scene.units, scene.frustum.longest_reach, settings.depth_label)
    if settings.slabs:
        label += f" and cuts at {', '.join(digits(cut) for cut in settings.slabs)}"
    if sampling.aperture > 1:
        label += f", {sampling.aperture} aperture samples"
    if family == "all effects":
        label += ", all effects"
    return Contestant(
        renderer="raster",
        label=label,
        configuration={
            "family": family or settings.depth_label,
            "near": settings.near,
            "depth": settings.depth,
            "mapping": settings.mapping,
            "slabs": settings.slabs,
            "aperture_samples": sampling.aperture,
            "effects": sorted(drawer.effects, key=list(Effect).index),
        },
        picture=lambda: drawer.render(aperture, settings, normals=False, sampling=sampling),
        rasterizer=drawer,
    )


def traced(aperture: Aperture, tracers: dict[str, Reference]) -> Iterator[Contestant]:
    """Yield each tracer alone, and the truth that is certified."""
    for name, reference in tracers.items():

        def picture(reference: Reference = reference) -> HogelImage:
            return reference.propose(aperture)

        label = f"{name} alone, float32, nothing proven"
        yield Contestant(renderer=name, label=label, configuration={"family": name}, picture=picture)
    truth = certified(Timing.of([0.0]))
    yield Contestant(
        renderer=truth.renderer,
        label=truth.label,
        configuration={**truth.configuration, "family": "certified truth"},
        picture=lambda: tracers["embree"].trace(aperture),
    )
