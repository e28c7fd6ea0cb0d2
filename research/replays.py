"""Replays of drawn plates to the two eyes of a viewer, measured."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from xfrustum.compare.eye import loss
from xfrustum.compare.eye.noticeable import Display, Viewer, eyes_apart
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reports.view import Drawing
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.eye import Eye

FILM_COLUMNS = (
    64  #: columns of the films of both eyes: a part is drawn of no more hogels than pixels
)


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """Measures of the pictures that two eyes are shown of drawn hogels."""

    hogels: int  #: Number of hogels of which pixels were drawn
    matched: int  #: Number of surface points that both eyes are shown
    #: Largest difference of the changes of disparity of two points, or of one and the plate's
    #: border, from the 1st to the 99th percentile; None where both eyes are shown no point
    disparity_change_arcsec: float | None
    depth: (
        loss.DepthShift | None
    )  #: By how much farther away than they are points are seen, scene units
    #: Share of both eyes' judged pixels with a wrong surface, and share of those right with exact
    #: depth
    wrong: float
    depth_wrong: float
    judged: int  #: Number of both eyes' judged pixels


def two_eyes(scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> tuple[Eye, ...]:
    """Return a viewer's left and right eye, their films with so many columns over the plate."""
    width, height = scene.plate.size
    film = (columns, max(1, round(columns * height / width)))
    half = eyes_apart(viewer, Display.from_scene(scene)) / 2
    return tuple(Eye(position=(x, 0.0, viewer.distance), resolution=film) for x in (-half, half))


class ReplayWorkbench:
    """Two eyes straight before a plate, with their true and their replayed views."""

    def __init__(self, scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> None:
        self._scene = scene
        self._reference = EyeReference(scene)
        self._views = [
            loss.Views(
                true=self._reference.true_view(eye, shaded=False),
                replayed=self._reference.replayed(eye, shaded=False),
                drawn=None,
                taken=self._reference.replay(eye),
            )
            for eye in two_eyes(scene, viewer, columns)
        ]
        self._control: tuple[DoubleFrustum, list[Mask]] | None = None

    @property
    def hogels(self) -> int:
        """Number of hogels that the eyes are shown."""
        return len(loss.hogels_of(view.taken for view in self._views))

    def measure(self, settings: DoubleFrustum) -> Replayed:
        """Draw what the eyes are shown, and with exact depth, which settings may share; judge both."""
        exact = with_exact_depth(settings)
        if self._control is None or self._control[0] != exact:
            self._control = exact, self._wrong(self._drawn(exact))
        views = self._drawn(settings)
        wrong = self._wrong(views)
        judged = sum(one.size for one in wrong)
        by_depth = sum(int((a & ~b).sum()) for a, b in zip(wrong, self._control[1], strict=True))
        pair = loss.disparity(self._reference, *views)
        change = pair.change_arcsec
        return Replayed(
            hogels=self.hogels,
            matched=pair.matched,
            disparity_change_arcsec=None
            if change is None
            else max(change.p99, 0.0) - min(change.p1, 0.0),
            depth=pair.depth,
            wrong=sum(int(one.sum()) for one in wrong) / judged,
            depth_wrong=by_depth / judged,
            judged=judged,
        )

    def _drawn(self, settings: DoubleFrustum) -> list[loss.Views]:
        collectors = [
            loss.Collector(self._scene, view.eye, view.taken, settings) for view in self._views
        ]
        hogels = Drawing(self._scene, settings).hogels(
            loss.film_parts(view.taken for view in self._views)
        )
        images = loss.collected(hogels, collectors)
        return [replace(view, drawn=image) for view, image in zip(self._views, images, strict=True)]

    def _wrong(self, views: Sequence[loss.Views]) -> list[Mask]:
        """Return the judged pixels that show a wrong surface, for each eye."""
        found = []
        for view in views:
            maps = loss.renderer_loss(self._reference, view, numbered=True)
            assert maps.wrong is not None
            found.append(maps.wrong[maps.judged])
        return found
