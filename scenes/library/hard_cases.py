"""Hard cases: scenes on which renderers of crossed frusta fail (docs/hard-cases.md)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import radians
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from xfrustum.scenes import Frustum, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.library.builtin import BuiltinScene
from xfrustum.scenes.library.objects import asymmetric, car
from xfrustum.scenes.shapes import as_object, build_shape, grid_faces, place, placement, triangulate

Objects = tuple[SceneObject, ...]
REACH = 128.0  #: reach on both sides, in millimeters
#: Plate with apertures at x and y of -16, -8, 0, 8 and 16; the middle aperture is at the origin.
PLATE = Plate(size=(40.0, 40.0), hogels=(5, 5))

#: Frustum in which every slope is a multiple of 1/128. Slopes of lines through the origin are odd
#: multiples, from -63/128 to 63/128. The frustum is defined by a screen and not by an angle,
#: because no angle in double precision has the tangent 1/2 exactly.
FRUSTUM = Frustum(
    resolution=(64, 64),
    reach=(REACH, REACH),
    screen=Screen(height=-64.0, center=(0.0, 0.0), size=(64.0, 64.0)),
)


@dataclass(frozen=True)
class HardCase(BuiltinScene):
    """Scene on which a renderer may fail, with the content of its true image."""

    plate: Plate = PLATE
    frustum: Frustum = FRUSTUM
    expected: str = ""  #: content of the true image, in one line
    apertures: tuple[tuple[int, int], ...] = ((2, 2),)  #: column and row of the relevant apertures
    giant: bool = False  #: whether the case takes minutes or gigabytes


_CASES: dict[str, HardCase] = {}
CASES = MappingProxyType(_CASES)  #: the cases by name, `hard/...`, in the order of the suite
Maker = Callable[[], Objects]


def _case(
    name: str, triangles: int, why: str, expected: str, **how: Any
) -> Callable[[Maker], Maker]:
    """Return a decorator that adds a case to the suite; the function makes its objects."""

    def entered(objects: Maker) -> Maker:
        _CASES[f"hard/{name}"] = HardCase(
            f"hard/{name}", triangles, why, objects, expected=expected, **how
        )
        return objects

    return entered


def names(*, giants: bool = True) -> list[str]:
    """Return the names of the cases, with or without giant cases."""
    return [name for name, case in CASES.items() if giants or not case.giant]


def listing() -> list[BuiltinScene]:
    """Return the entries of all cases."""
    return list(CASES.values())


def build(name: str) -> Scene:
    """Return the scene of a case, uncached: the largest scene takes hundreds of megabytes."""
    return CASES[name].build()


def on_line(column: ArrayLike, row: ArrayLike, s: ArrayLike) -> Floats:
    """Return points (..., 3) at depth s on lines through the origin; exact for half pixels."""
    columns, rows, along = np.broadcast_arrays(
        np.asarray(column, dtype=np.float64),
        np.asarray(row, dtype=np.float64),
        np.asarray(s, np.float64),
    )
    return np.stack(
        ((2 * columns - 63) / 128 * along, (63 - 2 * rows) / 128 * along, -along), axis=-1
    )


def loose(name: str, triangles: Sequence[ArrayLike] | Floats) -> SceneObject:
    """Return an object of triangles (F, 3, 3) that share no vertices."""
    corners = np.asarray(triangles, dtype=np.float64).reshape(-1, 3)
    return as_object(name, (corners, np.arange(len(corners)).reshape(-1, 3)))


def film_rectangle(columns: tuple[float, float], rows: tuple[float, float], s: ArrayLike) -> Floats:
    """Return two triangles over a film rectangle; s is one depth, or one per corner, clockwise."""
    left, right = columns
    top, bottom = rows
    corners = on_line([left, right, right, left], [top, top, bottom, bottom], s)
    return corners[[[0, 1, 2], [0, 2, 3]]]


def wall(z: float = -100.0) -> SceneObject:
    """Return one triangle parallel to the plate that fills the film of every aperture."""
    return loose("wall", [[(-400.0, -400.0, z), (400.0, -400.0, z), (0.0, 600.0, z)]])


# Exact hits: lines through vertices and edges, or surfaces through the aperture itself

GRID_STEP = 4  #: pixels between neighboring vertices of the bumpy sheets


def _bumpy_sheet(
    name: str, columns: tuple[int, int], rows: tuple[int, int], side: int
) -> SceneObject:
    """Return a sheet with every vertex exactly on a pixel's line, at depths of 32 to 60."""
    column, row = np.meshgrid(
        np.arange(columns[0], columns[1] + 1, GRID_STEP), np.arange(rows[0], rows[1] + 1, GRID_STEP)
    )
    s = side * (32.0 + 4.0 * ((7 * column + 3 * row) // GRID_STEP % 8))
    return as_object(name, (on_line(column, row, s).reshape(-1, 3), grid_faces(*column.shape)))


@_case(
    "vertices-and-edges",
    392,
    "lines run exactly through vertices and edges of a mesh: cracks or double hits",
    "no crack; ties between all triangles around the vertex or beside the edge",
)
def _vertices_and_edges() -> Objects:
    return _bumpy_sheet("behind", (2, 30), (2, 58), 1), _bumpy_sheet(
        "in front", (34, 62), (2, 58), -1
    )


@_case(
    "closed-edges",
    2,
    "lines run exactly through the outline of single triangles: rounding decides",
    "triangles are closed: their outline belongs to them, decided exactly, no tie",
)
def _closed_edges() -> Objects:
    behind = on_line([8, 40, 8], [8, 8, 40], [32.0, 64.0, 48.0])
    in_front = on_line([60, 60, 36], [60, 36, 60], [-32.0, -64.0, -48.0])
    return loose("behind", [behind]), loose("in front", [in_front])


#: Column and row of the pixels whose lines lie in a surface through the aperture.
THROUGH_COLUMN, THROUGH_ROW = 40, 20


@_case(
    "surface-through-aperture",
    2,
    "all lines meet at one point of the surface, and one column of lines lies in it",
    "the surface at height 0 in every pixel but that column, which shows the wall behind",
)
def _surface_through_aperture() -> Objects:
    # The triangle is in the plane of all lines of one column, and therefore passes exactly through
    # the aperture.
    corners = on_line(THROUGH_COLUMN, 0, [-64.0, -64.0, 96.0])
    corners[:, 1] = (-48.0, 48.0, 0.0)
    return loose("surface", [corners]), wall()


@_case(
    "vertex-on-aperture",
    6,
    "every line runs through the tip of a pyramid: all its sides are met at once",
    "a tie of the four sides at height 0 in every pixel; an ordinary pyramid from elsewhere",
    apertures=((2, 2), (3, 2)),
)
def _vertex_on_aperture() -> Objects:
    # The sides have slopes of 1/4 = 32/128, between two columns: no pixel's line is in a side.
    base = [(16.0, 16.0, -64.0), (-16.0, 16.0, -64.0), (-16.0, -16.0, -64.0), (16.0, -16.0, -64.0)]
    vertices: Floats = np.array([(0.0, 0.0, 0.0), *base])
    faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (1, 4, 3), (1, 3, 2)])
    return (as_object("pyramid", (vertices, faces)),)


@_case(
    "edge-through-aperture",
    3,
    "an edge runs through the aperture, along the line of one pixel",
    "a tie at height 0; one of both sides along a row and a column, the wall at the cross",
)
def _edge_through_aperture() -> Objects:
    ends = on_line(THROUGH_COLUMN, THROUGH_ROW, [-32.0, 64.0])
    # One triangle lies in the plane of the row's lines, the other in the plane of the column's
    # lines.
    aside = on_line(THROUGH_COLUMN, THROUGH_ROW, 16.0) + np.array(
        [(20.0, 0.0, 0.0), (0.0, 20.0, 0.0)]
    )
    return loose("tent", [[*ends, corner] for corner in aside]), wall()


@_case(
    "triangle-in-plate",
    2,
    "a triangle lies in the plate: with the aperture inside, on its edge, on its corner, beside",
    "the triangle at height 0 in every pixel; from beside it only the wall behind",
    apertures=((1, 3), (2, 2), (0, 4), (3, 1)),
)
def _triangle_in_plate() -> Objects:
    return loose("in plate", [[(-16, -16, 0), (16, -16, 0), (-16, 16, 0)]]), wall()


# Depth order: coincident and nearly coincident sheets, and the ends of the reach

#: Separations of the nearly coincident sheets, column by column, as fractions of `SHEET_DISTANCE`.
#: In one more column the separation of each corner is one ULP.
SEPARATIONS = (1e-3, 1e-6, 1e-9, 1e-12)
SHEET_DISTANCE = 64.0  #: distance of the sheets from the plate, at their top left corners
SHEET_ROWS = (
    (3.5, 29.5),
    (33.5, 59.5),
)  #: edges of the sheets behind and in front of the plate, between pixels


def sheet_columns(index: int) -> tuple[float, float]:
    """Return the left and right edge of a column of sheets, between pixels."""
    return 12 * index + 1.5, 12 * index + 13.5


def _ball(z: float) -> SceneObject:
    """Return a ball of diameter 24 at height z; the sign of z selects the half of the film."""
    return place(
        build_shape("sphere"), placement(24.0, (10.0, 20.0, 0.0), (0.25 * abs(z), -0.0625 * z, z))
    )


@_case(
    "coincident-copies",
    8_832,
    "the same triangles twice: nothing decides which is first",
    "every covered pixel is a tie of both copies and shows the first",
)
def _coincident_copies() -> Objects:
    return _ball(-50.0), _ball(50.0), _ball(-50.0), _ball(50.0)


@_case(
    "coincident-other-triangles",
    6,
    "the same plane in other triangles: equal depth from unequal numbers",
    "every covered pixel is a tie between both sheets and shows the first",
)
def _coincident_other_triangles() -> Objects:
    def in_plane(*points: tuple[float, float]) -> Floats:
        x, y = np.array(points).T
        return np.stack((x, y, -64 + x / 4 + y / 8), axis=-1)

    corners = ((-24.0, -24.0), (24.0, -24.0), (24.0, 24.0), (-24.0, 24.0))
    two = as_object("two triangles", (in_plane(*corners), triangulate(np.array([(0, 1, 2, 3)]))))
    fan = np.array([(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)])
    return two, as_object("four triangles", (in_plane(*corners, (4.0, -8.0)), fan))


@_case(
    "nearly-coincident",
    40,
    "sheets 1e-3 to 1e-12 of their distance apart, and one step of a double; the hidden one first",
    "the upper sheet everywhere, no tie; one step of a double is decided exactly",
)
def _nearly_coincident() -> Objects:
    lower, upper = [], []
    for side, rows in zip((1, -1), SHEET_ROWS, strict=True):
        for index in range(len(SEPARATIONS) + 1):
            # The sheets are inclined and bent: all pixels of a flat sheet would be right, or all
            # wrong.
            depth = side * SHEET_DISTANCE * np.array([1.0, 1.125, 1.25, 1.0625])
            sheet = film_rectangle(sheet_columns(index), rows, depth)
            raised = sheet.copy()
            if index < len(SEPARATIONS):
                raised[..., 2] += SEPARATIONS[index] * SHEET_DISTANCE
            else:
                raised[..., 2] = np.nextafter(sheet[..., 2], np.inf)
            lower.append(sheet)
            upper.append(raised)
    # The hidden sheets come first, so that a renderer that breaks ties by the smaller number is
    # wrong.
    return loose("lower sheets", np.concatenate(lower)), loose(
        "upper sheets", np.concatenate(upper)
    )


#: First and last column of the sheets exactly at the reach, and of the sheets one ULP beyond it.
#: The same ranges are the rows of the sheets behind and in front of the plate.
AT_REACH = ((2.5, 30.5), (34.5, 62.5))


@_case(
    "at-the-reach",
    8,
    "sheets exactly at the ends of the reach, and one step of a double beyond",
    "those at the reach are imaged, those beyond are not",
)
def _at_the_reach() -> Objects:
    at, beyond = REACH, float(np.nextafter(REACH, np.inf))
    return tuple(
        loose(
            name, np.concatenate([film_rectangle(columns, AT_REACH[k], (s, -s)[k]) for k in (0, 1)])
        )
        for name, columns, s in (("at the reach", AT_REACH[0], at), ("beyond", AT_REACH[1], beyond))
    )


_case(
    "nothing", 0, "no objects: nothing to build, nothing to hit", "no surface in any pixel, proven"
)(lambda: ())
_case(
    "only-in-front",
    2_208,
    "nothing behind the plate: one of the two cameras sees nothing",
    "surfaces at positive heights only",
)(lambda: (_ball(50.0),))
_case(
    "only-behind",
    2_208,
    "nothing in front of the plate: the other camera sees nothing",
    "surfaces at negative heights only",
)(lambda: (_ball(-50.0),))
_case(
    "only-out-of-reach",
    4_416,
    "objects on the lines, but beyond the reach on both sides",
    "no surface in any pixel, proven",
)(lambda: (_ball(REACH + 30.0), _ball(-REACH - 30.0)))


# Degenerate triangles: edge-on, needles, without area, doubled, tiny

#: Column whose lines lie in a triangle, and column of a triangle whose ends are moved by `TURN`.
EDGE_ON_COLUMN, TURNED_COLUMN = 20, 44
#: Distance in x by which the ends are moved: one ULP of numbers from 8 to 16, such as x at the far
#: end.
TURN = 2.0**-49
#: Half the turned triangle's height where it crosses its column's lines, and the depth there.
TURNED_HALF_HEIGHT, TURNED_MIDDLE = 10.0, 48.0


@_case(
    "edge-on",
    3,
    "a triangle in the plane of a column's lines, and one turned by a single step of a double",
    "the first covers nothing; the other covers 26 pixels of its column, at depth 48",
)
def _edge_on() -> Objects:
    def upright(column: int, turn: float) -> Floats:
        """Return a triangle along a column's lines, its ends moved in x."""
        corners = on_line(column, 0, [32.0, 32.0, 64.0])
        corners[:, 0] += (-turn, -turn, turn)
        corners[:, 1] = (-2 * TURNED_HALF_HEIGHT, 2 * TURNED_HALF_HEIGHT, 0.0)
        return corners

    still, turned = upright(EDGE_ON_COLUMN, 0.0), upright(TURNED_COLUMN, TURN)
    return loose("edge-on", [still]), loose("turned", [turned]), wall()


#: Half the width of a needle, in pixels; the longest needles are 56 pixels long, a million times
#: their width.
NEEDLE = 28e-6


@_case(
    "needles",
    4,
    "triangles a million times longer than wide, along rows of pixel centers",
    "exactly the pixels whose centers they cover: 57, 29 and 57; between pixels none",
)
def _needles() -> Objects:
    down = on_line([20 - NEEDLE, 20 + NEEDLE, 20], [4, 4, 60], [64.0, 64.0, 48.0])
    between = on_line([24.5 - NEEDLE, 24.5 + NEEDLE, 24.5], [4, 4, 60], [64.0, 64.0, 48.0])
    diagonal = on_line(
        [30 + NEEDLE / 2, 30 - NEEDLE / 2, 58], [4 - NEEDLE / 2, 4 + NEEDLE / 2, 32], 64.0
    )
    across = on_line([4, 4, 60], [44 - NEEDLE, 44 + NEEDLE, 44], [-64.0, -64.0, -48.0])
    return (loose("needles", [down, between, diagonal, across]),)


@_case(
    "zero-area",
    7,
    "triangles without area exactly on lines: points, collinear corners, in the aperture",
    "they cover nothing: the wall behind in every pixel, no tie",
)
def _zero_area() -> Objects:
    point = on_line([10, 10, 10], 10, 32.0)
    two_equal = on_line([14, 30, 14], [12, 12, 12], [32.0, 48.0, 32.0])
    along_row = on_line([14, 22, 30], 20, 32.0)
    along_a_line = on_line(40, 40, [16.0, 32.0, 64.0])
    through_aperture = on_line(50, 50, [-32.0, 16.0, 64.0])
    in_aperture = np.zeros((3, 3))
    flat = [point, two_equal, along_row, along_a_line, through_aperture, in_aperture]
    return loose("flat", flat), wall()


@_case(
    "duplicates",
    36,
    "the same faces twice, wound either way, and again with vertices of their own",
    "every covered pixel is a tie of all three and shows the first",
)
def _duplicates() -> Objects:
    box = place(build_shape("box"), placement(24.0, (20.0, 35.0, 10.0), (3.0, -2.0, -56.0)))
    # All faces exist three times: twice on shared vertices, with opposite winding, and once with
    # separate vertices.
    faces = np.concatenate([box.faces, box.faces[:, ::-1]])
    return as_object("faces twice", (box.vertices, faces)), loose(
        "vertices twice", box.vertices[box.faces]
    )


#: Depth of the nearer of two sheets. Its smallest coordinates, 1/128 of this depth, are about
#: 4e-75.
SMALLEST = 2.0**-240


@_case(
    "smallest",
    5,
    "two sheets 1e-72 behind the aperture, near the smallest coordinates that may be, and a wall",
    "the nearer sheet before the other, and the wall around them: 1517, 1248, 1331 pixels",
)
def _smallest() -> Objects:
    hidden = film_rectangle((4.0, 40.0), (4.0, 60.0), 2 * SMALLEST)
    nearer = film_rectangle((20.0, 56.0), (12.0, 52.0), SMALLEST)
    return loose("hidden", hidden), loose("nearer", nearer), wall()


# Size, place and view: far, tiny, huge, steep, sheared, one pixel, giants

FAR_AWAY = (
    1e6  #: distance of the far scene's meshes from the origin of their files, along each axis
)
#: Factors of the tiny and the huge scene: powers of two that make a reach of 150 about 1e-6 and
#: 1e6.
SCALES = {"tiny": 2.0**-27, "huge": 2.0**13}
_GRAIN = 2.0**-20  #: grid to which coordinates are rounded
ASYMMETRIC_PLATE = Plate(size=(80.0, 60.0), hogels=(81, 61))
ASYMMETRIC_FRUSTUM = Frustum(
    resolution=(64, 64), reach=(150.0, 150.0), fov=(radians(60), radians(60))
)
_ASYMMETRIC_APERTURES = ((40, 30), (12, 50))


def asymmetric_on_a_grid() -> Objects:
    """Return the asymmetric objects rounded to 2^-20: moving them away and back is exact."""
    return tuple(
        replace(part, vertices=np.rint(part.vertices / _GRAIN) * _GRAIN) for part in asymmetric()
    )


@_case(
    "far-from-origin",
    4_896,
    "mesh coordinates of 1e6, brought to the plate by the transform: float32 would keep 1/16 mm",
    "the same image as of meshes that lie at the plate already, to the last bit",
    plate=ASYMMETRIC_PLATE,
    frustum=ASYMMETRIC_FRUSTUM,
    apertures=_ASYMMETRIC_APERTURES,
)
def _far_from_origin() -> Objects:
    # Move far-away vertices, as in a mesh file, by the `translate` of a scene file.
    back = placement(translate=(-FAR_AWAY, FAR_AWAY, -FAR_AWAY))
    away = np.array([FAR_AWAY, -FAR_AWAY, FAR_AWAY])
    return tuple(
        place(replace(part, vertices=part.vertices + away), back) for part in asymmetric_on_a_grid()
    )


def _scaled(kind: str) -> None:
    scale = SCALES[kind]
    _case(
        kind,
        4_896,
        f"all lengths about {150 * scale:.0e}: absolute tolerances and products out of range show",
        "the asymmetric scene, to the last bit",
        plate=Plate(size=(80 * scale, 60 * scale), hogels=(81, 61)),
        frustum=replace(ASYMMETRIC_FRUSTUM, reach=(150 * scale, 150 * scale)),
        apertures=_ASYMMETRIC_APERTURES,
    )(lambda: tuple(place(part, placement(scale)) for part in asymmetric_on_a_grid()))


_scaled("tiny")
_scaled("huge")

ROOM = (24.0, 24.0, 20.0)  #: half sizes of the box about the middle aperture along x, y and z
SHEARED_SCREEN = Screen(height=-40.0, center=(0.0, 0.0), size=(20.0, 20.0))


def _room() -> Objects:
    box = build_shape("box")
    return (replace(box, name="room", vertices=box.vertices * (2 * np.array(ROOM))),)


_case(
    "steep",
    12,
    "a full angle of 170 degrees: slopes up to 11.4, lines almost along the plate",
    "the box about the aperture, where each line enters it, in every pixel",
    frustum=Frustum(resolution=(64, 64), reach=(REACH, REACH), fov=(radians(170), radians(170))),
    apertures=((2, 2), (0, 3)),
)(_room)


@_case(
    "sheared-five-screens",
    121,
    "apertures five screen widths beside the screen: the shear is ten times the half-extent",
    "the picture on the screen fills every aperture's film alike",
    plate=Plate(size=(250.0, 250.0), hogels=(5, 5)),
    frustum=replace(FRUSTUM, screen=SHEARED_SCREEN),
    apertures=((2, 2), (0, 0), (4, 4), (4, 0), (3, 2)),
)
def _picture_on_the_screen() -> Objects:
    """Return a sheet that fills the projection screen, with a hole through which a wall shows."""
    x, y = np.meshgrid(np.linspace(-10, 10, 9), np.linspace(-10, 10, 9))
    # The hole is off center, so that mirror images differ.
    quads = np.delete(_quads_to_viewer(9, 9), [18, 19, 26, 27], axis=0)
    screen = np.stack([x, y, np.full_like(x, SHEARED_SCREEN.height)], axis=-1).reshape(-1, 3)
    return as_object("picture", (screen, triangulate(quads))), wall(-90.0)


def _quads_to_viewer(rows: int, columns: int) -> Indices:
    """Return the quads (N, 4) of a grid of vertices whose rows run upward."""
    index = np.arange(rows * columns).reshape(rows, columns)
    return np.stack(
        [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1
    ).reshape(-1, 4)


def _screen_at(height: float) -> Frustum:
    return replace(FRUSTUM, screen=Screen(height=height, center=(0.0, 0.0), size=(64.0, 64.0)))


_case(
    "screen-near-plate",
    12,
    "a screen 2^-30 behind the plate: slopes of 1e10, lines as good as in the plate",
    "the box about the aperture, where each line enters it, within 1e-6 of the plate",
    frustum=_screen_at(-(2.0**-30)),
    apertures=((2, 2), (0, 3)),
)(_room)
_case(
    "screen-near-plate-in-front",
    12,
    "the same screen 2^-30 before the plate: the shear changes its sign, and its image is mirrored",
    "the box where each line enters it; from the middle what the screen behind the plate shows",
    frustum=_screen_at(2.0**-30),
    apertures=((2, 2), (0, 3)),
)(_room)
_case(
    "one-pixel",
    12,
    "1 x 1 pixel: no neighbor, and its one line runs through a diagonal of the box",
    "a tie of the two triangles beside the diagonal at height -32",
    frustum=replace(FRUSTUM, resolution=(1, 1)),
)(lambda: (place(build_shape("box"), placement(16.0, translate=(0.0, 0.0, -40.0))),))
_case(
    "giant-image",
    41_896,
    "8192 x 8192 pixels of the car: memory must not grow with the image",
    "the car; in bands, a few hundred megabytes at a time",
    frustum=replace(ASYMMETRIC_FRUSTUM, resolution=(8192, 8192)),
    giant=True,
)(car)


@_case(
    "giant-mesh",
    10_000_000,
    "ten million triangles, most of them smaller than a pixel",
    "the wave behind the plate in every pixel",
    frustum=replace(FRUSTUM, resolution=(512, 512)),
    giant=True,
)
def _ten_million() -> Objects:
    rows, columns = 2500, 2000
    x, y = np.linspace(-60, 60, columns + 1), np.linspace(-60, 60, rows + 1)[:, None]
    # Heights are rounded, so that sine tables that differ in the last bit make the same mesh.
    z = np.round(-60 + 8 * np.sin(0.9 * x) * np.sin(0.7 * y) + 0.2 * np.sin(9.1 * x + 7.3 * y), 6)
    vertices = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1)
    return (as_object("wave", (vertices.reshape(-1, 3), triangulate(_quads_to_viewer(*z.shape)))),)
