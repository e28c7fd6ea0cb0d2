"""Points in, on and outside closed surfaces, compared with rationals along other directions."""

from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from tests.reference.rays.worst import GRID, LENGTHS, SMALL, points
from tests.support.brute_force import exact_s
from tests.support.long_tail import examples
from xfrustum.rays import ExactIntersector, Location
from xfrustum.reference.backend import cross, difference, dot
from xfrustum.reference.rays.intersector import locate, open_edges
from xfrustum.reference.rays.rays import ExactMesh
from xfrustum.scenes import InputError
from xfrustum.scenes.arrays import Floats

FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))


@st.composite
def tetrahedra(draw: st.DrawFn) -> Floats:
    """Draw tetrahedra that may touch, coincide, overlap or be flat; return their faces."""
    corner = points(draw(st.sampled_from([GRID, SMALL])))
    corners = np.array(draw(st.lists(corner, min_size=4, max_size=8)))
    number = st.integers(0, len(corners) - 1)
    solids = draw(st.lists(st.tuples(number, number, number, number), min_size=1, max_size=3))
    faces = [[solid[k] for k in face] for solid in solids for face in FACES]
    return corners[faces] * draw(LENGTHS)


def on_triangle(corners: Floats, point: Floats) -> bool:
    """Return whether a point lies in a triangle, border included, in rational numbers."""
    a, b, c, p = ([Fraction(x) for x in row] for row in (*corners.tolist(), point.tolist()))
    for start, end in ((a, b), (b, c), (c, a)):
        along = [e - s for s, e in zip(start, end, strict=True)]
        offset = [x - s for s, x in zip(start, p, strict=True)]
        length = sum(x * x for x in along)
        share = sum(x * y for x, y in zip(along, offset, strict=True)) / length if length else 0
        if 0 <= share <= 1 and offset == [share * x for x in along]:
            return True
    # The point is on no edge: test where two lines through it meet the triangle's plane.
    return any(exact_s(corners, point, np.roll([1.0, 0.0, 0.0], k)) == 0 for k in range(3))


def crossings(triangles: Floats, point: Floats) -> int:
    """Return the number of triangles met along a direction that avoids all edges, in rationals."""
    rng = np.random.default_rng(5)
    start = [Fraction(x) for x in point.tolist()]
    offsets = [
        [difference([Fraction(x) for x in corner], start) for corner in corners]
        for corners in triangles.tolist()
    ]
    while True:
        d = [Fraction(x) for x in rng.normal(size=3).tolist()]
        count, generic = 0, True
        for a, b, c in offsets:
            normal = cross(difference(b, a), difference(c, a))
            if dot(a, normal) == 0:
                continue  # without area, or coplanar with a point outside the triangle
            sides = [dot(d, cross(a, b)), dot(d, cross(b, c)), dot(d, cross(c, a))]
            generic &= 0 not in sides
            crossed = min(sides) > 0 or max(sides) < 0
            count += crossed and dot(a, normal) / dot(d, normal) > 0
        if generic:
            return count


@examples(40)
@given(st.data(), tetrahedra())
def test_points_are_located_as_by_rationals(data: st.DataObject, triangles: Floats) -> None:
    """Test points at vertices, above and below them, on edges and faces, and elsewhere."""
    size = float(np.abs(triangles).max()) or 1.0
    places = []
    for corners in triangles[:: data.draw(st.integers(1, 3))]:
        a, b, c = corners
        places += [a, a / 2 + b / 2, a / 4 + b / 4 + c / 2, triangles.mean(axis=(0, 1))]
        places.append(np.array([*a[:2], data.draw(SMALL) * size]))
    places += [size * np.array(p) for p in data.draw(st.lists(points(SMALL), max_size=3))]
    located = locate(ExactMesh.from_triangles(triangles), np.array(places))
    for point, location in zip(places, located, strict=True):
        if any(on_triangle(corners, point) for corners in triangles):
            assert location == Location.ON
        else:
            inside = crossings(triangles, point) % 2
            assert location == (Location.INSIDE if inside else Location.OUTSIDE)


def test_a_cavity_is_outside_and_touching_boxes_have_no_wall_between() -> None:
    """Points on either wall are on the surface, and so are points of the boxes' common face."""
    outer, hole = trimesh.creation.box(extents=[2, 2, 2]), trimesh.creation.box(extents=[1, 1, 1])
    hole.invert()
    mesh = trimesh.util.concatenate([outer, hole])
    inner, on, outer_side = Location.INSIDE, Location.ON, Location.OUTSIDE
    line = [[0.0, 0.0, z] for z in (0, 0.75, 0.5, 1, 2)]
    located = ExactIntersector(mesh).locate_points([*line, [1.0, 1.0, 1.0]])
    assert located.tolist() == [outer_side, inner, on, on, outer_side, on]
    pair = trimesh.util.concatenate([outer, outer.copy().apply_translation([2, 0, 0])])
    located = ExactIntersector(pair).locate_points([[1.0, 0, 0], [0.9, 0, 0], [1.1, 1, 0]])
    assert located.tolist() == [on, inner, on]


def test_an_open_mesh_is_refused_with_its_number_of_open_edges() -> None:
    box = trimesh.creation.box()
    box.update_faces(np.arange(12) > 0)
    assert open_edges(np.array(box.triangles)) == 3
    with pytest.raises(InputError, match="3 edges are open"):
        ExactIntersector(box).locate_points([[0, 0, 0]])
    # The missing triangle is not above the point: along +z the box looks complete.
    places = [[0, 0, 0], [0, 0, 5]]
    upright = ExactIntersector(box).locate_points(places, closed=False)
    assert upright.tolist() == [Location.INSIDE, Location.OUTSIDE]
    assert ExactIntersector(box).contains_points(places).tolist() == [True, False]


def test_a_mesh_of_separate_triangles_is_closed_by_its_positions() -> None:
    soup = trimesh.creation.icosphere(subdivisions=2)
    soup.unmerge_vertices()
    assert open_edges(np.array(soup.triangles)) == 0
    directions = soup.vertices / 2
    assert (ExactIntersector(soup).locate_points(directions) == Location.INSIDE).all()
    assert (ExactIntersector(soup).locate_points(soup.vertices) == Location.ON).all()
