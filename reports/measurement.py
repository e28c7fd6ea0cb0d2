"""What a sweep measures: one row per aperture and setting, and the pictures that belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

if TYPE_CHECKING:
    from xfrustum.compare import Spread


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One raster image judged against the truth.

    Attributes
    ----------
    aperture, settings
        What was drawn, and how.
    comparison
        The numbers of `compare --json` (design, section 7).
    certainty
        Number of pixels per class of certainty of the truth.
    predicted
        Displacement in pixels by the closed form; None where nothing is imaged.
    times_s
        Wall seconds per stage. The truth's time is the aperture's, the same in all its rows.
    """

    aperture: Aperture
    settings: DoubleFrustum
    comparison: Mapping[str, Any]
    certainty: Mapping[str, int]
    predicted: Spread | None
    times_s: Mapping[str, float]

    @property
    def surface_fraction(self) -> float:
        """Share of the judged pixels that show the wrong surface."""
        return float(self.comparison["surface"]["fraction"])

    @property
    def displacement_p99_px(self) -> float:
        """99th percentile of displacement; 0 where the raster shows nothing to be displaced."""
        displacement = self.comparison["displacement_px"]
        return 0.0 if displacement is None else float(displacement["p99"])


@dataclass(frozen=True, kw_only=True)
class SettingPictures:
    """Encoded pictures (PNG or WebP) of one setting; see `xfrustum.reports.images`."""

    raster: bytes
    displacement: bytes
    surface: bytes
    triangle: bytes
    height: bytes
    radiance: bytes | None = None


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Everything measured on a scene.

    Attributes
    ----------
    rows, pictures
        One each per aperture and setting, in the same order: all settings of the first
        aperture first.
    truths
        Encoded picture of the truth, per aperture.
    reduction
        Image pixels per picture pixel, along each side.
    versions, devices
        What produced the numbers.
    times_s
        Wall seconds per stage, of the whole sweep.
    """

    scene: Scene
    apertures: tuple[Aperture, ...]
    rows: tuple[Measurement, ...]
    pictures: tuple[SettingPictures, ...]
    truths: tuple[bytes, ...]
    reduction: int
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    times_s: Mapping[str, float]
