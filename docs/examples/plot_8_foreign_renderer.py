"""
A foreign renderer diagnosed
============================

A renderer returns plausible pictures. ``verify`` judges files, a command, or, as
here, a function.
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from xfrustum import DoubleFrustum, Rasterizer, Reference, open_scene, verify

# %%
# The renderer has an undeclared near offset, and its rows are upside down.

scene = open_scene("asymmetric")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(96, 96)))
rasterizer = Rasterizer(scene)


def renderer(scene, aperture):
    """Return the hogel image of a foreign program."""
    image = rasterizer.render(aperture, DoubleFrustum(near=1.0))
    flipped = {
        name: getattr(image, name)[::-1]
        for name in ("triangle", "object", "position", "normal", "color")
    }
    return replace(image, **flipped)


apertures = [(20, 20), (60, 20), (20, 40), (60, 40)]
found = verify(scene, renderer, apertures=apertures)
print("passed" if found.passed else "failed")
for defect in found.summary()["diagnosis"]:
    print("*", defect["words"])

# %%
# The truth, and the image of this renderer:


def shown(image):
    """Return a hogel image's color as 8 bits, white where there is no surface."""
    color = np.where(image.covered[..., None], image.color, 1.0)
    return (255 * color.clip(0, 1) ** (1 / 2.2)).astype("uint8")


aperture = scene.plate.aperture(20, 20)
pair = (Reference(scene).trace(aperture), renderer(scene, aperture))
picture = Image.fromarray(np.hstack([shown(image) for image in pair])).resize(
    (1200, 600), Image.Resampling.NEAREST
)
picture

# %%
# Share of wrong pixels as delivered, and after correction of these defects:

summary = found.summary()
for which in ("as_found", "corrected"):
    print(f"{which:9} {summary[which]['fraction']:.2%} of the pixels are wrong")
rasterizer.release()
