"""
Slabs and seams
===============

Cuts at some distances from the plate divide both frusta into slabs. All slabs but the
first are drawn exactly from the aperture. Errors at the first cut depend on the fit.
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from xfrustum import DoubleFrustum, Evaluator, open_scene

# %%
# Three settings: one pair of frusta; a cut at 15 mm, with the frustum's angle in the
# first slab; and the same cut, with the first slab fitted to the cut.

scene = open_scene("car")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(192, 192)))
near = 0.01 * scene.frustum.longest_reach
settings = {
    "one pair": DoubleFrustum(near=near),
    "cut at 15 mm, fit angle": DoubleFrustum(near=near, slabs=(15.0,), fit="angle"),
    "cut at 15 mm, fit 15 mm": DoubleFrustum(near=near, slabs=(15.0,)),
}
with Evaluator(scene) as judge:
    hogel = next(
        iter(judge.stream([scene.plate.middle], list(settings.values()), images=True))
    )

# %%
# The seam is the line of wrong surfaces in the second picture, where the displaced
# first slab meets the exact second slab. The fit closes the seam.

truth = hogel.truth
gray = np.where(
    truth.covered[..., None], 0.75 * truth.color.clip(0, 1) ** (1 / 2.2) + 0.25, 1.0
)
pictures = []
for name, drawing in zip(settings, hogel.drawings, strict=True):
    wrong = drawing.comparison.maps.surface
    pictures.append(np.where(wrong[..., None], (0.88, 0.19, 0.19), gray))
    moved = drawing.comparison.displacement_px
    print(
        f"{name:24} {drawing.comparison.surface.fraction:7.3%} wrong, "
        f"99 % are displaced by less than {moved.p99:.2f} px"
    )
picture = Image.fromarray((255 * np.hstack(pictures)).astype("uint8")).resize(
    (1440, 480), Image.Resampling.NEAREST
)
picture
