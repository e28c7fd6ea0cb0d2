"""An installation has every file once, and runs without access to the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]


def packaged_files() -> list[str]:
    """Return every file below the import name, with the linked folders at the top."""
    source = CHECKOUT / "src"
    return sorted(
        (Path(folder) / file).relative_to(source).as_posix()
        for folder, _, files in os.walk(source / "xfrustum", followlinks=True)
        for file in files
        if "__pycache__" not in folder
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of a release's wheel, built from the source distribution."""
    place = tmp_path_factory.mktemp("release")
    build: list[str | Path]
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", place, CHECKOUT]
    subprocess.run(build, check=True, capture_output=True)
    (made,) = place.glob("*.whl")
    return made


def test_the_wheel_of_the_source_distribution_holds_every_file_once(wheel: Path) -> None:
    held = [name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("xfrustum/")]
    assert sorted(held) == packaged_files()
    suffixes = {Path(name).suffix for name in held}
    assert {".vert", ".frag", ".j2", ".typed"} <= suffixes


@pytest.mark.slow
def test_the_installed_command_lists_the_scenes(wheel: Path, tmp_path: Path) -> None:
    """Use a new environment outside the checkout, with the dependencies of this environment.

    A path file adds the dependencies' folders to the search path. Path files inside these folders
    are not read, so that the editable installation there has no effect.
    """
    venv.create(tmp_path / "environment", symlinks=True)
    programs = tmp_path / "environment" / "bin"
    (site_packages,) = tmp_path.glob("environment/lib/python*/site-packages")
    seen = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (site_packages / "dependencies.pth").write_text("\n".join(sorted(seen)))
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    install: list[str | Path] = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        programs / "python",
        "install",
    ]
    install += ["--no-deps", "--no-build-isolation", "--no-index", wheel]
    subprocess.run(install, cwd=tmp_path, env=clean, check=True, capture_output=True)
    printed = subprocess.check_output(
        [programs / "xfrustum", "scenes"], cwd=tmp_path, env=clean, text=True
    )
    assert "car" in printed
