"""Documents: working links, valid names, running examples. `make docs` builds the site."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from markdown_it import MarkdownIt

import xfrustum

CHECKOUT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path
    for path in (*CHECKOUT.glob("*.md"), *(CHECKOUT / "docs").rglob("*.md"))
    if "gallery" not in path.relative_to(CHECKOUT).parts
)
NAMES_PAGE = CHECKOUT / "docs" / "api" / "examples.md"
INDEX = (CHECKOUT / "docs" / "api" / "index.rst").read_text(encoding="utf-8")
PACKAGES = ("scenes", "reference", "raster", "compare")

MADE_BY_THE_BUILD = ("docs/gallery/index.rst",)
"""Targets of links that `make docs` creates."""


def public_names() -> list[str]:
    """Return every public name once: names of `xfrustum` and further exports of its packages."""
    named = list(xfrustum.__all__)
    for package in PACKAGES:
        exported = importlib.import_module(f"xfrustum.{package}").__all__
        named += [f"{package}.{name}" for name in exported if name not in xfrustum.__all__]
    return named


def thing(name: str) -> Any:
    package, _, last = name.rpartition(".")
    return getattr(importlib.import_module(f"xfrustum.{package}" if package else "xfrustum"), last)


def links(page: Path) -> list[str]:
    """Return the targets of a page's links and pictures on this site."""
    targets = []
    for token in MarkdownIt().parse(page.read_text(encoding="utf-8")):
        for child in token.children or ():
            target = child.attrGet("href") or child.attrGet("src")
            if isinstance(target, str) and not re.match(r"[a-z]+:", target):
                targets.append(target)
    return targets


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(CHECKOUT).as_posix())
def test_links_of_a_page_lead_to_files(page: Path) -> None:
    missing = []
    for link in links(page):
        target = (
            (page.parent / link.partition("#")[0]).resolve() if not link.startswith("#") else page
        )
        if not target.exists() and target.relative_to(CHECKOUT).as_posix() not in MADE_BY_THE_BUILD:
            missing.append(link)
    assert missing == []


def test_files_that_documents_name_exist() -> None:
    """Decisions and releases are excluded: their statements refer to the code of their time."""
    folders = "scenes|reference|raster|compare|reports|research|src|scripts|docs"
    named = re.compile(rf"(?<![\w/.-])(?:{folders})/[\w./-]*\w")
    missing = [
        f"{page.relative_to(CHECKOUT)}: {path}"
        for page in PAGES
        if page.name != "CHANGELOG.md" and page.parent.name != "adr"
        for path in named.findall(page.read_text(encoding="utf-8"))
        if not list(CHECKOUT.glob(f"{path}*"))
    ]
    assert missing == []


def test_the_list_of_the_api_has_every_public_name_once() -> None:
    listed = re.findall(
        r"^   ((?:scenes\.|reference\.|raster\.|compare\.)?\w+)$", INDEX, re.MULTILINE
    )
    assert sorted(name for name in listed if name != "examples") == sorted(public_names())


@pytest.mark.parametrize("name", public_names())
def test_a_public_name_is_described(name: str) -> None:
    value = thing(name)
    if inspect.isclass(value) or inspect.isfunction(value):
        assert inspect.getdoc(value)
    else:  # a constant, described below its value in the module
        assert isinstance(value, str | int | tuple)


def test_every_public_name_has_an_example() -> None:
    shown = re.findall(r"^## (\S+)$", NAMES_PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(shown) == sorted(public_names())


@pytest.mark.slow
def test_the_examples_of_names_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```pycon\n(.*?)```", NAMES_PAGE.read_text(encoding="utf-8"), re.DOTALL)
    test = doctest.DocTestParser().get_doctest(
        "\n".join(blocks), {}, "examples.md", str(NAMES_PAGE), 0
    )
    output: list[str] = []
    result = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(
        test, out=output.append
    )
    assert result.attempted > len(blocks)
    assert result.failed == 0, "".join(output)


@pytest.mark.slow
def test_the_walk_of_one_pixel_ends_at_the_closed_form(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = (CHECKOUT / "docs" / "how-it-is-built.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(block, "how-it-is-built.md", "exec"), names)
    assert names["measured"][0] == pytest.approx(names["predicted"], rel=1e-3)
    assert "by the closed form" in capsys.readouterr().out


def test_one_version_is_stated_everywhere() -> None:
    stated = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["version"]
    citation = re.search(r"^version: (\S+)$", (CHECKOUT / "CITATION.cff").read_text(), re.MULTILINE)
    released = re.findall(r"^## \[(\d\S*)\]", (CHECKOUT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert citation is not None
    assert stated == citation.group(1) == released[0]


def test_the_dockerfile_takes_the_steps_of_readme() -> None:
    """No test builds the image; the test compares its steps with README."""
    lines = (CHECKOUT / "Dockerfile").read_text().splitlines()
    assert {"COPY . .", "RUN make setup", 'ENTRYPOINT ["xfrustum"]'} <= set(lines)
    folder, data = (line.partition(" ")[2] for line in lines if line.startswith("WORKDIR "))
    assert f"ENV PATH={folder}/.venv/bin:$PATH" in lines  # as in the Makefile
    readme = (CHECKOUT / "README.md").read_text()
    assert "    make setup " in readme and f'-v "$PWD:{data}" xfrustum report' in readme
    ignored = (CHECKOUT / ".dockerignore").read_text().split()
    assert {".venv/", "build/", ".git/"} <= set(ignored)


def test_the_tests_that_the_makefile_names_are_there() -> None:
    for path, name in re.findall(
        r"(tests/[\w./]+)(?:::(\w+))?", (CHECKOUT / "Makefile").read_text()
    ):
        assert (CHECKOUT / path).exists(), path
        assert not name or f"def {name}(" in (CHECKOUT / path).read_text(), name


def test_the_places_of_decisions_are_in_the_code() -> None:
    text = (CHECKOUT / "docs" / "how-it-is-built.md").read_text(encoding="utf-8")
    places = re.findall(r"`(\w+)` in `([\w/]+\.py)`", text)
    assert len(places) > 9
    missing = [
        f"{path}: {name}"
        for name, path in places
        if not re.search(rf"\b{name}\b", (CHECKOUT / path).read_text(encoding="utf-8"))
    ]
    assert missing == []
