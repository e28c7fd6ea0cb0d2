"""The judge: displacement, surface, triangle and height, each in numbers and as an image."""

from xfrustum.compare.comparison import Comparison, ErrorMaps, HeightError, compare_images
from xfrustum.compare.displacement import Spread

__all__ = ["Comparison", "ErrorMaps", "HeightError", "Spread", "compare_images"]
