"""Blocks of work: made by one process, by local processes, by a Dask cluster, or in parts."""

from __future__ import annotations

import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from socket import AF_UNIX

import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.dask_processes import dask, free_port, scheduler, worker
from tests.support.long_tail import thinned
from tests.support.toy_work import NUMBERS, ToyJob, ToySession, made, parts_of, process_of
from xfrustum import InputError
from xfrustum.raster.device import context
from xfrustum.reports import blocks
from xfrustum.reports.blocks import CUDA_VARIABLE, DEVICE_VARIABLE, Engine, Part, open_workers
from xfrustum.reports.parts import ParquetParts

LONGEST_WAIT_S = 120


def run(job: ToyJob, engine: Engine | None = None) -> None:
    engine = engine or Engine(workers=1)
    with open_workers(engine, len(NUMBERS), draws=False) as workers:
        workers.run(job, engine.part.of(NUMBERS), len(NUMBERS))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("undisturbed")
    run(ToyJob.at(out))
    return parts_of(out)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Allow a scheduler one minute to answer, as it starts beside other tests."""
    monkeypatch.setattr(blocks, "CONNECT_S", 60)


def wait_for_blocks(out: Path, count: int) -> None:
    end = time.monotonic() + LONGEST_WAIT_S
    while len(made(out)) < count:
        assert time.monotonic() < end
        time.sleep(0.02)


def test_finished_blocks_stay_and_the_rest_is_made(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job = ToyJob.at(tmp_path)
    run(job)
    for number in (1, 4):
        job.parts.path(number).unlink()
    job.parts.path(7).write_bytes(undisturbed["part-0000007.parquet"][:-1])
    run(job)
    assert parts_of(tmp_path) == undisturbed
    assert [number for number, _ in made(tmp_path)] == [*NUMBERS, 1, 4, 7]


def test_parts_of_a_job_array_make_the_whole_between_them(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job = ToyJob.at(tmp_path)
    for number in (3, 1, 2):
        run(job, Engine(part=Part(number=number, count=3)))
    assert parts_of(tmp_path) == undisturbed
    assert len(made(tmp_path)) == len(NUMBERS)


def test_processes_make_the_same_bytes_and_nothing_of_them_listens(
    tmp_path: Path, undisturbed: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "temporary"
    scratch.mkdir()
    monkeypatch.setenv("TMPDIR", str(scratch))
    job = ToyJob.at(tmp_path, seconds=0.2)
    with open_workers(Engine(workers=2), len(NUMBERS), draws=False) as workers:
        thread = threading.Thread(target=workers.run, args=(job, NUMBERS, len(NUMBERS)))
        thread.start()
        wait_for_blocks(tmp_path, 2)
        tree = [psutil.Process(), *psutil.Process().children(recursive=True)]
        sockets = [socket for process in tree for socket in process.net_connections("all")]
        thread.join()
        assert workers.count == 2
        assert workers.ask(job, process_of) in {process for _, process in made(tmp_path)}
        # An error of a worker is printed with its message.
        with pytest.raises(InputError, match=r"^a bad block; mend it$"):
            workers.run(ToyJob.at(tmp_path / "bad", bad=5), NUMBERS, len(NUMBERS))
    # Pairs of unnamed Unix sockets connect parents and children.
    assert [socket for socket in sockets if socket.family != AF_UNIX or socket.laddr] == []
    assert list(scratch.iterdir()) == []
    assert parts_of(tmp_path) == undisturbed
    processes = {process for _, process in made(tmp_path)}
    assert len(processes) == 2 and os.getpid() not in processes
    assert not any(map(psutil.pid_exists, processes))


def test_a_block_that_kills_its_process_twice_is_named(tmp_path: Path) -> None:
    message = "block 5: 3 worker processes died of it"
    with pytest.raises(InputError, match=message):
        run(ToyJob.at(tmp_path, deadly={5: math.inf}), Engine(workers=2))


@pytest.mark.slow
def test_killed_processes_are_replaced_and_deaths_are_charged_to_their_own_blocks(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    run(ToyJob.at(tmp_path, deadly={1: 1, 5: 1, 9: 2}), Engine(workers=2))
    assert parts_of(tmp_path) == undisturbed
    assert len({process for _, process in made(tmp_path)}) > 2


PROGRAM = """
import signal, sys
from pathlib import Path
from tests.support.toy_work import NUMBERS, ToyJob
from xfrustum.reports.blocks import Engine, open_workers
# Where tests run in the background of a shell, Ctrl-C is ignored, and processes inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
with open_workers(Engine(workers=2), len(NUMBERS), draws=False) as workers:
    workers.run(ToyJob.at(Path(sys.argv[1]), seconds=0.5), NUMBERS, len(NUMBERS))
"""


@pytest.mark.parametrize("stop", thinned([signal.SIGKILL, signal.SIGINT], 2))
def test_worker_processes_end_with_the_command_and_the_next_one_goes_on(
    stop: signal.Signals, tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    command = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], stderr=subprocess.DEVNULL
    )
    wait_for_blocks(tmp_path, 1)
    time.sleep(random.Random(str(stop)).uniform(0, 0.3))
    workers = psutil.Process(command.pid).children(recursive=True)
    command.send_signal(stop)
    command.wait(LONGEST_WAIT_S)
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert workers and not alive and len(made(tmp_path)) < len(NUMBERS)
    run(ToyJob.at(tmp_path))
    assert parts_of(tmp_path) == undisturbed


def test_a_scheduler_that_does_not_answer_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocks, "CONNECT_S", 1)
    with pytest.raises(
        InputError, match=r"--scheduler tcp://127.0.0.1:9: no scheduler answers there"
    ):
        run(ToyJob.at(tmp_path), Engine(scheduler="tcp://127.0.0.1:9"))


@pytest.mark.slow
@pytest.mark.usefixtures("patient")
def test_a_scheduler_that_dies_ends_the_command_in_one_line_and_the_next_one_goes_on(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    port, job = free_port(), ToyJob.at(tmp_path, seconds=0.4)
    where = Engine(scheduler=f"tcp://127.0.0.1:{port}")
    with ThreadPoolExecutor(1) as pool, dask(*worker(port)):
        with dask(*scheduler(port)):
            work = pool.submit(run, job, where)
            wait_for_blocks(tmp_path, 2)
        with pytest.raises(InputError, match="is gone; start it again and repeat the command"):
            work.result(LONGEST_WAIT_S)
        with dask(*scheduler(port)), dask(*worker(port)):
            run(job, where)
            with pytest.raises(InputError, match=r"^a bad block; mend it \(worker on .*\)$"):
                run(ToyJob.at(tmp_path / "bad", bad=5), where)
    assert parts_of(tmp_path) == undisturbed


def devices_of(session: ToySession, number: int) -> tuple[str | None, str | None]:
    return os.environ.get(DEVICE_VARIABLE), os.environ.get(CUDA_VARIABLE)


@pytest.mark.slow
def test_processes_draw_and_trace_on_the_devices_of_their_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CUDA numbers GPUs in another order; only machines with GPUs can test EGL's numbers."""
    monkeypatch.delenv(DEVICE_VARIABLE, raising=False)
    monkeypatch.delenv(CUDA_VARIABLE, raising=False)
    monkeypatch.setattr(blocks, "_gpus", lambda: (2,))
    monkeypatch.setattr(context, "cuda_index", {3: 1}.get)
    job = ToyJob.at(tmp_path)
    with open_workers(Engine(workers=1, devices=(3, 4)), len(NUMBERS)) as workers:
        assert workers.ask(job, devices_of, 0)[0] == "3"
    with open_workers(Engine(), len(NUMBERS)) as workers:  # the only GPU of the machine
        assert (workers.count, workers.ask(job, devices_of, 0)[0]) == (1, "2")
    # Both calls are sent before the first answer, so that each process answers one.
    with open_workers(Engine(workers=2, devices=(3, 5)), len(NUMBERS)) as workers:
        answers = dict(answer for _, answer in workers.map(job, devices_of, range(2)))
    assert answers == {"3": "1", "5": None}


# Parts of a table: returned as written, or made again if damaged

ROWS = pa.table({"column": [1, 2, 3], "value": [0.5, None, 1.5], "word": ["a", None, "c"]})


@pytest.fixture
def parts(tmp_path: Path) -> ParquetParts:
    parts = ParquetParts(out=tmp_path, name="rows.parquet")
    parts.open({"scene": "a", "near": 1})
    parts.write(0, ROWS)
    return parts


def test_our_reader_and_pyarrow_return_a_part_as_written(parts: ParquetParts) -> None:
    assert parts.finished(0) and not parts.finished(1) and not parts.damaged(1)
    assert parts.read(0).equals(ROWS)
    assert pq.read_table(parts.folder).equals(ROWS)


def test_a_flipped_bit_of_a_part_is_noticed_or_changes_nothing(parts: ParquetParts) -> None:
    path, noticed = parts.path(0), 0
    whole = path.read_bytes()
    for bit in random.Random(0).sample(range(8 * len(whole)), 400):
        content = bytearray(whole)
        content[bit // 8] ^= 1 << bit % 8
        path.write_bytes(content)
        noticed += parts.damaged(0)
        assert parts.damaged(0) or parts.read(0).equals(ROWS), bit
    assert noticed > 200
    path.write_bytes(whole[:-1])
    with pytest.raises(InputError, match="is missing or damaged; repeat the command"):
        parts.read(0)
    parts.write(0, ROWS)
    assert path.read_bytes() == whole


@pytest.mark.parametrize("spoil", [lambda path: pq.write_table(ROWS, path), os.mkfifo])
def test_an_invalid_part_counts_as_damaged_and_is_replaced(
    spoil: Callable[[Path], object], parts: ParquetParts
) -> None:
    parts.path(0).unlink()
    spoil(parts.path(0))
    assert parts.damaged(0)
    parts.write(0, ROWS)
    assert parts.read(0).equals(ROWS)


def test_a_folder_is_continued_with_the_same_work_alone(
    parts: ParquetParts, tmp_path: Path
) -> None:
    parts.open({"scene": "a", "near": 1})
    with pytest.raises(InputError, match=r"begun with another near \(near was 1, now 2\);"):
        parts.open({"scene": "a", "near": 2})
    description = parts.folder / "_description.json"
    description.unlink()
    os.mkfifo(description)
    with pytest.raises(InputError, match="begun with another description"):
        parts.open({"scene": "a", "near": 1})
    (tmp_path / "empty").mkdir()
    ParquetParts(out=tmp_path, name="empty").open({})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "rows.parquet").touch()
    with pytest.raises(InputError, match="was not begun by this command"):
        ParquetParts(out=tmp_path, name="mine").open({})
