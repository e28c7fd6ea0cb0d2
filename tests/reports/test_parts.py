"""Parts of rows: whole as they were written, or made again."""

import os
import random
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from xfrustum.reports.parts import Parts, differences_words
from xfrustum.scenes import InputError

ROWS = pa.table({"column": [1, 2, 3], "value": [0.5, None, 1.5], "word": ["a", None, "c"]})


@pytest.fixture
def parts(tmp_path: Path) -> Parts:
    parts = Parts(out=tmp_path, name="rows.parquet")
    parts.open({"scene": "a", "near": 1})
    parts.write(0, ROWS)
    return parts


def test_a_part_is_read_as_it_was_written_by_us_and_by_others(parts: Parts) -> None:
    assert parts.finished(0) and not parts.finished(1) and not parts.damaged(1)
    assert parts.read(0).equals(ROWS)
    assert pq.read_table(parts.folder).equals(ROWS)


def test_every_flipped_bit_of_a_part_is_noticed(parts: Parts) -> None:
    path = parts.path(0)
    whole = path.read_bytes()
    for bit in random.Random(0).sample(range(8 * len(whole)), 400):
        content = bytearray(whole)
        content[bit // 8] ^= 1 << bit % 8
        path.write_bytes(content)
        assert parts.damaged(0), bit
    with pytest.raises(InputError, match="is missing or damaged; repeat the command"):
        parts.read(0)
    parts.write(0, ROWS)
    assert path.read_bytes() == whole


def test_parts_without_a_digest_and_what_is_no_file_are_damaged_and_replaced(parts: Parts) -> None:
    path = parts.path(0)
    pq.write_table(ROWS, path)
    assert parts.damaged(0)
    path.unlink()
    os.mkfifo(path)
    assert parts.damaged(0)
    parts.write(0, ROWS)
    assert parts.read(0).equals(ROWS)


def test_a_folder_is_continued_with_the_same_work_alone(parts: Parts, tmp_path: Path) -> None:
    parts.open({"scene": "a", "near": 1})
    with pytest.raises(InputError, match=r"begun with another near \(near was 1, now 2\);"):
        parts.open({"scene": "a", "near": 2})
    description = parts.folder / "_description.json"
    description.unlink()
    os.mkfifo(description)
    with pytest.raises(InputError, match="begun with another description"):
        parts.open({"scene": "a", "near": 1})
    (tmp_path / "empty").mkdir()
    Parts(out=tmp_path, name="empty").open({})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "rows.parquet").touch()
    with pytest.raises(InputError, match="was not begun by this command"):
        Parts(out=tmp_path, name="mine").open({})


def test_differences_tell_short_values_and_no_hashes() -> None:
    found = {"settings": [{"near": 0.1, "depth": "d24"}], "scene": {"content": "a" * 64}, "hogels": [1, 2]}
    wanted = {"settings": [{"near": 0.2, "depth": "d24"}], "scene": {"content": "b" * 64}, "hogels": [1, 2]}
    assert differences_words(found, wanted) == "other settings (near was 0.1, now 0.2) and another scene"
    assert differences_words(None, wanted) == "another description"
    told = 'other content (judged was false, now true; channels was ["color"], now ["color", "height"])'
    one, other = (
        {"judged": on, "channels": names} for on, names in ((False, ["color"]), (True, ["color", "height"]))
    )
    assert differences_words({"content": one}, {"content": other, "tracer": None}) == told
    told = differences_words({"state of the images": "a" * 64}, {"state of the images": "b" * 64})
    assert told == "another state of the images"
