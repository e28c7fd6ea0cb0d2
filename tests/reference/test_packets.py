"""Arrays that kernels read in whole packets: nothing is read where there may be no memory."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.support.processes import threads
from tests.support.views import view
from xfrustum import reference
from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.devices.packets import in_packets
from xfrustum.scenes import DoubleFrustum
from xfrustum.scenes.room import (
    ALIGNMENT_BYTES,
    MAX_PACKET_LANES,
    has_room,
    lie_by_coordinate,
    picked,
    vectors_with_room,
    with_room,
)

EMBREE_BYTES = 16
"""Bytes that Embree reads where the last corner of a mesh begins."""


@settings(max_examples=40)
@given(
    st.integers(0, 300),
    st.sampled_from([np.float64, np.float32, np.int32, np.uint32, np.bool_]),
    st.integers(0, 5),
)
def test_a_copy_has_its_values_its_alignment_and_memory_behind_its_last_packet(
    size: int, kind: type, skipped: int
) -> None:
    values: NDArray[Any] = (np.arange(skipped, skipped + 3 * size) % 7).astype(kind).reshape(-1, 3)[:, 1]
    copy = in_packets(values)
    np.testing.assert_array_equal(copy, values)
    assert copy.dtype == values.dtype and copy.flags.c_contiguous and copy.flags.writeable
    assert copy.ctypes.data % ALIGNMENT_BYTES == 0

    whole = copy
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    lanes = -(-size // MAX_PACKET_LANES) * MAX_PACKET_LANES
    room = whole.ctypes.data + whole.nbytes - copy.ctypes.data
    assert room >= lanes * copy.itemsize + EMBREE_BYTES
    behind = whole[len(whole) - room :].view(np.uint8)[copy.nbytes : lanes * copy.itemsize]
    assert not behind.any()


def test_a_copy_has_the_type_that_is_asked_for() -> None:
    copy = in_packets(np.array([[1, -2], [3, 4]]), np.int32)
    assert copy.dtype == np.int32 and copy.tolist() == [1, -2, 3, 4]


@given(st.integers(0, 300), st.sampled_from([np.float64, np.float32, np.int32, np.bool_]))
def test_an_array_with_room_is_not_copied(rows: int, kind: type) -> None:
    values = with_room((rows, 3), kind)
    values[:] = 1
    assert has_room(values) and has_room(values.reshape(-1))
    assert in_packets(values).ctypes.data == values.ctypes.data
    assert np.array_equal(in_packets(values), values.ravel())


@given(st.integers(1, 9), st.integers(1, 40), st.sampled_from([np.float64, np.float32]))
def test_vectors_lie_coordinate_by_coordinate_and_are_read_in_place(
    height: int, width: int, kind: type
) -> None:
    vectors = vectors_with_room((height, width), kind)
    vectors[:] = np.arange(3 * height * width).reshape(height, width, 3)
    rows = vectors.reshape(-1, 3)
    assert np.shares_memory(rows, vectors)
    assert rows.tolist() == np.arange(3 * height * width).reshape(-1, 3).tolist()
    for coordinate in rows.T:
        assert has_room(coordinate)
        assert in_packets(coordinate).ctypes.data == coordinate.ctypes.data


@given(st.integers(2, 300), st.lists(st.integers(0, 299), max_size=20))
def test_rows_are_picked_as_they_lie(count: int, places: list[int]) -> None:
    wanted = np.array([place for place in places if place < count], dtype=np.int64)
    rows = np.random.default_rng(count).normal(size=(count, 3))
    apart = vectors_with_room((1, count), np.float64).reshape(-1, 3)
    apart[:] = rows
    assert not lie_by_coordinate(rows) and lie_by_coordinate(apart)
    np.testing.assert_array_equal(picked(rows, wanted), rows[wanted])
    np.testing.assert_array_equal(picked(apart, wanted), rows[wanted])
    np.testing.assert_array_equal(picked(rows[:, 0], wanted), rows[wanted, 0])


def test_memory_of_others_is_no_room() -> None:
    whole = with_room((4 * MAX_PACKET_LANES,), np.float64)
    assert has_room(whole[: 2 * MAX_PACKET_LANES])
    for wrong in (whole[1:], whole[::2], np.zeros(4 * MAX_PACKET_LANES), whole.copy(), np.array(1.0)):
        assert not has_room(wrong)
    # Aligned and contiguous, but with nothing behind its end.
    memory = np.zeros(8 * MAX_PACKET_LANES + ALIGNMENT_BYTES, dtype=np.uint8)
    start = -memory.ctypes.data % ALIGNMENT_BYTES
    last = memory[start : start + 8 * MAX_PACKET_LANES].view(np.float64)
    assert last.ctypes.data % ALIGNMENT_BYTES == 0 and not has_room(last)
    assert in_packets(last).ctypes.data != last.ctypes.data
    backward = np.zeros(8 * MAX_PACKET_LANES)[::-1]
    assert not has_room(backward[: 2 * MAX_PACKET_LANES][::-1])


@pytest.mark.skipif(not compiled(), reason="needs LLVM")
@pytest.mark.parametrize("count", [7, 300_000])
def test_numbers_of_single_precision_are_doubles_on_all_threads(count: int) -> None:
    jit = import_module("xfrustum.reference.devices.arithmetic_jit")
    digits = np.random.default_rng(1).integers(0, 2**32, count, dtype=np.uint32)
    digits[:6] = 0, 1 << 31, 1, (1 << 31) + 1, 0x007FFFFF, 0x00800000
    rows = digits.view(np.float32)[:, None]
    apart = vectors_with_room((1, count), np.float32).reshape(-1, 3)
    apart[:] = rows
    with np.errstate(invalid="ignore"):
        expected = rows[:, 0].astype(np.float64)
    lanes = jit.UInt32(in_packets(np.arange(count, dtype=np.uint32)))
    with threads(2):
        for table in (jit.doubles_of(rows), jit.doubles_of(apart), jit.JIT.own(rows), jit.JIT.own(apart)):
            found = table(lanes)[0].numpy()
            np.testing.assert_array_equal(found, expected)
            assert np.array_equal(np.signbit(found), np.signbit(expected))


@pytest.mark.skipif(not compiled(), reason="needs LLVM")
def test_lengths_are_those_of_complex_numbers() -> None:
    jit = import_module("xfrustum.reference.devices.arithmetic_jit")
    random = np.random.default_rng(2)
    x, y = random.normal(size=(2, 20_000)) * 10.0 ** random.uniform(-290, 300, size=(2, 20_000))
    special = np.array([0.0, -0.0, 1e-300, 1e308, np.inf, -np.inf, np.nan, 1.0])
    x, y = (
        np.concatenate((values, more.ravel()))
        for values, more in zip((x, y), np.meshgrid(special, special), strict=True)
    )
    with threads(2):
        found = jit.length(jit.Float64(in_packets(x)), jit.Float64(in_packets(y))).numpy()
    with np.errstate(over="ignore", invalid="ignore"):
        np.testing.assert_array_equal(found, NUMPY.length(x, y))


KERNEL_ARRAYS = ("Float64", "Float32", "UInt32", "Int32", "Bool", "Point3f", "Vector3f")
"""Names of types whose arrays kernels read in place where they are made of NumPy's."""

COPYING = ("on_device", "in_packets")
"""Names of the functions that make room behind the end."""

OF_NUMPY = (
    "astype",
    "ravel",
    "view",
    "ascontiguousarray",
    "array",
    "asarray",
    "concatenate",
    "full",
    "zeros",
)
"""Names of functions and methods that return arrays of NumPy."""


def arrays_made_of_numpy(node: ast.AST) -> Iterator[int]:
    """Yield the lines where arrays that kernels read are made of NumPy's without room behind their end."""
    for call in ast.walk(node):
        if isinstance(call, ast.Call) and _name(call.func) in KERNEL_ARRAYS:
            yield from (call.lineno for argument in call.args if _is_of_numpy(argument))


def _is_of_numpy(node: ast.AST) -> bool:
    if isinstance(node, ast.Call):
        if _name(node.func) in COPYING:
            return False
        if _name(node.func) in OF_NUMPY:
            return True
    return any(map(_is_of_numpy, ast.iter_child_nodes(node)))


def _name(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


def test_arrays_of_numpy_without_room_are_found() -> None:
    for wrong in ("UInt32(a.astype(kind))", "mi.Point3f(np.ascontiguousarray(a.T))", "Bool(np.array(a) > 0)"):
        assert list(arrays_made_of_numpy(ast.parse(wrong))) == [1], wrong
    for right in ("UInt32(on_device(a.astype(kind)))", "mi.Point3f(in_packets(a.T, kind))", "Int32(1)"):
        assert not list(arrays_made_of_numpy(ast.parse(right))), right


def test_kernels_are_given_no_array_of_numpy_without_room() -> None:
    files = sorted(Path(reference.__file__).parent.rglob("*.py"))
    wrong = [
        f"{file}:{line}"
        for file in files
        for line in arrays_made_of_numpy(ast.parse(file.read_text("utf-8")))
    ]
    assert files and not wrong


GUARDED = """
import ctypes, mmap
import numpy as np
from xfrustum.reference.certify.processors import compiled
assert compiled()
from xfrustum.reference.devices.arithmetic_jit import on_device
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.sight.sight import Sight, SurfacePoints
from xfrustum.scenes import open_scene

libc = ctypes.CDLL(None)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
libc.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]

def guarded(values):
    # The last byte of the copy is the last before a page that cannot be read.
    size = -(-values.nbytes // mmap.PAGESIZE) * mmap.PAGESIZE
    start = libc.mmap(None, size + mmap.PAGESIZE, 3, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, -1, 0)
    assert libc.mprotect(start + size, mmap.PAGESIZE, 0) == 0
    memory = (ctypes.c_char * values.nbytes).from_address(start + size - values.nbytes)
    copy = np.frombuffer(memory, values.dtype).reshape(values.shape)
    copy[...] = values
    return copy

for kind in ("float64", "float32", "int32", "uint32"):
    values = np.arange(1601).astype(kind)
    assert np.array_equal((on_device(guarded(values)) + 1).numpy(), values + 1), kind

scene = open_scene("asymmetric")
points = SurfacePoints(
    position=guarded(np.tile([0.5, 0.25, 1e-3], (1601, 1))),
    triangle=guarded(np.full(1601, -1, dtype=np.int32)),
    tolerance=guarded(np.full(1601, 1e-9)),
)
pencil = crossed_frustum(scene.frustum, scene.plate.middle)
print(Sight(scene).hidden(pencil, points).size)
"""


@pytest.mark.skipif(not compiled(), reason="there is no LLVM for Dr.Jit here")
@pytest.mark.skipif(sys.platform != "linux", reason="memory is protected by Linux's C library here")
def test_kernels_read_no_memory_behind_arrays() -> None:
    """Arrays lie at the very end of their memory: to read behind them ends the process."""
    done = subprocess.run([sys.executable, "-c", GUARDED], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "1601\n"), done.stderr


@pytest.mark.skipif(not compiled(), reason="needs LLVM")
def test_kernels_read_points_of_models_in_place() -> None:
    scene = view("crossing", (37, 23))
    settings = DoubleFrustum(near=1e-2 * scene.frustum.longest_reach)
    model = reference.Reference(scene).trace_model(scene.plate.middle, settings, shaded=False)
    assert all(has_room(coordinate) for coordinate in model.position.reshape(-1, 3).T)
