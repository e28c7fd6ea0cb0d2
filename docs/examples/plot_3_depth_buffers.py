"""
Depth buffers side by side
==========================

Five buffers draw the same picture with the same tiny near. Which pixels show the
wrong surface because of depth?
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from xfrustum import DoubleFrustum, Evaluator, open_scene

# %%
# At n = 1e-7 of the reach the near offset has no visible effect: all errors are from
# the depth buffer.

scene = open_scene("car")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(160, 160)))
near = 1e-7 * scene.frustum.longest_reach
buffers = [
    ("d16", "standard"),
    ("d24", "standard"),
    ("d24", "reversed"),
    ("d24", "logarithmic"),
    ("d32f", "reversed"),
]
settings = [
    DoubleFrustum(near=near, depth=depth, mapping=mapping) for depth, mapping in buffers
]
with Evaluator(scene) as judge:
    hogel = next(iter(judge.stream([scene.plate.middle], settings, images=True)))

# %%
# Red pixels show the wrong surface. D16 loses most of the car: the depth of the car
# rounds to the clear value of the buffer.

truth = hogel.truth
gray = np.where(
    truth.covered[..., None], 0.75 * truth.color.clip(0, 1) ** (1 / 2.2) + 0.25, 1.0
)
pictures = []
for drawing in hogel.drawings:
    wrong = drawing.comparison.maps.surface
    pictures.append(np.where(wrong[..., None], (0.88, 0.19, 0.19), gray))
    print(
        f"{drawing.settings.depth_label:18} {drawing.comparison.surface.fraction:.4%}"
    )
picture = Image.fromarray((255 * np.hstack(pictures)).astype("uint8")).resize(
    (1600, 320), Image.Resampling.NEAREST
)
picture
