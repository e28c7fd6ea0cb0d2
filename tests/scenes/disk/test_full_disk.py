"""A disk that is full at any byte: the files of a command are whole, or it says so and leaves none."""

import json
import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.support.limited_disk import Outcome, run
from tests.support.long_tail import kept
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main

UNLIMITED = 1 << 40

FILM = film((80.0, 60.0), hogels=(2, 1), resolution=(32, 24), fov_deg=(60.0, 60.0), reach=(150.0, 150.0))
SCENE = named("small") + FILM + part("square", 60.0, (0.0, 0.0, -60.0))

TRUTH, DRAWN = "trace scene.toml --quiet --out", "raster scene.toml --near 0.1 --out"

COMMANDS = {
    "trace": f"{TRUTH} out/x.exr",
    "raster": f"{DRAWN} out/x.exr",
    "compare": "compare truth.exr 1x0.exr --out out/folder",
    "verify": "verify scene.toml {i}x{j}.exr --apertures 1,0 --quiet --out out/v --junit out/x.xml",
    "plate": "plate scene.toml --near 0.1 --ids --quiet --out out/x.zarr",
    "report": "report scene.toml --near 0.1 --depth d24 --quiet --out out/folder",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene, its truth, and its raster."""
    folder = tmp_path_factory.mktemp("disk")
    (folder / "scene.toml").write_text(SCENE)
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        assert main([*TRUTH.split(), "truth.exr"]) == 0
        assert main([*DRAWN.split(), "1x0.exr"]) == 0
    return folder


def assert_done_or_absent(outcome: Outcome, whole: Outcome) -> None:
    at = f"with at most {outcome.limit} bytes a file: {outcome}"
    if outcome.status == whole.status:
        assert outcome.files == whole.files, at
        return
    assert outcome.status == 2, at
    assert re.fullmatch(r"xfrustum: error: [^\n]+\n", outcome.error), at
    kept = {
        # The plate's finished hogels stay, and so does a folder that is complete when the other file fails.
        name: content
        for name, content in outcome.files.items()
        if not name.startswith(("x.zarr", "v"))
    }
    assert kept == {}, at
    assert outcome.files.items() <= whole.files.items(), at


def swept(command: str, limits: list[int], folder: Path) -> tuple[list[Outcome], Outcome]:
    *outcomes, whole = run(COMMANDS[command].split(), [*limits, UNLIMITED], folder)
    assert whole.status in (0, 1) and whole.files, whole
    return outcomes, whole


@pytest.mark.parametrize(
    "command", kept(["trace", "raster", "compare", "verify", "plate"], ["trace", "plate"])
)
def test_files_are_whole_or_absent_wherever_the_disk_is_full(command: str, folder: Path) -> None:
    """OpenEXR writes the last bytes when it closes, and says nothing of an error then."""
    size, limits = (folder / ("truth.exr" if command == "trace" else "1x0.exr")).stat().st_size, [400, 4000]
    if command in ("trace", "raster"):
        limits = [0, size // 2, size - 300, size - 100, size - 1]
    outcomes, whole = swept(command, [*limits, size], folder)
    for outcome in outcomes:
        assert_done_or_absent(outcome, whole)
    assert {outcome.status for outcome in outcomes[:-1]} >= {2}
    if command in ("trace", "raster"):
        assert [outcome.status for outcome in outcomes] == [2] * len(limits) + [0]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["trace", "raster", "compare", "verify", "plate"])
def test_whole_or_absent_at_every_size(command: str, folder: Path) -> None:
    largest = {"trace": 3600, "raster": 3600, "compare": 12_000, "verify": 12_000, "plate": 12_000}[command]
    outcomes, whole = swept(command, list(range(1, largest, 1 if largest == 3600 else 37)), folder)
    for outcome in outcomes:
        assert_done_or_absent(outcome, whole)


@pytest.mark.slow
def test_a_report_is_whole_or_absent(folder: Path) -> None:
    """A report has times, so that no two reports are the same bytes."""
    sizes = [0, 1000, 9000, 15_000, 20_000, 30_000, 100_000, 1_000_000, 4_000_000]
    whole = {
        "folder",
        *(f"folder/{name}" for name in ("index.html", "inspect.html", "report.json", "measurements.parquet")),
    }
    for outcome in run(COMMANDS["report"].split(), [*sizes, UNLIMITED], folder):
        if outcome.status == 0:
            assert set(outcome.files) == whole, outcome
        else:
            assert outcome.status == 2 and outcome.files == {}, outcome
            assert re.fullmatch(r"xfrustum: error: [^\n]+\n", outcome.error), outcome
    report = folder / "out" / "folder"
    assert json.loads((report / "report.json").read_text())
    assert pq.read_table(report / "measurements.parquet").num_rows == 1
    assert (report / "index.html").read_text().rstrip().endswith("</html>")
