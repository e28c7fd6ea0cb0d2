"""Frames that are drawn to be judged, in turns of the thread that draws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from xfrustum.compare.judging.parts import Part
from xfrustum.compare.judging.stopwatch import Machine, Stopwatch
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.raster import Drawn, Rasterizer
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A frame that is drawn, and the time that this took."""

    drawn: Drawn
    lap: Stopwatch

    @property
    def image(self) -> HogelImage:
        """The image."""
        return self.drawn.image

    @property
    def settings(self) -> DoubleFrustum:
        """The settings that it was drawn with."""
        settings = self.image.camera.settings
        assert settings is not None, "the rasterizer says with which settings it drew"
        return settings

    @property
    def gpu_s(self) -> float:
        """Seconds in which the device drew, by its own clock."""
        return self.drawn.times["draw"].gpu_s


Frames = tuple[Frame, ...]
"""Frames of the same cameras that are drawn together."""


def warm_up(
    stage: tuple[Machine, Stopwatch],
    aperture: Aperture,
    settings: Iterable[DoubleFrustum],
    rasterizer: Rasterizer,
    *,
    color: bool,
) -> None:
    """Have what a frame needs compiled and allocated, which belongs to the time of no frame.

    Parameters
    ----------
    stage
        Machine whose time is shared, and stopwatch that is given the time.
    aperture, settings
        Aperture, and the settings of the frames that are to be drawn.
    rasterizer
        Rasterizer that is to draw them.
    color
        Whether they are drawn in color.
    """
    machine, watch = stage
    with machine.stage(watch, "warm up"):
        for one in {(setting.depth, setting.mapping): setting for setting in settings}.values():
            rasterizer.warm_up(aperture, one, color=color)


def draw_turn(
    machine: Machine,
    aperture: Aperture,
    rasterizer: Rasterizer,
    *,
    parts: Sequence[Part],
    drawn: Sequence[Future[Frames]],
    color: bool,
) -> None:
    """Draw the frames of one turn, undisturbed, and hand them over when all are drawn.

    Frames are large. Those of each part have a future of their own, so that they are kept only as long as
    somebody waits for that part or judges it.

    Parameters
    ----------
    machine, aperture, rasterizer
        Machine whose time is shared, the frames' aperture, and the rasterizer that draws them.
    parts, drawn
        Parts of the turn, and the future of each part's frames. After an error all of them have this error.
    color
        Whether frames are drawn in color.
    """
    wanted = [
        (part, one) for part, one in zip(parts, drawn, strict=True) if one.set_running_or_notify_cancel()
    ]
    try:
        with machine.undisturbed():
            found = [
                tuple(_frame(machine, aperture, one, rasterizer, color=color) for one in part.settings)
                for part, _ in wanted
            ]
    except BaseException as error:
        for _, one in wanted:
            one.set_exception(error)
        raise
    for frames, (_, one) in zip(found, wanted, strict=True):
        one.set_result(frames)


def exact_frame(
    stage: tuple[Machine, Stopwatch], aperture: Aperture, drawn: Future[Frames], rasterizer: Rasterizer
) -> HogelImage:
    """Return the frame with exact depth among frames of the same cameras, or draw it.

    It belongs to the time of no frame, and is drawn beside what judges frames.

    Parameters
    ----------
    stage
        Machine whose time is shared, and stopwatch of what the hogel's drawings have in common.
    aperture, drawn
        Aperture and frames, which the rasterizer has drawn before.
    rasterizer
        The rasterizer.
    """
    machine, watch = stage
    frames = drawn.result()
    exact = with_exact_depth(frames[0].settings)
    found = [frame.image for frame in frames if frame.settings == exact]
    if found:
        return found[0]
    with machine.stage(watch, "causes"):
        return rasterizer.draw_beside(aperture, exact, frames[0].drawn)


def _frame(
    machine: Machine, aperture: Aperture, settings: DoubleFrustum, rasterizer: Rasterizer, *, color: bool
) -> Frame:
    lap = Stopwatch()
    with machine.timed(lap, "raster"):
        drawn = rasterizer.draw(aperture, settings, normals=False, color=color)
    return Frame(drawn=drawn, lap=lap)
