"""glTF files of known shape: the second reader and the product read that shape, or both refuse."""

from pathlib import Path

import pytest

from tests.second_reader.gltf_cases import cases
from tests.second_reader.making import Case
from tests.second_reader.testing import product_reads, second_reads

CASES = pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)


@CASES
def test_second_reader_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert second_reads(case, tmp_path) is None


@CASES
def test_product_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert product_reads(case, tmp_path) is None
