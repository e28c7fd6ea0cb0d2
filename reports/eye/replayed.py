"""What two eyes are shown of drawn hogels: changes of disparity, and wrong surfaces by depth, measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from xfrustum.compare.eye.collected import Collector, collected, film_parts, hogels_of
from xfrustum.compare.eye.limits import Viewer
from xfrustum.compare.eye.loss import Views, renderer_loss
from xfrustum.compare.eye.noticeable import Display, eyes_apart
from xfrustum.compare.eye.stereo import DepthShift, disparity
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.compare.sampling import share_at_most
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reports.eye.sources import Drawing
from xfrustum.reports.eye.viewing import stereo_eyes
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.eye_image import EyeImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

FILM_COLUMNS = 64
"""Columns of the films of both eyes: of no more hogels than pixels a part is drawn."""


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """What two eyes are shown of drawn hogels, measured.

    Attributes
    ----------
    hogels
        Number of hogels of which pixels were drawn.
    matched
        Number of surface points that both eyes are shown.
    disparity_change_arcsec
        Largest difference of the changes of disparity of two points, or of one and the plate's border, from
        the 1st to the 99th percentile; None where both eyes are shown no point.
    depth
        By how much farther away than they are points are seen, scene units.
    wrong, depth_wrong
        Share of both eyes' judged pixels with a wrong surface, and share of those that are right with exact
        depth.
    judged
        Number of both eyes' judged pixels.
    """

    hogels: int
    matched: int
    disparity_change_arcsec: float | None
    depth: DepthShift | None
    wrong: float
    depth_wrong: float
    judged: int

    @property
    def depth_wrong_at_most(self) -> float:
        """Upper bound of the share that is wrong by depth, as if pixels were drawn at random."""
        return share_at_most(round(self.depth_wrong * self.judged), self.judged)


class ReplayWorkbench:
    """Two eyes straight before a scene's plate, what they truly see, and what they are shown.

    Parameters
    ----------
    scene, viewer
        Scene, and its viewer.
    columns
        Columns of the films of both eyes; rows follow from the plate.
    """

    def __init__(self, scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> None:
        self._scene = scene
        self._reference = EyeReference(scene)
        width, height = scene.plate.size
        film = (columns, max(1, round(columns * height / width)))
        middle = Eye(position=(0.0, 0.0, viewer.distance), resolution=film)
        self._views = []
        for eye in stereo_eyes([middle], eyes_apart(viewer, Display.of(scene))):
            self._views.append(
                Views(
                    true=self._reference.true_view(eye, shaded=False),
                    replayed=self._reference.replayed(eye, shaded=False),
                    drawn=None,
                    taken=self._reference.replay(eye),
                )
            )
        self._control: tuple[DoubleFrustum, list[Mask]] | None = None

    @property
    def eye_pixel(self) -> float:
        """Width that a pixel of the eyes' films has on the plate, scene units."""
        return self._scene.plate.size[0] / self._views[0].eye.resolution[0]

    @property
    def hogels(self) -> int:
        """Number of hogels that the eyes are shown."""
        return len(hogels_of(view.taken for view in self._views))

    def measure(
        self, settings: DoubleFrustum, done: Callable[[int], object] = lambda hogels: None
    ) -> Replayed:
        """Draw what the eyes are shown of hogels with some settings, and with exact depth, and judge both.

        Settings that differ in their depth buffers alone share the pictures of exact depth.
        """
        exact = with_exact_depth(settings)
        if self._control is None or self._control[0] != exact:
            self._control = exact, self._wrong(self._drawn(exact))
            done(self.hogels)
        views = self._drawn(settings)
        done(self.hogels)
        wrong = self._wrong(views)
        judged = sum(one.size for one in wrong)
        by_depth = sum(int((a & ~b).sum()) for a, b in zip(wrong, self._control[1], strict=True))
        _, pair = disparity(self._reference, *views)
        assert pair is not None
        change = pair.change_arcsec
        return Replayed(
            hogels=self.hogels,
            matched=pair.matched,
            disparity_change_arcsec=None if change is None else max(change.p99, 0.0) - min(change.p1, 0.0),
            depth=pair.depth,
            wrong=sum(int(one.sum()) for one in wrong) / judged,
            depth_wrong=by_depth / judged,
            judged=judged,
        )

    def _drawn(self, settings: DoubleFrustum) -> list[Views]:
        collectors = [Collector(self._scene, view.eye, view.taken, settings) for view in self._views]
        source = Drawing(self._scene, settings)
        images: Sequence[EyeImage] = collected(
            source.hogels(film_parts(view.taken for view in self._views)), collectors
        )
        return [replace(view, drawn=image) for view, image in zip(self._views, images, strict=True)]

    def _wrong(self, views: Sequence[Views]) -> list[Mask]:
        """Return the judged pixels that show a wrong surface, for each eye."""
        found = []
        for view in views:
            maps = renderer_loss(self._reference, view, numbered=True)
            assert maps.wrong is not None
            found.append(maps.wrong[maps.judged])
        return found
