"""Image by direction: one pixel of all hogels of a tile, the transpose of hogel images.

A plate is a stack of hogels or a stack of images by direction; both have the same pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from xfrustum.scenes.arrays import Bytes, Floats, Indices, Numbers
from xfrustum.scenes.plate.plate import PlateTile
from xfrustum.scenes.representation import ShortRepr


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DirectionImage(ShortRepr):
    """True image by direction of a tile; arrays are (rows, columns) of hogels, row 0 on top.

    Each pixel is equal, bit for bit, to the same pixel in the image of its hogel.
    """

    tile: PlateTile
    pixel: tuple[int, int]  #: column and row of the pixel in every hogel
    triangle: Numbers  #: int32, -1 where there is no surface
    position: Floats  #: (rows, columns, 3) surface points, scene units; NaN where there is none
    normal: Floats | None  #: (rows, columns, 3) unit normals by the mesh's winding
    color: NDArray[Any] | None  #: (rows, columns, 3) linear RGB
    certainty: Bytes  #: uint8 `Certainty`
    tied_triangles: (
        Indices  #: (N, 3) row, column of the tile, triangle of surfaces that share a tie
    )
