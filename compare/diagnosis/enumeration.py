"""Enumerated candidates: composition, axes, objects, single hogels, and equivalent models."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.diagnosis.defects import FLAT, HYPOTHESES, NEAREST, NOT_OVERLAID, Hypothesis
from xfrustum.compare.diagnosis.geometry_fit import (
    MAX_FITTED_CLAIMS,
    MAX_NOISE_PX,
    MAX_SEARCHED_CLAIMS,
    GeometryFit,
    fit_geometry,
)
from xfrustum.compare.diagnosis.registration import with_near
from xfrustum.compare.diagnosis.testset import (
    MIN_OUTLYING_FRACTION,
    TestSet,
    claims_of,
    outside_px,
    shows,
)
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import (
    EVEN,
    Back,
    Front,
    Index,
    Recentering,
    RendererModel,
    screen_lengths,
)
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    Layers,
    as_image,
    as_stored,
    colored,
    drawn,
    drawn_scene,
    trace_drawn,
)
from xfrustum.reference import Reference
from xfrustum.reference.lines import film_window
from xfrustum.scenes.model.images import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene

Picture = NDArray[Any]
"""Numbers (H, W) or colors (H, W, 3) of an upright image."""

# Compositions of the two halves, the correct one first. Exchanging the depth tests causes two
# defects at once.
COMPOSITIONS: tuple[tuple[Hypothesis, ...], ...] = (
    (),
    *((hypothesis,) for hypothesis in HYPOTHESES),
    (NEAREST, NOT_OVERLAID),
)

# Smallest number of pixels that distinguishes two compositions: rounding of outlines may change
# fewer pixels.
MIN_DIFFERING_PIXELS = 20

# A composition is as good as the best if its gain of right pixels is at least this share of the
# best gain. For example, culling the front faces of a closed body gives the same image as drawing
# the surface nearest to the plate. Two percent allow for rounding of outlines.
MIN_ALIKE_FRACTION = 0.98

# Axes drawn in place of x, y and z.
EXCHANGED_AXES = (
    *("x, y, -z", "x, z, y", "x, z, -y", "x, -z, y"),
    *("y, x, z", "-x, y, z", "x, -y, z", "-x, y, -z"),
)

# Smallest number of claims that distinguishes axes, or the apertures of one hogel.
MIN_PART_CLAIMS = 30

# Largest number of objects that are assumed missing.
MAX_MISSING_OBJECTS = 4

# Largest share of hogels that may show images of other apertures; if more are wrong, the cause
# affects the whole plate. Largest distance, in columns and rows, between a hogel and the aperture
# whose image it shows. Largest numbers of apertures drawn per hogel: if claims rank the apertures,
# and if not. Largest share of wrong pixels that may remain.
MAX_ODD_HOGEL_FRACTION, MAX_APART, MAX_RANKED, MAX_NEIGHBORS = 0.5, 9, 2, 12
MAX_LEFT_FRACTION = 0.1

# Quantiles of vertex height at which equivalents of shifts are tried.
TRIED_VERTEX_FRACTIONS = (0.1, 0.3, 0.5, 0.7, 0.9)

# Largest relative difference at which the pitches of columns and rows count as equal: twice the
# largest deviation of a pitch that is not reported (`drawn_model.SMALLEST_FACTOR`).
MAX_PITCH_DIFFERENCE = 1e-3


def compositions(test: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return the candidate whose composition agrees best with images, then equally good candidates.

    Defects of composition and parameters that do not improve the explanation are removed.
    """
    best, *equals = _best_compositions(
        test.reference, model, [image for image in test.images if shows(image)]
    )
    reduced = test.reduced(best) if best != test.nominal else best
    return [best, *filter(test.explains, equals)] if reduced == best else [reduced]


def _best_compositions(
    reference: Reference, model: RendererModel, images: Sequence[HogelImage]
) -> list[RendererModel]:
    # Step 1: do not enumerate if the correct composition explains nearly every pixel.
    right = [_compared(reference, [model], image) for image in images]
    if sum(_differing(made[0], shown) for shown, made in right) < MIN_DIFFERING_PIXELS:
        return [model]

    def possible(way: tuple[Hypothesis, ...]) -> bool:
        fields = set[str]().union(*(hypothesis.fields for hypothesis in way))
        # If one camera deviates already, mirroring is not tried as well. Uneven films are ray
        # traced, without culling. Flat normals differ only in scenes with interpolated normals.
        return not (
            ("one_camera" in fields and model.one_camera is not None)
            or ("culled" in fields and model.film != EVEN)
            or (FLAT in way and reference.scene.surface.vertex_normals is None)
        )

    ways = [
        reduce(lambda made, hypothesis: hypothesis.of(made), way, model)
        for way in filter(possible, COMPOSITIONS)
    ]
    # At least one half must be present.
    ways = [way for way in ways if not (way.back is Back.MISSING and way.front is Front.MISSING)]
    wrong, differing = np.zeros(len(ways)), np.zeros(len(ways))
    for shown, made in (_compared(reference, ways, image) for image in images):
        wrong += [_differing(picture, shown) for picture in made]
        differing += [_differing(picture, made[0]) for picture in made]
    # Step 2: a composition is better if it makes right more than half of the pixels in which it
    # differs from the correct composition. The renderer's actual composition makes all these pixels
    # right.
    gained = wrong[0] - wrong
    better = (differing >= MIN_DIFFERING_PIXELS) & (gained > differing / 2)
    if not better.any():
        return [model]
    # Step 3: keep the best composition, and compositions that gain nearly as much.
    alike = better & (gained >= MIN_ALIKE_FRACTION * gained[better].max())
    return list(itertools.compress(ways, alike))


def _compared(
    reference: Reference, ways: Sequence[RendererModel], image: HogelImage
) -> tuple[Picture, list[Picture]]:
    """Return an upright image and the pictures of candidates: numbers (H, W), or colors."""
    scene, upright = reference.scene, ways[0].orientation.upright
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


def with_axes(test: TestSet, plain: GeometryFit) -> Iterator[GeometryFit]:
    """Yield candidates with other axes, sorted by number of other defects, then by misfit."""
    nominal, scene = test.nominal, test.reference.scene
    claiming = [image for image in test.images if (image.triangle != NOTHING).any()]
    turned = list(orientations(scene.frustum.resolution))
    orders = list(orientations(scene.plate.hogels)) if len(claiming) > 1 else [UPRIGHT]
    if not claiming:
        # Registration may have turned pictures because of other axes, or may be right: try both.
        turned = list(dict.fromkeys((nominal.orientation, plain.model.orientation)))
        orders = list(dict.fromkeys((nominal.order, plain.model.order)))
    ways = [
        replace(nominal, orientation=orientation, order=order)
        for orientation, order in itertools.product(turned, orders)
    ]
    candidates: list[tuple[float, GeometryFit]] = []
    for axes in EXCHANGED_AXES:
        if not claiming:
            models = [replace(way, axes=axes) for way in ways]
            candidates += [(test.wrong(model), replace(plain, model=model)) for model in models]
            continue
        claims = claims_of(drawn_scene(test.reference, replace(nominal, axes=axes)).scene, claiming)
        few, cap = claims.thinned(MAX_SEARCHED_CLAIMS), scene.frustum.resolution[0] / 2
        if len(few) < MIN_PART_CLAIMS:
            return
        least = min(float(outside_px(few, way, cap).mean()) for way in ways)
        if least <= MAX_NOISE_PX:
            fit = fit_geometry(claims, nominal, simple=True)
            candidates.append((least, replace(fit, model=replace(fit.model, axes=axes))))

    def rank(entry: tuple[float, GeometryFit]) -> tuple[int, float]:
        # Several axes, with differently turned pictures, may look alike: prefer fewer defects.
        misfit, model = entry[0], entry[1].model
        others = (model.orientation != nominal.orientation) + (model.order != nominal.order)
        return others, misfit

    yield from (fit for _, fit in sorted(candidates, key=rank))


def without_objects(test: TestSet, fits: Sequence[GeometryFit]) -> Iterator[GeometryFit]:
    """Yield candidates without the objects that cause most wrong pixels and are in no image."""
    scene, named = test.reference.scene, set[int]()
    for image in test.images:
        exists = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        named |= set(np.unique(scene.object_of_triangle[image.triangle[exists]]).tolist())
        named |= set(np.unique(image.object[image.object != NOTHING]).tolist())
    # A scene without objects would explain black images, which name no object.
    lit = any(image.color is not None and image.color.any() for image in test.images)
    if len(scene.objects) < 2 or not (named or lit):
        return
    for fit in fits:
        model = fit.model
        while len(model.missing) < MAX_MISSING_OBJECTS:
            number = _most_wrong_object(test, model)
            without = replace(model, missing=(*model.missing, number))
            if number in named | {NOTHING} or not test.pays(without, model):
                break
            model = without
        if model.missing:
            yield replace(fit, model=model)


def _most_wrong_object(test: TestSet, model: RendererModel) -> int:
    """Return the object that a candidate draws at most of its wrong pixels, or `NOTHING`."""
    reference, counts = drawn_scene(test.reference, model), np.zeros(0, dtype=np.int64)
    for image, wrong in zip(test.tested, test.mask(model, explained=True), strict=True):
        aperture = model.answers(reference.scene, image.camera.aperture)
        shown = model.orientation.applied(trace_drawn(reference, model, aperture).object)[wrong]
        here = np.bincount(shown[shown != NOTHING], minlength=len(reference.scene.objects))
        counts = counts + here if len(counts) else here
    return int(counts.argmax()) if counts.any() else NOTHING


def with_other_hogels(test: TestSet, fits: Sequence[GeometryFit]) -> Iterator[GeometryFit]:
    """Yield candidates in which the wrong hogels, if few, show images of other apertures."""
    most = int(MAX_ODD_HOGEL_FRACTION * len(test.images))
    for fit in fits:
        odd = list(itertools.islice(test.outliers(fit.model), most + 1))
        shows: dict[Index, tuple[Index, ...]] = {}
        for alone in odd if len(odd) <= most else ():
            apertures = _shown_apertures(alone, fit.model)
            if not apertures:
                break
            shows[alone.images[0].camera.aperture.index] = apertures
        if shows and len(shows) == len(odd):
            yield replace(fit, model=replace(fit.model, shows=tuple(shows.items())))


def _shown_apertures(alone: TestSet, model: RendererModel) -> tuple[Index, ...]:
    """Return the apertures whose image one hogel may show, the best first; empty if none fits."""
    (image,), scene = alone.images, alone.reference.scene
    index, likely = image.camera.aperture.index, _likely(scene, model, image)
    left = [
        alone.wrong(replace(model, shows=((index, (other,)),)), explained=True) for other in likely
    ]
    least, wrong = min(left, default=np.inf), alone.wrong(model, explained=True)
    if least > MAX_LEFT_FRACTION * wrong:
        return ()
    # Images of distant scenes may be equal: keep all apertures that fit equally well.
    limit = least + MAX_LEFT_FRACTION * MIN_OUTLYING_FRACTION * image.triangle.size
    ranked = sorted(zip(left, likely, strict=True))
    return tuple(other for count, other in ranked if count <= limit)


def _likely(scene: Scene, model: RendererModel, image: HogelImage) -> list[Index]:
    """Return other apertures whose image a hogel may show: ranked by claims, else neighbors."""
    hogels = scene.plate.hogels
    own = model.order.index(image.camera.aperture.index, hogels)
    columns, rows = (
        range(max(0, place - MAX_APART), min(count, place + MAX_APART + 1))
        for place, count in zip(own, hogels, strict=True)
    )
    others = [other for other in itertools.product(columns, rows) if other != own]
    claims = claims_of(scene, [image])
    if len(claims) < MIN_PART_CLAIMS:
        others.sort(key=lambda other: max(abs(a - b) for a, b in zip(other, own, strict=True)))
        return others[:MAX_NEIGHBORS]
    few, upright = claims.thinned(MAX_FITTED_CLAIMS // 8), replace(model, order=UPRIGHT)

    def misfit(other: Index) -> float:
        there = replace(few, hogel=np.tile(other, (len(few), 1)))
        return float(outside_px(there, upright, 5.0).mean())

    return sorted(others, key=misfit)[:MAX_RANKED]


def equivalents(
    test: TestSet, model: RendererModel, *, by_depth: bool = False
) -> list[RendererModel]:
    """Return candidates with other defects that show the same images, or nearly so (`by_depth`).

    At a single depth of the scene, a near offset n looks like a field of view that is 1 + n / |z|
    times as large, and an offset of the scene or plate looks like a shift of the sampling points.
    """
    same = list(_moved_instead(test, model))
    if tried := list(_sheared_instead(test, model)):
        most = test.wrong(model, explained=True)
        same += [other for other in tried if test.wrong(other, explained=True) <= most]
    if by_depth and model.fov != test.nominal.fov:
        same += filter(test.explains, [with_near(test, model)])
    if by_depth:
        same += filter(test.explains, _moved_at_one_depth(test, model))
    return same


def _moved_instead(test: TestSet, model: RendererModel) -> Iterator[RendererModel]:
    """Yield equivalents of moved or scaled scenes with centered frusta.

    An image depends only on the slopes (P - a) / s from its aperture a to points P at depths s.
    Moving the apertures to one side is equivalent to moving the scene to the other side. Enlarging
    the scene is equivalent to shrinking the plate by the same factor, except for surfaces beyond
    the reach.
    """
    nominal = test.nominal
    if test.reference.scene.frustum.screen is not None:
        return
    (x, y, z), factor, pitch = model.scene_offset, model.scene_scale, model.pitch[0]
    if (x, y) != nominal.scene_offset[:2] and model.aperture_offset == nominal.aperture_offset:
        yield replace(model, aperture_offset=(-x, -y), scene_offset=(0.0, 0.0, z))
    if factor != nominal.scene_scale and model.pitch == nominal.pitch:
        yield replace(model, scene_scale=1.0, pitch=(pitch / factor, pitch / factor))
    elif pitch != nominal.pitch[0] and abs(pitch / model.pitch[1] - 1) <= MAX_PITCH_DIFFERENCE:
        yield replace(model, scene_scale=factor / pitch, pitch=nominal.pitch)


def _moved_at_one_depth(test: TestSet, model: RendererModel) -> Iterator[RendererModel]:
    """Yield candidates whose moved scene or plate looks like a shift at one depth."""
    scene, shift = test.reference.scene, np.asarray(model.shift)
    if scene.frustum.screen is not None:
        shift = shift + np.asarray(model.screen_center) / screen_lengths(scene)
    if not shift.any():
        return
    _, half_extent = film_window(scene.frustum, scene.plate.middle)
    tilt = 2 * shift / scene.frustum.resolution * half_extent * (1, -1)
    plain = replace(model.with_parameters(test.nominal.parameters), fov=model.fov)
    for z in np.quantile(scene.vertices[:, 2], TRIED_VERTEX_FRACTIONS):
        x, y = (tilt * z).tolist()
        yield replace(plain, scene_offset=(x, y, 0.0))
        yield replace(plain, aperture_offset=(-x, -y))


def _sheared_instead(test: TestSet, model: RendererModel) -> Iterator[RendererModel]:
    """Yield candidates that may show the same images as a wrong shear or a moved screen.

    If all visible surfaces are on one side of the plate, the camera of the other side draws no
    pixel. In a single aperture, a missing or reversed shear is equivalent to a moved screen, and a
    reversed shear of one camera is equivalent to a shift of its film.
    """
    nominal, scene = test.nominal, test.reference.scene
    screen, right = scene.frustum.screen, model.recentering is nominal.recentering
    if screen is None:
        return
    if not right and model.recentering is not Recentering.NONE:
        kept = (nominal.recentering, model.recentering, Recentering.NONE)
        yield from (replace(model, recentering=shear) for shear in Recentering if shear not in kept)
    apertures = {model.answers(scene, image.camera.aperture) for image in test.images}
    if len(apertures) != 1:
        return
    factor = model.recentering.factor(1)
    if not right and factor == model.recentering.factor(-1):
        there = model.placed(*apertures)
        moved = (factor - 1) * np.subtract(screen.center, (there.x, there.y))
        x, y = moved.tolist()
        yield replace(model, recentering=nominal.recentering, screen_center=(x, y))
    if model.screen_center != nominal.screen_center:
        for shear in (Recentering.NONE, Recentering.BOTH_REVERSED):
            yield replace(model, recentering=shear, screen_center=nominal.screen_center)
    if model.one_camera is not None:
        back = model.one_camera.side > 0
        shear = Recentering.C_REVERSED if back else Recentering.C_STAR_REVERSED
        yield replace(model, recentering=shear, one_camera=None, shift=nominal.shift)
