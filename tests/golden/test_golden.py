"""The golden corpus: this checkout gives the answers of version 0.2, with explained exceptions."""

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.golden import answers, truths
from tests.golden.__main__ import HERE, Difference, compare_answers, compare_arrays
from tests.support.long_tail import thinned
from xfrustum import Rasterizer, open_scene


def held_against(part: str, step: int) -> Difference:
    """Compare every `step`-th scene of a part; a scene that is missing here counts as gone."""
    with np.load(HERE / f"{part}.npz") as old:
        known = dict.fromkeys(key.partition("|")[0] for key in old.files)
        here = [name for name in known if truths.SHARED.is_dir() or not name.startswith("shared/")]
        names = here[::step]
        kept = {key: old[key] for key in old.files if key.partition("|")[0] in names}
        chosen = [(name, scene) for name, scene in truths.scenes() if name in names]
        return compare_arrays(kept, getattr(truths, part)(chosen))


@pytest.mark.parametrize("step", thinned([9, 1], 2))
def test_truths_are_those_of_the_corpus(step: int) -> None:
    tally = held_against("truths", step)
    assert tally.compared > 1_000_000 / step
    assert (tally.differ, tally.gone) == ([], [])


@pytest.mark.parametrize("step", thinned([9, 1], 2))
def test_rasters_are_those_of_the_corpus(step: int) -> None:
    """The corpus was drawn by llvmpipe; other devices round differently."""
    with Rasterizer(open_scene("empty")) as rasterizer:
        if "llvmpipe" not in rasterizer.device["renderer"]:
            pytest.skip(
                "the corpus of rasters was drawn by llvmpipe, which is not the device at hand"
            )
    tally = held_against("rasters", step)
    assert (tally.differ, tally.gone) == ([], [])


def test_a_changed_pixel_is_reported() -> None:
    old: dict[str, Any] = {"a|triangle": np.arange(12), "a|color": np.ones((2, 3), np.float32)}
    new: dict[str, Any] = {key: array.copy() for key, array in old.items()}
    assert compare_arrays(old, new).differ == []
    new["a|triangle"][3] = 0
    new["a|color"][1, 1] += 1e-4
    assert compare_arrays(old, new).differ == [
        "a|color: 1 of 6 values",
        "a|triangle: 1 of 12 values",
    ]


@pytest.mark.slow
def test_answers_of_commands_are_those_of_the_corpus(tmp_path: Path) -> None:
    with gzip.open(HERE / "answers.json.gz", "rt") as file:
        tally = compare_answers(json.load(file), answers.answers(tmp_path))
    assert [line for line in tally.differ if not answers.is_expected(line)] == []
