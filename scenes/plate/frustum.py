"""The crossed frustum's parameters: its film, its angles or its projection screen, its reach.

Formulas that make lines and matrices of them are written twice, in `reference.lines.lines` and
`raster.cameras.cameras`, and never here: a formula shared by both answers would hide its own mistake.
"""

import math
from dataclasses import dataclass

from xfrustum.scenes.arguments import one_of, real, reals, settle, wholes
from xfrustum.scenes.errors import InputError

#: Smallest half-extent of a film, as a slope. Neighboring lines of an image 1e4 pixels wide differ by 2e-4 of
#: it: at 1e-12 that is the rounding of a shear of order one in double precision.
SMALLEST_SLOPE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Screen:
    """A projection screen fixed to the plate's frame (paper, section 5), in scene units."""

    height: float  #: signed, above the plate, not zero; positive on the viewer's side
    center: tuple[float, float]  #: x, y
    size: tuple[float, float]  #: width, height

    def __post_init__(self) -> None:
        height, center, size = real(self.height), reals(self.center, 2), reals(self.size, 2)
        if not math.isfinite(height) or height == 0:
            raise InputError(
                f"frustum.screen.height must be finite and not zero, not {self.height!r}: "
                "a screen in the plate has no direction to shear to"
            )
        if not all(math.isfinite(c) for c in center):
            raise InputError(f"frustum.screen.center must be two finite coordinates, not {self.center!r}")
        if not all(math.isfinite(s) and s > 0 for s in size):
            raise InputError(f"frustum.screen.size must be two positive lengths, not {self.size!r}")
        least = 2 * abs(height) * SMALLEST_SLOPE
        if min(size) < least:
            raise InputError(
                f"frustum.screen.size must be at least {least:.3g} for a screen at height {height:.6g}, "
                f"not {list(size)}: no image resolves such angles"
            )
        settle(self, height=height, center=center, size=size)


@dataclass(frozen=True, kw_only=True)
class Frustum:
    """The crossed frustum of every aperture: centered (`fov`) or recentered (`screen`), one of the two."""

    resolution: tuple[int, int]  #: width and height of the hogel image in pixels
    reach: tuple[float, float]  #: up to which surfaces are imaged, toward the viewer and behind the plate
    fov: tuple[float, float] | None = None  #: full angles in x and y, radians
    screen: Screen | None = None

    def __post_init__(self) -> None:
        resolution, reach = wholes(self.resolution, 2), reals(self.reach, 2)
        if not all(n >= 1 for n in resolution):
            raise InputError(f"frustum.resolution must be two counts of at least 1, not {self.resolution!r}")
        if not all(math.isfinite(r) and r > 0 for r in reach):
            raise InputError(f"frustum.reach must be two positive lengths, not {self.reach!r}")
        if (self.fov is None) == (self.screen is None):
            raise InputError(
                "frustum needs either fov_deg or screen, and not both: fov_deg = [x, y] degrees "
                "centers it, screen = { height = .., center = [x, y], size = [w, h] } recenters it"
            )
        fov = None if self.fov is None else reals(self.fov, 2)
        if fov is not None and not all(0 < angle < math.pi for angle in fov):
            numbers = not any(map(math.isnan, fov))
            given = [math.degrees(angle) for angle in fov] if numbers else f"{self.fov!r} (in radians)"
            raise InputError(f"frustum.fov_deg must be two angles between 0 and 180 degrees, not {given}")
        if fov is not None and min(fov) < 2 * SMALLEST_SLOPE:
            raise InputError(
                f"frustum.fov_deg must be at least {math.degrees(2 * SMALLEST_SLOPE):.1e} degrees, "
                f"not {[math.degrees(angle) for angle in fov]}: no image resolves such angles"
            )
        if self.screen is not None:
            one_of(self.screen, Screen, "frustum.screen")
        settle(self, resolution=resolution, reach=reach, fov=fov)

    @property
    def recentered(self) -> bool:
        """Whether the frustum shears from aperture to aperture (paper, section 5)."""
        return self.screen is not None

    @property
    def longest_reach(self) -> float:
        """The larger reach of both sides, which is the reach where no side is named."""
        return max(self.reach)
