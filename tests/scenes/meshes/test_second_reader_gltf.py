"""glTF files of known shape: the second reader and the product read that shape, or both refuse."""

from pathlib import Path

import pytest

from tests.second_reader.compare import compare
from tests.second_reader.gltf_cases import cases
from tests.second_reader.making import Case
from tests.second_reader.random_gltf import random_gltf
from tests.second_reader.testing import product_reads, second_reads

CASES = pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)


@CASES
def test_second_reader_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert second_reads(case, tmp_path) is None


@CASES
def test_product_reads_the_shape(case: Case, tmp_path: Path) -> None:
    assert product_reads(case, tmp_path) is None


@pytest.mark.parametrize("block", range(4))
def test_files_of_random_features(block: int, tmp_path: Path) -> None:
    differing = {}
    for seed in range(25 * block, 25 * block + 25):
        path = tmp_path / f"{seed}.glb"
        path.write_bytes(random_gltf(seed))
        row = compare(path)
        if row.difference:
            differing[seed] = (row.difference, row.product.refusal, row.second.refusal)
    assert differing == {}
