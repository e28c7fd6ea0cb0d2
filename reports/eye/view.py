"""What eyes see of a scene, of its replayed truth and of hogels, and where these hogels come from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import TypeAdapter, ValidationError

from xfrustum.compare.eye.loss import (
    Disparity,
    Loss,
    LossMaps,
    Views,
    disparity,
    display_loss,
    pixels_per_degree,
    renderer_loss,
)
from xfrustum.compare.eye.noticeable import moves_rigidly
from xfrustum.compare.eye.shown import (
    DEFAULT_COLOR,
    Collector,
    DrawnHogel,
    collected,
    drawn_hogels,
    film_parts,
    hogels_of,
)
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.eye.pictures import shown
from xfrustum.reports.plate import store
from xfrustum.reports.plate.store import COLOR, DAMAGE, TRIANGLE
from xfrustum.reports.verification.sources import Files, Problem
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.plate_content import FilmPart, PlateContent
from xfrustum.scenes.model.scene import Scene, look_hash
from xfrustum.scenes.notebook import Figure, Shown, Table, counted, digits, percent, png
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset

Index = tuple[int, int]
"""Column and row of a hogel."""

MAX_SHOWN_EYES = 4
"""Largest number of eyes whose pictures a notebook shows."""


class Source(Protocol):
    """Hogels of a scene, by any renderer."""

    name: str  #: The renderer, or where its hogels lie, for people
    settings: DoubleFrustum | None  #: Settings of the cameras that drew them; None where they are not known

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Yield hogels in order; only pixels in the part of each film that is asked for mean anything."""
        ...


class Drawing:
    """Hogels that are drawn when they are asked for, with one sample a pixel.

    Effects are those that are simulated; None for those that the scene calls for.
    """

    settings: DoubleFrustum | None

    def __init__(
        self, scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None
    ) -> None:
        settings.check_against(scene.frustum)
        self.settings = self._how = settings
        self.name = f"near {settings.near:g} {scene.units}, {settings.depth_label}"
        self._scene = replace(scene, sampling=Sampling())
        self._content = PlateContent(color=DEFAULT_COLOR, ids=True, effects=effects)

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Draw the hogels."""
        with PlateRenderer(self._scene, self._how, self._content) as renderer:
            yield from drawn_hogels(renderer, parts)


class StoredPlate:
    """A plate that `xfrustum plate` has drawn from a scene; InputError where there is no such plate."""

    def __init__(self, path: Path, scene: Scene) -> None:
        self.name = path.name
        try:
            plate = store.StoredPlate(path)
            said = plate.description["scene"]
            drawn_from = said["hash"], said["look"]
            kind: TypeAdapter[DoubleFrustum | None] = TypeAdapter(DoubleFrustum | None)
            self.settings = kind.validate_python(plate.description.get("settings"))
        except InputError as error:
            raise InputError(f"--plate {error}") from error
        except (KeyError, TypeError, ValidationError) as error:
            raise InputError(f"--plate {path}: its description is damaged; draw the plate again") from error
        if drawn_from != (scene.content_hash, look_hash(scene)):
            raise InputError(
                f"--plate {path}: was drawn from another scene; draw it again with xfrustum plate"
            )
        self._path, self._scene, self._plate = path, scene, plate
        self._arrays = {name: plate.arrays[name] for name in (TRIANGLE, COLOR) if name in plate.arrays}
        width, height = scene.frustum.resolution
        expected = (*scene.plate.hogels[::-1], height, width)
        if COLOR not in self._arrays or any(a.shape[:4] != expected for a in self._arrays.values()):
            raise InputError(f"--plate {path}: its arrays are damaged; draw the plate again")

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Read the hogels; InputError where some have not been drawn, or cannot be read."""
        missing = [i for i in parts if not self._plate.finished(self._scene.plate.aperture(*i))]
        if missing:
            first = missing[0]
            raise InputError(
                f"--plate {self._path}: {len(missing)} of {len(parts)} hogels that the eyes are shown are "
                f"not there, such as {first[0]},{first[1]}; draw them with xfrustum plate"
            )
        for column, row in parts:
            try:
                arrays = {name: np.asarray(array[row, column]) for name, array in self._arrays.items()}
            except DAMAGE as error:
                raise InputError(
                    f"--plate {self._path}: hogel {column},{row} is damaged; xfrustum plate --check mends it"
                ) from error
            yield DrawnHogel(index=(column, row), color=arrays[COLOR], triangle=arrays.get(TRIANGLE))


class Images:
    """Image files by any renderer, as `verify` reads them: {i} in a name is the column, {j} the row."""

    def __init__(self, pattern: str, scene: Scene, encoding: Encoding = Encoding.RGB) -> None:
        self.name = pattern
        self.settings: DoubleFrustum | None = None
        self._scene = scene
        self._files = Files(pattern=pattern, reference=Reference(scene), encoding=encoding)

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Read the files; InputError where one is missing or cannot be read."""
        apertures = [self._scene.plate.aperture(*index) for index in parts]
        self._files.check(apertures)
        for aperture in apertures:
            try:
                image = self._files.image(aperture)
            except Problem as error:
                raise InputError(str(error)) from error
            if image.triangle.max(initial=-1) >= len(self._scene.faces):
                raise InputError(
                    f"{self._files.path(aperture)}: names a triangle that the scene does not have; "
                    "`xfrustum verify` says how its numbers were stored"
                )
            # Colors alone do not say which surfaces they show, as `verify` tells it.
            named = image.color is None or bool(
                ((image.triangle != NOTHING) | (image.object != NOTHING)).any()
            )
            yield DrawnHogel(
                index=aperture.index,
                color=image.color,
                triangle=image.triangle if named else None,
                object=image.object if named else None,
                position=image.position,
            )


@dataclass(frozen=True, kw_only=True)
class EyeRecord:
    """What one eye loses: an element of `eyes` in `view --json`."""

    eye: tuple[float, float, float]  #: Its position, scene units
    pixels_per_degree: float  #: Pixels of its film in a degree of its view
    display: Loss  #: The loss of the true view by replaying it (A against B)
    renderer: Loss | None  #: What the renderer's hogels lose besides (B against C)


@dataclass(frozen=True, kw_only=True)
class PairRecord:
    """What two eyes, by their numbers, lose in depth: an element of `stereo` in `view --json`."""

    left: int
    right: int
    display: Disparity
    renderer: Disparity | None


@dataclass(frozen=True, kw_only=True)
class ViewRecord:
    """The object that `view --json` prints."""

    eyes: tuple[EyeRecord, ...]
    stereo: tuple[PairRecord, ...]  #: Empty unless pairs are asked for
    units: str  #: Name of the scene's unit of length
    source: str | None  #: The renderer, or where its hogels lie; None where no renderer is judged
    hogels: int  #: Number of hogels that the eyes are shown


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneView(Shown):
    """Pictures of all eyes, their losses pixel by pixel (no renderer's where none is judged), and numbers."""

    scene: Scene
    views: tuple[Views, ...]
    display: tuple[LossMaps, ...]
    renderer: tuple[LossMaps, ...]
    record: ViewRecord
    #: Distance by which everything is seen farther from the plate than it is, scene units; None where that is
    #: not one distance, or where the cameras are not known
    gap: float | None = None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `view --json` prints them."""
        return json_object(self.record)

    def _said(self) -> str:
        hogels = counted(self.record.hogels, "hogel")
        said = f"{self.scene.name!r}, seen by {counted(len(self.views), 'eye')} through {hogels}"
        parts = [f"the display shows {_worst([one.display for one in self.record.eyes])}"]
        renderer = [one.renderer for one in self.record.eyes if one.renderer is not None]
        if renderer:
            parts.append(f"{self.record.source} besides {_worst(renderer)}")
        return f"{said}; {', '.join(parts)}"

    def _tables(self) -> Sequence[Table]:
        first = f"eye, {self.scene.units}"
        head = (first, "pixels per degree", "lost by", "wrong surfaces", "displacement 99 %, arcmin")
        rows = []
        for one in self.record.eyes:
            for name, loss in (("display", one.display), (self.record.source or "", one.renderer)):
                if loss is not None:
                    wrong = "unknown" if loss.fraction is None else percent(loss.fraction)
                    moved = loss.displacement_arcmin
                    place = ", ".join(map(digits, one.eye)), digits(one.pixels_per_degree)
                    rows.append((*place, name, wrong, "-" if moved is None else digits(moved.p99)))
        return (Table(head=head, rows=rows),)

    def _figures(self) -> Sequence[Figure]:
        names = {"true": "true view", "replayed": "replayed truth", "drawn": self.record.source or ""}
        return [
            Figure(caption=f"eye {number}, {words}", content=png(shown(image)))
            for number, seen in enumerate(self.views[:MAX_SHOWN_EYES])
            for name, words in names.items()
            if (image := getattr(seen, name)) is not None
        ]


def _worst(losses: Sequence[Loss]) -> str:
    """Return the largest share of wrong surfaces of some losses in words."""
    known = [loss.fraction for loss in losses if loss.fraction is not None]
    return f"up to {percent(max(known))} wrong surfaces" if known else "an unknown share of wrong surfaces"


def eyes_on_path(eyes: Sequence[Eye], count: int | None) -> tuple[Eye, ...]:
    """Return eyes evenly spaced along the way through some eyes; these alone where no number is asked for."""
    if count is None:
        return tuple(eyes)
    if len(eyes) < 2:
        raise InputError("a path needs at least two eyes: give --eye X,Y,Z;X,Y,Z")
    places = np.array([eye.position for eye in eyes])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    way = np.concatenate(([0.0], np.cumsum(steps)))
    along = np.linspace(0.0, way[-1], count)
    found = np.stack([np.interp(along, way, places[:, axis]) for axis in range(3)], axis=-1)
    return tuple(replace(eyes[0], position=(x, y, z)) for x, y, z in found.tolist())


def stereo_eyes(eyes: Sequence[Eye], distance: float) -> tuple[Eye, ...]:
    """Return a left and a right eye in place of each eye, a distance apart in x."""
    places = [(eye, *eye.position) for eye in eyes]
    return tuple(
        replace(eye, position=(x + side * distance / 2, y, z)) for eye, x, y, z in places for side in (-1, 1)
    )


def view(
    scene: Scene,
    eyes: Sequence[Eye],
    source: Source | None = None,
    *,
    stereo: float | None = None,
    effects: frozenset[Effect] | None = None,
    progress: bool = False,
) -> SceneView:
    """Return what eyes see of a scene, truly, of its replayed truth, and of a renderer's hogels.

    Light is that of one sample a pixel, without light transport, and of the given effects (None: those that
    the scene calls for). Without a source the display alone is judged. Two eyes, `stereo` apart in scene
    units, may take the place of each eye.

    Raises
    ------
    InputError
        There is no eye, one sees the plate from too far aside, or the hogels cannot be had.
    """
    if not eyes:
        raise InputError("view needs at least one eye: give X,Y,Z with Z before the plate")
    chosen = tuple(eyes) if stereo is None else stereo_eyes(eyes, stereo)
    for eye in chosen:
        pixels_per_degree(scene, eye)  # before anything is traced
    reference = EyeReference(scene, effects)
    takes = [reference.replay(eye) for eye in chosen]
    drawn: Sequence[EyeImage | None] = [None] * len(chosen)
    numbered = False  # whether the hogels say which surfaces they show
    if source is not None:
        both = zip(chosen, takes, strict=True)
        collectors = [Collector(scene, eye, taken, source.settings) for eye, taken in both]
        parts = film_parts(takes)
        with progress_bar(len(parts), "hogels", "hogel", shown=progress) as bar:

            def counted_hogels() -> Iterator[DrawnHogel]:
                for hogel in source.hogels(parts):
                    bar.update()
                    yield hogel

            drawn = collected(counted_hogels(), collectors)
        numbered = any(collector.numbered for collector in collectors)
    views = []
    with progress_bar(len(chosen), "eyes", "eye", shown=progress) as bar:
        for eye, taken, image in zip(chosen, takes, drawn, strict=True):
            true, replayed = reference.true_view(eye), reference.replayed(eye)
            views.append(Views(true=true, replayed=replayed, drawn=image, taken=taken))
            bar.update()
    display = tuple(display_loss(reference, seen) for seen in views)
    renderer = tuple(
        renderer_loss(reference, seen, numbered=numbered) for seen in views if seen.drawn is not None
    )
    records = tuple(
        EyeRecord(
            eye=eye.position,
            pixels_per_degree=pixels_per_degree(scene, eye),
            display=display[number].numbers(),
            renderer=renderer[number].numbers() if renderer else None,
        )
        for number, eye in enumerate(chosen)
    )
    pairs = []
    for left in range(0, 0 if stereo is None else len(views), 2):
        by_display, by_renderer = disparity(reference, views[left], views[left + 1])
        pairs.append(PairRecord(left=left, right=left + 1, display=by_display, renderer=by_renderer))
    return SceneView(
        scene=scene,
        views=tuple(views),
        display=display,
        renderer=renderer,
        record=ViewRecord(
            eyes=records,
            stereo=tuple(pairs),
            units=scene.units,
            source=None if source is None else source.name,
            hogels=len(hogels_of(takes)),
        ),
        gap=None if source is None else _gap(scene, source.settings),
    )


def _gap(scene: Scene, settings: DoubleFrustum | None) -> float | None:
    """Return the distance by which a near offset moves all that is seen; None where there is not one."""
    if settings is None or settings.slabs or settings.offset is Offset.NONE:
        return None
    rigid = moves_rigidly(scene.frustum, settings) and settings.fitted_height(scene.frustum) is None
    return settings.near if rigid else None
