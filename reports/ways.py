"""Way by directions beside two cameras, for `plan` and `cost`: figures, or the reason against."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from xfrustum.compare.planning.ways import (
    COMPARED_PASSES,
    COMPARED_SIDE,
    DirectionErrors,
    WaySpeeds,
    direction_errors,
    measure_plate,
    spread_pixels,
    tile_about,
)
from xfrustum.reference import Reference
from xfrustum.reports.common.templates_environment import sentence
from xfrustum.reports.plate.ways import DEPTH
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Scene
from xfrustum.scenes.model.images import PlateContent

#: Images of the timed plates: color in the type that plates are stored in, and triangle numbers.
CONTENT = PlateContent(ids=True)


@dataclass(frozen=True, kw_only=True)
class DirectionsResult:
    """Measures of a plate drawn by directions; no line of it has a near plane, nothing is moved."""

    #: both None if refused
    errors: DirectionErrors | None = None
    speeds: WaySpeeds | None = None
    #: reason why the scene cannot be drawn so; empty if it can
    refused: str = ""

    def summary(self) -> dict[str, Any]:
        """Return the JSON object."""
        speeds = self.speeds and {**asdict(self.speeds), "crossover_hogels": self.speeds.crossover}
        return {"refused": self.refused or None, "speeds": speeds}

    def words(self, scene: Scene) -> str:
        """Return the answer for the plate of a scene, in one or two sentences."""
        hogels = math.prod(scene.plate.hogels)
        return sentence("ways.txt.j2", "by_directions", result=self, hogels=hogels)


def measure_directions(
    reference: Reference, apertures: Sequence[Aperture], settings: DoubleFrustum
) -> DirectionsResult:
    """Measure wrong surfaces about the worst of some apertures, and the speed of both ways.

    Two cameras are timed with the settings.
    """
    scene = reference.scene
    pixels = spread_pixels(scene.frustum, COMPARED_PASSES)
    tiles = dict.fromkeys(tile_about(scene.plate, a, COMPARED_SIDE) for a in apertures)
    try:
        every = [direction_errors(reference, tile, pixels, DEPTH) for tile in tiles]
        errors = max(every, key=lambda some: some.fraction)
        speeds = measure_plate(scene, [settings], CONTENT).speeds
    except InputError as error:
        return DirectionsResult(refused=str(error))
    return DirectionsResult(errors=errors, speeds=speeds)
