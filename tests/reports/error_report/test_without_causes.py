"""Reports without causes: the same pictures and numbers, nothing made that causes alone need, and said so."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.reports.error_report.test_reports import page_data, small
from xfrustum.cli.main import main
from xfrustum.compare import run
from xfrustum.compare.prediction.chain import EXACT_DEPTH
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.error_report.report import ReportFiles, make_report
from xfrustum.reports.error_report.settings import ReportOptions
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, InputError, Pivot

NEARS = (10.0, 0.1)
DEPTHS = ((DepthFormat.D16, DepthMapping.STANDARD), (DepthFormat.D24, DepthMapping.REVERSED))


def made(folder: Path, *, causes: bool) -> ReportFiles:
    scene = small("asymmetric-recentered", (48, 36))
    return make_report(
        scene,
        folder,
        ReportOptions(
            nears=NEARS,
            depths=DEPTHS,
            apertures=[scene.plate.aperture(3, 4)],
            pivots=[Pivot.APERTURE],
            causes=causes,
        ),
    )


@pytest.fixture(scope="module")
def charged(tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    return made(tmp_path_factory.mktemp("charged"), causes=True)


@pytest.fixture(scope="module")
def drawn() -> list[tuple[DepthFormat, DepthMapping]]:
    """Depth buffers of all frames that the report without causes has drawn, filled as it is made."""
    return []


@pytest.fixture(scope="module")
def plain(
    tmp_path_factory: pytest.TempPathFactory, drawn: list[tuple[DepthFormat, DepthMapping]]
) -> Iterator[ReportFiles]:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("causes alone need this")

    draw = Rasterizer.draw

    def noted(self: Rasterizer, aperture: Any, settings: DoubleFrustum, **how: Any) -> Any:
        drawn.append((settings.depth, settings.mapping))
        return draw(self, aperture, settings, **how)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(run, "ChainStart", refuse)
        patched.setattr(run, "Predictor", refuse)
        patched.setattr(Reference, "trace_model", refuse)
        patched.setattr(Reference, "gaps", refuse)
        patched.setattr(Rasterizer, "draw", noted)
        yield made(tmp_path_factory.mktemp("plain"), causes=False)


def test_what_is_measured_is_the_same_bit_for_bit(charged: ReportFiles, plain: ReportFiles) -> None:
    for key in ("settings", "aperture", "comparison"):
        rows, others = ([row[key] for row in one.content["rows"]] for one in (charged, plain))
        assert rows == others
    best, other = charged.content["best"], plain.content["best"]
    assert {**best, "sentence": ""} == {**other, "sentence": ""}
    shown, without = ([row["pictures"] for row in page_data(one.html)["rows"]] for one in (charged, plain))
    assert without == [{name: key for name, key in one.items() if name != "causes"} for one in shown]


def test_nothing_is_drawn_that_causes_alone_need(
    plain: ReportFiles, drawn: list[tuple[DepthFormat, DepthMapping]]
) -> None:
    assert len(plain.content["rows"]) == len(NEARS) * len(DEPTHS)
    assert EXACT_DEPTH not in drawn and set(drawn) == set(DEPTHS)


def test_json_says_what_was_left_out_and_has_no_numbers_of_it(
    charged: ReportFiles, plain: ReportFiles
) -> None:
    assert charged.content["left_out"] == []
    assert plain.content["left_out"] == ["causes", "predictions", "frames with exact depth", "traced models"]
    for row in plain.content["rows"]:
        assert row["causes"] == []
        for key in ("unexplained", "shear", "predicted_displacement_px", "predicted_surface"):
            assert row[key] is None
        assert set(row["measured_over_predicted"].values()) == {None}
        assert row["times_s"]["causes"] == row["times_s"]["predict"] == 0
    assert plain.content["times_s"]["causes"] == plain.content["times_s"]["predict"] == 0
    assert set(plain.content) == set(charged.content)


def test_the_table_has_the_same_columns_and_they_are_null(charged: ReportFiles, plain: ReportFiles) -> None:
    whole, table = (pq.read_table(one.parquet) for one in (charged, plain))
    assert table.schema == whole.schema
    empty = [name for name in table.column_names if table[name].null_count == len(table)]
    assert {"cause_depth_surface", "unexplained", "predicted_surface_fraction"} <= set(empty)
    assert not {"surface_wrong", "displacement_px_p99"} & set(empty)


def test_the_page_says_what_was_left_out_and_has_no_part_about_it(
    charged: ReportFiles, plain: ReportFiles
) -> None:
    whole, page = (one.html.read_text() for one in (charged, plain))
    assert "Left out, as asked for: causes, predictions" in page and "Left out, as" not in whole
    for part in ('id="plot-causes"', 'id="predictions"', 'id="causes"', "Dashed lines are closed forms"):
        assert part in whole and part not in page
    data = page_data(plain.html)
    assert "causes" not in data["curves"][0][0]
    named = [trace.get("name") for trace in data["curves"][0][0]["surface"]["data"]]
    assert "closed form" not in named and len(named) == len(DEPTHS)
    assert any(note.startswith("Left out") for note in plain.notes)


@pytest.mark.parametrize(("options", "asked"), [([], True), (["--no-causes"], False)])
def test_the_command_says_whether_there_are_causes(
    options: list[str], asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []

    def note(_scene: object, _out: object, options: ReportOptions) -> None:
        told.append(options.causes)
        raise InputError("seen")

    monkeypatch.setattr("xfrustum.reports.error_report.report.make_report", note)
    assert main(["report", "car", *options]) == 2
    assert told == [asked]
