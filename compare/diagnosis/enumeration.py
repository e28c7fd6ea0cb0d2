"""Candidates with discrete defects: composition of halves, film, scene, single hogels."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.registration import phase_cross_correlation

from xfrustum.compare.diagnosis.defects import (
    AXES_EXCHANGED,
    EXCHANGED,
    FLAT,
    HYPOTHESES,
    NEAREST,
    NOT_OVERLAID,
    OBJECT_MISSING,
    STALE,
    Z_NEGATED,
    Defect,
    Hypothesis,
)
from xfrustum.compare.diagnosis.geometry_fit import (
    ANGLES,
    MAX_FITTED_CLAIMS,
    MAX_NOISE_PX,
    MAX_SEARCHED_CLAIMS,
    GeometryFit,
    PixelClaims,
    claims_of,
    fit_geometry,
    outside_px,
)
from xfrustum.compare.diagnosis.testset import MIN_OUTLYING_FRACTION, TestSet
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import (
    EVEN,
    Back,
    Film,
    Front,
    Index,
    RendererModel,
)
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    Layers,
    as_image,
    as_stored,
    colored,
    drawn,
    drawn_scene,
)
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene

Picture = NDArray[Any]
"""Numbers (H, W) or colors (H, W, 3) of an upright image."""

Candidate = tuple[GeometryFit, tuple[Defect, ...]]
"""A candidate model, and its defects beside the cameras'."""

# Compositions of the two halves, the right one first. One depth test, taken for the other, makes
# two
# mistakes.
COMPOSITIONS: tuple[tuple[Hypothesis, ...], ...] = (
    (),
    *((hypothesis,) for hypothesis in HYPOTHESES),
    (NEAREST, NOT_OVERLAID),
)

# Smallest number of pixels that distinguishes two compositions: fewer may be outlines that rounding
# has moved.
MIN_DIFFERING_PIXELS = 20

# Smallest gain of right pixels, over the best composition's, of its equals: on closed bodies,
# leaving out the faces toward the viewer leaves the
# surface nearest to the plate. Two percent leave room for outlines, which rounding moves.
MIN_ALIKE_FRACTION = 0.98

# Resolutions, over the nominal one, of pictures that were enlarged.
DRAWN_SIZES = (3 / 4, 2 / 3, 1 / 2, 1 / 3, 1 / 4)

# Axes drawn in place of x, y and z.
EXCHANGED_AXES = (
    *("x, y, -z", "x, z, y", "x, z, -y", "x, -z, y"),
    *("y, x, z", "-x, y, z", "x, -y, z", "-x, y, -z"),
)

# Largest number of objects that are tried to be missing: more of them that images do not show are
# hidden.
MAX_TRIED_OBJECTS = 12

# Smallest number of claims that distinguishes axes, or the apertures of one hogel.
MIN_PART_CLAIMS = 30

# Largest share of an outlier's wrong pixels that may stay wrong when it is taken for another
# hogel's image; apertures that its image is compared with, nearest first: all neighbors, and the
# next ones; and number of outliers after which the search ends, if none shows another's image.
MAX_LEFT_FRACTION, MAX_TRIED_APERTURES, MAX_FAILED_HOGELS = 0.1, 12, 3


def compositions(
    reference: Reference, model: RendererModel, images: Sequence[HogelImage]
) -> tuple[RendererModel, ...]:
    """Return a candidate with the composition that images agree with best, then its equals."""
    # Step 1: nothing is to be enumerated where the right composition explains nearly every pixel.
    right = [compared(reference, [model], image) for image in images]
    if sum(_differing(made[0], shown) for shown, made in right) < MIN_DIFFERING_PIXELS:
        return (model,)
    # A camera that is off by itself is not mirrored too.
    ways = [
        reduce(lambda made, hypothesis: hypothesis.of(made), way, model)
        for way in COMPOSITIONS
        if (
            model.one_camera is None
            or not any("one_camera" in hypothesis.fields for hypothesis in way)
        )
        # Nor is anything culled where a ray tracer draws.
        and (model.film == EVEN or not any("culled" in hypothesis.fields for hypothesis in way))
        and (FLAT not in way or reference.scene.surface.vertex_normals is not None)
    ]
    # At least one half is there.
    ways = [way for way in ways if not (way.back is Back.MISSING and way.front is Front.MISSING)]
    wrong, differing = np.zeros(len(ways)), np.zeros(len(ways))
    for shown, made in (compared(reference, ways, image) for image in images):
        wrong += [_differing(picture, shown) for picture in made]
        differing += [_differing(picture, made[0]) for picture in made]
    # Step 2: a composition is better where it makes more than half of the pixels right in which it
    # differs from the right one. The renderer's own makes all of them right.
    gained = wrong[0] - wrong
    better = (differing >= MIN_DIFFERING_PIXELS) & (gained > differing / 2)
    if not better.any():
        return (model,)
    # Step 3: the best composition, and those that gain nearly as much.
    alike = np.flatnonzero(better & (gained >= MIN_ALIKE_FRACTION * gained[better].max()))
    return tuple(ways[index] for index in alike.tolist())


def compared(
    reference: Reference, ways: Sequence[RendererModel], image: HogelImage
) -> tuple[Picture, list[Picture]]:
    """Return an image, upright, and the pictures of some candidates: numbers (H, W), or colors."""
    scene, upright = reference.scene, ways[0].upright
    aperture, known = ways[0].answers(scene, image.camera.aperture), Layers()
    layers = [drawn(reference, way, aperture, known) for way in ways]
    if (image.triangle != NOTHING).any():
        return upright(image.triangle), [layer.triangle for layer in layers]
    answers = [as_image(reference, aperture, layer) for layer in layers]
    if (image.object != NOTHING).any() or image.color is None:
        return upright(image.object), [answer.object for answer in answers]
    colors = [colored(scene, way, answer) for way, answer in zip(ways, answers, strict=True)]
    return upright(image.color), [np.asarray(as_stored(color, image).color) for color in colors]


def _differing(entry: Picture, other: Picture) -> int:
    if entry.ndim == 2:
        return int(np.count_nonzero(entry != other))
    return int(np.count_nonzero((np.abs(entry - other) > COLOR_TOLERANCE).any(axis=-1)))


def films(few: TestSet) -> Iterator[Film]:
    """Yield films on which pixels may lie: rolled, unsheared, enlarged, of equal angles."""
    rolls = []
    for image in few.images:
        shown, (right,) = compared(few.reference, [few.nominal], image)
        if not (shown.any() and right.any()):  # black pictures lie nowhere
            continue
        # Neighboring numbers are unrelated: each gets a gray of its own.
        grays = [
            entry.mean(axis=-1) if entry.ndim == 3 else entry * 0.618 % 1
            for entry in (shown, right)
        ]
        down, across = phase_cross_correlation(*grays)[0].astype(int).tolist()
        rolls.append((across, down))
    yield from (Film(rolled=rolled) for rolled in dict.fromkeys(rolls))
    if few.reference.scene.frustum.recentered:
        yield Film(unsheared=True)
    for size in DRAWN_SIZES:
        yield Film(size=size)
        if all(image.color is not None for image in few.images):
            yield Film(size=size, smooth=True)
    if not any((image.triangle != NOTHING).any() for image in few.images):
        # The fit of geometry has tried them for triangles.
        yield from (Film(angles=angles) for angles in ANGLES)


def with_axes(test: TestSet, plain: GeometryFit) -> Iterator[Candidate]:
    """Yield candidates with other axes, fewest other defects first, then those that hold best."""
    nominal, reference = test.nominal, test.reference
    claiming = [image for image in test.images if (image.triangle != NOTHING).any()]
    hogels, resolution = reference.scene.plate.hogels, reference.scene.frustum.resolution
    orders = orientations(hogels) if len(claiming) > 1 else (UPRIGHT,)
    ways = [
        replace(nominal, orientation=orientation, order=order)
        for orientation, order in itertools.product(orientations(resolution), list(orders))
    ]
    if not claiming:
        # Registration may have turned pictures to suit other axes, and found the order rightly.
        ways = [
            replace(nominal, orientation=orientation, order=order)
            for orientation, order in itertools.product(
                dict.fromkeys((nominal.orientation, plain.model.orientation)),
                dict.fromkeys((nominal.order, plain.model.order)),
            )
        ]
    ranked: list[tuple[int, float, Candidate]] = []

    def add(axes: str, fit: GeometryFit, misfit: float) -> None:
        # A turned scene in turned pictures shows the same as other axes alone: fewer defects first.
        model = replace(fit.model, axes=axes)
        others = (model.orientation != nominal.orientation) + (model.order != nominal.order)
        name = Z_NEGATED if axes == "x, y, -z" else AXES_EXCHANGED
        defects = (Defect(fault=name, value=axes),)
        ranked.append((others, misfit, (replace(fit, model=model), defects)))

    for axes in EXCHANGED_AXES:
        if not claiming:
            for way in ways:
                model = replace(way, axes=axes)
                add(axes, replace(plain, model=model), float(test.wrong(model)))
            continue
        scene = drawn_scene(reference, replace(nominal, axes=axes)).scene
        claims = claims_of(scene, claiming)
        few, cap = claims.thinned(MAX_SEARCHED_CLAIMS), resolution[0] / 2
        if len(few) < MIN_PART_CLAIMS:
            return
        least = min(float(outside_px(few, way, cap).mean()) for way in ways)
        if least <= MAX_NOISE_PX:
            add(axes, fit_geometry(claims, nominal, simple=True), least)
    yield from (candidate for *_, candidate in sorted(ranked, key=lambda entry: entry[:2]))


def without_objects(test: TestSet, fits: Sequence[GeometryFit]) -> Iterator[Candidate]:
    """Yield candidates without the objects that images do not name, from fits of the cameras."""
    scene, named = test.reference.scene, set[int]()
    for image in test.images:
        exists = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        named |= set(np.unique(scene.object_of_triangle[image.triangle[exists]]).tolist())
        named |= set(np.unique(image.object[image.object != NOTHING]).tolist())
    # Black images name no object: that all are missing would explain any of them.
    lit = any(image.color is not None and image.color.any() for image in test.images)
    if len(scene.objects) < 2 or not (named or lit):
        return
    unnamed = [number for number in range(len(scene.objects)) if number not in named]
    stated = test.nominal.parameters
    sure = [fit for fit in fits if fit.holds or np.array_equal(fit.model.parameters, stated)]
    for fit in (*sure, *(fit for fit in fits if fit not in sure)):
        model, defects = fit.model, []
        for number in unnamed[:MAX_TRIED_OBJECTS]:
            without = replace(model, missing=(*model.missing, number))
            if test.pays(without, model):
                name = PurePath(scene.objects[number].name).stem
                defects.append(Defect(fault=OBJECT_MISSING, value=f"object {number} ({name})"))
                model = without
        if defects:
            yield replace(fit, model=model), tuple(defects)


def with_other_hogels(
    test: TestSet, claims: PixelClaims | None, fits: Sequence[GeometryFit]
) -> Iterator[Candidate]:
    """Yield candidates in which hogels show images of other apertures."""
    # Without claims every candidate is drawn: only the best and the nominal one are tried.
    for fit in fits if claims is not None else list(dict.fromkeys((fits[0], fits[-1]))):
        shows = _shown_apertures(test, claims, fit.model)
        if not shows:
            continue
        first = {index: others[0] for index, others in shows.items()}
        pairs = {index for index, other in first.items() if first.get(other) == index}
        defects = tuple(
            Defect(
                fault=name,
                value=f"{len(chosen)} hogels",
                details=tuple(
                    (entry, tuple(shows[entry])) for entry in sorted(chosen, key=_by_row)
                ),
            )
            for name, chosen in ((STALE, first.keys() - pairs), (EXCHANGED, pairs))
            if chosen
        )
        yield replace(fit, model=replace(fit.model, shows=tuple(first.items()))), defects


def _by_row(index: Index) -> Index:
    return index[::-1]


def _shown_apertures(
    test: TestSet, claims: PixelClaims | None, model: RendererModel
) -> dict[Index, list[Index]]:
    """Return, for outlying hogels, the apertures whose images they show, the best first."""
    scene, shows, failed = test.reference.scene, dict[Index, list[Index]](), 0
    for image in test.images:
        alone, index = test.of([image]), image.camera.aperture.index
        if not alone.outlying(model):
            continue
        likely = _likely(scene, claims, model, index)
        left = [
            alone.wrong(replace(model, shows=((index, other),)), explained=True) for other in likely
        ]
        if min(left, default=np.inf) <= MAX_LEFT_FRACTION * alone.wrong(model, explained=True):
            # Images of far scenes may not differ: all that are as good are kept.
            limit = min(left) + MAX_LEFT_FRACTION * MIN_OUTLYING_FRACTION * image.triangle.size
            ranked = sorted(zip(left, likely, strict=True))
            shows[index] = [other for count, other in ranked if count <= limit]
        else:
            failed += 1
        if failed > MAX_FAILED_HOGELS and not shows:
            break
    return shows


def _likely(
    scene: Scene, claims: PixelClaims | None, model: RendererModel, index: Index
) -> list[Index]:
    """Return other apertures whose image a hogel may show: by claims, or neighbors."""
    columns, rows = scene.plate.hogels
    own = model.order.index(index, (columns, rows))

    def apart(other: Index) -> tuple[int, int]:
        distance = max(abs(other[0] - own[0]), abs(other[1] - own[1]))
        return distance, -(other[1] * columns + other[0])

    nearby = range(max(0, own[1] - 9), min(rows, own[1] + 10))
    others = [(i, j) for j in nearby for i in range(columns) if (i, j) != own]
    near = sorted(others, key=apart)[: 32 * MAX_TRIED_APERTURES]
    mine = None if claims is None else claims.chosen((claims.hogel == index).all(axis=1))
    if mine is None or len(mine) < MIN_PART_CLAIMS:
        return near[:MAX_TRIED_APERTURES]
    few, upright = mine.thinned(MAX_FITTED_CLAIMS // 8), replace(model, order=UPRIGHT)

    def misfit(other: Index) -> float:
        there = replace(few, hogel=np.tile(other, (len(few), 1)))
        return float(outside_px(there, upright, 5.0).mean())

    return sorted(near, key=misfit)[:2]
