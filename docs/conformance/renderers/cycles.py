"""Blender's Cycles with the crossed frustum as its camera, by the script of `camera --for blender`.

    make test-blender     # installs bpy into build/blender
    xfrustum conformance run --timeout 600 --command 'python cycles.py BLENDER_PYTHON {case} {out}'

`python` is a Python with xfrustum, BLENDER_PYTHON a Python with bpy (build/blender/bin/python).
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from lines import check_float32, check_numbers, lines

from xfrustum.reports.exchange.cameras import write_cameras
from xfrustum.scenes.conformance_suite import chosen


def main() -> None:
    """Render the hogels of a case."""
    python, folder, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    asked = json.loads((folder / "case.json").read_text())
    try:
        check_numbers(asked)
        for hogel in asked["hogels"]:
            check_float32(np.load(folder / "scene.npz"), lines(asked, hogel)[0])
        if asked["asked"] == "object-id":
            raise NotImplementedError("numbers of triangles only")
    except NotImplementedError as told:
        (out / "unsupported").write_text(str(told))
        return
    (case,) = chosen(names=(asked["name"],))
    scene = case.open()
    write_cameras(scene, "blender", folder / "blender", None, case.apertures(scene))
    script = str(folder / "blender" / "render.py")
    subprocess.run([python, script, "--out", str(out), "--encoding", "triangle-id"], check=True)


if __name__ == "__main__":
    main()
