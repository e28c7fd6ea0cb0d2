"""`xfrustum view`: pictures of eyes, with the losses of the display and of the renderer.

An eye has three pictures: A, the true view of the scene; B, the replay of true hogels; C, the
replay of a renderer's hogels.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from xfrustum.compare import eye_loss
from xfrustum.compare.noticeable import moves_rigidly
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.reference.eye import EyeReference
from xfrustum.reports.common.outputs import (
    Staging,
    check_writable_folder,
    json_object,
    machine,
    progress_bar,
    versions,
    write_files,
)
from xfrustum.reports.common.templates_environment import address, html_page, plain_text, png
from xfrustum.reports.notebook import Figure, NotebookRepr, as_shown, marked
from xfrustum.reports.notebook import png as notebook_png
from xfrustum.reports.plate.arrays import COLOR, TRIANGLE
from xfrustum.reports.plate.store import PlateReader
from xfrustum.reports.verification.sources import Files, Problem
from xfrustum.scenes import NOTHING, DoubleFrustum, InputError, Offset
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.files.exr import write_eye_image
from xfrustum.scenes.files.pictures import Encoding
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.images import PlateContent
from xfrustum.scenes.model.scene import Scene, look_hash
from xfrustum.scenes.representation import counted

PAGE, DATA = "index.html", "view.json"

#: Titles of an eye's pictures by the stem of their files
NAMES = {
    "true": "the true view",
    "replayed": "the replayed truth",
    "drawn": "the renderer's hogels",
}

#: displacement in full color on a loss map, arc minutes: acuity of a good eye
SEEN_ARCMIN = 1.0
#: largest number of eyes with pictures in a notebook
MAX_SHOWN_EYES = 4
#: angle between the outermost views of a quilt, as on displays that show quilts
CONE_DEGREES = 40.0
#: largest number of tiles of a quilt
MAX_TILES = 1 << 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """Hogels of a scene by any renderer."""

    #: name of the renderer, or path of its files, for messages
    name: str
    #: cameras of the hogels; None if unknown
    settings: DoubleFrustum | None
    #: function that yields the hogels of some parts in order; pixels outside of the parts are
    #: undefined
    hogels: Callable[[eye_loss.FilmParts], Iterator[eye_loss.DrawnHogel]]


def drawing(
    scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None
) -> Source:
    """Return hogels drawn on demand, one sample a pixel; by default with the needed effects.

    InputError if the settings make no sense for the scene's frustum.
    """
    settings.check_against(scene.frustum)
    once = replace(scene, sampling=Sampling())
    content = PlateContent(color=eye_loss.DEFAULT_COLOR, ids=True, effects=effects)

    def hogels(parts: eye_loss.FilmParts) -> Iterator[eye_loss.DrawnHogel]:
        with PlateRenderer(once, settings, content) as renderer:
            yield from eye_loss.drawn_hogels(renderer, parts)

    name = f"near {settings.near:g} {scene.units}, {settings.depth_label}"
    return Source(name=name, settings=settings, hogels=hogels)


def stored_plate(path: Path, scene: Scene) -> Source:
    """Return the hogels of a plate of `xfrustum plate`; InputError for another scene's plate."""
    plate = PlateReader(path)
    try:
        drawn = plate.description["scene"]
        drawn_from = drawn["hash"], drawn["look"]
        kind: TypeAdapter[DoubleFrustum | None] = TypeAdapter(DoubleFrustum | None)
        settings = kind.validate_python(plate.description.get("settings"))
    except (KeyError, TypeError, ValidationError) as error:
        raise InputError(f"{path}: its description is damaged; draw the plate again") from error
    # Equal geometry with other materials makes other colors: both hashes count.
    if drawn_from != (scene.content_hash, look_hash(scene)):
        raise InputError(f"{path}: was drawn from another scene; draw it again with xfrustum plate")
    names = [name for name in (TRIANGLE, COLOR) if name in plate.arrays]
    if COLOR not in names:
        raise InputError(f"{path}: has no color; draw the plate again with color")

    def hogels(parts: eye_loss.FilmParts) -> Iterator[eye_loss.DrawnHogel]:
        # Missing hogels are refused before the first view is computed.
        if missing := [i for i in parts if not plate.finished(scene.plate.aperture(*i))]:
            raise InputError(
                f"{path}: {len(missing)} of {len(parts)} hogels in the eyes' view are missing, "
                f"such as {missing[0][0]},{missing[0][1]}; draw them with xfrustum plate"
            )
        for index in parts:
            arrays = {name: plate.image(name, *index) for name in names}
            yield eye_loss.DrawnHogel(
                index=index, color=arrays[COLOR], triangle=arrays.get(TRIANGLE)
            )

    return Source(name=path.name, settings=settings, hogels=hogels)


def image_files(pattern: str, scene: Scene, encoding: Encoding = Encoding.RGB) -> Source:
    """Return hogels from files of any renderer, as in `verify`; {i} is the column, {j} the row."""
    files = Files(pattern=pattern, reference=Reference(scene), encoding=encoding)

    def hogels(parts: eye_loss.FilmParts) -> Iterator[eye_loss.DrawnHogel]:
        apertures = [scene.plate.aperture(*index) for index in parts]
        files.check(apertures)
        for aperture in apertures:
            try:
                image = files.image(aperture)
            except Problem as error:
                raise InputError(str(error)) from error
            if image.triangle.max(initial=NOTHING) >= len(scene.faces):
                raise InputError(
                    f"{files.path(aperture)}: names a triangle that the scene does not have; "
                    "`xfrustum verify` detects how its numbers were stored"
                )
            # A color picture does not identify surfaces.
            named = image.color is None or bool(
                ((image.triangle != NOTHING) | (image.object != NOTHING)).any()
            )
            yield eye_loss.DrawnHogel(
                index=aperture.index,
                color=image.color,
                triangle=image.triangle if named else None,
                object=image.object if named else None,
                position=image.position,
            )

    return Source(name=pattern, settings=None, hogels=hogels)


@dataclass(frozen=True, kw_only=True)
class EyeRecord:
    """Losses of one eye: an element of `eyes` in `view --json`."""

    #: position, scene units
    eye: tuple[float, float, float]
    #: resolution at the middle of the eye's view
    pixels_per_degree: float
    #: loss by replaying the true view (A against B)
    display: eye_loss.Loss
    #: loss by the renderer's hogels (B against C)
    renderer: eye_loss.Loss | None

    @property
    def losses(self) -> dict[str, eye_loss.Loss]:
        """Known losses by their cause."""
        both = {"display": self.display, "renderer": self.renderer}
        return {name: lost for name, lost in both.items() if lost is not None}


@dataclass(frozen=True, kw_only=True)
class ViewRecord:
    """Object printed by `view --json`."""

    eyes: tuple[EyeRecord, ...]
    #: unit of length of the scene
    units: str
    #: name of the renderer, or path of its files; None without a renderer
    source: str | None
    #: number of hogels with a pixel in the pictures
    hogels: int


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedViews(eye_loss.Views):
    """Pictures of one eye with their loss maps."""

    display: eye_loss.LossMaps
    #: None without a renderer
    renderer: eye_loss.LossMaps | None

    @property
    def images(self) -> dict[str, EyeImage]:
        """Pictures by name; `drawn` is missing without a renderer."""
        every = {name: getattr(self, name) for name in NAMES}
        return {name: image for name, image in every.items() if image is not None}

    def marked(self, name: str) -> Bytes:
        """Return the `display` or `renderer` picture with wrong and moved pixels marked."""
        lost, image = getattr(self, name), self.replayed if name == "display" else self.drawn
        assert lost is not None and image is not None
        # The last argument is relative to the displacement in full color.
        return marked(shown(image), lost.wrong, lost.displacement_arcmin / SEEN_ARCMIN)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneView(NotebookRepr):
    """Pictures, loss maps and numbers of all eyes; a renderer's maps exist only for a source."""

    scene: Scene
    views: tuple[JudgedViews, ...]
    record: ViewRecord
    #: distance by which all points move away from the plate, scene units; None if it varies
    gap: float | None = None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as printed by `view --json`."""
        return json_object(self.record)

    @property
    def top(self) -> float:
        """Largest height of the scene: eyes below it lie within the scene."""
        return float(self.scene.vertices[:, 2].max())

    def sentences(self) -> list[str]:
        """Return the largest loss of any eye by each cause, and the gap at the plate."""
        return plain_text("view-sentences.txt.j2", {"found": self}).splitlines()

    def _said(self) -> str:
        hogels = counted(self.record.hogels, "hogel")
        seen = f"{self.scene.name!r}, seen by {counted(len(self.views), 'eye')} through {hogels}"
        losses = self.sentences()[: len(self.record.eyes[0].losses)]
        return " ".join([f"{seen}.", *losses]).removesuffix(".")

    def _figures(self) -> Sequence[Figure]:
        return [
            Figure(caption=f"eye {number}, {NAMES[name]}", content=notebook_png(shown(image)))
            for number, views in enumerate(self.views[:MAX_SHOWN_EYES])
            for name, image in views.images.items()
        ]

    def table(self) -> str:
        """Return the numbers as lines of text."""
        values = {"sentences": self.sentences(), "eyes": self.record.eyes}
        return plain_text("view.txt.j2", values).removesuffix("\n")


def view(
    scene: Scene,
    eyes: Sequence[Eye],
    source: Source | None = None,
    *,
    effects: frozenset[Effect] | None = None,
    progress: bool = False,
) -> SceneView:
    """Return the true view, the replayed truth and the replayed hogels of a renderer for some eyes.

    Light has one sample a pixel, without light transport. Without a source only the display
    is judged.

    Raises
    ------
    InputError
        There are no eyes, the plate is too small in an eye's view, or hogels are unreadable.
    """
    if not eyes:
        raise InputError("view needs at least one eye: give X,Y,Z with Z before the plate")
    # Refuse too small a view before anything is traced.
    sharpness = [eye_loss.pixels_per_degree(scene, eye) for eye in eyes]
    reference = EyeReference(scene, effects)
    takes = [reference.replay(eye) for eye in eyes]
    parts = eye_loss.film_parts(takes)
    drawn: Sequence[EyeImage | None] = [None] * len(eyes)
    numbered = False
    if source is not None:
        # All eyes share one pass over the hogels, the most expensive step.
        collectors = [
            eye_loss.Collector(scene, eye, taken, source.settings)
            for eye, taken in zip(eyes, takes, strict=True)
        ]
        with progress_bar(len(parts), "hogels", "hogel", shown=progress) as bar:
            bar.iterable = source.hogels(parts)
            drawn = eye_loss.collected(bar, collectors)
        numbered = any(collector.numbered for collector in collectors)
    views, records = [], []
    with progress_bar(len(eyes), "eyes", "eye", shown=progress) as bar:
        for eye, taken, image, pixels in zip(eyes, takes, drawn, sharpness, strict=True):
            true, replayed = reference.true_view(eye), reference.replayed(eye)
            seen = eye_loss.Views(true=true, replayed=replayed, drawn=image, taken=taken)
            display, renderer = eye_loss.display_loss(reference, seen), None
            if image is not None:
                renderer = eye_loss.renderer_loss(reference, seen, numbered=numbered)
            views.append(JudgedViews(**vars(seen), display=display, renderer=renderer))
            record = EyeRecord(
                eye=eye.position,
                pixels_per_degree=pixels,
                display=display.numbers(),
                renderer=renderer.numbers() if renderer else None,
            )
            records.append(record)
            bar.update()
    record_of_all = ViewRecord(
        eyes=tuple(records),
        units=scene.units,
        source=source.name if source else None,
        hogels=len(parts),
    )
    gap = _gap(scene, source.settings) if source and source.settings else None
    return SceneView(scene=scene, views=tuple(views), record=record_of_all, gap=gap)


def _gap(scene: Scene, settings: DoubleFrustum) -> float | None:
    """Return the distance by which all points move away from the plate; None if it varies."""
    rigid = moves_rigidly(scene.frustum, settings)
    plain = settings.fitted_height(scene.frustum) is None and not settings.slabs
    return settings.near if rigid and plain and settings.offset is not Offset.NONE else None


def shown(image: EyeImage) -> Bytes:
    """Return a view in sRGB, (H, W, 3); without colors, surfaces are gray by their height."""
    return as_shown(image.color, image.covered, image.position[..., 2])


def file_names(eyes: int, *, drawn: bool) -> tuple[str, ...]:
    """Return the names of the files of a view."""
    names = list(NAMES)[: 3 if drawn else 2]
    kinds = [f"{k}.{kind}" for k in range(eyes) for kind in ("exr", "png")]
    return (PAGE, DATA, *(f"{name}_{kind}" for name in names for kind in kinds))


def write_view(seen: SceneView, out: Path) -> tuple[Path, ...]:
    """Write page, numbers and pictures, all or nothing; InputError for an unwritable folder."""
    drawn = seen.record.source is not None
    with Staging(out, file_names(len(seen.views), drawn=drawn)) as staging:
        for number, views in enumerate(seen.views):
            for name, image in views.images.items():
                write_eye_image(staging.folder / f"{name}_{number}.exr", image)
                staging.write(f"{name}_{number}.png", png(shown(image)))
        staging.write(DATA, seen.record)
        staging.write(PAGE, _page(seen))
        return staging.commit()


def _page(seen: SceneView) -> str:
    values = {
        "found": seen,
        "record": seen.record,
        "names": NAMES,
        "seen_arcmin": SEEN_ARCMIN,
        "versions": {**versions(), **machine()},
    }
    return html_page("view.html.j2", values, {"shown": shown, "address": _address})


def _address(picture: Bytes) -> str:
    return address(png(picture))


def write_quilt(
    show: Callable[[Sequence[Eye]], SceneView], eye: Eye, tiles: tuple[int, int], out: Path
) -> tuple[ViewRecord, tuple[Path, ...]]:
    """Write pictures of a line of eyes as quilts, a tile for each eye, and the eyes' numbers.

    The eyes lie on a parallel to the plate through `eye`, at equal steps of angle; the leftmost eye
    has the tile at the bottom left. `show` is `view` with a scene and a source; it is called once
    for each row of tiles, which bounds memory.
    """
    count = tiles[0] * tiles[1]
    if min(tiles) < 1 or count > MAX_TILES:
        raise InputError(
            f"a quilt needs 1 to {MAX_TILES} tiles, such as 8x6, not {tiles[0]}x{tiles[1]}"
        )
    check_writable_folder(out)
    x, y, height = eye.position
    # Displays for quilts space views evenly in angle.
    shares = np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1)
    shifts = height * np.tan(np.radians(CONE_DEGREES) * shares)
    eyes = [replace(eye, position=(x + shift, y, height)) for shift in shifts.tolist()]
    rows: dict[str, list[Bytes]] = {}
    records = []
    for first in range(0, count, tiles[0]):
        seen = show(eyes[first : first + tiles[0]])
        records.append(seen.record)
        images = [views.images for views in seen.views]
        for name in images[0]:
            row = np.concatenate([shown(tile[name]) for tile in images], axis=1)
            # Tiles count from the bottom, rows of pixels from the top.
            rows.setdefault(name, []).insert(0, row)
    record = replace(
        records[0],
        eyes=tuple(eye for part in records for eye in part.eyes),
        hogels=max(part.hogels for part in records),
    )
    aspect = seen.scene.plate.size[0] / seen.scene.plate.size[1]
    stem = f"qs{tiles[0]}x{tiles[1]}a{aspect:.4g}.png"
    pictures = {f"{name}_{stem}": png(np.concatenate(own)) for name, own in rows.items()}
    return record, write_files(out, {DATA: record, **pictures})
