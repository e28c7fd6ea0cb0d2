"""Comparison of each reader with a shape that is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.second_reader.compare import differences, product_triangles
from tests.second_reader.making import Case
from tests.second_reader.model import Floats, Reading, Refused
from tests.second_reader.polygons import cut, is_cut_of
from tests.second_reader.reading import read
from xfrustum.scenes import InputError


def second_reads(case: Case, folder: Path) -> str | None:
    """Return how the second reader's polygons differ from those of a case."""
    try:
        reading = read(case.write(folder))
        cuts = [np.array(cut(polygon)) for polygon in reading.polygons]
    except Refused as refusal:
        return None if case.polygons is None else f"refused: {refusal}"
    if case.polygons is None:
        return f"{len(reading.polygons)} polygons, though it has no right reading"
    if len(reading.polygons) != len(case.polygons):
        return f"{len(reading.polygons)} polygons for {len(case.polygons)}"
    triples = zip(reading.polygons, case.polygons, reading.rounding, strict=True)
    for number, (mine, right, bound) in enumerate(triples):
        if not _equal(mine, right, bound):
            return f"polygon {number} is another"
        if not is_cut_of(cuts[number], mine):
            return f"polygon {number} is cut wrong"
    return None


def _equal(mine: Floats, right: Floats, bound: float) -> bool:
    turned = [np.roll(mine, k, axis=0) for k in range(len(mine))]
    same = [len(mine) == len(right) and np.abs(one - right).max() <= 2 * bound for one in turned]
    return any(same)  # twice the bound: the closed form is rounded, too


def product_reads(case: Case, folder: Path) -> str | None:
    """Return how the product's triangles differ from a case; any right cut is equal."""
    path = case.write(folder)
    try:
        triangles = product_triangles(path)
    except InputError as refusal:
        return None if case.polygons is None or case.may_refuse else f"refused: {refusal}"
    if case.polygons is None:
        return f"{len(triangles)} triangles, though it has no right reading"
    bounds = [2 * bound for bound in read(path).rounding]
    difference, _, _ = differences(triangles, Reading(case.polygons, bounds))
    return difference
