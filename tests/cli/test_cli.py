"""The command line: one JSON object on standard output, one line per mistake, no partial files."""

import signal
import stat
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NoReturn

import OpenEXR
import pytest

from tests.support.commands import Command
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.cli.options import engine_of
from xfrustum.scenes.library import builtin

SCENE = (
    named("two boxes", "mm")
    + film(
        (40.0, 30.0), hogels=(5, 3), resolution=(48, 32), fov_deg=(60.0, 40.0), reach=(50.0, 60.0)
    )
    + part("box", 12.0, (3.0, 1.0, 25.0), rotate_deg=(20.0, 30.0, 0.0))
    + part("box", 30.0, (-4.0, 2.0, -35.0))
)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("boxes.toml").write_text(SCENE)
    return "boxes.toml"


@pytest.fixture
def images(scene: str, command: Command) -> tuple[str, str]:
    command(f"trace {scene} --out truth.exr")
    command(f"raster {scene} --near 0.5 --depth d32f --mapping reversed --out raster.exr")
    return "truth.exr", "raster.exr"


def test_scenes_lists_every_builtin_scene_with_its_purpose(command: Command) -> None:
    lines = command("scenes").out.splitlines()
    assert [line.split()[0] for line in lines] == builtin.names()
    assert all(entry.purpose in line for entry, line in zip(builtin.listing(), lines, strict=True))
    entries = command("scenes --json").record["scenes"]
    assert [entry["name"] for entry in entries] == builtin.names()
    assert "report" in command("").out, "without a command the help is shown"


@pytest.mark.usefixtures("images")
def test_compare_prints_the_object_of_the_contract_and_writes_a_picture_of_each_error(
    command: Command,
) -> None:
    printed = command("compare truth.exr raster.exr --json --out errors")
    numbers = printed.record
    assert printed.err == ""
    assert numbers["pixels"] == 48 * 32
    for share in (numbers["surface"], numbers["triangle"]):
        assert share["fraction"] == share["wrong"] / numbers["judged"]
    errors = ("displacement", "height", "radiance", "surface", "triangle")
    names = sorted(path.name for path in Path("errors").iterdir())
    assert names == ["comparison.json", *(f"{error}.png" for error in errors)]


def test_compare_finds_a_scene_that_was_moved_with_its_images(
    images: tuple[str, str], monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    """The scene is looked up beside its images; the message names a broken scene file."""
    Path("moved").mkdir()
    for name in ("boxes.toml", *images):
        Path(name).rename(f"moved/{name}")
    there = "compare moved/truth.exr moved/raster.exr"
    assert command(f"{there} --json").record["surface"] is not None
    with monkeypatch.context() as inside:
        inside.chdir("moved")
        assert command("compare truth.exr raster.exr --json").record["surface"] is not None
    Path("moved/boxes.toml").write_text("plate = 1\n")
    assert "(moved/boxes.toml: plate: " in command(there).err


@pytest.mark.usefixtures("images")
def test_images_of_different_size_are_both_named_with_their_sizes(command: Command) -> None:
    """One of the images has no camera."""
    Path("boxes.toml").write_text(SCENE.replace("[48, 32]", "[40, 36]"))
    command("raster boxes.toml --near 0.5 --out raster.exr")
    channels = OpenEXR.File("truth.exr", separate_channels=True).channels()
    planes = {name: channel.pixels.copy() for name, channel in channels.items()}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, planes).write("truth.exr")
    printed = command("compare truth.exr raster.exr", status=2)
    assert printed.out == "" and printed.err.count("\n") == 1
    assert "truth.exr is 48 x 32 and raster.exr is 40 x 36" in printed.err


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("", "", "boxes.toml: no such scene file)"),
        ("scale = 12.0", "scale = 12.5", "not the one"),
        ("fov_deg", "fovdeg", "frustum.fovdeg; the nearest valid key is frustum.fov_deg)"),
    ],
)
@pytest.mark.usefixtures("images")
def test_without_its_scene_compare_leaves_surface_open_with_a_reason(
    old: str, new: str, reason: str, command: Command
) -> None:
    Path("boxes.toml").unlink()
    if old:
        Path("boxes.toml").write_text(SCENE.replace(old, new))
    printed = command("compare truth.exr raster.exr --json")
    assert printed.record["surface"] is None
    assert printed.err.startswith("xfrustum: note: scene ") and printed.err.count("\n") == 1
    assert reason in printed.err


def test_report_prints_the_best_setting_and_the_path_of_the_page(
    scene: str, command: Command
) -> None:
    line = f"report {scene} --near 1,0.01 --apertures '2,1;0,2' --depth d24 --no-causes"
    files = command(f"{line} --json").record["files"]
    assert files["parquet"] == "report/two-boxes/measurements.parquet"
    printed = command(f"{line} --quiet")
    assert printed.err == ""
    assert printed.out.startswith("At 2 hogels (2,1; 0,2): best of 2 settings: near ")
    assert Path(printed.out.splitlines()[-1]) == Path("report/two-boxes/index.html")


@pytest.mark.usefixtures("scene")
def test_names_that_look_like_addresses_are_local_paths(command: Command) -> None:
    some = "--near 0.1 --apertures 3,2 --quiet"
    command(f"report boxes.toml {some} --depth d24 --no-causes --out run:1")
    assert Path("run:1", "measurements.parquet").exists()
    for _ in range(2):
        command(f"plate boxes.toml {some} --judge --out run:1.zarr")
    command("convert run:1.zarr s3:x --to hogels --quiet")
    assert len(list(Path("s3:x").iterdir())) == 15


LONG = 300 * "n"
"""File name longer than 255 bytes, the limit of file systems."""

BAD = [
    ("figure7", "replaced by `xfrustum study figure7`"),
    ("report boxes.toml --near nan", "near"),
    ("report boxes.toml --near 1e-39", "at least 1.18e-38"),
    ("report boxes.toml --apertures 5,0", "outside the plate"),
    ("report boxes.toml --depth d24:sideways", "sideways"),
    ("report boxes.toml --fit angle,wide", "is not angle, screen or a height"),
    ("report boxes.toml --slabs 15,40;x", "is not lists of heights"),
    ("report boxes.toml --out a-file/below", "a-file"),
    ("trace boxes.toml --samples 3 --out x.exr", "--shadows or --interreflection"),
    ("trace boxes.toml --out no/such/folder/x.exr", "no/such/folder"),
    ("trace boxes.toml --out .", "folder"),
    ("trace boxes.toml --out x.png", "such as x.exr"),
    (
        "camera boxes.toml --for json --near 1 --out x.json",
        "give a folder, such as x, in which cameras.json",
    ),
    ("compare missing.exr missing.exr", "missing.exr"),
    ("compare . .", "is a folder"),
    ("plan boxes.toml --viewer far", "such as 600"),
    ("plate boxes.toml --near 1 --block 0x4 --out x.zarr", "COLUMNSxROWS"),
    ("raster boxes.toml --near 1 --supersample 100000 --out x.exr", "--supersample"),
    ("view boxes.toml --eye 0,0", "X,Y,Z"),
    ("verify boxes.toml {i}x{j}.png --max-wrong 2pixels", "share"),
    ("verify boxes.toml {i}x{j}.png --junit a-file/x.xml", "--junit a-file/x.xml: cannot write"),
    ("verify boxes.toml {i}x{j}.png --timeout inf", "finite"),
    (f"trace boxes.toml --out {LONG}.exr", "File name too long"),
    (f"verify boxes.toml {{i}}x{{j}}{LONG}.png --quiet", "none of its files exists"),
    ("trace boxes.toml --out caf\udce9.exr", r"caf\xe9.exr is not UTF-8"),
    ("verify boxes.toml {i:q}x{j}.png", "{i:q} is no way to write {i}"),
    ("verify boxes.toml --command x{out:5}", "{out:5} is no way to write {out}"),
    ("trace boxes.toml --tracer embree --shadows --out x.exr", "leave out --tracer embree"),
    ("trace boxes.toml --effects diffuse --shadows --out x.exr", "leave out --effects"),
    ("raster boxes.toml --near 1 --effects shiny --out x.exr", "shiny"),
    ("report car --near 1 --fit screen --out x", "fit screen needs a recentered frustum"),
    ("report car --near 1 --slabs 40,15 --out x", "ascending order"),
    ("report car --near 1 --slabs 15;1e4 --out x", "within the reach"),
    (
        "report car --offset none --near 3 --slabs none;2 --out x",
        "without an offset must be smaller than 2",
    ),
    ("plan asymmetric --tolerance-px -1", "'--tolerance-px': '-1' is not a"),
    ("plan asymmetric --aperture 1,1 --apertures 3", "--aperture"),
    ("plan boxes.toml --ipd=60", "give --viewer too"),
    ("plan boxes.toml --viewer=600mm --aperture=1,1", "leave out"),
    ("plan boxes.toml --viewer=600parsec", "not known"),
    ("plan boxes.toml --viewer=5mm --ipd=30 --quiet", "larger distance"),
    ("plate asymmetric --truth --near 0.1 --out x.zarr", "leave out --near"),
    ("plate asymmetric --near 0.1 --shadows --out x.zarr", "add --truth"),
    ("plate asymmetric --near 0.1 --channels certainty --out x.zarr", "certainty"),
    ("plate asymmetric --near 0.1 --out x.zarr --apertures=", "--apertures"),
    ("plate asymmetric --near 0.1 --out x.zarr --apertures=4-2,0", "--apertures"),
    ("plate asymmetric --near 0.1 --out x.zarr --apertures=-1,0", "--apertures"),
    ("plate asymmetric --near 0.1 --out x.zarr --apertures=0-81,3", "outside the plate"),
    ("verify boxes.toml {i}x{j}.exr --part 1/2", "give --out too"),
    ("verify boxes.toml . --workers 2 --layout hogels", "leave out --workers and the like"),
    ("verify boxes.toml {i}x{j}.exr --workers 2 --scheduler tcp://h:1", "leave out --workers"),
    ("view boxes.toml --eye=0,0,-5", "before the plate"),
    ("view boxes.toml --eye=0,0,600 --near=1 --plate=x.zarr", "one of them"),
    ("view boxes.toml --eye=0,0,600 --plate=nowhere.zarr", "is no plate"),
    ("view boxes.toml --eye=0,0,600 --encoding=rgb", "needs --images"),
    ("view boxes.toml --eye=0,0,600 --quilt=2x2", "needs --out"),
    ("view boxes.toml --eye=1e200,0,1 --near=0.5", "bring it nearer"),
    ("camera asymmetric --for json --out x", "need --near"),
    ("camera asymmetric --for blender --near 1 --out x", "leave out --near"),
    ("survey boxes.toml --sample 3 --out x", "give --near or --nears"),
    ("survey boxes.toml --near 1 --nears 1,2 --out x", "give one of them"),
    ("survey boxes.toml --near 1 --all --sample 3 --out x", "exclude each other"),
    ("survey boxes.toml --near 1 --until 1% --part 1/2 --out x", "use --all or --sample"),
    ("survey boxes.toml --images x --out x", "verify SCENE SOURCE --sample N"),
    ("survey boxes.toml --near 1 --truth-by directions --out x", "give --all too"),
    ("survey boxes.toml --near 1 --part 3/2 --out x", "parts run from 1/2"),
    (
        "survey boxes.toml --near 1 --all --part 1/2 --workers 2 --out x",
        "leave out --scheduler and --workers",
    ),
    (
        "survey boxes.toml --near 1 --scheduler tcp://h:1 --devices 0 --out x",
        "--devices are for processes of",
    ),
    ("bench truth crossing --resolution 0", "positive whole numbers"),
    ("bench truth empty", "has no triangles to measure"),
    ("verify boxes.toml {i}.png", "{j}"),
    ("verify boxes.toml {i-{j}.png", "SOURCE"),
    ("verify boxes.toml", "either SOURCE"),
    ("verify boxes.toml {i}-{j}.png --command x{out}", "either SOURCE"),
    ("verify boxes.toml --command x{i}", "{out}"),
    ("verify boxes.toml --command 'x{out}", "quotes"),
    ("verify boxes.toml {i}-{j}.png --accept colors", "colors"),
    ("verify boxes.toml {i}-{j}.png --approve", "--approve is about --baseline DIR"),
    (
        "verify boxes.toml {i}-{j}.png --baseline kept --baseline-tolerance wrong=3",
        "'wrong' is not one of",
    ),
    ("verify boxes.toml {i}-{j}.png --baseline boxes.toml", "--baseline boxes.toml"),
    (
        "plate boxes.toml --near 1 --layout views --apertures 0,0 --out x.zarr",
        "leave out --apertures and",
    ),
    (
        "plate boxes.toml --near 1 --layout views --channels height --out x.zarr",
        "color or triangle",
    ),
    ("plate boxes.toml --near 1 --layout views --ids --out x", "let the name end in .zarr"),
    ("plate boxes.toml --near 1 --multisample 64 --quiet --out x.zarr", "too fine"),
    ("cost boxes.toml --aperture 1,1 --apertures auto --quiet", "give one of them"),
    ("trace boxes.toml --decided-by mitsuba --tracer embree --out x.exr", "--decided-by mitsuba"),
    ("convert boxes.toml out --to polaroid", "'polaroid' is not one of"),
    ("convert nowhere out --to views", "no such file or folder"),
    ("unknown", "unknown"),
    ("scenes --unknown", "--unknown"),
]


@pytest.mark.parametrize(("line", "word"), BAD)
def test_bad_input_is_one_line_status_2_and_nothing_written(
    line: str, word: str, scene: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a-file").touch()
    assert main(line.split()) == 2
    printed = capfd.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    assert printed.err.startswith("xfrustum: error: ")
    assert word in printed.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-file", scene]


@pytest.mark.parametrize(
    ("line", "work"),
    [
        ("cost boxes.toml", "reports.cost.cost"),
        ("verify boxes.toml {i}x{j}.png", "reports.verification.verification.verify"),
        ("compare a.exr b.exr", "reports.image_files.compare_files"),
        ("study figure7 boxes.toml", "research.paper.write_figure"),
    ],
)
@pytest.mark.usefixtures("scene")
def test_a_folder_that_cannot_be_written_is_reported_before_any_work(
    line: str, work: str, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    Path("a-file").touch()
    monkeypatch.setattr(f"xfrustum.{work}", lambda *args, **how: pytest.fail("was begun"))
    message = command(f"{line} --out a-file", status=2).err
    assert "--out a-file: a-file is not a folder" in message


@pytest.mark.usefixtures("scene")
def test_an_unexpected_error_is_status_70_one_line_and_a_traceback_in_a_file(
    monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    def broken(_: str) -> NoReturn:
        raise MemoryError

    monkeypatch.setattr("xfrustum.scenes.open_scene", broken)
    Path("temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(Path("temporary").absolute()))
    printed = command("trace boxes.toml --out x.exr", status=70)
    assert printed.out == "" and printed.err.count("\n") == 1
    assert printed.err.startswith("xfrustum: unexpected error: MemoryError")
    (file,) = Path("temporary").iterdir()
    assert printed.err.split()[-1] == str(file.absolute())
    assert "in broken" in file.read_text() and stat.S_IMODE(file.stat().st_mode) == 0o600
    file.unlink()
    trace = command("--traceback trace boxes.toml --out x.exr", status=70).err
    assert trace.startswith("Traceback (most recent call last)") and "in broken" in trace
    assert list(Path("temporary").iterdir()) == []


def test_a_command_called_from_python_leaves_the_programs_own_signals_alone() -> None:
    def own(*_: object) -> None: ...

    for before in (own, signal.SIG_DFL):
        signal.signal(signal.SIGTERM, before)
        with ThreadPoolExecutor() as pool:
            assert (main(["scenes"]), pool.submit(main, ["scenes"]).result()) == (0, 0)
        assert signal.getsignal(signal.SIGTERM) is before


def test_a_part_of_a_job_array_has_one_process_unless_more_are_stated() -> None:
    alone, pair = engine_of((1, 3)), engine_of((1, 1), workers=2)
    assert alone is not None and pair is not None and engine_of(workers=None) is None
    assert (alone.workers, alone.part.number, pair.workers) == (1, 1, 2)
