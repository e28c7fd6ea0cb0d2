"""The study's document: written again from its data alone, and a short answer that its rows give."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from tests.conftest import CHECKOUT
from xfrustum.reports.splitting_study.document import document
from xfrustum.reports.splitting_study.facts import buffer_facts
from xfrustum.reports.splitting_study.grid import Family
from xfrustum.reports.splitting_study.rows import StudyRow, read_parquet
from xfrustum.reports.splitting_study.study import DATA, DOCUMENT, rewrite_document
from xfrustum.reports.studies.origin import Origin
from xfrustum.scenes import DepthFormat, DepthMapping

PUBLISHED = CHECKOUT / "docs"


@pytest.fixture(scope="module")
def published() -> tuple[tuple[StudyRow, ...], Origin]:
    return read_parquet(PUBLISHED / DATA)


def test_the_data_alone_give_the_document_again(tmp_path: Path) -> None:
    shutil.copy(PUBLISHED / DATA, tmp_path)
    written = rewrite_document(tmp_path)
    assert written.read_bytes() == (PUBLISHED / DOCUMENT).read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [DOCUMENT, DATA]


def in_short(rows: Sequence[StudyRow], origin: Origin) -> str:
    """Return the section that answers the title, on one line."""
    text = document(rows, origin)
    return " ".join(text.split("## In short")[1].split("\n## ")[0].split())


def test_the_short_answer_is_counted_in_the_rows(published: tuple[tuple[StudyRow, ...], Origin]) -> None:
    """Without what was measured of a scene or depth buffer, nothing is said about it."""
    rows, origin = published
    one_side = [row for row in rows if row.family is Family.ONE_SIDE]
    facts = {one.buffer: one for one in buffer_facts(one_side)}
    standard = facts[DepthFormat.D24, DepthMapping.STANDARD]
    assert standard.largest_product is not None and standard.one_pair < standard.cases
    never = [one.name for one in facts.values() if one.always_enough]
    said = in_short(rows, origin)
    assert f"With {', '.join(never[:-1])} and {never[-1]} one pair of frusta was enough" in said
    assert "pivot `camera`" in said and "through the plate" in said and "both sides" in said

    reversed_alone = [row for row in one_side if row.buffer == (DepthFormat.D32F, DepthMapping.REVERSED)]
    fewer = in_short(reversed_alone, origin)
    assert "With D32F reversed one pair of frusta was enough in all 24 cases" in fewer
    for absent in ("D24 standard", "pivot `camera`", "through the plate", "both sides"):
        assert absent not in fewer
    starved = [replace(row, misordered=1.0) for row in reversed_alone]
    assert "Never" not in in_short(starved, origin)
