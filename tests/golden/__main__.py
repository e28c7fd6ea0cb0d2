"""`python -m tests.golden compare|make`: compare this checkout with the corpus, or make one."""

import argparse
import gzip
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.golden import answers, truths
from tests.golden.answers import OF_THE_RUN, is_expected

HERE = Path(__file__).resolve().parent
PARTS = ("truths", "rasters", "answers", "wrong-renderers")

MAX_LINES = 200
"""Largest number of printed differences of a part."""

SINGLE = float(np.finfo(np.float32).eps)
"""Rounding of float32, the type of stored reals; the order of additions may change sums by a few
roundings.
"""
REAL = 1e-9
"""Relative tolerance of reals in answers: sums of 10^6 doubles err by at most 10^6 * 2^-53."""
FLIP = 1e-5
"""Relative tolerance of means of FLIP. Its library sums filters in float32, with tens of terms
each, in an order that depends on the processor.
"""


@dataclass(kw_only=True)
class Difference:
    """Numbers of compared values, and differences."""

    compared: int = 0
    differ: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)
    new: list[str] = field(default_factory=list)

    def say(self, part: str) -> None:
        known = sum(is_expected(line) for line in (*self.differ, *self.gone))
        counts = f"{len(self.differ)} differ, {len(self.gone)} gone, {len(self.new)} new"
        print(f"{part}: {self.compared:,} values compared, {counts}; {known} are explained")
        for title, lines in (("differs", self.differ), ("gone", self.gone), ("new", self.new)):
            for line in [line for line in lines if not is_expected(line)][:MAX_LINES]:
                print(f"  {title}: {line}")


def compare_arrays(old: Mapping[str, Any], new: Mapping[str, Any]) -> Difference:
    """Compare integers bit for bit, and reals to a few float32 roundings of the largest value."""
    tally = Difference(gone=sorted(set(old) - set(new)), new=sorted(set(new) - set(old)))
    for key in sorted(set(old) & set(new)):
        a, b = np.asarray(old[key]), np.asarray(new[key])
        tally.compared += a.size
        if a.shape != b.shape:
            tally.differ.append(f"{key}: shape {b.shape}, was {a.shape}")
            continue
        if a.dtype.kind == "f":
            # Colors and points are sums of fewer than 8 rounded products, each at most the largest
            # value.
            bound = 8 * SINGLE * max(float(np.nanmax(np.abs(a), initial=0)), 1e-30)
            wrong = ~(np.isclose(a, b, rtol=0, atol=bound, equal_nan=True))
        else:
            wrong = a != b
        if wrong.any():
            tally.differ.append(f"{key}: {int(wrong.sum())} of {a.size} values")
    return tally


def alike(a: object, b: object, place: str = "") -> bool:
    """Return whether two leaves of an answer are equal, reals up to rounding."""
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=FLIP if place.endswith("flip") else REAL, abs_tol=1e-12)
    return a == b


def compare_answers(
    old: Mapping[str, Mapping[str, Any]], new: Mapping[str, Mapping[str, Any]]
) -> Difference:
    """Compare leaf by leaf, and list keys that were removed or added."""
    tally = Difference(gone=sorted(set(old) - set(new)))
    for name in sorted(set(old) & set(new)):
        a, b = old[name], new[name]
        kept = [place for place in a if not OF_THE_RUN.search(place.rpartition(".")[2].lower())]
        tally.gone += [f"{name}{place}" for place in kept if place not in b]
        tally.new += [f"{name}{place}" for place in b if place not in a]
        for place in a.keys() & b.keys():
            tally.compared += 1
            if not alike(a[place], b[place], place):
                tally.differ.append(f"{name}{place}: {b[place]!r}, was {a[place]!r}")
    return tally


def wrong_renderers() -> dict[str, str]:
    """Return verdict and findings of each wrong renderer of the world "harbor", by its name."""
    words = [sys.executable, "-m", "tests.wrong_renderers", "--scene", "harbor"]
    words += ["--encoding", "triangle-id", "--group", "classic"]
    printed = subprocess.run(
        words, capture_output=True, text=True, check=True, cwd=HERE.parents[1]
    ).stdout
    return by_renderer(printed)


def by_renderer(table: str) -> dict[str, str]:
    """Return the rows of a table by the description of the renderer, without head and truth."""
    rows = [line.split("|") for line in table.splitlines() if "harbor" in line]
    return {row[2].strip(): "|".join(row[4:10]).strip() for row in rows}


def make(folder: Path, parts: list[str]) -> None:
    """Write the corpus of this checkout."""
    folder.mkdir(parents=True, exist_ok=True)
    for part, arrays in (("truths", truths.truths), ("rasters", truths.rasters)):
        if part in parts:
            np.savez_compressed(folder / f"{part}.npz", **arrays())  # type: ignore[arg-type]
    if "answers" in parts:
        with tempfile.TemporaryDirectory() as out:
            made = answers.answers(Path(out))
        with gzip.open(folder / "answers.json.gz", "wt") as file:
            json.dump(made, file)
    if "wrong-renderers" in parts:
        rows = [
            f"| harbor | {name} | triangle-id | {outcome}"
            for name, outcome in wrong_renderers().items()
        ]
        (folder / "wrong-renderers.txt").write_text("\n".join(rows) + "\n")


def compare(parts: list[str]) -> bool:
    """Print the differences from the corpus, part by part; return whether there are none."""
    tallies: dict[str, Difference] = {}
    for part, arrays in (("truths", truths.truths), ("rasters", truths.rasters)):
        if part in parts:
            tallies[part] = compare_arrays(np.load(HERE / f"{part}.npz"), arrays())
    if "answers" in parts:
        with (
            tempfile.TemporaryDirectory() as out,
            gzip.open(HERE / "answers.json.gz", "rt") as file,
        ):
            tallies["answers"] = compare_answers(json.load(file), answers.answers(Path(out)))
    if "wrong-renderers" in parts:
        old = by_renderer((HERE / "wrong-renderers.txt").read_text())
        tallies["wrong-renderers"] = compare_answers({"": old}, {"": wrong_renderers()})
    for part, tally in tallies.items():
        tally.say(part)
    return all(
        is_expected(line) for tally in tallies.values() for line in (*tally.differ, *tally.gone)
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("action", choices=("compare", "make"))
    parser.add_argument(
        "words", nargs="*", help="parts to compare, or the folder to write and parts"
    )
    arguments = parser.parse_args()
    folder = arguments.words[:1] if arguments.action == "make" else []
    parts = arguments.words[len(folder) :] or list(PARTS)
    if arguments.action == "make":
        make(Path(folder[0]), parts)
        return 0
    return 0 if compare(parts) else 1


if __name__ == "__main__":
    sys.exit(main())
