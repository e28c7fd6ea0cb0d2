"""An installation holds every file once and runs where the checkout cannot be seen, however it was made."""

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


@dataclass(frozen=True)
class Environment:
    """A fresh virtual environment that sees the dependencies of this one.

    A path file adds the folders of the dependencies to the search path only: the path files *in* them are not
    read, so the editable install there stays out of sight.
    """

    folder: Path

    @classmethod
    def made(cls, folder: Path) -> Environment:
        venv.create(folder, symlinks=True)
        (site_packages,) = folder.glob("lib/python*/site-packages")
        seen = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
        (site_packages / "dependencies.pth").write_text("\n".join(sorted(seen)))
        return cls(folder)

    def run(self, program: str | Path, *arguments: str | Path) -> str:
        """Run a program, by name one of this environment, outside the checkout; return what it prints."""
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        done = subprocess.run(
            [self.folder / "bin" / program, *arguments],
            cwd=self.folder.parent,
            env=clean,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def install(self, *what: str | Path) -> None:
        """Install without a network."""
        python = self.folder / "bin" / "python"
        offline = ("--no-deps", "--no-build-isolation", "--no-index")
        self.run(sys.executable, "-m", "pip", "--python", python, "install", *offline, *what)

    def installed_files(self) -> list[str]:
        (site_packages,) = self.folder.glob("lib/python*/site-packages")
        return sorted(
            path.relative_to(site_packages).as_posix()
            for path in (site_packages / "xfrustum").rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        )


def packaged_files() -> list[str]:
    """Every file under the import name, through the links to the folders at the top."""
    source = CHECKOUT / "src"
    return sorted(
        (Path(folder) / file).relative_to(source).as_posix()
        for folder, _, files in os.walk(source / "xfrustum", followlinks=True)
        for file in files
        if "__pycache__" not in folder
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of a release, built from the source distribution."""
    place = tmp_path_factory.mktemp("release")
    build: list[str | Path]
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", place, CHECKOUT]
    subprocess.run(build, check=True, capture_output=True)
    (made,) = place.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installation(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    environment = Environment.made(tmp_path_factory.mktemp("installed") / "environment")
    environment.install(wheel)
    return environment


def test_the_wheel_of_the_source_distribution_holds_every_file_once(wheel: Path) -> None:
    held = [name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("xfrustum/")]
    assert sorted(held) == packaged_files()
    suffixes = {Path(name).suffix for name in held}
    assert {".vert", ".frag", ".j2", ".typed"} <= suffixes


@pytest.mark.slow
@pytest.mark.parametrize("way", ["pip install", "pip install --editable", "pip install git+file"])
def test_a_checkout_is_installed_in_every_usual_way(way: str, tmp_path: Path) -> None:
    environment = Environment.made(tmp_path / "environment")
    if way == "pip install git+file":
        if not (CHECKOUT / ".git").exists():
            pytest.skip("this is no clone")
        environment.install(f"git+file://{CHECKOUT}")
    else:
        environment.install(*way.split()[2:], CHECKOUT)
    assert "car" in environment.run("xfrustum", "scenes")
    if way == "pip install git+file":  # what is committed may differ from what lies here
        assert "xfrustum/scenes/__init__.py" in environment.installed_files()
    else:
        assert environment.installed_files() == ([] if "editable" in way else packaged_files())


def test_the_installed_command_lists_the_scenes(installation: Environment) -> None:
    assert "car" in installation.run("xfrustum", "scenes")
