"""`xfrustum device`: output, files and errors; graphics cards that EGL does not list."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support.commands import Command
from tests.support.scene_file import film, part
from xfrustum.raster.device import context
from xfrustum.scenes.model import device_model
from xfrustum.scenes.model.device_model import H100, DeviceModel, safe_model


def names_at_hand(version: int = context.OLDEST_VERSION) -> dict[str, str]:
    """Return vendor, renderer, version and subpixel bits of the device in use."""
    with context.open_context(version) as opened:
        names = context.describe(opened)
    opened.release()
    return names


def test_a_device_that_is_not_known_is_measured_once_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in tuple(device_model.KNOWN):
        monkeypatch.delitem(device_model.KNOWN, name)
    names = names_at_hand()
    safe = safe_model(int(names["subpixel_bits"]))
    assert device_model.model_of(names) == safe
    folder = tmp_path / "measured"
    measured = command(f"device --json --quiet --out {folder}").record
    assert measured["varyings"]["flat"] == 0
    for name, counts in measured["within"].items():
        assert counts["within"] == counts["pixels"] >= (4096 if name == "filter" else 50_000)
    assert DeviceModel.read(folder / "device.json").subpixel_bits == measured["subpixel_bits"]
    assert measured["renderer"] in (folder / "index.html").read_text()
    assert json.loads(json.dumps(device_model.model_of(names).as_json())) == measured["model"]
    assert device_model.model_of(names | {"version": "of tomorrow"}) == safe
    device_model.kept_at(names).write_text("damaged")
    assert device_model.model_of(names) == safe


@pytest.mark.slow
def test_softpipe_is_measured_too_and_steps_through_d16(tmp_path: Path) -> None:
    """softpipe has only OpenGL 3.3, and its D16 exceeds the bounds for unknown devices."""
    command = [sys.executable, "-m", "xfrustum", "device", "--json", "--quiet"]
    environment = os.environ | {"GALLIUM_DRIVER": "softpipe", "LIBGL_ALWAYS_SOFTWARE": "1"}
    answer = json.loads(
        subprocess.run(command, env=environment, capture_output=True, check=True).stdout
    )
    if answer["renderer"] != "softpipe":
        pytest.skip(f"Mesa has no softpipe here: {answer['renderer']} drew")
    assert answer["model"]["name"] == "softpipe"
    assert all(counts["within"] == counts["pixels"] for counts in answer["within"].values())
    assert answer["depth"]["d16"]["interpolated_steps"][1] > safe_model(4).d16[1]


def test_the_devices_of_egl_are_listed(command: Command) -> None:
    listed = {device["renderer"] for device in command("device --list --json").record["devices"]}
    assert names_at_hand()["renderer"] in listed


@pytest.mark.parametrize("shift", [0, 1])
def test_a_recording_is_explained_by_the_model_of_its_device(
    shift: int, tmp_path: Path, shared_data: Path, command: Command
) -> None:
    with np.load(shared_data / "data" / "devices" / "h100-frames.npz") as recording:
        frame = "crossing|0.01|d24|standard|40,30"
        frames = {"device": recording["device"], frame: np.roll(recording[frame], shift, axis=1)}
    np.savez(tmp_path / "frames.npz", **frames)
    answer = command(f"device --replay {tmp_path}/frames.npz --json --quiet", status=shift).record
    assert answer["frames"] == 1
    assert answer["device_model"] == "NVIDIA H100"
    parts = sum(answer[name] for name in ("edge", "order", "lost", "unexplained"))
    assert answer["wrong"] == parts
    assert (answer["unexplained"] > 0) == bool(shift)


def test_plan_verify_and_conformance_name_the_device_of_their_bounds(
    tmp_path: Path, command: Command
) -> None:
    path, scene = tmp_path / "device.json", tmp_path / "scene.toml"
    path.write_text(json.dumps({"model": H100.as_json()}))
    (tmp_path / "none").mkdir()
    lens = film((40.0, 30.0), (3, 3), (16, 12), fov_deg=(60.0, 50.0), reach=(20.0, 30.0))
    scene.write_text(lens + part("box", 8.0, (0.0, 0.0, -15.0)))
    Image.new("RGB", (16, 12)).save(tmp_path / "1x1.png")
    for line, status in (
        (f"plan {scene} --aperture 1,1 --depth d24 --mapping standard", 0),
        (f"verify {scene} {tmp_path}/{{i}}x{{j}}.png --apertures 1,1", 1),
        (f"conformance judge {tmp_path / 'none'} --case L0-behind --json", 1),
    ):
        assert "NVIDIA H100" in command(f"{line} --device {path} --quiet", status=status).out


NO_MODELS: tuple[dict[str, Any], ...] = (
    {"subpixel_bits": -3},  # corners would move by pixels, which would explain any error
    {"subpixel_bits": True},
    {"filter_bits": 25},
    {"d16": [math.nan, 0.5]},
    {"d16": [0.5, -0.5]},
    {"d24": [-0.5, 0.0, 0.5]},
)


@pytest.mark.parametrize("wrong", NO_MODELS, ids=str)
def test_a_file_that_is_no_model_is_refused_in_one_line(
    wrong: dict[str, Any], tmp_path: Path, command: Command
) -> None:
    path = tmp_path / "device.json"
    path.write_text(json.dumps({"model": H100.as_json()}))
    assert DeviceModel.read(path) == H100
    for content in ({"renderer": "x"}, {"model": H100.as_json() | wrong}):
        path.write_text(json.dumps(content))
        message = command(f"budget car --near 0.1 --device {path}", status=2).err
        assert "no device.json" in message and message.count("\n") == 1


def test_a_recording_that_fits_no_scene_is_refused(tmp_path: Path, command: Command) -> None:
    device = json.dumps({"renderer": "llvmpipe", "subpixel_bits": 8})
    strange: dict[str, Any] = {"car|0.01|d24|standard|40,30": np.full((4, 4), 10**6, np.int32)}
    for frames, words in (({}, "no frames"), (strange, "triangle 1000000")):
        np.savez(tmp_path / "frames.npz", device=device, **frames)
        line = f"device --replay {tmp_path}/frames.npz --quiet"
        assert words in command(line, status=2).err


@pytest.fixture
def card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Simulate a machine with a GPU that NVIDIA's kernel driver lists, but EGL does not."""
    listed = tmp_path / "gpus" / "0000:01:00.0"
    listed.mkdir(parents=True)
    (listed / "information").write_text("Model: \t\t NVIDIA H100 80GB HBM3\nIRQ: 1\n")
    monkeypatch.setattr(context, "NVIDIA_CARDS", tmp_path / "gpus")
    monkeypatch.setattr(context, "VENDOR_FOLDERS", (tmp_path / "etc", tmp_path / "share"))
    monkeypatch.setattr(context, "gpu_indices", lambda: ())
    monkeypatch.delenv(context.VENDORS_ASKED, raising=False)
    return tmp_path


def test_a_card_that_is_not_registered_with_egl_is_named_with_what_to_do(card: Path) -> None:
    message = context.overlooked_card()
    assert message and "NVIDIA H100 80GB HBM3" in message and "10_nvidia.json" in message
    vendor = card / "share" / "10_nvidia.json"
    vendor.parent.mkdir()
    vendor.write_text("{}")
    assert "libraries" in str(context.overlooked_card())


def test_a_variable_that_selects_software_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(context, "gpu_indices", lambda: (0,))
    for name in context.SOFTWARE_ASKED:
        monkeypatch.delenv(name, raising=False)
    assert context.overlooked_card() is None
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", "1")
    assert "LIBGL_ALWAYS_SOFTWARE" in str(context.overlooked_card())
