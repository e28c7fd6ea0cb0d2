"""Mistakes along lines: surfaces cut off by another reach, and a depth buffer that is too coarse."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.diagnosis.faults import Defect
from xfrustum.compare.diagnosis.geometry_fit import GeometryFit
from xfrustum.compare.diagnosis.scene_faults import Guess
from xfrustum.compare.renderer_model.changed_scene import changed
from xfrustum.compare.renderer_model.drawn_model import DEPTH_BITS, DepthBuffer, RendererModel
from xfrustum.compare.renderer_model.pictures import Surfaces, trace_drawn
from xfrustum.scenes.model.hogel_image import NOTHING

if TYPE_CHECKING:  # it tests what is found here
    from xfrustum.compare.diagnosis.diagnosis import TestSet

STARVED_DEPTH = "starved-depth"
REACH = ("reach-front", "reach-back")  # Heights toward the viewer and behind the plate

# Near planes of a coarse depth buffer that are tried, as parts of the reach, and factors of the
# best one that are tried next. With the smallest all surfaces are stored at one depth, with the
# largest nearly none are.
TRIED_NEARS, FINER_NEARS = np.geomspace(1e-8, 1e-2, 121), np.geomspace(0.89, 1.12, 231)

# Smallest number of pixels that a height must make right.
MIN_CUT_PIXELS = 20

# Largest numbers of hogels and of their pixels that near planes are tried on: what they choose, all
# test.
MAX_TRIED_HOGELS, MAX_TRIED_PIXELS = 2, 10_000


def reach_guess(evidence: TestSet, fit: GeometryFit) -> Guess | None:
    """Return a guess in which nothing is drawn beyond other heights than those of the scene's reach.

    A height cuts best where fewest pixels that should show a surface below it are wrong, and fewest
    that should show one beyond it are right. Objects that lie beyond it as wholes may as well be
    missing.
    """
    scene, model = evidence.reference.scene, fit.model
    reference, faults, reach = (
        changed(evidence.reference, model.changes),
        [],
        list(scene.frustum.reach),
    )
    apertures = [model.answers(scene, image.camera.aperture) for image in evidence.tested]
    answers = [trace_drawn(reference, model, one) for one in apertures]
    heights = np.stack([one.height for one in answers]) - model.plate_height
    objects = np.stack([one.object for one in answers])
    wrong = np.stack([model.upright(one) for one in evidence.mask(model)])
    split = False
    for side, (name, asked) in enumerate(zip(REACH, reach, strict=False)):
        distance = -heights if side else heights
        there = distance > 0
        order = np.argsort(distance[there])
        ordered, off, part = (one[there][order] for one in (distance, wrong, objects))
        misplaced = np.cumsum(np.append(0, off)) - np.cumsum(np.append(0, np.logical_not(off)))
        cut = int(misplaced.argmin())
        if 0 < cut < len(off) and misplaced[-1] - misplaced[cut] >= MIN_CUT_PIXELS:
            split |= bool(
                np.isin(part[:cut][np.logical_not(off[:cut])], part[cut:][off[cut:]]).any()
            )
            low, high = ordered[cut - 1 : cut + 1].tolist()
            reach[side] = (low + high) / 2
            where = ("behind the plate", "on the viewer's side")[side == 0]
            words = (
                f"surfaces farther than {reach[side]:.4g} {scene.units} from the plate are missing "
            )
            words += f"{where}: the reach is {asked:.4g} {scene.units}"
            numbers = {"value": reach[side], "low": low, "high": high, "unit": scene.units}
            faults.append(Defect(fault=name, **numbers, words=words))
    return (
        (replace(fit, model=replace(model, reach=(reach[0], reach[1]))), tuple(faults))
        if split
        else None
    )


def find_depth_buffer(
    evidence: TestSet, model: RendererModel
) -> tuple[RendererModel, Defect] | None:
    """Return a guess with the coarse depth buffer that agrees best with images that name triangles."""
    scene, reference = evidence.reference.scene, changed(evidence.reference, model.changes)
    named = [image for image in evidence.tested if (image.triangle != NOTHING).any()]
    if not named:
        return None
    stacks = []
    for image in sorted(named, key=lambda one: -evidence.of([one]).wrong(model))[:MAX_TRIED_HOGELS]:
        aperture = model.answers(scene, image.camera.aperture)
        shown = model.upright(image.triangle).reshape(-1)
        chosen = np.random.default_rng(0).permutation(len(shown))[:MAX_TRIED_PIXELS]
        bundles = [model.bundle(scene, aperture, side) for side in (1, -1)]
        found = [Surfaces.from_bundle(reference, bundle, model.film) for bundle in bundles]
        both = [replace(one, triangle=one.triangle[:, chosen], s=one.s[:, chosen]) for one in found]
        stacks.append((shown[chosen], both))

    def wrong(buffer: DepthBuffer) -> int:
        count = 0
        for shown, (back, front) in stacks:
            (below, _), (above, _) = back.shown(buffer), front.shown(buffer)
            count += int(np.count_nonzero(np.where(above != NOTHING, above, below) != shown))
        return count

    def best_of(buffers: list[DepthBuffer]) -> list[DepthBuffer]:
        counts = [wrong(one) for one in buffers]
        return [one for one, count in zip(buffers, counts, strict=True) if count == min(counts)]

    # Of ways that images cannot tell apart the first one is taken, and the middle one of its near
    # planes.
    nears = (TRIED_NEARS * scene.frustum.longest_reach).tolist()
    ways = [
        {"last_wins": last, "cleared": cleared}
        for last in (False, True)
        for cleared in (True, False)
    ]
    tried = [best_of([DepthBuffer(near=near, **way) for near in nears]) for way in ways]
    alike = min(tried, key=lambda of: wrong(of[0]))
    rough = alike[len(alike) // 2]
    finest = best_of([replace(rough, near=one) for one in (rough.near * FINER_NEARS).tolist()])
    # The nearest values that images exclude, or are no better.
    step = float(FINER_NEARS[1] / FINER_NEARS[0])
    low, high = finest[0].near / step, finest[-1].near * step
    buffer = replace(rough, near=float(np.sqrt(low * high)))
    words = (
        f"depth is stored too coarsely: as by {DEPTH_BITS} bits with a near plane at {buffer.near:.3g} "
        f"{scene.units}; of those at one depth the {'last' if buffer.last_wins else 'first'} drawn wins"
    )
    fault = Defect(
        fault=STARVED_DEPTH, value=buffer.near, low=low, high=high, unit=scene.units, words=words
    )
    return replace(model, depth=buffer), fault
