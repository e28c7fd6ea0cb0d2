"""Inspection pages hold the channels of the OpenEXR files, bit for bit, in files of bounded size."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.reports.inspection.conftest import Inspected
from xfrustum import open_scene
from xfrustum.reports import inspection as inspection_page
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.inspection import (
    PAGE,
    InspectedHogel,
    Inspection,
    PlateMap,
    read_inspection,
    replacing_inspection,
    write_inspection,
)
from xfrustum.reports.scout import MAX_MAP_CELLS
from xfrustum.scenes import Scene
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Plate

SURFACES, COLOR, NORMALS = (
    {"id.triangle", "id.object", "P.X", "P.Y", "P.Z"},
    set("RGB"),
    {"N.X", "N.Y", "N.Z"},
)
COMMANDS = {
    "report": SURFACES | COLOR | NORMALS,
    # What verify is asked for is a surface, not its color; what it reads of an image is not its
    # normals.
    "verify": SURFACES,
    "survey": SURFACES | COLOR | NORMALS,
}
"""Channels that truth and image must both have."""


def hogels(inspected: Inspected, command: str) -> list[InspectedHogel]:
    return read_inspection(inspected.pages[command] / PAGE)


def inspection(scene: Scene, shown: list[InspectedHogel]) -> Inspection:
    """Return what a page shows of hogels of a plate of which nothing else is known."""
    nothing = PlateMap.from_values(scene.plate, "nothing", [])
    return Inspection(command="verify", scene=scene, told="", hogels=shown, plate_map=nothing)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_page_holds_the_bits_of_the_files(inspected: Inspected, command: str) -> None:
    found = hogels(inspected, command)
    assert sorted(hogel.aperture for hogel in found) == [(0, 0), (1, 0)]
    for hogel in found:
        values = hogel.values()
        assert COMMANDS[command] | NORMALS | {"certainty"} <= values["truth"].keys()
        assert COMMANDS[command] <= values["image"].keys()
        for layer in ("truth", "image"):
            stored = inspected.exr(hogel.aperture, layer)
            for name, channel in values[layer].items():
                assert channel.dtype == stored[name].dtype, (layer, name)
                assert channel.tobytes() == stored[name].tobytes(), (layer, name)


@pytest.mark.parametrize("command", COMMANDS)
def test_errors_are_those_of_the_two_images(inspected: Inspected, command: str) -> None:
    for hogel in hogels(inspected, command):
        values = hogel.values()
        truth, image, error = values["truth"], values["image"], values["error"]
        labels = {
            one.name: np.array(one.labels) for layer in hogel.layers for one in layer.channels
        }
        state = labels["state"][error["state"]]
        wrong = np.char.startswith(state, "wrong")
        assert 0 < wrong.sum() < wrong.size
        other = truth["id.triangle"] != image["id.triangle"]
        tie = labels["certainty"][truth["certainty"]] == "tie, not judged"
        assert not (other & (state == "right") & ~tie).any() or command == "verify"
        assert (np.char.startswith(state, "tie") == tie).all()
        assert (
            np.isfinite(error["displacement.X"]) == (image["P.Z"] != 0) & (image["id.triangle"] > 0)
        ).all()
        if command != "verify":
            assert ((labels["cause"][error["cause"]] == "none") == ~wrong).all()


def test_a_page_that_would_be_too_large_leaves_hogels_in_files_beside_it(
    inspected: Inspected, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = hogels(inspected, "verify")
    shown = inspection(open_scene(inspected.scene), whole)
    write_inspection(tmp_path, shown)
    size = (tmp_path / PAGE).stat().st_size
    assert [path.name for path in tmp_path.iterdir()] == [PAGE]
    bound = size - len(whole[-1].stream)
    monkeypatch.setattr(inspection_page, "MAX_PAGE_BYTES", bound)
    write_inspection(tmp_path, shown)
    beside = [path for path in tmp_path.iterdir() if path.name != PAGE]
    assert len(beside) == 1
    assert (tmp_path / PAGE).stat().st_size <= bound
    assert [one.stream for one in read_inspection(tmp_path / PAGE)] == [one.stream for one in whole]
    beside[0].write_text('takeStream("0123","AAAA");\n')
    with pytest.raises(InputError, match="no inspection page"):
        read_inspection(tmp_path / PAGE)
    beside[0].unlink()
    with pytest.raises(InputError, match="cannot be read"):
        read_inspection(tmp_path / PAGE)


def test_a_later_page_in_a_folder_removes_what_belonged_to_the_earlier_one_and_nothing_else(
    inspected: Inspected, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, whole = open_scene(inspected.scene), hogels(inspected, "verify")

    def run(shown: list[InspectedHogel]) -> None:
        with Staging(tmp_path) as staging:
            write_inspection(staging.folder, inspection(scene, shown))
            with replacing_inspection(tmp_path):
                staging.commit()

    with monkeypatch.context() as small:
        small.setattr(inspection_page, "MAX_PAGE_BYTES", 0)
        run([*whole, replace(whole[0], aperture=(7, 7))])
        beside = {f"inspect-{i}x{j}.js" for i, j in [(0, 0), (1, 0), (7, 7)]}
        assert {path.name for path in tmp_path.iterdir()} == {PAGE, *beside}
        # A file that no page has named, and one that is no more what the page says of it.
        (tmp_path / "inspect-9x9.js").write_text("mine")
        (tmp_path / "inspect-7x7.js").write_text("mine")
        run(whole[:1])
        (name,) = {"inspect-{}x{}.js".format(*one.aperture) for one in whole[:1]}
        kept = {PAGE, name, "inspect-7x7.js", "inspect-9x9.js"}
        assert {path.name for path in tmp_path.iterdir()} == kept
    run(whole)
    assert {path.name for path in tmp_path.iterdir()} == {PAGE, "inspect-7x7.js", "inspect-9x9.js"}
    assert len(read_inspection(tmp_path / PAGE)) == len(whole)


def test_a_page_knows_files_beside_it_by_a_word_that_its_texts_cannot_know(
    inspected: Inspected,
) -> None:
    page = (inspected.pages["report"] / PAGE).read_text()
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    (nonce,) = re.findall(r"'nonce-([^']+)'", policy[1])
    assert page.count(nonce) == 2, "in the policy, and in the data of our own script"
    assert "unsafe" not in policy[1].split(";")[1]


def test_hogels_with_too_many_pixels_are_listed_without_values(
    inspected: Inspected, tmp_path: Path
) -> None:
    (hogel, *_) = hogels(inspected, "report")
    scene = open_scene(inspected.scene)
    write_inspection(tmp_path, inspection(scene, [replace(hogel, stream=b"")]))
    (found,) = read_inspection(tmp_path / PAGE)
    assert found.values() == {} and found.words == hogel.words


def test_a_cell_of_a_large_plate_shows_the_worst_of_its_hogels() -> None:
    plate = Plate(size=(100.0, 50.0), hogels=(10 * MAX_MAP_CELLS, 60))
    cells = PlateMap.from_values(
        plate, "share", [(0, 0, 0.1), (9, 0, 0.3), (10, 0, 0.2), (1199, 59, 0.0)]
    ).cells
    assert cells.shape == (60, MAX_MAP_CELLS)
    assert cells[0, 0] == 0.3 and cells[0, 1] == 0.2 and cells[59, -1] == 0.0
    assert np.isnan(cells).sum() == cells.size - 3
