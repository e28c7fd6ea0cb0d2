"""The cameras that drew a plate by direction explain its wrong pixels."""

import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from tests.support.views import soup, view
from xfrustum import DepthFormat, InputError, PlateOptions, Reference, Scene, verify
from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.judging.judged import Judging, judge
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.rounding.causes import HEADINGS
from xfrustum.reports.plate.directions import write_directions
from xfrustum.reports.plate.store import direction_plate
from xfrustum.reports.verification.sources import StoredPlate
from xfrustum.reports.verification.words import defect_words
from xfrustum.scenes import NOTHING, Frustum, Plate, Screen
from xfrustum.scenes.model.images import Channel, PlateContent
from xfrustum.scenes.plate import PlateTile

#: Hogels in all tiles; tiles meet between rows 2 and 3, and rows 5 and 6
EVERY = [(column, row) for row in range(7) for column in range(9)]
SOME = [(4, 2), (4, 3), (8, 3), (2, 6)]
D16, D24, D32F = DepthFormat
BEHIND = "asymmetric before a screen"


def small(name: str) -> Scene:
    scene = view("asymmetric-recentered" if name == BEHIND else name, (14, 10))
    if name == BEHIND:
        screen = Screen(height=-160.0, center=(9.0, -6.0), size=(200.0, 170.0))
        scene = replace(scene, frustum=replace(scene.frustum, screen=screen))
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(9, 7)))


def drawn(scene: Scene, out: Path, depth: DepthFormat, tiles: int = 3) -> Path:
    """Draw a plate in tiles of a few rows."""
    options = PlateOptions(content=PlateContent(channels=(Channel.TRIANGLE,)), block=(4, 3))
    assert write_directions(scene, depth, out, options, memory=20_000).tiles == tiles
    return out


def causes(scene: Scene, plate: Path, hogels: list[tuple[int, int]]) -> Counter[str]:
    """Return numbers of wrong pixels by cause, of all wrong pixels, and of shown pixels."""
    reference, counts = Reference(scene), Counter[str]()
    source = StoredPlate(place=plate, stated=False, reference=reference)
    judging = Judging(directions=source.directions)
    for index in hogels:
        image = source.image(scene.plate.aperture(*index))
        points = image.position.astype(np.float64)
        numbers = judge(reference, RendererModel(), image, points, judging, explained=True).numbers
        counts.update(numbers.causes, wrong=numbers.wrong, shown=numbers.shown)
    return counts


@pytest.mark.parametrize(
    ("name", "depth"),
    [
        ("asymmetric", D16),
        ("asymmetric-recentered", D32F),
        pytest.param(BEHIND, D24, marks=pytest.mark.slow),
    ],
)
def test_every_wrong_pixel_is_explained(name: str, depth: DepthFormat, tmp_path: Path) -> None:
    scene = small(name)
    counts = causes(scene, drawn(scene, tmp_path / "x.zarr", depth), EVERY)
    assert counts["wrong"] == sum(counts[name] for name in HEADINGS) > 0
    assert counts["unexplained"] == 0


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn(small("asymmetric"), tmp_path_factory.mktemp("plate") / "x.zarr", D24)


def test_no_rounding_explains_hogels_one_column_off_whatever_the_batches(
    plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Path(shutil.copytree(plate, tmp_path / "x.zarr"))
    array: Any = zarr.open_group(other, mode="r+")["triangle"]
    array[:] = np.roll(array[:], 1, axis=1)
    together = causes(small("asymmetric"), other, SOME[:2])
    monkeypatch.setattr("xfrustum.compare.rounding.causes.PIXELS_AT_ONCE", 1)
    assert causes(small("asymmetric"), other, SOME[:2]) == together
    assert together["edge"] > 10 and together["unexplained"] > 50


def test_the_depth_buffer_is_taken_from_the_description(tmp_path: Path) -> None:
    """Two sheets are a fifth of a 16-bit step apart: the farther one, drawn first, remains."""
    step = 128.0 / 2**16
    corners = [(x, y, 40.0) for y in (-30.0, 30.0) for x in (-30.0, 30.0)]
    sheet = np.array([[corners[n] for n in (0, 1, 3)], [corners[n] for n in (0, 3, 2)]])
    frustum = Frustum(resolution=(4, 2), reach=(80.0, 48.0), fov=(1.0, 1.0))
    scene = soup(np.concatenate((sheet - [0.0, 0.0, step / 5], sheet)), frustum)
    scene = replace(scene, plate=Plate(size=(16.0, 16.0), hogels=(4, 4)))
    plate = drawn(scene, tmp_path / "x.zarr", D16, tiles=1)
    file, hogels = plate / "zarr.json", [(0, 0), (2, 3)]
    described = json.loads(file.read_text())
    for depth, cause in (("d16", "order"), ("d32f", "unexplained")):
        described["attributes"]["xfrustum"]["directions"]["depth"] = depth
        file.write_text(json.dumps(described))
        counts = causes(scene, plate, hogels)
        assert counts["wrong"] == counts["shown"] == 16 and counts[cause] >= 12


def test_an_interval_from_zero_is_no_evidence_of_an_offset() -> None:
    near = Defect(fault="near", value=2.5e-3, low=0.0, high=5e-3, unit="mm", stated=0.1)
    words = defect_words(near, small("asymmetric"))
    assert words == "both cameras step back by at most 0.005 mm, or not at all, not by 0.1"


def test_damaged_neighbors_show_nothing(plate: Path, tmp_path: Path) -> None:
    """Files of columns 4 to 7 are damaged; they contain the right neighbors of column 3."""
    other = Path(shutil.copytree(plate, tmp_path / "x.zarr"))
    for file in (other / "triangle/c/0/1").rglob("*"):
        if file.is_file():
            file.write_bytes(b"")
    stored = direction_plate(other)
    assert stored is not None
    tile = PlateTile(plate=small("asymmetric").plate, columns=range(3, 5), rows=range(2))
    np.testing.assert_array_equal(stored.shown(tile, (5, 5)), NOTHING)
    counts = causes(small("asymmetric"), other, [(3, row) for row in range(3)])
    assert counts["wrong"] == sum(counts[name] for name in HEADINGS)


def test_such_plates_are_verified(plate: Path) -> None:
    scene = small("asymmetric")
    result = verify(scene, str(plate), apertures=SOME, max_wrong=0.2)
    numbers = result.as_found
    assert numbers is not None and numbers.causes is not None
    assert result.passed and not result.diagnosis.faults
    assert numbers.causes["unexplained"] == 0 < numbers.wrong
    with pytest.raises(InputError, match="drawn by directions, without a near offset; leave out"):
        verify(scene, str(plate), near=0.1)
