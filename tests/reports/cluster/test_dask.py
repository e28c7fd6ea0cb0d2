"""Blocks done by the workers of a Dask cluster, some of which are killed."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.reports.cluster.dask_processes import dask, free_port, scheduler, worker
from tests.reports.cluster.toy_work import ToyJob, made, parts_of, process_of
from xfrustum.reports.cluster import cluster
from xfrustum.reports.cluster.run import Engine, Team, open_team, run_blocks
from xfrustum.scenes import InputError, open_scene

LONGEST_WAIT_S = 120


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("undisturbed")
    run(ToyJob.at(out), Engine(workers=1))
    return parts_of(out)


def run(job: ToyJob, engine: Engine) -> None:
    with open_team(engine, len(job.numbers), open_scene("car")) as team:
        do(job, team)


def do(job: ToyJob, team: Team) -> None:
    run_blocks(job, job.numbers, team, job.blocks.hogels(0), "toy")


def wait_for_blocks(out: Path, count: int) -> None:
    end = time.monotonic() + LONGEST_WAIT_S
    while len(made(out)) < count:
        assert time.monotonic() < end
        time.sleep(0.02)


def kill_somebody(out: Path, after: int) -> int:
    """Kill the process that made the last block, when there are so many; return which."""
    wait_for_blocks(out, after)
    _, process = made(out)[-1]
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)
    return process


def test_a_killed_worker_is_replaced_and_the_result_is_the_same_byte_for_byte(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job, killed = ToyJob.at(tmp_path, seconds=0.2), []
    lines: list[str] = []
    with open_team(Engine(workers=2), len(job.numbers), open_scene("car"), lines.append) as team:
        killer = threading.Thread(target=lambda: killed.append(kill_somebody(tmp_path, 3)))
        killer.start()
        do(job, team)
        killer.join()
        assert team.workers == 2
        assert team.ask(job, process_of) not in (os.getpid(), *killed)
    assert lines[0].startswith("dashboard: http://127.0.0.1:")
    processes = {process for _, process in made(tmp_path)}
    assert parts_of(tmp_path) == undisturbed
    assert sorted(number for number, _ in made(tmp_path)) == list(job.numbers)
    assert len(processes) > 1
    for process in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


@pytest.mark.slow
def test_a_killed_worker_and_a_restarted_scheduler_change_no_byte(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    port = free_port()
    job = ToyJob.at(tmp_path, seconds=0.4)
    work = threading.Thread(target=run, args=(job, Engine(scheduler=f"tcp://127.0.0.1:{port}")))
    with dask(*worker(port)), dask(*worker(port)):
        with dask(*scheduler(port)):
            work.start()
            kill_somebody(tmp_path, 2)
            wait_for_blocks(tmp_path, 4)
        with dask(*scheduler(port)), dask(*worker(port)), dask(*worker(port)):
            work.join(LONGEST_WAIT_S)
            assert not work.is_alive()
    assert parts_of(tmp_path) == undisturbed
    assert sorted(number for number, _ in made(tmp_path)) == list(job.numbers)


@pytest.mark.slow
def test_a_scheduler_may_be_gone_for_longer_than_a_client_tries(
    tmp_path: Path, undisturbed: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1)
    port, job = free_port(), ToyJob.at(tmp_path, seconds=0.4)
    work = threading.Thread(target=run, args=(job, Engine(scheduler=f"tcp://127.0.0.1:{port}")))
    with dask(*scheduler(port)), dask(*worker(port)):
        time.sleep(4)  # a client that tries for a second only must find it there
        work.start()
        wait_for_blocks(tmp_path, 2)
    time.sleep(6)
    assert work.is_alive()
    assert len(made(tmp_path)) < len(job.numbers)
    with dask(*scheduler(port)), dask(*worker(port)):
        work.join(LONGEST_WAIT_S)
        assert not work.is_alive()
    assert parts_of(tmp_path) == undisturbed


@pytest.mark.slow
def test_twenty_random_kills_change_no_byte(tmp_path: Path) -> None:
    calm, wild = ToyJob.at(tmp_path / "calm", (16, 12)), ToyJob.at(tmp_path / "wild", (16, 12), seconds=0.3)
    run(calm, Engine(workers=1))
    chance, over = random.Random(1), threading.Event()
    kills = 0

    def kill_at_random() -> None:
        nonlocal kills
        while kills < 20 and not over.wait(chance.uniform(0.0, 1.5)):
            known = made(wild.parts.out)
            if known:
                with suppress(ProcessLookupError):
                    os.kill(known[-1][1], signal.SIGKILL)
                    kills += 1

    killer = threading.Thread(target=kill_at_random)
    killer.start()
    run(wild, Engine(workers=2))
    over.set()
    killer.join()
    assert kills >= 3
    assert parts_of(wild.parts.out) == parts_of(calm.parts.out)
    assert sorted(number for number, _ in made(wild.parts.out)) == list(wild.numbers)


@pytest.mark.slow
def test_two_clients_on_one_store_lose_nothing_and_do_nothing_twice(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    job = ToyJob.at(tmp_path, seconds=0.2)
    clients = [threading.Thread(target=run, args=(job, Engine(workers=2))) for _ in range(2)]
    for client in clients:
        client.start()
    for client in clients:
        client.join(LONGEST_WAIT_S)
    assert parts_of(tmp_path) == undisturbed
    assert sorted(number for number, _ in made(tmp_path)) == list(job.numbers)


def test_a_scheduler_that_does_not_answer_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--scheduler tcp://127.0.0.1:9: no scheduler answers there"):
        run(ToyJob.at(tmp_path), Engine(scheduler="tcp://127.0.0.1:9"))
