"""The judge: displacement, surface, triangle and height, each in numbers and as an image.

attribution/     The error budget: wrong pixels charged to links of the chain
beyond           When a hogel is beyond a tolerance: the one definition
diagnosis/       What a foreign renderer does otherwise than asked, and whether that explains its errors
eye/              What a viewer sees: the display's loss, the renderer's, and the scene that a near offset
                  replays
extent           Where the objects of a scene lie, and which apertures see them; the same in words
judging/         One hogel of a foreign renderer judged
metrics/         Truth against image: what is measured, pixel by pixel and in numbers
planning/        The planner: settings to draw with, the fewest slabs, then the largest margin
prediction/      Closed forms of every error, from the truth's geometry alone
renderer_model/  A model of somebody else's renderer: conventions, geometry, what it draws
rounding/        The bounds of a rasterizer's rounding, and the classifier of causes (edge, order, lost)
run              Many hogels drawn and judged: the one loop behind reports, surveys, plans and plates
sampling        Samples of a plate's hogels, and what they bound: the share of all hogels with a property
scout           Which apertures of a plate decide the error: a look through many, before any is measured
selfcheck/       The truth against brute force in integers
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from xfrustum.compare.metrics.comparison import Comparison, compare_images
    from xfrustum.compare.metrics.error_maps import ErrorMaps, HeightError, Spread

__all__ = ["Comparison", "ErrorMaps", "HeightError", "Spread", "compare_images"]


def __getattr__(name: str) -> object:
    """Import a name when it is first used: closed forms answer without loading the reference."""
    if name not in __all__:
        raise AttributeError(f"module 'xfrustum.compare' has no attribute {name!r}")
    module = "comparison" if name in ("Comparison", "compare_images") else "error_maps"
    return getattr(import_module(f"xfrustum.compare.metrics.{module}"), name)
