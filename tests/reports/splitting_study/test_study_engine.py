"""The study on the engine: what several processes measure is what one measures, but for times."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from xfrustum.reports.cluster.run import Engine, Part
from xfrustum.reports.splitting_study.grid import Grid
from xfrustum.reports.splitting_study.rows import StudyRow
from xfrustum.reports.splitting_study.run import PICTURES, SHEETS, StudyJob
from xfrustum.reports.splitting_study.study import DOCUMENT, StudyFiles, make_study, make_study_on
from xfrustum.reports.studies.folder import RESULTS
from xfrustum.scenes import DepthFormat, DepthMapping, InputError

SMALL = Grid(
    nears=(1e-3, 1e-6),
    buffers=((DepthFormat.D24, DepthMapping.STANDARD),),
    resolutions=(16,),
    ratios=(10.0,),
)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> StudyFiles:
    return make_study(tmp_path_factory.mktemp("alone"), SMALL)


def without_times(rows: tuple[StudyRow, ...]) -> list[StudyRow]:
    return [replace(row, seconds=0.0) for row in rows]


def kept(out: Path) -> list[tuple[str, str]]:
    with sqlite3.connect(out / RESULTS) as connection:
        return connection.execute("SELECT kind, key FROM results ORDER BY kind, key").fetchall()


@pytest.mark.slow
def test_parts_of_a_job_array_measure_the_study_between_them(alone: StudyFiles, tmp_path: Path) -> None:
    parts = [Engine(workers=1, part=Part(number=number, count=3)) for number in (3, 1, 2)]
    assert make_study_on(parts[0], tmp_path, SMALL) is None
    assert make_study_on(parts[1], tmp_path, SMALL) is None
    assert not (tmp_path / DOCUMENT).exists()
    last = make_study_on(parts[2], tmp_path, SMALL)
    assert last is not None
    assert without_times(last.rows) == without_times(alone.rows)
    assert kept(tmp_path) == kept(alone.data.parent)
    assert [path.name for path in last.figures] == [path.name for path in alone.figures]
    for mine, theirs in zip(last.figures, alone.figures, strict=True):
        assert mine.read_bytes() == theirs.read_bytes()


@pytest.mark.slow
def test_workers_measure_what_one_process_measures(alone: StudyFiles, tmp_path: Path) -> None:
    lines: list[str] = []
    found = make_study_on(Engine(workers=2), tmp_path, SMALL, told=lines.append)
    assert found is not None
    assert lines[0].startswith("dashboard: ")
    assert without_times(found.rows) == without_times(alone.rows)
    assert kept(tmp_path) == kept(alone.data.parent)
    assert found.origin == alone.origin


def test_a_worker_with_another_device_refuses_to_measure(tmp_path: Path) -> None:
    job = StudyJob(asked=SMALL, kind=PICTURES, stage=0, path=tmp_path / RESULTS, origin="0" * 64)
    with pytest.raises(InputError, match="another device than the study was begun with"), job.open():
        pass
    assert not (tmp_path / RESULTS).exists()


def test_blocks_have_every_cell_once_and_those_of_one_picture_together() -> None:
    pictures, sheets = (
        StudyJob(asked=SMALL, kind=kind, stage=0, path=Path(RESULTS), origin="")
        for kind in (PICTURES, SHEETS)
    )
    assert [cell for block in pictures.blocks for cell in block] == list(SMALL.cells())
    assert [{cell.side for cell in block} for block in pictures.blocks] == [{side} for side in SMALL.sides]
    # Each near is another place of the camera.
    assert len(sheets.blocks) == 4
    assert sum(map(sheets.size, range(4))) == 4
