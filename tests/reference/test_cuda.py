"""CUDA kernels of the truth, tested without a card: no product of doubles fuses with a sum.

Dr.Jit compiles the kernels as for a card and passes them to a stand-in for the driver (libcuda.c),
which stores their PTX and runs nothing. The tests inspect the instructions that a driver's compiler
receives. If `ptxas` is available (on the path or in the wheel nvidia-cuda-nvcc-cu12), they also
check that NVIDIA's own compiler fuses nothing. Results of a card, atomic operations, read-back,
speed and OpenGL are not tested. `test_a_card_decides_the_same_bits` needs a card and is skipped
without one.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

#: A program that traces the kernels of truth, gaps, points and occlusion. Kernels of colors are
#: omitted: they are not exact.
KERNELS = """
import sys
from dataclasses import replace
import numpy as np
from xfrustum.reference import Reference, backend
from xfrustum.reference.backend import UInt32, dr
from xfrustum.reference.certify import occlusion
from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.certify.directions import DirectionLines
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.filter import Filter, PencilLines
from xfrustum.reference.lines import TileLines, crossed_frustum
from xfrustum.scenes import open_scene
from xfrustum.scenes.plate import PlateTile

assert backend.ARRAYS == "cuda"
if "plain" in sys.argv:  # without the remedy
    backend._MINUS_ZERO = None

def compress(mask):
    # Its answer would come from a kernel.
    dr.eval(mask)
    return dr.opaque(UInt32, 0, 1)

dr.compress = compress
for name in ("asymmetric", "hard/edge-through-aperture"):
    scene = open_scene(name)
    scene = replace(scene, frustum=replace(scene.frustum, resolution=(8, 8)))
    reference, rows, shape = Reference(scene), range(8), (8, 8)
    pencil = crossed_frustum(scene.frustum, scene.plate.middle)
    tile = PlateTile(plate=scene.plate, columns=range(2), rows=range(2))
    grid = TileLines(scene.frustum, tile).of_pixel((3, 4))
    with backend.recording():
        by_hogel = PencilLines(pencil, ExactPencil(scene.triangles, pencil))
        by_direction = DirectionLines(grid, reference._triangles)
    for lines, some in ((by_hogel, rows), (by_direction, range(2))):
        narrow = Filter(reference._triangles, lines)
        narrow.classify_pixels(some)
        narrow.gaps(some)
    seen = FirstSurfaces(
        triangle=np.zeros(shape, np.int32), s=np.ones(shape), certainty=np.zeros(shape, np.uint8),
        tied_triangles=np.zeros((0, 3), np.int64),
    )
    camera = reference.camera(scene.plate.middle)
    reference._pictures.image(camera, rows, [(pencil, seen)], colored=False)
    points = occlusion.SurfacePoints(
        position=np.full((64, 3), -1.0), triangle=np.zeros(64, np.int32),
        tolerance=np.full(64, 1e-6)
    )
    nowhere = np.zeros(64)
    pairs = occlusion.Candidates(
        ray=np.arange(64), triangle=np.zeros(64, np.int64), t=nowhere, error=nowhere,
        sure=nowhere > 0
    )
    reference._occlusion._off_planes(points, pairs)
    with backend.recording():
        dr.eval(vars(occlusion._lines_to(reference._occlusion._mesh, pencil, points)))
"""

STATEMENT = re.compile(r"^\s*(mul|add|sub|neg|mov)\.(?:f64|b64) (%\w+), (.*);", re.MULTILINE)


def fused(kernel: str) -> list[str]:
    """Return the sums of doubles in a kernel's PTX that a compiler may fuse with a product."""
    products: set[str] = set()
    result = []
    for statement in STATEMENT.finditer(kernel):
        operation, target, operands = statement.groups()
        takes = not products.isdisjoint(operands.split(", "))
        if operation in {"add", "sub"} and takes:
            result.append(statement[0].strip())
        # A product remains fusible behind a change of sign or a copy.
        if operation == "mul" or (operation in {"neg", "mov"} and takes):
            products.add(target)
    return result


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the stand-in for the driver's library."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler (cc) to build the stand-in for CUDA's driver with")
    library = tmp_path_factory.mktemp("driver") / "libcuda.so"
    source = Path(__file__).with_name("libcuda.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", library, source], check=True)
    return library


def traced(driver: Path, folder: Path, *arguments: str) -> dict[str, str]:
    """Return the PTX of kernels with doubles by file name, stored in a folder."""
    environment = {
        **os.environ,
        "XFRUSTUM_DEVICE": "auto",  # use the card
        "DRJIT_LIBCUDA_PATH": str(driver),
        "KERNELS": str(folder),
    }
    subprocess.run(
        [sys.executable, "-c", KERNELS, *arguments], env=environment, check=True, timeout=300
    )
    texts = {file.name: file.read_text() for file in sorted(folder.glob("*.ptx"))}
    return {name: text for name, text in texts.items() if re.search(r"(add|sub)\.f64", text)}


@pytest.fixture(scope="module")
def kernels(driver: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the PTX of the kernels of the truth."""
    return traced(driver, tmp_path_factory.mktemp("kernels"))


def test_no_product_of_doubles_can_be_fused_with_a_sum(kernels: dict[str, str]) -> None:
    assert len(kernels) >= 12
    assert sum(text.count("fma.rn.f64") for text in kernels.values()) > 300
    assert {name: result for name, text in kernels.items() if (result := fused(text))} == {}
    everything = "".join(kernels.values())
    # Quotients and roots are IEEE operations, and the minimum of doubles is atomic.
    assert "div.rn.f64" in everything and "sqrt.rn.f64" in everything and "approx" not in everything


@pytest.mark.slow
def test_the_inspection_finds_products_that_can_be_fused(driver: Path, tmp_path: Path) -> None:
    """Without the barrier to fusion, most kernels contain such products."""
    plain = traced(driver, tmp_path, "plain")
    assert sum(len(fused(text)) for text in plain.values()) > 200
    assert fused("mul.f64 %d3, %d1, %d2;\nneg.f64 %d4, %d3;\nadd.f64 %d5, %d4, %d1;") == [
        "add.f64 %d5, %d4, %d1;"
    ]


#: A program that saves the truths of all built-in scenes and hard cases, from three apertures each
SAVED = """
import sys
import numpy as np
from dataclasses import replace
from xfrustum.reference import Reference, backend
from xfrustum.scenes import open_scene
from xfrustum.scenes.library import builtin, hard_cases

found = {"arrays": np.array(backend.ARRAYS)}
for name in (*builtin.names(), *hard_cases.CASES):
    scene = open_scene(name)
    scene = replace(scene, frustum=replace(scene.frustum, resolution=(96, 72)))
    columns, rows = scene.plate.hogels
    for index in {(0, 0), (columns // 2, rows // 2), (columns - 1, rows - 1)}:
        image = Reference(scene).trace(scene.plate.aperture(*index))
        for channel in ("triangle", "object", "certainty", "position", "normal", "color"):
            found[f"{name}|{index}|{channel}"] = getattr(image, channel)
np.savez(sys.argv[1], **found)
"""


def test_a_card_decides_the_same_bits(tmp_path: Path) -> None:
    """Decisions, points and normals are bit-identical on a card; colors agree to rounding."""
    result = []
    for device in ("auto", "llvm"):
        file = tmp_path / f"{device}.npz"
        environment = {**os.environ, "XFRUSTUM_DEVICE": device}
        if device == "auto":
            request = "from xfrustum.reference.llvm import array_device; print(array_device())"
            message = subprocess.run(
                [sys.executable, "-c", request],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            if message.stdout.strip() != "cuda":
                pytest.skip("no NVIDIA card that Dr.Jit finds")
        subprocess.run([sys.executable, "-c", SAVED, str(file)], env=environment, check=True)
        result.append(dict(np.load(file)))
    card, processors = result
    assert card.pop("arrays") == "cuda" and processors.pop("arrays") == "llvm"
    for name, values in processors.items():
        if name.endswith("|color"):
            np.testing.assert_allclose(
                card[name], values, rtol=2.0**-22, atol=2.0**-100, err_msg=name
            )
        else:
            np.testing.assert_array_equal(card[name], values, err_msg=name)
