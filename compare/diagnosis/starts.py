"""The conventions and the numbers from which fits of geometry start: those under which claims fail least."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from xfrustum.compare.diagnosis.claims import Claims
from xfrustum.compare.diagnosis.composition import FLIPPED
from xfrustum.compare.diagnosis.containment import outside_px
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, OneCamera, Recentering
from xfrustum.compare.renderer_model.orientations import UPRIGHT, orientations
from xfrustum.scenes.model.scene import Scene

START_NEARS = (0.0, *np.geomspace(1e-6, 0.3, 12).tolist())
"""Starting points for near, as parts of the reach."""

START_SCALES = (1e-3, 0.03, 0.3, 3.0, 30.0)
"""Starting points for the size of the scene. Places on the film change with the inverse of the size, so that
larger sizes than the last one look like it."""

START_FILMS = (0.5, 2.0, 3.0)
"""Starting points for the extent of the film: a field of view taken for half of it, or half taken for all."""

START_HEIGHTS = (0.5, 2.0)
"""Starting points for the height of the projection screen, over that of the scene's."""

SHEARED_NEAR = 0.03
"""Near offset, as a part of the reach, with which every wrong shear is tried besides none. Smaller offsets
move pictures less than a wrong shear does, and larger ones are rare."""

MAX_STARTS = 4
"""Largest number of starting points from the search that are fitted."""


def starting_points(claims: Claims, scene: Scene, nominal: DrawnModel) -> list[DrawnModel]:
    """Return the best few discrete conventions and starting points for near."""
    cap = scene.frustum.resolution[0] / 2
    reach = scene.frustum.longest_reach
    ranked = []
    # Step 1: every orientation and order, each with a few values of near, scale and film, and, where there is
    # a screen, with every way to shear and a few heights of the screen.
    several = len(np.unique(claims.hogel, axis=0)) > 1
    orders = list(orientations(claims.hogels)) if several else [UPRIGHT]
    for orientation, order in itertools.product(orientations(claims.size), orders):
        upright = replace(nominal, orientation=orientation, order=order)
        tried = [
            replace(upright, near=near) for near in {nominal.near, *(reach * n for n in START_NEARS[::4])}
        ]
        sides = [OneCamera(side, other_near=nominal.near) for side in (-1, 1)]
        tried += [
            replace(upright, near=reach * n, one_camera=one) for one in sides for n in START_NEARS[4::4]
        ]
        tried += [replace(upright, one_camera=replace(one, other_near=nominal.near)) for one in FLIPPED]
        tried += [replace(upright, scene_scale=scale) for scale in START_SCALES]
        tried += [replace(upright, fov=(film, film)) for film in START_FILMS]
        if scene.frustum.recentered:
            tried += [replace(upright, screen_height=height) for height in START_HEIGHTS]
            wrongly = [shear for shear in Recentering if shear is not nominal.recentering]
            nears = dict.fromkeys((nominal.near, reach * SHEARED_NEAR))
            tried += [replace(upright, near=near, recentering=shear) for near in nears for shear in wrongly]
        ranked += [(float(outside_px(claims, scene, model, cap).mean()), model) for model in tried]
    ranked.sort(key=lambda pair: (pair[0], _changes(pair[1])))
    # Step 2: the best conventions, each with all values of near.
    conventions = {
        (model.orientation, model.order, model.recentering, model.one_camera): model
        for _, model in reversed(ranked[:6])
    }
    finely = [
        (float(outside_px(claims, scene, fine, cap).mean()), fine)
        for model in conventions.values()
        for near in {nominal.near, *(reach * part for part in START_NEARS)}
        for fine in (replace(model, near=near),)
    ]
    finely.sort(key=lambda pair: (pair[0], _changes(pair[1])))
    scaled = [model for _, model in ranked if model.scene_scale != nominal.scene_scale]
    filmed = [model for _, model in ranked if model.fov != nominal.fov]
    plainly = [
        model for _, model in ranked if model.recentering is nominal.recentering and model.one_camera is None
    ]
    # One camera alone: the best near offset of each, and the best start of its other numbers.
    upright = plainly[0]
    alone = [
        min(
            (replace(upright, near=reach * n, one_camera=one) for n in START_NEARS),
            key=lambda model: float(outside_px(claims, scene, model, cap).mean()),
        )
        for one in sides
    ]
    raised = [model for _, model in ranked if model.screen_height != nominal.screen_height]
    best = [model for _, model in finely[:MAX_STARTS]]
    # Step 3: the best starts, and the best one of each group that was searched.
    of_groups = (*scaled[:1], *filmed[:1], *plainly[:1], *raised[:1], *alone)
    return list(dict.fromkeys([*best, ranked[0][1], *of_groups]))


def _changes(model: DrawnModel) -> tuple[int, int]:
    """Return the sort key of guesses that fit equally well: the plainest has the smallest."""
    shears = tuple(Recentering).index(model.recentering)
    one = model.one_camera
    flips = 0 if one is None else 1 + one.flip_x + one.flip_y
    return model.orientation.changes + model.order.changes + flips, shears
