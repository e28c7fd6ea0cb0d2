"""Former findings of fuzzing do not recur: every input of the corpus ends correctly."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.fuzz.__main__ import entries
from tests.fuzz.child import Outcome, findings
from tests.fuzz.mutations import mutated, mutated_arguments


@pytest.fixture(scope="module")
def replayed() -> dict[str, list[str]]:
    """Return the findings of each input, from a separate process: threads here forbid forks."""
    checkout = Path(__file__).resolve().parents[1]
    line = [sys.executable, "-m", "tests.fuzz", "--replay"]
    done = subprocess.run(line, cwd=checkout, capture_output=True, check=True)
    return dict(json.loads(done.stdout))


@pytest.mark.slow
@pytest.mark.parametrize("name", [path.name for path in entries()])
def test_no_input_of_the_corpus_finds_anything_again(
    name: str, replayed: dict[str, list[str]]
) -> None:
    assert replayed[name] == []


def test_mutations_depend_on_their_seed_alone_and_change_something() -> None:
    data = bytes(range(256)) + b"size = [10.0, 8.0]\n"
    once, again = ([mutated(data, random.Random(number)) for number in range(50)] for _ in range(2))
    assert once == again and len(set(once) - {data}) > 40
    assert () in {mutated_arguments(("scenes",), random.Random(number)) for number in range(1000)}


def test_every_kind_of_finding_is_detected() -> None:
    fine: dict[str, Any] = {"status": 2, "errors": b"xfrustum: error: no\n", "peak_bytes": 1}
    fine |= {"hung": False, "left": frozenset()}
    left = frozenset({"out.exr"})
    cases: list[tuple[dict[str, Any], list[str]]] = [
        ({}, []),
        ({"hung": True, "status": -9}, ["hang"]),
        ({"status": -11, "errors": b""}, ["signal-11"]),
        ({"status": 70, "errors": b"xfrustum: error: bug\n"}, ["status-70"]),
        ({"errors": b"Traceback (most recent call last):\nxfrustum: error: x\n"}, ["traceback"]),
        ({"errors": b"libpng error: read\nxfrustum: error: x\n"}, ["foreign-words"]),
        ({"errors": b""}, ["not-one-line"]),
        ({"errors": b"xfrustum: error: a\x1b[31m\n"}, ["control-characters"]),
        ({"peak_bytes": 3 << 30}, ["memory"]),
        ({"left": left}, ["leftovers"]),
        ({"left": left, "status": 0, "errors": b"xfrustum: note\n"}, []),
    ]
    for changes, expected in cases:
        assert list(findings(Outcome(**{**fine, **changes}), left, named=True)) == expected
