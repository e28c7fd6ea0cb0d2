"""What a sweep measures: one row per aperture and setting, and the pictures that belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

if TYPE_CHECKING:
    from xfrustum.compare.predict import Prediction


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
        The same by closed forms, from the scene's geometry alone.
    times_s
        Wall seconds per stage. The truth's time is the aperture's, the same in all its rows; `raster` is
        a frame with read-back, and `gpu` that part of it in which the device drew.
    """

    aperture: Aperture
    settings: DoubleFrustum
    comparison: Mapping[str, Any]
    certainty: Mapping[str, int]
    predicted: Prediction
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

    @property
    def measured_over_predicted(self) -> dict[str, float | None]:
        """Ratios of what was measured to what was predicted; None without either, and where that is zero."""
        displacement, predicted = self.comparison["displacement_px"], self.predicted.displacement_px
        moved = {
            f"displacement_{key}": _ratio(displacement[key], getattr(predicted, key))
            if displacement and predicted
            else None
            for key in ("rms", "p99")
        }
        return {**moved, "surface": _ratio(self.surface_fraction, self.predicted.surface_fraction)}


def _ratio(measured: float, predicted: float) -> float | None:
    return measured / predicted if predicted else None


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
        Seconds per stage, of the whole sweep; `pictures` are those of the page. Settings are judged side by
        side, and `gpu` is a part of `raster`: together they are more than `wall_s`.
    wall_s
        What the sweep took.
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
    wall_s: float

    @property
    def cost(self) -> dict[str, float]:
        """What the sweep took beside what it cannot do without: its frames with read-back, its truths.

        Pictures belong to the page, and have a price of their own.
        """
        needed = self.times_s["raster"] + self.times_s["trace"]
        measuring = self.wall_s - self.times_s["pictures"]
        return {
            "wall_s": measuring,
            "frames_s": self.times_s["raster"],
            "truths_s": self.times_s["trace"],
            "pictures_s": self.times_s["pictures"],
            "ratio": measuring / needed,
        }

    @property
    def cost_sentence(self) -> str:
        """The same in words."""
        cost = self.cost
        frames = "a raster frame" if len(self.rows) == 1 else f"{len(self.rows)} raster frames"
        truths = "the certified truth" if len(self.truths) == 1 else f"{len(self.truths)} certified truths"
        return (
            f"Measured in {cost['wall_s']:.2f} s: {cost['ratio']:.2f} times what {frames} with read-back "
            f"({cost['frames_s']:.2f} s) and {truths} ({cost['truths_s']:.2f} s) take. "
            f"Encoding the page's pictures: {cost['pictures_s']:.2f} s."
        )
