"""Names that look like addresses, such as `run:1`, are local paths; options that fail leave nothing."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from xfrustum.cli.main import main

SCENE = """
name = "small"
units = "mm"
[plate]
size = [40.0, 30.0]
hogels = [6, 4]
[frustum]
resolution = [16, 12]
screen = { height = 120.0, center = [0.0, 0.0], size = [80.0, 60.0] }
reach = [60.0, 60.0]
[[object]]
shape = "sphere"
scale = 12.0
"""


@pytest.fixture(autouse=True)
def scene_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write the scene into the working folder: only relative names can look like addresses."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)


def test_a_report_and_a_judged_plate_lie_in_folders_whose_names_have_a_colon() -> None:
    line = ["report", "scene.toml", "--near", "0.1", "--apertures", "3,2", "--depth", "d24", "--quiet"]
    assert main([*line, "--out", "run:1"]) == 0
    assert pq.read_table(Path("run:1", "measurements.parquet").absolute()).num_rows > 0
    line = ["plate", "scene.toml", "--near", "0.1", "--apertures", "3,2", "--judge", "--quiet"]
    for _ in range(2):
        assert main([*line, "--out", "run:1.zarr"]) == 0
    line = ["convert", "run:1.zarr", "s3:x", "--to", "hogels", "--quiet"]
    assert main(line) == 0
    assert len(list(Path("s3:x").iterdir())) == 24


@pytest.mark.parametrize("options", [["--judge"], []])
def test_sampling_that_the_device_refuses_leaves_no_group(
    options: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    line = ["plate", "scene.toml", "--near", "0.1", "--multisample", "64", *options, "--quiet"]
    assert main([*line, "--out", "new.zarr"]) == 2
    assert "too fine" in capfd.readouterr().err
    assert sorted(path.name for path in Path().iterdir()) == ["scene.toml"]
