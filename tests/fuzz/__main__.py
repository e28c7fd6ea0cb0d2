"""`make fuzz`: run many mutated inputs of each kind, and count the exit statuses.

Run as `python -m tests.fuzz [--kind KIND] [--count N] [--seed S] [--jobs J] [--keep DIR]
[--replay]`.
"""

import argparse
import hashlib
import importlib
import json
import math
import multiprocessing
import os
import random
import sys
import time
from collections import Counter
from pathlib import Path

from PIL import Image

from tests.fuzz import mutations
from tests.fuzz.child import findings, outcome_of
from tests.fuzz.inputs import KINDS, Seed, with_payload
from xfrustum.reference.llvm import THREADS_VARIABLE

CORPUS = Path(__file__).parent / "corpus"
BATCH = 50  # number of inputs in one task of a worker
PREPARED = (
    *("tests.fuzz.entries", "skimage.measure"),
    *("xfrustum.cli.main", "xfrustum.compare", "xfrustum.raster", "xfrustum.reference"),
    *("xfrustum.reports.image_files", "xfrustum.reports.plate.plate"),
    *("xfrustum.reports.scene_check.checking", "xfrustum.reports.exchange.convert"),
    *("xfrustum.reports.conformance", "xfrustum.reports.device"),
    "xfrustum.reports.verification.verification",
)
"""Modules that child processes use, including modules that other libraries import late."""


def attacked(seed: Seed, number: int) -> tuple[tuple[str, ...], dict[str, bytes], bytes]:
    """Return the command, files and mutated names of an input; equal numbers give equal inputs."""
    chance = random.Random(f"{seed.name} {number}")
    files = dict(seed.files)
    if not seed.mutated:
        command = mutations.mutated_arguments(seed.command, chance)
        return command, files, json.dumps(command).encode("utf-8", "surrogatepass")
    payload = getattr(mutations, seed.how)(files[seed.mutated], chance)
    return seed.command, with_payload(seed, payload), payload


def batch_of(work: tuple[Seed, range, Path | None]) -> tuple[Counter[str], list[str]]:
    """Run a batch of inputs; return the counts by exit status and the lines about findings."""
    seed, numbers, keep = work
    counts: Counter[str] = Counter()
    lines = []
    for number in numbers:
        command, files, payload = attacked(seed, number)
        outcome = outcome_of(command, files)
        counts["hang" if outcome.hung else str(outcome.status)] += 1
        for finding in findings(outcome, seed.outputs, named=bool(seed.mutated)):
            counts[finding] += 1
            words = outcome.errors.decode("utf-8", "replace").strip().splitlines()
            lines.append(f"{seed.name} {number}: {finding}: {(words or [''])[-1][:200]!r}")
            if keep is not None:
                name = f"{seed.name}.{finding}.{hashlib.sha256(payload).hexdigest()[:12]}"
                (keep / name).write_bytes(payload)
    return counts, lines


def entries() -> list[Path]:
    """Return the paths of the corpus; a file name joins seed, finding and hash with dots."""
    return sorted(path for path in CORPUS.iterdir() if path.name.count(".") == 2)


def replayed() -> dict[str, list[str]]:
    """Return the findings of every input in the corpus."""
    names = {path.name.split(".")[0] for path in entries()}
    kinds = [kind for kind in KINDS if any(name.startswith(kind) for name in names)]
    seeds = {seed.name: seed for kind in kinds for seed in KINDS[kind]()}
    import_everything()
    results = {}
    for path in entries():
        seed, payload = seeds[path.name.split(".")[0]], path.read_bytes()
        command, files = seed.command, dict(seed.files)
        if seed.mutated:
            files = with_payload(seed, payload)
        else:
            command = tuple(json.loads(payload.decode("utf-8", "surrogatepass")))
        outcome = outcome_of(command, files)
        results[path.name] = list(findings(outcome, seed.outputs, named=bool(seed.mutated)))
    return results


def main(arguments: list[str] | None = None) -> int:
    """Fuzz, print the table, and return 1 if there are any findings."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--kind", choices=sorted(KINDS), action="append", help="default: all")
    parser.add_argument("--count", type=int, default=10_000, help="inputs of each kind")
    parser.add_argument("--seed", type=int, default=0, help="number of the first input")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep", type=Path, help="folder for the inputs that found something")
    parser.add_argument(
        "--replay", action="store_true", help="print, as JSON, what the corpus finds again"
    )
    chosen = parser.parse_args(arguments)
    if chosen.replay:
        print(json.dumps(replayed()))
        return 0
    if chosen.keep is not None:
        chosen.keep.mkdir(parents=True, exist_ok=True)
    seeds = {kind: KINDS[kind]() for kind in chosen.kind or KINDS}
    import_everything()
    failed = not all(_is_valid(seed) for of_kind in seeds.values() for seed in of_kind)
    with multiprocessing.get_context("fork").Pool(chosen.jobs) as workers:
        for kind, of_kind in seeds.items():
            start, total = time.monotonic(), sum(seed.share for seed in of_kind)
            work = [
                (seed, range(first, min(first + BATCH, end)), chosen.keep)
                for seed in of_kind
                for end in [chosen.seed + math.ceil(chosen.count * seed.share / total)]
                for first in range(chosen.seed, end, BATCH)
            ]
            counts: Counter[str] = Counter()
            for more, lines in workers.imap_unordered(batch_of, work):
                counts += more
                for line in lines:
                    print(line, file=sys.stderr, flush=True)
            inputs, took_s = sum(len(numbers) for _, numbers, _ in work), time.monotonic() - start
            counted = ", ".join(f"{name}: {count:,}" for name, count in sorted(counts.items()))
            print(f"{kind}: {inputs:,} inputs in {took_s:.0f} s: {counted}", flush=True)
            failed |= bool(counts.keys() - {"0", "1", "2"})
    return int(failed)


def _is_valid(seed: Seed) -> bool:
    """Return whether a seed is valid; damage to an invalid seed reveals nothing."""
    files = with_payload(seed, seed.files[seed.mutated]) if seed.mutated else dict(seed.files)
    outcome = outcome_of(seed.command, files)
    if outcome.status not in (0, 1):
        print(
            f"{seed.name}: not valid itself: {outcome.errors!r:.300}", file=sys.stderr, flush=True
        )
    return outcome.status in (0, 1)


def import_everything() -> None:
    """Import all modules once in the parent: a fork takes a hundredth of the time.

    The parent computes nothing: threads of Dr.Jit and OpenMP do not survive a fork.
    """
    os.environ[THREADS_VARIABLE] = "1"
    for name in PREPARED:
        importlib.import_module(name)
    # Without this cache, every child would search for the entry points again.
    Image.init()


if __name__ == "__main__":
    raise SystemExit(main())
