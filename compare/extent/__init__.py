"""Where a scene lies: which part of it the reach and the frusta of the plate hold, before anything is drawn.

content  What lies at which depth in the frusta of some apertures, in bins of |z|, hidden surfaces included
facts    Size, heights, area within the reach and apertures of every object of a scene
layers   Triangles cut by heights: the corners of what is left of each, and its area
sight    Whether an aperture's image can show any of an object, and which apertures of a plate can
wording  Where a scene lies, in words: why nothing is seen, what the reach cuts off, units that do not fit
"""

from xfrustum.compare.extent.facts import ObjectExtent, Sight, box, extents, in_plate
from xfrustum.compare.extent.layers import triangles_in_chunks
from xfrustum.compare.extent.sight import aside_of_frusta
from xfrustum.compare.extent.wording import (
    heights,
    length,
    plate_warnings,
    require_seen,
    unseen_facts,
    unseen_sentence,
    warnings,
)

__all__ = [
    "ObjectExtent",
    "Sight",
    "aside_of_frusta",
    "box",
    "extents",
    "heights",
    "in_plate",
    "length",
    "plate_warnings",
    "require_seen",
    "triangles_in_chunks",
    "unseen_facts",
    "unseen_sentence",
    "warnings",
]
