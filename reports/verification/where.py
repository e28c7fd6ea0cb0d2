"""Where wrong pixels are: by side of the plate, object, hogel, and distance from outlines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from xfrustum.compare.judging.judged import COLOR_ONLY, Figures
from xfrustum.compare.judging.outlines import steps_of
from xfrustum.compare.metrics.error_maps import covered_by
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.scenes import NOTHING, Aperture, Scene

DISTANCES_PX = (1.5, 4.5)
"""Ends of the ranges of distance: a neighbor of an outline, as rounding moves it, and what is near to one."""

Places = dict[str, tuple[int, int]]
"""Numbers of wrong pixels and of those where image or truth shows something, by place."""


def places_of(figures: Figures) -> Places:
    """Return where the wrong pixels of one hogel are."""
    answer, error = figures.answer, figures.error
    # Plain pictures name no surfaces: what is not black shows something.
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
    """Return by which places all hogels together are wrong: pixels, of those shown; None where nothing is."""
    wrong, shown = Counter[str](), Counter[str]()
    for aperture, places in hogels:
        sides = [count for name, count in places.items() if name.startswith("side/")]
        total = (sum(one for one, _ in sides), sum(one for _, one in sides))
        lines = {f"row/{aperture.row}": total, f"column/{aperture.column}": total}
        for name, (bad, of) in (places | lines).items():
            wrong[name] += bad
            shown[name] += of
    if not any(wrong.values()):
        return None
    found: dict[str, Any] = {}
    for name in sorted(shown, key=lambda one: (one.split("/")[0], shown[one] == 0)):
        group, place = name.split("/")
        if group == "object":
            place = f"{place} ({PurePath(scene.objects[int(place)].name).stem})"
        if shown[name]:
            share = {
                "wrong": wrong[name],
                "shown": shown[name],
                "fraction": wrong[name] / shown[name],
            }
            found.setdefault(group, {})[place] = share
    return found


def wrong_counts(scene: Scene, hogels: Sequence[tuple[Aperture, Places]]) -> dict[str, Any] | None:
    """Return the numbers of wrong pixels, `where` of `verify --json`; None where nothing is wrong.

    `front` is before the plate, drawn by C*. `hogels` has a list for each row of the plate, with
    None for hogels that were not judged; `shares` has what `where_wrong` says.
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
        {place: one["wrong"] for place, one in shares.get(group, {}).items()}
        for group in ("side", "object")
    )
    return {
        "sides": {"front": 0, "back": 0} | sides,
        "objects": objects,
        "hogels": plate,
        "shares": shares,
    }


def where_words(where: Mapping[str, Any]) -> list[str]:
    """Return where hogels are wrong in words, a line for each way to divide the pixels."""
    heads = {
        "side": "side of the plate",
        "object": "object",
        "distance": "distance from outlines of objects",
    }
    heads |= {"row": "row of hogels", "column": "column of hogels", "shown": "where images show"}
    lines = []
    for group, head in heads.items():
        worst = sorted(where.get(group, {}).items(), key=lambda one: -one[1]["fraction"])[:6]
        told = (f"{place} {100 * one['fraction']:.3g} % ({one['wrong']:,})" for place, one in worst)
        lines += [f"{head}: {', '.join(told)}"] if worst else []
    return lines
