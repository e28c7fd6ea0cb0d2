"""Dr.Jit kernels: the same bits for any number of threads and bands; errors without LLVM."""

import os
import subprocess
import sys

import numpy as np
import pytest

from tests.support.images import assert_same
from tests.support.processes import threads
from tests.support.views import view
from xfrustum.reference import Reference, shading
from xfrustum.reference.backend import constants, dr, on_device, recording, vectors_on_device
from xfrustum.reference.shading import Surroundings, Textures, radiance_toward
from xfrustum.scenes import HogelImage
from xfrustum.scenes.appearance import Environment


def assert_same_truth(item: HogelImage, other: HogelImage) -> None:
    assert_same(item, other, "triangle", "object", "certainty", "position", "normal", "color")
    assert set(map(tuple, item.tied_triangles.tolist())) == set(
        map(tuple, other.tied_triangles.tolist())
    )


def test_several_threads_make_the_bits_of_one() -> None:
    """Kernels write with atomic operations in any order; decisions are independent of it."""
    scene = view("crossing", (128, 96))
    aperture = scene.plate.aperture(38, 31)
    with threads(1):
        alone = Reference(scene).trace(aperture)
    with threads(4):
        for _ in range(3):
            assert_same_truth(Reference(scene).trace(aperture), alone)


def test_images_in_bands_have_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = view("crossing", (20, 30))
    whole = Reference(scene).trace(scene.plate.middle)
    monkeypatch.setattr("xfrustum.reference.truth.WHOLE_PIXELS", 20 * 7)
    assert_same_truth(Reference(scene).trace(scene.plate.middle), whole)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 7.0, 50.0, 1000.0, 3e4, 2.5, 333.25])
def test_powers_are_those_of_numpy_down_to_nothing(exponent: float) -> None:
    """Dr.Jit's own power function returns minus infinity near 2^-1023."""
    base = np.concatenate(
        (np.linspace(0.0, 1.0, 3001), 2.0 ** (-np.arange(990, 1080) / max(exponent, 1.0)), [-0.5])
    )
    where = base > 0
    digits = int(exponent).bit_length() if exponent.is_integer() else None
    expected = np.power(base, exponent, out=np.zeros(len(base)), where=where)
    with recording():
        (raised,) = constants([exponent])
        result = shading._power(on_device(base), raised, on_device(where), digits).numpy()
    # Values below the range of float32 are zero in an image.
    np.testing.assert_allclose(result, expected, rtol=1e-10, atol=2.0**-900)


def test_lookups_stay_inside_a_picture_at_any_place() -> None:
    """NaN coordinates, as in pixels without a surface, must not index memory."""
    random = np.random.default_rng(2)
    pictures = tuple(
        random.integers(0, 256, (*size, 4)).astype(np.uint8) for size in ((5, 9), (16, 4))
    )
    numbers = np.array([1, -1, 0], dtype=np.int32)
    u = np.array([np.nan, np.inf, -np.inf, 1e300, -1e17, 0.999999, -3.2, 1e9 + 0.25])
    triangle = np.arange(len(u)) % 3
    with recording():
        textures = Textures(pictures, numbers)
        channels = textures.color(on_device(triangle), [on_device(u), on_device(u[::-1])])
        dr.eval(*channels)
        result = np.stack([channel.numpy() for channel in channels])
    assert (result[:, triangle == 1] == 1).all()
    known = np.isfinite(u) & np.isfinite(u[::-1])
    assert known.sum() >= 2 and ((result[:, known] >= 0) & (result[:, known] <= 1)).all()
    sky = Environment(radiance=random.uniform(0, 2, (7, 12, 3)).astype(np.float32))
    assert radiance_toward(sky, np.tile([[np.nan], [np.inf], [0.0]], 3)).shape == (3, 3)
    with recording():
        assert len(Surroundings(sky).radiance(vectors_on_device(np.eye(3)))) == 3


@pytest.mark.parametrize(
    ("environment", "words", "message"),
    [
        ({"DRJIT_LIBLLVM_PATH": "/nowhere/libLLVM.so"}, (), "(none: DRJIT_LIBLLVM_PATH names none"),
        ({"CUDA_VISIBLE_DEVICES": ""}, ("--arrays", "cuda"), "no NVIDIA card"),
        pytest.param(
            {"XFRUSTUM_DEVICE": "gpu"},
            (),
            "'gpu': set it to one of auto, llvm, cuda",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_without_a_compiler_or_a_card_a_command_prints_one_line(
    environment: dict[str, str], words: tuple[str, ...], message: str
) -> None:
    command = [sys.executable, "-m", "xfrustum", *words, "trace", "asymmetric", "--out", "x.exr"]
    done = subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert message in line and len(line) < 500


def test_the_environment_bounds_the_threads() -> None:
    program = """
import drjit
from xfrustum.reference.llvm import array_device
array_device()
print(drjit.thread_count())
"""
    environment = {**os.environ, "XFRUSTUM_THREADS": "3", "XFRUSTUM_DEVICE": "llvm"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == 3
