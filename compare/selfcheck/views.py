"""What `selfcheck` looks at: scenes, apertures, and images small enough for integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path

from xfrustum.scenes import Aperture, InputError, Scene, open_scene
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.hard import cases as hard_cases

PIXELS, QUICK_PIXELS = 50_000, 1_600
"""Per view of a scene. In full, the built-in ones that show anything make 1.4 million pixels alone. Hard
cases keep their own resolution, for which their lines are aimed."""

APERTURE_SHARES = ((0.5, 0.5), (0.3, 0.7), (0.0, 0.0), (1.0, 1.0))
"""Of the plate's columns and rows: the middle, off center on both axes, two corners."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One image to check: a scene at a resolution, through one aperture."""

    name: str
    scene: Scene
    aperture: Aperture


def views(names: Sequence[str], *, quick: bool) -> list[View]:
    """Return the views of some scenes, or of all there are.

    Parameters
    ----------
    names
        Paths of scene files and names of built-in scenes and hard cases; none for all built-in scenes,
        all hard cases but the giants, and the scene files in the folder of test data beside the
        checkout.
    quick
        Fewer pixels per view, and of hard cases only the apertures that they name.

    Raises
    ------
    InputError
        There is no such scene, or it is a giant.
    """
    found = []
    for name in names or default_names():
        case = hard_cases.CASES.get(name)
        if case is None:
            scene = _at_about(open_scene(name), QUICK_PIXELS if quick else PIXELS)
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
    """Return the scene with about that many pixels, an odd number of columns.

    A middle column has lines without slope in x: where scenes are symmetric, it runs along edges.
    """
    width, height = scene.frustum.resolution
    factor = sqrt(pixels / (width * height))
    resolution = (max(1, round(width * factor)) | 1, max(1, round(height * factor)))
    return replace(scene, frustum=replace(scene.frustum, resolution=resolution))
