"""Table of both readings: `python -m tests.second_reader FILE..`; exit status 1 on a difference."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.second_reader.compare import Row, Side, compare


def lines(name: str, row: Row) -> list[str]:
    """Return the lines of the table for one file."""
    product, second = f"{said(row.product)}  product", f"{said(row.second)}  second reader"
    return [f"{name:32} {product}", f"{'':32} {second}", f"{'':32} {verdict(row)}"]


def said(side: Side) -> str:
    """Return the figures of one reading."""
    if side.bounds is None:
        return f"refused: {side.refusal}"
    low, high = (
        "(" + ", ".join(f"{value:.6g}" for value in corner) + ")" for corner in side.bounds
    )
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
    sys.stdout.write(f"{'file':32} {'triangles':>9} {'area':>13}  bounds\n")
    differ, triangles = 0, 0
    for path in map(Path, arguments):
        row = compare(path)
        differ += row.difference is not None
        triangles += row.second.triangles
        sys.stdout.write("\n".join(lines(path.name, row)) + "\n")
    sys.stdout.write(f"{len(arguments)} files, {triangles:,} triangles, {differ} differ\n")
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
