"""The configurations whose cost is measured: near, depth, slabs, offset, samples, effects, tracers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from xfrustum.raster import Drawn, Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.trade_off.trade_off import CertifiedConfiguration, Configuration, certified, near_label
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
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
class DrawnConfiguration(Configuration):
    """A picture of the rasterizer: its settings, samples of the aperture, and effects."""

    family: str
    near: float
    depth: DepthFormat
    mapping: DepthMapping
    slabs: tuple[float, ...]
    offset: Offset
    aperture_samples: int
    effects: tuple[Effect, ...]


@dataclass(frozen=True, kw_only=True)
class TracedConfiguration(Configuration):
    """A picture of a tracer alone, by its name."""

    family: str


@dataclass(frozen=True, kw_only=True)
class CertifiedFamily(CertifiedConfiguration):
    """The certified truth, with the name of its family."""

    family: str


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way to make a picture, ready to make it.

    Attributes
    ----------
    renderer, label, family, configuration
        Renderer and configuration, in words and values; see `trade_off.Option`.
    picture
        Function that makes the picture.
    draw
        Function that draws the picture and returns the times of its stages besides; None where it is traced.
    """

    renderer: str
    label: str
    family: str
    configuration: Configuration
    picture: Callable[[], HogelImage]
    draw: Callable[[], Drawn] | None = None


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
    label = near_label(settings.near, scene.units, scene.frustum.longest_reach, settings.depth_label)
    if settings.slabs:
        label += f" and cuts at {', '.join(digits(cut) for cut in settings.slabs)}"
    if settings.offset is Offset.NONE:
        label += " and no offset, which leaves a gap at the plate"
    if sampling.aperture > 1:
        label += f", {sampling.aperture} aperture samples"
    if family == "all effects":
        label += ", all effects"

    def draw() -> Drawn:
        return drawer.draw(aperture, settings, normals=False, sampling=sampling)

    family = family or settings.depth_label
    return Way(
        renderer="raster",
        label=label,
        family=family,
        configuration=DrawnConfiguration(
            family=family,
            near=settings.near,
            depth=settings.depth,
            mapping=settings.mapping,
            slabs=settings.slabs,
            offset=settings.offset,
            aperture_samples=sampling.aperture,
            effects=tuple(sorted(drawer.effects_for(settings), key=list(Effect).index)),
        ),
        picture=lambda: draw().image,
        draw=draw,
    )


def traced(aperture: Aperture, tracers: dict[str, Reference]) -> Iterator[Way]:
    """Yield each tracer alone, and the certified truth."""
    for name, reference in tracers.items():

        def picture(reference: Reference = reference) -> HogelImage:
            return reference.propose(aperture)

        label = f"{name} alone, float32, nothing proven"
        yield Way(
            renderer=name,
            label=label,
            family=name,
            configuration=TracedConfiguration(family=name),
            picture=picture,
        )
    truth = certified(Timing.of([0.0]))
    yield Way(
        renderer=truth.renderer,
        label=truth.label,
        family="certified truth",
        configuration=CertifiedFamily(family="certified truth"),
        picture=lambda: tracers["embree"].trace(aperture),
    )
