"""Closed forms of the displacement of drawn points, and of the lines on which they are seen.

Both follow from the true image only (docs/method.md, "Light").

At one *pixel* the drawn line is parallel to the true line (pivot aperture, fit angle), and meets
another surface point. At one *surface point* the directions of the two lines differ. With
E = -d / |d| the unit eye vector of a line d, a bend D of the line (`bend`) turns E by

    dE = - (D - (D.E) E) / |d|

and the reflection of the eye vector across N, R = 2 (N.E) N - E, by dR = 2 (N.dE) N - dE. To first
order the specular term of a light from L then changes by

    dC = I specular exponent (R.L)^(exponent - 1) (dR.L)      where N.L > 0 and R.L > 0

and a mirror shows the environment at R + dR. Diffuse and ambient light do not depend on the eye.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.error_maps import Spread, lengths, pixel_centers, root_mean_square
from xfrustum.reference.lines import model_cameras
from xfrustum.reference.shading import Shader, radiance_toward, smooth_normals
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Camera, DoubleFrustum, Frustum, Offset, Pivot


@dataclass(frozen=True, kw_only=True, eq=False)
class TruePoints:
    """Surface points at the places on the film where the truth shows them."""

    height: Floats  #: (...) signed z, scene units; NaN where there is no surface off the plate
    from_middle: Floats  #: (..., 2) columns and rows from the middle of the film: W/2 u and -H/2 v
    camera: HogelCamera

    @classmethod
    def from_image(cls, truth: HogelImage) -> TruePoints:
        """Return the points of all pixels, (H, W)."""
        height = np.full(truth.triangle.shape, np.nan)
        np.copyto(height, truth.height, where=truth.off_plate)
        from_middle = pixel_centers(truth.camera) - (np.asarray(truth.camera.resolution) - 1) / 2
        return cls(height=height, from_middle=from_middle, camera=truth.camera)

    @cached_property
    def depth(self) -> Floats:
        """Distances (...) from the plate, scene units; NaN as in `height`."""
        return np.abs(self.height)

    @cached_property
    def radius(self) -> Floats:
        """Distances (...) from the middle of the film, pixels."""
        return lengths(self.from_middle)

    def at(self, pixels: Indices) -> TruePoints:
        """Return the points at some pixels, given as indices of the flattened image."""
        height, places = self.height.reshape(-1)[pixels], self.from_middle.reshape(-1, 2)[pixels]
        return TruePoints(height=height, from_middle=places, camera=self.camera)

    def shown(self) -> TruePoints:
        """Return the points that are on a surface and off the plate."""
        return self.at(np.flatnonzero(np.isfinite(self.height)))


def displacements(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return the true minus the drawn position of some points, (..., 2) columns and rows in pixels.

    NaN where there is no surface off the plate, and where no camera draws the surface: on the other
    side of the plate if only one camera draws, and closer than n without an offset. The positions
    at which the two cameras draw a point (docs/method.md, "Shear") give a formula without a
    difference of nearly equal numbers. With the true film coordinate u, w = |z| + n, the shear k (0
    for pivot `aperture`), and 1 / zf = 0 for fit `angle`, the displacement is

        u n / w (1 - |z| / zf)  +  n k / (t w) (1 + n / zf).

    The formula holds in the first slab. The cameras of the other slabs are in the aperture and
    cause no displacement.
    """
    bent = _bent(points, frustum, settings)
    fitted = settings.fitted_height(frustum)
    per_fit = 0.0 if fitted is None else 1 / fitted
    field = points.from_middle * (bent * (1 - points.depth * per_fit))[..., None]
    if settings.pivot is Pivot.CAMERA:
        camera = points.camera
        sides = [camera.resolution[0] / 2, -camera.resolution[1] / 2]
        film_units = np.asarray(camera.shear) / camera.half_extent * sides
        field += (bent * (1 + settings.near * per_fit))[..., None] * film_units
    return field


def displacement_lengths(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return the lengths of displacements of points, (...) in pixels; see `displacements`."""
    if settings.pivot is Pivot.CAMERA:
        return lengths(displacements(points, frustum, settings))
    # Every point moves along its radius, away from the middle of the film or toward it.
    moved = points.radius * _bent(points, frustum, settings)
    fitted = settings.fitted_height(frustum)
    return moved if fitted is None else moved * np.abs(1 - points.depth / fitted)


def _bent(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return n / w of points, (...): 0 outside the first slab, NaN where no camera draws."""
    near = settings.near if settings.offset is Offset.PLATE else 0.0
    bent: Floats = points.depth + near
    np.divide(near, bent, out=bent)
    if settings.slabs:
        bent[np.isfinite(points.height) & ~in_first_slab(points.height, frustum, settings)] = 0.0
    if settings.camera is not Camera.BOTH or settings.offset is Offset.NONE:
        bent[~is_drawn(points.height, settings)] = np.nan
    return bent


def in_first_slab(height: NDArray[np.floating], frustum: Frustum, settings: DoubleFrustum) -> Mask:
    """Return a mask of the heights at which the slab that touches the plate draws."""
    toward, behind = (settings.sections(reach)[0][1] for reach in frustum.reach)
    return np.asarray((height <= toward) & (height >= -behind))


def is_drawn(height: NDArray[np.floating], settings: DoubleFrustum) -> Mask:
    """Return a mask of the heights off the plate at which any camera draws."""
    drawn: Mask = np.isfinite(height)
    if settings.camera is not Camera.BOTH:
        drawn &= (height < 0) == (settings.camera is Camera.C)
    if settings.offset is Offset.NONE:
        drawn &= np.abs(height) >= settings.near
    return drawn


def spread_of(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Spread | None:
    """Return the spread of displacement over the visible surfaces; None if there are none."""
    moved = displacement_lengths(points, frustum, settings)
    return Spread.from_values(moved[np.isfinite(moved)])


def link_lengths(
    points: TruePoints, frustum: Frustum, chain: Sequence[DoubleFrustum]
) -> list[float | None]:
    """Return the rms displacement (px) that each link of a chain adds; None without a surface."""
    fields = {link: displacements(points, frustum, link) for link in dict.fromkeys(chain)}

    def rms(moved: Floats) -> float | None:
        known = lengths(moved)
        known = known[np.isfinite(known)]
        return root_mean_square(known) if known.size else None

    first = rms(fields[chain[0]])
    # Two links with equal settings draw the same points: the second adds no displacement.
    still = None if first is None else 0.0
    return [
        first,
        *(
            still if link == after else rms(fields[after] - fields[link])
            for link, after in pairwise(chain)
        ),
    ]


def outside_shares(
    points: TruePoints, frustum: Frustum, chain: Sequence[DoubleFrustum]
) -> tuple[float, ...]:
    """Return the share of pixels that each link of a chain adds with points from outside the film.

    A pixel is charged to the first link whose image, like all later images, shows a point from
    outside the film. If a point on the film's border is drawn d pixels farther in, the strip of d
    pixels shows points from beyond the border. A pixel counts if its center is in the strip:
    floor(d + 1/2) pixels. `points` are the points of all pixels (H, W).
    """
    height, width = points.height.shape
    columns, rows = np.arange(width), np.arange(height) * width
    # For the left, right, top and bottom border: pixels, axis of displacement, outward sign.
    sides = ((rows, 0, -1), (rows + width - 1, 0, 1), (columns, 1, -1), (columns + rows[-1], 1, 1))
    borders = [(points.at(pixels), axis, sign) for pixels, axis, sign in sides]

    def shown(settings: DoubleFrustum) -> list[Floats]:
        """Return the width, in pixels, of the strip of outside points at each side."""
        moved = (
            sign * displacements(some, frustum, settings)[:, axis] for some, axis, sign in borders
        )
        # Undefined displacement, of points that no camera draws, counts as 0.
        return [np.floor(np.fmax(depth, 0.0) + 0.5) for depth in moved]

    by_settings = {link: shown(link) for link in dict.fromkeys(chain)}
    together, to_the_end = [], by_settings[chain[-1]]
    for settings in reversed(chain):
        pairs = zip(to_the_end, by_settings[settings], strict=True)
        left, right, top, bottom = to_the_end = [np.minimum(depth, other) for depth, other in pairs]
        across = np.minimum(left + right, width).sum() / (height * width)
        down = np.minimum(top + bottom, height).sum() / (height * width)
        # Strips at left and right overlap strips at top and bottom only in corners: take them as
        # independent.
        together.append(1 - (1 - across) * (1 - down))
    return tuple(np.diff(together[::-1], prepend=0.0).tolist())


def true_lines(position: NDArray[np.floating], aperture: Aperture) -> Floats:
    """Return d = (.., .., -1) of the true line through each point, (..., 3); NaN in the plate."""
    return _through(position, (aperture.x, aperture.y, 0.0))


def drawn_lines(
    position: NDArray[np.floating], frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> Floats:
    """Return d = (.., .., -1) of the drawn line of each point, (..., 3); NaN where undrawn."""
    lines = np.full(position.shape, np.nan)
    for camera in model_cameras(frustum, aperture, settings):
        low, high = camera.heights
        # At a cut between two slabs, the slab drawn later covers the other.
        here = (position[..., 2] >= low) & (position[..., 2] <= high)
        lines[here] = _through(position[here], camera.bundle.center)
    return lines


def bend(position: NDArray[np.floating], camera: HogelCamera, near: float) -> Floats:
    """Return the drawn minus the true direction d of each point, in closed form, (..., 3).

    A point with true film coordinate u is drawn at u |z| / (|z| + n) (pivot aperture, fit angle).
    The line of film coordinate u has slope k + u t, so that the line bends by - u t n / (|z| + n).
    """
    position = np.asarray(position, dtype=np.float64)
    d = true_lines(position, camera.aperture)
    from_axis = d[..., :2] - np.asarray(camera.shear)
    height = np.abs(position[..., 2:])
    bent = np.zeros_like(d)
    bent[..., :2] = -from_axis * near / (height + near)
    return bent


def shading_normals(scene: Scene, triangle: Numbers, position: Floats, lines: Floats) -> Floats:
    """Return the unit normals that surface points are shaded with, turned to the viewer, (N, 3)."""
    flat = scene.normals[triangle]
    back = np.einsum("ij,ij->i", flat, lines) > 0
    smooth = scene.surface.vertex_normals is not None
    normal = smooth_normals(scene, triangle, position) if smooth else flat
    return np.where(back[:, None], -normal, normal)


def _through(position: NDArray[np.floating], center: tuple[float, float, float]) -> Floats:
    offset = position.astype(np.float64) - center
    depth = -offset[..., 2:]
    return np.asarray(offset / np.where(depth == 0, np.nan, depth))


def bent_eye(line: Floats, bend: Floats) -> tuple[Floats, Floats]:
    """Return E and dE, (N, 3), of true lines d and their bend (drawn minus true)."""
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    eye = -line / length
    return eye, -(bend - _dot(bend, eye) * eye) / length


def specular_change(
    scene: Scene, triangle: Numbers, normal: Floats, eye: tuple[Floats, Floats]
) -> Floats:
    """Return the excess radiance of drawn highlights, (N, 3); `eye` is E and dE."""
    mirrored, turned = _reflected(normal, eye[0]), _reflected(normal, eye[1])
    material = scene.object_of_triangle[triangle]
    exponent = np.array([m.exponent for m in scene.materials])[material][:, None]
    specular = np.array([m.specular for m in scene.materials])[material]
    change = np.zeros_like(normal)
    for light in scene.appearance.lights:
        toward = np.asarray(light.direction)
        along = (mirrored @ toward)[:, None]
        lit = ((normal @ toward)[:, None] > 0) & (along > 0)
        # With an exponent below one the slope is infinite where R.L = 0, so unlit points use
        # R.L = 1.
        slope = exponent * np.where(lit, along, 1.0) ** (exponent - 1)
        change += np.where(lit, slope * (turned @ toward)[:, None], 0.0) * specular * light.color
    return change


def mirror_change(
    scene: Scene, triangle: Numbers, normal: Floats, eye: tuple[Floats, Floats]
) -> Floats:
    """Return the excess radiance of drawn reflections, (N, 3); see `specular_change`."""
    environment = scene.appearance.environment
    if environment is None:
        return np.zeros_like(normal)
    mirrored, turned = _reflected(normal, eye[0]), _reflected(normal, eye[1])
    reflectivity = np.array([m.reflectivity for m in scene.materials])[
        scene.object_of_triangle[triangle]
    ]
    moved = radiance_toward(environment, mirrored + turned) - radiance_toward(environment, mirrored)
    return np.asarray(reflectivity * moved)


def _reflected(normal: Floats, vector: Floats) -> Floats:
    return 2 * _dot(normal, vector) * normal - vector


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("...i,...i->...", a, b)[..., None])


def predicted_eye_error(scene: Scene, image: HogelImage, near: float) -> Floats:
    """Return the first-order excess radiance of points, (N, 3), for cameras offset by `near`."""
    where = image.off_plate
    triangle, position = image.triangle[where], image.position[where].astype(np.float64)
    lines = true_lines(position, image.camera.aperture)
    eye = bent_eye(lines, bend(position, image.camera, near))
    normal = shading_normals(scene, triangle, position, lines)
    return specular_change(scene, triangle, normal, eye) + mirror_change(
        scene, triangle, normal, eye
    )


def measured_eye_error(shader: Shader, drawn: HogelImage) -> Floats:
    """Return the excess radiance of drawn points over their true radiance, (N, 3)."""
    assert drawn.color is not None
    where = drawn.off_plate
    position = drawn.position[where].astype(np.float64)
    lines = true_lines(position, drawn.camera.aperture)
    return np.asarray(drawn.color[where] - shader.radiance(drawn.triangle[where], position, lines))
