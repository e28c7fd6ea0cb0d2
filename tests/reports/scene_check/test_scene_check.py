"""`xfrustum check` and `xfrustum new`: facts and pictures of a scene, a scene around a mesh."""

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import xfrustum
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.scenes import InputError, Scene, open_scene
from xfrustum.scenes.geometry.shapes import build_shape, flipped, placement, smoothed
from xfrustum.scenes.model.visibility import box

FILE = (
    named("two & a <half>", "mm")
    + film(
        (80.0, 60.0), hogels=(9, 7), resolution=(16, 16), fov_deg=(60.0, 60.0), reach=(150.0, 100.0)
    )
    + part("sphere", 60.0, (10.0, -5.0, -60.0), smooth=True)
    + part("torus", 40.0, (0.0, 0.0, 60.0))
    + part("box", 1000.0, (0.0, 0.0, -8500.0))
)


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "scene.toml"
    path.write_text(FILE)
    return str(path)


def words(svg: str) -> list[str]:
    return [
        element.text or ""
        for element in Xml.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")
    ]


def test_check_says_of_each_object_where_it_lies_and_who_sees_it(
    scene: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", scene, "--json"]) == 0
    printed = capsys.readouterr()
    content = json.loads(printed.out)
    sphere, torus, away = content["objects"]
    assert (sphere["name"], sphere["number"]) == ("sphere", 0)
    assert sphere["size"] == pytest.approx([60, 60, 60], rel=0.01)
    assert [sphere["low"][2], sphere["high"][2]] == pytest.approx([-90, -30], abs=0.5)
    assert sphere["share_in_reach"] == pytest.approx(1.0) and sphere["sight"]["apertures"] == 63
    assert "smooth" in sphere["normals"] and torus["normals"].startswith("none")
    assert away["share_in_reach"] == 0 and away["sight"]["apertures"] == 0
    assert content["seen"] is True and content["files"] == []
    assert "object 2 (box) spans 8,000 to 9,000 mm behind the plate" in printed.err
    assert printed.err.count("\n") == len(content["warnings"])
    # Where no aperture sees anything, the exit status is 1.
    text = Path(scene).read_text()
    Path(scene).write_text(text.replace("-60.0]", "-800.0]").replace("60.0]\n[[", "900.0]\n[["))
    assert main(["check", scene]) == 1
    printed = capsys.readouterr()
    assert (
        "none of 63 apertures" in printed.out
        and "no aperture of the plate sees anything" in printed.err
    )


def test_check_writes_two_views_that_name_what_they_show(scene: str, tmp_path: Path) -> None:
    assert main(["check", scene, "--out", str(tmp_path / "views")]) == 0
    files = sorted((tmp_path / "views").iterdir())
    assert [file.name for file in files] == ["side.svg", "top.svg"]
    expected = {"plate", "viewer", "reach 150", "reach 100", "0 sphere", "1 torus"}
    expected |= {"behind the plate: camera C", "viewer's side: camera C*"}
    expected |= {"outside the picture: 8,000 to 9,000 mm behind the plate"}
    for file in files:
        assert expected <= set(words(file.read_text()))
        assert "http" not in file.read_text().replace("http://www.w3.org/2000/svg", "")


Triple = tuple[float, float, float]


def mesh(
    folder: Path, name: str, extents: Triple = (2.0, 1.0, 0.5), at: Triple = (0.0, 0.0, 0.0)
) -> Path:
    solid = trimesh.creation.box(extents=extents)
    solid.apply_translation(at)
    solid.export(folder / name)
    return folder / name


def assert_fits(scene: Scene) -> None:
    (low, high), (toward, back) = box(scene.objects[0]), scene.frustum.reach
    assert -back <= low[2] and high[2] <= toward
    checked = xfrustum.check(scene)
    (placed,) = checked.objects
    assert placed.extent.share_in_reach == pytest.approx(1.0) and placed.extent.sight.middle
    assert checked.warnings == ()
    assert scene.plate.size[0] >= high[0] - low[0] and scene.plate.size[1] >= high[1] - low[1]


@settings(max_examples=5, deadline=None)
@given(
    st.tuples(*[st.floats(0.01, 1.0)] * 3),
    st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    st.integers(-6, 6),
    st.sampled_from(["through", "behind", "before"]),
    st.sampled_from([None, 120.0, 0.3]),
)
def test_a_new_scene_fits_a_mesh_of_any_size_anywhere(
    tmp_path_factory: pytest.TempPathFactory,
    sides: Triple,
    at: Triple,
    power: int,
    place: str,
    size: float | None,
) -> None:
    folder, unit = tmp_path_factory.mktemp("new"), 10.0**power
    extents, center = (tuple(unit * length for length in some) for some in (sides, at))
    solid = mesh(folder, "box.ply", extents, center)  # type: ignore[arg-type]
    written = xfrustum.new_scene(solid, folder / "box.toml", place=place, size=size)
    scene = open_scene(str(written.path))
    assert_fits(scene)
    low, high = box(scene.objects[0])
    if size is not None:
        assert max(np.subtract(high, low)) == pytest.approx(size, rel=1e-4)
    assert {"through": low[2] < 0 < high[2], "behind": high[2] < 0, "before": low[2] > 0}[place]


def test_new_writes_a_file_that_opens_from_anywhere_and_says_what_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").mkdir()
    mesh(tmp_path, 'a "quoted" näme.obj', at=(7.0, 0.0, 0.0))
    arguments = [
        "new",
        'a "quoted" näme.obj',
        "--out",
        "scenes/new.toml",
        "--size",
        "100",
        "--units",
        "mm",
    ]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "100 x 50 x 25 mm, from 12.5 mm behind the plate to 12.5 mm before it" in printed
    text = Path("scenes/new.toml").read_text()
    assert tomllib.loads(text)["units"] == "mm" and text.count("#") > 8
    monkeypatch.chdir(tmp_path / "scenes")
    assert_fits(open_scene("new.toml"))


def test_new_replaces_nothing_unless_told_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mesh(tmp_path, "part.stl")
    Path("part.toml").write_text("mine")
    assert main(["new", "part.stl"]) == 2
    assert "part.toml: exists already" in capsys.readouterr().err
    assert Path("part.toml").read_text() == "mine"
    assert main(["new", "part.stl", "--force"]) == 0
    assert_fits(open_scene("part.toml"))
    # The unit of glTF is the meter.
    glb = mesh(tmp_path, "other.glb")
    assert open_scene(str(xfrustum.new_scene(glb).path)).units == "m"


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"place": "beside"}, "through, behind, before"),
        ({"size": -1.0}, "positive"),
        ({"units": ""}, "units"),
        ({"units": "mm\n[plate"}, "units must be printable text on one line"),
        ({}, "one point"),
    ],
)
def test_new_refuses_nonsense(keywords: dict[str, object], message: str, tmp_path: Path) -> None:
    solid = mesh(tmp_path, "part.obj")
    if message == "one point":
        solid.write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(InputError, match=message):
        xfrustum.new_scene(solid, tmp_path / "a.toml", **keywords)  # type: ignore[arg-type]
    assert not (tmp_path / "a.toml").exists()


ARCMIN = math.pi / 180 / 60


@pytest.mark.parametrize(
    ("options", "plate", "hogels", "warning"),
    [
        # Cells that an eye sees from nearer than the pitch / 1'.
        (["--plate", "60cm,40cm", "--viewer", "2m"], (600, 400), (1032, 688), None),
        (
            ["--plate", "600,400", "--viewer", "600", "--pitch", "1"],
            (600, 400),
            (600, 400),
            "3,438 mm",
        ),
        (["--size", "55", "--pitch", "0.7"], (80.5, 40.6), (115, 58), None),
        (
            ["--size", "500", "--viewer", "50mm", "--plate", "60,40", "--pitch", "0.02"],
            (60, 40),
            (3000, 2000),
            "behind",
        ),
    ],
)
def test_a_real_plate_gets_hogels_that_its_viewer_does_not_see_as_cells(
    options: list[str],
    plate: tuple[float, float],
    hogels: tuple[int, int],
    warning: str | None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = str(tmp_path / "part.toml")
    arguments = [
        "new",
        str(mesh(tmp_path, "part.obj")),
        "--out",
        path,
        "--units",
        "mm",
        "--json",
        *options,
    ]
    assert main(arguments) == 0
    printed = capsys.readouterr()
    content, scene = json.loads(printed.out), open_scene(path)
    assert scene.plate.size == pytest.approx(plate) and scene.plate.hogels == hogels
    pitch = max(plate[0] / hogels[0], plate[1] / hogels[1])
    assert content["pitch"] == pytest.approx(pitch)
    assert content["cells_within"] == pytest.approx(pitch / ARCMIN)
    assert (
        (warning in content["warning"] and warning in printed.err)
        if warning
        else content["warning"] is None
    )
    # A mesh of no stated size fits the plate.
    low, high = box(scene.objects[0])
    within = np.subtract(high, low)[:2] < plate
    assert within.all() or "--size" in options


def test_a_mesh_whose_up_is_z_stands_upright_and_looks_at_the_viewer(tmp_path: Path) -> None:
    solid = mesh(tmp_path, "part.ply", (1.0, 2.0, 8.0), at=(0.0, 0.0, 100.0))
    written = xfrustum.new_scene(solid, tmp_path / "a.toml", up="z")
    low, high = box(open_scene(str(written.path)).objects[0])
    np.testing.assert_allclose(np.subtract(high, low), (1.0, 8.0, 2.0), atol=1e-4)
    np.testing.assert_allclose(np.add(high, low), 0.0, atol=1e-3)
    assert written.mesh == pytest.approx((1.0, 2.0, 8.0), abs=1e-4)
    # +z, up in the file, is up in the scene; -y, Blender's front, faces the viewer.
    turned = placement(1.0, written.rotate_deg)[:3, :3]
    np.testing.assert_allclose(turned @ [0, 0, 1], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(turned @ [0, -1, 0], [0, 0, 1], atol=1e-15)


# Winding
# -------------------------------------------------------------------------------------------------


def test_a_mesh_wound_the_other_way_is_told_where_faces_are_culled_and_the_scene_file_turns_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    solid, path = trimesh.creation.icosphere(2, 20.0), tmp_path / "a.toml"
    solid.invert()
    solid.export(tmp_path / "inside-out.ply")
    xfrustum.new_scene(tmp_path / "inside-out.ply", path, place="behind", units="mm")
    drawn = [*("raster", str(path), "--near", "0.1", "--out", str(tmp_path / "a.exr")), "--cull"]
    warning = "show back faces, and `--cull back` leaves them out"
    capsys.readouterr()
    for command, expected in (
        (["check", str(path)], 1),
        ([*drawn, "back"], 1),
        ([*drawn, "none"], 0),
    ):
        assert main(command) == 0
        assert capsys.readouterr().err.count(warning) == expected
    wrong = open_scene(str(path)).objects[0]
    path.write_text(path.read_text().replace("# flip_winding", "flip_winding"))
    for command in (["check", str(path)], [*drawn, "back"]):
        assert main(command) == 0
        assert warning not in capsys.readouterr().err
    np.testing.assert_array_equal(open_scene(str(path)).objects[0].faces, wrong.faces[:, ::-1])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_normals_of_a_flipped_mesh_lie_on_the_side_of_its_new_winding(side: float) -> None:
    """Its file has them on the side of its winding or, rightly, on the other one."""
    ball = build_shape("sphere")
    normals = side * np.asarray(smoothed(ball).vertex_normals)
    turned = flipped(replace(ball, vertex_normals=normals)).vertex_normals
    np.testing.assert_array_equal(turned, -np.asarray(smoothed(ball).vertex_normals))


# Surfaces in the plate
# -----------------------------------------------------------------------------------

TILED = "v -20 -20 0\nv 20 -20 0\nv 20 20 0\nv -20 20 0\nf 1 2 3\nf 1 3 4\nf 1 2 2\n"


@pytest.mark.parametrize("off", ["0", "1e-7", "-1e-15"])
def test_a_flat_mesh_is_placed_behind_the_plate_and_new_says_so(
    off: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As flat as rounding makes it; if put into the plate, `new` and `check` warn of that."""
    monkeypatch.chdir(tmp_path)
    Path("flat.obj").write_text(TILED.replace("v 20 20 0", f"v 20 20 {off}"))
    assert main(["new", "flat.obj", "--size", "60"]) == 0
    printed = capsys.readouterr()
    assert (
        "flat, and is placed behind the plate" in printed.err and "behind the plate" in printed.out
    )
    assert box(open_scene("flat.toml").objects[0])[1][2] < -10
    assert main(["check", "flat.toml"]) == 0
    assert "in the plate" not in capsys.readouterr().err
    assert main(["new", "flat.obj", "--units", "mm", "--size", "6cm", "--through", "--force"]) == 0
    assert "2 triangles lie in the plate" in capsys.readouterr().err
    assert main(["check", "flat.toml"]) == 0
    assert "2 of its 3 triangles lie in the plate" in capsys.readouterr().err


def test_what_passes_through_the_plate_or_lies_near_it_raises_no_warning(tmp_path: Path) -> None:
    """A solid across the plate has no triangle in it; a distance that float32 holds is valid."""
    solid = mesh(tmp_path, "part.obj")
    assert xfrustum.new_scene(solid, tmp_path / "a.toml").warning is None
    (tmp_path / "near.toml").write_text(
        film(
            (80.0, 60.0),
            hogels=(9, 7),
            resolution=(16, 16),
            fov_deg=(60.0, 60.0),
            reach=(50.0, 50.0),
        )
        + part("square", 40.0, (0.0, 0.0, 1e-4))
    )
    assert not xfrustum.check(open_scene(str(tmp_path / "near.toml"))).warnings


def test_features_that_are_not_read_are_listed_and_warned_about(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Triangles without area are such, and no aperture sees them."""
    mesh, flat = tmp_path / "a.obj", tmp_path / "flat.obj"
    square = "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv 0 0 0\nl 1 2\n"
    mesh.write_text(square + "f 1 2 3\nf 1 4 3\n")
    flat.write_text("v 0 0 0\nv 1 0 0\nv 3 0 0\nf 1 2 3\nf 1 1 2\n")
    objects = "".join(
        f'\n[[object]]\nmesh = "{name}"\ntranslate = [0.0, 0.0, -20.0]\n'
        for name in ("a.obj", "flat.obj")
    )
    frame = film(
        (20.0, 20.0), hogels=(3, 3), resolution=(8, 8), fov_deg=(60.0, 60.0), reach=(50.0, 50.0)
    )
    (tmp_path / "scene.toml").write_text(named("lines", "mm") + frame + objects)
    assert main(["check", str(tmp_path / "scene.toml"), "--json"]) == 0
    printed = capfd.readouterr()
    content = json.loads(printed.out)
    no_area = "have no area and are not seen"
    assert content["unread"] == [
        {
            "object": 0,
            "file": str(mesh),
            "feature": "lines (l)",
            "consequence": "are not drawn: they have no surface",
        },
        {"object": 0, "file": str(mesh), "feature": "1 of 2 triangles", "consequence": no_area},
        {"object": 1, "file": str(flat), "feature": "2 of 2 triangles", "consequence": no_area},
    ]
    assert content["objects"][0]["sight"]["apertures"] == 9
    assert content["objects"][1]["sight"]["apertures"] == 0
    assert f"warning: {mesh}: 1 of 2 triangles {no_area}\n" in printed.err
    for command in (
        ["trace", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "t.exr")],
        ["new", str(mesh), "--out", str(tmp_path / "new.toml")],
    ):
        assert main(command) == 0
        assert f"warning: {mesh}: lines (l) are not drawn" in capfd.readouterr().err
