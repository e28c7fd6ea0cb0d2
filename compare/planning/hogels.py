"""How well settings do at single hogels, measured, and what that says of the plate."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from xfrustum.compare.attribution.wrong_by_depth import DepthControl
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.planning.views import Requirement
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class HogelResult:
    """How well a plan does at one hogel, measured.

    Attributes
    ----------
    aperture
        The hogel's aperture.
    displacement_p99_px
        99th percentile of displacement, pixels.
    surface_fraction, depth_wrong
        Share of judged pixels with a wrong surface, for any cause and by depth.
    """

    aperture: Aperture
    displacement_p99_px: float
    surface_fraction: float
    depth_wrong: float

    def excess(self, requirement: Requirement) -> float:
        """Return the larger ratio to what is allowed; more than 1 is beyond what is required."""
        return max(
            self.displacement_p99_px / requirement.tolerance_px, self.depth_wrong / requirement.max_wrong
        )


@dataclass(frozen=True, kw_only=True)
class PlateResult:
    """What is known of a plan all over the plate.

    Attributes
    ----------
    hogels, scouted, measured
        Hogels of the plate; of these, how many were looked through, and how many were drawn and judged.
    sampled, beyond
        Hogels of the last random sample, and of these the ones beyond what is required.
    worst
        The measured hogel that comes nearest to what is allowed, or is farthest beyond it; None without a
        plan.
    hopeless
        Scouted hogels at which no near at all would keep to the tolerance.
    set_aside
        Further scouted hogels that the plan was not made for, since there is none for them and all others.
    share_beyond_at_most
        Bound on the share of all hogels that are beyond what is required.
    confidence
        Probability that the bound holds; 1 where every hogel was measured.
    """

    hogels: int
    scouted: int
    measured: int
    sampled: int
    beyond: int
    worst: HogelResult | None
    hopeless: int
    set_aside: int
    share_beyond_at_most: float
    confidence: float

    @property
    def share_within_at_least(self) -> float:
        """Bound on the share of all hogels at which the plan holds."""
        return 1 - self.share_beyond_at_most

    @property
    def covers_the_plate(self) -> bool:
        """Whether the plan was made for every scouted hogel."""
        return not self.hopeless and not self.set_aside

    def summary(self) -> dict[str, Any]:
        """Return what `plan --json` prints under `plate`."""
        numbers = asdict(self)
        numbers["share_within_at_least"] = self.share_within_at_least
        worst = numbers.pop("worst")
        if worst is not None:
            aperture = worst.pop("aperture")
            worst = {"aperture": [aperture["column"], aperture["row"]], **worst}
        return {**numbers, "worst": worst}


def hogel_result(
    reference: Reference, rasterizer: Rasterizer, aperture: Aperture, settings: DoubleFrustum
) -> HogelResult:
    """Draw one hogel, and judge it by the truth."""
    truth = reference.trace(aperture)
    drawn = rasterizer.render(aperture, settings, normals=False, color=False)
    judged = compare_images(truth, drawn, reference, radiance=False)
    wrong = judged.maps.surface
    assert wrong is not None
    by_depth = DepthControl.of(rasterizer, truth, reference, settings).charged(wrong)
    count = max(judged.judged, 1)
    return HogelResult(
        aperture=aperture,
        displacement_p99_px=judged.displacement_px.p99 if judged.displacement_px else 0.0,
        surface_fraction=float(wrong.sum() / count),
        depth_wrong=float(by_depth.sum() / count),
    )
