"""Where a scene lies: which part of it the reach and the frusta of the plate hold, before anything is drawn.

    layers      triangles cut by heights: the corners of what is left of each
    sight       whether an aperture's image can show any of an object, and which apertures of a plate can
    facts       size, heights, area within the reach and apertures of every object
    wording     the same in words: why nothing is seen, what the reach cuts off, wrong units

Neither answer imports this room: it says a third time, for itself, where a point is imaged, so that a
mistake here cannot hide one of theirs.
"""

from xfrustum.compare.extent.facts import ObjectExtent, Sight, box, extents
from xfrustum.compare.extent.layers import triangles_in_chunks
from xfrustum.compare.extent.sight import aside_of_frusta
from xfrustum.compare.extent.wording import (
    heights,
    length,
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
    "length",
    "require_seen",
    "triangles_in_chunks",
    "unseen_facts",
    "unseen_sentence",
    "warnings",
]
