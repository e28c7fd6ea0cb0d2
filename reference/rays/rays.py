"""First surfaces and all surfaces along rays: proven in doubles, or decided in integers.

Embree proposes a triangle for each ray in float32. If doubles prove that the ray meets this
triangle, the triangle's t is an upper limit. Embree has no other use. The walk (`walk`) visits all
triangles that may lie before the limit. The filter (`filter`) keeps triangles that may be first.
Integers decide rays with several possible triangles, or with an uncertain triangle.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Bool,
    Float64,
    Int32,
    UInt32,
    UInt64,
    constants,
    difference,
    dot,
    dr,
    interleaved,
    on_device,
    recording,
    vectors_on_device,
)
from xfrustum.reference.certify.cone import ROUNDING, UNDERFLOW, Triangles
from xfrustum.reference.rays.filter import meet, meetings, nearest_double
from xfrustum.reference.rays.walk import BESIDE, Boxes, Rays, build_tree
from xfrustum.reference.tracers import EmbreeMesh
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask
from xfrustum.scenes.model.images import NOTHING, Certainty

#: number of rays in a batch; a ray takes some 300 bytes
RAYS_AT_ONCE = 1 << 19

#: number of pairs decided at once in integers; a pair takes some 2 kB
PAIRS_AT_ONCE = 1 << 15

#: Smallest size of a mesh relative to its distance from the origin of coordinates; doubles have
#: steps of 2^-53 of this distance. A smaller mesh, or a point, is scaled by its distance instead.
MIN_RELATIVE_SIZE = 2.0**-40

#: Largest exponent e for which 2^e and 2^-e are normal doubles, with a margin
MAX_SINGLE_EXPONENT = 1000

#: largest double
LARGEST = float(np.finfo(np.float64).max)

#: weight of an uncertain pair: a single uncertain pair leaves its ray undecided
DOUBTFUL_WEIGHT = 2

#: bits of the exponent of a double
EXPONENT_BITS = 0x7FF << 52


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstHits:
    """First surfaces along N rays.

    Parameters
    ----------
    triangle
        (N,) number of the first triangle (smallest number of a tie), -1 for a miss.
    t
        (N,) place along the ray in lengths of its direction, NaN for a miss. With the certainty
        `EXACT` or `TIE`, t is the nearest double. With `PROVEN`, the sign is right; the error is at
        most |t| and, except for underflow, 2^-47 (|p - o| . m + |t| |d| . m) / |d . n|. Here
        o + t d is the ray, p the first corner of the triangle, n the cross product of its edges at
        p, and m the same with all products positive. For a well-shaped triangle that the ray meets
        steeply, the error is about 1e-14 of the distance to p.
    certainty
        (N,) `Certainty` of each hit or miss: proven in doubles, decided in integers, or a tie.
    ties
        (K, 2) numbers of ray and triangle, ascending: all triangles of ties.
    """

    triangle: Indices
    t: Floats
    certainty: Bytes
    ties: Indices


@dataclass(frozen=True, kw_only=True, eq=False)
class AllHits:
    """All K hits of rays, sorted by ray, then exactly by t, then by triangle.

    `position` (K, 3) is origin + t direction, rounded. `place` (K,) counts the distinct t along
    each ray, from 0; hits at equal t have equal numbers.
    """

    ray: Indices
    triangle: Indices
    position: Floats
    place: Indices

    def __getitem__(self, chosen: Mask) -> "AllHits":
        """Return some of the hits."""
        return AllHits(**{name: values[chosen] for name, values in vars(self).items()})


@dataclass(frozen=True, kw_only=True, eq=False)
class RayBatch:
    """Rays in doubles: origins and directions (N, 3), and the closed range of t, (N, 2)."""

    origins: Floats
    directions: Floats
    ends: Floats

    def __getitem__(self, chosen: Any) -> "RayBatch":
        """Return some of the rays."""
        return RayBatch(**{field.name: vars(self)[field.name][chosen] for field in fields(self)})

    def __len__(self) -> int:
        """Return the number of rays."""
        return len(self.origins)

    @cached_property
    def exponents(self) -> Indices:
        """Exponents e (N,): the largest component of each direction is in [2^(e-1), 2^e)."""
        x, y, z = np.abs(self.directions).T
        return np.asarray(np.frexp(np.maximum(np.maximum(x, y), z))[1], dtype=np.int64)

    def points(self, lengths: Floats) -> Floats:
        """Return the points (N, 3) at `lengths`, which are t times 2^`exponents`.

        For a very short or long direction, t itself may exceed the range of doubles.
        """
        return self.origins + lengths[:, None] * _shifted(self.directions, -self.exponents[:, None])


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """Pairs (K,) of rays and triangles that may meet; t is in the units of the mesh."""

    ray: Indices
    triangle: Indices
    t: Floats
    error: Floats
    sure: Mask

    def __getitem__(self, chosen: Mask | Indices) -> "Candidates":
        """Return some of the pairs."""
        return Candidates(**{name: values[chosen] for name, values in vars(self).items()})


class ExactMesh:
    """Ray query structures of triangles: tree, Embree's structure, corners in doubles.

    Parameters
    ----------
    vertices
        (V, 3) positions, finite if a triangle uses them.
    faces
        (F, 3) vertex numbers of at least one triangle.
    """

    def __init__(self, vertices: Floats, faces: Indices) -> None:
        self.triangles = vertices.take(faces, axis=0)
        used = np.zeros(len(vertices), dtype=np.bool_)
        used[faces] = True
        # Ignore vertices without triangles.
        vertices = np.where(used[:, None], vertices, vertices[faces[0, 0]])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        # Halve first: the sum of two doubles may overflow.
        middle = low / 2 + high / 2
        size = float(np.maximum(high - middle, middle - low).max())
        size = max(size, MIN_RELATIVE_SIZE * float(np.abs(vertices).max()))
        #: power of two by which lengths are multiplied, so that the size is at most 1
        self._scale = -int(np.frexp(size)[1])
        scaled, middle = _shifted(vertices, self._scale), _shifted(middle, self._scale)
        centered = scaled - middle
        self._boxes = Boxes(build_tree(centered.take(faces, axis=0)))
        self._corners = Triangles(scaled.take(faces, axis=0))
        self._centered, self._faces = centered, faces
        #: number of rays before Embree's structure is built: building takes about as long per
        #: triangle as Embree saves per ray
        self._rays_until_embree = len(faces)
        with recording():
            self._middle = constants(middle.tolist())
        self._exact_middle = [Fraction(x) for x in middle.tolist()]

    @classmethod
    def from_triangles(cls, triangles: Floats) -> "ExactMesh":
        """Return the mesh of triangles (F, 3, 3) that share no vertices."""
        return cls(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))

    @cached_property
    def _embree(self) -> EmbreeMesh:
        # Share vertices: the binding copies number by number, which takes most of the time.
        return EmbreeMesh(self._centered, self._faces)

    def first(self, rays: RayBatch) -> FirstHits:
        """Return the first surfaces along rays."""
        return self._first(rays)[0]

    def first_points(self, rays: RayBatch) -> AllHits:
        """Return the first hits of rays; for a tie, the triangle with the smallest number."""
        first, lengths = self._first(rays)
        ray = np.flatnonzero(first.triangle >= 0)
        return AllHits(
            ray=ray,
            triangle=first.triangle[ray],
            position=rays[ray].points(lengths[ray]),
            place=np.zeros(len(ray), dtype=np.int64),
        )

    def _first(self, rays: RayBatch) -> tuple[FirstHits, Floats]:
        """Return the first surfaces along rays, and t times 2^`exponents` (N,)."""
        triangle = np.full(len(rays), NOTHING, dtype=np.int64)
        t, lengths = np.full((2, len(rays)), np.nan)
        certainty = np.full(len(rays), Certainty.PROVEN, dtype=np.uint8)
        ties = [np.zeros((0, 2), dtype=np.int64)]
        for part in _batches(len(rays)):
            batch = rays[part]
            triangle[part], places, *doubtful = self._filtered(batch)
            t[part] = _shifted(places, -batch.exponents - self._scale)
            lengths[part] = _shifted(places, -self._scale)
            for ray, hits in self._decided(batch, *doubtful).items():
                number = part.start + ray
                certainty[number] = Certainty.EXACT
                if not hits:
                    continue
                place = min(hits)[0]
                winners = sorted(triangle for at, triangle in hits if at == place)
                triangle[number], t[number] = winners[0], nearest_double(place)
                lengths[number] = _nearest(place, batch.exponents[ray])
                if len(winners) > 1:
                    certainty[number] = Certainty.TIE
                    ties.append(np.array([(number, winner) for winner in winners]))
        first = FirstHits(triangle=triangle, t=t, certainty=certainty, ties=np.concatenate(ties))
        return first, lengths

    def all(self, rays: RayBatch) -> AllHits:
        """Return all surfaces along rays."""
        parts = [self._ordered(rays[part], part.start) for part in _batches(len(rays))]
        parts = parts or [self._ordered(rays, 0)]
        return AllHits(
            **{
                field.name: np.concatenate([vars(part)[field.name] for part in parts])
                for field in fields(AllHits)
            }
        )

    def rays_from(self, origin: Sequence[float], direction: list[Any], ends: Sequence[Any]) -> Rays:
        """Return rays from one point, with directions and ends on the device.

        The largest component of a direction must be a normal double.
        """
        largest = dr.maximum(dr.maximum(abs(direction[0]), abs(direction[1])), abs(direction[2]))
        # Keep the exponent bits: the largest power of two up to the component.
        bits: Any = dr.reinterpret_array(UInt64, largest)
        power: Any = dr.reinterpret_array(Float64, bits & EXPONENT_BITS)
        start = constants(_shifted(np.asarray(origin), self._scale).tolist())
        (unit,) = constants([2 * 2.0**self._scale])
        lanes = dr.zeros(Float64, dr.width(largest))
        return Rays.from_origins(
            [lanes + place for place in start],
            [part * (0.5 / power) for part in direction],
            [end * power * unit for end in ends],
            self._middle,
        )

    def candidates(self, batch: RayBatch) -> Candidates:
        """Return all pairs that may meet; t and error of far rays are zero."""
        if not len(batch):
            none, nowhere = np.zeros(0, dtype=np.int64), np.zeros(0)
            return Candidates(ray=none, triangle=none, t=nowhere, error=nowhere, sure=none > 0)
        with recording():
            rays = self._on_device(batch)
            far = np.flatnonzero(rays.far.numpy())
            return self._candidates(rays, far, batch[far], self._scale)

    def candidates_of(self, rays: Rays) -> Candidates:
        """Return the `candidates` of rays on the device; call it while `recording`."""
        far = np.flatnonzero(rays.far.numpy())
        columns = np.stack(_compressed(rays.far, *rays.origin, *rays.direction, *rays.ends), axis=1)
        batch = RayBatch(origins=columns[:, :3], directions=columns[:, 3:6], ends=columns[:, 6:])
        return self._candidates(rays, far, batch, 0)

    def _candidates(self, rays: Rays, far: Indices, afar: RayBatch, scale: int) -> Candidates:
        """Return the candidates of rays, with candidates of far rays by `_from_afar`."""
        ray, triangle = self._boxes.pairs(rays, rays.ends[1])
        t, error, sure, possible = self._examined(rays, ray, triangle)
        columns = _compressed(possible, ray, triangle, t, error, sure)
        number, triangle_from_afar = self._from_afar(afar, scale)
        nowhere = np.zeros(len(number))
        columns_from_afar = (far[number], triangle_from_afar, nowhere, nowhere, nowhere > 0)
        ray, triangle, t, error, sure = (
            np.concatenate(parts) for parts in zip(columns, columns_from_afar, strict=True)
        )
        return Candidates(ray=ray, triangle=triangle, t=t, error=error, sure=sure)

    def _from_afar(self, rays: RayBatch, scale: int) -> tuple[Indices, Indices]:
        """Return pairs of far rays and triangles that their lines may meet.

        Lengths times 2^scale are in the units of the mesh. Rays are restarted in rational numbers,
        because doubles would lose the mesh.
        """
        if not len(rays):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        unit = Fraction(2) ** scale
        starts = np.empty((len(rays), 3))
        for number, line in enumerate(zip(rays.origins, rays.directions, strict=True)):
            origin, along = ([Fraction(x) for x in vector.tolist()] for vector in line)
            offset = difference([x * unit for x in origin], self._exact_middle)
            t = dot(offset, along) / dot(along, along)
            starts[number] = [nearest_double(x - t * d) for x, d in zip(offset, along, strict=True)]
        with recording():
            lines = Rays.from_starts(
                # Clipping has no effect on results: a line with a clipped start misses the mesh.
                vectors_on_device(np.clip(starts, -BESIDE, BESIDE)),
                _columns(rays.directions, -rays.exponents),
            )
            pairs = self._boxes.pairs(lines, lines.ends[1])
            ray, triangle = (numbers.numpy().astype(np.int64) for numbers in pairs)
        return ray, triangle

    def _on_device(self, batch: RayBatch) -> Rays:
        """Return rays in the units of the mesh; t is multiplied by 2^`exponents`."""
        origin = _columns(batch.origins, self._scale)
        direction = _columns(batch.directions, -batch.exponents)
        both_ends = _columns(batch.ends, batch.exponents + self._scale)
        return Rays.from_origins(origin, direction, both_ends, self._middle)

    def _examined(self, rays: Rays, ray: Any, triangle: Any) -> tuple[Any, Any, Any, Any]:
        """Return t, error, sure and possible of pairs; see `meetings`."""
        origin, direction, ends = (
            [dr.gather(Float64, values, ray) for values in vector]
            for vector in (rays.origin, rays.direction, rays.ends)
        )
        t, error, sure, possible = meetings(self._corners.points(triangle), origin, direction, ends)
        # A walk without pairs returns an arbitrary pair. Its ray may be far, and `_from_afar` may
        # return the same pair.
        walked = ~dr.gather(Bool, rays.missing, ray)
        sure, possible = sure & walked, possible & walked
        dr.eval(t, error, sure, possible)
        return t, error, sure, possible

    def _filtered(self, batch: RayBatch) -> tuple[Indices, Floats, Indices, Indices]:
        """Return first triangles and t proven in doubles, and the pairs of undecided rays.

        t is in the units of the mesh.
        """
        with recording():
            rays = self._on_device(batch)
            limit = self._proposed_limit(rays)
            ray, triangle = self._boxes.pairs(rays, limit)
            t, error, sure, possible = self._examined(rays, ray, triangle)
            # The first surface is no farther than the upper bound of t of a certain hit.
            dr.scatter_reduce(dr.ReduceOp.Min, limit, t + error, ray, sure, dr.ReduceMode.Direct)
            dr.eval(limit)
            possible &= t - error <= dr.gather(Float64, limit, ray)
            count = dr.zeros(UInt32, len(batch))
            weight = dr.select(sure, UInt32(1), UInt32(DOUBTFUL_WEIGHT))
            dr.scatter_reduce(dr.ReduceOp.Add, count, weight, ray, possible, dr.ReduceMode.Direct)
            number = dr.full(Int32, NOTHING, len(batch))
            place = dr.full(Float64, np.nan, len(batch))
            dr.scatter(number, Int32(triangle), ray, possible)
            dr.scatter(place, t, ray, possible)
            dr.eval(count, number, place)
            unsettled = count > 1
            number = dr.select(unsettled, NOTHING, number)
            place = dr.select(unsettled, np.nan, place)
            possible &= dr.gather(Bool, unsettled, ray)
            dr.eval(number, place, possible)
            doubtful = _compressed(possible, ray, triangle)
            far = np.flatnonzero(rays.far.numpy())
            settled = number.numpy().astype(np.int64), place.numpy()
        return *settled, *doubtful, far

    def _proposed_limit(self, rays: Rays) -> Any:
        """Return an upper limit of t of the first surface of each ray, from Embree's proposal."""
        last = rays.ends[1]
        self._rays_until_embree -= dr.width(rays.restart)
        if self._rays_until_embree >= 0:
            return last
        origin, direction, length = rays.proposed()
        dr.eval(origin, direction, length)
        shape = (dr.width(length), 3)
        hits = self._embree.first_hits(
            interleaved(origin, shape), interleaved(direction, shape), length.numpy()
        )
        proposed = on_device(hits)
        points = self._corners.points(UInt32(dr.maximum(proposed, 0)))
        t, error, sure, _ = meetings(points, rays.origin, rays.direction, rays.ends)
        limit = dr.select(sure & (proposed >= 0), dr.minimum(t + error, last), last)
        dr.make_opaque(limit)
        return limit

    def _decided(
        self, batch: RayBatch, ray: Indices, triangle: Indices, far: Indices
    ) -> dict[int, list[tuple[Fraction, int]]]:
        """Return the hits of undecided rays and of far rays, decided in integers."""
        hits: dict[int, list[tuple[Fraction, int]]] = {
            number: [] for number in (*np.unique(ray).tolist(), *far.tolist())
        }
        number, triangle_from_afar = self._from_afar(batch[far], self._scale)
        for rays, triangles in ((ray, triangle), (far[number], triangle_from_afar)):
            for pair, place in self._places(batch, rays, triangles):
                hits[int(rays[pair])].append((place, int(triangles[pair])))
        return hits

    def _places(
        self, batch: RayBatch, ray: Indices, triangle: Indices
    ) -> Iterator[tuple[int, Fraction]]:
        """Yield the pairs with a hit and their t, decided in integers."""
        for start in range(0, len(ray), PAIRS_AT_ONCE):
            part = slice(start, start + PAIRS_AT_ONCE)
            some = batch[ray[part]]
            decided = meet(self.triangles[triangle[part]], some.origins, some.directions, some.ends)
            for pair in np.flatnonzero(decided.met).tolist():
                yield start + pair, decided.place(pair)

    def _ordered(self, batch: RayBatch, start: int) -> AllHits:
        """Return all hits of rays in exact order; rays are numbered from `start`."""
        pairs = self.candidates(batch)
        exponents = batch.exponents + self._scale
        # Decide uncertain pairs in integers.
        met, doubtful = pairs.sure.copy(), np.flatnonzero(~pairs.sure)
        for pair, place in self._places(batch, pairs.ray[doubtful], pairs.triangle[doubtful]):
            number = doubtful[pair]
            met[number] = True
            pairs.t[number] = _nearest(place, exponents[pairs.ray[number]])
            # Give an infinite t a finite error: infinity minus infinity is NaN.
            pairs.error[number] = UNDERFLOW + ROUNDING * min(abs(pairs.t[number]), LARGEST)
        pairs = pairs[np.flatnonzero(met)]
        pairs = pairs[np.lexsort((pairs.t - pairs.error, pairs.ray))]
        # Sort pairs in integers if their intervals of t overlap. For a far ray, t may be infinite
        # in the units of the mesh, and finite in the caller's units.
        group = _overlapping(pairs)
        together = np.flatnonzero((np.bincount(group)[group] > 1) | np.isinf(pairs.t))
        lengths = _shifted(pairs.t, -self._scale)
        places = [
            place for _, place in self._places(batch, pairs.ray[together], pairs.triangle[together])
        ]
        keys = list(
            zip(group[together].tolist(), places, pairs.triangle[together].tolist(), strict=True)
        )
        begins = np.diff(group, prepend=-1) > 0
        order, before = np.arange(len(group)), None
        ascending = sorted(range(len(keys)), key=keys.__getitem__)
        for position, chosen in zip(together.tolist(), ascending, strict=True):
            order[position] = together[chosen]
            begins[position] = keys[chosen][:2] != before
            before = keys[chosen][:2]
            exponent = batch.exponents[pairs.ray[order[position]]]
            lengths[order[position]] = _nearest(places[chosen], exponent)
        pairs, lengths = pairs[order], lengths[order]
        # Count places over all rays, then subtract the count at the first hit of each ray.
        number = np.cumsum(begins)
        first = np.searchsorted(pairs.ray, pairs.ray, "left")
        rays = batch[pairs.ray]
        return AllHits(
            ray=pairs.ray + start,
            triangle=pairs.triangle,
            position=rays.points(lengths),
            place=number - number[first],
        )


def _batches(count: int) -> Iterator[slice]:
    """Yield slices of batches of rays."""
    for start in range(0, count, RAYS_AT_ONCE):
        yield slice(start, start + RAYS_AT_ONCE)


def _powers(exponents: Indices | int) -> list[Floats]:
    """Return 2^exponents as factors: two if one factor may exceed the range of doubles."""
    # Results beyond 2^2000 overflow or underflow anyway.
    exponents = np.clip(exponents, -2000, 2000)
    if np.abs(exponents).max(initial=0) <= MAX_SINGLE_EXPONENT:
        return [np.ldexp(1.0, exponents)]
    half = exponents // 2
    return [np.ldexp(1.0, half), np.ldexp(1.0, exponents - half)]


def _shifted(values: Floats, exponents: Indices | int) -> Floats:
    """Return values times 2^exponents, infinite or zero beyond the range of doubles."""
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray(math.prod(_powers(exponents), start=values))


def _columns(rows: Floats, exponents: Indices | int) -> list[Any]:
    """Return the coordinates of vectors (N, C) times 2^exponents on the device."""
    # Multiply column by column: a product of (N, C) and (N, 1) takes five times as long.
    powers = _powers(exponents)
    with np.errstate(over="ignore", under="ignore"):
        return [on_device(math.prod(powers, start=column)) for column in rows.T]


def _compressed(mask: Any, *columns: Any) -> tuple[Any, ...]:
    """Return the masked lanes of columns as NumPy arrays; integers have 64 bits."""
    chosen: Any = dr.compress(mask)
    parts = [dr.gather(type(column), column, chosen).numpy() for column in columns]
    return tuple(part.astype(np.int64) if part.dtype == np.uint32 else part for part in parts)


def _nearest(place: Fraction, exponent: int) -> float:
    """Return the double nearest to `place` times 2^exponent."""
    return nearest_double(place * Fraction(2) ** int(exponent))


def _overlapping(pairs: Candidates) -> Indices:
    """Return the group of each pair: pairs of a ray whose intervals of t overlap form a group.

    A chain of overlapping intervals is one group. Pairs are sorted by ray, then by the smallest
    possible t.
    """
    near, far = pairs.t - pairs.error, pairs.t + pairs.error
    # Compute the running maximum of `far` along each ray by ranks that grow from ray to ray.
    order = np.argsort(far, kind="stable")
    rank = np.empty(len(far), dtype=np.int64)
    rank[order] = np.arange(len(far))
    reached = np.maximum.accumulate(pairs.ray * len(far) + rank)
    begins = np.ones(len(far), dtype=np.bool_)
    begins[1:] = (np.diff(pairs.ray) > 0) | (near[1:] > far[order[reached[:-1] % len(far)]])
    return np.cumsum(begins) - 1
