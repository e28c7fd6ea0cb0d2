"""Second reader of mesh files, written from the formats' specifications; not used by the product.

Slow and plain on purpose: the standard library and NumPy, one loop per rule. It shares no code with
`xfrustum.scenes`, so that an error of one reader does not hide in the other.
`python -m tests.second_reader FILE..` prints both readings of each file.
"""

from tests.second_reader.model import Reading, Refused
from tests.second_reader.reading import read, read_polygons, read_triangles

__all__ = ["Reading", "Refused", "read", "read_polygons", "read_triangles"]
