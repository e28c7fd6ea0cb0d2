"""OBJ, OFF, PLY, STL, 3MF and 3DXML of known shape: read so by both readers, or refused by both."""

from pathlib import Path

import numpy as np
import pytest

from tests.second_reader import archive_cases, text_cases
from tests.second_reader.compare import compare
from tests.second_reader.making import Case
from tests.second_reader.model import Floats
from tests.second_reader.polygons import cut, is_cut_of
from tests.second_reader.random_obj import random_obj
from tests.second_reader.testing import product_reads, second_reads

ALL = [*text_cases.cases(), *archive_cases.cases()]
CASES = pytest.mark.parametrize("case", ALL, ids=lambda case: case.name)


@pytest.mark.parametrize("outline", [text_cases.LETTER, text_cases.DART], ids=["letter", "dart"])
def test_fan_of_a_concave_polygon_is_no_cut(outline: Floats) -> None:
    polygon = text_cases.placed(outline, "oblique")
    fan = np.array([polygon[[0, k, k + 1]] for k in range(1, len(polygon) - 1)])
    assert not is_cut_of(fan, polygon)
    assert is_cut_of(np.array(cut(polygon)), polygon)


@CASES
def test_second_reader_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert second_reads(case, tmp_path) is None


@CASES
def test_product_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert product_reads(case, tmp_path) is None


def test_objs_of_random_layout(tmp_path: Path) -> None:
    differing = {}
    for seed in range(60):
        path = tmp_path / f"{seed}.obj"
        path.write_bytes(random_obj(seed))
        row = compare(path)
        if row.difference or row.second.refusal:
            differing[seed] = (row.difference, row.product.refusal, row.second.refusal)
    assert differing == {}
