"""How fast are many hogels at once, next to loops that anybody would write? Hogels per second, and ratios."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace

from xfrustum.raster.plate.plain_loop import PlainLoop
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reports.benchmarks.common import (
    Record,
    exhaust,
    machine_record,
    positive,
    rate_of,
    ratios_of,
    scene_record,
    settings_of,
    sized,
)
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Timing, race
from xfrustum.scenes.model.effects import Effect, needed
from xfrustum.scenes.model.plate_content import ColorType, PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

RESOLUTION = 128
REPEAT = 5

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
"""All contestants, in the order in which they are listed."""

RATIOS = (
    (BATCHED, PLAIN),
    (BATCHED, PLAIN_NUMBERED),
    (BATCHED, DISCARDED),
    (COLOR, BARE),
    (COLOR, BARE_NUMBERED),
)
"""Pairs of contestants; the rate of the first is divided by that of the second."""

EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)
COLOR_ONLY = PlateContent(color=ColorType.UINT8)


def benchmark_plate(
    scene: Scene, resolution: int = RESOLUTION, repeat: int = REPEAT, *, progress: bool = False
) -> Record:
    """Race the middle row of a scene's plate, W = H pixels a hogel.

    The scene's own resolution and sampling do not matter, for plain loops take one sample. Contestants warm
    up, and then take `repeat` turns.

    Raises
    ------
    InputError
        The scene has no triangles, or a number is not positive.
    """
    scene, repeat = sized(scene, resolution), positive(repeat)
    settings, row = settings_of(scene), scene.plate.middle.row
    apertures = [scene.plate.aperture(column, row) for column in range(scene.plate.hogels[0])]
    with (
        ExitStack() as stack,
        progress_bar((repeat + 1) * len(MEANINGS), "bench", "row", shown=progress) as bar,
    ):
        batched = stack.enter_context(_batched(scene, settings, EVERYTHING))
        runs = {
            BATCHED: lambda: exhaust(batched.hogels(apertures)),
            DISCARDED: lambda: batched.draw_only(apertures, rasterize=False),
            **_other_contestants(stack, scene, settings, apertures),
        }
        seconds = race({name: runs[name] for name in MEANINGS}, repeat, bar.update)
        # Everything has warmed up by now.
        measured = [batched.measure(apertures) for _ in range(repeat)]
        device = batched.device["renderer"]
    rates = {name: rate_of(len(apertures), taken) for name, taken in seconds.items()}
    return {
        "scene": scene_record(scene),
        "resolution": scene.frustum.resolution,
        "settings": settings,
        "row": row,
        "hogels": len(apertures),
        "meanings": MEANINGS,
        "hogels_per_second": rates,
        "ratios": ratios_of(rates, RATIOS),
        "stages_s": {
            stage: {
                clock: Timing.of([getattr(run[stage], clock) for run in measured])
                for clock in ("gpu_s", "wall_s")
            }
            for stage in measured[0]
        },
        "device": device,
        **machine_record(),
    }


def _batched(scene: Scene, settings: DoubleFrustum, content: PlateContent) -> PlateRenderer:
    # Plain loops draw no reflections.
    effects = needed(scene) - {Effect.REFLECTION}
    return PlateRenderer(scene, settings, replace(content, effects=effects))


def _other_contestants(
    stack: ExitStack, scene: Scene, settings: DoubleFrustum, apertures: Sequence[Aperture]
) -> dict[str, Callable[[], object]]:
    """Open the plain loops and the plate of color only; leaving the stack frees them."""

    def loop(content: PlateContent, *, numbered: bool) -> PlainLoop:
        return stack.enter_context(PlainLoop(scene, settings, content, numbered=numbered))

    plain, plain_numbered = loop(EVERYTHING, numbered=False), loop(EVERYTHING, numbered=True)
    bare, bare_numbered = loop(COLOR_ONLY, numbered=False), loop(COLOR_ONLY, numbered=True)
    color = stack.enter_context(_batched(scene, settings, COLOR_ONLY))
    return {
        PLAIN: lambda: exhaust(plain.hogels(apertures)),
        PLAIN_NUMBERED: lambda: exhaust(plain_numbered.hogels(apertures)),
        BARE: lambda: bare.draw_only(apertures),
        BARE_NUMBERED: lambda: bare_numbered.draw_only(apertures),
        COLOR: lambda: exhaust(color.hogels(apertures)),
    }


def table(found: Record) -> str:
    """Return rates, ratios and stages as text."""
    machine, scene, hogels = found["machine"], found["scene"], found["hogels"]
    width, height = found["resolution"]
    rates: dict[str, Timing] = found["hogels_per_second"]
    return "\n".join(
        (
            f"{scene['name']}, {scene['triangles']:,} triangles, row {found['row']}: "
            f"{hogels} hogels of {width} x {height}",
            f"{found['device']}; {machine['cores']} cores of {machine['processor']}",
            f"median of {rates[PLAIN].repetitions} after a warm-up (slowest to fastest), taking turns",
            "",
            "hogels per second",
            *(
                f"  {name:<18}{rate.median:9.1f} ({rate.lowest:.1f} to {rate.highest:.1f})"
                for name, rate in rates.items()
            ),
            "",
            *(f"  {pair:<34}{ratio:6.2f}" for pair, ratio in found["ratios"].items()),
            "",
            f"stages of {BATCHED}, ms a hogel: the device's own, and wall time of giving the orders",
            *(
                f"  {name:<18}" + "".join(f"{1e3 * clock.median / hogels:9.3f}" for clock in clocks.values())
                for name, clocks in found["stages_s"].items()
            ),
            "",
            *(f"{name}: {meaning}" for name, meaning in MEANINGS.items()),
        )
    )
