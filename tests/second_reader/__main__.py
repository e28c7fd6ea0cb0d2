"""Table of both readings: `python -m tests.second_reader FILE..`; exit status 1 where one differs."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from tests.second_reader.compare import Row, Side, compare


def lines(names: Iterable[tuple[str, Path]]) -> tuple[list[str], int]:
    """Return the table of files and the count of those that differ."""
    table, differ = [f"{'file':32} {'triangles':>9} {'area':>13}  bounds"], 0
    for name, path in names:
        row = compare(path)
        differ += row.difference is not None
        table.append(f"{name:32} {said(row.product)}  product")
        table.append(f"{'':32} {said(row.second)}  second reader")
        table.append(f"{'':32} {verdict(row)}")
    table.append(f"{differ} of {(len(table) - 1) // 3} files differ")
    return table, differ


def said(side: Side) -> str:
    """Return the figures of one reading."""
    if side.bounds is None:
        return f"refused: {side.refusal}"
    low, high = ("(" + ", ".join(f"{value:.6g}" for value in corner) + ")" for corner in side.bounds)
    return f"{side.triangles:9,} {side.area:13.8g}  {low} to {high}"


def verdict(row: Row) -> str:
    """Return the outcome of a comparison."""
    if row.difference:
        return f"DIFFERS: {row.difference}"
    if row.product.refusal:
        return "equal: both refuse"
    order = "in order" if row.order else "in another order"
    return f"equal, {order}, within {row.distance:.2g}"


def main(arguments: list[str]) -> int:
    """Print the table of the files named."""
    if not arguments:
        sys.stderr.write("usage: python -m tests.second_reader FILE..\n")
        return 2
    table, differ = lines((Path(name).name, Path(name)) for name in arguments)
    sys.stdout.write("\n".join(table) + "\n")
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
