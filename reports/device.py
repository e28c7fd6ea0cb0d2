"""`xfrustum device`: rounding of the current OpenGL device, as table, page and `device.json`."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from xfrustum.compare.fingerprints import DeviceRecord, Measured
from xfrustum.compare.recorded import Replayed, read_frames, replay
from xfrustum.raster.device.context import (
    OLDEST_VERSION,
    describe,
    egl_devices,
    open_context,
    overlooked_card,
)
from xfrustum.raster.device.fingerprint import draw_fingerprint
from xfrustum.reports.common.outputs import json_object, progress_bar, write_files
from xfrustum.reports.common.templates_environment import html_page, plain_text
from xfrustum.reports.text import aligned
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.disk import write_file
from xfrustum.scenes.model.device_model import DeviceModel, kept_at

FILES = PAGE, DATA = "index.html", "device.json"


def measure_device() -> DeviceRecord:
    """Draw and measure the fingerprint of the device of EGL; InputError without OpenGL 3.3.

    The measured model of an unknown device is stored (`kept_at`), and other commands then use it to
    explain pixels.
    """
    with open_context(OLDEST_VERSION) as context:
        names = describe(context)
        measured = Measured(draw_fingerprint(context, names))
    # Free the context, a limited resource of the driver: the analysis needs none.
    context.release()
    record = measured.record
    # Devices of the shipped table keep their reviewed model.
    if measured.known == measured.model:
        kept = kept_at(names)
        # If it cannot be stored, other commands use the model that holds for any device.
        with suppress(OSError, InputError):
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_file(kept, json.dumps(json_object(record)).encode())
    return record


def table(record: DeviceRecord) -> str:
    """Return the measurements as aligned lines, with the number of trials."""
    # The template separates the cells of a row by tabs.
    lines = plain_text("device.txt.j2", {"record": record}).splitlines()
    rows = aligned([line.split("\t") for line in lines], str.ljust)
    return f"{record.renderer}, OpenGL {record.version}\n{rows}"


def write_device(record: DeviceRecord, out: Path) -> tuple[Path, ...]:
    """Write the page and device.json to a folder; InputError if they cannot be written."""
    values = {"found": record, "table": table(record)}
    return write_files(out, {PAGE: html_page("device.html.j2", values), DATA: record})


def listed() -> dict[str, Any]:
    """Return all EGL devices, and advice about a GPU that EGL does not use."""
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
    """Explain recorded frames by a model, by default the model of their device."""
    recording = read_frames(frames)
    with progress_bar(len(recording[1]), "replay", "frame", shown=progress) as bar:
        return replay(recording, model, lambda frame: bar.update())


def replay_table(replay: Replayed) -> str:
    """Return the causes of differences of recorded frames as text."""
    return plain_text("device-replay.txt.j2", {"replay": replay}).rstrip("\n")
