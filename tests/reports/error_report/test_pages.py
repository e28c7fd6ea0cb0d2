"""Pages escape texts, run only scripts of the package, and load no other files."""

import base64
import hashlib
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.reports.common.templates_environment import TEMPLATES, script_json

EVIL = "<img src=x onerror=document.title=1></script><script>document.title=2</script>"

SCENE = (
    named("<script>document.title=3</script>\u0007", EVIL)
    + film(
        (40.0, 30.0), hogels=(2, 2), resolution=(12, 8), fov_deg=(60.0, 40.0), reach=(50.0, 60.0)
    )
    + part("box", 12.0, (3.0, 1.0, 25.0))
)

SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next((path for name in BROWSERS if (path := shutil.which(name))), None)


@pytest.fixture(scope="module")
def report_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evil")
    (folder / "evil.toml").write_text(SCENE)
    out = folder / "report"
    line = f"report {folder}/evil.toml --near 1 --depth d24 --quiet --out {out}"
    assert main(line.split()) == 0
    return out / "index.html"


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("evil.toml").write_text(SCENE)
    return "evil.toml"


def policy_of(page: str) -> str:
    head = page[: page.index("<title>")]
    match = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', head)
    assert match, "the policy comes before anything that could be somebody else's"
    return match[1]


def test_a_page_allows_its_own_scripts_by_their_hashes_and_nothing_else(report_page: Path) -> None:
    page = report_page.read_text()
    policy = policy_of(page)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    scripts = policy.split(";")[1]
    assert "unsafe" not in scripts and "http" not in policy
    own = {
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for text in SCRIPT.findall(page)
    }
    assert own == set(re.findall(r"'sha256-([^']*)'", scripts)) and len(own) == 2
    # Texts of a scene never become markup.
    assert "<img src=x" not in page and not re.search(r"<script>document", page)


@pytest.mark.parametrize("script", sorted(TEMPLATES.glob("*.js")), ids=str)
def test_no_script_of_ours_turns_text_into_markup(script: Path) -> None:
    forbidden = (
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\b|new Function|srcdoc"
    )
    assert not re.search(forbidden, script.read_text())


@pytest.mark.parametrize("template", sorted(TEMPLATES.glob("[!_]*.html.j2")), ids=str)
def test_every_page_has_a_policy_and_only_listed_scripts(template: Path) -> None:
    text = template.read_text()
    assert text.index("{{ policy() }}") < text.index("<title>")
    assert "<script" not in text
    assert not re.search(r'\son\w+="', text)


def test_json_in_a_page_cannot_end_its_element_nor_a_line_of_script() -> None:
    text = script_json({"a": "</script><!--\u2028\u2029&"})
    assert not set(text) & set("<>&\u2028\u2029")


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium, which is not installed")
@pytest.mark.slow
def test_a_browser_draws_the_plots_of_a_page_and_runs_nothing_else(
    report_page: Path, tmp_path: Path
) -> None:
    quiet = (
        "--disable-quic --no-first-run --disable-background-networking --disable-component-update"
    )
    options = (
        f"--headless --no-sandbox --disable-gpu --virtual-time-budget=8000 --disable-sync {quiet}"
    ).split()
    options += [f"--user-data-dir={tmp_path / 'profile'}", "--enable-logging=stderr", "--dump-dom"]
    words = [str(BROWSER), *options, report_page.as_uri()]
    shown = subprocess.run(words, capture_output=True, text=True, check=True, timeout=300)
    assert "Content Security Policy" not in shown.stderr
    assert "error of the double frustum</title>" in shown.stdout
    assert shown.stdout.count("js-plotly-plot") >= 6
    assert "<td>displacement measured, px</td>" in shown.stdout


def test_without_usable_hogels_page_and_junit_report_it_for_any_scene_name(
    scene: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(scene).read_text().replace(r"\u0007", r"\u0007\u0000\uFFFE\u001B")
    Path(scene).write_text(text)
    Path("0x0.png").write_text("no picture")  # the other files are missing
    line = ["verify", scene, "{i}x{j}.png", "--quiet", "--out", "out", "--junit", "junit.xml"]
    assert main(line) == 1
    page = Path("out/index.html").read_text()
    assert "4 of 4 are missing" in capsys.readouterr().out and "No hogel could be judged" in page
    assert "script-src 'none'" in policy_of(page)
    suite = ElementTree.parse("junit.xml").getroot()
    assert (suite.get("tests"), suite.get("errors"), suite.get("failures")) == ("4", "4", "0")
    assert (suite.get("name") or "").startswith("xfrustum verify <script>document.title=3</script>")
