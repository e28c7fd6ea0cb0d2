"""
The gap at the plate
====================

A viewer receives one pixel of each hogel. To an eye, the near offset opens a gap of 2 n
at the plate: content behind the plate appears n farther back, content in front of it n
farther in front (proof: docs/method.md).
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from xfrustum import DoubleFrustum, Eye, open_scene, view
from xfrustum.reports.view import drawing

# %%
# A scene with parts on both sides of the plate, viewed from 600 mm. To make the gap
# visible, n is a twenty-fifth of the reach.

scene = open_scene("asymmetric")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(48, 48)))
eye = Eye(position=(40.0, 20.0, 600.0), resolution=(240, 180))
seen = view(scene, [eye], drawing(scene, DoubleFrustum(near=6.0)))
print(
    f"every point is seen {seen.gap:g} {scene.units} farther from the plate than it is"
)

# %%
# From left to right: A, the scene itself; B, a plate whose hogels are all true; C, a
# plate that two cameras drew with n = 6.


def shown(image):
    """Return an eye's picture as 8 bits, white where no surface is visible."""
    color = np.where((image.triangle >= 0)[..., None], image.color, 1.0)
    return (255 * color.clip(0, 1) ** (1 / 2.2)).astype("uint8")


views = seen.views[0]
pictures = [shown(image) for image in (views.true, views.replayed, views.drawn)]
picture = Image.fromarray(np.hstack(pictures)).resize(
    (1440, 360), Image.Resampling.NEAREST
)
picture

# %%
# Loss by the display (A to B), and additional loss by the renderer (B to C):

for who, loss in (
    ("display", seen.record.eyes[0].display),
    ("renderer", seen.record.eyes[0].renderer),
):
    print(f"{who:9} {loss.fraction:.2%} of the pixels show another surface")
