"""Comparison of each reader with a shape that is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.second_reader.compare import differences, product_triangles
from tests.second_reader.making import Case
from tests.second_reader.model import Reading, Refused
from tests.second_reader.reading import read
from xfrustum.scenes import InputError


def second_reads(case: Case, folder: Path) -> str | None:
    """Return how the second reader's polygons differ from those of a case, in order and in number."""
    try:
        reading = read(case.write(folder))
    except Refused as refusal:
        return None if case.polygons is None else f"refused: {refusal}"
    if case.polygons is None:
        return f"{len(reading.polygons)} polygons, though it has no right reading"
    if len(reading.polygons) != len(case.polygons):
        return f"{len(reading.polygons)} polygons for {len(case.polygons)}"
    pairs = zip(reading.polygons, case.polygons, strict=True)
    for number, ((mine, right), bound) in enumerate(zip(pairs, reading.rounding, strict=True)):
        if len(mine) != len(right):
            return f"polygon {number} has {len(mine)} corners for {len(right)}"
        turned = [np.abs(np.roll(mine, k, axis=0) - right).max() for k in range(len(mine))]
        if min(turned) > 2 * bound:  # the closed form is rounded, too
            return f"polygon {number} is off by {min(turned):g}"
    return None


def product_reads(case: Case, folder: Path) -> str | None:
    """Return how the product's triangles differ from a case, whose polygons they may cut in any right way."""
    path = case.write(folder)
    try:
        triangles = product_triangles(path)
    except InputError as refusal:
        return None if case.polygons is None else f"refused: {refusal}"
    if case.polygons is None:
        return f"{len(triangles)} triangles, though it has no right reading"
    bounds = [2 * bound for bound in read(path).rounding]
    difference, _, _ = differences(triangles, Reading(case.polygons, bounds))
    return difference
