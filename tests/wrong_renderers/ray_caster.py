"""The right renderer, from CONVENTIONS.md: the first triangle, from the viewer, on each line wins.

Mistakes of geometry are settings; the defaults are right.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.wrong_renderers.worlds import Floats, Ints, World

Picture = NDArray[np.uint8]
# Number of pixels cast together: their products with all triangles fit into the processor's cache
BLOCK = 24


FRONT = 1e6  # offset of ranks, mm: more than any reach, so that one half precedes the other


@dataclass(frozen=True, kw_only=True)
class Mistakes:
    """Deviations of a renderer from the right one; the defaults are right."""

    move: tuple[float, float, float] = (0.0, 0.0, 0.0)  # translation of the scene, mm
    scale: float = 1.0  # factor of the scene about the plate's center; the plate stays
    any_reach: bool = False  # whether surfaces out of reach are drawn
    reach: tuple[float, float] = (
        1.0,
        1.0,
    )  # factors of the reach toward the viewer and behind the plate
    aperture: tuple[float, float] = (
        0.0,
        0.0,
    )  # offset of each aperture to the right and up, in hogels
    plate: tuple[float, float] = (1.0, 1.0)  # factors of the distances between apertures
    film: tuple[float, float] = (1.0, 1.0)  # factors of the film's extent
    angles: str = (
        ""  # axes whose pixels have equal angles: `x`, `y`, `xy`; `radial` for a fisheye lens
    )
    distortion: float = (
        0.0  # outward shift of the film's corners as a share: > 0 barrel, < 0 pincushion
    )
    sample: tuple[float, float] = (
        0.0,
        0.0,
    )  # offset of a pixel's sampling point to the right and down, px
    near: float = 0.0  # distance by which both cameras step back, mm
    screen_height: float = 1.0  # factor of the projection screen's height; its size stays
    screen_center: tuple[float, float] = (0.0, 0.0)  # offset of the projection screen's center, mm
    shear: tuple[float, float] = (1.0, 1.0)  # factors of the shears of C and C*
    only: int | None = None
    """Only camera with this film, sampling point and near offset: 0 is C, 1 is C*; None: both."""
    winner: str = "first"  # rule for the surface that wins, a name in `rank`
    depth_bits: int = 0  # bits of the depth buffer with standard mapping; 0 for exact depths
    cull: int = 0
    """Culled winding: 1 for triangles seen counterclockwise, -1 for the others, 0 for none."""
    light: str = "right"
    """Light: `right`, `not conjugated` (on C*'s wrong side) or `head` (from the viewer, without
    ambient).
    """
    normals: str = "right"  # normals: `right`, `flat` (of triangles) or `inverted`


RIGHT = Mistakes()


@dataclass(frozen=True, eq=False)
class Hits:
    """All intersections of lines and triangles, unordered."""

    pixel: Ints
    triangle: Ints
    s: Floats  # (M,) s of each intersection, from the line's center; negative on the viewer's side
    weights: Floats  # (M, 3) barycentric coordinates of each intersection

    @property
    def fields(self) -> tuple[Ints, Ints, Floats, Floats]:
        return self.pixel, self.triangle, self.s, self.weights

    def of(self, keep: NDArray[np.bool_] | Ints, further: float = 0.0) -> "Hits":
        """Return some of the intersections, with s from a center that lies `further` back."""
        return Hits(
            self.pixel[keep], self.triangle[keep], self.s[keep] + further, self.weights[keep]
        )


def cast(triangles: Floats, center: Floats, directions: Floats) -> Hits:
    """Intersect lines through one center, directions (N, 3), with triangles (T, 3, 3)."""
    a, b, c = np.moveaxis(triangles - center, 1, 0)
    sides = [np.cross(b, c).T, np.cross(c, a).T, np.cross(a, b).T]
    volume = np.einsum("ti,it->t", a, sides[0])
    pixels, numbers, depths, weights = [], [], [], []
    for start in range(0, len(directions), BLOCK):
        e, f, g = (directions[start : start + BLOCK] @ side for side in sides)
        pixel, number = np.nonzero((e * f >= 0) & (f * g >= 0) & (g * e >= 0))
        parts = np.stack([side[pixel, number] for side in (e, f, g)], axis=1)
        total = parts.sum(axis=1)
        flat = total != 0
        pixel, number, total, parts = pixel[flat], number[flat], total[flat], parts[flat]
        pixels.append(pixel + start)
        numbers.append(number)
        depths.append(volume[number] / total)
        weights.append(parts / total[:, None])
    return Hits(*(np.concatenate(of) for of in (pixels, numbers, depths, weights)))


def lines(
    world: World, i: int, j: int, wrong: Mistakes = RIGHT, camera: int = 0
) -> tuple[Floats, Floats, Floats]:
    """Return an aperture, the directions (H * W, 3) of its lines, and its shear.

    CONVENTIONS.md defines the lines. They belong to C (camera 0) or C* (camera 1), which are equal
    without mistakes.
    """
    (columns, rows), (width, height) = world.hogels, world.resolution
    sx, sy = world.size
    wrong = of_camera(wrong, camera)
    x = ((i + 0.5) * sx / columns - sx / 2) * wrong.plate[0] + wrong.aperture[0] * sx / columns
    y = (sy / 2 - (j + 0.5) * sy / rows) * wrong.plate[1] + wrong.aperture[1] * sy / rows
    k, t = np.zeros(2), np.tan(np.radians(world.fov_deg) / 2)
    if world.screen:
        z = world.screen[0] * wrong.screen_height
        center = np.add(world.screen[1:3], wrong.screen_center)
        k = wrong.shear[camera] * (center - [x, y]) / -z
        t = np.array(world.screen[3:]) / 2 / abs(z)
    t = t * wrong.film
    u = (2 * (np.arange(width) + wrong.sample[0]) + 1) / width - 1
    v = 1 - (2 * (np.arange(height) + wrong.sample[1]) + 1) / height
    across, up = slopes(u[None, :], v[:, None], t, wrong)
    grid = np.broadcast_arrays(k[0] + across, k[1] + up, -1.0)
    return (
        np.array([x, y, 0.0]),
        np.stack(grid, axis=-1).reshape(-1, 3),
        np.append(k, 0.0),
    )


def slopes(u: Floats, v: Floats, t: Floats, wrong: Mistakes) -> tuple[Floats, Floats]:
    """Return the slopes of lines relative to the film's middle, through the renderer's lens."""
    across, up = u * t[0], v * t[1]
    if "x" in wrong.angles:
        across = np.tan(u * np.arctan(t[0]))
    if "y" in wrong.angles:
        up = np.tan(v * np.arctan(t[1]))
    share = np.hypot(across, up) / np.hypot(*t)
    factor = 1 + wrong.distortion * share**2
    if wrong.angles == "radial":
        corner = np.hypot(*t)
        factor = np.tan(share * np.arctan(corner)) / (np.maximum(share, 1e-12) * corner)
    return across * factor, up * factor


def of_camera(wrong: Mistakes, camera: int) -> Mistakes:
    """Return the mistakes of one camera; the other has the right film, sampling points and near."""
    right = wrong.only not in (None, camera)
    return replace(wrong, film=(1.0, 1.0), sample=(0.0, 0.0), near=0.0) if right else wrong


def all_hits(world: World, i: int, j: int, wrong: Mistakes = RIGHT) -> tuple[Hits, Floats]:
    """Return the intersections of both cameras' lines in their halves, and the directions."""
    center, directions, shear = lines(world, i, j, wrong)
    _, directions_star, shear_star = lines(world, i, j, wrong, 1)
    triangles = world.triangles[world.seen] * wrong.scale + wrong.move
    n, n_star = (of_camera(wrong, camera).near for camera in (0, 1))
    if n == n_star == 0 and wrong.shear[0] == wrong.shear[1] and wrong.only is None:
        hits = cast(triangles, center, directions)
    else:
        up = np.array([0.0, 0.0, 1.0])
        behind, before = (
            cast(triangles, center + n * (up - shear), directions),
            cast(triangles, center - n_star * (up - shear_star), directions_star),
        )
        behind, before = behind.of(behind.s > n, -n), before.of(before.s < -n_star, n_star)
        hits = Hits(
            *(np.concatenate(both) for both in zip(behind.fields, before.fields, strict=True))
        )
    s = hits.s
    front, back = np.multiply(world.reach, wrong.reach)
    keep = (s != 0) & (wrong.any_reach | ((s >= -front) & (s <= back)))
    along = np.where((s < 0)[:, None], directions_star[hits.pixel], directions[hits.pixel])
    if wrong.cull:
        a, b, c = np.moveaxis(triangles[hits.triangle], 1, 0)
        seen = np.einsum("ni,ni->n", np.cross(b - a, c - a), -along)
        keep &= np.sign(seen) != wrong.cull
    return replace(hits, triangle=world.seen[hits.triangle]).of(keep), along[keep]


def rank(s: Floats, winner: str) -> Floats:
    """Return ranks, smallest for the winning surface, infinite for surfaces that are not drawn."""
    front = s < 0
    return {
        "first": s,
        "nearest in C*": np.where(front, -s - FRONT, s),
        "no front": np.where(front, np.inf, s),
        "no back": np.where(front, s, np.inf),
        "back over front": np.where(front, s + FRONT, s),
        "farthest in C": np.where(front, s, FRONT - s),
    }[winner]


def coarse(s: Floats, world: World, wrong: Mistakes) -> Floats:
    """Return the stored depth of each s, with the sign of s; the first triangle wins a tie."""
    w = np.abs(s) + wrong.near
    far = wrong.near + np.where(s < 0, *world.reach)
    stored = np.round((2**wrong.depth_bits - 1) * far * (w - wrong.near) / (w * (far - wrong.near)))
    return np.asarray(np.sign(s) * (1 + stored))


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """Image of an aperture: triangle numbers, -1 for none, and unrounded linear radiance."""

    triangle: Ints  # (H, W) triangle numbers
    radiance: Floats  # (H, W, 3) linear radiance


def draw(world: World, i: int, j: int, wrong: Mistakes = RIGHT) -> Drawing:
    """Return the drawing of one hogel; the world keeps it."""
    return world.once((i, j, wrong), lambda: _draw(world, i, j, wrong))


def met(world: World, i: int, j: int) -> Ints:
    """Return pixel * (number of triangles + 1) + triangle, sorted, for all true intersections."""

    def keys() -> Ints:
        hits, _ = all_hits(world, i, j)
        return np.unique(hits.pixel * (len(world.triangles) + 1) + hits.triangle)

    return world.once(("met", i, j), keys)


def _draw(world: World, i: int, j: int, wrong: Mistakes) -> Drawing:
    hits, along = all_hits(world, i, j, wrong)
    first = rank(coarse(hits.s, world, wrong) if wrong.depth_bits else hits.s, wrong.winner)
    order = np.lexsort((first, hits.pixel))
    order = order[np.isfinite(first[order])]
    pixel, at = np.unique(hits.pixel[order], return_index=True)
    width, height = world.resolution
    triangle, radiance = np.full(height * width, -1), np.zeros((height * width, 3))
    triangle[pixel] = hits.triangle[order][at]
    radiance[pixel] = shade(world, hits.of(order[at]), along[order][at], wrong)
    return Drawing(
        triangle=triangle.reshape(height, width), radiance=radiance.reshape(height, width, 3)
    )


def shade(world: World, hits: Hits, directions: Floats, wrong: Mistakes) -> Floats:
    """Return radiance by Phong, with normals turned to the visible side of the triangle."""
    eye = -directions / np.linalg.norm(directions, axis=1, keepdims=True)
    a, b, c = np.moveaxis(world.triangles[hits.triangle], 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    normal = np.einsum("nc,nci->ni", hits.weights, world.normals[hits.triangle])
    normal = (
        flat if wrong.normals == "flat" else normal / np.linalg.norm(normal, axis=1, keepdims=True)
    )
    turned = np.where(np.einsum("ni,ni->n", flat, eye) < 0, -1.0, 1.0)[:, None]
    normal = normal * (-turned if wrong.normals == "inverted" else turned)
    light = np.broadcast_to(np.array(world.light) / np.linalg.norm(world.light), eye.shape)
    if wrong.light == "not conjugated":
        light = np.where((hits.s < 0)[:, None], -light, light)
    if wrong.light in ("head", "other"):
        light = np.broadcast_to(np.array([0.0, 0.0, 1.0]), eye.shape)
    mirrored = 2 * np.einsum("ni,ni->n", normal, eye)[:, None] * normal - eye
    facing, gloss = np.einsum("ni,ni->n", normal, light), np.einsum("ni,ni->n", mirrored, light)
    of = world.object_of[hits.triangle]
    diffuse, ambient, specular, exponent = (
        np.array([getattr(part, name) for part in world.parts])[of]
        for name in ("diffuse", "ambient", "specular", "exponent")
    )
    shine = np.where(facing > 0, specular * np.maximum(gloss, 0) ** exponent, 0.0)
    around = 0.0 if wrong.light == "head" else ambient
    return np.asarray((around + shine)[:, None] + diffuse * np.maximum(facing, 0)[:, None])


def numbers(world: World, shown: Drawing, encoding: str) -> Ints:
    """Return ids: the number of the triangle or the object + 1, 0 for none."""
    if encoding == "triangle-id":
        return shown.triangle + 1
    return np.where(shown.triangle < 0, 0, world.object_of[shown.triangle] + 1)


def packed(claims: Ints) -> Picture:
    """Return ids as colors: red * 65536 + green * 256 + blue."""
    return np.stack([claims >> 16 & 255, claims >> 8 & 255, claims & 255], axis=-1).astype(np.uint8)


def eight_bits(radiance: Floats) -> Picture:
    """Return linear radiance of 0 to 1 as bytes of 0 to 255."""
    return np.asarray(np.round(255 * np.clip(radiance, 0, 1)), dtype=np.uint8)


def srgb(linear: Floats) -> Floats:
    """Encode linear values of 0 to 1 as sRGB."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def linear(encoded: Floats) -> Floats:
    """Decode sRGB to linear values."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def picture(world: World, i: int, j: int, encoding: str, wrong: Mistakes = RIGHT) -> Picture:
    """Draw a hogel as a picture in an encoding."""
    shown = draw(world, i, j, wrong)
    if encoding == "rgb":
        return eight_bits(shown.radiance)
    if encoding == "srgb":
        return eight_bits(srgb(shown.radiance))
    return packed(numbers(world, shown, encoding))


def rewound(world: World) -> World:
    """Return the scene with the corners of all triangles in the opposite order."""
    parts = tuple(replace(part, faces=part.faces[:, ::-1]) for part in world.parts)
    return replace(world, parts=parts, drawn={})


def resized(world: World, factor: float) -> World:
    """Return the scene with the film's resolution scaled by a factor."""
    width, height = world.resolution
    return replace(world, resolution=(round(width * factor), round(height * factor)), drawn={})
