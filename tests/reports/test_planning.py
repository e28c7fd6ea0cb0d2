"""`xfrustum plan`: its JSON object, its page, and its commands."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.commands import Command
from tests.support.scene_file import film, part
from xfrustum import open_scene
from xfrustum.reports import planning


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    size = film(
        (40.0, 30.0), hogels=(5, 4), resolution=(24, 18), fov_deg=(60.0, 50.0), reach=(100.0, 100.0)
    )
    file.write_text(size + part("torus", 30.0, (2.0, 1.0, -40.0)))
    return str(file)


@pytest.mark.slow
def test_json_and_page_are_as_promised(small_scene: str, tmp_path: Path, command: Command) -> None:
    line = f"plan {small_scene} --depth d16 --mapping gl --sample 2 --out {tmp_path}"
    made = command(f"{line} --json --quiet").record
    assert made["plate"]["hogels"] == 5 * 4 and made["plate"]["worst"]["displacement_p99_px"] <= 0.5
    assert made["within"] and (made["depth"], made["mapping"]) == ("d16", "gl")
    least, largest = made["near_range"]
    assert least <= largest == made["near"] and made["split"] == bool(made["slabs"])
    pair, turned = made["ways"]
    assert pair["way"] == ("slabs" if made["split"] else "two cameras")
    assert pair["surface_fraction"] == made["measured"]["surface_fraction"]
    assert (turned["way"], turned["displacement_p99_px"]) == ("directions", 0)
    assert made["command"].startswith("xfrustum plate ")
    assert made["confirm"].startswith("xfrustum survey ")
    assert made == json.loads((tmp_path / "plan.json").read_text())
    page = (tmp_path / "index.html").read_text()
    assert made["sentence"] in page.replace("&#39;", "'") and "largest near that keeps" in page


def test_without_a_plan_every_number_is_null(small_scene: str, command: Command) -> None:
    line = f"plan {small_scene} --aperture 2,1 --separation 1e-7 --json --quiet"
    none = command(line).record
    assert none["near"] is None and none["near_range"] is None and none["slabs"] == []
    assert none["within"] is False and none["command"] is None
    assert set(none["predicted"].values()) == {None}
    assert none["sentence"].startswith("No plan: sheets")


def test_the_text_ends_with_a_command_that_draws_as_planned(
    small_scene: str, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Coarse depth needs cuts for sheets this close: depth binds, and the frusta are split."""
    options = "--depth d16 --mapping standard --aperture 2,2 --separation 0.01 --quiet"
    text = command(f"plan {small_scene} {options}").out
    line = text.splitlines()[-1]
    assert line.startswith("xfrustum raster ") and "--slabs" in line
    words = " ".join(text.split())
    assert "one pair of frusta is not enough" in words and "Binding limit" in words
    # Both largest near offsets come with their frusta.
    assert "In one pair a displacement of 0.5 px allows near up to" in words
    assert "With these cuts near may be up to" in words
    monkeypatch.chdir(tmp_path)
    command(line.removeprefix("xfrustum "))


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
