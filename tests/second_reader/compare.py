"""Comparison of the product's triangles of a file with the second reader's polygons."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tests.second_reader import read
from tests.second_reader.model import Floats, Reading, Refused
from tests.second_reader.polygons import Labels, cut, is_cut_of, newell
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh


def product_triangles(path: Path) -> Floats:
    """Return the product's triangles of a file, (F, 3, 3)."""
    mesh = load_mesh(path)
    return np.asarray(mesh.vertices[mesh.faces])


def compare(path: Path) -> str | None:
    """Return the difference of both readings of a file; None if they agree, or both refuse."""
    reading = product = None
    refusals = []
    try:
        reading = read(path)
        _ = [cut(polygon) for polygon in reading.polygons]  # refuses polygons that cross themselves
    except Refused as refusal:
        refusals.append(f"the second reader alone refuses: {refusal}")
    try:
        product = product_triangles(path)
    except InputError as refusal:
        refusals.append(f"the product alone refuses: {refusal}")
    if len(refusals) == 1:
        return refusals[0]
    return difference(product, reading) if product is not None and reading is not None else None


def difference(product: Floats, reading: Reading) -> str | None:
    """Return the first difference of triangles (F, 3, 3) from a reading, with any valid cut."""
    expected = sum(len(polygon) - 2 for polygon in reading.polygons)
    if len(product) != expected:
        return f"{len(product)} triangles for {expected}"
    points = np.concatenate([*reading.polygons, product.reshape(-1, 3)])
    labels = _labels(points, 2 * reading.rounding)
    ends = np.cumsum([len(polygon) for polygon in reading.polygons])
    outlines, corners = np.split(labels[: ends[-1]], ends[:-1]), labels[ends[-1] :].reshape(-1, 3)
    if expected == len(reading.polygons):
        mine, theirs = (_soup(rows, reading.oriented) for rows in (np.array(outlines), corners))
        return None if mine == theirs else f"{len(set(theirs) - set(mine))} triangles are others"
    groups = _assigned(product, corners, reading.polygons, outlines)
    wrong = [
        k
        for k, (polygon, outline) in enumerate(zip(reading.polygons, outlines, strict=True))
        if not is_cut_of(product[groups[k]], corners[groups[k]], polygon, outline)
    ]
    return f"polygons {wrong[:9]} of {len(outlines)} are cut wrong" if wrong else None


def _labels(points: Floats, distance: float) -> Labels:
    """Return labels (K,), equal for points linked by steps of at most a distance."""
    unique, inverse = np.unique(points + 0.0, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    if distance == 0:
        return np.asarray(inverse)
    pairs = cKDTree(unique).query_pairs(distance, p=np.inf, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(unique), len(unique)))
    return np.asarray(connected_components(graph, directed=False)[1][inverse])


def _soup(rows: Labels, oriented: bool) -> list[tuple[int, ...]]:
    """Return triangles in ascending order, each rotated to begin with its least corner."""
    if not oriented:
        rows = np.sort(rows, axis=1)
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in rows.tolist())


def _assigned(
    product: Floats, corners: Labels, polygons: list[Floats], outlines: list[Labels]
) -> list[list[int]]:
    """Assign each triangle to an incomplete polygon with its corners and its orientation."""
    owners: dict[int, set[int]] = defaultdict(set)
    for number, outline in enumerate(outlines):
        for corner in outline.tolist():
            owners[corner].add(number)
    groups: list[list[int]] = [[] for _ in polygons]
    for index, triangle in enumerate(corners.tolist()):
        shared = set.intersection(*(owners[corner] for corner in triangle))
        lacking = [k for k in shared if len(groups[k]) < len(polygons[k]) - 2]
        # Equal polygons receive different triangles; a triangle of the file prefers its equal.
        held = {k: triangle in corners[groups[k]].tolist() for k in lacking}
        turned = {k: newell(product[index]) @ newell(polygons[k]) <= 0 for k in lacking}
        lacking.sort(key=lambda k: (turned[k], len(polygons[k]), held[k], k))
        if lacking:
            groups[lacking[0]].append(index)
    return groups
