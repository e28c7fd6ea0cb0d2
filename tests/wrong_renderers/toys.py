"""Wrong renderers: functions that draw a picture of a scene, from an aperture, in an encoding.

`expected` lists the mistakes by encoding, each with names of faults: `verify` must find one of them
or list it as an alternative. If an encoding has no names, it is only required that no false
cause is named, as in docs/verify.md. The classic renderers are here; `new_toys` adds the others.
"""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from PIL import Image

from tests.wrong_renderers import ray_caster
from tests.wrong_renderers.ray_caster import Mistakes, Picture, packed, picture
from tests.wrong_renderers.worlds import Ints, World

TRIANGLES, OBJECTS, RGB = ENCODINGS = ("triangle-id", "object-id", "rgb")
SRGB = "srgb"
IDS = (TRIANGLES, OBJECTS)
GROUPS = ("classic", "new", "pairs")

Draw = Callable[[World, int, int, str], Picture]


@dataclass(frozen=True, kw_only=True, eq=False)
class Toy:
    """A renderer, and the names that `verify` must give."""

    name: str
    words: str  # description of the mistake in words
    draw: Draw
    encodings: tuple[str, ...] = ENCODINGS
    expected: Mapping[str, tuple[frozenset[str], ...]] = field(default_factory=dict)
    scene: str | None = None  # name of the renderer's only scene; None for `harbor` and `attic`
    group: str = "classic"  # one of `GROUPS`

    def causes(self, encoding: str) -> tuple[frozenset[str], ...]:
        """Return the names of each mistake; `verify` must give one name of each."""
        return self.expected.get(encoding, ())

    def names(self, encoding: str) -> frozenset[str]:
        """Return all names that `verify` may give."""
        return frozenset().union(*self.causes(encoding))


TWINS = {
    ("harbor", "corners"): ("aperture-offset", "scene-offset"),
    ("harbor", "moved-x"): ("aperture-offset", "scene-offset"),
    ("harbor", "moved-y"): ("aperture-offset", "scene-offset"),
    ("harbor", "tenth"): ("scene-scale", "pitch"),
    ("harbor", "tenfold"): ("scene-scale", "pitch"),
}
"""Pairs of causes with identical pictures. With a centered frustum an image depends only on (P - a)
/ s. Moving all apertures equals moving the scene in the opposite direction, and enlarging the scene
g times equals shrinking the plate g times.
"""


TOYS: dict[str, Toy] = {}


def add(
    name: str,
    words: str,
    draw: Draw | Mistakes,
    expected: str = "",
    on: tuple[str, ...] = (TRIANGLES,),
    *,
    encodings: tuple[str, ...] = ENCODINGS,
    scene: str | None = None,
    group: str = "classic",
) -> None:
    """Add a toy; `expected` has names separated by blanks, for the encodings `on`."""
    if isinstance(draw, Mistakes):
        mistakes = draw

        def draw(world: World, i: int, j: int, encoding: str) -> Picture:
            return picture(world, i, j, encoding, mistakes)

    names = dict.fromkeys(on, (frozenset(expected.split()),)) if expected else {}
    TOYS[name] = Toy(
        name=name,
        words=words,
        draw=draw,
        encodings=encodings,
        expected=names,
        scene=scene,
        group=group,
    )


def changed(change: Callable[[Picture], Picture]) -> Draw:
    """Return a renderer that changes the right picture afterwards."""
    return lambda world, i, j, encoding: np.ascontiguousarray(
        change(picture(world, i, j, encoding))
    )


def renumbered(change: Callable[[World, Ints], Ints]) -> Draw:
    """Return a renderer that changes ids, the number of triangle or object + 1, before packing."""

    def draw(world: World, i: int, j: int, encoding: str) -> Picture:
        claims = ray_caster.numbers(world, ray_caster.draw(world, i, j), encoding)
        return packed(change(world, claims))

    return draw


def other_order(world: World, i: int, j: int, encoding: str) -> Picture:
    """Number the objects, and hence their blocks of triangles, from last to first."""
    shown = ray_caster.draw(world, i, j)
    of = world.object_of[shown.triangle]
    count = np.bincount(world.object_of)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    first_new = np.concatenate([[0], np.cumsum(count[::-1])[:-1]])[::-1]
    claims = (
        shown.triangle - first[of] + first_new[of] if encoding == TRIANGLES else len(count) - 1 - of
    )
    return packed(np.where(shown.triangle < 0, 0, claims + 1))


def gray(world: World, i: int, j: int, encoding: str) -> Picture:
    """Convert a shaded picture to gray."""
    mean = picture(world, i, j, RGB).mean(axis=2)
    return np.dstack([mean] * 3).round().astype(np.uint8)


def jpeg(right: Picture) -> Picture:
    """Store the picture in a lossy file."""
    file = io.BytesIO()
    Image.fromarray(right).save(file, "JPEG", quality=90)
    return np.asarray(Image.open(file))


def scaled_up(how: Image.Resampling) -> Draw:
    """Draw the picture at half its size, and enlarge it."""

    def draw(world: World, i: int, j: int, encoding: str) -> Picture:
        small = world.once("small", lambda: ray_caster.resized(world, 0.5))
        return np.asarray(
            Image.fromarray(picture(small, i, j, encoding)).resize(world.resolution, how)
        )

    return draw


def antialiased(world: World, i: int, j: int, encoding: str) -> Picture:
    """Average two by two pixels of a picture twice as large."""
    larger = world.once("large", lambda: ray_caster.resized(world, 2.0))
    large = picture(larger, i, j, encoding).astype(float)
    mean = (large[::2, ::2] + large[1::2, ::2] + large[::2, 1::2] + large[1::2, 1::2]) / 4
    return np.asarray(mean.round(), dtype=np.uint8)


def elsewhere(place: Callable[[World, int, int], tuple[int, int]]) -> Draw:
    """Return a renderer that draws the right picture of another aperture."""
    return lambda world, i, j, encoding: picture(world, *place(world, i, j), encoding)


def square_film(world: World, i: int, j: int, encoding: str) -> Picture:
    """Use the film's horizontal extent for the vertical extent."""
    extent = np.tan(np.radians(world.fov_deg) / 2) if world.screen is None else world.screen[3:]
    return picture(world, i, j, encoding, Mistakes(film=(1.0, float(extent[0] / extent[1]))))


def half_angle(world: World, i: int, j: int, encoding: str) -> Picture:
    """Use the full angle, or width, in place of its half."""
    film = (2.0, 2.0)
    if world.screen is None:
        angles = np.radians(world.fov_deg)
        film = tuple((np.tan(angles) / np.tan(angles / 2)).tolist())
    return picture(world, i, j, encoding, Mistakes(film=film))


def outer_edges(world: World, i: int, j: int, encoding: str) -> Picture:
    """Place the outermost apertures on the plate's edges."""
    plate = (world.hogels[0] / (world.hogels[0] - 1), world.hogels[1] / (world.hogels[1] - 1))
    return picture(world, i, j, encoding, Mistakes(plate=plate))


def gamma(right: Picture) -> Picture:
    """Encode linear colors as sRGB."""
    return ray_caster.eight_bits(ray_caster.srgb(right / 255))


def noisy(world: World, i: int, j: int, encoding: str) -> Picture:
    """Add noise to colors; replace a third of the ids by random ids."""
    right, chance = picture(world, i, j, encoding), np.random.default_rng(97 * i + j)
    if encoding == RGB:
        return np.clip(right + chance.normal(0, 25, right.shape), 0, 255).astype(np.uint8)
    count = len(world.triangles) if encoding == TRIANGLES else len(world.parts)
    anything = packed(chance.integers(0, count + 1, right.shape[:2]))
    return np.where(chance.random(right.shape[:2])[..., None] < 1 / 3, anything, right)


add("right", "nothing", Mistakes())
add(
    "winding",
    "triangles are wound the other way; nothing is culled",
    lambda w, i, j, e: picture(w.once("rewound", lambda: ray_caster.rewound(w)), i, j, e),
)

# Numbers.
add(
    "blue-red",
    "blue and red are exchanged",
    changed(lambda p: p[..., ::-1]),
    "channel-order",
    IDS,
)
add(
    "green-red",
    "green and red are exchanged",
    changed(lambda p: p[..., [1, 0, 2]]),
    "channel-order",
    IDS,
)
add(
    "plus-none",
    "numbers without + 1",
    renumbered(lambda w, n: np.maximum(n - 1, 0)),
    "id-offset",
    IDS,
    encodings=IDS,
)
add(
    "plus-two",
    "numbers + 2",
    renumbered(lambda w, n: np.where(n, n + 1, 0)),
    "id-offset",
    IDS,
    encodings=IDS,
)
add(
    "low-byte",
    "the low 8 bits alone",
    renumbered(lambda w, n: n & 255),
    "8-bit-overflow",
    encodings=IDS,
)
add(
    "restarting",
    "triangles counted from zero in each object",
    renumbered(lambda w, n: np.where(n, n - np.searchsorted(w.object_of, w.object_of)[n - 1], 0)),
    "numbers-restarting",
    encodings=(TRIANGLES,),
)
add(
    "low-byte-gray",
    "the low 8 bits in all three channels",
    renumbered(lambda w, n: (n & 255) * 0x010101),
    "8-bit-overflow",
    encodings=(TRIANGLES,),
)
add(
    "white-background",
    "nothing is white",
    renumbered(lambda w, n: np.where(n, n, 0xFFFFFF)),
    "background-id",
    IDS,
    encodings=IDS,
)
add(
    "two-bytes",
    "the low 16 bits alone",
    renumbered(lambda w, n: n & 65535),
    "8-bit-overflow 16-bit-overflow id-overflow",
    encodings=(TRIANGLES,),
    scene="crowd",
)
add(
    "crowd-right", "nothing, of 66,636 triangles", Mistakes(), encodings=(TRIANGLES,), scene="crowd"
)
add("gray", "a gray shaded picture", gray, "wrong-encoding", IDS)
add(
    "gray-for-screens",
    "a gray shaded picture as sRGB",
    lambda *at: gamma(gray(*at)),
    "wrong-encoding",
    IDS,
    encodings=IDS,
)
add("white", "all white", changed(lambda p: np.full_like(p, 255)))
add("black", "all black", changed(np.zeros_like))
add(
    "objects-for-triangles",
    "numbers of objects where triangles are asked for",
    lambda w, i, j, e: picture(w, i, j, OBJECTS),
    "wrong-encoding",
    encodings=(TRIANGLES,),
)
add(
    "triangles-for-objects",
    "numbers of triangles where objects are asked for",
    lambda w, i, j, e: picture(w, i, j, TRIANGLES),
    "wrong-encoding",
    (OBJECTS,),
    encodings=(OBJECTS,),
)
add("other-order", "objects are numbered from the last", other_order, encodings=IDS)
add("noise", "noise", noisy)

# Pixels.
add(
    "rolled",
    "images rolled by 5 px to the right",
    changed(lambda p: np.roll(p, 5, axis=1)),
)
add(
    "resampled-nearest",
    "drawn at half the size, nearest",
    scaled_up(Image.Resampling.NEAREST),
)
add(
    "resampled-bilinear",
    "drawn at half the size, bilinear",
    scaled_up(Image.Resampling.BILINEAR),
    "resampled wrong-encoding",
    IDS,
)
add("jpeg", "JPEG", changed(jpeg), "lossy resampled wrong-encoding", IDS)
add("antialiased", "anti-aliased", antialiased, "resampled wrong-encoding", IDS)
add("mirrored", "mirrored", changed(lambda p: p[:, ::-1]), "orientation", ENCODINGS)
add("upside-down", "upside down", changed(lambda p: p[::-1]), "orientation", ENCODINGS)
add("half-pixel", "sampled at pixel corners", Mistakes(sample=(-0.5, -0.5)), "shift-x shift-y")

# Apertures.
add(
    "rows-from-below",
    "rows of apertures are counted from below",
    elsewhere(lambda w, i, j: (i, w.hogels[1] - 1 - j)),
    "aperture-order",
    ENCODINGS,
)
add(
    "all-upside-down",
    "upside down, rows counted from below",
    lambda w, i, j, e: picture(w, i, w.hogels[1] - 1 - j, e)[::-1],
    "orientation aperture-order",
)
add(
    "every-second",
    "every second hogel is a copy",
    elsewhere(lambda w, i, j: (i - (i + j) % 2 * (1 if i else -1), j)),
)
add(
    "one-hogel",
    "one hogel is another's",
    elsewhere(lambda w, i, j: (2, 1) if (i, j) == (1, 1) else (i, j)),
)
add(
    "corners",
    "apertures at their hogels' corners",
    Mistakes(aperture=(-0.5, 0.5)),
    "aperture-offset",
)
add("edge-to-edge", "outer apertures on the plate's edges", outer_edges, "pitch-x pitch-y")

# The scene.
add("moved-x", "the scene moved by x = 0.8", Mistakes(move=(0.8, 0.0, 0.0)), "scene-offset")
add("moved-y", "the scene moved by y = -1.5", Mistakes(move=(0.0, -1.5, 0.0)), "scene-offset")
add("moved-z", "the scene moved by z = 2", Mistakes(move=(0.0, 0.0, 2.0)), "scene-offset")
add(
    "moved-all",
    "the scene moved by (1, 0.7, -1.5)",
    Mistakes(move=(1.0, 0.7, -1.5)),
    "scene-offset",
)
add("tenth", "millimeters taken for centimeters: a tenth", Mistakes(scale=0.1), "scene-scale")
# Without a reach there is a second fault, which has no name. A smaller plate is also accepted as
# the cause if it looks the same.
add(
    "tenfold",
    "ten times as large, without a reach",
    Mistakes(scale=10.0, any_reach=True),
    "scene-scale does-not-explain",
)
# In the harbor, this scene is invisible from all hogels: black pictures show nothing.
add("inches", "a 25.4th", Mistakes(scale=1 / 25.4), "scene-scale", scene="attic")

# Halves.
add("nearest", "the nearest surface wins in C*", Mistakes(winner="nearest in C*"), "front-nearest")
add(
    "no-front",
    "the viewer's half is missing",
    Mistakes(winner="no front"),
    "front-missing",
    ENCODINGS,
)
add(
    "no-back",
    "the half behind the plate is missing",
    Mistakes(winner="no back"),
    "back-missing",
    ENCODINGS,
)
add(
    "back-over-front",
    "C is drawn over C*",
    Mistakes(winner="back over front"),
    "not-overlaid",
    ENCODINGS,
)
add("farthest", "the farthest surface wins in C", Mistakes(winner="farthest in C"), "back-farthest")
add("culled", "faces seen counterclockwise are culled", Mistakes(cull=1))
add("culled-back", "faces seen clockwise are culled", Mistakes(cull=-1))

# Cameras.
add("near", "both cameras step back by 2", Mistakes(near=2.0), "near")
add("near-small", "both cameras step back by 0.3", Mistakes(near=0.3), "near")
add("fov", "the film is 5 % too wide and high", Mistakes(film=(1.05, 1.05)), "fov-x fov-y")
add("half-angle", "the full field of view is taken for half of it", half_angle, "fov-x fov-y")
add("square-film", "the horizontal field of view for the vertical one", square_film, "fov-y")

# One camera is wrong, the other right.
for _camera, _half, _which in ((0, "back", "C"), (1, "front", "C*")):
    for _name, _words, _one in (
        ("near-offset", "steps back by 1", Mistakes(near=1.0)),
        ("fov", "has a film 5 % too wide and high", Mistakes(film=(1.05, 1.05))),
        ("shift", "samples pixels at their corners", Mistakes(sample=(-0.5, -0.5))),
        ("mirrored", "is mirrored", Mistakes(film=(-1.0, 1.0))),
        ("unturned", "is turned by 180 degrees", Mistakes(film=(-1.0, -1.0))),
    ):
        _expected = f"{_half}-{_name}"
        # Pictures without triangle numbers show which half is mirrored, but not small errors of a
        # half.
        _on = ENCODINGS if _name in ("mirrored", "unturned") else (TRIANGLES,)
        add(_expected, f"{_which} alone {_words}", replace(_one, only=_camera), _expected, _on)

# The projection screen of a recentered frustum
for _fault, _words, _mistakes in (
    ("screen-height", "the projection screen is 1.25 times as high", Mistakes(screen_height=1.25)),
    ("screen-center", "the projection screen is moved by (4, -3)", Mistakes(screen_center=(4, -3))),
    ("not-recentered", "no camera is sheared", Mistakes(shear=(0.0, 0.0))),
    ("shear-sign", "C* is sheared the way of C", Mistakes(shear=(1.0, -1.0))),
):
    add(_fault, _words, _mistakes, _fault, scene="attic")
    _both = f"{_words}; both cameras step back by 2"
    add(f"{_fault}-near", _both, replace(_mistakes, near=2.0), _fault, scene="attic")

# Light.
COLORS = (RGB,)
add(
    "lights",
    "lights are not conjugated",
    Mistakes(light="not conjugated"),
    "lights",
    COLORS,
    encodings=COLORS,
)
add(
    "gamma", "sRGB given as linear", changed(gamma), "srgb-read-as-linear", COLORS, encodings=COLORS
)
add("headlight", "another light, no ambient", Mistakes(light="head"), encodings=COLORS)
add("relit", "another light", Mistakes(light="other"), encodings=COLORS)
