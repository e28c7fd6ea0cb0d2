"""Places of wrong pixels: side of the plate, object, hogel, and distance from outlines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from xfrustum.compare.judging.judged import COLOR_ONLY, Figures
from xfrustum.compare.judging.outlines import steps_of
from xfrustum.compare.metrics.error_maps import covered_by
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

DISTANCES_PX = (1.5, 4.5)
"""Upper ends of the distance ranges, px: pixels next to an outline, and its surroundings."""

Places = dict[str, tuple[int, int]]
"""Numbers of wrong pixels and of pixels where image or truth shows something, by place."""


def places_of(figures: Figures) -> Places:
    """Return the places of the wrong pixels of one hogel."""
    answer, error = figures.answer, figures.error
    # Plain pictures identify no surfaces: pixels that are not black count as shown.
    shows = shows_something if figures.numbers.by in COLOR_ONLY else covered_by
    covered = shows(figures.image)
    shown = answer.covered | covered | error
    across, down = steps_of(answer.object)
    outline = np.pad(across > 0, ((0, 0), (0, 1))) | np.pad(down > 0, ((0, 1), (0, 0)))
    apart = distance_transform_edt(~outline) if outline.any() else np.full(outline.shape, np.inf)
    near, far = DISTANCES_PX
    masks = {
        "side/front": answer.height > 0,
        "side/back": answer.height <= 0,
        "side/nothing": ~answer.covered,
        "distance/within 1 px": apart <= near,
        "distance/2 to 4 px": (apart > near) & (apart <= far),
        "distance/farther": apart > far,
        "shown/nothing": ~covered,
    }
    for number in np.unique(answer.object[answer.object != NOTHING]).tolist():
        masks[f"object/{number}"] = answer.object == number
    return {
        name: (int((mask & error).sum()), int((mask & shown).sum())) for name, mask in masks.items()
    }


def where_wrong(scene: Scene, hogels: Iterable[tuple[Aperture, Places]]) -> dict[str, Any] | None:
    """Return wrong and shown pixels of all hogels by place; None if none is wrong."""
    wrong, shown = Counter[str](), Counter[str]()
    for aperture, places in hogels:
        sides = [count for name, count in places.items() if name.startswith("side/")]
        total = (sum(camera for camera, _ in sides), sum(camera for _, camera in sides))
        lines = {f"row/{aperture.row}": total, f"column/{aperture.column}": total}
        for name, (bad, of) in (places | lines).items():
            wrong[name] += bad
            shown[name] += of
    if not any(wrong.values()):
        return None
    shares: dict[str, Any] = {}
    for name in sorted(shown, key=lambda entry: (entry.split("/")[0], shown[entry] == 0)):
        group, place = name.split("/")
        if group == "object":
            place = f"{place} ({PurePath(scene.objects[int(place)].name).stem})"
        if shown[name]:
            share = wrong[name] / shown[name]
            counts = {"wrong": wrong[name], "shown": shown[name], "fraction": share}
            shares.setdefault(group, {})[place] = counts
    return shares


def wrong_counts(scene: Scene, hogels: Sequence[tuple[Aperture, Places]]) -> dict[str, Any] | None:
    """Return the numbers of wrong pixels, `where` of `verify --json`; None if nothing is wrong.

    `front` is the content in front of the plate, drawn by C*. `hogels` has a list for each row of
    the plate, with None for hogels that were not judged; `shares` is the result of `where_wrong`.
    """
    shares = where_wrong(scene, hogels)
    if shares is None:
        return None
    columns, rows = scene.plate.hogels
    plate: list[list[int | None]] = [[None] * columns for _ in range(rows)]
    for aperture, places in hogels:
        wrong = (count for name, (count, _) in places.items() if name.startswith("side/"))
        plate[aperture.row][aperture.column] = sum(wrong)
    sides, objects = (
        {place: counts["wrong"] for place, counts in shares.get(group, {}).items()}
        for group in ("side", "object")
    )
    sides = {"front": 0, "back": 0} | sides
    return {"sides": sides, "objects": objects, "hogels": plate, "shares": shares}
