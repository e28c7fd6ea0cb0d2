"""The views that `selfcheck` checks: scenes, apertures, and images small enough for integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path

from xfrustum.scenes import Aperture, InputError, Scene, open_scene
from xfrustum.scenes.library import builtin, hard_cases

VIEW_PIXELS, QUICK_VIEW_PIXELS = 50_000, 1_600
"""Approximate numbers of pixels in each view of a scene. With the larger one, the views of built-in scenes
that show anything have 1.4 million pixels together. Hard cases keep their own resolution, at which their
lines are aimed."""

APERTURE_SHARES = ((0.5, 0.5), (0.3, 0.7), (0.0, 0.0), (1.0, 1.0))
"""Places of the apertures as shares of the plate's columns and rows: the middle, a place off center on both
axes, and two corners."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One image to check: a scene at a resolution, through one aperture."""

    name: str
    scene: Scene
    aperture: Aperture


def views(names: Sequence[str], *, quick: bool) -> list[View]:
    """Return the views of some scenes, or of all.

    Parameters
    ----------
    names
        Paths of scene files and names of built-in scenes and hard cases; none for all built-in scenes,
        all hard cases but the giants, and the scene files in the folder of test data beside the
        checkout.
    quick
        Whether views have fewer pixels, and hard cases only the apertures that they name.

    Raises
    ------
    InputError
        There is no such scene, or it is a giant.
    """
    found = []
    for name in names or default_names():
        case = hard_cases.CASES.get(name)
        if case is None:
            scene = _at_about(open_scene(name), QUICK_VIEW_PIXELS if quick else VIEW_PIXELS)
            chosen = apertures(scene)
        elif case.giant:
            raise InputError(
                f"{name} is a giant, which integers take hours for: leave it out of the self-check"
            )
        else:
            scene = case.build()
            named = [scene.plate.aperture(*index) for index in case.apertures]
            chosen = named if quick else list(dict.fromkeys([*named, *apertures(scene)]))
        found += [View(name=name, scene=scene, aperture=aperture) for aperture in chosen]
    return found


def default_names() -> list[str]:
    """Return the built-in scenes, the hard cases, and scene files where there are any beside the checkout."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "scenes"
    return [
        *builtin.names(),
        *hard_cases.names(giants=False),
        *(str(path) for path in sorted(beside.glob("*.toml"))),
    ]


def apertures(scene: Scene) -> list[Aperture]:
    """Return the different apertures of a plate at `APERTURE_SHARES`."""
    columns, rows = scene.plate.hogels
    indices = [(min(int(x * columns), columns - 1), min(int(y * rows), rows - 1)) for x, y in APERTURE_SHARES]
    return [scene.plate.aperture(*index) for index in dict.fromkeys(indices)]


def _at_about(scene: Scene, pixels: int) -> Scene:
    """Return the scene with about that many pixels, in an odd number of columns.

    An odd number of columns has a middle one, whose lines have no slope in x: in symmetric scenes they run
    along edges.
    """
    width, height = scene.frustum.resolution
    factor = sqrt(pixels / (width * height))
    resolution = (max(1, round(width * factor)) | 1, max(1, round(height * factor)))
    return replace(scene, frustum=replace(scene.frustum, resolution=resolution))
