"""The page about engines with fixed code: its blocks run, and its matrices are right."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import Command
from xfrustum.cli.main import main
from xfrustum.scenes import open_scene

PAGE = Path(__file__).resolve().parents[2] / "docs" / "from-an-engine.md"
MATRIX, NUMBERS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def passes(folder: Path, mapping: str) -> list[dict[str, Any]]:
    line = f"camera asymmetric --for json --near 1 --mapping {mapping} --apertures 20,20 --out"
    assert main([*line.split(), str(folder)]) == 0
    [aperture] = json.loads((folder / "cameras.json").read_text())["apertures"]
    entries: list[dict[str, Any]] = aperture["passes"]
    return entries


def depths(matrix: np.ndarray, one_pass: dict[str, Any], distances: np.ndarray) -> np.ndarray:
    """Return z/w at distances from a camera along its axis."""
    toward = 1.0 if one_pass["looks_to"] == "+z" else -1.0
    points = np.tile((*one_pass["position"], 1.0), (len(distances), 1))
    points[:, 2] += toward * distances
    clip = points @ matrix.T
    np.testing.assert_allclose(clip[:, 3], distances)
    return np.asarray(clip[:, 2] / clip[:, 3])


@pytest.mark.parametrize(
    ("mapping", "ends"), [("gl", (-1.0, 1.0)), ("standard", (0.0, 1.0)), ("reversed", (1.0, 0.0))]
)
def test_clip_ranges_are_those_of_the_table_and_a_fixed_test_gets_turned_depths(
    mapping: str, ends: tuple[float, float], tmp_path: Path
) -> None:
    for one_pass in passes(tmp_path, mapping):
        distances = np.linspace(one_pass["near"], one_pass["far"], 50)
        stated = np.array(one_pass["clip_from_scene"])
        before = depths(stated, one_pass, distances)
        np.testing.assert_allclose(before[[0, -1]], ends, atol=1e-12)
        if mapping == "reversed":
            continue
        names = {"one_pass": one_pass}
        exec(MATRIX, names)
        matrix = np.asarray(names["matrix"])
        np.testing.assert_array_equal(matrix[[0, 1, 3]], stated[[0, 1, 3]])
        after = depths(matrix, one_pass, distances)
        turned = ends[::-1] if one_pass["wins"] == "farthest" else ends
        np.testing.assert_allclose(after[[0, -1]], turned, atol=1e-12)
        # The test `<` keeps the smallest depth: the farthest surface for C*, the nearest for C.
        assert (np.diff(after) * (turned[1] - turned[0]) > 0).all()


def test_rows_alone_flip_for_a_camera_that_looks_at_the_viewer(tmp_path: Path) -> None:
    random = np.random.default_rng(0).uniform((-5, -5, 2), (5, 5, 15), (9, 3))
    for one_pass in passes(tmp_path, "gl"):
        side = 1.0 if one_pass["looks_to"] == "+z" else -1.0
        points, forward, up = random * (1, 1, side), np.array((0, 0, side)), np.array((0, 1, 0))
        offset, (width, height) = points - one_pass["position"], one_pass["half_extent"]
        along = np.stack((offset @ np.cross(forward, up) / width, offset @ up / height), axis=1)
        picture = along / (offset @ forward)[:, None]
        clip = np.c_[points, np.ones(9)] @ np.array(one_pass["clip_from_scene"]).T
        np.testing.assert_allclose(picture * (1, -side), clip[:, :2] / clip[:, 3:])


def test_numbers_are_those_of_the_scene_also_behind_triangles_without_area(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mesh.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv 1 1 3\nf 1 2 4\nf 1 2 3\nf 2 5 3\n"
    )
    (tmp_path / "scene.toml").write_text(
        'units = "mm"\nplate = {size = [2, 2], hogels = [3, 3]}\n'
        "frustum = {resolution = [32, 32], fov_deg = [60, 60], reach = [9, 9]}\n"
        '[[object]]\nmesh = "mesh.obj"\n'
    )
    monkeypatch.chdir(tmp_path)
    assert main(["camera", "scene.toml", "--for", "json", "--near", "0.1", "--out", "cameras"]) == 0
    names: dict[str, Any] = {"np": np}
    exec(NUMBERS, names)
    scene = open_scene("scene.toml")
    np.testing.assert_array_equal(names["corners"].reshape(-1, 3, 3), scene.triangles)
    assert names["number"].tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert (names["color"] @ (65536, 256, 1)).tolist() == names["number"].tolist()


def test_apertures_of_verify_are_the_ranges_of_plate(tmp_path: Path, command: Command) -> None:
    (tmp_path / "h_1x2.png").write_bytes(b"")
    line = f"verify hard/only-behind {tmp_path}/h_{{i}}x{{j}}.png --quiet --json --apertures"
    for text, expected in {
        "1-2,2": [[1, 2], [2, 2]],
        "1,*": [[1, 0], [1, 1], [1, 2], [1, 3], [1, 4]],
        "1,2;0-1,2": [[1, 2], [0, 2]],
    }.items():
        hogels = command(f"{line} '{text}'", status=1).record["hogels"]
        assert [hogel["aperture"] for hogel in hogels] == expected
    assert "aperture 9,2 lies outside" in command(f"{line} 1-9,2", status=2).err
    assert "columns,rows such as 0-80,30" in command(f"{line} 2-1,2", status=2).err
