"""Files are whole or absent, though a disk is full or a process killed."""

import os
import re
import signal
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.support.limited_disk import run
from tests.support.long_tail import kept
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.reports.common.outputs import Staging, check_writable_file, write_output
from xfrustum.scenes import InputError
from xfrustum.scenes.disk.durable import _host, new_file, remove_abandoned, write_file

FILM = film(
    (80.0, 60.0), hogels=(1, 1), resolution=(16, 12), fov_deg=(60.0, 60.0), reach=(150.0, 150.0)
)
SCENE = named("small") + FILM + part("square", 60.0, (0.0, 0.0, -60.0))

VERIFY = "verify scene.toml {i}x{j}.exr --quiet --junit"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene and a renderer's image of it."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    assert main(["raster", "scene.toml", "--near", "0.001", "--out", "0x0.exr"]) == 0
    return tmp_path


def made_by_us(folder: Path) -> list[Path]:
    return sorted(folder.glob(".xfrustum-*"))


def left_behind(folder: Path, what: str) -> subprocess.Popen[str]:
    """Start a process that makes something aside in a folder and waits to be killed."""
    program = f"""
import sys, time
from pathlib import Path
from xfrustum.scenes.disk.durable import TempPath, new_file
made = {what}
made.__enter__()
print("made", flush=True)
time.sleep(600)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=folder
    )
    assert process.stdout is not None and process.stdout.readline() == "made\n"
    return process


def test_links_stay_and_what_they_point_to_is_replaced(folder: Path) -> None:
    (folder / "far").mkdir()
    target = folder / "far" / "target.xml"
    target.write_text("old")
    target.chmod(0o640)
    (folder / "middle.xml").symlink_to(target)
    (folder / "link.xml").symlink_to("middle.xml")
    (folder / "out").mkdir()
    (folder / "page.html").write_text("old")
    (folder / "out" / "index.html").symlink_to("../page.html")
    before = target.stat().st_ino
    assert main([*VERIFY.split(), "link.xml", "--out", "out"]) == 0
    assert (folder / "out" / "index.html").is_symlink()
    assert (folder / "page.html").read_text().rstrip().endswith("</html>")
    assert (folder / "link.xml").is_symlink() and (folder / "middle.xml").is_symlink()
    assert target.read_text().startswith("<?xml") and target.stat().st_ino != before
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    (folder / "dangling").symlink_to("new")
    write_file(folder / "dangling", b"new")
    assert (folder / "dangling").is_symlink() and (folder / "new").read_bytes() == b"new"


def test_a_device_is_written_into_and_stays_and_a_disk_is_refused(folder: Path) -> None:
    device = folder / "null"
    try:
        os.mknod(folder / "disk", 0o600 | stat.S_IFBLK, os.makedev(7, 250))
        os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
        device.write_bytes(b"")
    except PermissionError:
        pytest.skip("needs the right to make and open devices")
    before = device.stat()
    assert main([*VERIFY.split(), "null"]) == 0
    assert main([*VERIFY.split(), str(folder / "x.xml"), "--out", "out"]) == 0
    with pytest.raises(InputError, match=r"--junit .*: is a block device"):
        check_writable_file(folder / "disk", "--junit")
    with pytest.raises(InputError, match="is a block device"):
        write_output(folder / "disk", b"new", "--junit")
    assert (device.stat().st_ino, device.stat().st_rdev) == (before.st_ino, before.st_rdev)
    assert made_by_us(folder) == []


def test_a_pipe_is_written_into(folder: Path) -> None:
    os.mkfifo(folder / "pipe.exr")
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append((folder / "pipe.exr").read_bytes()))
    reader.start()
    assert main(["raster", "scene.toml", "--near", "0.001", "--out", "pipe.exr"]) == 0
    reader.join()
    assert read == [(folder / "0x0.exr").read_bytes()]
    assert stat.S_ISFIFO((folder / "pipe.exr").stat().st_mode)


def test_standard_output_is_written_into_whatever_it_is(tmp_path: Path) -> None:
    """A file that standard output goes to keeps all text, printed before and after."""
    (tmp_path / "link").symlink_to("/dev/stdout")
    names = ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "link"]
    program = """
import sys
from pathlib import Path
from xfrustum.scenes.disk.durable import write_file
for name in sys.argv[1:]:
    print("before", flush=True)
    write_file(Path(name), b"content\\n")
    print("after", flush=True)
"""
    with (tmp_path / "log").open("w") as log:
        subprocess.run(
            [sys.executable, "-c", program, *names], stdout=log, check=True, cwd=tmp_path
        )
    assert (tmp_path / "log").read_text() == "before\ncontent\nafter\n" * len(names)


def test_what_no_file_can_be_written_into_is_refused_in_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind("socket")
    for name in ("folder", "socket", "loop", "missing/x.xml", "scene.toml/x.xml"):
        capsys.readouterr()
        assert main([*VERIFY.split(), name]) == 2, name
        error = capsys.readouterr().err
        assert error.startswith(f"xfrustum: error: --junit {name}: ") and error.count("\n") == 1
    listening.close()
    assert stat.S_ISSOCK((folder / "socket").stat().st_mode) and (folder / "loop").is_symlink()
    (folder / "out").mkdir()
    (folder / "socket").rename(folder / "out" / "index.html")
    with (
        pytest.raises(InputError, match=r"index\.html in it is a socket"),
        Staging(Path("out"), ["index.html"]),
    ):
        pytest.fail("was begun")


@pytest.mark.parametrize(
    "what", ["TempPath(Path())", "TempPath(Path(), folder=True)", "new_file(Path('x'))"]
)
def test_what_a_killed_process_left_goes_and_what_a_living_one_makes_stays(
    what: str, tmp_path: Path
) -> None:
    processes = [left_behind(tmp_path, what) for _ in range(2)]
    try:
        assert len(made_by_us(tmp_path)) == 2
        remove_abandoned(tmp_path)
        assert len(made_by_us(tmp_path)) == 2
        processes[0].send_signal(signal.SIGKILL)
        processes[0].wait()
        remove_abandoned(tmp_path)
        assert len(made_by_us(tmp_path)) == 1
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    write_file(tmp_path / "other", b"anything")
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_only_what_bears_our_name_is_removed(tmp_path: Path) -> None:
    names = [".xfrustum-", ".xfrustum-notes.txt", "xfrustum-01234567"]
    names += [f".xfrustum-00000000-{pid}-01234567" for pid in (os.getpid(), 999_999_999)]
    for name in names:
        (tmp_path / name).write_text("mine")
    (tmp_path / ".xfrustum-abcdefgh").symlink_to("xfrustum-01234567")
    remove_abandoned(tmp_path)
    assert len(list(tmp_path.iterdir())) == len(names) + 1


@pytest.mark.parametrize("made", [True, False])
def test_a_folder_of_outputs_removes_what_was_left_there_and_beside_it(
    made: bool, tmp_path: Path
) -> None:
    for place in (tmp_path, tmp_path / "out") if made else (tmp_path,):
        place.mkdir(exist_ok=True)
        left = place / f".xfrustum-{_host()}-999999999-0a1b2c3d"
        left.mkdir()
        (left / "index.html").write_text("half")
    with Staging(tmp_path / "out", ["x"]) as staging:
        (staging.folder / "x").write_text("whole")
        staging.commit()
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["out", "x"]


def test_a_new_folder_of_outputs_has_all_its_files_or_is_not_there_whenever_the_process_is_killed(
    tmp_path: Path,
) -> None:
    program = """
import os, signal, sys
from pathlib import Path
from xfrustum.reports.common.outputs import Staging
left = 0
def watched(event, arguments):
    global left
    if event == "os.rename":
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(watched)
for number, folder in enumerate(sys.argv[1:]):
    if os.fork():
        os.wait()
        continue
    left = number
    os.chdir(folder)
    with Staging(Path("new") / "out", "xyz") as staging:
        for name in staging.names:
            (staging.folder / name).write_text("whole")
        staging.commit()
    os._exit(0)
"""
    folders = [tmp_path / str(renames) for renames in range(4)]
    for folder in folders:
        folder.mkdir()
    # One process for each number of renames; they are forked, so that Python starts once.
    subprocess.run([sys.executable, "-c", program, *folders], check=True)
    contents = ["".join(sorted(path.name for path in (f / "new").glob("out/*"))) for f in folders]
    assert set(contents) == {"", "xyz"}


def test_nothing_has_its_name_before_it_is_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both the content and, after the renaming, the folder with the name are forced to the disk."""
    path, seen = tmp_path / "x", []
    fsync = os.fsync

    def watched(descriptor: int) -> None:
        seen.append((stat.S_ISDIR(os.fstat(descriptor).st_mode), path.exists()))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    write_file(path, b"content")
    assert seen == [(False, False), (True, True)]
    seen.clear()
    path.unlink()
    with Staging(tmp_path, ["x"]) as staging:
        (staging.folder / "x").write_text("content")
        staging.commit()
    assert seen == [(False, False), (True, True)]


def test_an_error_of_the_disk_keeps_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x").write_text("old")

    def failing(descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", failing)
    with pytest.raises(InputError, match=r"--junit .*Input/output error"):
        write_output(tmp_path / "x", b"new", "--junit")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("x", "old")]


def test_permissions_are_those_that_files_get(tmp_path: Path) -> None:
    mask = os.umask(0o027)
    try:
        with new_file(tmp_path / "x"):
            pass
        with Staging(tmp_path / "out", ["x"]) as staging:
            (staging.folder / "x").write_text("content")
            staging.commit()
    finally:
        os.umask(mask)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("x", "out")]
    assert modes == [0o640, 0o750]


# A disk that is full at any byte: files are whole, or the command reports it and leaves none.

DISK_SCENE = SCENE.replace("hogels = [1, 1]", "hogels = [2, 1]").replace("[16, 12]", "[32, 24]")
TRUTH, DRAWN = "trace scene.toml --quiet --out", "raster scene.toml --near 0.1 --out"
COMMANDS = {
    "trace": f"{TRUTH} out/x.exr",
    "compare": "compare truth.exr 1x0.exr --out out/folder",
    "verify": "verify scene.toml {i}x{j}.exr --apertures 1,0 --quiet --out out/v --junit out/x.xml",
    "plate": "plate scene.toml --near 0.1 --ids --quiet --out out/x.zarr",
}


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene, its truth, and its raster."""
    images = tmp_path_factory.mktemp("disk")
    (images / "scene.toml").write_text(DISK_SCENE)
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(images)
        assert main([*TRUTH.split(), "truth.exr"]) == 0
        assert main([*DRAWN.split(), "1x0.exr"]) == 0
    return images


@pytest.mark.parametrize("command", kept(COMMANDS, ["trace", "plate"]))
def test_files_are_whole_or_absent_wherever_the_disk_is_full(
    command: str, images: Path, request: pytest.FixtureRequest
) -> None:
    """OpenEXR writes the last bytes when it closes, and reports no error then."""
    size = (images / "truth.exr").stat().st_size
    limits = [400, size - 300, size - 1] if command == "trace" else [400]
    if request.node.get_closest_marker("slow"):
        limits += range(1, 12_000, 97)
    *outcomes, whole = run(COMMANDS[command].split(), [*limits, 1 << 40], images)
    assert whole.status in (0, 1) and whole.files, whole
    for outcome in outcomes:
        if outcome.status == whole.status:
            assert outcome.files == whole.files, outcome
            continue
        assert outcome.status == 2, outcome
        assert re.fullmatch(r"xfrustum: error: [^\n]+\n", outcome.error), outcome
        # The plate's finished hogels stay, and a folder that is complete when another file fails.
        assert all(name.startswith(("x.zarr", "v")) for name in outcome.files), outcome
        assert outcome.files.items() <= whole.files.items(), outcome
    assert 2 in {outcome.status for outcome in outcomes}
