"""`make kill`: signals at random moments of every command: how it ends, what it leaves, whether it goes on.

Run as `python -m tests.fuzz.kill [--count N] [--jobs J] [--command NAME]`. Moments are spread over the whole
life of the process. Those before the program's first line, while Python starts, are counted apart: there
nobody can answer a signal yet.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.fuzz.killing import ENDS, SIGNALS, Ending, killed, problems
from tests.fuzz.victims import Victim, undisturbed, victims


def main(arguments: list[str] | None = None) -> int:
    """Kill, print the table, and return 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kill", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="of each signal, for each command")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--command", action="append", help="report, plate, verify, verify-command or study")
    chosen = parser.parse_args(arguments)
    found = 0
    for victim in victims(Path(__file__).resolve().parents[2]):
        if chosen.command is None or victim.name in chosen.command:
            with ThreadPoolExecutor(chosen.jobs) as pool:
                found += sum(1 for _ in _tried(victim, chosen.count, chosen.jobs, pool))
    print(f"{found} problems")
    return int(found > 0)


def _tried(victim: Victim, count: int, jobs: int, pool: ThreadPoolExecutor) -> Iterator[str]:
    """Kill one victim with every signal; print a line for each, and yield what was found."""
    # As many run at once as will be killed at once; at least two, to find which output is always the same.
    whole = undisturbed(list(pool.map(lambda _: victim.run(), range(max(2, jobs)))))
    silent = f"{whole.silent_s:.2f} s before its first line"
    print(f"{victim.name}: undisturbed {whole.length_s:.1f} s, of which {silent}", flush=True)
    for number in SIGNALS:
        endings = list(pool.map(lambda seed: killed(victim, number, seed, whole), range(count)))  # noqa: B023
        wrong = [problem for ending in endings for problem in problems(victim, number, ending, whole)]
        print(_row(number, endings, wrong), flush=True)
        yield from wrong


def _row(number: signal.Signals, endings: list[Ending], wrong: list[str]) -> str:
    """Return the outcome of one signal, in one line."""
    early = [ending for ending in endings if ending.early]
    statuses = Counter(ending.status for ending in endings if not ending.early)
    told = [f"{status}: {n}" for status, n in sorted(statuses.items())]
    if early:
        apart = Counter(ending.status for ending in early)
        which = ", ".join(f"{status}: {n}" for status, n in sorted(apart.items()))
        latest = max(ending.moment_s for ending in early)
        told.append(f"before the first line {which} (latest at {latest:.2f} s)")
    late = sum(not ending.sent for ending in endings)
    hit = [ending for ending in endings if ending.status == ENDS[number] and not ending.early]
    again = [ending.again for ending in endings if ending.again is not None]
    parts = [
        f"  {number.name} {len(endings)}: statuses {', '.join(told)}",
        f"{late} were done before",
        f"ended within {max((ending.lasted_s for ending in hit), default=0.0):.2f} s",
        f"left hidden until the next run {sum(bool(ending.hidden) for ending in hit)}",
        f"second runs {again.count('')} of {len(again)} complete",
    ]
    if any(ending.children for ending in endings):
        parts.append(f"renderer at work {sum(bool(ending.children) for ending in endings)}")
    parts.append(f"{len(wrong)} problems {dict(Counter(wrong)) or ''}".rstrip())
    return "; ".join(parts)


if __name__ == "__main__":
    sys.exit(main())
