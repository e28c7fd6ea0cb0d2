"""Types of arrays, named by their content."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]  # lengths, directions, matrices and colors in double precision
Singles = NDArray[np.float32]  # the same quantities in single precision, for images and GPUs
Mask = NDArray[np.bool_]  # truth values of pixels, triangles or other elements
Indices = NDArray[np.int64]  # indices into another array
Numbers = NDArray[np.int32]  # numbers of triangles and objects in images; `NOTHING` for none
Bytes = NDArray[np.uint8]  # levels from 0 to 255, as in picture files
