"""Replay the corpus: `python -m tests.fuzz.replay` prints, as JSON, what each of its inputs finds."""

import json
from pathlib import Path

from tests.fuzz.__main__ import import_everything
from tests.fuzz.child import outcome_of
from tests.fuzz.findings import findings
from tests.fuzz.inputs import KINDS, Seed, with_payload

CORPUS = Path(__file__).parent / "corpus"


def entries() -> list[Path]:
    """Return the corpus; a name is that of the seed, a finding, and a hash, with dots between."""
    return sorted(path for path in CORPUS.iterdir() if path.name.count(".") == 2)


def found_of(seed: Seed, payload: bytes) -> list[str]:
    """Return the findings of one input."""
    command, files = seed.command, dict(seed.files)
    if seed.mutated:
        files = with_payload(seed, payload)
    else:
        command = tuple(json.loads(payload.decode("utf-8", "surrogatepass")))
    return list(findings(outcome_of(command, files), seed.outputs, named=bool(seed.mutated)))


def main() -> None:
    """Replay every input of the corpus."""
    wanted = {path.name.split(".")[0] for path in entries()}
    kinds = [kind for kind in KINDS if any(name.startswith(kind.rstrip("s")) for name in wanted)]
    seeds = {seed.name: seed for kind in kinds for seed in KINDS[kind]()}
    import_everything()
    print(json.dumps({p.name: found_of(seeds[p.name.split(".")[0]], p.read_bytes()) for p in entries()}))


if __name__ == "__main__":
    main()
