"""Channels of hogels that our own rasterizer draws: truth, drawing, errors and their causes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import partial

from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.judging.engine import JudgedFrame, Wanted
from xfrustum.compare.judging.judge import Judge
from xfrustum.compare.metrics.error_maps import ErrorMaps
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


def inspected_drawings(
    judge: Judge, apertures: Sequence[Aperture], setting: DoubleFrustum
) -> Iterator[InspectedHogel]:
    """Yield the hogels of some apertures, drawn with a setting."""
    finish = partial(inspected_frame, judge.scene)
    with closing(judge.engine(WANTED, finish).frames(apertures, (setting,))) as frames:
        for one in frames:
            yield one.found


def inspected_frame(scene: Scene, frame: JudgedFrame) -> InspectedHogel:
    """Return a frame of a scene with its truth and its errors; its engine was asked for causes."""
    maps, budget = frame.comparison.maps, frame.budget
    assert budget is not None, "the engine was asked for causes"
    settings = frame.settings
    drawing = f"rasterizer: near {digits(settings.near)}, {settings.depth_label}"
    return InspectedHogel.of(
        frame.hogel.aperture,
        _badness(frame),
        [
            image_layer(TRUTH, "truth", with_normals(frame.hogel.truth, scene)),
            image_layer(IMAGE, drawing, with_normals(frame.image, scene)),
            Layer(name=ERROR, words="errors of the image", channels=_errors(maps, budget)),
        ],
    )


def _badness(frame: JudgedFrame) -> str:
    numbers = frame.comparison.numbers
    surface, moved = numbers.surface, numbers.displacement_px
    wrong = "" if surface is None else f"wrong surfaces {percent(surface.fraction)}"
    return wrong if moved is None else f"{wrong}, displacement (p99) {digits(moved.p99)} px"


def _errors(maps: ErrorMaps, budget: Budget) -> tuple[Channel, ...]:
    """Return what judging has found out, and the causes that it is charged to."""
    surface, outside, shape = maps.surface, maps.outside, maps.judged.shape
    assert surface is not None and outside is not None, "a judge has the scene at hand"
    states = {
        "tie, not judged": ~maps.judged,
        "wrong surface, whose point belongs outside the film": outside,
        "wrong surface": surface,
        "right surface, another triangle": maps.triangle,
    }
    links = {name: budget.surface_charge == number for number, name in enumerate(budget.links)}
    return (
        classes(STATE, shape, states, "right"),
        classes(LINK, shape, links, "none"),
        classes(ROUNDING, shape, vars(budget.explanation), "none"),
        *displacement_channels(maps.displacement),
    )
