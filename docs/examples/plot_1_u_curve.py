"""
The U curve
===========

Two cameras must step back by some near distance n. A large n displaces surfaces; a
small n leaves too little depth precision. In between, the share of wrong pixels has a
minimum: its curve is U-shaped.
"""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
from PIL import Image

from xfrustum import DoubleFrustum, Evaluator, open_scene

# %%
# The scene is the built-in car. It crosses the plate, and the film has 160 x 160
# pixels.

scene = open_scene("car")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(160, 160)))
nears = scene.frustum.longest_reach * 10.0 ** np.arange(-7.5, -0.5, 0.5)
buffers = {
    "D16 standard": ("d16", "standard"),
    "D24 standard": ("d24", "standard"),
    "D32F reversed": ("d32f", "reversed"),
}

# %%
# An ``Evaluator`` draws an aperture with all settings, traces its truth once, and
# compares the images.

settings = [
    DoubleFrustum(near=near, depth=depth, mapping=mapping)
    for depth, mapping in buffers.values()
    for near in nears
]
with Evaluator(scene) as judge:
    hogel = next(iter(judge.stream([scene.plate.middle], settings)))
wrong = np.array(
    [drawing.comparison.surface.fraction for drawing in hogel.drawings]
).reshape(len(buffers), -1)
for name, shares in zip(buffers, wrong, strict=True):
    print(f"{name:14} least: {shares.min():.4%} at n = {nears[shares.argmin()]:.2g} mm")

# %%
# Pictures, from a near that is too large to a near that is too small for 24 bits:
# red pixels show the wrong surface.


def with_errors(drawing, truth):
    """Return a drawing in gray with its wrong pixels in red."""
    gray = np.where(
        truth.covered[..., None], 0.75 * truth.color.clip(0, 1) ** (1 / 2.2) + 0.25, 1.0
    )
    return np.where(
        drawing.comparison.maps.surface[..., None], (0.88, 0.19, 0.19), gray
    )


chosen = [
    DoubleFrustum(near=scene.frustum.longest_reach * share)
    for share in (1e-2, 1e-5, 1e-7)
]
with Evaluator(scene) as judge:
    shown = next(iter(judge.stream([scene.plate.middle], chosen, images=True)))
pictures = [with_errors(drawing, shown.truth) for drawing in shown.drawings]
picture = Image.fromarray((255 * np.hstack(pictures)).astype("uint8")).resize(
    (1440, 480), Image.Resampling.NEAREST
)
picture

# %%
# The curves: at the right all buffers agree, because the near offset causes the
# errors; at the left the buffer causes them.

figure = go.Figure()
for name, shares in zip(buffers, wrong, strict=True):
    figure.add_scatter(
        x=nears, y=np.where(shares > 0, shares, np.nan), name=name, mode="lines+markers"
    )
axis = {"type": "log", "dtick": 1, "exponentformat": "power"}
figure.update_xaxes(title="near n, mm", **axis)
figure.update_yaxes(title="share of pixels with the wrong surface", **axis)
figure.update_layout(
    colorway=["#E69F00", "#0072B2", "#CC79A7"],
    template="plotly_white",
    legend={"orientation": "h", "y": 1.1},
)
figure
