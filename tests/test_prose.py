"""Prose: no docstring and no description begins with a fragment whose subject the reader has to guess."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.prose import Kind, python_files, riddles, texts

CHECKOUT = Path(__file__).resolve().parent.parent

ROOMS = ("src/xfrustum", "scenes", "reference", "raster", "compare", "reports", "scripts", "tests")
"""Folders whose Python files are read."""

EXAMPLE = '''
"""Who reads this module stumbles."""

LIMIT = 3
"""Of the hogels, so many."""

OFFSET = 1  # Of a comment nothing is asked
"""Offset of the apertures, px."""


def example(scene, image):
    """Return the result.

    Parameters
    ----------
    scene
        Of the scene,

        in two paragraphs.
    image
        Image whose pixels count.

    Returns
    -------
    By which name it is called.

    Notes
    -----
    Whose lines these are, a section of prose may ask.
    """
'''


@pytest.mark.parametrize("room", ROOMS)
def test_every_docstring_and_description_begins_with_its_subject(room: str) -> None:
    files = list(python_files([CHECKOUT / room]))
    assert files
    found = "\n".join(str(text) for path in files for text in riddles(path))
    assert not found, found


def test_riddles_are_found_in_every_place_that_describes_something(tmp_path: Path) -> None:
    path = tmp_path / "example.py"
    path.write_text(EXAMPLE)
    assert [(text.line, text.kind, text.words[:12]) for text in riddles(path)] == [
        (2, Kind.DOCSTRING, "Who reads th"),
        (5, Kind.DOCSTRING, "Of the hogel"),
        (12, Kind.DESCRIPTION, "Of the scene"),
        (12, Kind.DESCRIPTION, "By which nam"),
    ]
    constants = [text.words for text in texts(path) if text.kind is Kind.CONSTANT]
    comments = [text.words for text in texts(path) if text.kind is Kind.COMMENT]
    assert (constants, comments) == (["LIMIT", "OFFSET"], ["Of a comment nothing is asked"])
