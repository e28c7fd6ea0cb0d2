"""
Band limiting
=============

A hogel has an area, and shows the mean over its points. Fine bars alias if a hogel is
computed from only one point.
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from xfrustum import Reference, open_scene
from xfrustum.scenes.appearance import Sampling

# %%
# Bars finer and coarser than an aperture can show, traced from 1, 16 and 64 points
# of the aperture.

scene = open_scene("grating")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(128, 128)))
reference = Reference(scene)
images = {
    count: reference.trace(scene.plate.middle, Sampling(aperture=count))
    for count in (1, 16, 64)
}

# %%
# Bars that are finer than the hogel become gray, as they should.


def shown(image):
    """Return a hogel image's color as 8 bits."""
    return (255 * image.color.clip(0, 1) ** (1 / 2.2)).astype("uint8")


picture = Image.fromarray(
    np.hstack([shown(image) for image in images.values()])
).resize((1440, 480), 0)
picture

# %%
# Difference of the other means from the mean over 64 points:

for count in (1, 16):
    difference = images[count].color - images[64].color
    print(f"{count:3} points: {np.sqrt(np.mean(difference**2)):.4f} rms of radiance")
