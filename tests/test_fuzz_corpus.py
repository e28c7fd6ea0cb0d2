"""What fuzzing once found stays found: every input of the corpus ends as every input must."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.child import Outcome
from tests.fuzz.findings import findings
from tests.fuzz.inputs import seed_named
from tests.fuzz.mutations import mutated

CORPUS = sorted((Path(__file__).parent / "fuzz" / "corpus").glob("*.*"))


def outcome_in_a_process_of_its_own(name: str, payload: bytes) -> list[str]:
    """Return what is found of an input.

    The process is started anew and not forked: this one may have threads and an OpenGL context.
    """
    program = (
        "import json, sys\n"
        "from tests.fuzz.child import outcome_of\n"
        "from tests.fuzz.child import Outcome
from tests.fuzz.findings import findings\n"
        "from tests.fuzz.inputs import seed_named\n"
        "seed, payload = seed_named(sys.argv[1]), sys.stdin.buffer.read()\n"
        "command, files = seed.command, dict(seed.files)\n"
        "if seed.mutated: files[seed.mutated] = payload\n"
        "else: command = tuple(json.loads(payload.decode('utf-8', 'surrogatepass')))\n"
        "found = findings(outcome_of(command, files), seed.outputs, named=bool(seed.mutated))\n"
        "print(json.dumps(list(found)))\n"
    )
    checkout = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-c", program, name], input=payload, cwd=checkout, capture_output=True, check=True
    )
    return list(json.loads(done.stdout))


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_no_input_of_the_corpus_finds_anything_again(path: Path) -> None:
    assert outcome_in_a_process_of_its_own(path.name.split(".")[0], path.read_bytes()) == []


def test_mutations_depend_on_their_seed_alone_and_change_something() -> None:
    data = bytes(range(256)) + b"size = [10.0, 8.0]\n"
    once = [mutated(data, random.Random(number)) for number in range(50)]
    again = [mutated(data, random.Random(number)) for number in range(50)]
    assert once == again
    assert sum(piece != data for piece in once) > 40
    assert len(set(once)) > 40


def test_every_finding_is_found() -> None:
    assert seed_named("patches-two").mutated == "a.bpt"

    def told(**changes: object) -> list[str]:
        fine = {"status": 2, "errors": b"xfrustum: error: no\n", "output": b"", "peak_bytes": 1}
        fine |= {"wall_s": 0.1, "hung": False, "left": frozenset()}
        return list(findings(Outcome(**(fine | changes)), frozenset({"out.exr"}), named=True))  # type: ignore[arg-type]

    assert told() == []
    assert told(hung=True, status=-9) == ["hang"]
    assert told(status=-11, errors=b"") == ["signal-11"]
    assert told(status=70, errors=b"xfrustum: error: bug\n") == ["status-70"]
    assert told(errors=b"Traceback (most recent call last):\nxfrustum: error: x\n") == ["traceback"]
    assert told(errors=b"libpng error: read\nxfrustum: error: x\n") == ["foreign-words"]
    assert told(errors=b"") == ["not-one-line"]
    assert told(errors=b"xfrustum: error: a\x1b[31m\n") == ["control-characters"]
    assert told(peak_bytes=3 << 30) == ["memory"]
    assert told(left=frozenset({"out.exr"})) == ["leftovers"]
    assert told(left=frozenset({"out.exr"}), status=0, errors=b"xfrustum: note\n") == []
