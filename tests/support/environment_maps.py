"""Environment maps for tests: OpenEXR, and Radiance HDR in the format of Greg Ward's programs."""

from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.files.exr import write_planes


def write_map(path: Path, pixels: Singles) -> None:
    """Write linear RGB (H, W, 3) in the format that the suffix selects."""
    if path.suffix == ".exr":
        planes = zip("RGB", np.moveaxis(pixels.astype(np.float32), -1, 0), strict=False)
        write_planes(path, dict(planes))
        return
    height, width = pixels.shape[:2]
    _, exponent = np.frexp(pixels.max(axis=-1))
    mantissa = pixels * np.ldexp(1.0, 8 - exponent)[..., None]
    stored = np.concatenate([mantissa, (exponent + 128)[..., None]], axis=-1).astype(np.uint8)
    rows = bytearray(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode())
    for row in stored:
        if width < 8:  # too narrow for run-length encoding
            rows += row.tobytes()
            continue
        rows += bytes((2, 2, width >> 8, width & 255))
        for component in row.T:
            # A run of the first value, then the other values unencoded
            same = int(np.argmin(component == component[0])) or width
            same = min(same, 127)
            rows += bytes((128 + same, component[0]))
            for start in range(same, width, 128):
                part = component[start : start + 128]
                rows += bytes((len(part),)) + part.tobytes()
    path.write_bytes(rows)
