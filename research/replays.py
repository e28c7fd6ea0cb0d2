"""Measured replays of drawn plates to the two eyes of a viewer."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare import eye_loss
from xfrustum.compare.noticeable import ARCSEC_PER_RADIAN, Display, Viewer, eyes_apart
from xfrustum.compare.prediction.predict import with_exact_depth
from xfrustum.reference.eye import EyeReference
from xfrustum.reference.lines import pixel_places
from xfrustum.reports.view import drawing
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.images import NOTHING

#: columns of each eye's film; its number of pixels limits the number of drawn hogels
FILM_COLUMNS = 64

#: Largest distance of two surface points that count as one point, in units of a pixel width of the
#: eye plus a hogel width, both at their depth. The point that one eye sees lies between pixels of
#: the other.
SAME_PLACE = 2.0


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """Measures of drawn hogels in the views of two eyes."""

    #: number of surface points in both views
    matched: int
    #: largest difference of the changes of disparity of two points, or of one and the plate's
    #: border, from the 1st to the 99th percentile; None if no point is in both views
    disparity_change_arcsec: float | None
    #: shares of both eyes' judged pixels: wrong surfaces; wrong surfaces that exact depth mends
    wrong: float
    depth_wrong: float
    #: number of both eyes' judged pixels
    judged: int


def two_eyes(scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> tuple[Eye, ...]:
    """Return a viewer's left and right eye, with films of some columns over the plate."""
    width, height = scene.plate.size
    film = (columns, max(1, round(columns * height / width)))
    half = eyes_apart(viewer, Display.from_scene(scene)) / 2
    return tuple(Eye(position=(x, 0.0, viewer.distance), resolution=film) for x in (-half, half))


class ReplayWorkbench:
    """Two eyes straight in front of a plate, with their true and their replayed views."""

    def __init__(self, scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> None:
        self._scene = scene
        self._reference = EyeReference(scene)
        self._views = [
            eye_loss.Views(
                true=self._reference.true_view(eye, shaded=False),
                replayed=self._reference.replayed(eye, shaded=False),
                drawn=None,
                taken=self._reference.replay(eye),
            )
            for eye in two_eyes(scene, viewer, columns)
        ]
        self._control: tuple[DoubleFrustum, list[Mask]] | None = None

    def measure(self, settings: DoubleFrustum) -> Replayed:
        """Draw and judge the views, with the depth buffer of the settings and with exact depth."""
        # Settings that differ only in depth share the views with exact depth.
        exact = with_exact_depth(settings)
        if self._control is None or self._control[0] != exact:
            self._control = exact, self._wrong(self._drawn(exact))
        views = self._drawn(settings)
        wrong = self._wrong(views)
        judged = sum(mask.size for mask in wrong)
        by_depth = sum(int((a & ~b).sum()) for a, b in zip(wrong, self._control[1], strict=True))
        errors = disparity_errors(self._reference, *views)
        errors = errors[np.isfinite(errors)] * ARCSEC_PER_RADIAN
        change = None
        if errors.size:
            # The border of the plate does not move, so zero is among the changes.
            low, high = np.percentile(errors, (1, 99))
            change = float(max(high, 0.0) - min(low, 0.0))
        return Replayed(
            matched=errors.size,
            disparity_change_arcsec=change,
            wrong=sum(int(mask.sum()) for mask in wrong) / judged,
            depth_wrong=by_depth / judged,
            judged=judged,
        )

    def _drawn(self, settings: DoubleFrustum) -> list[eye_loss.Views]:
        collectors = [
            eye_loss.Collector(self._scene, view.eye, view.taken, settings) for view in self._views
        ]
        parts = eye_loss.film_parts(view.taken for view in self._views)
        images = eye_loss.collected(drawing(self._scene, settings).hogels(parts), collectors)
        return [replace(view, drawn=image) for view, image in zip(self._views, images, strict=True)]

    def _wrong(self, views: Sequence[eye_loss.Views]) -> list[Mask]:
        """Return the judged pixels with a wrong surface, for each eye."""
        masks = []
        for view in views:
            maps = eye_loss.renderer_loss(self._reference, view, numbered=True)
            assert maps.wrong is not None
            masks.append(maps.wrong[maps.judged])
        return masks


def disparity_errors(
    reference: EyeReference, left: eye_loss.Views, right: eye_loss.Views
) -> Floats:
    """Return shown minus true disparity of a renderer's hogels by pixel of the left eye, radians.

    The eyes differ in x alone; NaN at pixels whose surface point the right eye does not see. The
    error of an eye is the slope along x of the line on which a hogel's pixel shows a point, minus
    the slope of the point itself, so that neither pitch nor pixels affect it. The error of
    disparity is the left eye's error minus the right eye's.
    """
    height, bundle = left.eye.position[2], reference.bundle(right.eye)
    images, errors = [], []
    for views in (left, right):
        assert views.drawn is not None
        place = eye_loss.shown_at(reference.scene, views.taken, views.drawn) - views.drawn.position
        with np.errstate(divide="ignore", invalid="ignore"):
            errors.append(place[..., 0] / (height - views.drawn.position[..., 2]))
        images.append(views.drawn)
    first, second = images
    # For each pixel of the left eye: the pixel of the right eye that truly shows the same point.
    pixel = np.nan_to_num(pixel_places(first.position, bundle), nan=-1.0, posinf=-1.0, neginf=-1.0)
    column, row = np.moveaxis(np.floor(np.clip(pixel, -1.0, 1e6) + 0.5).astype(int), -1, 0)
    width, rows = right.eye.resolution
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < rows)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    distance = height - first.position[..., 2]
    pitch = reference.scene.plate.size[0] / reference.scene.plate.hogels[0]
    near = SAME_PLACE * (distance * 2 * bundle.half_extent[0] / width + pitch)
    apart = np.linalg.norm(first.position - second.position[row, column], axis=-1)
    same = inside & (first.object != NOTHING) & (first.object == second.object[row, column])
    return np.where(same & (apart <= near), errors[0] - errors[1][row, column], np.nan)
