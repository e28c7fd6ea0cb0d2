"""Blocks done by this process: every hogel once, whoever else is at work and whatever happened before."""

from __future__ import annotations

import math
import os
import re
import shutil
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.reports.cluster.toy_work import ToyJob, ToySession, made, parts_of
from tests.support.scene_file import film, named, part
from xfrustum.cli.where import Where
from xfrustum.compare.scouting.strata import GrowingSample
from xfrustum.reports.cluster import run
from xfrustum.reports.cluster.blocks import Blocks, SampleBlocks, Tiles, hogels_per_block
from xfrustum.reports.cluster.job import Answer, Job, do_block
from xfrustum.reports.cluster.parts import Parts
from xfrustum.reports.cluster.processes import DEVICE_VARIABLE
from xfrustum.reports.cluster.run import Engine, Part, open_team, run_blocks
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.scenes import Frustum, InputError, Plate, open_scene

SIDES = st.integers(1, 30)


def all_done(job: ToyJob, engine: Engine | None = None) -> None:
    engine = engine or Engine(workers=1)
    with open_team(engine, len(job.numbers), open_scene("car")) as team:
        run_blocks(job, engine.part.of(job.numbers), team, job.blocks.hogels(0), "toy")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("undisturbed")
    all_done(ToyJob.at(out))
    return parts_of(out)


def frustum(side: int) -> Frustum:
    return Frustum(resolution=(side, side), reach=(1.0, 1.0), fov=(1.0, 1.0))


def indices(blocks: Blocks, look: int) -> list[tuple[int, int]]:
    return [a.index for number in blocks.numbers(look) for a in blocks.apertures(number)]


@given(SIDES, SIDES, st.integers(1, 100))
def test_tiles_have_every_hogel_of_a_plate_once(columns: int, rows: int, hogels: int) -> None:
    plate = Plate(size=(1.0, 1.0), hogels=(columns, rows))
    tiles = Tiles.of(plate, hogels)
    found = indices(tiles, 0)
    assert sorted(found) == sorted(a.index for a in plate.apertures())
    assert len(found) == tiles.hogels(0)
    assert max(len(tiles.apertures(number)) for number in tiles.numbers(0)) <= hogels


@given(SIDES, SIDES, st.integers(1, 50), st.integers(1, 20))
def test_blocks_of_samples_have_every_hogel_that_a_look_adds_once(
    columns: int, rows: int, first: int, size: int
) -> None:
    sample = GrowingSample(plate=Plate(size=(1.0, 1.0), hogels=(columns, rows)), first=first)
    blocks = SampleBlocks(sample=sample, size=size, looks=sample.looks)
    found: list[tuple[int, int]] = []
    for look in range(sample.looks):
        new = indices(blocks, look)
        assert len(new) == blocks.hogels(look)
        found += new
    assert len(set(found)) == len(found) == math.prod(sample.plate.hogels)


def test_blocks_of_ten_million_hogels_are_cut_without_being_listed() -> None:
    tiles = Tiles.of(
        Plate(size=(800.0, 600.0), hogels=(4000, 2500)), hogels_per_block(10**7, frustum(512), 1)
    )
    assert tiles.hogels(0) == 10**7
    assert len(tiles.apertures(tiles.numbers(0)[-1])) > 0


def test_blocks_depend_on_the_work_and_not_on_who_does_it() -> None:
    sizes = (4941, 128, 1), (4941, 128, 5), (300, 128, 1), (10**6, 4096, 1)
    found = [hogels_per_block(count, frustum(side), settings) for count, side, settings in sizes]
    assert found == [51, 10, 19, 1]


def test_what_is_finished_stays_and_the_rest_is_made(tmp_path: Path, undisturbed: dict[str, bytes]) -> None:
    job = ToyJob.at(tmp_path)
    all_done(job)
    for number in (1, 4):
        job.parts.path(number).unlink()
    job.parts.path(7).write_bytes(undisturbed["part-0000007.parquet"][:-1])
    all_done(job)
    assert parts_of(tmp_path) == undisturbed
    assert [number for number, _ in made(tmp_path)] == [*job.numbers, 1, 4, 7]


def test_parts_of_a_job_array_make_the_whole_between_them(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job = ToyJob.at(tmp_path)
    for number in (3, 1, 2):
        all_done(job, Engine(part=Part(number=number, count=3)))
    assert parts_of(tmp_path) == undisturbed
    assert len(made(tmp_path)) == len(job.numbers)


def test_a_block_that_somebody_else_is_making_is_waited_for(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job = ToyJob.at(tmp_path)
    with job.claims() as other:
        assert other.take(3)
        work = threading.Thread(target=all_done, args=(job,))
        work.start()
        work.join(0.5)
        assert work.is_alive()
        assert not job.finished(3)
        other.release(3)
        work.join(60)
    assert not work.is_alive()
    assert parts_of(tmp_path) == undisturbed
    assert len(made(tmp_path)) == len(job.numbers)


def test_blocks_that_workers_finish_where_nobody_sees_them_are_no_end_of_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "MAX_UNSEEN_S", 0.5)
    rounds = []

    class Elsewhere:
        """Workers whose folder has the same name and is another one."""

        workers = 1

        def finished(self, job: Job, numbers: Iterator[int]) -> Iterator[int]:
            rounds.append(1)
            yield from numbers

        def progressed(self) -> None:
            raise AssertionError("no block is finished")

        def ask(self, job: Job, question: Callable[..., Answer], *arguments: Any) -> Answer:
            raise NotImplementedError

    job = ToyJob.at(tmp_path)
    with pytest.raises(InputError, match="a file system that the command and all workers share"):
        run_blocks(job, job.numbers, Elsewhere(), job.blocks.hogels(0), "toy")
    assert 1 < len(rounds) < 10


def test_a_worker_that_does_not_see_the_folder_says_so_and_where_it_is(tmp_path: Path) -> None:
    job = ToyJob.at(tmp_path)
    shutil.rmtree(job.parts.folder)
    with pytest.raises(
        InputError, match=rf"all workers share \(worker on {re.escape(socket.gethostname())}\)"
    ):
        do_block(job, 0)


def test_two_who_do_the_same_work_at_once_do_nothing_twice(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job = ToyJob.at(tmp_path, seconds=0.01)
    both = [threading.Thread(target=all_done, args=(job,)) for _ in range(2)]
    for one in both:
        one.start()
    for one in both:
        one.join()
    assert parts_of(tmp_path) == undisturbed
    assert sorted(number for number, _ in made(tmp_path)) == list(job.numbers)


def test_a_folder_is_continued_with_the_same_work_alone(tmp_path: Path) -> None:
    parts = Parts(out=tmp_path, name="toy")
    parts.open({"scene": "a", "near": 1})
    parts.open({"scene": "a", "near": 1})
    with pytest.raises(InputError, match=r"begun with another near \(near was 1, now 2\);"):
        parts.open({"scene": "a", "near": 2})
    (tmp_path / "empty").mkdir()
    Parts(out=tmp_path, name="empty").open({})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "rows.parquet").touch()
    with pytest.raises(InputError, match="was not begun by this command"):
        Parts(out=tmp_path, name="mine").open({})


def test_a_scene_travels_by_path_and_another_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    text = named("s") + film((8, 6), (3, 3), (16, 16), (60, 60), (30, 30))
    path.write_text(text + part("sphere", 5, (0, 0, -10)))
    ticket = SceneTicket.of(open_scene(path))
    assert ticket.open().content_hash == ticket.content
    path.write_text(text + part("sphere", 5, (0, 0, -11)))
    with pytest.raises(InputError, match="a worker finds another content than the command"):
        ticket.open()


def test_a_built_in_scene_travels_by_its_name_whatever_lies_in_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = open_scene("car")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car").mkdir()
    assert SceneTicket.of(scene).source == "car"


def test_a_scene_that_was_made_in_memory_stays_in_its_process(tmp_path: Path) -> None:
    job, scene = ToyJob.at(tmp_path), replace(open_scene("car"), source="")
    with (
        pytest.raises(InputError, match="has no file or name by which workers could open it"),
        open_team(Engine(workers=2), len(job.numbers), scene),
    ):
        pass
    with open_team(Engine(workers=1), len(job.numbers), scene) as team:
        run_blocks(job, job.numbers, team, job.blocks.hogels(0), "toy")
    assert all(map(job.finished, job.numbers))


def device_of(session: ToySession) -> str | None:
    return os.environ.get(DEVICE_VARIABLE)


def test_one_process_draws_on_the_device_that_it_is_given(tmp_path: Path) -> None:
    before = os.environ.get(DEVICE_VARIABLE)
    job, scene = ToyJob.at(tmp_path), open_scene("car")
    with open_team(Engine(workers=1, devices=(3, 4)), len(job.numbers), scene) as team:
        assert team.ask(job, device_of) == "3"
    assert os.environ.get(DEVICE_VARIABLE) == before


def test_what_draws_takes_the_gpus_of_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(DEVICE_VARIABLE, raising=False)
    monkeypatch.setattr(run, "default_devices", lambda: (2,))
    job, scene = ToyJob.at(tmp_path), open_scene("car")
    with open_team(Engine(), len(job.numbers), scene) as team:
        assert (team.workers, team.ask(job, device_of)) == (1, "2")
    with open_team(Engine(workers=1), len(job.numbers), scene, draws=False) as team:
        assert team.ask(job, device_of) is None


def test_there_is_one_process_for_each_gpu_unless_more_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "_processors", lambda: 16)
    assert [Engine().process_count(1000, gpus) for gpus in (0, 1, 4, 32)] == [16, 1, 4, 16]
    assert Engine(workers=8).process_count(1000, 1) == 8
    assert Engine().process_count(3, 0) == 3


def test_a_job_array_of_one_job_is_one_process() -> None:
    assert Where(part=(1, 1)).engine().process_count(1000) == 1


def test_strange_wishes_are_refused() -> None:
    for wish in (
        lambda: Part(number=0, count=3),
        lambda: Part(number=4, count=3),
        lambda: Engine(workers=0),
        lambda: Engine(scheduler="tcp://host:1", workers=2),
        lambda: Engine(scheduler="tcp://host:1", devices=(0,)),
        lambda: Engine(part=Part(number=1, count=2), workers=2),
    ):
        with pytest.raises(InputError):
            wish()
