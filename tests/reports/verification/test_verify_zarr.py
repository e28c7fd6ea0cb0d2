"""Plates in Zarr groups are judged by their triangle numbers and colors."""

import json
from typing import Any

import numpy as np
import pytest
import zarr

from tests.reports.verification.conftest import run
from xfrustum import (
    Aperture,
    DoubleFrustum,
    HogelImage,
    InputError,
    Rasterizer,
    Scene,
    verify,
)
from xfrustum.cli.main import main


@pytest.fixture
def drawn(world: Scene) -> dict[Aperture, HogelImage]:
    with Rasterizer(world) as rasterizer:
        near = DoubleFrustum(near=1e-4)
        return {at: rasterizer.render(at, near) for at in world.plate.apertures()}


def group_of(images: dict[Aperture, HogelImage], **arrays: Any) -> str:
    """Write a foreign group with arrays that are functions of an image; return its path."""
    group = zarr.create_group("foreign.zarr")
    for name, values in arrays.items():
        stack = np.stack([values(image) for image in images.values()])
        stack = stack.reshape(2, 3, *stack.shape[1:])
        group.create_array(name, data=stack, chunks=(1, 1, *stack.shape[2:]))
    return "foreign.zarr"


def triangles(image: HogelImage) -> np.ndarray:
    return image.triangle


def colors(image: HogelImage) -> np.ndarray:
    assert image.color is not None
    return image.color


@pytest.mark.usefixtures("world")
@pytest.mark.parametrize(
    ("made", "content", "by"),
    [
        (("--truth",), ("--ids",), "triangle and color"),
        (("--near", "1e-4"), ("--ids", "--color", "uint8"), "triangle"),
        pytest.param(("--near", "1e-4"), ("--color", "uint8"), "color", marks=pytest.mark.slow),
    ],
)
def test_our_own_plates_pass(
    made: tuple[str, ...],
    content: tuple[str, ...],
    by: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["plate", "scene.toml", *made, *content, "--out", "own.zarr", "--quiet"]) == 0
    capsys.readouterr()
    status, result = run(capsys, "own.zarr")
    assert (status, result["verdict"], result["diagnosis"]) == (0, "pass", [])
    assert result["source"] == f"own.zarr, array {by}"


def test_wrong_colors_of_right_triangles_fail(
    world: Scene, drawn: dict[Aperture, HogelImage]
) -> None:
    darker = group_of(drawn, triangle=triangles, color=lambda image: colors(image) / 2)
    assert not any(hogel.passed for hogel in verify(world, darker).hogels)
    assert verify(world, darker, encoding="triangle-id").passed


@pytest.mark.usefixtures("world")
def test_hogels_that_were_never_drawn_are_missing(capsys: pytest.CaptureFixture[str]) -> None:
    part = ("plate", "scene.toml", "--truth", "--ids", "--apertures", "0-1,0", "--out", "own.zarr")
    assert main([*part, "--quiet"]) == 0
    capsys.readouterr()
    status, result = run(capsys, "own.zarr")
    assert status == 1
    assert [hogel["verdict"] for hogel in result["hogels"]] == ["pass"] * 2 + ["missing"] * 4
    assert "hogel 2,0 was never drawn" in result["hogels"][2]["problem"]


@pytest.mark.parametrize(
    ("arrays", "encoding", "problem"),
    [
        ({"height": lambda image: image.height}, None, "no array color or triangle"),
        ({"color": colors}, "triangle-id", "no array triangle, or color of type uint8, which"),
        ({"triangle": triangles}, "object-id", "no array color of type uint8, which"),
        ({"triangle": triangles}, "srgb", "no array color, which --encoding srgb needs"),
        ({"triangle": lambda image: image.triangle[1:]}, None, "the scene says"),
        ({"triangle": lambda image: image.triangle / 2}, None, "is not that of a plate"),
    ],
)
def test_unusable_groups_are_refused(
    world: Scene,
    drawn: dict[Aperture, HogelImage],
    arrays: dict[str, Any],
    encoding: str | None,
    problem: str,
) -> None:
    place = group_of(drawn, **arrays)
    with pytest.raises(InputError, match=problem):
        verify(world, place, encoding=encoding)


def test_truths_by_directions_give_the_same_verdict(
    world: Scene, drawn: dict[Aperture, HogelImage]
) -> None:
    place = group_of(drawn, triangle=triangles, color=lambda image: colors(image) / 2)
    results = [
        json.dumps(verify(world, place, truth_by=by).summary()) for by in ("hogels", "directions")
    ]
    assert results[0].replace('"truth_by": "hogels"', '"truth_by": "directions"') == results[1]
    assert results[0] != results[1]
    with pytest.raises(InputError, match="leave out --apertures"):
        verify(world, place, truth_by="directions", apertures=[(0, 0)])
