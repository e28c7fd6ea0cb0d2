"""Names that look like addresses, such as `run:1`, are local paths."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.support.scene_file import film, part
from xfrustum.cli.main import main

SCENE = film((40, 30), (6, 4), (16, 12), (60, 60), (60, 60)) + part("sphere", 12.0, (0.0, 0.0, 0.0))


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
