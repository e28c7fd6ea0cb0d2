"""Words and line lengths of the rooms in `words.CLEAN`."""

import pytest

from tests.documents.words import CLEAN, modules, report, violations


def test_words_of_clean_rooms() -> None:
    assert list(modules(CLEAN))
    assert report(CLEAN) == []


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ('"""That which is measured."""', "begins with 'That'"),
        ('"""Errors. Whether one is left out is open."""', "begins with 'Whether'"),
        ("x = 1\n# What is left", "begins with 'What'"),
        ("# The camera is told\n# its near plane.\nx = 1", "'told'"),
        ('"""Errors.\n\nThose of C alone."""', "begins with 'Those'"),
        ("def f(asked: int) -> int:\n    return asked", "the name 'asked'"),
        ("x = '" + "0" * 100 + "'", "106 columns"),
    ],
)
def test_violations_are_reported(source: str, problem: str) -> None:
    assert any(problem in text for _, text in violations(source))


def test_quoted_code_and_plain_sentences_pass() -> None:
    source = (
        '"""Errors of a raster.\n\nThe name `told` and the word "asked" are quoted."""\nx = 1\n'
    )
    assert list(violations(source)) == []
