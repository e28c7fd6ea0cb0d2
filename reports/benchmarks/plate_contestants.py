"""Contestants for a race over one row of a plate: many hogels at once, and loops that anybody would write."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

from xfrustum.raster.device.timer import StageTime
from xfrustum.raster.plate.plain_loop import PlainLoop
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.scenes.model.effects import Effect, needed
from xfrustum.scenes.model.plate_content import ColorType, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

PLAIN, PLAIN_NUMBERED, BATCHED = "plain", "plain-numbered", "batched"
DISCARDED = "batched-discarded"
BARE, BARE_NUMBERED, COLOR = "bare", "bare-numbered", "batched-color"

MEANINGS = {
    PLAIN: "one hogel after the other, every triangle twice, triangle numbers and float32 color read back",
    PLAIN_NUMBERED: "the same, with the triangles' numbers in vertices instead of gl_PrimitiveID",
    BATCHED: "PlateRenderer, the same images read back",
    DISCARDED: "the draws of batched with rasterization discarded, nothing read back",
    BARE: "one hogel after the other, every triangle twice, 8-bit color only, nothing read back",
    BARE_NUMBERED: "the same, with the triangles' numbers in vertices instead of gl_PrimitiveID",
    COLOR: "PlateRenderer, 8-bit color only, read back",
}

EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)
COLOR_ONLY = PlateContent(color=ColorType.UINT8)

Run = Callable[[], object]
"""Draws the whole row once."""


@dataclass(frozen=True, kw_only=True)
class PlateContestants:
    """All contestants, ready to run.

    Attributes
    ----------
    runs
        What draws the row, by the names in `MEANINGS`.
    device
        Name of the device that draws.
    measure
        Draws the row as `BATCHED` does, and returns the time of each stage.
    """

    runs: dict[str, Run]
    device: str
    measure: Callable[[], dict[str, StageTime]]


@contextmanager
def plate_contestants(
    scene: Scene, settings: DoubleFrustum, apertures: Sequence[Aperture]
) -> Iterator[PlateContestants]:
    """Open all contestants; leaving frees them.

    Parameters
    ----------
    scene
        Scene with at least one triangle.
    settings
        Settings of the double frustum.
    apertures
        The row.

    Raises
    ------
    InputError
        See `PlateRenderer`.
    """
    with ExitStack() as stack:

        def loop(content: PlateContent, *, numbered: bool) -> PlainLoop:
            return stack.enter_context(PlainLoop(scene, settings, content, numbered=numbered))

        def batched(content: PlateContent) -> PlateRenderer:
            # Plain loops draw no reflections.
            content = replace(content, effects=needed(scene) - {Effect.REFLECTION})
            return stack.enter_context(PlateRenderer(scene, settings, content))

        everything, color = batched(EVERYTHING), batched(COLOR_ONLY)
        plain, plain_numbered = (loop(EVERYTHING, numbered=numbered) for numbered in (False, True))
        bare, bare_numbered = (loop(COLOR_ONLY, numbered=numbered) for numbered in (False, True))
        runs: dict[str, Run] = {
            PLAIN: lambda: exhaust(plain.hogels(apertures)),
            PLAIN_NUMBERED: lambda: exhaust(plain_numbered.hogels(apertures)),
            BATCHED: lambda: exhaust(everything.hogels(apertures)),
            DISCARDED: lambda: everything.draw_only(apertures, rasterize=False),
            BARE: lambda: bare.draw_only(apertures),
            BARE_NUMBERED: lambda: bare_numbered.draw_only(apertures),
            COLOR: lambda: exhaust(color.hogels(apertures)),
        }
        yield PlateContestants(
            runs=runs,
            device=everything.device["renderer"],
            measure=lambda: everything.measure(apertures),
        )


def exhaust(hogels: Iterable[PlateHogel]) -> int:
    """Take every image, keep none, and return how many there were."""
    return sum(1 for _ in hogels)
