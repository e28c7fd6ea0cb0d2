"""`xfrustum plan`: its JSON object, its page, and its commands."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.support.scene_file import film, part
from xfrustum.cli.main import main
from xfrustum.reports import planning
from xfrustum.scenes import open_scene

KEYS = ["displacement_p99_px", "surface_fraction", "depth_wrong", "misordered", "separation"]


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    size = film(
        (40.0, 30.0), hogels=(5, 4), resolution=(24, 18), fov_deg=(60.0, 50.0), reach=(100.0, 100.0)
    )
    file.write_text(size + part("torus", 30.0, (2.0, 1.0, -40.0)))
    return str(file)


def planned(line: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main(["plan", *line.split(), "--json", "--quiet"]) == 0
    made: dict[str, Any] = json.loads(capsys.readouterr().out)
    return made


@pytest.mark.slow
def test_json_and_page_are_as_promised(
    small_scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = planned(f"{small_scene} --depth d16 --mapping gl --sample 2 --out {tmp_path}", capsys)
    names = (
        "near near_range slabs split depth mapping within sentence reason binds limits command "
        "confirm"
    )
    rest = "predicted measured plate ways directions apertures buffers hogels device_model"
    assert list(made) == [*names.split(), *rest.split()]
    assert made["plate"]["hogels"] == 5 * 4 and made["plate"]["worst"]["displacement_p99_px"] <= 0.5
    assert list(made["predicted"]) == list(made["measured"]) == KEYS
    assert made["within"] and (made["depth"], made["mapping"]) == ("d16", "gl")
    least, largest = made["near_range"]
    assert least <= largest == made["near"] and made["split"] == bool(made["slabs"])
    assert list(made["hogels"].values()) == sorted(made["hogels"].values())
    pair, turned = made["ways"]
    assert (pair["way"], turned["way"]) == (
        "slabs" if made["split"] else "two cameras",
        "directions",
    )
    assert pair["surface_fraction"] == made["measured"]["surface_fraction"]
    assert turned["displacement_p99_px"] == 0 and turned["seconds"] > 0
    command, confirm = shlex.split(made["command"]), shlex.split(made["confirm"])
    assert command[:2] == ["xfrustum", "plate"] and confirm[:2] == ["xfrustum", "survey"]
    assert made == json.loads((tmp_path / "plan.json").read_text())
    page = (tmp_path / "index.html").read_text()
    assert made["sentence"] in page.replace("&#39;", "'") and "largest near that keeps" in page


def test_without_a_plan_every_number_is_null(
    small_scene: str, capsys: pytest.CaptureFixture[str]
) -> None:
    none = planned(f"{small_scene} --aperture 2,1 --separation 1e-7", capsys)
    assert none["near"] is None and none["near_range"] is None and none["slabs"] == []
    assert none["within"] is False and none["command"] is None
    assert set(none["predicted"].values()) == {None}
    assert none["sentence"].startswith("No plan: sheets")


def test_the_text_ends_with_a_command_that_draws_as_planned(
    small_scene: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Coarse depth needs cuts for sheets this close: depth binds, and the frusta are split."""
    options = "--depth d16 --mapping standard --aperture 2,2 --separation 0.01 --quiet"
    assert main(["plan", small_scene, *options.split()]) == 0
    text = capsys.readouterr().out
    command = shlex.split(text.splitlines()[-1])
    assert command[:2] == ["xfrustum", "raster"] and "--slabs" in command
    words = " ".join(text.split())
    assert "one pair of frusta is not enough" in words and "Binding limit" in words
    # Both largest near offsets come with their frusta.
    assert "In one pair a displacement of 0.5 px allows near up to" in words
    assert "With these cuts near may be up to" in words
    monkeypatch.chdir(tmp_path)
    assert main(command[1:]) == 0


def test_a_near_below_the_limit_of_displacement_states_the_wrong_surfaces(small_scene: str) -> None:
    """Traced cameras also count wrong surfaces, which the closed form of displacement omits."""
    scene = open_scene(small_scene)
    report = planning.plan(scene, [scene.plate.aperture(2, 1)])
    limits, outcome = report.plan.limits, report.plan.outcome
    assert limits is not None and limits.pixels is not None
    clause = "beyond it traced cameras exceed 0.5 px or 1 % wrong surfaces"
    for largest, stated in ((limits.pixels, False), (limits.pixels / 4, True)):
        made = replace(report.plan, outcome=replace(outcome, largest_near=largest))
        assert (clause in replace(report, plan=made).reason) == stated
