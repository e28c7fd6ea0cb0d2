"""Request of an error report: settings, apertures and options, and the grid of settings."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.scout import AutoApertures
from xfrustum.reference.alone import CERTIFIED
from xfrustum.scenes import (
    Aperture,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate.plate import Frustum

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Depth buffers of a report, the cheapest first: the first of equally good ones is recommended."""

DEFAULT_NEARS_PER_REACH = np.geomspace(1e-1, 1e-8, 25)

GEOMETRY = ("pivot", "fit", "offset", "slabs")
"""Fields of `DoubleFrustum` for the places of the cameras and the extents of their films."""


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """Settings, apertures and ways of measuring of a report; None is the default.

    Every combination of the nears, depth buffers and camera geometries is measured.
    """

    #: In scene units, each between 0 and the reach; None for `default_nears`.
    nears: Sequence[float] | None = None
    #: None for the middle one and, if the frustum is recentered, two corners. With those that
    #: `auto_apertures` chooses, the page has a map of the plate.
    apertures: Sequence[Aperture] | AutoApertures | None = None
    depths: Sequence[DepthBuffer] | None = None
    #: None for both of a recentered frustum where they differ; else the aperture.
    pivots: Sequence[Pivot] | None = None
    fits: Sequence[Fit | float] | None = None
    offsets: Sequence[Offset] | None = None
    slabs: Sequence[tuple[float, ...]] | None = None
    cull: Cull = Cull.NONE
    tracer: str = "embree"
    #: Effects that are simulated, as `--effects` takes them: `auto`, `all`, or names between
    #: commas.
    effects: str = "auto"
    #: Source of the truths: `certified`, or a tracer alone, of which nothing is examined.
    decided_by: str = CERTIFIED
    #: Predict errors, and charge wrong pixels to causes.
    causes: bool = True
    #: Model that explains rounding; None for the known model of the device at hand.
    device: DeviceModel | None = None
    #: Show a progress bar on standard error.
    progress: bool = False


def default_nears(frustum: Frustum) -> tuple[float, ...]:
    """Return 25 offsets in scene units, logarithmic, from 1e-1 to 1e-8 of the longest reach."""
    return tuple(float(share) * frustum.longest_reach for share in DEFAULT_NEARS_PER_REACH)


def settings_of(frustum: Frustum, options: ReportOptions) -> tuple[DoubleFrustum, ...]:
    """Return all settings of a report, geometry by geometry, all nears of a buffer in turn.

    InputError where settings make no sense for the frustum.
    """
    nears = tuple(dict.fromkeys(default_nears(frustum) if options.nears is None else options.nears))
    buffers = tuple(dict.fromkeys(DEFAULT_DEPTHS if options.depths is None else options.depths))
    grid = [
        replace(geometry, near=near, depth=depth, mapping=mapping, cull=options.cull)
        for geometry in geometry_grid(frustum, options)
        for depth, mapping in buffers
        for near in nears
        # Default nears beyond the first cut are omitted.
        if options.nears is not None or admits(geometry, near, frustum)
    ]
    for setting in grid:
        setting.check_against(frustum)
    return tuple(grid)


def geometry_grid(frustum: Frustum, options: ReportOptions) -> tuple[DoubleFrustum, ...]:
    """Return every combination of pivot, fit, offset and cuts; the cuts change fastest."""
    # A centered frustum has no shear. The own centers of cameras without an offset are the
    # aperture.
    both = frustum.recentered and options.pivots is None
    usual = tuple(Pivot) if both else (Pivot.APERTURE,)
    product = itertools.product(
        usual if options.pivots is None else options.pivots,
        (None,) if options.fits is None else options.fits,
        (Offset.PLATE,) if options.offsets is None else options.offsets,
        ((),) if options.slabs is None else options.slabs,
    )
    return geometries_of(
        DoubleFrustum(near=1.0, pivot=pivot, fit=fit, offset=offset, slabs=tuple(cuts))
        for pivot, fit, offset, cuts in product
        if not (both and pivot is Pivot.CAMERA and offset == Offset.NONE)
    )


def admits(geometry: DoubleFrustum, near: float, frustum: Frustum) -> bool:
    """Return whether a near lies before the first cut, required for cameras without an offset."""
    return geometry.offset is Offset.PLATE or near < min((*geometry.slabs, *frustum.reach))


def geometry_of(settings: DoubleFrustum) -> DoubleFrustum:
    """Return the camera geometry of settings: the same cameras with near 1 and default depth."""
    return DoubleFrustum(near=1.0, **{name: getattr(settings, name) for name in GEOMETRY})


def geometries_of(settings: Iterable[DoubleFrustum]) -> tuple[DoubleFrustum, ...]:
    """Return the camera geometries of some settings, in the order of their first occurrence."""
    return tuple(dict.fromkeys(map(geometry_of, settings)))
