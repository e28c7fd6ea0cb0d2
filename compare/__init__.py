"""The judge: displacement, surface, triangle and height, each in numbers and as an image."""

from xfrustum.compare.metrics.comparison import Comparison, HeightError, compare_images
from xfrustum.compare.metrics.displacement import Spread
from xfrustum.compare.metrics.error_maps import ErrorMaps

__all__ = ["Comparison", "ErrorMaps", "HeightError", "Spread", "compare_images"]
