"""
Shear
=====

With a projection screen fixed to the plate, every aperture has a different shear. The
paper shears about the aperture; an ordinary off-axis projection shears about each
camera's own center, and displaces all points a little.
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from xfrustum import DoubleFrustum, Evaluator, open_scene

# %%
# The hogel at the top left of the plate has the largest shear.

scene = open_scene("asymmetric-recentered")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(200, 150)))
corner = scene.plate.aperture(0, 0)
settings = [DoubleFrustum(near=1.0, pivot=pivot) for pivot in ("aperture", "camera")]
with Evaluator(scene) as judge:
    hogel = next(iter(judge.stream([corner], settings, images=True)))

# %%
# Displacement from blue (0.01 px) to yellow (10 px): with shear about the aperture
# (left), points move toward the middle of the film; with shear about the cameras
# (right), all points also move sideways.


def colors(displacement):
    """Return lengths as colors on a logarithmic scale, white for no surface."""
    length = np.hypot(displacement[..., 0], displacement[..., 1])
    level = np.clip((np.log10(np.maximum(length, 1e-12)) + 2) / 3, 0, 1)[..., None]
    mixed = (1 - level) * (0.05, 0.2, 0.55) + level * (0.98, 0.85, 0.2)
    return np.where(np.isfinite(length)[..., None], mixed, 1.0)


pictures = [colors(drawing.comparison.maps.displacement) for drawing in hogel.drawings]
picture = Image.fromarray(
    (255 * np.nan_to_num(np.hstack(pictures))).astype("uint8")
).resize((1600, 600), 0)
picture

# %%
# The displacements in numbers:

for drawing in hogel.drawings:
    moved = drawing.comparison.displacement_px
    print(
        f"pivot {drawing.settings.pivot:9} median {moved.p50:.3f} px, "
        f"99 % below {moved.p99:.3f} px"
    )
