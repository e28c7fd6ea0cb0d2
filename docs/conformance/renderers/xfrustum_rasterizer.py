"""xfrustum's own rasterizer through the suite: the two cameras that each case states, drawn by OpenGL.

    xfrustum conformance run --command 'python xfrustum_rasterizer.py {case} {out}'

A third argument, such as d16:logarithmic, is the depth buffer of the cases that state no offset.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

from xfrustum import DoubleFrustum, Rasterizer, write_image
from xfrustum.scenes.conformance.suite import chosen

case_folder, out = Path(sys.argv[1]), Path(sys.argv[2])
asked = json.loads((case_folder / "case.json").read_text())
(case,) = chosen(names=(asked["name"],))
scene = case.open()
settings = case.settings(scene)
if asked["near"] is None and len(sys.argv) > 3:
    depth, mapping = sys.argv[3].split(":")
    named = json.loads((case_folder / "cameras.json").read_text())["settings"]
    settings = DoubleFrustum(
        near=max(named["near"], 1e-4 * max(scene.frustum.reach)), depth=depth, mapping=mapping
    )
with Rasterizer(scene) as rasterizer:
    for index in asked["hogels"]:
        image = rasterizer.render(scene.plate.aperture(*index), settings)
        image = image if case.colored else replace(image, color=None)
        write_image(out / f"hogel_{index[0]}x{index[1]}.exr", image)
