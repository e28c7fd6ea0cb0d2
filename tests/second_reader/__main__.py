"""Table of both readings: `python -m tests.second_reader FILE..`; exit status 1 if they differ."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.second_reader.compare import Row, compare


def table(name: str, row: Row) -> str:
    """Return the lines of the table for a file."""
    verdict = f"DIFFERS: {row.difference}" if row.difference else "equal"
    rows = (f"{row.product}  product", f"{row.second}  second reader", verdict)
    return "".join(f"{title:32} {text}\n" for title, text in zip((name, "", ""), rows, strict=True))


def main(arguments: list[str]) -> int:
    """Print the table for some files."""
    if not arguments:
        sys.stderr.write("usage: python -m tests.second_reader FILE..\n")
        return 2
    sys.stdout.write(f"{'file':32} {'triangles':>9} {'area':>13}  bounds\n")
    differing, triangles = 0, 0
    for path in map(Path, arguments):
        row = compare(path)
        differing += row.difference is not None
        triangles += 0 if row.second.triangles is None else len(row.second.triangles)
        sys.stdout.write(table(path.name, row))
    sys.stdout.write(f"{len(arguments)} files, {triangles:,} triangles, {differing} differ\n")
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
