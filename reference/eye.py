"""True views and replayed views, with points and color, and the rays of an eye.

The ray from an eye e, at distance L in front of the plate, to the point p of the plate has the
slope m = (p - e) / L per unit of depth. At p, the eye sees the film position u = (m - k) / t of the
hogel whose cell contains p: a hogel is uniform over its cell.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from xfrustum.reference.certify.certify import Certifier, FirstSurfaces
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.occlusion import Occlusion, SurfacePoints
from xfrustum.reference.lines import LineGrid, RayBundle, crossed_frustum, film_window
from xfrustum.reference.rays.rays import ExactMesh, RayBatch
from xfrustum.reference.shading import Shader
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Beam, Eye, EyeImage, HogelPixels, Replay
from xfrustum.scenes.model.images import NOTHING, Certainty
from xfrustum.scenes.model.scene import Scene

#: column or row of a ray that meets no hogel or no film
NONE = -1


def eye_bundle(scene: Scene, eye: Eye, point: Floats | None = None) -> RayBundle:
    """Return the rays of an eye's film through a point (2,) relative to the center of the pupil.

    None is the center. Rays of one pixel through different points meet in the plane of focus.
    Only surfaces within the reach of the plate and in front of the eye count.
    """
    x, y, height = eye.position
    shear, center = [-x / height, -y / height], [x, y]
    if point is not None:
        for axis in range(2):
            center[axis] += float(point[axis])
            shear[axis] -= float(point[axis]) / (height - eye.focus)
    toward, back = scene.frustum.reach
    size = scene.plate.size
    return RayBundle(
        center=(center[0], center[1], height),
        shear=(shear[0], shear[1]),
        half_extent=(size[0] / 2 / height, size[1] / 2 / height),
        resolution=eye.resolution,
        s_range=(max(height - toward, 0.0), height + back),
    )


def _pixels_on_axis(
    scene: Scene, bundle: RayBundle, axis: int, step: int | None
) -> tuple[Indices, Indices, Floats]:
    """Return hogel, pixel and weight of each ray along an axis (0: columns, 1: rows).

    `step` is None for the nearest pixel; 0 or 1 for one of the two pixels between which the ray
    lies, weighted by a tent.
    """
    slope, sign = (bundle.dx, bundle.dy)[axis], (1.0, -1.0)[axis]
    size, hogels, count = (
        scene.plate.size[axis],
        scene.plate.hogels[axis],
        scene.frustum.resolution[axis],
    )
    met = bundle.center[axis] + bundle.center[2] * slope
    # The hogel whose cell contains the point of the plate; rows count down.
    hogel = np.floor((size / 2 + sign * met) * hogels / size)
    hogel = np.where((hogel >= 0) & (hogel < hogels), hogel, NONE).astype(np.int64)
    # Positions on the film: integers at centers of pixels, NaN outside the film.
    place = np.full(len(slope), np.nan)
    for number in np.unique(hogel[hogel != NONE]).tolist():
        shear, half_extent = film_window(
            scene.frustum, scene.plate.aperture(*_on_axis(axis, number))
        )
        here = hogel == number
        film = sign * (slope[here] - shear[axis]) / half_extent[axis]
        place[here] = np.where(np.abs(film) <= 1, ((film + 1) * count - 1) / 2, np.nan)
    inside = np.isfinite(place)
    place = np.where(inside, place, 0.0)
    if step is None:
        pixel = np.clip(np.floor(place + 0.5), 0, count - 1).astype(np.int64)
        weight = np.ones(len(place))
    else:
        pixel = np.floor(place).astype(np.int64) + step
        weight = 1.0 - np.abs(place - pixel)
        inside &= (pixel >= 0) & (pixel < count)
    hogel, pixel = (np.where(inside, numbers, NONE) for numbers in (hogel, pixel))
    return hogel, pixel, np.where(inside, weight, 0.0)


def _on_axis(axis: int, number: int) -> tuple[int, int]:
    """Return one hogel of a column (axis 0) or row, whose hogels have equal films on the axis."""
    return (number, 0) if axis == 0 else (0, number)


def _hogel_pixels(
    scene: Scene, bundle: RayBundle, steps: tuple[int | None, int | None] = (None, None)
) -> HogelPixels:
    columns, rows = (_pixels_on_axis(scene, bundle, axis, steps[axis]) for axis in range(2))
    return HogelPixels(
        hogel_column=columns[0],
        film_column=columns[1],
        hogel_row=rows[0],
        film_row=rows[1],
        column_weight=columns[2],
        row_weight=rows[2],
    )


def replay(scene: Scene, eye: Eye) -> Replay:
    """Return the pixels of hogels in an eye's view, for its surfaces and for its color."""
    points = eye.pupil_points
    both: tuple[tuple[int | None, int | None], ...] = ((None, None),)
    if eye.beam is Beam.TENT:
        # A tent weights the two nearest pixels on each axis: four pairs of a column and a row.
        both = ((0, 0), (0, 1), (1, 0), (1, 1))
    colors = []
    for point in points:
        bundle = eye_bundle(scene, eye, point)
        for steps in both:
            taken = _hogel_pixels(scene, bundle, steps)
            colors.append(replace(taken, row_weight=taken.row_weight / len(points)))
    return Replay(shown=_hogel_pixels(scene, eye_bundle(scene, eye)), colors=tuple(colors))


def hogel_lines(scene: Scene, pixels: HogelPixels) -> LineGrid:
    """Return the lines of `pixels.columns` and `pixels.rows` through their hogels."""
    columns, rows = pixels.columns, pixels.rows
    x, dx = _lines_on_axis(scene, pixels.hogel_column[columns], pixels.film_column[columns], 0)
    y, dy = _lines_on_axis(scene, pixels.hogel_row[rows], pixels.film_row[rows], 1)
    reach = scene.frustum.reach
    return LineGrid(x=x, dx=dx, y=y, dy=dy, s_range=(-reach[0], reach[1]))


def _lines_on_axis(
    scene: Scene, hogel: Indices, pixel: Indices, axis: int
) -> tuple[Floats, Floats]:
    place, slope = np.empty(len(hogel)), np.empty(len(hogel))
    for number in np.unique(hogel).tolist():
        bundle = crossed_frustum(scene.frustum, scene.plate.aperture(*_on_axis(axis, number)))
        here = hogel == number
        place[here], slope[here] = bundle.center[axis], (bundle.dx, bundle.dy)[axis][pixel[here]]
    return place, slope


class EyeReference:
    """Views of eyes in front of a plate, every ray certified; `effects` as for `Reference`.

    Color has one line for each pixel and point of the pupil: the scene's own sampling is not used.
    """

    def __init__(self, scene: Scene, effects: frozenset[Effect] | None = None) -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self._shader = Shader(scene, effects)

    def bundle(self, eye: Eye) -> RayBundle:
        """Return the rays through the center of an eye's pupil."""
        return eye_bundle(self.scene, eye)

    def replay(self, eye: Eye) -> Replay:
        """Return the pixels of hogels in an eye's view."""
        return replay(self.scene, eye)

    def true_view(self, eye: Eye, *, shaded: bool = True) -> EyeImage:
        """Return the true view of an eye: first surfaces within the reach; faster unshaded."""
        bundle = self.bundle(eye)
        decided = self._decided(bundle)
        position = np.asarray(bundle.center) + decided.s[..., None] * bundle.directions()
        color = None
        if shaded:
            color = np.zeros((*decided.triangle.shape, 3))
            points = eye.pupil_points
            for point in points:
                rays = eye_bundle(self.scene, eye, point)
                # Surfaces are seen from the pupil's center; color is the mean over all its points.
                seen = decided if len(points) == 1 else self._decided(rays)
                places = np.asarray(rays.center) + seen.s[..., None] * rays.directions()
                color += self._shader.picture(seen.triangle, places, rays.directions()) / len(
                    points
                )
        return self._image(eye, (decided.triangle, position, decided.certainty), color)

    def replayed(self, eye: Eye, *, shaded: bool = True) -> EyeImage:
        """Return the view of a plate of true hogels, the best that any renderer can show.

        Its pixels equal the pixels that `Reference.trace` returns for their hogels, bit for bit. It
        is faster without color (`shaded`).
        """
        taken = self.replay(eye)
        width, height = eye.resolution
        shown = taken.shown
        grid, decided = self._traced(eye, shown, None)
        triangle = np.full((height, width), NOTHING, dtype=np.int32)
        position = np.full((height, width, 3), np.nan)
        certainty = np.full((height, width), Certainty.PROVEN, dtype=np.uint8)
        here = np.ix_(shown.rows, shown.columns)
        triangle[here], certainty[here] = decided.triangle, decided.certainty
        position[here] = grid.points() + decided.s[..., None] * grid.directions()
        color = None
        if shaded:
            color = np.zeros((height, width, 3))
            # `replay` groups the parts of a beam by point of the pupil.
            per_point = len(taken.colors) // len(eye.pupil_points)
            for number, pixels in enumerate(taken.colors):
                point = eye.pupil_points[number // per_point]
                # With the nearest pixel and a pinhole, color is taken from the surfaces that are
                # shown.
                known = (grid, decided) if len(taken.colors) == 1 else None
                part = self._part_color(eye, pixels, point, known)
                weight = (
                    pixels.row_weight[pixels.rows][:, None] * pixels.column_weight[pixels.columns]
                )
                color[np.ix_(pixels.rows, pixels.columns)] += weight[..., None] * part
        return self._image(eye, (triangle, position, certainty), color)

    def hidden(self, eye: Eye, points: SurfacePoints) -> Mask:
        """Return a mask (N,) of points that are hidden from an eye; see `Occlusion`."""
        return self._occlusion.hidden(self.bundle(eye), points)

    @cached_property
    def _triangles(self) -> Triangles:
        return Triangles(self.scene.triangles)

    @cached_property
    def _mesh(self) -> ExactMesh:
        return ExactMesh(self.scene.vertices, self.scene.faces)

    @cached_property
    def _occlusion(self) -> Occlusion:
        return Occlusion(self._triangles)

    def _part_color(
        self,
        eye: Eye,
        pixels: HogelPixels,
        point: Floats,
        known: tuple[LineGrid, FirstSurfaces] | None,
    ) -> Floats:
        """Return the color of hogels' pixels; `known` are lines and surfaces, if computed."""
        grid, decided = known or self._traced(eye, pixels, point)
        places = grid.points() + decided.s[..., None] * grid.directions()
        return self._shader.picture(decided.triangle, places, grid.directions())

    def _traced(
        self, eye: Eye, pixels: HogelPixels, point: Floats | None
    ) -> tuple[LineGrid, FirstSurfaces]:
        """Return the lines of some hogels' pixels and their first surfaces."""
        grid = hogel_lines(self.scene, pixels)
        return grid, self._first(grid)

    def _first(self, grid: LineGrid) -> FirstSurfaces:
        """Return the first surfaces along the lines of a grid."""
        width, height = grid.resolution
        if not len(self._triangles):
            return FirstSurfaces(
                triangle=np.full((height, width), NOTHING, dtype=np.int32),
                s=np.full((height, width), np.nan),
                certainty=np.full((height, width), Certainty.PROVEN, dtype=np.uint8),
                tied_triangles=np.zeros((0, 3), dtype=np.int64),
            )
        first = self._mesh.first(
            RayBatch(
                origins=grid.points().reshape(-1, 3),
                directions=grid.directions().reshape(-1, 3),
                ends=np.tile(grid.s_range, (width * height, 1)),
            )
        )
        line, number = first.ties.T
        return FirstSurfaces(
            triangle=first.triangle.reshape(height, width).astype(np.int32),
            s=first.t.reshape(height, width),
            certainty=first.certainty.reshape(height, width),
            tied_triangles=np.stack((line // width, line % width, number), axis=1),
        )

    def _decided(self, bundle: RayBundle) -> FirstSurfaces:
        return Certifier(self._triangles, bundle).decide(range(bundle.resolution[1]))

    def _image(
        self, eye: Eye, shown: tuple[Numbers, Floats, Bytes], color: Floats | None
    ) -> EyeImage:
        triangle, position, certainty = shown
        return EyeImage(
            eye=eye,
            triangle=triangle,
            object=self.scene.object_of_number[triangle],
            position=position,
            color=None if color is None else color.astype(np.float32),
            certainty=certainty,
        )
