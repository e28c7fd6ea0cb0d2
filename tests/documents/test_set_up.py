"""Steps of the set-up: one line with a time for each, and what a step printed only where it failed."""

from __future__ import annotations

import re
from pathlib import Path

TOP = Path(__file__).resolve().parents[2]


def test_the_dockerfile_takes_the_steps_of_readme() -> None:
    """No test builds the image; its steps are those of the Makefile, and its files where these put them."""
    lines = [line for line in (TOP / "Dockerfile").read_text().splitlines() if line and line[0] != "#"]
    makefile, readme = (TOP / "Makefile").read_text(), (TOP / "README.md").read_text()
    *_, sources, copied, made, path, data, entry, _ = lines
    assert (copied, made) == ("COPY . .", "RUN make setup")
    assert "\nsetup: $(READY)" in makefile and "    make setup " in readme
    # The command is where the Makefile puts it.
    folder = sources.removeprefix("WORKDIR ")
    assert path == f"ENV PATH={folder}/.venv/bin:$PATH" and "XFRUSTUM := .venv/bin/xfrustum\n" in makefile
    assert entry == 'ENTRYPOINT ["xfrustum"]'
    assert f'-v "$PWD:{data.removeprefix("WORKDIR ")}" xfrustum report' in readme
    ignored = (TOP / ".dockerignore").read_text().split()
    assert {".venv/", "build/", ".git/"} <= set(ignored)


def test_the_tests_that_the_makefile_names_are_there() -> None:
    for path, name in re.findall(r"(tests/[\w./]+)(?:::(\w+))?", (TOP / "Makefile").read_text()):
        assert (TOP / path).exists(), path
        assert not name or f"def {name}(" in (TOP / path).read_text(), name
