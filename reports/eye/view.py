"""What eyes see of a scene, of its replayed truth and of hogels, and where these hogels come from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

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
from xfrustum.compare.eye.moved import moves_rigidly
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
from xfrustum.scenes.model.eye import Eye, EyeImage, Replay
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.plate_content import FilmPart, PlateContent
from xfrustum.scenes.model.scene import Scene, look_hash
from xfrustum.scenes.notebook import Figure, Shown, Table, counted, digits, percent, png
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset

Index = tuple[int, int]
"""Column and row of a hogel."""


class Source(Protocol):
    """Hogels of a scene, by any renderer.

    Attributes
    ----------
    name
        The renderer, or where its hogels lie, for people.
    settings
        Settings of the cameras that drew them; None where they are not known.
    """

    name: str
    settings: DoubleFrustum | None

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Yield hogels in order; only pixels in the part of each film that is asked for mean anything."""
        ...


class Drawing:
    """Hogels that are drawn when they are asked for, with one sample a pixel.

    Parameters
    ----------
    scene, settings
        Scene that is drawn, and settings of its cameras.
    effects
        Effects that are simulated; None for those that the scene calls for.

    Raises
    ------
    InputError
        The settings do not fit the scene.
    """

    def __init__(
        self, scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None
    ) -> None:
        settings.check_against(scene.frustum)
        self.settings: DoubleFrustum | None = settings
        self.name = f"near {settings.near:g} {scene.units}, {settings.depth_label}"
        self._scene, self._how = scene, settings
        self._content = PlateContent(color=DEFAULT_COLOR, ids=True, effects=effects)

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Draw the hogels."""
        scene = replace(self._scene, sampling=Sampling())
        with PlateRenderer(scene, self._how, self._content) as renderer:
            yield from drawn_hogels(renderer, parts)


class StoredPlate:
    """A plate that `xfrustum plate` has drawn.

    Parameters
    ----------
    path
        Folder of the Zarr group.
    scene
        Scene that it must have been drawn from.

    Raises
    ------
    InputError
        There is no such plate, or it was drawn from another scene.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        self.name = path.name
        try:
            plate = store.StoredPlate(path)
        except InputError as error:
            raise InputError(f"--plate {error}") from error
        of_scene, given = plate.description.get("scene"), plate.description.get("settings")
        if not isinstance(of_scene, dict):
            raise InputError(f"--plate {path}: its description is damaged; draw the plate again")
        if (of_scene.get("hash"), of_scene.get("look")) != (scene.content_hash, look_hash(scene)):
            raise InputError(
                f"--plate {path}: was drawn from another scene; draw it again with xfrustum plate"
            )
        names = {field.name for field in fields(DoubleFrustum)}
        self.settings: DoubleFrustum | None = None
        if isinstance(given, dict):
            settings = {name: value for name, value in given.items() if name in names}
            self.settings = DoubleFrustum(**settings)
        self._path, self._scene, self._plate = path, scene, plate
        self._arrays = {name: plate.arrays[name] for name in (TRIANGLE, COLOR) if name in plate.arrays}
        width, height = scene.frustum.resolution
        expected = (*scene.plate.hogels[::-1], height, width)
        if COLOR not in self._arrays or any(a.shape[:4] != expected for a in self._arrays.values()):
            raise InputError(f"--plate {path}: its arrays are damaged; draw the plate again")

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Read the hogels.

        Raises
        ------
        InputError
            Some have not been drawn, or cannot be read.
        """
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


@dataclass(kw_only=True)
class Images:
    """Image files by any renderer, as `verify` reads them.

    Attributes
    ----------
    pattern
        Pattern of the files' names: {i} is the column, {j} the row.
    scene
        Scene that they show.
    encoding
        Meaning of pictures' pixels; OpenEXR files say it themselves.
    """

    pattern: str
    scene: Scene
    encoding: Encoding = Encoding.RGB

    def __post_init__(self) -> None:
        self.name = self.pattern
        self.settings: DoubleFrustum | None = None
        self._files = Files(
            pattern=self.pattern, reference=Reference(self.scene), encoding=Encoding(self.encoding)
        )

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Read the files.

        Raises
        ------
        InputError
            One is missing or cannot be read.
        """
        apertures = [self.scene.plate.aperture(*index) for index in parts]
        self._files.check(apertures)
        for aperture in apertures:
            try:
                image = self._files.image(aperture)
            except Problem as error:
                raise InputError(str(error)) from error
            beyond = image.triangle.max(initial=-1) >= len(self.scene.faces)
            if beyond:
                raise InputError(
                    f"{self._files.path(aperture)}: names a triangle that the scene does not have; "
                    "`xfrustum verify` says how its numbers were stored"
                )
            named = _names_surfaces(image)
            yield DrawnHogel(
                index=aperture.index,
                color=image.color,
                triangle=image.triangle if named else None,
                object=image.object if named else None,
                position=image.position,
            )


def _names_surfaces(image: HogelImage) -> bool:
    """Return whether an image says which surfaces it shows, as `verify` tells it: colors alone do not."""
    return image.color is None or bool(((image.triangle != NOTHING) | (image.object != NOTHING)).any())


MAX_SHOWN_EYES = 4
"""Largest number of eyes whose pictures a notebook shows."""


@dataclass(frozen=True, kw_only=True)
class EyeRecord:
    """What one eye loses: an element of `eyes` in `view --json`.

    Attributes
    ----------
    eye
        Its position, scene units.
    pixels_per_degree
        Pixels of its film in a degree of its view.
    display
        The loss of the true view by replaying it (A against B).
    renderer
        What the renderer's hogels lose besides (B against C); None where no renderer is judged.
    """

    eye: tuple[float, float, float]
    pixels_per_degree: float
    display: Loss
    renderer: Loss | None


@dataclass(frozen=True, kw_only=True)
class PairRecord:
    """What two eyes lose in depth: an element of `stereo` in `view --json`.

    Attributes
    ----------
    left, right
        Numbers of the eyes.
    display, renderer
        Errors of disparity that display and renderer make.
    """

    left: int
    right: int
    display: Disparity
    renderer: Disparity | None


@dataclass(frozen=True, kw_only=True)
class ViewRecord:
    """The object that `view --json` prints.

    Attributes
    ----------
    eyes
        One record for each eye.
    stereo
        One record for each pair of eyes; empty unless pairs are asked for.
    units
        Name of the scene's unit of length.
    source
        The renderer, or where its hogels lie; None where no renderer is judged.
    hogels
        Number of hogels that the eyes are shown.
    """

    eyes: tuple[EyeRecord, ...]
    stereo: tuple[PairRecord, ...]
    units: str
    source: str | None
    hogels: int


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneView(Shown):
    """Pictures, maps and numbers of all eyes.

    Attributes
    ----------
    scene
        Scene that is looked at.
    views, display, renderer
        Pictures of each eye, and its losses pixel by pixel; no renderer's where none is judged.
    record
        The numbers.
    gap
        Distance by which everything is seen farther from the plate than it is, scene units; None where that
        is not one distance, or where the cameras are not known.
    """

    scene: Scene
    views: tuple[Views, ...]
    display: tuple[LossMaps, ...]
    renderer: tuple[LossMaps, ...]
    record: ViewRecord
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
        head = (
            "eye, " + self.scene.units,
            "pixels per degree",
            "lost by",
            "wrong surfaces",
            "displacement 99 %, arcmin",
        )
        rows = [
            (", ".join(map(digits, one.eye)), digits(one.pixels_per_degree), name, *_loss_cells(loss))
            for one in self.record.eyes
            for name, loss in (("display", one.display), (self.record.source or "", one.renderer))
            if loss is not None
        ]
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


def _loss_cells(loss: Loss) -> tuple[str, str]:
    moved = loss.displacement_arcmin
    wrong = "unknown" if loss.fraction is None else percent(loss.fraction)
    return wrong, "-" if moved is None else digits(moved.p99)


def eyes_on_path(eyes: Sequence[Eye], count: int | None) -> tuple[Eye, ...]:
    """Return eyes evenly spaced along the way through some eyes; these alone where no number is asked for.

    Raises
    ------
    InputError
        A way needs two ends.
    """
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
    found = []
    for eye in eyes:
        x, y, z = eye.position
        found += [replace(eye, position=(x + side * distance / 2, y, z)) for side in (-1, 1)]
    return tuple(found)


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

    Parameters
    ----------
    scene
        Scene that is looked at. Light is that of one sample a pixel, without light transport.
    eyes
        Eyes before the plate.
    source
        Hogels of a renderer; None to judge the display alone.
    stereo
        Distance of two eyes that take the place of each eye, scene units; None for single eyes.
    effects
        Effects of light that are evaluated; None for those that the scene calls for.
    progress
        Whether to draw a bar on standard error.

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
    drawn, numbered = _drawn(scene, chosen, takes, source, progress=progress)
    views = _views(reference, list(zip(chosen, takes, drawn, strict=True)), progress=progress)
    display = [display_loss(reference, seen) for seen in views]
    renderer = [renderer_loss(reference, seen, numbered=numbered) for seen in views if seen.drawn is not None]
    pairs = [] if stereo is None else [_pair(reference, views, left) for left in range(0, len(views), 2)]
    record = ViewRecord(
        eyes=tuple(_eye_record(scene, eye, k, display, renderer) for k, eye in enumerate(chosen)),
        stereo=tuple(pairs),
        units=scene.units,
        source=None if source is None else source.name,
        hogels=len(hogels_of(takes)),
    )
    gap = None if source is None else _gap(scene, source.settings)
    return SceneView(
        scene=scene,
        views=tuple(views),
        display=tuple(display),
        renderer=tuple(renderer),
        record=record,
        gap=gap,
    )


def _views(
    reference: EyeReference, shown: Sequence[tuple[Eye, Replay, EyeImage | None]], *, progress: bool
) -> list[Views]:
    """Return the pictures of each eye, given what it is shown."""
    views = []
    with progress_bar(len(shown), "eyes", "eye", shown=progress) as bar:
        for eye, taken, image in shown:
            true, replayed = reference.true_view(eye), reference.replayed(eye)
            views.append(Views(true=true, replayed=replayed, drawn=image, taken=taken))
            bar.update()
    return views


def _gap(scene: Scene, settings: DoubleFrustum | None) -> float | None:
    """Return the distance by which a near offset moves all that is seen; None where there is not one."""
    if settings is None or settings.slabs or settings.offset is Offset.NONE:
        return None
    rigid = moves_rigidly(scene.frustum, settings) and settings.fitted_height(scene.frustum) is None
    return settings.near if rigid else None


def _drawn(
    scene: Scene, eyes: Sequence[Eye], takes: Sequence[Replay], source: Source | None, *, progress: bool
) -> tuple[list[EyeImage | None], bool]:
    """Return what eyes are shown of a renderer's hogels, and whether these say which surface they show."""
    if source is None:
        return [None] * len(eyes), False
    collectors = [
        Collector(scene, eye, taken, source.settings) for eye, taken in zip(eyes, takes, strict=True)
    ]
    parts = film_parts(takes)
    with progress_bar(len(parts), "hogels", "hogel", shown=progress) as bar:
        drawn = collected(_counted(source.hogels(parts), bar.update), collectors)
    return [*drawn], any(collector.numbered for collector in collectors)


def _eye_record(
    scene: Scene, eye: Eye, number: int, display: Sequence[LossMaps], renderer: Sequence[LossMaps]
) -> EyeRecord:
    return EyeRecord(
        eye=eye.position,
        pixels_per_degree=pixels_per_degree(scene, eye),
        display=display[number].numbers(),
        renderer=renderer[number].numbers() if renderer else None,
    )


def _pair(reference: EyeReference, views: Sequence[Views], left: int) -> PairRecord:
    display, renderer = disparity(reference, views[left], views[left + 1])
    return PairRecord(left=left, right=left + 1, display=display, renderer=renderer)


def _counted(hogels: Iterator[DrawnHogel], update: Callable[[], object]) -> Iterator[DrawnHogel]:
    for hogel in hogels:
        update()
        yield hogel
