"""Further wrong renderers: each has a typical mistake of developers, or a pair of mistakes.

They were written without knowledge of the diagnosis. Names of faults follow docs/verify.md, as in
`toys`.
"""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from PIL import Image

from tests.wrong_renderers import ray_caster
from tests.wrong_renderers.ray_caster import RIGHT, Mistakes, Picture, eight_bits, picture, srgb
from tests.wrong_renderers.toys import (
    COLORS,
    ENCODINGS,
    RGB,
    SRGB,
    TOYS,
    TRIANGLES,
    Draw,
    Toy,
    add,
)
from tests.wrong_renderers.worlds import Floats, Part, World

__all__ = ["CLASSIC", "PAIRS", "SLIPS", "TOYS"]

Place = Callable[[World, int, int], tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Slip:
    """A mistake, by the stage at which it occurs, so that mistakes can be combined."""

    words: str
    names: str
    """Accepted names of the defect, separated by blanks: `verify` must give one of them. Empty if
    `verify` has no name for the defect.
    """
    _: KW_ONLY
    encodings: tuple[str, ...] = ENCODINGS
    scene: str | None = None
    world: Callable[[World], World] | None = None  # change of the scene
    place: Place = lambda world, i, j: (i, j)  # column and row of the hogel that is drawn
    mistakes: Mapping[str, Any] | Callable[[World, int, int], Mapping[str, Any]] = field(
        default_factory=dict
    )
    """Fields of `Mistakes`, for all hogels or by hogel."""
    radiance: Callable[[Floats], Floats] | None = None  # from linear radiance to bytes / 255
    change: Callable[[Picture], Picture] = np.asarray  # change of the picture


def drawn_by(*slips: Slip) -> Draw:
    """Return a renderer that combines these mistakes."""

    def draw(world: World, i: int, j: int, encoding: str) -> Picture:
        wrong, colors = RIGHT, None
        for slip in slips:
            i, j = slip.place(world, i, j)
        for slip in slips:
            mistakes = slip.mistakes(world, i, j) if callable(slip.mistakes) else slip.mistakes
            wrong = replace(wrong, **mistakes)
            if slip.world:
                world = world.once(slip.words, partial(slip.world, world))
            colors = slip.radiance or colors
        if colors and encoding in (RGB, SRGB):
            made = eight_bits(colors(np.clip(ray_caster.draw(world, i, j, wrong).radiance, 0, 1)))
        else:
            made = picture(world, i, j, encoding, wrong)
        for slip in slips:
            made = np.ascontiguousarray(slip.change(made))
        return made

    return draw


def axes(*exchanged: str) -> Callable[[World], World]:
    """Return a function that exchanges or reverses the scene's axes; lights and plate stay.

    `axes("x", "z", "-y")` moves a point (x, y, z) to (x, z, -y).
    """
    unit = dict(zip("xyz", np.eye(3), strict=True))
    matrix = np.array([-unit[axis[1]] if axis[0] == "-" else unit[axis] for axis in exchanged])

    def world(of: World) -> World:
        parts = tuple(replace(part, corners=part.corners @ matrix.T) for part in of.parts)
        return replace(of, parts=parts, drawn={})

    return world


def one_object(names: str, change: Callable[[Part], Part]) -> Callable[[World], World]:
    """Return a function that changes the one object with one of these names."""

    def world(of: World) -> World:
        assert sum(part.name in names.split() for part in of.parts) == 1
        parts = tuple(change(part) if part.name in names.split() else part for part in of.parts)
        return replace(of, parts=parts, drawn={})

    return world


def about_middle(
    matrix: Floats, move: tuple[float, float, float] = (0, 0, 0)
) -> Callable[[Part], Part]:
    """Return a function that turns or scales an object about its box's middle, then moves it."""

    def part(of: Part) -> Part:
        middle = (of.corners.min(axis=0) + of.corners.max(axis=0)) / 2
        return replace(of, corners=(of.corners - middle) @ matrix.T + middle + move)

    return part


def about_y(degrees: float) -> Floats:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def odd_rows(right: Picture) -> Picture:
    """Shift odd rows one pixel to the right."""
    shifted = right.copy()
    shifted[1::2, 1:] = right[1::2, :-1]
    return shifted


def three_quarters(how: Image.Resampling) -> Slip:
    """Draw at 0.75 of the resolution and resize by 4/3, without correcting the film."""

    def change(made: Picture) -> Picture:
        height, width = made.shape[:2]
        return np.asarray(Image.fromarray(made).resize((width * 4 // 3, height * 4 // 3), how))

    words = f"drawn at 0.75 of the size, {how.name.lower()}"
    return Slip(words, "", world=lambda of: ray_caster.resized(of, 0.75), change=change)


def jittered(world: World, i: int, j: int) -> Mapping[str, Any]:
    """Shift each aperture by a random amount."""
    return {"aperture": tuple(np.random.default_rng([i, j]).normal(0, 0.2, 2).tolist())}


def starved(world: World, i: int, j: int) -> Mapping[str, Any]:
    """Place the near plane extremely close, with a depth buffer of 16 bits."""
    return {"near": 1e-5 * max(world.reach), "depth_bits": 16}


def rolled(world: World, i: int, j: int, encoding: str) -> Picture:
    """Roll an unsheared picture by whole pixels; columns that leave it enter on the other side."""
    _, _, k = ray_caster.lines(world, i, j)
    assert world.screen
    height, full = world.screen[0], world.screen[3:]
    t = np.array(full) / 2 / abs(height)
    columns, rows = np.round(k[:2] / t * np.array(world.resolution) / 2).astype(int)
    straight = picture(world, i, j, encoding, Mistakes(shear=(0.0, 0.0)))
    return np.roll(straight, (rows, -columns), axis=(0, 1))


BACK, MIDDLE, FRONT = "pebble crate", "band scarf", "buoy lamp"
"""Names of the objects behind the plate, across it and before it, in both scenes."""

TRANSFER = "srgb-read-as-linear linear-read-as-srgb gamma wrong-transfer wrong-encoding"
SAME = np.eye(3)

SLIPS: dict[str, Slip] = {
    # Axes.
    "z-negated": Slip("z is negated", "z-negated", world=axes("x", "y", "-z")),
    "yz-exchanged": Slip(
        "y and z are exchanged, which mirrors the scene",
        "axes-exchanged",
        world=axes("x", "z", "y"),
    ),
    "z-up": Slip(
        "z up is taken for y up",
        "axes-exchanged",
        world=axes("x", "z", "-y"),
    ),
    "y-up": Slip(
        "y up is taken for z up",
        "axes-exchanged",
        world=axes("x", "-z", "y"),
    ),
    "xy-exchanged": Slip(
        "x and y are exchanged",
        "axes-exchanged",
        world=axes("y", "x", "z"),
    ),
    # With a centered frustum, mirrored films in a mirrored order of hogels look the same.
    "x-negated": Slip(
        "x is negated",
        "axes-exchanged orientation aperture-order",
        world=axes("-x", "y", "z"),
    ),
    "front-flipped": Slip(
        "C* is turned and then mirrored",
        "front-mirrored",
        mistakes={"film": (1, -1), "only": 1},
    ),
    "transposed": Slip(
        "rows and columns are exchanged",
        "orientation",
        scene="attic",
        change=lambda p: p.transpose(1, 0, 2),
    ),
    # Lenses.
    "equal-angles": Slip("pixels have equal angles", "equal-angles", mistakes={"angles": "xy"}),
    "equal-angles-x": Slip("columns have equal angles", "equal-angles", mistakes={"angles": "x"}),
    "equal-angles-y": Slip("rows have equal angles", "equal-angles", mistakes={"angles": "y"}),
    "fisheye": Slip(
        "radii have equal angles",
        "equal-angles",
        mistakes={"angles": "radial"},
    ),
    "barrel-weak": Slip(
        "barrel distortion, 3 % in the corners",
        "",
        mistakes={"distortion": 0.03},
    ),
    "barrel": Slip(
        "barrel distortion, 12 % in the corners",
        "",
        mistakes={"distortion": 0.12},
    ),
    "pincushion": Slip(
        "pincushion distortion, 6 % in the corners",
        "",
        mistakes={"distortion": -0.06},
    ),
    # Transfer functions.
    "linear-for-srgb": Slip(
        "linear, read as sRGB", TRANSFER, encodings=(SRGB,), radiance=lambda x: x
    ),
    "srgb-for-linear": Slip("sRGB, read as linear", TRANSFER, encodings=COLORS, radiance=srgb),
    "gamma-for-srgb": Slip(
        "gamma 2.2 for sRGB",
        TRANSFER,
        encodings=(SRGB,),
        radiance=lambda x: x ** (1 / 2.2),
    ),
    "gamma-for-linear": Slip(
        "gamma 2.2 for linear",
        TRANSFER,
        encodings=COLORS,
        radiance=lambda x: x ** (1 / 2.2),
    ),
    "encoded-twice": Slip(
        "sRGB encoded twice",
        TRANSFER,
        encodings=(SRGB,),
        radiance=lambda x: srgb(srgb(x)),
    ),
    "decoded": Slip(
        "linear values decoded like sRGB", TRANSFER, encodings=COLORS, radiance=ray_caster.linear
    ),
    # Normals.
    "flat-normals": Slip(
        "flat normals for smooth ones",
        "flat-normals",
        encodings=COLORS,
        scene="cove",
        mistakes={"normals": "flat"},
    ),
    "inverted-normals": Slip(
        "normals point away from the viewer",
        "inverted-normals",
        encodings=COLORS,
        mistakes={"normals": "inverted"},
    ),
    # Hogels.
    "stale": Slip(
        "one hogel shows the previous one's picture",
        "stale-hogel",
        place=lambda w, i, j: (0, 1) if (i, j) == (1, 1) else (i, j),
    ),
    "stale-block": Slip(
        "two hogels show the picture of the one before them",
        "stale-hogel",
        place=lambda w, i, j: (0, 0) if j == 0 and i in (1, 2) else (i, j),
    ),
    "late": Slip(
        "every hogel shows the previous one's picture",
        "stale-hogel aperture-order",
        place=lambda w, i, j: w.apertures[max(w.apertures.index((i, j)) - 1, 0)],
    ),
    "exchanged": Slip(
        "two hogels are exchanged",
        "hogels-exchanged",
        place=lambda w, i, j: {(1, 0): (2, 0), (2, 0): (1, 0)}.get((i, j), (i, j)),
    ),
    "odd-columns": Slip(
        "odd columns of hogels are half a pitch too high",
        "",
        mistakes=lambda w, i, j: {"aperture": (0.0, 0.5 * (i % 2))},
    ),
    "jitter": Slip("apertures are off at random by 0.2 hogels", "", mistakes=jittered),
    # Pixels.
    "odd-rows": Slip("odd rows are shifted by one pixel", "", change=odd_rows),
    "three-quarters-nearest": three_quarters(Image.Resampling.NEAREST),
    "three-quarters-bilinear": three_quarters(Image.Resampling.BILINEAR),
    # Objects.
    "object-right": Slip(
        "one object is moved by x = 0.6",
        "",
        world=one_object(BACK, about_middle(SAME, (0.6, 0.0, 0.0))),
    ),
    "object-forward": Slip(
        "one object is moved by z = 3",
        "",
        world=one_object(FRONT, about_middle(SAME, (0.0, 0.0, 3.0))),
    ),
    "object-turned": Slip(
        "one object is turned by 3 degrees",
        "",
        world=one_object(MIDDLE, about_middle(about_y(3.0))),
    ),
    "object-missing": Slip(
        "one object is left out",
        "object-missing",
        world=one_object(BACK, lambda part: replace(part, hidden=True)),
    ),
    "object-twice": Slip(
        "one object is twice as large",
        "",
        world=one_object(FRONT, about_middle(2 * SAME)),
    ),
    # Depth and reach.
    "starved": Slip(
        "16 bits of depth from a near of 1e-5 of the reach on",
        "",
        mistakes=starved,
        # In the harbor, z-fighting occurs only within an object, so that object numbers stay right.
        encodings=(TRIANGLES, RGB),
    ),
    "clipped": Slip(
        "the reach is 0.6 and 0.5 of what it should be",
        "",
        mistakes={"reach": (0.6, 0.5)},
    ),
}

CLASSIC: dict[str, Slip] = {
    "near": Slip("both cameras step back by 2", "near", mistakes={"near": 2.0}),
    "fov": Slip("the film is 5 % too wide and high", "fov", mistakes={"film": (1.05, 1.05)}),
    "half-pixel": Slip("sampled at pixel corners", "shift", mistakes={"sample": (-0.5, -0.5)}),
    "no-front": Slip(
        "the viewer's half is missing",
        "front-missing",
        mistakes={"winner": "no front"},
    ),
    "mirrored": Slip("mirrored", "orientation", change=lambda p: p[:, ::-1]),
    "rows-from-below": Slip(
        "rows of apertures are counted from below",
        "aperture-order",
        place=lambda w, i, j: (i, w.hogels[1] - 1 - j),
    ),
    "blue-red": Slip(
        "blue and red are exchanged",
        "channel-order",
        encodings=(TRIANGLES,),
        change=lambda p: p[..., ::-1],
    ),
    "lights": Slip(
        "lights are not conjugated",
        "lights",
        encodings=COLORS,
        mistakes={"light": "not conjugated"},
    ),
}
"""Classic mistakes for combinations."""

PAIRS = (
    ("near", "object-missing"),
    ("mirrored", "srgb-for-linear"),
    ("stale", "fov"),
    ("jitter", "near"),
    ("object-right", "half-pixel"),
    ("barrel", "odd-rows"),
    ("exchanged", "no-front"),
    ("equal-angles", "blue-red"),
    ("z-negated", "rows-from-below"),
    ("object-missing", "object-turned"),
    ("starved", "object-twice"),
    ("flat-normals", "near"),
    ("mirrored", "lights"),
)
"""Pairs of mistakes; `verify` must name both."""


def add_slips(name: str, group: str, *slips: Slip) -> None:
    """Add the renderer that combines these mistakes."""
    encodings = tuple(
        of for of in (*ENCODINGS, SRGB) if all(of in slip.encodings for slip in slips)
    )
    causes = tuple(frozenset(slip.names.split()) for slip in slips if slip.names)
    TOYS[name] = Toy(
        name=name,
        words="; ".join(slip.words for slip in slips),
        draw=drawn_by(*slips),
        encodings=encodings,
        expected=dict.fromkeys(encodings, causes),
        scene=next((slip.scene for slip in slips if slip.scene), None),
        group=group,
    )


for _name, _slip in SLIPS.items():
    add_slips(_name, "new", _slip)
add("wrapped", "pictures are rolled, not sheared", rolled, scene="attic", group="new")
add(
    "cove-right",
    "nothing, with smooth normals",
    RIGHT,
    encodings=COLORS,
    scene="cove",
    group="new",
)
add("right-srgb", "nothing, as sRGB", RIGHT, encodings=(SRGB,), group="new")
for _pair in PAIRS:
    add_slips("+".join(_pair), "pairs", *((SLIPS | CLASSIC)[_name] for _name in _pair))
