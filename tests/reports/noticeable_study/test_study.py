"""The study of viewers: what is written follows from the data, and no replay is made twice."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from xfrustum.cli.main import main
from xfrustum.compare.eye.limits import EYES_APART_MM, STEREO_ACUITY_ARCSEC
from xfrustum.compare.eye.noticeable import Display, replay_noise_arcsec, surface_content
from xfrustum.compare.scouting.sample import share_at_most
from xfrustum.reports.eye.replayed import ReplayWorkbench
from xfrustum.reports.noticeable_study import facts
from xfrustum.reports.noticeable_study.document import document
from xfrustum.reports.noticeable_study.figures import figures
from xfrustum.reports.noticeable_study.grid import FULL, PIXELS, QUICK
from xfrustum.reports.noticeable_study.rows import NoticedRow, decisive, read_parquet, starved_nears
from xfrustum.reports.noticeable_study.rule import kept, safe_near
from xfrustum.reports.noticeable_study.run import predicted_rows, to_replay
from xfrustum.reports.noticeable_study.study import DATA, DOCUMENT
from xfrustum.scenes import InputError, open_scene
from xfrustum.tolerances import MAX_DEPTH_WRONG

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.fixture(scope="module")
def rows() -> tuple[NoticedRow, ...]:
    return read_parquet(DOCS / DATA)[0]


def test_the_document_and_its_figures_follow_from_the_data_beside_them() -> None:
    rows, origin = read_parquet(DOCS / DATA)
    assert document(rows, origin, pictured=True) == (DOCS / DOCUMENT).read_text()
    for name, drawn in figures(rows).items():
        assert (DOCS / "images" / f"{name}.svg").read_text() == drawn
        assert f"images/{name}.svg" in (DOCS / DOCUMENT).read_text()


def test_the_data_are_those_of_the_whole_grid(rows: tuple[NoticedRow, ...]) -> None:
    cells = list(FULL.cells())
    assert [row.settings for row in rows] == [cell.settings for cell in cells]
    places = [(row.scene, row.pitch, row.distance) for row in rows]
    assert places == [(cell.scene, cell.pitch, cell.distance) for cell in cells]
    replayed = [row.replayed_points is not None for row in rows]
    decides = decisive(rows)
    assert replayed == [FULL.is_replayed_anyway(cell) or n in decides for n, cell in enumerate(cells)]


def test_at_the_limit_of_the_rule_two_eyes_tell_the_gap_from_none() -> None:
    near, distance = facts.rule_near(600.0), 600.0
    change = EYES_APART_MM / (distance - near) - EYES_APART_MM / (distance + near)
    assert math.degrees(change) * 3600 == pytest.approx(STEREO_ACUITY_ARCSEC, rel=1e-9)
    # The short form of the rule leaves out what is of second order in n.
    assert distance**2 / (1000 * facts.rule_metres()) == pytest.approx(near, rel=1e-3)


def test_below_the_rule_no_row_without_shear_is_noticed_and_the_page_says_no_more(
    rows: tuple[NoticedRow, ...],
) -> None:
    below = [r for r in rows if r.near <= safe_near(r.distance, r.nearest_distance)]
    plain = [row for row in below if not row.sheared]
    assert len(plain) > 500
    assert not any(row.offset_seen for row in plain)
    assert all((row.replayed_stereo_arcsec or 0.0) <= STEREO_ACUITY_ARCSEC for row in plain)
    assert kept(rows, sheared=False).holds
    # The limits between the rows keep it too, but for what is of second order: n/R, a share of 1e-3 here.
    sheared = {(row.scene, row.pivot) for row in rows if row.sheared}
    before = {(row.scene, row.distance): row.nearest_distance for row in rows}
    ratios: dict[bool, list[float]] = {True: [], False: []}
    for one in facts.thresholds(rows):
        for distance, near in one.stereo.items():
            limit = safe_near(distance, before[one.scene, distance])
            ratios[(one.scene, one.pivot) in sheared].append((near or 0.0) / limit)
    assert min(ratios[False]) > 1 - 1e-3
    assert min(ratios[True]) < 1
    text = (DOCS / DOCUMENT).read_text()
    assert "That is true up to a number: without shear" in text
    assert "**The exception is shear**" in text


def test_the_page_does_not_claim_a_rule_that_its_rows_refute(rows: tuple[NoticedRow, ...]) -> None:
    origin = read_parquet(DOCS / DATA)[1]
    index = next(n for n, row in enumerate(rows) if row.is_replayed and not row.sheared and row.near < 0.05)
    wrong = [*rows]
    wrong[index] = replace(rows[index], replayed_stereo_arcsec=2 * STEREO_ACUITY_ARCSEC)
    text = document(wrong, origin)
    assert "That is true up to a number" not in text
    assert "This study does not bear it out" in text


def test_one_pair_is_enough_only_where_a_replay_says_so(rows: tuple[NoticedRow, ...]) -> None:
    one = replace(rows[0], stereo_arcsec=1.0, crack_arcmin=None, ordered_separation=0.0)
    replayed = replace(one, near=0.3, replayed_pixels=5000, replayed_depth_wrong=0.0017)
    smaller = replace(one, near=0.1, replayed_pixels=None, replayed_depth_wrong=None)
    assert not smaller.noticed
    (found,) = facts.windows([replayed, smaller])
    assert (found.eye, found.eye_cases, found.replayed) == (0, 1, 1)
    assert starved_nears([replayed, smaller]) == {one.case: 0.3}
    right = replace(replayed, replayed_depth_wrong=0.0, replayed_stereo_arcsec=1.0)
    (found,) = facts.windows([right, smaller])
    assert (found.eye, found.certain) == (1, 1)
    (found,) = facts.windows([replace(right, replayed_stereo_arcsec=25.0), smaller])
    assert found.eye == 0
    # Of 1,152 pixels not even none that is wrong shows that no more than one in a thousand is.
    (found,) = facts.windows([replace(right, replayed_pixels=1152)])
    assert (found.eye, found.certain) == (1, 0)


def test_the_near_that_decides_is_replayed_for_every_seat_and_buffer(rows: tuple[NoticedRow, ...]) -> None:
    decides = [rows[index] for index in decisive(rows)]
    assert all(row.is_replayed for row in decides)
    assert {row.case for row in decides} == {row.case for row in rows}
    for found in facts.windows(rows):
        own = [row for row in decides if row.buffer == found.buffer]
        assert found.eye == sum(not row.noticed for row in own)
        assert found.replayed == found.eye_cases == len(own)


def test_pixels_of_hogels_know_nothing_of_pitch_and_distance(rows: tuple[NoticedRow, ...]) -> None:
    shown: dict[object, set[object]] = {(row.scene, row.pivot, row.near): set() for row in rows}
    for row in rows:
        shown[row.scene, row.pivot, row.near].add((row.pixels_worst, row.pixels_median, row.pixels_beyond))
    assert {len(values) for values in shown.values()} == {1}
    apart = facts.disagreement(rows)
    assert apart.hogel_cases == len(shown)
    pairs = apart.pixels_only + apart.eyes_only + apart.both + apart.neither
    assert pairs == apart.hogel_cases * apart.places
    assert apart.unseen_everywhere <= apart.unseen_somewhere <= apart.displaced


def test_films_have_as_many_pixels_as_one_wrong_among_them_needs() -> None:
    assert share_at_most(1, PIXELS) <= MAX_DEPTH_WRONG < share_at_most(1, PIXELS - 1)
    for size in ((80.0, 60.0), (30.0, 90.0), (400.0, 10.0)):
        columns = FULL.columns(size)
        assert 2 * columns * max(1, round(columns * size[1] / size[0])) >= PIXELS


def test_no_replay_is_off_by_more_than_its_noise(rows: tuple[NoticedRow, ...]) -> None:
    scenes = {row.scene: open_scene(row.scene) for row in rows}
    contents = {name: surface_content(scene) for name, scene in scenes.items()}
    count = 0
    for row in rows:
        if row.replayed_stereo_arcsec is None:
            continue
        scene = scenes[row.scene]
        hogels = (round(scene.plate.size[0] / row.pitch), round(scene.plate.size[1] / row.pitch))
        display = Display.of(replace(scene, plate=replace(scene.plate, hogels=hogels)))
        pixel = scene.plate.size[0] / FULL.columns(scene.plate.size)
        noise = replay_noise_arcsec(contents[row.scene], row.viewer, display, row.settings, pixel)
        # The closed form has the ends of all that is seen: a replay that sees less changes less.
        assert row.replayed_stereo_arcsec <= row.stereo_arcsec + noise
        count += 1
    assert count > 200


def test_a_threshold_lies_where_a_power_law_reaches_its_limit(rows: tuple[NoticedRow, ...]) -> None:
    one = rows[0]
    line = [replace(one, near=near, stereo_arcsec=3.0 * near**2) for near in (0.1, 1.0, 10.0)]
    found = facts.largest_near(line, lambda row: row.stereo_arcsec, lambda row: 27.0)
    assert found == pytest.approx(3.0, rel=1e-12)
    assert facts.largest_near(line, lambda row: row.stereo_arcsec, lambda row: 0.01) is None
    assert facts.largest_near(line, lambda row: row.stereo_arcsec, lambda row: 1e9) == math.inf
    # Beyond the last row that is known nothing is promised.
    assert facts.largest_near(line, lambda row: None if row.near > 1 else 0.5, lambda row: 1.0) == 1.0


def test_no_eye_of_a_replay_disagrees_with_the_closed_form_on_what_is_noticed(
    rows: tuple[NoticedRow, ...],
) -> None:
    replayed = [row for row in rows if row.replayed_stereo_arcsec is not None]
    assert len(replayed) > 70
    assert {row.stereo_seen for row in replayed} == {True, False}
    for row in replayed:
        assert ((row.replayed_stereo_arcsec or 0.0) > STEREO_ACUITY_ARCSEC) == row.stereo_seen


def test_a_grid_without_nears_is_refused() -> None:
    with pytest.raises(InputError, match="nothing to study"):
        replace(FULL, nears=())


def written(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*.*") if path.suffix != ".sqlite"}


@pytest.mark.slow
def test_a_study_that_was_stopped_replays_nothing_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["study", "noticeable", "--quick", "--json", "--quiet", "--out", str(tmp_path)]
    assert main(arguments) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["cells"] == len(list(QUICK.cells()))
    cells = list(QUICK.cells())
    assert told["replays"] == len(to_replay(QUICK, cells, predicted_rows(cells)))
    before = written(tmp_path)
    assert {DOCUMENT, DATA} <= set(before)

    def never(*arguments: object) -> None:
        raise AssertionError("replayed again")

    monkeypatch.setattr(ReplayWorkbench, "measure", never)
    assert main(arguments) == 0
    assert before == written(tmp_path)
