"""Mistakes of the scene: axes exchanged or negated, and single objects left out."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.diagnosis import geometry_fit
from xfrustum.compare.diagnosis.faults import Defect
from xfrustum.compare.renderer_model.changed_scene import Matrix, SceneChange, changed
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene

if TYPE_CHECKING:  # it tests what is found here
    from xfrustum.compare.diagnosis.diagnosis import TestSet

Z_NEGATED, AXES_EXCHANGED, OBJECT_MISSING = "z-negated", "axes-exchanged", "object-missing"

# What is drawn in place of x, y and z, and the mistake in words.
EXCHANGED_AXES = {
    "x, y, -z": "z is negated: what belongs before the plate is behind it",
    "x, z, y": "y and z are exchanged",
    "x, z, -y": "y and z are exchanged, and y is negated: the scene is turned by 90 degrees about x",
    "x, -z, y": "y and z are exchanged, and z is negated: the scene is turned by 90 degrees about x",
    "y, x, z": "x and y are exchanged",
    "-x, y, z": "x is negated: the scene is mirrored left to right",
    "x, -y, z": "y is negated: the scene is upside down, as in a mirror",
    "-x, y, -z": "x and z are negated: the scene is seen from behind",
}

# Largest number of objects that are tried to be missing: more of them that images do not show are
# hidden.
MAX_TRIED_OBJECTS = 12

# Smallest number of claims by which axes, or the apertures of one hogel, are told apart.
MIN_PART_CLAIMS = 30

Guess = tuple[geometry_fit.GeometryFit, tuple[Defect, ...]]
"""A guess about cameras and scene, and the faults beside those of the cameras."""


def scene_guesses(evidence: TestSet, fits: Sequence[geometry_fit.GeometryFit]) -> Iterator[Guess]:
    """Yield guesses that have changes of the scene, from fits of the cameras without; likely ones first."""
    # One mistake that turns everything comes before many that turn or leave out each object.
    yield from with_axes(evidence, fits[-1])
    asked = evidence.nominal.parameters
    sure = [fit for fit in fits if fit.holds or np.array_equal(fit.model.parameters, asked)]
    for fit in itertools.chain(sure, [fit for fit in fits if fit not in sure]):
        found = _without_objects(evidence, fit)
        if found is not None:
            yield found


def _named_objects(evidence: TestSet) -> set[int] | None:
    """Return the numbers of the objects that images name; None where they name none."""
    scene, found = evidence.reference.scene, set[int]()
    for image in evidence.images:
        exists = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        found |= set(np.unique(scene.object_of_triangle[image.triangle[exists]]).tolist())
        found |= set(np.unique(image.object[image.object != NOTHING]).tolist())
    return found or None


def _without_objects(evidence: TestSet, fit: geometry_fit.GeometryFit) -> Guess | None:
    """Return a guess with the objects that are missing."""
    scene, named = evidence.reference.scene, _named_objects(evidence)
    model, faults = fit.model, []
    # Black images name no object: that all are missing would explain any of them.
    shown = named is not None or any(
        one.color is not None and one.color.any() for one in evidence.images
    )
    unnamed = [number for number in range(len(scene.objects)) if number not in (named or ())]
    for number in unnamed[:MAX_TRIED_OBJECTS] if shown and len(scene.objects) > 1 else ():
        without = replace(model, changes=(*model.changes, SceneChange(missing=number)))
        if evidence.pays(without, model):
            words = f"{_called(scene, number)} is missing: it is not drawn"
            faults.append(Defect(fault=OBJECT_MISSING, value=_called(scene, number), words=words))
            model = without
    return (replace(fit, model=model), tuple(faults)) if faults else None


def _called(scene: Scene, number: int) -> str:
    return f"object {number} ({PurePath(scene.objects[number].name).stem})"


def with_axes(evidence: TestSet, plain: geometry_fit.GeometryFit) -> Iterator[Guess]:
    """Yield guesses with other axes, those with fewest other mistakes first, then those that hold best."""
    nominal, reference = evidence.nominal, evidence.reference
    claiming = [one for one in evidence.images if (one.triangle != NOTHING).any()]
    hogels, resolution = reference.scene.plate.hogels, reference.scene.frustum.resolution
    ways = [
        replace(nominal, orientation=one, order=two)
        for one in orientations(resolution)
        for two in (orientations(hogels) if len(claiming) > 1 else (UPRIGHT,))
    ]
    found = []
    for value, words in EXCHANGED_AXES.items():
        change = SceneChange(matrix=_matrix(value))
        name = Z_NEGATED if value == "x, y, -z" else AXES_EXCHANGED
        fault = Defect(
            fault=name, value=value, words=f"axes are wrong: {words} ({value} in place of x, y, z)"
        )
        if not claiming:
            # Registration may have turned pictures to suit other axes, and found the order rightly.
            as_found = itertools.product(
                dict.fromkeys((nominal.orientation, plain.model.orientation)),
                dict.fromkeys((nominal.order, plain.model.order)),
            )
            for one, two in as_found:
                model = replace(nominal, orientation=one, order=two, changes=(change,))
                also = (one != nominal.orientation) + (two != nominal.order)
                found.append(
                    (also, float(evidence.wrong(model)), (replace(plain, model=model), (fault,)))
                )
            continue
        claims = geometry_fit.claims_of(changed(reference, (change,)).scene, claiming)
        few, cap = claims.thinned(geometry_fit.MAX_SEARCHED_CLAIMS), resolution[0] / 2
        if len(few) < MIN_PART_CLAIMS:
            return
        left = [float(geometry_fit.outside_px(few, way, cap).mean()) for way in ways]
        if min(left) <= geometry_fit.MAX_NOISE_PX:
            fit = geometry_fit.fit_geometry(claims, nominal, simple=True)
            # A turned scene in turned pictures shows the same as other axes alone: fewer mistakes
            # come first.
            also = (fit.model.orientation != nominal.orientation) + (
                fit.model.order != nominal.order
            )
            fit = replace(fit, model=replace(fit.model, changes=(change,)))
            found.append((also, min(left), (fit, (fault,))))
    yield from (guess for *_, guess in sorted(found, key=lambda one: one[:2]))


def _matrix(axes: str) -> Matrix:
    """Return the matrix by which points are multiplied to have other axes, such as `x, -z, y`."""
    rows = np.zeros((3, 3))
    for row, axis in enumerate(axes.split(", ")):
        rows[row, "xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return _rows(rows)


def _rows(matrix: Floats) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    return (a, b, c), (d, e, f), (g, h, i)
