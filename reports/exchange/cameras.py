"""The cameras C and C* of any settings and aperture, for renderers that somebody else writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.raster.cameras.cameras import FilmWindow, SlabCamera
from xfrustum.raster.cameras.depth_formats import MAPPINGS
from xfrustum.raster.cameras.passes import Pass, cameras_in_order, pass_of
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate

DEPTH_FUNCTIONS = {
    DepthMapping.STANDARD: "f (w - n) / (w (f - n))",
    DepthMapping.GL: "f (w - n) / (w (f - n))",
    DepthMapping.REVERSED: "n (f - w) / (w (f - n))",
    DepthMapping.LOGARITHMIC: "ln(w/n) / ln(f/n)",
    DepthMapping.LINEAR: "(w - n) / (f - n)",
}
"""Stored depth at distance w from a camera with near plane n and far plane f (CONVENTIONS.md, "Depth")."""

CONVENTIONS = (
    "Scene coordinates are right-handed: the plate is z = 0, +z points to the viewer, x right, y up.",
    "Matrices are row-major, named target-from-source, and multiply column vectors.",
    "Clip x/w and y/w are the film coordinates u (to the right) and v (up), both in [-1, 1]; the flips of "
    "C* are in its "
    "matrix. The center of pixel (column c, row r; row 0 at the top) is u = (2c + 1)/W - 1, v = 1 - (2r + "
    "1)/H.",
    "Clip w is the distance from the camera along its axis. Only points with near <= w <= far are drawn.",
    "Passes are drawn in the order given, each with its depth buffer cleared to `clear`, over those before "
    "it. Depth tests "
    "are strict: of equal depths the one drawn first stays. Nothing is culled unless `culled_face` says so.",
)
"""What a reader of the file must know, in the words of CONVENTIONS.md."""


@dataclass(frozen=True, kw_only=True)
class Depth:
    """The depth buffer of a pass.

    Attributes
    ----------
    format, mapping
        Names as on the command line.
    function
        Stored depth at distance w, with n and f the planes of the pass.
    near_value, far_value
        Values stored at the two planes.
    clip_range
        Depths over w between which OpenGL, or another interface, clips.
    written_by_fragment
        Whether the fragment writes the depth, because no interpolation gives it.
    test
        Comparison that a new depth must pass against the stored one.
    clear
        Value that the buffer is cleared to.
    """

    format: str
    mapping: str
    function: str
    near_value: float
    far_value: float
    clip_range: tuple[float, float]
    written_by_fragment: bool
    test: str
    clear: float


@dataclass(frozen=True, kw_only=True)
class CameraPass:
    """One camera of one aperture, and what it draws.

    Attributes
    ----------
    camera
        `c` or `c-star`.
    clip_from_scene
        (4, 4) matrix.
    position
        Center of projection, scene coordinates.
    looks_to
        `-z` or `+z`.
    film_flipped
        Whether the film is flipped left-right and up-down against the ordinary picture of a camera that looks
        that way with its y axis up and its x axis to the right as the viewer sees them.
    shear, half_extent
        k and t of the film in slopes about the center of projection, the factor of the fit included.
    near, far
        Distances of the two planes from the camera.
    heights
        Lowest and highest z between the two planes.
    wins
        `nearest` or `farthest` surface.
    depth
        Depth buffer of the pass.
    front_face
        Window winding of faces that are turned to the camera.
    culled_face
        Faces that are left out, as OpenGL names them; None where all are drawn.
    """

    camera: str
    clip_from_scene: Floats
    position: tuple[float, float, float]
    looks_to: str
    film_flipped: bool
    shear: tuple[float, float]
    half_extent: tuple[float, float]
    near: float
    far: float
    heights: tuple[float, float]
    wins: str
    depth: Depth
    front_face: str
    culled_face: str | None


@dataclass(frozen=True, kw_only=True)
class ApertureCameras:
    """The passes of one aperture's image, in drawing order.

    Attributes
    ----------
    aperture
        Column and row.
    center
        Center of the aperture, scene coordinates.
    passes
        Cameras in drawing order, the farthest from the viewer first.
    """

    aperture: tuple[int, int]
    center: tuple[float, float, float]
    passes: tuple[CameraPass, ...]


@dataclass(frozen=True, kw_only=True)
class Cameras:
    """The cameras of some apertures of a scene: the JSON object of `camera --for json`.

    Attributes
    ----------
    scene, scene_hash, units
        Name of the scene, the hash of its content, and its unit of length.
    conventions
        What a reader must know, one sentence each.
    plate, frustum, settings
        The question, as the scene file and the command line put it; angles in radians.
    apertures
        Cameras of each aperture.
    """

    scene: str
    scene_hash: str
    units: str
    conventions: tuple[str, ...]
    plate: Plate
    frustum: Frustum
    settings: DoubleFrustum
    apertures: tuple[ApertureCameras, ...]


def cameras_of(scene: Scene, settings: DoubleFrustum, apertures: Sequence[Aperture]) -> Cameras:
    """Return the cameras of some apertures.

    Slabs in which the scene has nothing are left out, as `raster` leaves them out.

    Raises
    ------
    InputError
        The settings make no sense for the scene.
    """
    settings.check_against(scene.frustum)
    slabs = cameras_in_order(scene, settings)
    return Cameras(
        scene=scene.name,
        scene_hash=scene.content_hash,
        units=scene.units,
        conventions=CONVENTIONS,
        plate=scene.plate,
        frustum=scene.frustum,
        settings=settings,
        apertures=tuple(
            ApertureCameras(
                aperture=aperture.index,
                center=(aperture.x, aperture.y, 0.0),
                passes=tuple(_camera_pass(scene, settings, aperture, slab) for slab in slabs),
            )
            for aperture in apertures
        ),
    )


def _camera_pass(scene: Scene, settings: DoubleFrustum, aperture: Aperture, slab: SlabCamera) -> CameraPass:
    drawn = pass_of(scene, aperture, settings, slab)
    window = FilmWindow.of(scene.frustum, aperture)
    return CameraPass(
        camera="c" if slab.orthoscopic else "c-star",
        clip_from_scene=drawn.clip_from_scene,
        position=center_of_projection(drawn.clip_from_scene),
        looks_to="-z" if slab.orthoscopic else "+z",
        film_flipped=not slab.orthoscopic,
        shear=(-window.axis[0], -window.axis[1]),
        half_extent=(window.half_width * slab.scale, window.half_height * slab.scale),
        near=slab.near,
        far=slab.far,
        heights=drawn.heights,
        wins="nearest" if slab.orthoscopic else "farthest",
        depth=_depth(settings, drawn),
        front_face=drawn.front_face,
        culled_face=drawn.culled_face,
    )


def _depth(settings: DoubleFrustum, drawn: Pass) -> Depth:
    mapping = MAPPINGS[settings.mapping]
    return Depth(
        format=settings.depth.value,
        mapping=settings.mapping.value,
        function=DEPTH_FUNCTIONS[settings.mapping],
        near_value=mapping.stored_near,
        far_value=mapping.stored_far,
        clip_range=(-1.0, 1.0) if settings.mapping is DepthMapping.GL else (0.0, 1.0),
        written_by_fragment=bool(mapping.fragment_depth),
        test=drawn.test.function,
        clear=drawn.test.clear,
    )


def center_of_projection(clip_from_scene: Floats) -> tuple[float, float, float]:
    """Return the point at which clip x, y and w are all zero."""
    rows = clip_from_scene[(0, 1, 3), :]
    x, y, z = np.linalg.solve(rows[:, :3], -rows[:, 3])
    # Adding zero turns a negative zero into a positive one.
    return float(x) + 0.0, float(y) + 0.0, float(z) + 0.0
