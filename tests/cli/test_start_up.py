"""Help, listings and complaints come at once: nothing that draws, traces or reads meshes is loaded for them.

No time is measured, for it depends on the machine; loading these libraries is what takes the time.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.cli.test_help import commands, words
from tests.support.scene_file import film, named, part

HEAVY = (
    "trimesh", "scipy", "mitsuba", "drjit", "embreex", "moderngl", "OpenGL", "pyarrow", "plotly", "zarr",
    "jinja2", "PIL", "OpenEXR", "skimage", "matplotlib", "xarray", "distributed",
)  # fmt: skip
"""Libraries that take from a tenth of a second to some seconds to load."""

SCENE = named("boxes", "mm") + film(
    (40.0, 30.0), hogels=(5, 3), resolution=(48, 32), fov_deg=(60.0, 40.0), reach=(50.0, 60.0)
)
FILES = {
    "broken.toml": SCENE.replace("fov_deg", "fovdeg"),
    "none.toml": "= =",
    "meshless.toml": SCENE
    + part("box", 1.0, (0.0, 0.0, 9.0)).replace('shape = "box"', 'mesh = "nosuch.obj"'),
    "unlit.toml": SCENE + '[environment]\nmap = "nosuch.exr"\n',
    "strange.toml": SCENE + '[[object]]\nshape = "bax"\nmaterial = "gold"\n',
}

STRANGE_VALUES = (
    ("raster", "car", "--near", "0.1", "--depth", "d99", "--out", "x.exr"),
    ("raster", "car", "--near", "-1", "--out", "x.exr"),
    ("report", "car", "--depth", "d24:strange"),
    ("report", "car", "--supersample", "0"),
    ("report", "car", "--fit", "nothing"),
    ("trace", "car", "--tracer", "strange", "--out", "x.exr"),
    ("plate", "car", "--near", "0.1", "--color", "int7", "--out", "x.zarr"),
    ("plate", "car", "--near", "0.1", "--apertures", "a,b", "--out", "x.zarr"),
    ("verify", "car", "x.png", "--accept", "strange"),
    ("plan", "car", "--apertures", "none"),
    ("compare", "nosuch.exr", "nosuch.exr"),
    ("new", "nosuch.obj"),
    ("strange",),
)


def loaded_by(lines: Sequence[Sequence[str]], folder: Path, watched: Sequence[str]) -> dict[str, list[str]]:
    """Run command lines in one new process; return what each but the help and the listing has loaded."""
    program = f"""
import contextlib, io, json, sys
from xfrustum.cli.main import main
told = {{}}
for line in json.loads({json.dumps(json.dumps(list(lines)))}):
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        status = main(line)
    assert status == (0 if "--help" in line or line[0] == "scenes" else 2), (line, status)
    found = [name for name in {list(watched)!r} if name in sys.modules]
    if found:
        told[" ".join(line)] = found
        break
print(json.dumps(told))
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=folder, check=False
    )
    assert ended.returncode == 0, ended.stderr
    found: dict[str, list[str]] = json.loads(ended.stdout)
    return found


def of_scene(scene: str) -> list[tuple[str, ...]]:
    """Return the examples of all commands that open a scene, with another scene."""
    found = []
    for name, command in commands().items():
        if any(parameter.name in ("scene", "scenes") for parameter in command.params):
            before = len(name.split())
            found.append((*name.split(), scene, *words(name)[before + 1 :]))
    return found


def test_help_listings_and_complaints_load_nothing_heavy_not_even_numpy(tmp_path: Path) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    files = [line for name in (*FILES, "nosuch.toml") for line in of_scene(name)]
    helped = [(*name.split(), "--help") for name in commands()]
    lines = [("--help",), ("scenes",), *helped, *STRANGE_VALUES, *files]
    assert loaded_by(lines, tmp_path, (*HEAVY, "numpy")) == {}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


def test_unknown_names_and_the_list_of_hard_cases_load_numpy_alone(tmp_path: Path) -> None:
    lines = [("scenes", "--hard"), *of_scene("nosuch"), *of_scene("hard/nosuch")]
    assert loaded_by(lines, tmp_path, HEAVY) == {}
