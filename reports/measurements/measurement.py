"""What a sweep measures: one row per aperture and setting, and the pictures that belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.reports.common.timing import Timing
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

if TYPE_CHECKING:
    from xfrustum.compare.prediction.predict import Prediction


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One raster image judged against the truth.

    Attributes
    ----------
    aperture, settings
        What was drawn, and how.
    comparison
        The numbers of `compare --json` (CONVENTIONS.md, "Errors and their signs").
    certainty
        Number of pixels per class of certainty of the truth.
    predicted
        The same by closed forms, from the scene's geometry alone.
    times_s
        Wall seconds per stage. The truth's time is the aperture's, the same in all its rows; `raster` is
        a frame with read-back. Of `compare` and `predict`, done side by side, each row has its share.
    parts_s
        By stage: seconds of which parts of it took how long; `gpu` is the device's own time in a frame.
    wrong
        By `surface` and `radiance`: the judged pixels that show the wrong surface, or a color that is off
        by more than 1/255; empty where they were not kept.
    """

    aperture: Aperture
    settings: DoubleFrustum
    comparison: Mapping[str, Any]
    certainty: Mapping[str, int]
    predicted: Prediction
    times_s: Mapping[str, float]
    parts_s: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    wrong: Mapping[str, PixelSet] = field(default_factory=dict, repr=False)

    def wrong_share(self, kind: str) -> float:
        """Return the share of judged pixels that are wrong in one sense, `surface` or `radiance`."""
        if kind == "surface":
            return self.surface_fraction
        radiance = self.comparison.get("radiance")
        return float(radiance["above_step"]) if radiance else 0.0

    def wrong_count(self, kind: str) -> int:
        """Return the number of those pixels."""
        pixels = self.wrong_pixels(kind)
        return round(self.wrong_share(kind) * self.comparison["judged"]) if pixels is None else pixels.count

    def wrong_pixels(self, kind: str) -> PixelSet | None:
        """Return those pixels; None where they were not kept."""
        return self.wrong.get(kind)

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
    """Encoded pictures (PNG or WebP) of one setting; see `xfrustum.reports.error_report.images`."""

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
        Wall seconds per stage, which add up to `wall_s`; `pictures` are those of the page, `repeat` are
        frames drawn again to be timed, `light` is what a shaded scene is measured for besides, and `other`
        is the rest.
    parts_s
        By stage: seconds of which parts of it took how long.
    wall_s
        What everything took.
    frames_s
        By setting: repeated frames with read-back at the first aperture, where they were timed.
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
    parts_s: Mapping[str, Mapping[str, float]]
    wall_s: float
    frames_s: Mapping[DoubleFrustum, Timing]

    def with_stage(self, name: str, seconds: float) -> Sweep:
        """Return the same with one more stage, done after all others."""
        return replace(self, times_s={**self.times_s, name: seconds}, wall_s=self.wall_s + seconds)

    @property
    def cost(self) -> dict[str, float]:
        """What measuring took beside what it cannot do without: its frames with read-back, its truths.

        Pictures belong to the page, repeated frames to the ranking by time, and light has a section of its
        own: each has a price of its own.
        """
        needed = self.times_s["raster"] + self.times_s["trace"]
        apart = sum(self.times_s.get(stage, 0.0) for stage in ("pictures", "repeat", "light"))
        measuring = self.wall_s - apart
        return {
            "wall_s": measuring,
            "frames_s": self.times_s["raster"],
            "truths_s": self.times_s["trace"],
            "pictures_s": self.times_s["pictures"],
            "ratio": measuring / needed,
            "total_s": self.wall_s,
        }

    @property
    def cost_sentence(self) -> str:
        """The same in words."""
        cost = self.cost
        frames = "a raster frame" if len(self.rows) == 1 else f"{len(self.rows)} raster frames"
        truths = "the certified truth" if len(self.truths) == 1 else f"{len(self.truths)} certified truths"
        besides = [f"the page's pictures {cost['pictures_s']:.2f} s"]
        for stage, words in (("repeat", "frames drawn again for their time"), ("light", "light")):
            if stage in self.times_s:
                besides.append(f"{words} {self.times_s[stage]:.2f} s")
        return (
            f"Measured in {cost['wall_s']:.2f} s of wall time: {cost['ratio']:.2f} times what {frames} "
            f"with read-back ({cost['frames_s']:.2f} s) and {truths} ({cost['truths_s']:.2f} s) take. "
            f"Besides: {', '.join(besides)}; {cost['total_s']:.2f} s in all."
        )
