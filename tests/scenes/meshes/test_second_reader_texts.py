"""OBJ, OFF, PLY, STL, 3MF and 3DXML of known shape: both readers read that shape, or both refuse."""

from pathlib import Path

import pytest

from tests.second_reader import archive_cases, text_cases
from tests.second_reader.making import Case
from tests.second_reader.testing import product_reads, second_reads

ALL = [*text_cases.cases(), *archive_cases.cases()]
CASES = pytest.mark.parametrize("case", ALL, ids=lambda case: case.name)


@CASES
def test_second_reader_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert second_reads(case, tmp_path) is None


@CASES
def test_product_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert product_reads(case, tmp_path) is None
