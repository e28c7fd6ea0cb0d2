"""
Hard cases
==========

Scenes on which renderers fail: lines exactly through edges and vertices, surfaces in
the aperture, triangles without area. The reference decides each pixel: by proof in
floating point, by integer arithmetic, or as a tie.
"""

import numpy as np
from PIL import Image

from xfrustum import Reference, open_scene
from xfrustum.scenes import Certainty

# %%
# Four hard cases. ``xfrustum scenes --hard`` lists all.

names = (
    "vertices-and-edges",
    "surface-through-aperture",
    "needles",
    "nearly-coincident",
)
images = {}
for name in names:
    scene = open_scene(f"hard/{name}")
    images[name] = Reference(scene).trace(scene.plate.middle)

# %%
# Gray pixels are proven, blue pixels are decided in integers, orange pixels are
# ties, and white pixels show no surface.

COLORS = {
    Certainty.PROVEN: (0.72, 0.72, 0.72),
    Certainty.EXACT: (0.0, 0.45, 0.7),
    Certainty.TIE: (0.9, 0.6, 0.0),
}


def decided(image):
    """Return the method that decided each pixel, as a color."""
    found = np.ones((*image.triangle.shape, 3))
    for kind, color in COLORS.items():
        seen = (image.certainty == kind) & (image.covered | (kind != Certainty.PROVEN))
        found[seen] = color
    return found


for name, image in images.items():
    counts = {
        kind.name.lower(): int((image.certainty == kind).sum()) for kind in COLORS
    }
    alone = int(image.overruled.sum())
    print(f"{name:25} {counts}; a float32 tracer alone: {alone} pixels wrong")
picture = Image.fromarray(
    (255 * np.hstack([decided(image) for image in images.values()])).astype("uint8")
)
picture = picture.resize((1600, 400), Image.Resampling.NEAREST)
picture
