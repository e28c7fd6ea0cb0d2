"""`xfrustum device`: rounding of the OpenGL device at hand, as table, page and `device.json`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from xfrustum.compare.device.fingerprints import Measured
from xfrustum.compare.device.recorded import Replayed, read_frames, replay
from xfrustum.raster.device.context import (
    OLDEST_VERSION,
    describe,
    egl_devices,
    open_context,
    overlooked_card,
)
from xfrustum.raster.device.fingerprint import draw_fingerprint
from xfrustum.reports.common.figure_style import Figure, log_axis, look, styled
from xfrustum.reports.common.outputs import json_object, progress_bar, write_files
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.text import aligned
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.durable import write_file
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.device_model import DeviceModel, kept_at
from xfrustum.scenes.plate.double_frustum import DepthFormat
from xfrustum.scenes.representation import percent

FILES = PAGE, DATA = "index.html", "device.json"


def measure_device() -> Measured:
    """Draw and measure the fingerprint of the device of EGL; InputError without OpenGL 3.3.

    A device that is not known is kept (`kept_at`), so that other commands explain by its measured
    model.
    """
    with open_context(OLDEST_VERSION) as context:
        names = describe(context)
        measured = Measured(draw_fingerprint(context, names))
    # Contexts are a limited resource of the driver: analysis needs none.
    context.release()
    # Devices of the shipped table keep their reviewed model.
    if measured.known == measured.model:
        kept = kept_at(names)
        # Without a folder to keep it in, other commands take the model that holds for any device.
        with suppress(OSError, InputError):
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_file(kept, json.dumps(json_object(measured.record)).encode())
    return measured


def table(measured: Measured) -> str:
    """Return the measurements as aligned lines, with the number of trials."""
    record = json_object(measured.record)
    tried = record["tried"]
    pixels = f"{tried['triangles']} triangles, {tried['pixels']:,} pixels"
    noise = "?" if record["plane_noise"] is None else f"{record['plane_noise']:.2f}"
    planes = (
        f"from {'' if record['snaps_depth'] else 'un'}snapped vertices, {noise} roundings a pixel"
    )
    bits, filtered = record["subpixel_bits"], record["filter_bits"]
    edges, cuts = f"{tried['edges_in_window']} triangles", record["cuts"]
    sides = "none" if (begins := record["cut_from_px"]) is None else f"from {begins:.4g} px on"
    cut = (
        f"{cuts['differ']:,} pixels differ, at most {cuts['farthest_px']:.2g} px from the exact cut"
    )
    rows = [
        ("measured", "", "tried"),
        (
            "subpixel bits",
            f"{bits}, vertices snapped to 1/{2**bits} px",
            f"{tried['edges']} triangles",
        ),
        ("places in the window", _least(record["viewport"]), edges),
        ("pixel centers on edges are of the", _least(record["ties"]), edges),
        ("cut at the window's sides", sides, f"up to {tried['reach_px']:,.0f} px from its middle"),
        ("cut by near and far plane", cut, f"{cuts['pixels']:,} pixels"),
        ("depth planes", planes, pixels),
    ]
    for name, steps in record["depth"].items():
        # Float depth has no uniform step: 2^-24 is its spacing next to one, the widest.
        unit = "steps of 2^-24" if name == "d32f" else "steps"
        rows += [
            (
                f"{name} written",
                f"{_steps(steps['written_steps'])} {unit}",
                f"{tried['written'][name]:,}",
            ),
            (f"{name} interpolated", f"{_steps(steps['interpolated_steps'])} {unit}", pixels),
        ]
    weights = "float32" if filtered is None else f"multiples of 1/{2**filtered}"
    rows.append(("filter weights", weights, f"{tried['filtered']:,} places"))
    equal = ", ".join(f"{name} {off:.2g}" for name, off in record["varyings"].items())
    rows.append(("equal varyings off by", equal, "every 7th triangle"))
    within = ", ".join(
        f"{name} {percent(part['within'] / max(part['pixels'], 1))}"
        for name, part in record["within"].items()
    )
    smaller = ", ".join(
        f"{name} {part['share_of_safe']:.2f}" for name, part in record["within"].items()
    )
    rows += [
        (f"within the bounds of {record['model']['name']}", within, pixels),
        ("these bounds, relative to those of any device", smaller, ""),
    ]
    return f"{record['renderer']}, OpenGL {record['version']}\n{aligned(rows, str.ljust)}"


def _least(counts: dict[str, int]) -> str:
    """Return the names with the fewest wrong pixels, and their number."""
    # Several hypotheses may fit equally; all of them are named.
    least = min(counts.values())
    names = " or ".join(name for name, count in counts.items() if count == least)
    return f"{names} ({least:,} pixels differ)"


def _steps(steps: tuple[float, float]) -> str:
    low, high = steps
    return f"{low:+.3g} to {high:+.3g}"


def write_device(measured: Measured, out: Path) -> tuple[Path, ...]:
    """Write the page and device.json to a folder; InputError where they cannot be written."""
    record = measured.record
    values = {"found": record, "table": table(measured), "figures": figures(measured)}
    return write_files(out, {PAGE: html_page("device.html.j2", values), DATA: record})


def figures(measured: Measured) -> dict[str, Figure]:
    """Draw the distance of depths from their planes against the slopes of the planes."""
    planes = {"corners as given": False, "corners snapped to the grid": True}
    float32 = {
        name: measured.off_by_slope(DepthFormat.D32F, snapped=snapped)
        for name, snapped in planes.items()
    }
    fixed = {
        depth.value.upper(): measured.off_by_slope(depth, snapped=measured.snaps_depth)
        for depth in (DepthFormat.D16, DepthFormat.D24)
    }
    return {
        "float32": _by_slope(float32, "steps of 2^-24"),
        "fixed": _by_slope(fixed, "steps of the format"),
    }


def _by_slope(offsets: Mapping[str, Floats], steps: str) -> Figure:
    curves: list[dict[str, Any]] = []
    for place, (name, pairs) in enumerate(offsets.items()):
        color, marker = look(place)
        # Logarithmic axes have no zero: exact depths and flat planes are left out.
        slope, off = pairs[(pairs > 0).all(axis=1)].T
        points = {"type": "scatter", "mode": "markers", "x": slope.tolist(), "y": off.tolist()}
        curves.append(
            {**points, "name": name, "marker": {"color": color, "symbol": marker, "size": 5}}
        )
    ends = [[end for curve in curves for end in curve[axis]] for axis in "xy"]
    layout = {
        "height": 380,
        "xaxis": {"title": f"slope of depth, {steps} a pixel", **log_axis(ends[0])},
    }
    return styled(
        curves, layout | {"yaxis": {"title": f"stored minus exact, {steps}", **log_axis(ends[1])}}
    )


def listed() -> dict[str, Any]:
    """Return all devices of EGL, and the reason for an overlooked card."""
    return {"devices": [vars(device) for device in egl_devices()], "overlooked": overlooked_card()}


def list_table(record: dict[str, Any]) -> str:
    """Return the devices of EGL as aligned lines."""
    rows = [("EGL device", "renderer", "OpenGL")]
    rows += [
        (str(device["index"]), device["renderer"] or "none", device["version"])
        for device in record["devices"]
    ]
    return "\n".join(filter(None, (aligned(rows, str.ljust), record["overlooked"])))


def replayed(frames: Path, model: DeviceModel | None = None, *, progress: bool = False) -> Replayed:
    """Explain recorded frames by a model, None for the model of their device."""
    recording = read_frames(frames)
    with progress_bar(len(recording[1]), "replay", "frame", shown=progress) as bar:
        return replay(recording, model, lambda frame: bar.update())


def replay_table(replay: Replayed) -> str:
    """Return the causes of differences of recorded frames as text."""
    counts = ", ".join(f"{name} {count:,}" for name, count in replay.counts.items())
    lines = [
        f"{replay.frames} frames of {replay.device}, "
        f"explained by the model of {replay.model.name}:",
        f"{replay.wrong:,} pixels differ from exact cameras: {counts}",
    ]
    return "\n".join(
        [*lines, *(f"unexplained in {name}: {n:,}" for name, n in replay.unexplained.items())]
    )
