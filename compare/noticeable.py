"""Effects of a near offset and of a depth buffer that an eye notices, in closed form.

By the theorem of docs/method.md, "The near offset as a viewer perceives it", all lines on which
hogels replay one drawn surface point P cross in one point, P + m (kx, ky, -1) behind the plate and
P - m (kx, ky, -1) before it, at the distance D = |z| + m from the plate:

    D = (|z| + n) zf / (zf + n),   without a fit D = |z| + n,   beyond the first slab D = |z|.

All eyes lie straight in front of the middle of the plate, at the distance L. Content at the height
z is at the distance R = L - z from them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from xfrustum.compare.eye_loss import ARCMIN_PER_RADIAN
from xfrustum.reference.lines import film_window
from xfrustum.scenes.arguments import InputError, real, settle
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DoubleFrustum, Frustum, Offset, Pivot


def replayed_distance(distance: Floats, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return the distance D from the plate at which points at |z| are seen, scene units.

    A point at the first cut belongs to the first slab.
    """
    distance = np.asarray(distance, dtype=np.float64)
    if settings.offset is Offset.NONE:
        return distance
    moved = distance + settings.near
    fitted = settings.fitted_height(frustum)
    if fitted is not None:
        moved = moved * (fitted / (fitted + settings.near))
    return np.where(_in_first_slab(distance, settings), moved, distance)


def _in_first_slab(distance: Floats, settings: DoubleFrustum) -> Mask:
    return distance <= (settings.slabs[0] if settings.slabs else np.inf)


def replayed_shifts(
    distance: Floats, frustum: Frustum, settings: DoubleFrustum
) -> tuple[Floats, Floats]:
    """Return m, the displacement away from the plate, and c, the lateral shift per shear."""
    moved = replayed_distance(distance, frustum, settings) - distance
    if settings.pivot is Pivot.CAMERA and settings.offset is Offset.PLATE:
        # The shear about the camera's own center draws points of the first slab a further k n
        # aside.
        return moved, np.where(_in_first_slab(distance, settings), moved - settings.near, moved)
    return moved, moved


def moves_rigidly(frustum: Frustum, settings: DoubleFrustum) -> bool:
    """Return whether all apertures replay a surface point at the same place."""
    straight = settings.pivot is Pivot.CAMERA and settings.fitted_height(frustum) is None
    return not frustum.recentered or straight or settings.offset is Offset.NONE


#: Acuity of a good eye, arc minutes; stereo acuity of an ordinary observer, arc seconds (the best
#: have a tenth of it); distance of two eyes, mm
#: (docs/noticeable.md, "The viewer")
ACUITY_ARCMIN, STEREO_ACUITY_ARCSEC, EYES_APART_MM = 1.0, 20.0, 65.0

#: Length of each known unit, mm
MILLIMETERS = {"um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}

GREEN_MM = 550e-6  #: a wavelength to which eyes are most sensitive

ARCSEC_PER_RADIAN = 60 * ARCMIN_PER_RADIAN

#: Number of depths per side at which disparity is evaluated: it changes smoothly
DEPTH_SAMPLES = 33


def scene_length(length: tuple[float, str | None], scene: Scene) -> float:
    """Convert a length, given as number and unit (None: the scene's unit), to scene units."""
    return length_in(length, scene.units, scene.name)


def length_in(length: tuple[float, str | None], units: str, name: str) -> float:
    """Return a length in the scene's units; InputError with its name for unknown units."""
    value, unit = length
    if unit is None or unit == units:
        return value
    known = ", ".join(MILLIMETERS)
    if unit not in MILLIMETERS:
        raise InputError(f"{value:g}{unit} has a unit that is not known; known are {known}")
    if units not in MILLIMETERS:
        raise InputError(
            f"{name}: how long is one of its {units}? Give {value:g} in {units}, without a "
            f"unit, or a unit that is known to the scene: {known}"
        )
    return value * MILLIMETERS[unit] / MILLIMETERS[units]


@dataclass(frozen=True, kw_only=True)
class Viewer:
    """A pair of eyes straight in front of the plate, at a distance from it in scene units.

    InputError if a number is not positive and finite.
    """

    distance: float
    acuity_arcmin: float = ACUITY_ARCMIN
    stereo_acuity_arcsec: float = STEREO_ACUITY_ARCSEC
    eyes_apart_mm: float = EYES_APART_MM
    #: diameter
    pupil_mm: float = 4.0

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = real(getattr(self, name))
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"a viewer's {name} must be positive, not {getattr(self, name)!r}")
            settle(self, **{name: value})


@dataclass(frozen=True, kw_only=True)
class Display:
    """Properties of a plate that limit its sharpness, on the coarser axis."""

    frustum: Frustum
    #: size of the plate, scene units
    size: tuple[float, float]
    #: pitch of the hogels, scene units
    pitch: float
    #: slope between the directions of neighboring pixels of a hogel
    pixel: float
    #: wavelength over pitch; 0 where the length of the scene's unit is not known
    diffraction: float
    #: length of the scene's unit; None if it is not known
    millimeters: float | None

    @classmethod
    def from_scene(cls, scene: Scene) -> Display:
        """Return the display of a scene."""
        _, half_extent = film_window(scene.frustum, scene.plate.middle)
        pitches = [
            size / count for size, count in zip(scene.plate.size, scene.plate.hogels, strict=True)
        ]
        unit = MILLIMETERS.get(scene.units)
        return cls(
            frustum=scene.frustum,
            size=scene.plate.size,
            pitch=max(pitches),
            pixel=max(
                2 * t / count
                for t, count in zip(half_extent, scene.frustum.resolution, strict=True)
            ),
            diffraction=0.0 if unit is None else GREEN_MM / unit / min(pitches),
            millimeters=unit,
        )


@dataclass(frozen=True, kw_only=True)
class DisplayLimits:
    """Limits of a display for a viewer; lengths in scene units.

    Values that depend on the length of the scene's unit are None if it is unknown.
    """

    viewer: Viewer
    #: angle between a hogel's neighboring pixels; a viewer sees |z|/R of it at the height z
    pixel_arcmin: float
    #: angle under which a hogel is seen
    pitch_arcmin: float
    #: diffraction limit of a hogel
    diffraction_arcmin: float | None
    #: Depths of field: largest distances from the plate up to which pixels do not limit the
    #: resolution, but the pitch of the hogels or the viewer's acuity does; may be infinite
    behind: float
    before: float
    #: pixels of a hogel that a pupil catches along an axis
    rays_per_pupil: float | None


def display_limits(scene: Scene, viewer: Viewer) -> DisplayLimits:
    """Return the limits of a scene's display for a viewer."""
    display, distance = Display.from_scene(scene), viewer.distance
    pixel, unit = display.pixel, display.millimeters
    # The coarser of the display and the eye limits the visible angle.
    finest = max(display.pitch / distance, viewer.acuity_arcmin / ARCMIN_PER_RADIAN)
    return DisplayLimits(
        viewer=viewer,
        pixel_arcmin=pixel * ARCMIN_PER_RADIAN,
        pitch_arcmin=display.pitch / distance * ARCMIN_PER_RADIAN,
        diffraction_arcmin=None if unit is None else display.diffraction * ARCMIN_PER_RADIAN,
        behind=distance * finest / (pixel - finest) if pixel > finest else math.inf,
        before=distance * finest / (pixel + finest),
        rays_per_pupil=None if unit is None else viewer.pupil_mm / unit / (distance * pixel),
    )


def gap_slope(display: Display, distance: float, aside: float = 1.0) -> float:
    """Return the lateral gap of a surface's halves at the plate, per displacement in depth.

    If the halves are displaced by 1 in depth and laterally by c k, the gap seen along a ray of
    slope m through an aperture of shear k is 2 |c k - m|. The vector c k - m is linear over the
    plate, and therefore longest at a corner of the plate. `aside` is c: 1 with pivot `aperture`, 0
    with pivot `camera`.
    """
    corners = np.array([(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * display.size
    screen = display.frustum.screen
    shears = (
        0.0 * corners if screen is None else (np.array(screen.center) - corners) / -screen.height
    )
    return float(np.linalg.norm(aside * shears - corners / distance, axis=1).max())


@dataclass(frozen=True, kw_only=True)
class Content:
    """Depths of a plate's content: nearest and farthest |z| on each side, None on an empty side."""

    before: tuple[float, float] | None
    behind: tuple[float, float] | None
    #: whether a surface intersects the plate
    through: bool

    @property
    def heights(self) -> Floats:
        """Heights z between the ends of both sides, scene units, the farthest of a side last."""
        sides = ((1.0, self.before), (-1.0, self.behind))
        parts = [
            sign * np.linspace(*ends, DEPTH_SAMPLES) for sign, ends in sides if ends is not None
        ]
        return np.concatenate([np.zeros(0), *parts])

    @property
    def farthest(self) -> tuple[float, ...]:
        """Heights z of the farthest surfaces on each side, scene units."""
        return tuple(self.heights[DEPTH_SAMPLES - 1 :: DEPTH_SAMPLES].tolist())


def runs_through_plate(scene: Scene) -> bool:
    """Return whether any triangle crosses or touches the plate within its border."""
    lowest, highest = scene.height_ranges
    corners = scene.triangles[(lowest <= 0) & (highest >= 0)]
    half = np.array(scene.plate.size) / 2
    inside = (corners[..., :2].min(axis=1) <= half) & (corners[..., :2].max(axis=1) >= -half)
    return bool(inside.all(axis=1).any())


def surface_content(scene: Scene) -> Content:
    """Return the depths of all surfaces within the reach, hidden or not: an upper bound."""
    lowest, highest = scene.height_ranges
    sides: list[tuple[float, float] | None] = []
    for low, high, reach in zip(
        (lowest, -highest), (highest, -lowest), scene.frustum.reach, strict=True
    ):
        within = (high >= 0) & (low <= reach)
        ends = np.clip(low[within], 0, reach), np.clip(high[within], 0, reach)
        sides.append((float(ends[0].min()), float(ends[1].max())) if within.any() else None)
    return Content(before=sides[0], behind=sides[1], through=runs_through_plate(scene))


def require_before_viewer(scene: Scene, content: Content, viewer: Viewer) -> None:
    """Raise an InputError if a plate shows surfaces behind a viewer."""
    if content.before is not None and content.before[1] >= viewer.distance:
        raise InputError(
            f"{scene.name} shows something {content.before[1]:.3g} {scene.units} before the "
            f"plate, behind a viewer at {viewer.distance:g}; choose a larger distance"
        )


def eyes_apart(viewer: Viewer, display: Display) -> float:
    """Return the distance of a viewer's eyes, scene units; InputError if it is not known."""
    if display.millimeters is None:
        raise InputError(
            "what two eyes see depends on their distance: name the scene's units, one of "
            f"{', '.join(MILLIMETERS)}"
        )
    return viewer.eyes_apart_mm / display.millimeters


def disparity_changes(
    height: Floats, viewer: Viewer, display: Display, settings: DoubleFrustum
) -> Floats:
    """Return the changes of disparity of points at some heights, arc seconds, < 0 if farther.

    The heights z are below the viewer's, scene units; 0.0 is in front of the plate, and -0.0 behind
    it. A point P = (x, s) at the depth s = -z behind the plate is replayed at P + sigma (c k, m),
    with m and c of `replayed_shifts`, sigma the sign of s, the shear k = (middle - a)/ss, and the
    screen ss behind the plate. The eye e at the height L sees the replayed point through the
    aperture a on the line from e to this point. With K = sigma c/ss and S = L + s + sigma m, the
    slope of this line falls with e as -(1 + K)/(S + L K), and the true slope as -1/(L + s). Both
    slopes are linear in e, so that the disparity of two eyes is exact.
    """
    s = -np.asarray(height, dtype=np.float64)
    # The sign of zero is the side of the plate.
    side = np.copysign(1.0, s)
    moved, aside = replayed_shifts(np.abs(s), display.frustum, settings)
    distance = viewer.distance + s
    screen = display.frustum.screen
    sheared = 0.0 if screen is None else side * aside / -screen.height
    seen = (1 + sheared) / (distance + side * moved + viewer.distance * sheared)
    return np.asarray(eyes_apart(viewer, display) * (seen - 1 / distance) * ARCSEC_PER_RADIAN)


def stereo_change_arcsec(
    content: Content, viewer: Viewer, display: Display, settings: DoubleFrustum
) -> float:
    """Return the largest change of disparity between any two visible points, arc seconds.

    The plate's border is one of the points, and does not move.
    """
    height = content.heights
    if not len(height):
        return 0.0
    moved, _ = replayed_shifts(np.abs(height), display.frustum, settings)
    if np.any(height + moved * (height > 0) >= viewer.distance):
        return math.inf
    changes = np.append(disparity_changes(height, viewer, display, settings), 0.0)
    return float(changes.max() - changes.min())


def crack_arcmin(viewer: Viewer, display: Display, settings: DoubleFrustum) -> float:
    """Return the largest angle of the crack in a surface that runs through the plate, arc minutes.

    If halves are displaced by m0 in depth and laterally by c0 k, with shear k, their gap is 2 m0
    times `gap_slope`.
    """
    moved, aside = (
        float(shift[0]) for shift in replayed_shifts(np.zeros(1), display.frustum, settings)
    )
    # Without an offset, surfaces nearer than n are clipped on both sides.
    moved = settings.near if settings.offset is Offset.NONE else moved
    if not moved:
        return 0.0
    slope = gap_slope(display, viewer.distance, aside / moved)
    return 2 * moved * slope / viewer.distance * ARCMIN_PER_RADIAN


def blur_arcmin(height: float, viewer: Viewer, display: Display) -> dict[str, float]:
    """Return the widths of the display's blurs at a height, by name, arc minutes."""
    distance = viewer.distance - height
    share = abs(height) / distance * ARCMIN_PER_RADIAN
    return {
        "pitch": display.pitch / viewer.distance * ARCMIN_PER_RADIAN,
        "pixel": display.pixel * share,
        "diffraction": display.diffraction * share,
    }


def resolved_crack(
    viewer: Viewer, display: Display, settings: DoubleFrustum
) -> tuple[str, float, float]:
    """Return the limit that hides cracks, its size, and the crack's width, both arc minutes.

    Pixels and diffraction blur the edges of the crack at the height to which they are displaced.
    """
    edge = -float(replayed_shifts(np.zeros(1), display.frustum, settings)[0][0])
    blurs = {"acuity": viewer.acuity_arcmin, **blur_arcmin(edge, viewer, display)}
    name, angle = max(blurs.items(), key=lambda item: item[1])
    return name, angle, crack_arcmin(viewer, display, settings)


def resolved_separation(height: float, viewer: Viewer, display: Display) -> tuple[str, float]:
    """Return the name of the limit on depth resolution at a height, and the smallest separation.

    Two eyes resolve surfaces whose disparities differ by more than stereo acuity, and by more than
    the display's blur at that height. The separation is in scene units.
    """
    angles = {
        "stereo acuity": viewer.stereo_acuity_arcsec / 60,
        **blur_arcmin(height, viewer, display),
    }
    name, angle = max(angles.items(), key=lambda item: item[1])
    distance, apart = viewer.distance - height, eyes_apart(viewer, display)
    radians = angle / ARCMIN_PER_RADIAN
    # apart / R - apart / (R + separation) = angle, solved for the separation.
    room = apart - radians * distance
    return name, math.inf if room <= 0 else radians * distance**2 / room


def finest_separation(
    heights: Iterable[float], viewer: Viewer, display: Display
) -> tuple[str, float, float] | None:
    """Return limit, size and height of the smallest resolved separation at some heights."""
    limits = [(*resolved_separation(height, viewer, display), height) for height in heights]
    return min(limits, key=lambda limit: limit[1]) if limits else None
