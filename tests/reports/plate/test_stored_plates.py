"""Stored plates: shards that Zarr and xarray read, measures, cameras; damage is refused."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from PIL import Image

from tests.conftest import CHECKOUT
from tests.reports.plate.test_plate_stream import (
    BLOCK,
    SETTINGS,
    disk_full_after,
    drawn,
    small,
    tree,
)
from tests.support.commands import Command
from tests.support.long_tail import thinned
from tests.support.views import view
from xfrustum import (
    InputError,
    PlateFiles,
    Rasterizer,
    Reference,
    camera_of,
    compare_images,
    convert,
)
from xfrustum.reports.plate.plate import blocks_of_apertures
from xfrustum.reports.plate.store import PlateReader
from xfrustum.reports.view import stored_plate
from xfrustum.scenes.appearance import Appearance, Sampling, Transport
from xfrustum.scenes.model.images import DRAWN_CHANNELS, Channel, ColorType, PlateContent
from xfrustum.scenes.shapes import smoothed

ALL = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plate with all channels, in blocks."""
    out = tmp_path_factory.mktemp("whole") / "p.zarr"
    return drawn(out, content=ALL, block=BLOCK).out


@pytest.fixture
def plate(whole: Path, tmp_path: Path) -> Path:
    """Return a copy that tests may damage."""
    return Path(shutil.copytree(whole, tmp_path / "p.zarr"))


def test_blocks_are_shards_of_the_rasterizers_images(whole: Path) -> None:
    scene, group = small(), xarray.open_zarr(whole, chunks=None)
    color: Any = zarr.open_group(whole, mode="r")["color"]
    assert (color.shards, color.chunks) == ((2, 3, 12, 20, 3), (1, 1, 12, 20, 3))
    with Rasterizer(scene) as rasterizer:
        for aperture in scene.plate.apertures():
            image = rasterizer.render(aperture, SETTINGS)
            for channel in ALL.channels:
                stored = group[channel].isel(row=aperture.row, column=aperture.column)
                np.testing.assert_array_equal(stored, getattr(image, channel))


def test_xarray_shows_names_coordinates_and_units(whole: Path) -> None:
    plate = xarray.open_zarr(whole)
    assert plate.color.dims == ("row", "column", "v", "u", "rgb") and plate.attrs["units"] == "mm"
    assert set(plate.coords) == {"row", "column", "x", "y", "u", "v"} and bool(plate.finished.all())
    width, height = small().frustum.resolution
    np.testing.assert_array_equal(plate.u, (2 * np.arange(width) + 1) / width - 1)
    np.testing.assert_array_equal(plate.v, 1 - (2 * np.arange(height) + 1) / height)


def test_the_camera_of_any_hogel_is_the_rasterizers(whole: Path) -> None:
    stores = (str(whole), zarr.open_group(whole, mode="r"), xarray.open_zarr(whole))
    with Rasterizer(small()) as rasterizer:
        drawn = rasterizer.render(small().plate.aperture(6, 4), SETTINGS, color=False).camera
    for camera in (camera_of(store, 6, 4) for store in stores):
        shear, extent = camera.shear, camera.half_extent
        assert camera == replace(drawn, renderer=camera.renderer, shear=shear, half_extent=extent)
        # The rasterizer computes its window by another formula, which differs in the last bit.
        window = (drawn.shear, drawn.half_extent)
        np.testing.assert_allclose((shear, extent), window, rtol=4 * 2**-53, atol=0)
    with pytest.raises(InputError, match="lies outside the plate"):
        camera_of(whole, 7, 0)


def test_a_folder_without_a_plate_has_neither_hogels_nor_cameras(tmp_path: Path) -> None:
    zarr.create_group(tmp_path / "other.zarr")
    attributes = {"xfrustum": {"plate": {"size": "x"}}}
    group = zarr.create_group(tmp_path / "damaged.zarr", attributes=attributes)
    for store in (tmp_path / "other.zarr", tmp_path / "nosuch.zarr"):
        for read in (PlateReader, lambda place: camera_of(place, 0, 0)):
            with pytest.raises(InputError, match="is no plate"):
                read(store)
    with pytest.raises(InputError, match="is damaged"):
        camera_of(group, 0, 0)


def test_a_plate_of_truths_is_certified(tmp_path: Path) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    content = PlateContent(color=ColorType.FLOAT32, channels=tuple(Channel))
    here = scene.plate.aperture(0, 4)
    assert drawn(out, [here], None, content=content).drawn == 1
    truth, reader = Reference(scene).trace(here), PlateReader(out)
    for channel in Channel:
        stored = reader.image(channel, *here.index)
        np.testing.assert_array_equal(stored, getattr(truth, channel).astype(stored.dtype))
    assert camera_of(out, 0, 4).settings is None
    with pytest.raises(InputError, match="certainty is the truth's alone"):
        drawn(tmp_path / "y.zarr", [here], content=content)
    with pytest.raises(InputError, match="leave out --truth"):
        drawn(tmp_path / "z.zarr", [here], None, judge=True)


def test_light_paths_are_in_the_truth(tmp_path: Path) -> None:
    scene = replace(small("crossing"), transport=Transport(shadows=True, samples=4))
    plate = PlateReader(drawn(tmp_path / "x.zarr", [scene.plate.middle], None, scene).out)
    transport = {"shadows": True, "interreflection": False, "samples": 4}
    assert plate.description["transport"] == transport and "settings" not in plate.description


# Measures beside the pixels, as arrays and as a table

SQUARE = (2, 2)
CHOSEN = [(3, 2), (0, 0), (1, 0), (6, 4)]


def judged(out: Path, chosen: list[tuple[int, int]] = CHOSEN, **more: Any) -> PlateFiles:
    apertures = [small().plate.aperture(*index) for index in chosen]
    return drawn(out, apertures, **{"block": SQUARE, "judge": True, **more})


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plate of four judged hogels in three blocks."""
    out = tmp_path_factory.mktemp("judged") / "x.zarr"
    assert judged(out).drawn == len(CHOSEN)
    return out


def test_the_measures_are_those_of_compare(measured: Path) -> None:
    opened, reference = xarray.open_zarr(measured, chunks=None), Reference(small())
    finite = np.argwhere(np.isfinite(opened.displacement_px_p99.values))
    assert {(column, row) for row, column in finite.tolist()} == set(CHOSEN)
    with Rasterizer(small()) as rasterizer:
        for index in CHOSEN:
            here = small().plate.aperture(*index)
            drawn, truth = rasterizer.render(here, SETTINGS), reference.trace(here)
            numbers = compare_images(truth, drawn, reference, radiance=False).numbers
            hogel = opened.isel(row=here.row, column=here.column)
            assert int(hogel.surface_wrong) == numbers.surface.wrong
            assert float(hogel.displacement_px_p99) == numbers.displacement_px.p99
            assert int(hogel.certainty_tie) == numbers.certainty["tie"]
            np.testing.assert_array_equal(hogel.color, drawn.color)
    units = opened.displacement_px_p99.attrs["units"], opened.height_rms.attrs["units"]
    assert units == ("px", "mm") and not any(str(n).startswith("radiance") for n in opened)


def test_measures_that_are_gone_or_damaged_are_made_again(measured: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(measured, tmp_path / "x.zarr"))
    (out / "surface_wrong/c/0/0").write_bytes(b"")
    (out / "height_rms/c/1/1").unlink()
    assert judged(out, check=True).drawn == 3
    assert tree(out) == tree(measured)


@pytest.mark.parametrize("written", thinned([1, 12], 2))
def test_a_run_that_ends_anywhere_goes_on_to_the_same_bytes(
    written: int, measured: Path, tmp_path: Path
) -> None:
    """The first run ends on a full disk, the second draws one hogel of a block of two."""
    out = tmp_path / "x.zarr"
    with disk_full_after(written, out):
        judged(out)
    judged(out, CHOSEN[2:3])
    files = judged(out)
    assert (files.drawn + files.present, files.damaged) == (len(CHOSEN), 0)
    assert tree(out) == tree(measured)


@pytest.mark.parametrize(
    ("name", "points"), thinned([("asymmetric-recentered", 3), ("mirror-sphere", 1)], 2)
)
def test_a_judged_plate_has_the_pixels_of_one_that_is_not(
    name: str, points: int, tmp_path: Path
) -> None:
    """One plate is drawn by hogel, the other in batches: all channels, light, sub-apertures."""
    scene = replace(small(name), sampling=Sampling(aperture=points))
    here, written = [scene.plate.aperture(0, 0)], []
    for judge in (False, True):
        out = tmp_path / f"{judge}.zarr"
        drawn(out, here, scene=scene, content=ALL, block=(1, 1), judge=judge)
        written.append({path: data for path, data in tree(out).items() if "/c/" in path})
    pixels, with_measures = written
    assert len(pixels) >= len(DRAWN_CHANNELS) and pixels.items() <= with_measures.items()


# Damage: no command reads a plate whose labels or descriptions contradict its scene.

Spoil = Callable[[Path], object]


def described(array: str, key: str, value: Any, *, group_too: bool) -> Spoil:
    """Change the description of an array in its file, and optionally in the group's copy."""

    def spoil(place: Path) -> None:
        own, group = place / array / "zarr.json", place / "zarr.json"
        own.write_text(json.dumps(json.loads(own.read_text()) | {key: value}))
        if group_too:
            facts = json.loads(group.read_text())
            facts["consolidated_metadata"]["metadata"][array][key] = value
            group.write_text(json.dumps(facts))

    return spoil


def moved(place: Path) -> None:
    array: Any = zarr.open_group(place)["v"]
    array[2] = array[2] + 1


SPOILED: dict[str, tuple[Spoil, str]] = {
    "no x": (lambda place: (place / "x/c/0").unlink(), "values of x are not the scene's"),
    "v moved": (moved, "1 of 12 values of v"),
    "fill": (described("triangle", "fill_value", 7, group_too=True), "fill value of triangle is 7"),
    "names": (
        described("color", "dimension_names", ["row", "column", "u", "v", "rgb"], group_too=False),
        "dimension names of color",
    ),
    "codec": (described("color", "codecs", [{"name": "x"}], group_too=False), "codecs|is damaged"),
    "shape": (described("y", "shape", [9], group_too=True), "shape of y"),
    "no flags": (lambda place: shutil.rmtree(place / "finished"), "finished"),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_every_reader_refuses_a_plate_that_contradicts_its_scene(
    kind: str, plate: Path, tmp_path: Path
) -> None:
    spoil, message = SPOILED[kind]
    spoil(plate)
    readers: list[Callable[[], object]] = [
        lambda: drawn(plate, content=ALL),
        lambda: stored_plate(plate, small()),
        lambda: convert(plate, tmp_path / "out", write_as="hogels"),
    ]
    for read in readers:
        with pytest.raises(InputError, match=message) as caught:
            read()
        assert "p.zarr" in str(caught.value) and "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_plate_of_other_lights_normals_or_colors_is_of_another_scene(plate: Path) -> None:
    scene = small()
    gray = [replace(o, vertex_colors=np.full(o.vertices.shape, 0.5)) for o in scene.objects]
    others = [replace(scene, appearance=Appearance(lights=()))]
    looks = (map(smoothed, scene.objects), gray)
    others += [replace(scene, objects=tuple(objects)) for objects in looks]
    stored_plate(plate, scene)
    for other in others:
        with pytest.raises(InputError, match="was drawn from another scene"):
            stored_plate(plate, other)


# The command, the size of a plate on disk, and its page


def test_a_plate_reports_its_size_and_stops_where_the_disk_is_smaller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    line = f"plate hard/only-behind --near 0.1 --ids --quiet --out {tmp_path}/p.zarr"
    needed = 25 * 64 * 64 * (3 * 2 + 4)  # hogels, pixels, float16 colors and 32-bit numbers
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=needed - 1))
    message = command(line, status=2).err
    assert "25 hogels to draw take at most 1000 KiB" in message and message.count("\n") == 1
    assert not list(tmp_path.iterdir())
    command(f"{line} --ignore-disk-space --apertures *,0-1")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=needed * 15 // 25))
    assert command(f"{line} --json").record["bytes_at_most"] == needed * 15 // 25


PAGE = (CHECKOUT / "docs" / "plates.md").read_text(encoding="utf-8")
DRAWN_COLUMNS = (0, 10, 20, 40)


@pytest.mark.slow
def test_the_programs_of_the_page_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page's plate, `row.zarr`, has few hogels of a small scene."""
    monkeypatch.chdir(tmp_path)
    scene = view("asymmetric", (16, 12))
    spans = [((column, column), (30, 30)) for column in DRAWN_COLUMNS]
    content = PlateContent(channels=(Channel.COLOR, Channel.HEIGHT))
    chosen = blocks_of_apertures(scene.plate, spans)
    drawn(Path("row.zarr"), chosen, scene=scene, content=content, judge=True)
    names: dict[str, object] = {}
    for program in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(compile(program, "docs/plates.md", "exec"), names)
    assert "worst hogel: " in capsys.readouterr().out
    mosaic = np.asarray(Image.open("mosaic.png")).reshape(12, 9, 16, 3)
    assert (10 * np.flatnonzero(mosaic.any(axis=(0, 2, 3)))).tolist() == list(DRAWN_COLUMNS)
