"""The chain from the truth to the raster, one thing changed per link (docs/method.md, "The error budget")."""

from __future__ import annotations

from dataclasses import dataclass, replace

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum, Fit, Pivot
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture

LINKS = ("near offset", "pivot and fit", "slabs", "rasterization", "depth")
"""Name of what each link changes; link k leads from image k to image k + 1 of the chain."""

RASTERIZATION, DEPTH = 3, 4
"""Numbers of the links that round: every wrong pixel of theirs needs a cause."""

EXACT_DEPTH = (DepthFormat.D32F, DepthMapping.LINEAR)
"""The depth buffer without a depth problem: what it alone shows rightly is charged to depth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """The six images T0, T1, T2, T3, R0 and R1 of one aperture.

    Attributes
    ----------
    images
        T0 the true crossed frustum; T1 with the near offset; T2 with pivot and fit; T3 with slabs, all
        traced and certified; R0 rasterized with linear depth; R1 with the depth format and mapping.
    settings
        Settings of R1.
    subpixel_bits
        Subpixel bits of the device that drew R0 and R1.
    """

    images: tuple[HogelImage, HogelImage, HogelImage, HogelImage, HogelImage, HogelImage]
    settings: DoubleFrustum
    subpixel_bits: int


def traced_settings(
    settings: DoubleFrustum, frustum: Frustum
) -> tuple[DoubleFrustum, DoubleFrustum, DoubleFrustum]:
    """Return the settings of T1, T2 and T3: the near offset alone, then pivot and fit, then everything."""
    fit = settings.fitted_height(frustum)
    whole = replace(settings, slabs=(), fit=Fit.ANGLE if fit is None else fit)
    return replace(whole, pivot=Pivot.APERTURE, fit=Fit.ANGLE), whole, settings


def with_exact_depth(settings: DoubleFrustum) -> DoubleFrustum:
    """Return settings with `EXACT_DEPTH`, and all else as it is."""
    return replace(settings, depth=EXACT_DEPTH[0], mapping=EXACT_DEPTH[1])


def make_chain(
    reference: Reference, rasterizer: Rasterizer, aperture: Aperture, settings: DoubleFrustum
) -> Chain:
    """Trace and draw all images of the chain.

    Raises
    ------
    InputError
        The settings make no sense for the scene's frustum.
    """
    settings.check_against(reference.scene.frustum)
    traced = [
        reference.trace_model(aperture, link) for link in traced_settings(settings, reference.scene.frustum)
    ]
    links = (with_exact_depth(settings), settings)
    drawn = [rasterizer.render(aperture, link, normals=False) for link in links]
    return Chain(
        images=(reference.trace(aperture), traced[0], traced[1], traced[2], drawn[0], drawn[1]),
        settings=settings,
        subpixel_bits=int(rasterizer.device["subpixel_bits"]),
    )
