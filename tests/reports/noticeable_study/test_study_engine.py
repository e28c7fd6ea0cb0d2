"""The study of viewers on the engine: several processes write what one writes, byte for byte."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from xfrustum.reports.cluster.run import Engine, Part
from xfrustum.reports.noticeable_study.grid import QUICK
from xfrustum.reports.noticeable_study.run import REPLAYING_MODULES, ReplayJob
from xfrustum.reports.noticeable_study.study import DOCUMENT, make_study, make_study_on
from xfrustum.reports.studies.folder import RESULTS
from xfrustum.reports.studies.origin import Origin, origin_hash
from xfrustum.scenes import InputError

SMALL = replace(QUICK, distances=(400.0, 800.0), nears=QUICK.nears[:2], replayed_nears=QUICK.nears[:1])


def written(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*.*") if path.suffix != ".sqlite")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("alone")
    make_study(folder, SMALL)
    return written(folder)


@pytest.mark.slow
def test_parts_of_a_job_array_write_what_one_process_writes(alone: dict[str, bytes], tmp_path: Path) -> None:
    first, last = (Engine(workers=1, part=Part(number=number, count=2)) for number in (2, 1))
    assert make_study_on(first, tmp_path, SMALL) is None
    assert not (tmp_path / DOCUMENT).exists()
    assert make_study_on(last, tmp_path, SMALL) is not None
    assert written(tmp_path) == alone


@pytest.mark.slow
def test_workers_write_what_one_process_writes(alone: dict[str, bytes], tmp_path: Path) -> None:
    lines: list[str] = []
    assert make_study_on(Engine(workers=2), tmp_path, SMALL, told=lines.append) is not None
    assert lines[0].startswith("dashboard: ")
    assert written(tmp_path) == alone


def test_each_seat_is_a_block_and_every_cell_is_in_one() -> None:
    cells = tuple(SMALL.cells())
    job = ReplayJob(cells=cells, grid=SMALL, path=Path(RESULTS))
    assert [{cell.seat for cell in block} for block in job.blocks] == [
        {block[0].seat} for block in job.blocks
    ]
    assert [block[0].distance for block in job.blocks] == [400.0, 800.0]
    assert sorted(job.key(cell) for block in job.blocks for cell in block) == sorted(map(job.key, cells))


def test_a_worker_with_another_device_refuses_to_replay(tmp_path: Path) -> None:
    job = ReplayJob(cells=tuple(SMALL.cells()), grid=SMALL, path=tmp_path / RESULTS, origin="0" * 64)
    with pytest.raises(InputError, match="another device than the study was begun with"), job.open():
        pass
    assert not (tmp_path / RESULTS).exists()


def test_what_replays_decides_which_results_are_its_own() -> None:
    here = Origin(versions={"numpy": "2"}, devices={"OpenGL renderer": "one"})
    job = ReplayJob(cells=(), grid=SMALL, path=Path(RESULTS))
    assert job.hashed(here) == origin_hash(here, REPLAYING_MODULES)
    assert job.hashed(here) != origin_hash(here)
    assert job.measured_with(here).origin == job.hashed(here)
