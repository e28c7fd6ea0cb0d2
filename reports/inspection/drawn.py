"""Channels of hogels that our own rasterizer draws: truth, drawing, errors and their causes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import partial

from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.metrics.error_maps import ErrorMaps
from xfrustum.compare.run import Judge, JudgedFrame, Wanted
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.inspection.channels import (
    ERROR,
    IMAGE,
    LINK,
    ROUNDING,
    STATE,
    TRUTH,
    Channel,
    Layer,
    classes,
    displacement_channels,
    image_layer,
    with_normals,
)
from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

WANTED = Wanted(color=True, causes=True)
"""What an engine must be asked for: frames in color, and causes."""

WANTED_WITHOUT_CAUSES = Wanted(color=True, causes=False)
"""The same for pages that leave causes out."""


def inspected_drawings(
    judge: Judge, apertures: Sequence[Aperture], setting: DoubleFrustum, *, causes: bool = True
) -> Iterator[InspectedHogel]:
    """Yield the hogels of some apertures, drawn with a setting, and perhaps the causes of their errors."""
    finish, wanted = partial(inspected_frame, judge.scene), WANTED if causes else WANTED_WITHOUT_CAUSES
    with closing(judge.frames(apertures, (setting,), wanted, finish)) as frames:
        yield from frames


def inspected_frame(scene: Scene, frame: JudgedFrame) -> InspectedHogel:
    """Return a frame of a scene with its truth, its errors, and their causes where these were asked for."""
    maps, settings = frame.comparison.maps, frame.settings
    drawing = f"rasterizer: near {digits(settings.near)}, {settings.depth_label}"
    return InspectedHogel.of(
        frame.aperture,
        _badness(frame),
        [
            image_layer(TRUTH, "truth", with_normals(frame.truth, scene)),
            image_layer(IMAGE, drawing, with_normals(frame.image, scene)),
            Layer(name=ERROR, words="errors of the image", channels=_errors(maps, frame.budget)),
        ],
    )


def _badness(frame: JudgedFrame) -> str:
    numbers = frame.comparison.numbers
    surface, moved = numbers.surface, numbers.displacement_px
    wrong = "" if surface is None else f"wrong surfaces {percent(surface.fraction)}"
    return wrong if moved is None else f"{wrong}, displacement (p99) {digits(moved.p99)} px"


def _errors(maps: ErrorMaps, budget: Budget | None) -> tuple[Channel, ...]:
    """Return what judging has found out, and the causes that it is charged to where these were found."""
    surface, outside, shape = maps.surface, maps.outside, maps.judged.shape
    assert surface is not None and outside is not None, "a judge has the scene at hand"
    states = {
        "tie, not judged": ~maps.judged,
        "wrong surface, whose point belongs outside the film": outside,
        "wrong surface": surface,
        "right surface, another triangle": maps.triangle,
    }
    return (
        classes(STATE, shape, states, "right"),
        *(() if budget is None else _causes(budget, shape)),
        *displacement_channels(maps.displacement),
    )


def _causes(budget: Budget, shape: tuple[int, int]) -> tuple[Channel, ...]:
    links = {name: budget.surface_charge == number for number, name in enumerate(budget.links)}
    return (
        classes(LINK, shape, links, "none"),
        classes(ROUNDING, shape, budget.explanation.masks, "none"),
    )
