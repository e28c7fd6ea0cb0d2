"""A release: the wheel, built from the source distribution, runs where the checkout cannot be seen."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
PRINT_FILE_OF_EVERY_MODULE = """
import importlib, pkgutil, xfrustum
print(xfrustum.__file__)
for module in pkgutil.walk_packages(xfrustum.__path__, "xfrustum."):
    print(importlib.import_module(module.name).__file__)
"""


@dataclass(frozen=True)
class Installation:
    wheel: Path
    environment: Path

    def run(self, program: str, *arguments: str) -> str:
        """Run a program of the environment from a folder outside the checkout; return what it prints."""
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        done = subprocess.run(
            [self.environment / "bin" / program, *arguments],
            cwd=self.environment.parent,
            env=clean,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


def packaged_files() -> set[str]:
    """Every file under the import name, through the links to the folders at the top."""
    source = CHECKOUT / "src"
    return {
        (Path(folder) / file).relative_to(source).as_posix()
        for folder, _, files in os.walk(source / "xfrustum", followlinks=True)
        for file in files
        if "__pycache__" not in folder
    }


@pytest.fixture(scope="module")
def installation(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """A fresh environment with the wheel in it, and the dependencies of this one in sight.

    A path file adds the folder of the dependencies to the search path only: the path files
    *in* that folder are not read, so the editable install there stays out of sight.
    """
    place = tmp_path_factory.mktemp("release")
    build: list[str | Path]
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", place, CHECKOUT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = place.glob("*.whl")

    environment = place / "environment"
    venv.create(environment, symlinks=True)
    pip: list[str | Path] = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python"]
    subprocess.run([*pip, "install", "--no-index", "--no-deps", wheel], check=True, capture_output=True)

    (site_packages,) = environment.glob("lib/python*/site-packages")
    seen = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (site_packages / "dependencies.pth").write_text("\n".join(sorted(seen)))
    return Installation(wheel, environment)


def test_the_wheel_holds_every_file_once(installation: Installation) -> None:
    held = [name for name in zipfile.ZipFile(installation.wheel).namelist() if name.startswith("xfrustum/")]
    assert sorted(held) == sorted(packaged_files())
    suffixes = {Path(name).suffix for name in held}
    assert {".vert", ".frag", ".j2", ".typed"} <= suffixes


@pytest.mark.slow
def test_every_module_comes_from_the_wheel(installation: Installation) -> None:
    files = [Path(line) for line in installation.run("python", "-c", PRINT_FILE_OF_EVERY_MODULE).splitlines()]
    assert len(files) == len({name for name in packaged_files() if name.endswith(".py")})
    assert [file for file in files if not file.is_relative_to(installation.environment)] == []


def test_the_installed_command_lists_the_scenes(installation: Installation) -> None:
    assert "car" in installation.run("xfrustum", "scenes")
