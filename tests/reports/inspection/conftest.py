"""A small scene, an inspection page of each command, and the OpenEXR files that all values must equal."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main

SCENE = (
    named("two parts", "mm")
    + film(
        (40.0, 30.0), hogels=(2, 1), resolution=(40, 28), fov_deg=(60.0, 44.0), reach=(50.0, 60.0)
    )
    + part("torus", 12.0, (3.0, 1.0, 25.0), rotate_deg=(20.0, 30.0, 0.0))
    + part("box", 30.0, (-4.0, 2.0, -35.0), rotate_deg=(10.0, 40.0, 0.0))
)

NEAR = "4"
"""Near offset that displaces points by several pixels and makes surfaces wrong."""

Channels = dict[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Inspected:
    """A scene, and the folders in which commands have left their pages."""

    scene: Path
    pages: dict[str, Path]

    def exr(self, aperture: tuple[int, int], layer: str) -> Channels:
        """Return the channels of an OpenEXR file of a truth, or of a drawing with `NEAR`."""
        return exr_channels(self.scene.parent / f"{layer}-{aperture[0]}-{aperture[1]}.exr")


def exr_channels(path: Path) -> Channels:
    """Return the channels of an OpenEXR file, read without our own reader."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


@pytest.fixture(scope="session")
def inspected(tmp_path_factory: pytest.TempPathFactory) -> Inspected:
    """A report, a verification of the rasterizer's own files, and a survey, all of one near offset."""
    folder = tmp_path_factory.mktemp("inspected")
    scene, pages = (
        folder / "parts.toml",
        {name: folder / name for name in ("report", "verify", "survey")},
    )
    scene.write_text(SCENE)
    setting = ["--near", NEAR, "--depth", "d24"]
    for i in range(2):
        words = [str(scene), "--aperture", f"{i},0"]
        assert main(["trace", *words, "--quiet", "--out", str(folder / f"truth-{i}-0.exr")]) == 0
        assert main(["raster", *words, *setting, "--out", str(folder / f"image-{i}-0.exr")]) == 0
    out = ["--quiet", "--out"]
    report = ["report", str(scene), *setting, "--apertures", "0,0;1,0", *out, str(pages["report"])]
    assert main(report) == 0
    verify = ["verify", str(scene), str(folder / "image-{i}-{j}.exr"), *out, str(pages["verify"])]
    assert main(verify) == 1
    survey = ["survey", str(scene), *setting, "--all", "--workers", "1", *out, str(pages["survey"])]
    assert main(survey) == 0
    return Inspected(scene=scene, pages=pages)
