"""What an eye notices of a near offset and of a depth buffer: closed forms, for the depths a plate shows.

By the theorem of docs/method.md, two eyes see everything m farther from the plate than it is, and a surface
that runs through the plate has a crack of 2 m there. With shear, what is seen goes aside with the aperture's
own k besides; two eyes take their rays through different apertures, which changes the depth again. What
remains is to compare both with what eyes, and the display itself, resolve.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.eye.limits import GREEN_MM, MILLIMETERS, Viewer, gap_slope
from xfrustum.compare.eye.loss import ARCMIN_PER_RADIAN
from xfrustum.compare.eye.moved import replayed_distance
from xfrustum.compare.eye.stereo import SAME_PLACE
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset, Pivot
from xfrustum.scenes.plate.frustum import Frustum

ARCSEC_PER_RADIAN = 60 * ARCMIN_PER_RADIAN

DEPTH_SAMPLES = 33
"""Depths from the nearest to the farthest on a side at which disparity is looked at: it changes smoothly."""


@dataclass(frozen=True, kw_only=True)
class Display:
    """What of a plate decides how fine it shows.

    Attributes
    ----------
    frustum
        Crossed frusta of its hogels.
    size
        Width and height of the plate, scene units.
    pitch
        Width or height of a hogel, whichever is larger, scene units.
    pixel
        Slope between the directions of neighboring pixels of a hogel, the coarser of both axes.
    diffraction
        Wavelength over pitch; 0 where the length of the scene's unit is not known.
    millimeters
        Length of the scene's unit; None where it is not known.
    """

    frustum: Frustum
    size: tuple[float, float]
    pitch: float
    pixel: float
    diffraction: float
    millimeters: float | None

    @classmethod
    def of(cls, scene: Scene) -> Display:
        """Return the display of a scene."""
        _, half_extent = film_window(scene.frustum, scene.plate.middle)
        pitches = [size / count for size, count in zip(scene.plate.size, scene.plate.hogels, strict=True)]
        unit = MILLIMETERS.get(scene.units)
        return cls(
            frustum=scene.frustum,
            size=scene.plate.size,
            pitch=max(pitches),
            pixel=max(2 * t / count for t, count in zip(half_extent, scene.frustum.resolution, strict=True)),
            diffraction=0.0 if unit is None else GREEN_MM / unit / min(pitches),
            millimeters=unit,
        )


@dataclass(frozen=True, kw_only=True)
class Content:
    """The depths that a plate shows.

    Attributes
    ----------
    before, behind
        Nearest and farthest visible |z| on the viewer's side and behind the plate, scene units; None where
        nothing is seen there.
    through
        Whether a surface runs through the plate.
    """

    before: tuple[float, float] | None
    behind: tuple[float, float] | None
    through: bool

    @property
    def heights(self) -> Floats:
        """Heights z between the ends of both sides, scene units."""
        sides = [
            sign * np.linspace(*ends, DEPTH_SAMPLES)
            for sign, ends in ((1.0, self.before), (-1.0, self.behind))
            if ends is not None
        ]
        return np.concatenate([np.zeros(0), *sides])

    @property
    def farthest(self) -> tuple[float, ...]:
        """Heights z of the farthest surfaces on each side, scene units."""
        ends = ((1.0, self.before), (-1.0, self.behind))
        return tuple(sign * one[1] for sign, one in ends if one is not None)


def runs_through_plate(scene: Scene) -> bool:
    """Return whether any triangle crosses or touches the plate within its border."""
    lowest, highest = scene.height_ranges
    corners = scene.triangles[(lowest <= 0) & (highest >= 0)]
    half = np.array(scene.plate.size) / 2
    inside = (corners[..., :2].min(axis=1) <= half) & (corners[..., :2].max(axis=1) >= -half)
    return bool(inside.all(axis=1).any())


def surface_content(scene: Scene) -> Content:
    """Return the depths of all surfaces within the reach, whether anybody sees them or not.

    Without a look at the scene they stand for what a plate shows: no less is noticed of them.
    """
    lowest, highest = scene.height_ranges
    sides: list[tuple[float, float] | None] = []
    for low, high, reach in zip((lowest, -highest), (highest, -lowest), scene.frustum.reach, strict=True):
        within = (high >= 0) & (low <= reach)
        ends = np.clip(low[within], 0, reach), np.clip(high[within], 0, reach)
        sides.append((float(ends[0].min()), float(ends[1].max())) if within.any() else None)
    return Content(before=sides[0], behind=sides[1], through=runs_through_plate(scene))


def require_before_viewer(scene: Scene, content: Content, viewer: Viewer) -> None:
    """Raise an InputError where a plate shows something behind a viewer."""
    if content.before is not None and content.before[1] >= viewer.distance:
        raise InputError(
            f"{scene.name} shows something {content.before[1]:.3g} {scene.units} before the "
            f"plate, behind a viewer at {viewer.distance:g}; choose a larger distance"
        )


def eyes_apart(viewer: Viewer, display: Display) -> float:
    """Return the distance of a viewer's eyes, scene units.

    Raises
    ------
    InputError
        The length of the scene's unit is not known.
    """
    if display.millimeters is None:
        raise InputError(
            "what two eyes see depends on their distance: name the scene's units, one of "
            f"{', '.join(MILLIMETERS)}"
        )
    return viewer.eyes_apart_mm / display.millimeters


def disparity_changes(height: Floats, viewer: Viewer, display: Display, settings: DoubleFrustum) -> Floats:
    """Return by how much the disparity of points at some heights changes, arc seconds; less where farther.

    Parameters
    ----------
    height
        Heights z below the viewer's, scene units; 0.0 is before the plate, and -0.0 behind it.
    viewer, display
        Eyes straight before the plate, and the plate.
    settings
        Settings of the cameras that drew it.

    Notes
    -----
    The point P = (x, s) behind the plate by s < 0 or s > 0 is replayed at P + sigma (c k, m), as `moved` has
    it: m in depth, c times the shear k = (middle - a)/ss aside, with the screen ss behind the plate. The eye
    e at the height L sees it through that aperture a for which all three lie on one line. With K = sigma c/ss
    and S = L + s + sigma m, the slope of this line falls with e as -(1 + K)/(S + L K), and that of the true
    line as -1/(L + s). Both are linear in e: what is said of the disparity of two eyes is exact.
    """
    s = -np.asarray(height, dtype=np.float64)
    # The zero at which the side before the plate begins is another one than that of the side behind it.
    side = np.copysign(1.0, s)
    moved, aside = _shifts(np.abs(s), display.frustum, settings)
    distance = viewer.distance + s
    screen = display.frustum.screen
    sheared = 0.0 if screen is None else side * aside / -screen.height
    seen = (1 + sheared) / (distance + side * moved + viewer.distance * sheared)
    return np.asarray(eyes_apart(viewer, display) * (seen - 1 / distance) * ARCSEC_PER_RADIAN)


def stereo_change_arcsec(
    content: Content, viewer: Viewer, display: Display, settings: DoubleFrustum
) -> float:
    """Return the largest change of disparity between any two things that a viewer sees, arc seconds.

    The plate's own border is one of these things: it stays where it is.
    """
    height = content.heights
    if not len(height):
        return 0.0
    moved, _ = _shifts(np.abs(height), display.frustum, settings)
    if np.any(height + moved * (height > 0) >= viewer.distance):
        return math.inf
    changes = np.append(disparity_changes(height, viewer, display, settings), 0.0)
    return float(changes.max() - changes.min())


def replay_noise_arcsec(
    content: Content, viewer: Viewer, display: Display, settings: DoubleFrustum, eye_pixel: float
) -> float:
    """Return by how much a replay's change of disparity may differ from the closed form, arc seconds.

    Parameters
    ----------
    eye_pixel
        Width that a pixel of the eyes' films has on the plate, scene units.

    Notes
    -----
    Along the line of slope u of a hogel of shear k, a point that is moved by m is shown m u - c k aside of
    its place (`disparity_changes` has c); the closed form has the slope of sight in place of u. To first
    order in m, the difference of two eyes then is off by m/R times the sum of these:

    * the pixel of a hogel: an eye is shown the nearest one, whose u is at most half a pixel off, in each eye;
    * the hogel, at most half a pitch beside the line of sight, in each eye, which changes k;
    * the right eye's pixel, at most half of one beside that of the left eye's point, which changes u and k;
    * the point that it shows, the same up to `SAME_PLACE`, and so at another R, at the largest slope.

    It is the largest on each side of the plate, and a difference has one point on each.
    """
    height = content.heights
    moved, aside = (np.abs(one) for one in _shifts(np.abs(height), display.frustum, settings))
    distance = viewer.distance - height
    slope = (math.hypot(*display.size) + eyes_apart(viewer, display)) / 2 / viewer.distance
    seen = eye_pixel * distance / viewer.distance
    direct = display.pixel + eye_pixel / 2 / viewer.distance
    off = direct + slope * SAME_PLACE * (seen + display.pitch) / distance
    screen = display.frustum.screen
    sheared = 0.0 if screen is None else (display.pitch + eye_pixel / 2) / abs(screen.height)
    noise = (moved * off + aside * sheared) / distance
    sides = (noise[np.signbit(height)], noise[~np.signbit(height)])
    return sum(float(one.max(initial=0)) for one in sides) * ARCSEC_PER_RADIAN


def crack_arcmin(viewer: Viewer, display: Display, settings: DoubleFrustum) -> float:
    """Return the largest angle under which a viewer sees the crack in a surface that runs through the plate.

    Halves that are moved by m0 in depth and c0 k aside, with shear k, part by 2 m0 times `gap_slope`.
    """
    moved, aside = (float(one[0]) for one in _shifts(np.zeros(1), display.frustum, settings))
    if settings.offset is Offset.NONE:
        # What is nearer than n is clipped on both sides.
        moved = settings.near
    if not moved:
        return 0.0
    slope = gap_slope(display.frustum, display.size, viewer.distance, aside / moved)
    return 2 * moved * slope / viewer.distance * ARCMIN_PER_RADIAN


def blur_arcmin(height: float, viewer: Viewer, display: Display) -> dict[str, float]:
    """Return how wide the display's own blurs are at a height, arc minutes, by their names."""
    distance = viewer.distance - height
    share = abs(height) / distance * ARCMIN_PER_RADIAN
    return {
        "pitch": display.pitch / viewer.distance * ARCMIN_PER_RADIAN,
        "pixel": display.pixel * share,
        "diffraction": display.diffraction * share,
    }


def finest_arcmin(height: float, viewer: Viewer, display: Display) -> tuple[str, float]:
    """Return what limits the angles that can be told apart at a height, the eye included, and that angle."""
    blurs = {"acuity": viewer.acuity_arcmin, **blur_arcmin(height, viewer, display)}
    return max(blurs.items(), key=lambda item: item[1])


def resolved_crack(viewer: Viewer, display: Display, settings: DoubleFrustum) -> tuple[str, float, float]:
    """Return what hides a crack, how wide it may be, and how wide it is, arc minutes.

    Its edges are seen in front of and behind the plate, as far as halves are moved: there the display has the
    blurs of its pixels and of diffraction.
    """
    edge = -float(_shifts(np.zeros(1), display.frustum, settings)[0][0])
    name, angle = finest_arcmin(edge, viewer, display)
    return name, angle, crack_arcmin(viewer, display, settings)


def resolved_separation(height: float, viewer: Viewer, display: Display) -> tuple[str, float]:
    """Return what limits the depths that can be told apart at a height, and their smallest difference.

    Two eyes tell two surfaces apart whose disparities differ by more than stereo acuity, and by more than the
    display's own blur there: pitch, pixels, diffraction. The difference is in scene units.
    """
    angles = {"stereo acuity": viewer.stereo_acuity_arcsec / 60, **blur_arcmin(height, viewer, display)}
    name, angle = max(angles.items(), key=lambda item: item[1])
    distance, apart = viewer.distance - height, eyes_apart(viewer, display)
    radians = angle / ARCMIN_PER_RADIAN
    # apart / R - apart / (R + separation) = angle, solved for the separation.
    room = apart - radians * distance
    return name, math.inf if room <= 0 else radians * distance**2 / room


def finest_separation(
    heights: Iterable[float], viewer: Viewer, display: Display
) -> tuple[str, float, float] | None:
    """Return the smallest separation that can be told apart at some heights, what limits it, and the height.

    None where there are no heights.
    """
    found = [(*resolved_separation(height, viewer, display), height) for height in heights]
    return min(found, key=lambda one: one[1]) if found else None


def _shifts(distance: Floats, frustum: Frustum, settings: DoubleFrustum) -> tuple[Floats, Floats]:
    """Return how far points are moved from the plate, and the factor of the shear by which they go aside."""
    moved = replayed_distance(distance, frustum, settings) - distance
    if settings.pivot is Pivot.CAMERA and settings.offset is Offset.PLATE:
        first = settings.slabs[0] if settings.slabs else np.inf
        return moved, np.where(distance <= first, moved - settings.near, moved)
    return moved, moved
