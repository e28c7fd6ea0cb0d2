"""Mistakes of the scene: axes exchanged or negated, and single objects left out, moved, turned or resized.

An object is fitted to its own claims alone, under a guess about the cameras that the other objects'
claims hold under: an object that is off does not mislead the fit of the others.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from xfrustum.compare.diagnosis import geometry_fit
from xfrustum.compare.diagnosis.faults import Defect, moved_words
from xfrustum.compare.diagnosis.registration import fit_drawn
from xfrustum.compare.renderer_model.changed_scene import Matrix, SceneChange, changed, middle_of
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import (
    SMALLEST_SHIFT_PX,
    RendererModel,
    places,
    smallest_named,
)
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene

if TYPE_CHECKING:  # it tests what is found here
    from xfrustum.compare.diagnosis.diagnosis import TestSet

Z_NEGATED, AXES_EXCHANGED, OBJECT_MISSING, OBJECT_MOVED = (
    "z-negated",
    "axes-exchanged",
    "object-missing",
    "object-moved",
)
OBJECT_TURNED, OBJECT_SCALE = "object-turned", "object-scale"

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

# Largest number of objects that are tried to be missing, or to be off by themselves: more of them
# that images do not show are hidden.
MAX_TRIED_OBJECTS = 12

# Smallest number of claims of one object, or of one hogel, that are fitted by themselves.
MIN_PART_CLAIMS = 30

# Largest distance, in pixels, by which claims may fail under the numbers of one object or hogel:
# the shift that is too small to have a name, for these claims have no other fault left to stand
# for.
MAX_PART_NOISE_PX = SMALLEST_SHIFT_PX

# Turns, in degrees, about each axis from which fits start, and smallest turn and factor that have a
# name.
START_TURNS = (0.0, -150.0, -90.0, -45.0, -15.0, 15.0, 45.0, 90.0, 150.0, 180.0)
TURNS = [np.eye(3)[axis] * np.radians(angle) for axis in range(3) for angle in START_TURNS]
SMALLEST_TURN_DEG = 0.05

# Factors of an object's size from which fits to pictures start; and the largest numbers of objects
# that are fitted to pictures, and of these: one hogel and another tell how far away an object is.
START_FACTORS, MAX_DRAWN_OBJECTS, MAX_DRAWN_HOGELS = (1.0, 0.25, 0.5, 0.7, 1.4, 2.0, 4.0), 3, 2

# Numbers of a change: a move (3), a turn (3), the logarithm of a factor (1). The simplest kinds
# come first.
MOVE, TURN, SIZE = slice(0, 3), slice(3, 6), slice(6, 7)
KINDS_OF_CHANGE = ((MOVE,), (TURN,), (SIZE,), (SIZE, MOVE), (TURN, MOVE))

Guess = tuple[geometry_fit.GeometryFit, tuple[Defect, ...]]
"""A guess about cameras and scene, and the faults beside those of the cameras."""


def scene_guesses(
    evidence: TestSet,
    claims: geometry_fit.PixelClaims | None,
    fits: Sequence[geometry_fit.GeometryFit],
) -> Iterator[Guess]:
    """Yield guesses that have changes of the scene, from fits of the cameras without; likely ones first."""
    # One mistake that turns everything comes before many that turn or leave out each object.
    yield from with_axes(evidence, fits[-1])
    others = _without_one_object(claims, evidence.nominal) if claims is not None else iter(())
    # An object that is off misleads a fit to all claims, which then does not hold: those to the
    # claims of the other objects come before it.
    asked = evidence.nominal.parameters
    sure = [fit for fit in fits if fit.holds or np.array_equal(fit.model.parameters, asked)]
    for fit in itertools.chain(sure, others, [fit for fit in fits if fit not in sure]):
        found = _with_objects(evidence, claims, fit)
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


def _with_objects(
    evidence: TestSet, claims: geometry_fit.PixelClaims | None, fit: geometry_fit.GeometryFit
) -> Guess | None:
    """Return a guess with the objects that are missing, and those that are off by themselves."""
    scene, named = evidence.reference.scene, _named_objects(evidence)
    model, faults = fit.model, []
    # Black images name no object: that all are missing would explain any of them.
    shown = named is not None or any(
        one.color is not None and one.color.any() for one in evidence.images
    )
    unnamed = [number for number in range(len(scene.objects)) if number not in (named or ())]
    for number in unnamed[:MAX_TRIED_OBJECTS] if shown and len(scene.objects) > 1 else ():
        without = replace(model, changes=(*model.changes, SceneChange(part=number, missing=True)))
        if evidence.pays(without, model):
            words = f"{_called(scene, number)} is missing: it is not drawn"
            faults.append(Defect(fault=OBJECT_MISSING, value=_called(scene, number), words=words))
            model = without
    for number in (
        _wrong_objects(evidence, model) if claims is None else _off_by_themselves(claims, model)
    ):
        if claims is None:
            change = _fitted_to_pictures(evidence, model, number)
        else:
            change = _fitted(claims.chosen(claims.part == number), model, number)
        moved = model if change is None else replace(model, changes=(*model.changes, change))
        if change is not None and evidence.pays(moved, model):
            faults.append(_fault(scene, change))
            model = moved
    return (replace(fit, model=model), tuple(faults)) if faults else None


def _off_by_themselves(claims: geometry_fit.PixelClaims, model: RendererModel) -> list[int]:
    """Return the objects many of whose claims fail, where those of some other object hold."""
    off: Mask = geometry_fit.outside_px(claims, model, np.inf) > MAX_PART_NOISE_PX
    numbers, which, counts = np.unique(claims.part, return_inverse=True, return_counts=True)
    odd = np.bincount(which, off) / counts >= geometry_fit.MIN_SPOILED_FRACTION
    wanted = odd & (counts >= MIN_PART_CLAIMS)
    return numbers[wanted].tolist()[:MAX_TRIED_OBJECTS] if not odd.all() else []


def _wrong_objects(evidence: TestSet, model: RendererModel) -> list[int]:
    """Return the objects that most wrong pixels of pictures show, or should show."""
    reference = changed(evidence.reference, model.changes)
    counts = np.zeros(len(reference.scene.objects) + 1, dtype=np.int64)
    for image, wrong in zip(evidence.tested, evidence.mask(model), strict=True):
        answer = trace_drawn(
            reference, model, model.answers(reference.scene, image.camera.aperture)
        )
        for objects in (model.applied(answer.object), image.object):
            counts += np.bincount(objects[wrong] + 1, minlength=len(counts))[: len(counts)]
    order = np.argsort(-counts[1:], kind="stable").tolist()
    return [number for number in order if counts[number + 1]][:MAX_DRAWN_OBJECTS]


def _fitted_to_pictures(evidence: TestSet, model: RendererModel, number: int) -> SceneChange | None:
    """Return the simplest change of an object under which pictures are as drawn; None where there is none."""
    odd = sorted(evidence.tested, key=lambda one: -evidence.of([one]).wrong(model))[
        :MAX_DRAWN_HOGELS
    ]
    few = evidence.of(odd)

    def of(values: Floats) -> RendererModel:
        return replace(model, changes=(*model.changes, _change(number, values)))

    starts = [np.append(np.zeros(6), np.log(factor)) for factor in START_FACTORS]
    starts += [np.concatenate((np.zeros(3), turn, np.zeros(1))) for turn in TURNS]
    whole = fit_drawn(few, of, min(starts, key=lambda start: few.wrong(of(start))), roughly=True)
    if few.wrong(of(whole)) > few.wrong(model) / 2:
        return None
    for kind in KINDS_OF_CHANGE:
        places = np.eye(7)[np.concatenate([np.arange(7)[numbers] for numbers in kind])]

        def only(values: Floats, places: Floats = places) -> RendererModel:
            return of(values @ places)

        values = fit_drawn(few, only, places @ whole)
        if evidence.explains(only(values)):
            return _change(number, values @ places)
    return None


def _without_one_object(
    claims: geometry_fit.PixelClaims, nominal: RendererModel
) -> Iterator[geometry_fit.GeometryFit]:
    """Yield fits of the cameras to the claims of all objects but one, where these hold."""
    numbers, counts = np.unique(claims.part, return_counts=True)
    for number in (
        numbers[np.argsort(-counts)].tolist()[:MAX_TRIED_OBJECTS] if len(numbers) > 1 else ()
    ):
        fit = geometry_fit.fit_geometry(claims.chosen(claims.part != number), nominal, simple=True)
        if fit.noise_px <= MAX_PART_NOISE_PX and fit.model != nominal:
            yield fit


def _changed_claims(
    claims: geometry_fit.PixelClaims, change: SceneChange
) -> geometry_fit.PixelClaims:
    middle = np.zeros(3) if change.part is None else middle_of(claims.scene, change.part)
    return replace(claims, corners=change.applied(claims.corners, middle))


def _change(number: int, values: Floats) -> SceneChange:
    """Return the change of an object that seven numbers stand for."""
    matrix = Rotation.from_rotvec(values[TURN]).as_matrix() * np.exp(values[SIZE])
    x, y, z = values[MOVE].tolist()
    return SceneChange(part=number, matrix=_rows(matrix), offset=(x, y, z))


def _fitted(
    claims: geometry_fit.PixelClaims, model: RendererModel, number: int
) -> SceneChange | None:
    """Return the simplest change of an object under which its claims hold; None where there is none."""
    scene, cap = claims.scene, max(claims.scene.frustum.resolution) / 2
    few, some = (
        claims.thinned(geometry_fit.MAX_SEARCHED_CLAIMS // 4),
        claims.thinned(geometry_fit.MAX_FITTED_CLAIMS),
    )
    # A step of each number: as far as the object is moved by a hundredth of its own size.
    size = float(np.ptp(scene.objects[number].vertices, axis=0).max())
    scales = np.array([0.01 * size] * 3 + [0.01] * 4)

    def failing(of: geometry_fit.PixelClaims, values: Floats) -> Floats:
        return geometry_fit.outside_px(_changed_claims(of, _change(number, values)), model, cap)

    for kind in KINDS_OF_CHANGE:
        free = np.concatenate([np.arange(7)[numbers] for numbers in kind])
        starts = [np.zeros(7)]
        if TURN in kind:
            starts = [np.concatenate((np.zeros(3), turn, np.zeros(1))) for turn in TURNS]
            starts = sorted(starts, key=lambda start: float(failing(few, start).mean()))[:4]
        for start in starts:
            values = start.copy()
            for of, attraction, trials in (
                (few, geometry_fit.ATTRACTION_PX, 20),
                (some, geometry_fit.SNAP_PX, 25),
            ):

                def misfit(
                    scaled: Floats,
                    of: geometry_fit.PixelClaims = of,
                    values: Floats = values,
                    free: Indices = free,
                ) -> Floats:
                    values[free] = scaled * scales[free]
                    return failing(of, values)

                options = {
                    "loss": "soft_l1",
                    "f_scale": attraction,
                    "x_scale": "jac",
                    "max_nfev": trials,
                }
                found = least_squares(misfit, values[free] / scales[free], **options)
                values[free] = found.x * scales[free]
            if (
                np.quantile(failing(some, values), 1 - geometry_fit.MAX_MISPLACED_FRACTION)
                <= MAX_PART_NOISE_PX
            ):
                return _change(number, values)
    return None


def _called(scene: Scene, number: int) -> str:
    return f"object {number} ({PurePath(scene.objects[number].name).stem})"


def _fault(scene: Scene, change: SceneChange) -> Defect:
    """Return the fault of an object that is off by itself."""
    assert change.part is not None
    called, matrix = _called(scene, change.part), np.array(change.matrix)
    factor = float(np.cbrt(np.linalg.det(matrix)))
    turn = np.degrees(Rotation.from_matrix(matrix / factor).as_rotvec())
    angle, length = float(np.linalg.norm(turn)), float(np.linalg.norm(change.offset))
    smallest = float(smallest_named(scene)[places("scene-offset")].min())
    moved = moved_words(scene, change.offset, max(smallest, 0.01 * length))
    also = f", and {moved}" if length > smallest else ""
    if angle > SMALLEST_TURN_DEG:
        along = turn / angle
        axis = "xyz"[int(np.abs(along).argmax())]
        words = ", ".join(f"{one:.3g}" for one in along)
        if np.abs(along).max() > np.cos(np.radians(SMALLEST_TURN_DEG * 10)):
            words, angle = axis, angle * float(np.sign(along["xyz".index(axis)]))
        words = f"{called} is turned by {angle:.3g} degrees about {words}, through its middle{also}"
        return Defect(fault=OBJECT_TURNED, value=angle, unit="degrees", words=words)
    if abs(factor - 1) > float(smallest_named(scene)[places("scene-scale")].min()):
        words = f"{called} is {factor:.4g} times as large as asked, about its middle{also}"
        return Defect(fault=OBJECT_SCALE, value=factor, unit="ratio", words=words)
    return Defect(fault=OBJECT_MOVED, value=length, unit=scene.units, words=f"{called} is {moved}")


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
