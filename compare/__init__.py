"""The judge: displacement, surface, triangle and height, each in numbers and as an image."""

from xfrustum.compare.comparison import Comparison, HeightError, compare_images
from xfrustum.compare.displacement import Spread
from xfrustum.compare.error_maps import ErrorMaps

__all__ = ["Comparison", "ErrorMaps", "HeightError", "Spread", "compare_images"]
