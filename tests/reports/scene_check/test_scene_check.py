"""`xfrustum check` and `xfrustum new`: facts and pictures of a scene; a scene for a mesh."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import xfrustum
from tests.support.commands import Command
from tests.support.scene_file import film, named, part
from xfrustum import InputError, Scene, open_scene
from xfrustum.cli.main import main
from xfrustum.reports.scene_check.checking import View
from xfrustum.scenes.model.visibility import box
from xfrustum.scenes.shapes import build_shape, flipped, placement, smoothed

Triple = tuple[float, float, float]
FRAME = film(
    (80.0, 60.0), hogels=(9, 7), resolution=(16, 16), fov_deg=(60.0, 60.0), reach=(150.0, 100.0)
)
FILE = (
    named("two & a <half>", "mm")
    + FRAME
    + part("sphere", 60.0, (10.0, -5.0, -60.0), smooth=True)
    + part("torus", 40.0, (0.0, 0.0, 60.0))
    + part("box", 1000.0, (0.0, 0.0, -8500.0))
)


@pytest.fixture(autouse=True)
def work_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run each test in its own folder."""
    monkeypatch.chdir(tmp_path)


def test_check_lists_places_and_sight_and_draws_two_views(command: Command) -> None:
    scene = Path("scene.toml")
    scene.write_text(FILE)
    printed = command("check scene.toml --json --out views")
    content = printed.record
    sphere, torus, away = content["objects"]
    assert sphere["size"] == pytest.approx([60, 60, 60], rel=0.01)
    assert [sphere["low"][2], sphere["high"][2]] == pytest.approx([-90, -30], abs=0.5)
    assert sphere["share_in_reach"] == pytest.approx(1.0) and sphere["sight"]["apertures"] == 63
    assert "smooth" in sphere["normals"] and torus["normals"].startswith("none")
    assert away["share_in_reach"] == 0 and away["sight"]["apertures"] == 0
    assert "object 2 (box) spans 8,000 to 9,000 mm behind the plate" in printed.err
    assert printed.err.count("\n") == len(content["warnings"])
    expected = {"plate", "viewer", "reach 150", "reach 100", "0 sphere", "1 torus"}
    expected |= {"outside the picture: 8,000 to 9,000 mm behind the plate"}
    for name in ("side", "top"):
        svg = Path(f"views/{name}.svg").read_text()
        assert expected <= {element.text for element in Xml.fromstring(svg).iter()}
        assert "http" not in svg.replace("http://www.w3.org/2000/svg", "")
    # If no aperture sees any surface, the exit status is 1.
    scene.write_text(FILE.replace("-60.0]", "-800.0]").replace("60.0]\n[[", "900.0]\n[["))
    assert "no aperture of the plate sees anything" in command("check scene.toml", status=1).err


def test_check_rings_small_objects_and_counts_their_warnings() -> None:
    """Triangles of a tiny object are smaller than the cells of its outline."""
    small = (part("sphere", 0.5, (10.0 * x, 0.0, -20.0)) for x in range(5))
    Path("scene.toml").write_text(FRAME + "".join(small))
    checked = xfrustum.check(open_scene("scene.toml"))
    assert len(checked.warnings) == 3 and checked.warnings[-1].endswith("; and so for 2 more")
    assert [checked.view(view).count('r="9"') for view in View] == [5, 5]


def mesh(name: str, extents: Triple = (2.0, 1.0, 0.5), at: Triple = (0.0, 0.0, 0.0)) -> str:
    solid = trimesh.creation.box(extents=extents)
    solid.apply_translation(at)
    solid.export(name)
    return name


def assert_fits(scene: Scene) -> None:
    checked = xfrustum.check(scene)
    (placed,) = checked.objects
    assert placed.extent.share_in_reach == pytest.approx(1.0) and placed.extent.sight.middle
    assert checked.warnings == ()
    assert (np.array(scene.plate.size) >= placed.extent.size[:2]).all()


@settings(max_examples=4, deadline=None)
@given(
    sides=st.tuples(*[st.floats(0.01, 1.0)] * 3),
    at=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    unit=st.integers(-6, 6).map(lambda power: 10.0**power),
    place=st.sampled_from(["through", "behind", "before"]),
    size=st.sampled_from([None, 120.0, 0.3]),
)
def test_a_new_scene_fits_a_mesh_of_any_size_anywhere(
    sides: Triple, at: Triple, unit: float, place: str, size: float | None
) -> None:
    extents, center = (tuple(unit * length for length in some) for some in (sides, at))
    solid = mesh("box.ply", extents, center)  # type: ignore[arg-type]
    xfrustum.new_scene(solid, "box.toml", place=place, size=size, force=True)
    scene = open_scene("box.toml")
    assert_fits(scene)
    low, high = box(scene.objects[0])
    if size is not None:
        assert max(np.subtract(high, low)) == pytest.approx(size, rel=1e-4)
    assert {"through": low[2] < 0 < high[2], "behind": high[2] < 0, "before": low[2] > 0}[place]


def test_new_writes_a_file_that_opens_from_anywhere_and_replaces_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("scenes").mkdir()
    solid = mesh('a "quoted" näme.obj', at=(7.0, 0.0, 0.0))
    command = ["new", solid, "--out", "scenes/new.toml", "--size", "100", "--units", "mm"]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "100 x 50 x 25 mm, from 12.5 mm behind the plate to 12.5 mm before it" in printed
    text = Path("scenes/new.toml").read_text()
    assert tomllib.loads(text)["units"] == "mm" and text.count("#") > 8
    Path("scenes/new.toml").write_text("mine")
    assert main(command) == 2
    assert "new.toml: exists already" in capsys.readouterr().err
    assert Path("scenes/new.toml").read_text() == "mine"
    assert main([*command, "--force"]) == 0
    monkeypatch.chdir("scenes")
    assert_fits(open_scene("new.toml"))
    # The unit of glTF is the meter.
    assert xfrustum.new_scene(mesh("other.glb")).units == "m"


POINT = "v 1 1 1\nv 1 1 1\nv 1 1 1\n"


@pytest.mark.parametrize(
    ("corners", "keywords", "message"),
    [
        (POINT, {"size": -1.0}, "positive"),
        (POINT, {"units": "mm\n[plate"}, "units must be printable text on one line"),
        (POINT, {}, "one point"),
        ("v 0 0 0\nv 0 0 1\nv 0 0 2\n", {}, "on one line through the plate"),
        ("v 0 0 0\nv 1e-320 0 0\nv 0 1e-320 0\n", {"size": 100.0}, "so small or large"),
    ],
)
def test_new_refuses_nonsense_and_meshes_without_a_width_or_of_extreme_lengths(
    corners: str, keywords: dict[str, Any], message: str
) -> None:
    Path("part.obj").write_text(corners + "f 1 2 3\n")
    with pytest.raises(InputError, match=message):
        xfrustum.new_scene("part.obj", "a.toml", **keywords)
    assert not Path("a.toml").exists()


PLATES = {
    # Cells are visible to an eye nearer than the pitch / 1'.
    "--plate 60cm,40cm --viewer 2m": ((600, 400), (1032, 688), ""),
    "--plate 600,400 --viewer 600 --pitch 1": ((600, 400), (600, 400), "3,438 mm"),
    "--size 55 --pitch 0.7": ((80.5, 40.6), (115, 58), ""),
    "--size 500 --viewer 50mm --plate 60,40 --pitch 0.02": ((60, 40), (3000, 2000), "behind"),
}


@pytest.mark.parametrize("options", PLATES)
def test_a_real_plate_gets_hogels_that_its_viewer_does_not_see_as_cells(
    options: str, command: Command
) -> None:
    plate, hogels, warning = PLATES[options]
    printed = command(f"new {mesh('part.obj')} --units mm --json {options}")
    content, scene = printed.record, open_scene("part.toml")
    assert scene.plate.size == pytest.approx(plate) and scene.plate.hogels == hogels
    pitch = max(plate[0] / hogels[0], plate[1] / hogels[1])
    assert content["pitch"] == pytest.approx(pitch)
    assert content["cells_within"] == pytest.approx(pitch / (math.pi / 180 / 60))
    assert bool(content["warning"]) == bool(warning) and warning in printed.err
    # Without --size, the mesh is scaled to fit the plate.
    low, high = box(scene.objects[0])
    assert (np.subtract(high, low)[:2] < plate).all() or "--size" in options


def test_a_mesh_whose_up_is_z_stands_upright_and_looks_at_the_viewer() -> None:
    written = xfrustum.new_scene(mesh("part.ply", (1.0, 2.0, 8.0), at=(0, 0, 100)), up="z")
    low, high = box(open_scene("part.toml").objects[0])
    np.testing.assert_allclose(np.subtract(high, low), (1.0, 8.0, 2.0), atol=1e-4)
    np.testing.assert_allclose(np.add(high, low), 0.0, atol=1e-3)
    assert written.mesh == pytest.approx((1.0, 2.0, 8.0), abs=1e-4)
    # +z, up in the file, is up in the scene; -y, the front in Blender, faces the viewer.
    turned = placement(1.0, written.rotate_deg)[:3, :3]
    np.testing.assert_allclose(
        turned @ [[0, 0], [0, -1], [1, 0]], [[0, 0], [1, 0], [0, 1]], atol=1e-15
    )


def test_faces_wound_inward_are_warned_about_where_they_are_culled_and_turned_by_the_file(
    command: Command,
) -> None:
    solid, path = trimesh.creation.icosphere(2, 20.0), Path("a.toml")
    solid.invert()
    solid.export("inside-out.ply")
    xfrustum.new_scene("inside-out.ply", path, place="behind", units="mm")
    draw = "raster a.toml --near 0.1 --out a.exr --cull"

    def warned(line: str) -> int:
        return command(line).err.count("show back faces, and `--cull back` leaves them out")

    assert [warned(line) for line in ("check a.toml", f"{draw} back", f"{draw} none")] == [1, 1, 0]
    scene = open_scene("a.toml")
    (wrong,), few = scene.objects, np.arange(len(scene.faces))[:, None] % 4 == 0
    for turned, count in ((few, 1), (~few, 0)):
        faces = np.where(turned, wrong.faces[:, ::-1], wrong.faces)
        checked = xfrustum.check(replace(scene, objects=(replace(wrong, faces=faces),)))
        assert sum("back faces" in line for line in checked.warnings) == count
    path.write_text(path.read_text().replace("# flip_winding", "flip_winding"))
    assert [warned("check a.toml"), warned(f"{draw} back")] == [0, 0]
    np.testing.assert_array_equal(open_scene("a.toml").objects[0].faces, wrong.faces[:, ::-1])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_normals_of_a_flipped_mesh_lie_on_the_side_of_its_new_winding(side: float) -> None:
    """The file's normals agree with its winding or, correctly, oppose it."""
    ball = build_shape("sphere")
    normals = np.asarray(smoothed(ball).vertex_normals)
    turned = flipped(replace(ball, vertex_normals=side * normals)).vertex_normals
    np.testing.assert_array_equal(turned, -normals)


TILED = "v -20 -20 0\nv 20 -20 0\nv 20 20 {}\nv -20 20 0\nf 1 2 3\nf 1 3 4\nf 1 2 2\n"


@pytest.mark.parametrize("off", ["0", "1e-7"])
def test_a_mesh_as_flat_as_rounding_is_placed_behind_the_plate(off: str, command: Command) -> None:
    """If the mesh is put into the plate, `new` and `check` warn of it."""
    Path("flat.obj").write_text(TILED.format(off))
    printed = command("new flat.obj --size 60")
    assert "flat, and is placed behind the plate" in printed.err
    assert box(open_scene("flat.toml").objects[0])[1][2] < -10
    printed = command("new flat.obj --units mm --size 6cm --through --force")
    assert "2 triangles lie in the plate" in printed.err
    assert "2 of its 3 triangles lie in the plate" in command("check flat.toml").err


def test_surfaces_through_the_plate_or_near_it_raise_no_warning() -> None:
    """A solid across the plate has no triangle in the plate; float32 resolves a height of 1e-4."""
    assert xfrustum.new_scene(mesh("part.obj"), "a.toml").warning is None
    Path("near.toml").write_text(FRAME + part("square", 40.0, (0.0, 0.0, 1e-4)))
    assert not xfrustum.check(open_scene("near.toml")).warnings


def test_features_that_are_not_read_are_listed_and_warned_about(command: Command) -> None:
    """Triangles without area are such a feature; no aperture sees them."""
    square = "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv 0 0 0\nl 1 2\nf 1 2 3\nf 1 4 3\n"
    Path("a.obj").write_text(square)
    text = '\n[[object]]\nmesh = "a.obj"\ntranslate = [0.0, 0.0, -20.0]\n'
    Path("scene.toml").write_text(named("lines", "mm") + FRAME + text)
    printed = command("check scene.toml --json")
    lines, flat = printed.record["unread"]
    assert (lines["object"], Path(lines["file"]).name) == (0, "a.obj")
    assert (lines["feature"], flat["feature"]) == ("lines (l)", "1 of 2 triangles")
    assert "a.obj: 1 of 2 triangles have no area and are not seen\n" in printed.err
    for line in ("trace scene.toml --out t.exr", "new a.obj"):
        assert "a.obj: lines (l) are not drawn" in command(line).err
