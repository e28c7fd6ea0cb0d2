"""Reports without causes: the same pictures and numbers, nothing made that causes alone need, and said so."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.reports.error_report.test_reports import page_data, small
from xfrustum.compare import run
from xfrustum.compare.prediction.chain import EXACT_DEPTH
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.error_report.best import ReportOptions
from xfrustum.reports.error_report.report import ReportFiles, make_report
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, Pivot

NEARS = (10.0, 0.1)
DEPTHS = ((DepthFormat.D16, DepthMapping.STANDARD), (DepthFormat.D24, DepthMapping.REVERSED))


def made(folder: Path, *, causes: bool) -> ReportFiles:
    scene = small("asymmetric-recentered", (48, 36))
    where = ReportOptions(apertures=[scene.plate.aperture(3, 4)], pivots=[Pivot.APERTURE])
    return make_report(scene, folder, replace(where, nears=NEARS, depths=DEPTHS, causes=causes))


@pytest.fixture(scope="module")
def charged(tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    return made(tmp_path_factory.mktemp("charged"), causes=True)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ReportFiles]:
    """A report without causes, made where nothing works that causes alone need."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("causes alone need this")

    draw, drawn = Rasterizer.draw, set()

    def noted(self: Rasterizer, aperture: Any, settings: DoubleFrustum, **how: Any) -> Any:
        drawn.add((settings.depth, settings.mapping))
        return draw(self, aperture, settings, **how)

    with pytest.MonkeyPatch.context() as patched:
        for name in ("ChainStart", "Predictor"):
            patched.setattr(run, name, type(name, (), {"__init__": refuse}))
        patched.setattr(Reference, "trace_model", refuse)
        patched.setattr(Reference, "gaps", refuse)
        patched.setattr(Rasterizer, "draw", noted)
        yield made(tmp_path_factory.mktemp("plain"), causes=False)
    assert EXACT_DEPTH not in drawn and drawn == set(DEPTHS)


def test_what_is_measured_is_the_same_bit_for_bit(charged: ReportFiles, plain: ReportFiles) -> None:
    assert len(plain.content["rows"]) == len(NEARS) * len(DEPTHS)
    for key in ("settings", "aperture", "comparison"):
        rows, others = ([row[key] for row in one.content["rows"]] for one in (charged, plain))
        assert rows == others
    best, other = charged.content["best"], plain.content["best"]
    assert {**best, "sentence": ""} == {**other, "sentence": ""}
    shown, without = ([row["pictures"] for row in page_data(one.html)["rows"]] for one in (charged, plain))
    assert without == [{name: key for name, key in one.items() if name != "causes"} for one in shown]


def test_json_and_table_say_what_was_left_out_and_have_no_numbers_of_it(
    charged: ReportFiles, plain: ReportFiles
) -> None:
    assert charged.content["left_out"] == [] and set(plain.content) == set(charged.content)
    assert plain.content["left_out"] == ["causes", "predictions", "frames with exact depth", "traced models"]
    for row in plain.content["rows"]:
        assert row["causes"] == [] and set(row["measured_over_predicted"].values()) == {None}
        for key in ("unexplained", "shear", "predicted_displacement_px", "predicted_surface"):
            assert row[key] is None
    for times in (plain.content["times_s"], *(row["times_s"] for row in plain.content["rows"])):
        assert times["causes"] == times["predict"] == 0
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
    ((curves,),) = page_data(plain.html)["curves"]
    assert "causes" not in curves and len(curves["surface"]["data"]) == len(DEPTHS)
    assert any(note.startswith("Left out") for note in plain.notes)
