"""Files are complete or absent, even if a disk is full or a process is killed."""

import os
import re
import signal
import socket
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.support.limited_disk import run
from tests.support.long_tail import kept
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.reports.common.outputs import Staging, check_writable_file, write_output
from xfrustum.scenes import InputError
from xfrustum.scenes.disk import _host, remove_abandoned, write_file

FILM = film(
    (80.0, 60.0), hogels=(2, 1), resolution=(32, 24), fov_deg=(60.0, 60.0), reach=(150.0, 150.0)
)
SCENE = named("small") + FILM + part("square", 60.0, (0.0, 0.0, -60.0))


def made_by_us(folder: Path) -> list[Path]:
    return sorted(folder.glob(".xfrustum-*"))


def left_behind(folder: Path, what: str) -> subprocess.Popen[str]:
    """Start a process that opens a temporary file or folder and waits to be killed."""
    program = f"""
import sys, time
from pathlib import Path
from xfrustum.scenes.disk import TempPath, new_file
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


def commit(out: Path, name: str, content: str) -> None:
    """Write a folder of outputs with one file."""
    with Staging(out, [name]) as staging:
        (staging.folder / name).write_text(content)
        staging.commit()


def test_links_stay_and_their_targets_are_replaced(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    target = tmp_path / "far" / "target.xml"
    target.write_text("old")
    target.chmod(0o640)
    (tmp_path / "middle.xml").symlink_to(target)
    (tmp_path / "link.xml").symlink_to("middle.xml")
    (tmp_path / "out").mkdir()
    (tmp_path / "page.html").write_text("old")
    (tmp_path / "out" / "index.html").symlink_to("../page.html")
    (tmp_path / "dangling").symlink_to("new")
    before = target.stat().st_ino
    for name in ("link.xml", "dangling"):
        write_output(tmp_path / name, b"new")
    commit(tmp_path / "out", "index.html", "new")
    links = ["link.xml", "middle.xml", "dangling", "out/index.html"]
    assert all((tmp_path / name).is_symlink() for name in links)
    assert [(tmp_path / name).read_text() for name in ("new", "page.html")] == ["new", "new"]
    assert target.read_text() == "new" and target.stat().st_ino != before
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_a_device_is_written_into_and_stays_and_a_disk_is_refused(tmp_path: Path) -> None:
    device, disk = tmp_path / "null", tmp_path / "disk"
    try:
        os.mknod(disk, 0o600 | stat.S_IFBLK, os.makedev(7, 250))
        os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
        device.write_bytes(b"")
    except PermissionError:
        pytest.skip("needs the right to make and open devices")
    before = device.stat()
    write_output(device, b"new")
    with pytest.raises(InputError, match=r"--junit .*: is a block device"):
        check_writable_file(disk, "--junit")
    with pytest.raises(InputError, match="is a block device"):
        write_output(disk, b"new", "--junit")
    assert (device.stat().st_ino, device.stat().st_rdev) == (before.st_ino, before.st_rdev)
    assert made_by_us(tmp_path) == []


def test_a_pipe_is_written_into(
    images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(images)
    pipe = tmp_path / "pipe.exr"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as pool:
        read = pool.submit(pipe.read_bytes)
        assert main([*DRAWN.split(), str(pipe)]) == 0
        assert read.result() == Path("1x0.exr").read_bytes()
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_standard_output_of_any_kind_is_written(tmp_path: Path) -> None:
    """A file that receives standard output keeps all text, printed before and after."""
    (tmp_path / "link").symlink_to("/dev/stdout")
    names = ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "link"]
    program = """
import sys
from pathlib import Path
from xfrustum.scenes.disk import write_file
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


def test_unwritable_targets_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("loop").symlink_to("loop")
    Path("file").write_text("text")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind("socket")
    for name in ("folder", "socket", "loop", "missing/x.xml", "file/x.xml"):
        with pytest.raises(InputError, match=f"^--junit {name}: [^\n]+$"):
            check_writable_file(Path(name), "--junit")
    listening.close()
    assert stat.S_ISSOCK(Path("socket").stat().st_mode) and Path("loop").is_symlink()
    Path("socket").rename("folder/index.html")
    with pytest.raises(InputError, match=r"index\.html in it is a socket"):
        commit(Path("folder"), "index.html", "new")


@pytest.mark.parametrize(
    "what", ["TempPath(Path())", "TempPath(Path(), folder=True)", "new_file(Path('x'))"]
)
def test_files_of_killed_processes_go_and_files_of_living_ones_stay(
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


def test_only_files_with_our_prefix_are_removed(tmp_path: Path) -> None:
    names = [".xfrustum-", ".xfrustum-notes.txt", "xfrustum-01234567"]
    names += [f".xfrustum-00000000-{pid}-01234567" for pid in (os.getpid(), 999_999_999)]
    for name in names:
        (tmp_path / name).write_text("mine")
    (tmp_path / ".xfrustum-abcdefgh").symlink_to("xfrustum-01234567")
    remove_abandoned(tmp_path)
    assert len(list(tmp_path.iterdir())) == len(names) + 1


@pytest.mark.parametrize("made", [True, False])
def test_a_folder_of_outputs_removes_leftovers_inside_and_beside_it(
    made: bool, tmp_path: Path
) -> None:
    for place in (tmp_path, tmp_path / "out")[: 1 + made]:
        left = place / f".xfrustum-{_host()}-999999999-0a1b2c3d"
        left.mkdir(parents=True)
        (left / "index.html").write_text("half")
    commit(tmp_path / "out", "x", "whole")
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
    # One process for each number of renames, forked so that Python starts once
    subprocess.run([sys.executable, "-c", program, *folders], check=True)
    contents = ["".join(sorted(path.name for path in (f / "new").glob("out/*"))) for f in folders]
    assert set(contents) == {"", "xyz"}


def test_a_file_gets_its_name_only_after_it_is_synced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The content is synced first and, after the renaming, the folder that lists the name."""
    path, seen, fsync = tmp_path / "x", list[tuple[bool, bool]](), os.fsync

    def watched(descriptor: int) -> None:
        seen.append((stat.S_ISDIR(os.fstat(descriptor).st_mode), path.exists()))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    write_file(path, b"content")
    path.unlink()
    commit(tmp_path, "x", "content")
    assert seen == [(False, False), (True, True)] * 2


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
        write_file(tmp_path / "x", b"")
        commit(tmp_path / "out", "x", "content")
    finally:
        os.umask(mask)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("x", "out")]
    assert modes == [0o640, 0o750]


# Full disks, at any byte: a command leaves complete files, or reports the error and leaves none.

TRUTH, DRAWN = "trace scene.toml --quiet --out", "raster scene.toml --near 0.1 --out"
COMMANDS = {
    "trace": f"{TRUTH} out/x.exr",
    "compare": "compare truth.exr 1x0.exr --out out/folder",
    "verify": "verify scene.toml {i}x{j}.exr --apertures 1,0 --quiet --out out/v --junit out/x.xml",
    "plate": "plate scene.toml --near 0.1 --ids --quiet --out out/x.zarr",
}


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene, its truth, and its raster."""
    images = tmp_path_factory.mktemp("disk")
    (images / "scene.toml").write_text(SCENE)
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(images)
        assert main([*TRUTH.split(), "truth.exr"]) == main([*DRAWN.split(), "1x0.exr"]) == 0
    return images


@pytest.mark.parametrize("command", kept(COMMANDS, ["trace"]))
def test_files_are_whole_or_absent_wherever_the_disk_is_full(
    command: str, images: Path, request: pytest.FixtureRequest
) -> None:
    """OpenEXR writes its last bytes on closing, and then reports no error."""
    size = (images / "truth.exr").stat().st_size
    limits = [400, size - 300, size - 1] if command == "trace" else [400]
    if request.node.get_closest_marker("slow"):
        limits += range(1, 12_000, 97)
    *outcomes, whole = run(COMMANDS[command].split(), [*limits, 1 << 40], images)
    assert whole.status in (0, 1) and whole.files, whole
    failed = [outcome for outcome in outcomes if outcome.status != whole.status]
    assert failed and all(o.files == whole.files for o in outcomes if o not in failed)
    for outcome in failed:
        assert outcome.status == 2, outcome
        assert re.fullmatch(r"xfrustum: error: [^\n]+\n", outcome.error), outcome
        # A plate keeps its finished hogels, and a complete folder remains if another file fails.
        assert all(name.startswith(("x.zarr", "v")) for name in outcome.files), outcome
        assert outcome.files.items() <= whole.files.items(), outcome
