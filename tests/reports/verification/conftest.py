"""Scene of verified files and groups: a torus before the plate, a sphere behind it."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.support.scene_file import film, named, part
from xfrustum import Scene, open_scene
from xfrustum.cli.main import main

SCENE = (
    named("two parts", "mm")
    + film((40.0, 40.0), (3, 2), (24, 24), (60.0, 60.0), (50.0, 60.0))
    + part("torus", 12.0, (6.0, 3.0, 25.0), rotate_deg=(20.0, 30.0, 0.0))
    + part("sphere", 30.0, (-4.0, 2.0, -35.0))
)


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    """Return the scene, with its file in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    return open_scene("scene.toml")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    """Verify against the scene in the current folder; return exit status and JSON object."""
    status = main(["verify", "scene.toml", *arguments, "--json", "--quiet"])
    return status, json.loads(capsys.readouterr().out)
