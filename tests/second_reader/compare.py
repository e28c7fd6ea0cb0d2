"""Comparison of the product's reading of a file with the second reader's."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.second_reader import gltf
from tests.second_reader.model import UNIT, Floats, Reading, Refused
from tests.second_reader.polygons import area, cut, is_cut_of, key, newell
from tests.second_reader.reading import read
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh


@dataclass(frozen=True)
class Side:
    """Figures of one reading, or its refusal."""

    triangles: int = 0
    area: float = 0.0
    bounds: tuple[Floats, Floats] | None = None
    refusal: str | None = None


@dataclass(frozen=True)
class Row:
    """Both readings of a file."""

    product: Side
    second: Side
    difference: str | None  #: None where the readings are equal, or both refuse
    order: bool  #: triangles come in the same order
    distance: float  #: largest difference of a coordinate of two triangles that belong together


def product_triangles(path: Path) -> Floats:
    """Return the product's triangles of a file, (F, 3, 3)."""
    mesh = load_mesh(path)
    return np.asarray(mesh.vertices[mesh.faces], dtype=np.float64)


def side(triangles: Floats) -> Side:
    """Measure triangles."""
    corners = triangles.reshape(-1, 3)
    a, b, c = np.moveaxis(triangles, 1, 0)
    total = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return Side(len(triangles), float(total), (corners.min(axis=0), corners.max(axis=0)))


def compare(path: Path) -> Row:
    """Read a file with both readers."""
    mine: Reading | None = None
    theirs: Floats | None = None
    try:
        mine = read(path)
        second = side(np.array([one for polygon in mine.polygons for one in cut(polygon)]))
    except Refused as refusal:
        second = Side(refusal=str(refusal))
    try:
        theirs = product_triangles(path)
        product = side(theirs)
    except InputError as refusal:
        product = Side(refusal=str(refusal))
    if second.refusal is not None or product.refusal is not None:
        both = second.refusal is not None and product.refusal is not None
        refuser = "the product" if product.refusal is not None else "the second reader"
        return Row(product, second, None if both else f"{refuser} alone refuses", True, 0.0)
    assert mine is not None
    assert theirs is not None
    difference, order, distance = differences(theirs, mine)
    if difference and path.suffix.lower() in (".glb", ".gltf"):
        # Quaternions as they are stored, not quite of unit length, are right, too.
        difference, order, distance = differences(theirs, gltf.read(path, unit=False))
    return Row(product, second, difference, order, distance)


def differences(product: Floats, reading: Reading) -> tuple[str | None, bool, float]:
    """Return the first difference, whether the order is equal, and the largest distance."""
    expected = sum(len(polygon) - 2 for polygon in reading.polygons)
    if len(product) != expected:
        return f"{len(product)} triangles for {expected}", False, np.inf
    if any(len(polygon) > 3 for polygon in reading.polygons):
        return polygons_differ(product, reading)
    mine, bounds = np.array(reading.polygons), np.array(reading.rounding)
    if not reading.oriented:
        product, mine = without_orientation(product), without_orientation(mine)
    gaps = np.min(
        [np.abs(np.roll(product, k, axis=1) - mine).max(axis=(1, 2)) for k in range(3)], axis=0
    )
    if (gaps <= bounds).all():
        return None, True, float(gaps.max())
    (one, _), (other, order) = in_order(product), in_order(mine)
    gaps = np.abs(one - other).max(axis=(1, 2))
    if (gaps <= bounds[order]).all():
        return None, False, float(gaps.max())
    return matched(product, mine, bounds)


def without_orientation(soup: Floats) -> Floats:
    """Sort the corners of each triangle."""
    rounded = np.round(soup / (np.abs(soup).max() or 1.0), 9) + 0.0
    return np.array([one[np.lexsort(key.T[::-1])] for one, key in zip(soup, rounded, strict=True)])


def in_order(soup: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Rotate each triangle to its least corner, and sort the triangles; return their order, too."""
    rounded = np.round(soup / (np.abs(soup).max() or 1.0), 9) + 0.0  # equal triangles sort alike
    least = [np.lexsort(corners.T[::-1])[0] for corners in rounded]
    turned = (np.arange(3) + np.array(least)[:, None]) % 3
    rows = np.arange(len(soup))[:, None]
    order = np.lexsort(rounded[rows, turned].reshape(-1, 9).T[::-1])
    return soup[rows, turned][order], order


def matched(product: Floats, mine: Floats, bounds: Floats) -> tuple[str | None, bool, float]:
    """Pair triangles of two soups in any order, each once, corners rotated but not exchanged."""
    size = float(np.abs(mine).max()) or 1.0
    cell = max(4 * float(bounds.max()), size * 2.0**-30)
    cells: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for number, middle in enumerate(mine.mean(axis=1)):
        cells[_cell(middle, cell)].append(number)
    farthest, unpaired = 0.0, 0
    for triangle in product:
        here = _cell(triangle.mean(axis=0), cell)
        around = [tuple(np.add(here, step)) for step in np.ndindex(3, 3, 3)]
        near = [
            number for step in around for number in cells.get(tuple(int(k) - 1 for k in step), [])
        ]
        gaps = {
            n: min(np.abs(np.roll(triangle, k, axis=0) - mine[n]).max() for k in range(3))
            for n in near
        }
        right = [number for number in near if gaps[number] <= bounds[number]]
        if not right:
            unpaired += 1
            continue
        cells[_cell(mine[right[0]].mean(axis=0), cell)].remove(right[0])
        farthest = max(farthest, gaps[right[0]])
    if unpaired:
        return f"{unpaired} of {len(product)} triangles are others", False, np.inf
    return None, False, farthest


def texture_distance(path: Path) -> float | None:
    """Return the largest difference of a texture coordinate; None where a reading has none.

    Both readings must have the same triangles in the same order.
    """
    mesh, reading = load_mesh(path), read(path)
    if mesh.uv is None or not any(texture is not None for texture in reading.texture):
        return None
    farthest = 0.0
    corners, coordinates = mesh.vertices[mesh.faces], mesh.uv[mesh.faces]
    for k, (polygon, texture) in enumerate(zip(reading.polygons, reading.texture, strict=True)):
        if texture is not None:
            gaps = [np.abs(np.roll(corners[k], turn, axis=0) - polygon).max() for turn in range(3)]
            turned = np.roll(coordinates[k], int(np.argmin(gaps)), axis=0)
            farthest = max(farthest, float(np.abs(turned - texture).max()))
    return farthest


def _cell(point: Floats, size: float) -> tuple[int, ...]:
    return tuple(int(value) for value in np.floor(point / size))


def polygons_differ(product: Floats, reading: Reading) -> tuple[str | None, bool, float]:
    """Test that triangles cut every polygon, each by corners of its own and over its own area."""
    if any(reading.rounding):
        product = snapped(product, reading)
    place, wrong = 0, 0
    for polygon in reading.polygons:
        wrong += not is_cut_of(product[place : place + len(polygon) - 2], polygon)
        place += len(polygon) - 2
    if not wrong:
        return None, True, 0.0
    groups = assigned(product, reading.polygons)
    bad = [k for k, polygon in enumerate(reading.polygons) if not is_cut_of(groups[k], polygon)]
    if not bad:
        return None, False, 0.0
    first = reading.polygons[bad[0]]
    covered = sum(area(triangle) for triangle in groups[bad[0]])
    count = f"{len(bad)} of {len(reading.polygons)} polygons are cut wrong"
    areas = f"area {area(first):.6g}, its triangles {covered:.6g}"
    return f"{count}: number {bad[0] + 1} of {len(first)} corners has {areas}", False, np.inf


def assigned(product: Floats, polygons: list[Floats]) -> list[Floats]:
    """Give each triangle to a polygon that has its corners, faces its way and lacks triangles."""
    owners: dict[tuple[float, ...], set[int]] = defaultdict(set)
    for number, polygon in enumerate(polygons):
        for corner in polygon:
            owners[key(corner)].add(number)
    groups: list[list[Floats]] = [[] for _ in polygons]
    held: list[list[list[tuple[float, ...]]]] = [[] for _ in polygons]
    for triangle in product:
        shared = set.intersection(*(owners.get(key(corner), set()) for corner in triangle))
        same = [key(corner) for corner in triangle]
        free = [k for k in shared if len(groups[k]) < len(polygons[k]) - 2]
        # A triangle of the file takes its equal first; equal polygons take different triangles.
        free.sort(key=lambda k: (len(polygons[k]), same in held[k], k))
        facing = [k for k in free if newell(triangle) @ newell(polygons[k]) > 0]
        if free:
            groups[(facing or free)[0]].append(triangle)
            held[(facing or free)[0]].append(same)
    return [np.array(group).reshape(-1, 3, 3) for group in groups]


def snapped(product: Floats, reading: Reading) -> Floats:
    """Replace corners by those of the polygons within the bound on rounding."""
    corners = np.unique(np.concatenate(reading.polygons), axis=0)
    bound = max(reading.rounding) + 4 * UNIT
    moved = product.copy()
    for corner in moved.reshape(-1, 3):
        gaps = np.abs(corners - corner).max(axis=1)
        if gaps.min() <= bound:
            corner[:] = corners[gaps.argmin()]
    return moved
