"""The limits of a display and of an eye at a distance, and the near offset that stays below them.

Everything is told for an eye straight before the middle of the plate, at the distance L. Content at the depth
z is at the distance R from it, which is L plus or minus abs(z).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from xfrustum.compare.eye.loss import ARCMIN_PER_RADIAN
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.arguments import real, settle
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.frustum import Frustum

ACUITY_ARCMIN = 1.0
"""Smallest angle that a good eye resolves."""

STEREO_ACUITY_ARCSEC = 20.0
"""Smallest difference of disparity that most people tell from none."""

MILLIMETERS = {"um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
"""Length of the units that are known by name."""

EYES_APART_MM, PUPIL_MM, GREEN_MM = 65.0, 4.0, 550e-6
"""Distance of two eyes, diameter of a pupil, and a wavelength to which eyes are most sensitive."""


Length = tuple[float, str | None]
"""A number and the name of its unit, None for the scene's own."""


def scene_length(length: Length, scene: Scene) -> float:
    """Return a length in scene units.

    Raises
    ------
    InputError
        It has a unit, and either this unit or that of the scene is not known.
    """
    value, unit = length
    if unit is None or unit == scene.units:
        return value
    known = ", ".join(MILLIMETERS)
    if unit not in MILLIMETERS:
        raise InputError(f"{value:g}{unit} has a unit that is not known; known are {known}")
    if scene.units not in MILLIMETERS:
        raise InputError(
            f"{scene.name}: how long is one of its {scene.units}? Give {value:g} in {scene.units}, without a "
            f"unit, or a unit that is known to the scene: {known}"
        )
    return value * MILLIMETERS[unit] / MILLIMETERS[scene.units]


@dataclass(frozen=True, kw_only=True)
class Viewer:
    """A pair of eyes straight before the plate.

    Attributes
    ----------
    distance
        Its distance from the plate, scene units.
    acuity_arcmin, stereo_acuity_arcsec
        Smallest angle, and smallest difference of disparity, that it tells.
    eyes_apart_mm, pupil_mm
        Distance of its eyes, and diameter of a pupil.

    Raises
    ------
    InputError
        A number is not positive and finite.
    """

    distance: float
    acuity_arcmin: float = ACUITY_ARCMIN
    stereo_acuity_arcsec: float = STEREO_ACUITY_ARCSEC
    eyes_apart_mm: float = EYES_APART_MM
    pupil_mm: float = PUPIL_MM

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = real(getattr(self, name))
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"a viewer's {name} must be positive, not {getattr(self, name)!r}")
            settle(self, **{name: value})


@dataclass(frozen=True, kw_only=True)
class DisplayLimits:
    """What the display can show to a viewer, and which near offset he cannot see.

    Attributes
    ----------
    viewer
        The viewer.
    pixel_arcmin
        Angle between the directions of neighboring pixels of a hogel; content at the depth z is seen under
        abs(z)/R of it.
    pitch_arcmin
        Angle under which a hogel is seen.
    diffraction_arcmin
        Wavelength over pitch: no hogel holds finer angles. None where the length of the unit is not known.
    behind, before
        Depth of field: distances from the plate up to which the display shows as fine as its hogels, or the
        viewer, allow; scene units, infinite where pixels are fine enough for any depth.
    rays_per_pupil
        Pixels of a hogel that a pupil catches along an axis; None where the length of the unit is not known.
    near_stereo
        Largest near offset whose gap changes the disparity across the plate by no more than the viewer's
        stereo acuity, scene units; None where the length of the unit is not known.
    near_crack
        Largest near offset whose gap opens no crack that the viewer resolves, and that is wider than a hogel,
        in surfaces that run through the plate, seen through its corners with pivot `aperture`; scene units,
        infinite where the corners are seen along the shear.
    """

    viewer: Viewer
    pixel_arcmin: float
    pitch_arcmin: float
    diffraction_arcmin: float | None
    behind: float
    before: float
    rays_per_pupil: float | None
    near_stereo: float | None
    near_crack: float

    @property
    def near(self) -> float:
        """Largest near offset that the viewer cannot see by any of these, scene units.

        It is that of surfaces at the plate; what stands before it is seen to change more (`noticeable`).
        """
        return self.near_crack if self.near_stereo is None else min(self.near_crack, self.near_stereo)


def gap_slope(frustum: Frustum, size: tuple[float, float], distance: float, aside: float = 1.0) -> float:
    """Return how far aside the halves of a surface part at the plate, as a multiple of how far in depth.

    Seen along a ray of slope m through an aperture of shear k, halves that are moved by 1 in depth and by c k
    aside part by 2 |c k - m|. That is linear over the plate, and so largest at one of its corners.

    Parameters
    ----------
    size
        Width and height of the plate, scene units.
    distance
        Distance of the eye straight before its middle, scene units.
    aside
        The c above: 1 with pivot `aperture`, 0 with pivot `camera`.
    """
    slopes = []
    for x in (-0.5, 0.5):
        for y in (-0.5, 0.5):
            corner = np.array([x * size[0], y * size[1]])
            shear = np.zeros(2)
            if frustum.screen is not None:
                shear = (np.array(frustum.screen.center) - corner) / -frustum.screen.height
            slopes.append(float(np.linalg.norm(aside * shear - corner / distance)))
    return max(slopes)


def display_limits(scene: Scene, viewer: Viewer) -> DisplayLimits:
    """Return what a scene's display can show to a viewer; of both axes the coarser one counts."""
    distance, unit = viewer.distance, MILLIMETERS.get(scene.units)
    _, half_extent = film_window(scene.frustum, scene.plate.middle)
    pixel = max(2 * t / count for t, count in zip(half_extent, scene.frustum.resolution, strict=True))
    pitches = [size / count for size, count in zip(scene.plate.size, scene.plate.hogels, strict=True)]
    pitch = max(pitches)
    # What can be told apart: by the display, or by the eye, whichever is coarser.
    finest = max(pitch / distance, viewer.acuity_arcmin / ARCMIN_PER_RADIAN)
    slope = gap_slope(scene.frustum, scene.plate.size, distance)
    near_stereo = None
    if unit is not None:
        apart = viewer.eyes_apart_mm / unit
        disparity = viewer.stereo_acuity_arcsec / 60 / ARCMIN_PER_RADIAN
        # apart / (L - n) - apart / (L + n) = disparity, solved for n without cancellation.
        near_stereo = disparity * distance**2 / (apart + math.hypot(apart, disparity * distance))
    return DisplayLimits(
        viewer=viewer,
        pixel_arcmin=pixel * ARCMIN_PER_RADIAN,
        pitch_arcmin=pitch / distance * ARCMIN_PER_RADIAN,
        diffraction_arcmin=None if unit is None else GREEN_MM / unit / min(pitches) * ARCMIN_PER_RADIAN,
        behind=distance * finest / (pixel - finest) if pixel > finest else math.inf,
        before=distance * finest / (pixel + finest),
        rays_per_pupil=None if unit is None else viewer.pupil_mm / unit / (distance * pixel),
        near_stereo=near_stereo,
        near_crack=finest * distance / (2 * slope) if slope else math.inf,
    )
