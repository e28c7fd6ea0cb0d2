"""Comparison of both readers: `python -m tests.second_reader FILE..`; status 1 if they differ."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.second_reader.compare import compare


def main(arguments: list[str]) -> int:
    """Print a line for each file."""
    differing = 0
    for name in arguments:
        difference = compare(Path(name))
        differing += difference is not None
        sys.stdout.write(f"{name}: {difference or 'equal, or refused by both'}\n")
    sys.stdout.write(f"{len(arguments)} files, {differing} differ\n")
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
