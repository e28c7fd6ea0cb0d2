"""Chain from the truth to the raster, one change per link (docs/method.md, "The error budget")."""

from dataclasses import dataclass, replace
from functools import lru_cache

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.plate import (
    Aperture,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Frustum,
    Pivot,
)
from xfrustum.scenes.representation import ShortRepr

#: Change of each link; link k leads from image k to image k + 1 of the chain.
LINKS = ("near offset", "pivot", "fit", "slabs", "rasterization", "depth")

PIVOT = 1  #: index of the link that moves the center of the shear
RASTERIZATION = (
    #: index in `LINKS` of the first of the two links with rounding; wrong pixels of these links are
    #: classified by cause
    4
)
#: link between slabs and rasterization, in chains whose settings cull faces
CULLING = "culling"

#: Depth buffer practically without errors: pixels that only it gets right are charged to depth.
EXACT_DEPTH = (DepthFormat.D32F, DepthMapping.LINEAR)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Chain(ShortRepr):
    """T0, T1, T2, T3, T4, R0 and R1 of one aperture; with culling T5 between T4 and R0.

    T0 is the true crossed frustum. T1 adds the near offset, T2 the pivot, T3 the fit, T4 the slabs,
    and T5 omits culled faces. All of these are traced and certified. R0 is rasterized with linear
    depth, R1 with the depth buffer of the settings.
    """

    images: tuple[HogelImage, ...]
    settings: DoubleFrustum
    device: DeviceModel  #: model of the device that drew R0 and R1


# All hogels of a plate have the same settings.
@lru_cache
def traced_settings(settings: DoubleFrustum, frustum: Frustum) -> tuple[DoubleFrustum, ...]:
    """Return the settings of T1 to T4, and of T5 with culling; each adds one change."""
    # The default fit is replaced by its explicit equivalent, so that settings without a change
    # compare equal.
    settings = replace(settings, fit=settings.fitted_height(frustum) or Fit.ANGLE)
    drawn = replace(settings, cull=Cull.NONE)
    whole = replace(drawn, slabs=())
    sheared = replace(whole, fit=Fit.ANGLE)
    unculled = replace(sheared, pivot=Pivot.APERTURE), sheared, whole, drawn
    return unculled if settings.cull is Cull.NONE else (*unculled, settings)


def links_of(settings: DoubleFrustum) -> tuple[str, ...]:
    """Return the names of a chain's links: `LINKS`, with `CULLING` where faces are culled."""
    if settings.cull is Cull.NONE:
        return LINKS
    return (*LINKS[:RASTERIZATION], CULLING, *LINKS[RASTERIZATION:])


@lru_cache
def with_exact_depth(settings: DoubleFrustum) -> DoubleFrustum:
    """Return settings with `EXACT_DEPTH` and everything else unchanged."""
    return replace(settings, depth=EXACT_DEPTH[0], mapping=EXACT_DEPTH[1])


def traced_models(
    reference: Reference,
    aperture: Aperture,
    settings: DoubleFrustum,
    traced: dict[DoubleFrustum, HogelImage] | None = None,
    *,
    shaded: bool = True,
) -> tuple[HogelImage, ...]:
    """Return T1 to T4, and T5 with culling; `traced` caches models of this aperture by settings."""
    traced = {} if traced is None else traced
    links = [with_exact_depth(link) for link in traced_settings(settings, reference.scene.frustum)]
    for link in links:
        if link not in traced:
            traced[link] = reference.trace_model(aperture, link, shaded=shaded)
    return tuple(traced[link] for link in links)


def make_chain(
    reference: Reference, rasterizer: Rasterizer, aperture: Aperture, settings: DoubleFrustum
) -> Chain:
    """Trace and draw all images of the chain; invalid settings raise InputError."""
    settings.check_against(reference.scene.frustum)
    traced = traced_models(reference, aperture, settings)
    links = (with_exact_depth(settings), settings)
    drawn = [rasterizer.render(aperture, link, normals=False) for link in links]
    return Chain(
        images=(reference.trace(aperture), *traced, *drawn),
        settings=settings,
        device=rasterizer.model,
    )
