"""Blender renders the crossed frustum with the script from `camera --for blender`.

Tests with Blender use build/blender, made by `make test-blender`, or the Python in
XFRUSTUM_BLENDER_PYTHON, which must have the package bpy.
"""

import io
import json
import os
import shlex
import signal
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.conftest import CHECKOUT
from tests.support.views import view
from xfrustum import Reference, Scene, read_image, verify, write_cameras
from xfrustum.reference.lines import film_window
from xfrustum.reports.exchange import blender

BLENDER = Path(
    os.environ.get("XFRUSTUM_BLENDER_PYTHON", CHECKOUT / "build" / "blender" / "bin" / "python")
)
needs_blender = pytest.mark.skipif(
    not BLENDER.exists(), reason="needs Blender as a Python module: run make test-blender"
)


def written(folder: Path, name: str = "asymmetric-recentered") -> Scene:
    """Write the script, the plate and the triangles of a small scene; return the scene."""
    scene = view(name, (64, 48))
    scene = replace(scene, frustum=replace(scene.frustum, resolution=(64, 48)))
    write_cameras(scene, "blender", folder)
    return scene


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_the_script_has_the_film_of_every_aperture(name: str, tmp_path: Path) -> None:
    scene = written(tmp_path, name)
    plate = json.loads((tmp_path / "plate.json").read_text())
    for column, row in ((0, 0), (17, 40), (80, 60)):
        aperture = scene.plate.aperture(column, row)
        assert blender.aperture_center(plate, column, row) == (aperture.x, aperture.y)
        shear, half = blender.film(plate, (aperture.x, aperture.y))
        true_shear, true_half = film_window(scene.frustum, aperture)
        assert np.allclose([shear, half], [true_shear, true_half], rtol=1e-14)


def test_files_of_plain_python_are_read_by_libraries(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 256, (5, 7, 3), np.uint8)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(blender.png(pixels)))), pixels)
    number = rng.integers(0, 1 << 24, (5, 7), dtype=np.uint32)
    planes = {"P.X": rng.random((5, 7), np.float32), "id.triangle": number}
    content = blender.exr(planes)
    (tmp_path / "hogel.exr").write_bytes(content)
    file = OpenEXR.InputFile(str(tmp_path / "hogel.exr"))
    for name, plane in planes.items():
        assert np.array_equal(np.frombuffer(file.channel(name), plane.dtype).reshape(5, 7), plane)
        assert np.array_equal(blender.exr_planes(content)[name], plane.astype(np.float32))


def test_the_script_prints_mistakes_in_one_line_and_ends_with_130_when_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    written(tmp_path)
    monkeypatch.setattr(blender, "HERE", tmp_path)
    for apertures, message in (("x", "is not a list"), ("81,0", "lies outside the plate")):
        assert blender.main(["--out", "h", "--apertures", apertures]) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    monkeypatch.setattr(blender, "render_hogels", interrupted)
    assert blender.main(["--out", str(tmp_path / "hogels")]) == 130
    assert capsys.readouterr().err == "render.py: interrupted; repeat the command to continue\n"
    before = signal.getsignal(signal.SIGINT)
    pressed = blender.interruptions()
    signal.raise_signal(signal.SIGINT)  # is recorded, and does not end the script by itself
    signal.signal(signal.SIGINT, before)
    assert pressed == [signal.SIGINT]


def run(folder: Path, arguments: str) -> str:
    """Run the script in Blender; return its output."""
    command = [str(BLENDER), str(folder / "render.py"), *shlex.split(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@needs_blender
@pytest.mark.slow
@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_blender_draws_the_crossed_frustum(name: str, tmp_path: Path) -> None:
    scene = written(tmp_path, name)
    options = "--encoding triangle-id --apertures {i},{j} --out {out}"
    command = f"{BLENDER} {tmp_path}/render.py {options}"
    result = verify(scene, command=command, encoding="triangle-id", apertures=[(0, 0), (40, 30)])
    whole = result.as_found
    assert result.passed and result.diagnosis.faults == () and whole is not None
    # With 32-bit vertices and rays, pixels within a millionth of an edge may differ.
    assert whole.wrong <= 2 and whole.shown > 500


@needs_blender
@pytest.mark.slow
@pytest.mark.parametrize("layout", ["burnett", "hocking"])
def test_a_stopped_run_continues_in_every_layout_of_hogels(layout: str, tmp_path: Path) -> None:
    scene = written(tmp_path)
    options = f"--out {tmp_path}/hogels --layout {layout}"
    assert "1 hogels to render, 0 found" in run(tmp_path, f"--apertures 5,50 {options}")
    assert "1 hogels to render, 1 found" in run(tmp_path, f"--apertures '5,50;70,3' {options}")
    hogels, apertures = str(tmp_path / "hogels"), [(5, 50), (70, 3)]
    assert verify(scene, hogels, layout=layout, encoding="triangle-id", apertures=apertures).passed


MOVE = """
import sys, bpy, math
from mathutils import Matrix
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
by = Matrix.Translation((3, -2, 7)) @ Matrix.Rotation(0.6, 4, (1, 2, 3)) @ Matrix.Scale(2.5, 4)
for item in bpy.data.objects:
    item.matrix_world = by @ item.matrix_world
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


@needs_blender
@pytest.mark.slow
def test_hogels_follow_the_empty_in_a_blend_file(tmp_path: Path) -> None:
    scene = written(tmp_path)
    run(tmp_path, f"--save {tmp_path}/mine.blend")
    (tmp_path / "move.py").write_text(MOVE)
    subprocess.run(
        [str(BLENDER), str(tmp_path / "move.py"), str(tmp_path / "mine.blend")], check=True
    )
    blend = f"--blend {tmp_path}/mine.blend --apertures 5,50"
    run(tmp_path, f"{blend} --out {tmp_path}/hogel.exr --encoding exr")
    truth = Reference(scene).trace(scene.plate.aperture(5, 50))
    image = read_image(tmp_path / "hogel.exr", truth.camera)
    same = image.triangle == truth.triangle
    # A moved scene rounds differently to 32 bits.
    assert (~same).sum() <= 5
    shown = same & truth.covered
    assert np.allclose(image.position[shown], truth.position[shown], atol=1e-2)
    assert image.normal is not None and truth.normal is not None
    assert np.allclose(image.normal[shown], truth.normal[shown], atol=1e-5)
    assert np.isnan(image.position[same & ~truth.covered]).all()
    run(tmp_path, f"{blend} --out {tmp_path}/hogel.png --samples 4")
    assert np.asarray(Image.open(tmp_path / "hogel.png"))[truth.covered].mean() > 20
