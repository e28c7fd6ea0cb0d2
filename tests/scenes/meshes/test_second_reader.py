"""Both readers agree on every mesh file of the repository and of ../shared, or both refuse it.

`pytest -s` prints the table; `python -m tests.second_reader FILE..` prints it for any file.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.second_reader import Reading, read, read_triangles
from tests.second_reader.__main__ import lines
from tests.second_reader.compare import compare, differences, product_triangles, texture_distance
from tests.second_reader.gltf_data import Document
from tests.second_reader.model import Floats
from tests.second_reader.reading import READERS
from xfrustum.reference import Reference
from xfrustum.scenes import Frustum, Plate, Scene
from xfrustum.scenes.geometry.shapes import place, placement
from xfrustum.scenes.meshes.mesh_file import load_mesh

CHECKOUT = Path(__file__).resolve().parents[3]
DATA = CHECKOUT.parent / "shared" / "data"
INPUTS = DATA / "inputs"
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="no folder of test data beside the checkout"
)

#: Files with a feature, and the same shapes written plainly.
TWINS = [
    ("letter_ngon.obj", "letter_triangles.obj"),
    ("letter_ngon.off", "letter_triangles.obj"),
    ("letter_ngon.ply", "letter_triangles.obj"),
    ("three_blocks.obj", "three_blocks_absolute.obj"),
    ("bom.obj", "noff.off"),
    ("indented.obj", "noff.off"),
    ("tabs.obj", "noff.off"),
    ("mac_line_ends.obj", "noff.off"),
    ("commented_mtllib.obj", "noff.off"),
    ("4off.off", "noff.off"),
    ("box_normalized_int16.glb", "box_float.glb"),
    ("box_uv_uint16.glb", "box_float.glb"),
    ("skyline_sparse.glb", "skyline_dense.glb"),
    ("skyline_all_sparse.glb", "skyline_dense.glb"),
    ("figure_skinned.glb", "figure_baked.glb"),
    ("hill_morph.glb", "hill_baked.glb"),
    ("field_instanced.glb", "field_nodes.glb"),
    ("field_instanced_required.glb", "field_nodes.glb"),
    ("mixed_modes.glb", "mixed_triangles.glb"),
    ("badge_under_camera.glb", "badge_baked.glb"),
]
TEXTURED = [
    "box_float.glb",
    "box_uv_uint16.glb",
    "box_normalized_int16.glb",
    "commented_mtllib.obj",
]


def files() -> list[Path]:
    """Return the mesh files that git tracks, and those of the test data beside the checkout."""
    git = ["git", "ls-files"]
    listed = subprocess.run(git, cwd=CHECKOUT, capture_output=True, text=True, check=False).stdout
    tracked = [CHECKOUT / name for name in listed.splitlines()]
    paths = [*(tracked or sorted((CHECKOUT / "scenes").rglob("*"))), *sorted(DATA.rglob("*"))]
    return [path for path in paths if path.suffix.lower() in READERS]


def name_of(path: Path) -> str:
    """Return the name of a file within its folder."""
    return str(path.relative_to(CHECKOUT if path.is_relative_to(CHECKOUT) else DATA))


def has_order(path: Path) -> bool:
    """Test whether a specification orders the triangles: not of several nodes, nor of polygons."""
    if path.suffix.lower() in (".glb", ".gltf"):
        return sum("mesh" in node for node in Document(path).json["nodes"]) < 2
    return all(len(polygon) == 3 for polygon in read(path).polygons)


@pytest.mark.parametrize("path", files(), ids=name_of)
def test_both_readers_agree(path: Path) -> None:
    row = compare(path)
    sys.stdout.write("\n" + "\n".join(lines(path.name, row)) + "\n")
    assert row.difference is None
    assert row.order or not has_order(path)


@needs_data
def test_test_data_has_meshes() -> None:
    assert any(path.is_relative_to(INPUTS) for path in files())


@needs_data
@pytest.mark.parametrize(("feature", "plain"), TWINS)
def test_twins_are_equal_by_the_second_reader(feature: str, plain: str) -> None:
    assert twins_differ(read(INPUTS / feature), read_triangles(INPUTS / plain)) is None


@needs_data
@pytest.mark.parametrize(("feature", "plain"), TWINS)
def test_twins_are_equal_by_the_product(feature: str, plain: str) -> None:
    reading = read(INPUTS / feature)
    assert twins_differ(reading, product_triangles(INPUTS / plain)) is None
    assert twins_differ(reading, product_triangles(INPUTS / feature)) is None


@needs_data
@pytest.mark.parametrize(("feature", "plain"), TWINS)
def test_twins_have_equal_traces(feature: str, plain: str) -> None:
    """Compare surface points, for cuts and nodes in another order have other triangle numbers."""
    twins = [load_mesh(INPUTS / name) for name in (feature, plain)]
    low, high = twins[1].vertices.min(axis=0), twins[1].vertices.max(axis=0)
    size = float(np.max(high - low))
    askew = placement(1.0, (33.0, 21.0, 7.0))
    askew[:3, 3] = -askew[:3, :3] @ ((low + high) / 2)  # about the plate
    truths = []
    for part in twins:
        scene = Scene(
            name="twin",
            plate=Plate(size=(size, size), hogels=(3, 3)),
            frustum=Frustum(resolution=(48, 40), reach=(4 * size, 4 * size), fov=(1.2, 1.0)),
            objects=(place(part, askew),),
        )
        reference = Reference(scene)
        traced = [reference.trace(aperture) for aperture in scene.plate.apertures()]
        truths.append(np.stack([truth.position for truth in traced]))
    assert np.isfinite(truths[0]).any()
    # Twins stored in float32 and in integers differ by its rounding; lines this oblique enlarge it
    # tenfold.
    bound = 10 * 2.0**-24 * size
    np.testing.assert_allclose(truths[0], truths[1], rtol=0, atol=bound)


def twins_differ(feature: Reading, triangles: Floats) -> str | None:
    """Compare triangles with polygons; either file may store in float32 what the other computes."""
    bound = 2.0**-24 * float(np.abs(triangles).max())
    wider = [bound + one for one in feature.rounding]
    return differences(triangles, Reading(feature.polygons, wider))[0]


@needs_data
@pytest.mark.parametrize("name", TEXTURED)
def test_texture_coordinates_agree(name: str) -> None:
    distance = texture_distance(INPUTS / name)
    assert distance is not None
    assert distance <= 2.0**-52
