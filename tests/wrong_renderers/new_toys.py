"""Further wrong renderers: each has a typical mistake of developers, or a pair of mistakes.

They were written without knowledge of the diagnosis. Names of faults follow docs/verify.md, as in
`toys`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from PIL import Image

from tests.wrong_renderers import ray_caster
from tests.wrong_renderers.ray_caster import (
    RIGHT,
    Mistakes,
    Picture,
    eight_bits,
    linear,
    picture,
    srgb,
)
from tests.wrong_renderers.toys import (
    ENCODINGS,
    RGB,
    SRGB,
    TOYS,
    TRIANGLES,
    Draw,
    add,
    drawn_with,
)
from tests.wrong_renderers.worlds import Floats, Part, World

__all__ = ["CLASSIC", "PAIRS", "SLIPS", "TOYS"]

Place = Callable[[World, int, int], tuple[int, int]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Slip:
    """A mistake, by the stage at which it occurs, so that mistakes can be combined."""

    words: str
    names: str
    """Accepted names of the defect, separated by blanks: `verify` must give one of them. Empty if
    `verify` has no name for the defect.
    """
    encodings: tuple[str, ...] = ENCODINGS
    scene: str | None = None
    world: Callable[[World], World] | None = None  # change of the scene
    place: Place = lambda world, i, j: (i, j)  # column and row of the hogel that is drawn
    mistakes: Mistakes | Callable[[World, int, int], Mistakes] = RIGHT
    radiance: Callable[[Floats], Floats] | None = None  # from linear radiance to bytes / 255
    change: Callable[[Picture], Picture] | None = None  # change of the picture

    def of_hogel(self, world: World, i: int, j: int) -> Mistakes:
        return self.mistakes if isinstance(self.mistakes, Mistakes) else self.mistakes(world, i, j)


def drawn_by(*slips: Slip) -> Draw:
    """Return a renderer that combines these mistakes."""

    def draw(world: World, i: int, j: int, encoding: str) -> Picture:
        wrong, colors = RIGHT, None
        for slip in slips:
            i, j = slip.place(world, i, j)
        for slip in slips:
            theirs = slip.of_hogel(world, i, j)
            differ = {of.name: getattr(theirs, of.name) for of in fields(Mistakes)}
            wrong = replace(wrong, **{k: v for k, v in differ.items() if v != getattr(RIGHT, k)})
            world = drawn_with(world, slip.words, slip.world) if slip.world else world
            colors = slip.radiance or colors
        if colors and encoding in (RGB, SRGB):
            made = eight_bits(colors(np.clip(ray_caster.draw(world, i, j, wrong).radiance, 0, 1)))
        else:
            made = picture(world, i, j, encoding, wrong)
        for slip in slips:
            made = np.ascontiguousarray(slip.change(made)) if slip.change else made
        return made

    return draw


def axes(*rows: tuple[int, int, int]) -> Callable[[World], World]:
    """Return a function that exchanges or reverses the scene's axes; lights and plate stay."""
    matrix = np.array(rows, dtype=float)

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


def three_quarters(how: Image.Resampling) -> dict[str, Callable[..., object]]:
    """Draw at 0.75 of the resolution and resize by 4/3, without correcting the film."""

    def change(made: Picture) -> Picture:
        height, width = made.shape[:2]
        return np.asarray(Image.fromarray(made).resize((width * 4 // 3, height * 4 // 3), how))

    return {"world": lambda of: ray_caster.resized(of, 0.75), "change": change}


def jittered(world: World, i: int, j: int) -> Mistakes:
    """Shift each aperture by a random amount."""
    right, up = np.random.default_rng([i, j]).normal(0, 0.2, 2).tolist()
    return Mistakes(aperture=(right, up))


def starved(world: World, i: int, j: int) -> Mistakes:
    """Place the near plane extremely close, with a depth buffer of 16 bits."""
    return Mistakes(near=1e-5 * max(world.reach), depth_bits=16)


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

COLORS = (RGB,)
TRANSFER = "srgb-read-as-linear linear-read-as-srgb gamma wrong-transfer wrong-encoding"
SAME = np.eye(3)

SLIPS: dict[str, Slip] = {
    # Axes.
    "z-negated": Slip(
        words="z is negated", names="z-negated", world=axes((1, 0, 0), (0, 1, 0), (0, 0, -1))
    ),
    "yz-exchanged": Slip(
        words="y and z are exchanged, which mirrors the scene",
        names="axes-exchanged",
        world=axes((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    ),
    "z-up": Slip(
        words="z up is taken for y up",
        names="axes-exchanged",
        world=axes((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ),
    "y-up": Slip(
        words="y up is taken for z up",
        names="axes-exchanged",
        world=axes((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ),
    "xy-exchanged": Slip(
        words="x and y are exchanged",
        names="axes-exchanged",
        world=axes((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    ),
    # A centered frustum shows mirrored films in a mirrored order.
    "x-negated": Slip(
        words="x is negated",
        names="axes-exchanged orientation aperture-order",
        world=axes((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ),
    "front-flipped": Slip(
        words="C* is turned and then mirrored",
        names="front-mirrored",
        mistakes=Mistakes(film=(1, -1), only=1),
    ),
    "transposed": Slip(
        words="rows and columns are exchanged",
        names="orientation",
        scene="attic",
        change=lambda p: p.transpose(1, 0, 2),
    ),
    # Lenses.
    "equal-angles": Slip(
        words="pixels have equal angles", names="equal-angles", mistakes=Mistakes(angles="xy")
    ),
    "equal-angles-x": Slip(
        words="columns have equal angles", names="equal-angles", mistakes=Mistakes(angles="x")
    ),
    "equal-angles-y": Slip(
        words="rows have equal angles", names="equal-angles", mistakes=Mistakes(angles="y")
    ),
    "fisheye": Slip(
        words="radii have equal angles",
        names="equal-angles",
        mistakes=Mistakes(angles="radial"),
    ),
    "barrel-weak": Slip(
        words="barrel distortion, 3 % in the corners",
        names="",
        mistakes=Mistakes(distortion=0.03),
    ),
    "barrel": Slip(
        words="barrel distortion, 12 % in the corners",
        names="",
        mistakes=Mistakes(distortion=0.12),
    ),
    "pincushion": Slip(
        words="pincushion distortion, 6 % in the corners",
        names="",
        mistakes=Mistakes(distortion=-0.06),
    ),
    # Transfer functions.
    "linear-for-srgb": Slip(
        words="linear, read as sRGB", names=TRANSFER, encodings=(SRGB,), radiance=lambda x: x
    ),
    "srgb-for-linear": Slip(
        words="sRGB, read as linear", names=TRANSFER, encodings=COLORS, radiance=srgb
    ),
    "gamma-for-srgb": Slip(
        words="gamma 2.2 for sRGB",
        names=TRANSFER,
        encodings=(SRGB,),
        radiance=lambda x: x ** (1 / 2.2),
    ),
    "gamma-for-linear": Slip(
        words="gamma 2.2 for linear",
        names=TRANSFER,
        encodings=COLORS,
        radiance=lambda x: x ** (1 / 2.2),
    ),
    "encoded-twice": Slip(
        words="sRGB encoded twice",
        names=TRANSFER,
        encodings=(SRGB,),
        radiance=lambda x: srgb(srgb(x)),
    ),
    "decoded": Slip(
        words="linear values decoded like sRGB", names=TRANSFER, encodings=COLORS, radiance=linear
    ),
    # Normals.
    "flat-normals": Slip(
        words="flat normals for smooth ones",
        names="flat-normals",
        encodings=COLORS,
        scene="cove",
        mistakes=Mistakes(normals="flat"),
    ),
    "inverted-normals": Slip(
        words="normals point away from the viewer",
        names="inverted-normals",
        encodings=COLORS,
        mistakes=Mistakes(normals="inverted"),
    ),
    # Hogels.
    "stale": Slip(
        words="one hogel shows the previous one's picture",
        names="stale-hogel",
        place=lambda w, i, j: (0, 1) if (i, j) == (1, 1) else (i, j),
    ),
    "stale-block": Slip(
        words="two hogels show the picture of the one before them",
        names="stale-hogel",
        place=lambda w, i, j: (0, 0) if j == 0 and i in (1, 2) else (i, j),
    ),
    "late": Slip(
        words="every hogel shows the previous one's picture",
        names="stale-hogel aperture-order",
        place=lambda w, i, j: w.apertures[max(w.apertures.index((i, j)) - 1, 0)],
    ),
    "exchanged": Slip(
        words="two hogels are exchanged",
        names="hogels-exchanged",
        place=lambda w, i, j: {(1, 0): (2, 0), (2, 0): (1, 0)}.get((i, j), (i, j)),
    ),
    "odd-columns": Slip(
        words="odd columns of hogels are half a pitch too high",
        names="",
        mistakes=lambda w, i, j: Mistakes(aperture=(0.0, 0.5 * (i % 2))),
    ),
    "jitter": Slip(words="apertures are off at random by 0.2 hogels", names="", mistakes=jittered),
    # Pixels.
    "odd-rows": Slip(words="odd rows are shifted by one pixel", names="", change=odd_rows),
    "three-quarters-nearest": Slip(
        words="drawn at 0.75 of the size, nearest",
        names="",
        **three_quarters(Image.Resampling.NEAREST),  # type: ignore[arg-type]
    ),
    "three-quarters-bilinear": Slip(
        words="drawn at 0.75 of the size, bilinear",
        names="",
        **three_quarters(Image.Resampling.BILINEAR),  # type: ignore[arg-type]
    ),
    # Objects.
    "object-right": Slip(
        words="one object is moved by x = 0.6",
        names="",
        world=one_object(BACK, about_middle(SAME, (0.6, 0.0, 0.0))),
    ),
    "object-forward": Slip(
        words="one object is moved by z = 3",
        names="",
        world=one_object(FRONT, about_middle(SAME, (0.0, 0.0, 3.0))),
    ),
    "object-turned": Slip(
        words="one object is turned by 3 degrees",
        names="",
        world=one_object(MIDDLE, about_middle(about_y(3.0))),
    ),
    "object-missing": Slip(
        words="one object is left out",
        names="object-missing",
        world=one_object(BACK, lambda part: replace(part, hidden=True)),
    ),
    "object-twice": Slip(
        words="one object is twice as large",
        names="",
        world=one_object(FRONT, about_middle(2 * SAME)),
    ),
    # Depth and reach.
    "starved": Slip(
        words="16 bits of depth from a near of 1e-5 of the reach on",
        names="",
        mistakes=starved,
        # In the harbor, z-fighting occurs only within an object, so that object numbers stay right.
        encodings=(TRIANGLES, RGB),
    ),
    "clipped": Slip(
        words="the reach is 0.6 and 0.5 of what it should be",
        names="",
        mistakes=Mistakes(reach=(0.6, 0.5)),
    ),
}

CLASSIC: dict[str, Slip] = {
    "near": Slip(words="both cameras step back by 2", names="near", mistakes=Mistakes(near=2.0)),
    "fov": Slip(
        words="the film is 5 % too wide and high", names="fov", mistakes=Mistakes(film=(1.05, 1.05))
    ),
    "half-pixel": Slip(
        words="sampled at pixel corners", names="shift", mistakes=Mistakes(sample=(-0.5, -0.5))
    ),
    "no-front": Slip(
        words="the viewer's half is missing",
        names="front-missing",
        mistakes=Mistakes(winner="no front"),
    ),
    "mirrored": Slip(words="mirrored", names="orientation", change=lambda p: p[:, ::-1]),
    "rows-from-below": Slip(
        words="rows of apertures are counted from below",
        names="aperture-order",
        place=lambda w, i, j: (i, w.hogels[1] - 1 - j),
    ),
    "blue-red": Slip(
        words="blue and red are exchanged",
        names="channel-order",
        encodings=(TRIANGLES,),
        change=lambda p: p[..., ::-1],
    ),
    "lights": Slip(
        words="lights are not conjugated",
        names="lights",
        encodings=COLORS,
        mistakes=Mistakes(light="not conjugated"),
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
    scene = next((slip.scene for slip in slips if slip.scene), None)
    add(name, "; ".join(slip.words for slip in slips), drawn_by(*slips), {}, encodings, scene)
    causes = tuple(frozenset(slip.names.split()) for slip in slips if slip.names)
    TOYS[name] = replace(TOYS[name], expected=dict.fromkeys(encodings, causes), group=group)


for _name, _slip in SLIPS.items():
    add_slips(_name, "new", _slip)
add("wrapped", "pictures are rolled, not sheared", rolled, {}, scene="attic")
add("cove-right", "nothing, with smooth normals", RIGHT, {}, COLORS, scene="cove")
add("right-srgb", "nothing, as sRGB", RIGHT, {}, (SRGB,))
for _name in ("wrapped", "cove-right", "right-srgb"):
    TOYS[_name] = replace(TOYS[_name], group="new")
for _one, _other in PAIRS:
    _slips = [(SLIPS | CLASSIC)[_name] for _name in (_one, _other)]
    add_slips(f"{_one}+{_other}", "pairs", *_slips)
