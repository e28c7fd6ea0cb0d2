"""Recordings, archives and scene files of strangers: one-line errors within the memory limit."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Command
from tests.support.scene_file import film
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.disk import input_memory, read_arrays, read_input
from xfrustum.scenes.model.device_model import DeviceModel

SCENE = film(
    (10.0, 10.0), hogels=(3, 3), resolution=(16, 12), fov_deg=(60.0, 60.0), reach=(20.0, 20.0)
)
ADVICE = "archive", "make it again"


def test_recordings_of_an_attack_end_with_one_line(shared_data: Path, command: Command) -> None:
    files = sorted((shared_data / "data" / "inputs" / "hostile").glob("replay-*.npz"))
    assert len(files) == 9
    for path in files:
        printed = command(f"device --replay {path}", status=2)
        assert printed.out == "" and printed.err.count("\n") == 1 and path.name in printed.err


def test_arrays_are_read_without_pickles_and_declare_no_more_than_allowed(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, one=np.arange(6).reshape(2, 3), two=np.array("text"))
    arrays = read_arrays(path, *ADVICE)
    assert arrays["one"].tolist() == [[0, 1, 2], [3, 4, 5]] and str(arrays["two"]) == "text"
    np.savez(path, one=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="pickle"):
        read_arrays(path, *ADVICE)
    # A few kilobytes that expand to 32 MiB
    np.savez_compressed(path, one=np.zeros(1 << 25, np.uint8))
    tracemalloc.start()
    message = r"unpacking its arrays, 32 MiB of memory.*--max-input-memory"
    with input_memory(1 << 20), pytest.raises(InputError, match=message):
        read_arrays(path, *ADVICE)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_files_that_are_holes_empty_or_of_proc_are_refused(tmp_path: Path) -> None:
    hole, empty = tmp_path / "hole", tmp_path / "empty"
    with hole.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError, match=r"hole: claims 1024 GiB and fills 0 bytes of the disk"):
        read_input(hole, "mesh file")
    empty.touch()
    for path in (empty, Path("/proc/self/environ")):
        with pytest.raises(InputError, match="the mesh file is empty"):
            read_input(path, "mesh file")


def test_a_file_of_a_device_has_a_bounded_size_and_depth(tmp_path: Path) -> None:
    path = tmp_path / "device.json"
    path.write_text(" " * (1 << 21))
    with pytest.raises(InputError, match=r"more than a device\.json has"):
        DeviceModel.read(path)
    path.write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"is no device\.json \(invalid json: recursion limit"):
        DeviceModel.read(path)


@pytest.mark.parametrize(
    "line", [".".join(["a"] * 200_000) + " = 1", "x = {" + " . ".join(["'a'"] * 200_000) + " = 1}"]
)
def test_keys_of_many_parts_are_refused_at_once(line: str, tmp_path: Path) -> None:
    """Python's TOML reader takes 8 seconds for a key of 20,000 parts."""
    (tmp_path / "scene.toml").write_text(f"{SCENE}{line}\n")
    with pytest.raises(InputError, match="has more than 16 parts"):
        open_scene(tmp_path / "scene.toml")


def test_comments_and_texts_with_dots_are_no_long_keys(tmp_path: Path) -> None:
    path, name = tmp_path / "scene.toml", "a.b " * 40 + "'\\\"..'.c" * 40
    comment = f"# see {'a.' * 40}b\n"
    path.write_bytes(
        b"\xef\xbb\xbf" + f'{comment}name = "{name}"  # {"1.2, " * 99}\n{SCENE}'.encode()
    )
    assert open_scene(path).name == name.replace('\\"', '"')


def test_numbers_of_thousands_of_digits_are_refused_by_the_name_of_their_key(
    tmp_path: Path,
) -> None:
    """Python reads a hexadecimal number of any length, but prints at most 4,300 decimal digits."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace("hogels = [3", f"hogels = [0x{'f' * 5000}"))
    message = r"plate.hogels\[0\]: .*not a number of thousands of digits"
    with pytest.raises(InputError, match=message):
        open_scene(path)
