"""True views and replayed views, with points and color."""

from functools import cached_property

import numpy as np

from xfrustum.reference.certify.certify import Certifier, FirstSurfaces
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.occlusion import Occlusion, SurfacePoints
from xfrustum.reference.eye.first import Axis, LineGrid, first_along_grid
from xfrustum.reference.eye.rays import eye_pencil, hogel_lines, replay
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.shading.shading import Shader
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Eye, EyeImage, HogelPixels, Replay
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty
from xfrustum.scenes.model.scene import Scene


class EyeReference:
    """What eyes before the plate of a scene see, every ray certified; `effects` as for `Reference`.

    Color is that of one line for each pixel, or point of the pupil: the scene's own sampling is not used.
    """

    def __init__(self, scene: Scene, effects: frozenset[Effect] | None = None) -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self._shader = Shader(scene, effects)
        # Indexed by triangle number: `NOTHING`, which is -1, finds the last entry, `NOTHING`.
        self._object_of_number = np.append(scene.object_of_triangle, np.int32(NOTHING))

    def pencil(self, eye: Eye) -> Pencil:
        """Return the rays through the center of an eye's pupil."""
        return eye_pencil(self.scene, eye)

    def replay(self, eye: Eye) -> Replay:
        """Return the pixels of hogels that an eye is shown."""
        return replay(self.scene, eye)

    def true_view(self, eye: Eye, *, shaded: bool = True) -> EyeImage:
        """Return what an eye sees of the scene: first surfaces within the reach; faster if not `shaded`."""
        pencil = self.pencil(eye)
        found = self._decided(pencil)
        position = np.asarray(pencil.center) + found.s[..., None] * pencil.directions()
        color = None
        if shaded:
            color = np.zeros((*found.triangle.shape, 3))
            points = eye.pupil_points
            for point in points:
                rays = eye_pencil(self.scene, eye, point)
                seen = found if len(points) == 1 else self._decided(rays)
                places = np.asarray(rays.center) + seen.s[..., None] * rays.directions()
                color += self._shader.picture(seen.triangle, places, rays.directions()) / len(points)
        return self._image(eye, (found.triangle, position, found.certainty), color)

    def replayed(self, eye: Eye, *, shaded: bool = True) -> EyeImage:
        """Return what an eye sees of a plate whose hogels are all true: no renderer is worse than this.

        What the pixels show that the eye is shown is, bit for bit, what they show in `Reference.trace` of
        their hogels. Without color (`shaded`) the picture is made faster.
        """
        taken = self.replay(eye)
        width, height = eye.resolution
        shown = taken.shown
        grid, found = self._traced(eye, shown, None)
        triangle = np.full((height, width), NOTHING, dtype=np.int32)
        position = np.full((height, width, 3), np.nan)
        certainty = np.full((height, width), Certainty.PROVEN, dtype=np.uint8)
        here = np.ix_(shown.rows, shown.columns)
        triangle[here], certainty[here] = found.triangle, found.certainty
        position[here] = grid.points() + found.s[..., None] * grid.directions()
        color = None
        if shaded:
            color = np.zeros((height, width, 3))
            per_point = len(taken.colors) // len(eye.pupil_points)
            for number, pixels in enumerate(taken.colors):
                point = eye.pupil_points[number // per_point]
                # With a box and a pinhole, what is seen is what is shown.
                known = (grid, found) if len(taken.colors) == 1 else None
                part = self._part_color(eye, pixels, point, known)
                weight = pixels.row_weight[pixels.rows][:, None] * pixels.column_weight[pixels.columns]
                color[np.ix_(pixels.rows, pixels.columns)] += weight[..., None] * part
        return self._image(eye, (triangle, position, certainty), color)

    def hidden(self, eye: Eye, points: SurfacePoints) -> Mask:
        """Return which points are hidden from an eye; see `Occlusion`."""
        return self._occlusion.hidden(self.pencil(eye), points)

    @cached_property
    def _triangles(self) -> Triangles:
        return Triangles(self.scene.triangles)

    @cached_property
    def _occlusion(self) -> Occlusion:
        return Occlusion(self._triangles)

    def _part_color(
        self, eye: Eye, pixels: HogelPixels, point: Floats, known: tuple[LineGrid, FirstSurfaces] | None
    ) -> Floats:
        """Return the color of some hogels' pixels; `known` are their lines and surfaces, if at hand."""
        grid, found = known or self._traced(eye, pixels, point)
        places = grid.points() + found.s[..., None] * grid.directions()
        return self._shader.picture(found.triangle, places, grid.directions())

    def _traced(self, eye: Eye, pixels: HogelPixels, point: Floats | None) -> tuple[LineGrid, FirstSurfaces]:
        """Return the lines of some hogels' pixels, and the surfaces that are first along them."""
        rays = eye_pencil(self.scene, eye, point)
        grid = hogel_lines(self.scene, pixels)
        x, y, height = rays.center
        columns = Axis(place=grid.x, slope=grid.dx, seen=rays.dx[pixels.columns], eye=x, height=height)
        rows = Axis(place=grid.y, slope=grid.dy, seen=rays.dy[pixels.rows], eye=y, height=height)
        return grid, first_along_grid(self._triangles, grid, columns, rows)

    def _decided(self, pencil: Pencil) -> FirstSurfaces:
        return Certifier(self._triangles, pencil).decide(range(pencil.resolution[1]))

    def _image(self, eye: Eye, shown: tuple[Numbers, Floats, Bytes], color: Floats | None) -> EyeImage:
        triangle, position, certainty = shown
        return EyeImage(
            eye=eye,
            triangle=triangle,
            object=self._object_of_number[triangle],
            position=position,
            color=None if color is None else color.astype(np.float32),
            certainty=certainty,
        )
