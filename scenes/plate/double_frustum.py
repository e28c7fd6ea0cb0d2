"""The settings of the paper's double frustum (section 4), with which rasterizers draw."""

import itertools
import math
from dataclasses import dataclass
from enum import StrEnum

from xfrustum.scenes.arguments import choice, real, reals, settle
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Frustum

#: Smallest near distance, in scene units: the smallest normal float32. Devices may round smaller
#: numbers to zero.
SMALLEST_NEAR = 2.0**-126


class DepthFormat(StrEnum):
    """Storage of the depth buffer."""

    D16 = "d16"
    D24 = "d24"
    D32F = "d32f"


class DepthMapping(StrEnum):
    """Function from distance w, between near n and far f, to stored depth.

    `STANDARD` is hyperbolic, from 0 at near to 1 at far. `GL` is the same with clip depth -1..1,
    and `REVERSED` is from 1 to 0. `LOGARITHMIC` is ln(w/n)/ln(f/n), and `LINEAR` is
    (w - n)/(f - n); both are written by the fragment shader.
    """

    STANDARD = "standard"
    GL = "gl"
    REVERSED = "reversed"
    LOGARITHMIC = "logarithmic"
    LINEAR = "linear"


class Pivot(StrEnum):
    """Center of the shear of a recentered frustum: the aperture (paper), or each camera."""

    APERTURE = "aperture"
    CAMERA = "camera"


class Offset(StrEnum):
    """Offset of the cameras, so that near planes meet at the plate (paper), or none."""

    PLATE = "plate"
    NONE = "none"


class Fit(StrEnum):
    """Angles of the offset cameras: equal to the frustum's, or exact on the screen."""

    ANGLE = "angle"
    SCREEN = "screen"


class Camera(StrEnum):
    """The cameras that draw: both, or only one (paper, figure 7)."""

    BOTH = "both"
    C = "c"
    C_STAR = "c-star"


class Cull(StrEnum):
    """Omitted faces: none, or faces turned away from the viewer, for both cameras.

    `BACK` changes no picture of closed bodies that lie off the plate and within the reach (paper,
    section 3).
    """

    NONE = "none"
    BACK = "back"


@dataclass(frozen=True, kw_only=True)
class DoubleFrustum:
    """Settings of the two cameras C and C*; names may be strings, such as `depth="d24"`.

    Raises InputError for an unknown name, or for a length that is not positive and finite.
    """

    #: Near distance n > 0, scene units: distance of the near planes from the cameras, and offset of
    #: both cameras if `offset` is `plate`.
    near: float
    depth: DepthFormat = DepthFormat.D24
    mapping: DepthMapping = DepthMapping.STANDARD
    camera: Camera = Camera.BOTH
    pivot: Pivot = Pivot.APERTURE
    offset: Offset = Offset.PLATE
    #: A `Fit`, or the height |z| of the two planes that are drawn without displacement. None
    #: selects the far end of the first slab if there are slabs, else the angle.
    fit: Fit | float | None = None
    #: Heights |z| at which both frusta are cut, ascending. Every slab except the first has its own
    #: near plane, and cameras exactly at the aperture; `fit` and `offset` apply to the first.
    slabs: tuple[float, ...] = ()
    cull: Cull = Cull.NONE

    def __post_init__(self) -> None:
        near, slabs = real(self.near), reals(self.slabs)
        if not (math.isfinite(near) and near > 0):
            raise InputError(f"near must be a positive length, not {self.near!r}")
        if near < SMALLEST_NEAR:
            raise InputError(
                f"near must be at least {SMALLEST_NEAR:.3g}, as matrices have 32 bits, "
                f"not {self.near}"
            )
        if not all(low < high for low, high in itertools.pairwise((0.0, *slabs, math.inf))):
            raise InputError(
                f"slabs must be positive heights in ascending order, not {self.slabs!r}"
            )
        fit: Fit | float | None = None
        if isinstance(self.fit, str) and self.fit in list(Fit):
            fit = Fit(self.fit)
        elif self.fit is not None:
            fit = real(self.fit)
            if not (math.isfinite(fit) and fit > 0):
                raise InputError(
                    f"fit must be angle, screen, or a positive height, not {self.fit!r}"
                )
        settle(self, near=near, slabs=slabs, fit=fit)
        kinds = {"depth": DepthFormat, "mapping": DepthMapping, "camera": Camera}
        for name, kind in (kinds | {"pivot": Pivot, "offset": Offset, "cull": Cull}).items():
            settle(self, **{name: choice(kind, getattr(self, name), name)})

    def check_against(self, frustum: Frustum) -> None:
        """Raise InputError if these settings are invalid for a frustum."""
        if not self.near < frustum.longest_reach:
            raise InputError(
                f"near {self.near} must be smaller than the reach, {frustum.longest_reach}; "
                "it is the distance that both cameras step back from the plate"
            )
        if self.slabs and not self.slabs[-1] < frustum.longest_reach:
            raise InputError(
                f"slabs must lie within the reach, {frustum.longest_reach}, not at {self.slabs[-1]}"
            )
        if self.fit is Fit.SCREEN and frustum.screen is None:
            raise InputError("fit screen needs a recentered frustum; give a height instead")
        first = min((*self.slabs, *frustum.reach))
        if self.offset is Offset.NONE and not self.near < first:
            raise InputError(
                f"near {self.near} without an offset must be smaller than {first}: it clips nearer "
                "surfaces"
            )

    def fitted_height(self, frustum: Frustum) -> float | None:
        """Return the height |z| that the first slab draws exactly; None to keep the angle."""
        if self.fit is Fit.SCREEN and frustum.screen is not None:
            return abs(frustum.screen.height)
        if self.fit is None and self.slabs:
            return self.slabs[0]
        return None if self.fit is None or isinstance(self.fit, Fit) else self.fit

    def sections(self, reach: float) -> tuple[tuple[float, float], ...]:
        """Return the two heights |z| between which each slab of one side lies, innermost first."""
        cuts = (0.0, *(height for height in self.slabs if height < reach), reach)
        return tuple(itertools.pairwise(cuts))

    @property
    def depth_label(self) -> str:
        """Format and mapping for reports, such as `D24 standard`."""
        return f"{self.depth.upper()} {self.mapping}"
