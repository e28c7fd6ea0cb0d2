"""Rows of a report that are made up: numbers as a comparison and a stopwatch would give them."""

from xfrustum.compare.attribution.budget import Cause
from xfrustum.compare.metrics.comparison import ComparisonNumbers, Share, SurfaceShare
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.compare.metrics.radiance import ChannelSpread, RadianceNumbers
from xfrustum.compare.prediction.chain import LINKS
from xfrustum.compare.prediction.predict import Prediction, Separations
from xfrustum.compare.run import StageTimes
from xfrustum.reports.error_report.best import Measurement
from xfrustum.scenes import Aperture, DoubleFrustum

MIDDLE = Aperture(column=1, row=1, x=0.0, y=0.0)

TIMES = StageTimes(trace=0.5, raster=0.01, compare=0.02, predict=0.03, causes=0.04)
GPU_S = 0.001
NO_CAUSES = tuple(
    Cause(
        name=name,
        surface=0,
        triangle=0,
        displacement_rms_px=None,
        displacement_p99_px=None,
        predicted_displacement_rms_px=None,
        predicted_surface=None,
    )
    for name in LINKS
)

NO_PREDICTION = Prediction(
    displacement_px=None,
    silhouettes=0.0,
    snapped=0.0,
    depth=0.0,
    outside=0.0,
    separation=Separations(c=None, c_star=None),
)


def measured_row(settings: DoubleFrustum, comparison: ComparisonNumbers) -> Measurement:
    """Return a made-up row at the middle aperture: nothing has a cause, nothing was predicted."""
    return Measurement(
        aperture=MIDDLE,
        settings=settings,
        comparison=comparison,
        causes=NO_CAUSES,
        unexplained=0,
        predicted=NO_PREDICTION,
        times_s=TIMES,
        gpu_s=GPU_S,
    )


def comparison_numbers(
    judged: int, covered: int, surface: float, p99: float | None, wrong_colors: float | None = None
) -> ComparisonNumbers:
    """Return a comparison with shares of wrong surfaces and colors, and a displacement."""
    spread = (
        None
        if p99 is None
        else Spread(rms=p99 / 2, p50=p99 / 3, p95=p99 / 1.5, p99=p99, max=2 * p99)
    )
    return ComparisonNumbers(
        pixels=judged,
        judged=judged,
        covered=covered,
        at_plate=0,
        surface=SurfaceShare(wrong=round(surface * judged), fraction=surface, outside=0),
        triangle=Share(wrong=0, fraction=0.0),
        displacement_px=spread,
        height=None,
        radiance=None if wrong_colors is None else radiance_numbers(judged, wrong_colors),
        certainty={"proven": judged, "exact": 0, "tie": 0, "unexamined": 0},
    )


def radiance_numbers(judged: int, wrong_colors: float) -> RadianceNumbers:
    """Return a radiance error with a share of pixels that are off by more than a level."""
    gray = (0.1, 0.1, 0.1)
    return RadianceNumbers(
        pixels=judged,
        rms=0.1,
        mean=0.0,
        p99=0.1,
        max=0.1,
        above_step=wrong_colors,
        channels=ChannelSpread(rms=gray, mean=gray, p99=gray, max=gray),
        away_from_edges=None,
        flip=0.1,
        ssim=0.9,
        pixels_per_degree=67.0,
        noise=None,
    )
