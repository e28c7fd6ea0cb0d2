"""Videos: a decoder gives what the layout needs and no more, whatever the file holds or declares."""

from pathlib import Path

import numpy as np
import pytest

from xfrustum.scenes import InputError
from xfrustum.scenes.disk.input_files import input_memory
from xfrustum.scenes.files.pictures import read_video, video_size, write_video
from xfrustum.scenes.files.plate_files import find_files

pytest.importorskip("av", reason="needs the package av, the optional part xfrustum[video]")


def written(path: Path, frames: int, size: tuple[int, int] = (16, 12)) -> Path:
    """Write a video of random frames."""
    pixels = np.random.default_rng(1).integers(0, 256, (frames, size[1], size[0], 3), np.uint8)
    write_video(path, pixels)
    return path


def declaring(path: Path, frames: int) -> Path:
    """Let the headers of an AVI file declare another number of frames."""
    data = bytearray(path.read_bytes())
    number = frames.to_bytes(4, "little")
    head, stream = data.index(b"avih") + 8, data.index(b"strh") + 8
    data[head + 16 : head + 20] = number
    data[stream + 32 : stream + 36] = number
    path.write_bytes(data)
    return path


def test_frames_that_are_too_many_are_not_kept_and_too_few_are_named(tmp_path: Path) -> None:
    path = declaring(written(tmp_path / "HogelRow_0.avi", 40), 3)
    frames, size = video_size(path)
    with pytest.raises(InputError, match=f"more than {min(frames, 3)} frames"):
        read_video(path, min(frames, 3), size)
    with pytest.raises(InputError, match="has 3 frames, and the plate 4 columns"):
        read_video(written(tmp_path / "a.avi", 3), 4, (16, 12))


def test_frames_that_take_too_much_memory_are_refused_before_they_are_decoded(
    tmp_path: Path,
) -> None:
    path = written(tmp_path / "HogelRow_0.avi", 2, (256, 256))
    with input_memory(1 << 20), pytest.raises(InputError, match="--max-input-memory"):
        find_files(tmp_path)
    assert video_size(path) == (2, (256, 256))


def test_more_frames_than_hogels_are_allowed_are_refused(tmp_path: Path) -> None:
    declaring(written(tmp_path / "HogelRow_0.avi", 2), 30_000_000)
    with pytest.raises(InputError, match=r"--max-hogels|2 frames"):
        find_files(tmp_path).rows().row(0)


def test_a_codec_that_nobody_knows_is_one_line(tmp_path: Path) -> None:
    path = written(tmp_path / "HogelRow_0.avi", 2)
    path.write_bytes(path.read_bytes().replace(b"FFV1", b"\1\2\3\4"))
    with pytest.raises(InputError, match="is not a video that can be read"):
        find_files(tmp_path).rows()
