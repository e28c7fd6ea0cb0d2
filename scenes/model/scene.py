"""Scene, the input of every renderer: immutable, validated, in scene coordinates."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property, reduce
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.appearance import DEFAULT_LIGHT, Appearance, Material, Sampling, Transport
from xfrustum.scenes.arguments import InputError, one_of, settle
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Numbers
from xfrustum.scenes.plate import Aperture, Frustum, Plate
from xfrustum.scenes.representation import ShortRepr

#: Bounds of the lengths of plate, reach and screen, and of the largest coordinate. Products of two
#: lengths are within the range of float32 in pictures, and products of three lengths are far within
#: the range of doubles, so that rounding bounds are valid.
SHORTEST, LONGEST = 1e-30, 1e30
#: Smallest coordinate of a vertex other than zero. Differences of two such numbers are zero or at
#: least 2^-53 times this bound. Products of three differences are within the range of doubles even
#: if all digits of a sum but the last cancel, so that the relative rounding bounds are valid
#: (docs/truth.md).
SMALLEST_COORDINATE = 1e-75
#: largest slope of a line: beyond it float64 cannot separate neighboring pixels' lines
STEEPEST = 1e12
#: Number of triangles processed at once. It bounds the memory of intermediate results, 300 bytes
#: per triangle, in scenes of many million triangles.
TRIANGLES_AT_ONCE = 1 << 19
MAX_LISTED_OBJECTS = 24  #: largest number of objects that a notebook lists; it counts the rest
_Scalar = TypeVar("_Scalar", bound=np.generic)


def read_only(array: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """Return the array, made read-only."""
    array.flags.writeable = False
    return array


class NormalsMade(StrEnum):
    """Vertex normals of an object that are computed from its faces."""

    NONE = "none"
    SOME = "some"
    ALL = "all"


@dataclass(frozen=True)
class UnreadFeature:
    """Unread feature of a mesh file; it changes only the appearance.

    An unread feature that would change geometry or position is refused with InputError instead.
    """

    feature: str  #: name in the file's own format, such as "KHR_texture_transform"
    consequence: str  #: consequence, a verb phrase, such as "is not applied to the texture"

    def __str__(self) -> str:
        return f"{self.feature} {self.consequence}"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneObject(ShortRepr):
    """One object of a scene: a triangle mesh in scene coordinates.

    Vertex normals, of any length, lie on the side that the winding faces; they are interpolated
    linearly and then normalized. A triangle is flat if a corner has no normal. Raises InputError
    for an invalid mesh.
    """

    name: str  #: mesh file or built-in shape of the object
    vertices: Floats  #: (V, 3) scene units, finite
    faces: Indices  #: (F, 3) indices into `vertices`, at least one
    material: str | None = None  #: name of the material table; None for the default
    uv: Floats | None = None  #: (V, 2) texture coordinates, v up; NaN if a vertex has none
    textures: tuple[
        Bytes, ...
    ] = ()  #: (H, W, 4) uint8 sRGB base colors with alpha, row 0 at the top
    texture_of_triangle: Numbers | None = None  #: (F,) index into `textures`, or `UNTEXTURED`
    vertex_normals: Floats | None = None  #: (V, 3), NaN if a vertex has no normal
    vertex_colors: Floats | None = None  #: (V, 3) linear RGB
    normals_made: NormalsMade = NormalsMade.NONE  #: normals computed from faces (`smooth = true`)
    unread: tuple[UnreadFeature, ...] = ()  #: unread features of the mesh file
    warnings: tuple[str, ...] = ()  #: doubts about the placement, one line each

    def __post_init__(self) -> None:
        one_of(self.name, str, "an object's name")
        if self.material is not None:
            one_of(self.material, str, f"{self.name}: the name of a material")
        try:
            vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.name}: vertices must be numbers, (V, 3) ({error})") from error
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise InputError(
                f"{self.name}: vertices must be one triple each, (V, 3), not {vertices.shape}"
            )
        indices = np.asarray(self.faces)
        # Fractional indices are refused, not rounded.
        if indices.dtype.kind not in "iu" and indices.size:
            raise InputError(
                f"{self.name}: faces must be whole numbers, (F, 3), not of type {indices.dtype}"
            )
        faces = np.ascontiguousarray(indices, dtype=np.int64)
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
            raise InputError(f"{self.name}: the mesh has no triangles; give it a mesh with faces")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(
                f"{self.name}: faces point past the vertices (index {faces.max()}, "
                f"{len(vertices)} vertices); export the mesh again"
            )
        if not np.isfinite(vertices).all():
            bad = int(np.count_nonzero(~np.isfinite(vertices).all(axis=1)))
            raise InputError(
                f"{self.name}: {bad} vertices are NaN or infinite in scene coordinates; "
                "repair the mesh or its transform"
            )
        for name in ("vertex_normals", "vertex_colors"):
            values = getattr(self, name)
            if values is None:
                continue
            if np.shape(values) != vertices.shape:
                raise InputError(f"{self.name}: {name} must be one triple per vertex")
            settle(self, **{name: read_only(np.array(values, dtype=np.float64))})
        settle(self, vertices=read_only(vertices), faces=read_only(faces))


UNTEXTURED = -1  #: number in `texture_of_triangle` of a triangle without a texture


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SurfaceAttributes(ShortRepr):
    """Attributes of all vertices and triangles, as in `SceneObject`; None if no object has any.

    For objects without an attribute, colors are one, and normals and texture coordinates are
    NaN.
    """

    vertex_normals: Floats | None
    vertex_colors: Floats | None
    uv: Floats | None
    textures: tuple[Bytes, ...]
    texture_of_triangle: Numbers | None

    @classmethod
    def from_objects(cls, objects: Sequence[SceneObject]) -> SurfaceAttributes:
        """Return the attributes of all objects, joined."""

        def joined(name: str, width: int, missing: float) -> Floats | None:
            columns = [(getattr(part, name), (len(part.vertices), width)) for part in objects]
            if all(values is None for values, _ in columns):
                return None
            return np.concatenate(
                [np.full(s, missing) if values is None else values for values, s in columns]
            )

        textures: list[Bytes] = []
        numbers = []
        for part in objects:
            own = part.texture_of_triangle
            if own is None or part.uv is None:
                numbers.append(np.full(len(part.faces), UNTEXTURED, dtype=np.int32))
                continue
            # A triangle has no texture if a corner lacks texture coordinates.
            placed = np.isfinite(part.uv[part.faces]).all(axis=(1, 2))
            numbers.append(
                np.where((own >= 0) & placed, own + len(textures), UNTEXTURED).astype(np.int32)
            )
            textures += part.textures
        textured = bool(textures) and any((part >= 0).any() for part in numbers)
        return cls(
            vertex_normals=joined("vertex_normals", 3, np.nan),
            vertex_colors=joined("vertex_colors", 3, 1.0),
            uv=joined("uv", 2, np.nan),
            textures=tuple(textures) if textured else (),
            texture_of_triangle=np.concatenate(numbers) if textured else None,
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scene(ShortRepr):
    """Plate, frustum and objects: the input of every renderer; there may be no objects.

    Triangles are numbered consecutively through the objects, and within an object in the order of
    its faces. Coordinates are zero or between `SMALLEST_COORDINATE` and `LONGEST`.
    """

    name: str
    plate: Plate
    frustum: Frustum
    objects: tuple[SceneObject, ...]
    units: str = "units"  #: name of the scene's unit of length, for reports
    source: str = ""  #: path or built-in name by which the command line opens this scene
    appearance: Appearance = field(default_factory=Appearance)  #: by default gray, with one light
    sampling: Sampling = field(default_factory=Sampling)  #: by default one sample
    transport: Transport = field(default_factory=Transport)  #: by default no light paths

    def __post_init__(self) -> None:
        kinds = {"name": str, "units": str, "plate": Plate, "frustum": Frustum, "objects": Iterable}
        kinds |= {"appearance": Appearance, "sampling": Sampling, "transport": Transport}
        for name, kind in kinds.items():
            one_of(getattr(self, name), kind, f"a scene's {name}")
        settle(self, objects=tuple(self.objects))
        for number, part in enumerate(self.objects):
            one_of(part, SceneObject, f"object {number} of a scene")
        lengths = [*self.plate.size, *self.frustum.reach]
        for part in self.objects:
            coordinates = np.abs(part.vertices)
            smallest = float(coordinates.min(where=coordinates > 0, initial=np.inf))
            if smallest < SMALLEST_COORDINATE:
                raise InputError(
                    f"{self.name}: {part.name} has a coordinate of {smallest:.3g} "
                    f"{self.units}, which is not "
                    f"zero but below {SMALLEST_COORDINATE:.0e}, where no bound on rounding "
                    "holds; round it "
                    "to zero, or scale the mesh"
                )
        corners = [float(np.abs(part.vertices).max()) for part in self.objects]
        screen = self.frustum.screen
        if screen is not None:
            lengths += [abs(screen.height), *screen.size, *(abs(c) for c in screen.center if c)]
            # Largest lateral distance of a line on its way from an aperture to the screen.
            extents = zip(screen.center, screen.size, self.plate.size, strict=True)
            aside = max(abs(center) + size + plate for center, size, plate in extents)
            if aside > STEEPEST * abs(screen.height):
                raise InputError(
                    f"frustum.screen.height {screen.height} is too small for a screen and a "
                    "plate of this "
                    f"size: lines may run aside at most {STEEPEST:.0e} times their depth"
                )
        if min(lengths) < SHORTEST or max((*lengths, *corners)) > LONGEST:
            raise InputError(
                f"{self.name}: lengths must lie between {SHORTEST:.0e} and {LONGEST:.0e} "
                f"{self.units}, "
                "which is what 32-bit images can hold; choose another unit of length"
            )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Unread features of mesh files and doubtful placements; each line once."""
        unread = [f"{part.name}: {feature}" for part in self.objects for feature in part.unread]
        doubtful = [line for part in self.objects for line in part.warnings]
        return tuple(dict.fromkeys([*unread, *doubtful]))

    @cached_property
    def vertices(self) -> Floats:
        """(V, 3) vertices of all objects, scene units."""
        parts = [o.vertices for o in self.objects]
        return read_only(np.concatenate(parts) if parts else np.zeros((0, 3)))

    @cached_property
    def faces(self) -> Indices:
        """(F, 3) faces of all objects; the row is the triangle number."""
        offsets = np.cumsum([0, *(len(o.vertices) for o in self.objects)])
        parts = [o.faces + offset for o, offset in zip(self.objects, offsets, strict=False)]
        return read_only(np.concatenate(parts) if parts else np.zeros((0, 3), dtype=np.int64))

    @cached_property
    def object_of_triangle(self) -> Numbers:
        """(F,) object number of each triangle."""
        counts = [len(o.faces) for o in self.objects]
        return read_only(np.repeat(np.arange(len(counts), dtype=np.int32), counts))

    @cached_property
    def object_of_number(self) -> Numbers:
        """(F + 1,) object number by triangle number; `NOTHING`, -1, maps to itself."""
        return read_only(np.append(self.object_of_triangle, np.int32(-1)))

    @cached_property
    def triangles(self) -> Floats:
        """(F, 3, 3) corner positions: triangle, corner, coordinate."""
        return read_only(self.vertices[self.faces])

    @cached_property
    def bounds(self) -> Floats:
        """(2, 3) lowest and highest coordinates of all vertices; NaN where there are none."""
        if not len(self.vertices):
            return read_only(np.full((2, 3), np.nan))
        return read_only(np.stack((self.vertices.min(axis=0), self.vertices.max(axis=0))))

    @cached_property
    def height_ranges(self) -> Floats:
        """(2, F) lowest and highest z of each triangle."""
        # Process corner by corner, here and below: NumPy is several times slower along rows of
        # three numbers.
        z = self.vertices[:, 2][self.faces.T]
        return read_only(np.stack((reduce(np.minimum, z), reduce(np.maximum, z))))

    @cached_property
    def largest_coordinates(self) -> Floats:
        """(F,) largest absolute coordinate of each triangle, the scale of rounding errors."""
        of_vertex = reduce(np.maximum, np.abs(self.vertices.T))
        return read_only(reduce(np.maximum, of_vertex[self.faces.T]))

    @cached_property
    def normals(self) -> Floats:
        """(F, 3) unit normals by the mesh's winding; zero for triangles without area."""
        normals = np.zeros((len(self.faces), 3))
        for start in range(0, len(normals), TRIANGLES_AT_ONCE):
            corners = self.triangles[start : start + TRIANGLES_AT_ONCE]
            edges = np.ascontiguousarray((corners[:, 1:] - corners[:, :1]).reshape(-1, 6).T)
            scale = reduce(np.maximum, np.abs(edges))
            edges /= np.where(scale > 0, scale, 1.0)
            ax, ay, az, bx, by, bz = edges
            cross = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            length = np.sqrt(cross[0] ** 2 + cross[1] ** 2 + cross[2] ** 2)
            for axis, along in enumerate(cross):
                np.divide(
                    along, length, out=normals[start : start + len(corners), axis], where=length > 0
                )
        return read_only(normals)

    @cached_property
    def twins(self) -> Indices:
        """(F, 3) number of the coincident side of another triangle: 3 * triangle + side.

        Side k is from corner k to the next corner. The number is -1 unless exactly one other
        triangle of the object has corners at the same two positions.
        """
        _, place = np.unique(self.vertices + 0.0, axis=0, return_inverse=True)
        corners = place.reshape(-1)[self.faces]
        ends = np.sort(np.stack((corners, np.roll(corners, -1, axis=1)), axis=-1), axis=-1).reshape(
            -1, 2
        )
        owner = np.repeat(self.object_of_triangle, 3)
        order = np.lexsort((ends[:, 1], ends[:, 0], owner))
        keys = np.column_stack((owner, ends))[order]
        same = np.append((keys[1:] == keys[:-1]).all(axis=1), False)
        # Keep groups of exactly two equal sides: in sorted order the sides before and after them
        # differ.
        first = np.flatnonzero(same & ~np.roll(same, 1) & ~np.roll(same, -1))
        twins = np.full(len(ends), -1)
        twins[order[first]], twins[order[first + 1]] = order[first + 1], order[first]
        return read_only(twins.reshape(-1, 3))

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of plate, frustum and triangles, which determine the geometry of images."""
        digest = hashlib.sha256()
        parameters: dict[str, Any] = {"plate": asdict(self.plate), "frustum": asdict(self.frustum)}
        digest.update(json.dumps(parameters, sort_keys=True).encode())
        for part in self.objects:
            digest.update(np.array([len(part.vertices), len(part.faces)], dtype=np.int64).tobytes())
            digest.update(part.vertices.tobytes())
            digest.update(part.faces.tobytes())
        return digest.hexdigest()

    @cached_property
    def materials(self) -> tuple[Material, ...]:
        """One material per object; the default material for objects without a material name."""
        return tuple(self.appearance.material(part.material) for part in self.objects)

    @cached_property
    def surface(self) -> SurfaceAttributes:
        """Normals, colors and textures of all objects."""
        return SurfaceAttributes.from_objects(self.objects)

    def default_apertures(self) -> tuple[Aperture, ...]:
        """Return the apertures of a report: the middle, and two corners of a recentered plate."""
        if not self.frustum.recentered:
            return (self.plate.middle,)
        candidates = (self.plate.middle, *self.plate.corners)
        return tuple(dict.fromkeys(candidates))


def look_hash(scene: Scene) -> str:
    """Return the SHA-256 of all inputs of color that `Scene.content_hash` does not contain."""
    appearance, surface = scene.appearance, scene.surface
    environment = appearance.environment
    digest = hashlib.sha256()
    parameters = {
        "materials": [asdict(material) for material in scene.materials],
        "lights": [asdict(light) for light in appearance.lights],
        "strength": None if environment is None else environment.strength,
    }
    digest.update(json.dumps(parameters, sort_keys=True).encode())
    arrays: list[np.ndarray[Any, Any] | None] = [
        None if environment is None else environment.radiance,
        surface.vertex_normals,
        surface.vertex_colors,
        surface.uv,
        surface.texture_of_triangle,
        *surface.textures,
    ]
    for array in arrays:
        # Hash the shape before the content, so that different lists of arrays give different bytes.
        digest.update(json.dumps(None if array is None else array.shape).encode())
        digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def is_shaded(scene: Scene) -> bool:
    """Test whether a scene has materials, lights, environment, colors, textures or shadows."""
    looks, surface = scene.appearance, scene.surface
    if scene.transport.simulated:
        return True
    named = (
        bool(looks.materials) or looks.environment is not None or looks.lights != (DEFAULT_LIGHT,)
    )
    return named or surface.vertex_colors is not None or surface.texture_of_triangle is not None
