"""How fast are many hogels at once, next to loops that anybody would write? Hogels per second, and ratios."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

from xfrustum.raster.plate.one_by_one import PlainLoop
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reports.benchmarks import common
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Timing, race
from xfrustum.scenes.model.effects import Effect, needed
from xfrustum.scenes.model.plate_content import ColorType, PlateContent
from xfrustum.scenes.model.scene import Scene

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
    *((BATCHED, PLAIN), (BATCHED, PLAIN_NUMBERED), (BATCHED, DISCARDED)),
    *((COLOR, BARE), (COLOR, BARE_NUMBERED)),
)
"""Pairs of contestants; the rate of the first is divided by that of the second."""

EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)
COLOR_ONLY = PlateContent(color=ColorType.UINT8)


def benchmark_plate(
    scene: Scene, resolution: int = RESOLUTION, repeat: int = REPEAT, *, progress: bool = False
) -> common.Record:
    """Race the middle row of a scene's plate, W = H pixels a hogel and one sample a pixel.

    Raises InputError where the scene has no triangles, or a number is not positive.
    """
    scene, repeat = common.sized(scene, resolution), common.positive(repeat)
    settings, row = common.settings_of(scene), scene.plate.middle.row
    apertures = [scene.plate.aperture(column, row) for column in range(scene.plate.hogels[0])]
    effects = needed(scene) - {Effect.REFLECTION}  # plain loops draw no reflections
    turns = (repeat + 1) * len(MEANINGS)
    with ExitStack() as stack, progress_bar(turns, "bench", "row", shown=progress) as bar:

        def loop(content: PlateContent, *, numbered: bool) -> PlainLoop:
            return stack.enter_context(PlainLoop(scene, settings, content, numbered=numbered))

        batched, color = (
            stack.enter_context(PlateRenderer(scene, settings, replace(content, effects=effects)))
            for content in (EVERYTHING, COLOR_ONLY)
        )
        plain, plain_numbered = loop(EVERYTHING, numbered=False), loop(EVERYTHING, numbered=True)
        bare, bare_numbered = loop(COLOR_ONLY, numbered=False), loop(COLOR_ONLY, numbered=True)
        runs = {
            PLAIN: lambda: common.exhaust(plain.hogels(apertures)),
            PLAIN_NUMBERED: lambda: common.exhaust(plain_numbered.hogels(apertures)),
            BATCHED: lambda: common.exhaust(batched.hogels(apertures)),
            DISCARDED: lambda: batched.draw_only(apertures, rasterize=False),
            BARE: lambda: bare.draw_only(apertures),
            BARE_NUMBERED: lambda: bare_numbered.draw_only(apertures),
            COLOR: lambda: common.exhaust(color.hogels(apertures)),
        }
        seconds = race(runs, repeat, bar.update)
        # Everything has warmed up by now.
        measured = [batched.measure(apertures) for _ in range(repeat)]
        device = batched.device["renderer"]
    rates = {name: common.rate_of(len(apertures), taken) for name, taken in seconds.items()}
    clocks = ("gpu_s", "wall_s")
    return {
        "scene": common.scene_record(scene),
        "resolution": scene.frustum.resolution,
        "settings": settings,
        "row": row,
        "hogels": len(apertures),
        "meanings": MEANINGS,
        "hogels_per_second": rates,
        "ratios": common.ratios_of(rates, RATIOS),
        "stages_s": {
            stage: {clock: Timing.of([getattr(run[stage], clock) for run in measured]) for clock in clocks}
            for stage in measured[0]
        },
        "device": device,
        **common.machine_record(),
    }


def table(found: common.Record) -> str:
    """Return rates, ratios and stages as text."""
    machine, scene, hogels = found["machine"], found["scene"], found["hogels"]
    width, height = found["resolution"]
    rates: dict[str, Timing] = found["hogels_per_second"]
    lines = [
        f"{scene['name']}, {scene['triangles']:,} triangles, row {found['row']}: "
        f"{hogels} hogels of {width} x {height}",
        f"{found['device']}; {machine['cores']} cores of {machine['processor']}",
        f"median of {rates[PLAIN].repetitions} after a warm-up (slowest to fastest), taking turns",
        *("", "hogels per second"),
    ]
    for name, rate in rates.items():
        lines.append(f"  {name:<18}{rate.median:9.1f} ({rate.lowest:.1f} to {rate.highest:.1f})")
    lines += ["", *(f"  {pair:<34}{ratio:6.2f}" for pair, ratio in found["ratios"].items())]
    lines += ["", f"stages of {BATCHED}, ms a hogel: the device's own, and wall time of giving the orders"]
    for name, clocks in found["stages_s"].items():
        figures = (f"{1e3 * clock.median / hogels:9.3f}" for clock in clocks.values())
        lines.append(f"  {name:<18}" + "".join(figures))
    return "\n".join([*lines, "", *(f"{name}: {meaning}" for name, meaning in MEANINGS.items())])
