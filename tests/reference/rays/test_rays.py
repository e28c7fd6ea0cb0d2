"""Rays against rational brute force, on difficult cases from hypothesis, and negative controls."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given

from tests.reference.rays.worst import Problem, problems
from tests.support.long_tail import examples
from xfrustum.compare.selfcheck import position_bound
from xfrustum.reference.backend import Float32, Float64, cross, difference, dot, dr, recording
from xfrustum.reference.certify import cone
from xfrustum.reference.rays import filter as filter_module
from xfrustum.reference.rays import walk
from xfrustum.reference.rays.filter import meet, nearest_double, triple_product
from xfrustum.reference.rays.rays import ExactMesh, RayBatch
from xfrustum.reference.rays.walk import Tree, build_tree, slab_shifts
from xfrustum.scenes import Certainty
from xfrustum.scenes.arrays import Floats


@examples(100)
@given(problems())
def test_surfaces_are_those_of_rationals_in_order(problem: Problem) -> None:
    """Compare first surfaces with ties, and all surfaces with the order of their hits."""
    mesh, rays = ExactMesh.from_triangles(problem.triangles), problem.rays
    first, hits = mesh.first(rays), mesh.all(rays)
    for ray in range(len(rays)):
        expected, own = problem.hits(ray), hits.ray == ray
        assert hits.triangle[own].tolist() == [number for _, number in expected]
        places = sorted({t for t, _ in expected})
        assert hits.place[own].tolist() == [places.index(t) for t, _ in expected]
        tied = [number for t, number in expected if t == places[0]]
        assert first.triangle[ray] == (tied[0] if tied else -1)
        listed = first.ties[first.ties[:, 0] == ray, 1].tolist()
        assert listed == (tied if len(tied) > 1 else [])
        assert (first.certainty[ray] == Certainty.TIE) == (len(tied) > 1)
        if not expected:
            assert np.isnan(first.t[ray])
        elif first.certainty[ray] != Certainty.PROVEN:
            assert first.t[ray] == nearest_double(places[0])
        elif first.t[ray] != nearest_double(places[0]):
            t, d = np.array([nearest_double(places[0])]), rays.directions[[ray]]
            unit = np.abs(d).max()
            corners = problem.triangles[tied[0]][None] - rays.origins[ray]
            bound = position_bound(corners, d / unit, t * unit) / unit
            assert abs(first.t[ray] - t) <= bound


def test_results_are_equal_without_proposals_of_embree() -> None:
    """A mesh uses Embree's proposals as soon as it has traced more rays than it has triangles."""
    rng = np.random.default_rng(4)
    ball = trimesh.creation.icosphere(subdivisions=1)
    origins = np.concatenate((rng.uniform(-2, 2, (38, 3)), ball.vertices))
    directions = np.concatenate((rng.normal(size=(38, 3)), -ball.vertices))
    ends = np.tile([0.0, np.inf], (len(ball.faces), 1))
    rays = RayBatch(origins=origins, directions=directions, ends=ends)
    mesh = ExactMesh(ball.vertices, ball.faces)
    alone, proposed = mesh.first(rays), mesh.first(rays)
    for name in ("triangle", "t", "certainty"):
        assert np.array_equal(vars(alone)[name], vars(proposed)[name], equal_nan=True)


def test_half_of_the_bound_of_an_edge_function_is_too_little() -> None:
    """Nearly every rounding of these doubles, found by hill climbing, errs in one direction."""
    origin, p, q, d = np.array(
        [
            [-0.8869499050578171, 0.6575147141159208, -0.5532586191310437],
            [-0.887412036883079, 0.9352459071458401, 0.5351180157888564],
            [-0.8640638588863622, -0.974398231408247, 0.7619531951938838],
            [0.467847850581862, 0.012648159002810078, -0.01475835506202633],
        ]
    )
    value, magnitude = triple_product(d.tolist(), (p - origin).tolist(), (q - p).tolist())
    o, a, b, along = ([Fraction(x) for x in row] for row in (origin, p, q, d))
    exact = dot(along, cross(difference(a, o), difference(b, a)))
    error = abs(Fraction(value) - exact)
    bound = Fraction(filter_module.EDGE_ROUNDING) * Fraction(magnitude)
    assert bound / 2 < error < bound


def test_half_of_the_bound_of_a_slab_is_too_little(monkeypatch: pytest.MonkeyPatch) -> None:
    start, along = float.fromhex("-0x1.174ad900001b4p+0"), float.fromhex("0x1.cbafdafffffeap-1")

    def holds() -> bool:
        with recording():
            factor, low, high = slab_shifts(Float64(start), Float64(along), Float64(0.0))
            near, far = (dr.fma(Float32(1.0), factor, shift).numpy()[0] for shift in (low, high))
        exact = (1 - Fraction(start)) / Fraction(along)
        return bool(Fraction(float(near)) <= exact <= Fraction(float(far)))

    assert holds()
    monkeypatch.setattr(walk, "SLAB_ROUNDINGS", walk.SLAB_ROUNDINGS / 2)
    assert not holds()


def boxes_hold(tree: Tree, triangles: Floats) -> bool:
    """Return whether leaves contain their triangles, and nodes their descendants."""
    node = np.arange(len(tree.skip))
    leaf = tree.skip == node + 1
    corners = triangles[tree.triangle[leaf]]
    within = (tree.low[:, leaf].T[:, None] <= corners) & (corners <= tree.high[:, leaf].T[:, None])
    inner = node[~leaf]
    children = np.concatenate((inner + 1, tree.skip[inner + 1]))
    parents = np.concatenate((inner, inner))
    nested = (tree.low[:, parents] <= tree.low[:, children]) & (
        tree.high[:, parents] >= tree.high[:, children]
    )
    return bool(within.all() and nested.all())


@pytest.mark.parametrize("count", [1, 2, 3, 777])
def test_boxes_hold_their_triangles_and_no_ulp_less(count: int) -> None:
    """Each triangle has one leaf; a box that shrinks by one ulp at any side is too small."""
    triangles = np.random.default_rng(count).uniform(-1, 1, (count, 3, 3))
    tree = build_tree(triangles)
    assert sorted(tree.triangle[tree.triangle >= 0].tolist()) == list(range(count))
    assert boxes_hold(tree, triangles)
    for axis in range(3):
        for side, inward in (("low", np.inf), ("high", -np.inf)):
            box = getattr(tree, side).copy()
            box[axis] = np.nextafter(box[axis], np.float32(inward))
            assert not boxes_hold(replace(tree, **{side: box}), triangles)


@pytest.mark.parametrize("growth", [1.0, 1.1])
def test_trees_of_equal_and_growing_triangles_are_shallow(growth: float) -> None:
    """Equal or growing boxes must not reduce clustering to one merged pair in each round."""
    count = 200
    size = growth ** np.arange(-count, 0)
    triangles = np.asarray(size[:, None, None] * np.diag([1.0, 0.1, 0.1]), dtype=np.float64)
    tree = build_tree(triangles)
    assert boxes_hold(tree, triangles)
    depth = np.zeros(len(tree.skip), dtype=int)
    for node, skip in enumerate(tree.skip.tolist()):
        depth[node + 1 : skip] += 1
    assert depth.max() < 2 * np.log2(count)


def test_a_filter_without_a_bound_of_distances_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays start at rounded middles of triangles: a rounding decides whether they meet them."""
    rng = np.random.default_rng(3)
    triangles = rng.uniform(-1, 1, (40, 3, 3))
    rays = RayBatch(
        origins=triangles.mean(axis=1),
        directions=rng.normal(size=(40, 3)),
        ends=np.tile([0.0, np.inf], (40, 1)),
    )
    exact = meet(triangles, rays.origins, rays.directions, rays.ends).met

    def met() -> list[bool]:
        each = (
            ExactMesh.from_triangles(corners[None]).first(rays[[k]])
            for k, corners in enumerate(triangles)
        )
        return [first.triangle[0] == 0 for first in each]

    assert met() == exact.tolist()
    monkeypatch.setattr(cone, "ROUNDING", 0.0)
    monkeypatch.setattr(filter_module, "ROUNDING", 1.0)  # divides a bound of underflow
    assert met() != exact.tolist()
