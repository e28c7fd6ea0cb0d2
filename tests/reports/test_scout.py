"""`--apertures auto`: output of the commands on standard error, in JSON and on the page."""

import json
from pathlib import Path

import pytest

from tests.support.scene_file import film, part
from xfrustum import open_scene
from xfrustum.cli.main import main
from xfrustum.reports import cost as cost_module
from xfrustum.reports.plotting import auto_apertures

BALL = (12.0, 7.0, -3.3)
"""Middle of a ball of radius 1.5 close behind one aperture; a box is far behind the others."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("scene") / "ball.toml"
    text = film(
        (40.0, 30.0), hogels=(8, 6), resolution=(24, 18), fov_deg=(60.0, 45.0), reach=(20.0, 60.0)
    )
    path.write_text(text + part("sphere", 3.0, BALL) + part("box", 20.0, (0.0, 0.0, -40.0)))
    return str(path)


@pytest.mark.parametrize("auto", [True, False])
def test_a_report_of_scouted_apertures_has_a_map_and_names_the_plan_of_the_plate(
    auto: bool, scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--near", "0.1", "--depth", "d24", "--quiet", "--no-causes", "--out", str(tmp_path)]
    assert main(["report", scene, *words, *(["--apertures", "auto"] if auto else [])]) == 0
    assert ('id="plot-scout"' in (tmp_path / "index.html").read_text()) == auto
    assert (json.loads((tmp_path / "report.json").read_text())["scout"] is not None) == auto
    message = "says what holds for the whole plate"
    if not auto:
        message = "Measured at 1 of 48 hogels, and others may need other settings: xfrustum plan "
    assert message in capsys.readouterr().out


def test_errors_of_a_cost_are_those_of_the_worst_aperture(
    scene: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Right behind the ball a large near offset displaces much more than in the middle."""
    monkeypatch.setattr(cost_module, "NEARS_PER_REACH", (1e-2,))
    rows, expected = [], auto_apertures(open_scene(scene)).apertures
    for words in (["--apertures", "auto"], []):
        assert main(["cost", scene, *words, "--repeat", "1", "--json", "--quiet"]) == 0
        answer = json.loads(capsys.readouterr().out)
        chosen = answer["apertures"] or []
        assert len(chosen) == (len(expected) if words else 0) and all(row["why"] for row in chosen)
        rows.append(answer["rows"])
    worst, middle = ([row["error"]["displacement_p99_px"] for row in those] for those in rows)
    assert all(more >= less for more, less in zip(worst, middle, strict=True))
    assert max(worst) > 1.5 * max(middle)
