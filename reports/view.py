"""`xfrustum view`: what eyes see of a scene, of its replayed truth and of any renderer's hogels.

As pictures and numbers, as a page, and as quilts: views from an arc as tiles of one picture.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image
from pydantic import TypeAdapter, ValidationError

from xfrustum.compare.eye import loss
from xfrustum.compare.eye.noticeable import moves_rigidly
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reports.common.outputs import Staging, json_object, progress_bar
from xfrustum.reports.common.provenance import machine, versions
from xfrustum.reports.common.templates_environment import address, html_page, plain_text, png
from xfrustum.reports.exchange.convert import packed
from xfrustum.reports.inspection import first_triangles
from xfrustum.reports.plate import stored
from xfrustum.reports.plate.store import COLOR, TRIANGLE
from xfrustum.reports.verification.sources import Files, Problem
from xfrustum.scenes import NOTHING, DoubleFrustum, InputError, Offset
from xfrustum.scenes.appearance.display import LEVELS
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.files.exr import write_eye_image
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.plate_content import FilmPart, PlateContent
from xfrustum.scenes.model.scene import Scene, look_hash
from xfrustum.scenes.notebook import (
    Figure,
    NotebookRepr,
    as_shown,
    counted,
    digits,
    marked,
    percent,
)
from xfrustum.scenes.notebook import png as notebook_png

PAGE, DATA, ANIMATION = "index.html", "view.json", "views.gif"

NAMES = {
    "true": "the true view",
    "replayed": "the replayed truth",
    "drawn": "the renderer's hogels",
}
"""Names of the three pictures: in files, and in words."""

UNKNOWN = "wrong surfaces unknown"
"""Words for the share of wrong surfaces of a picture that does not say which surfaces it shows."""

SEEN_ARCMIN = 1.0  #: displacement from which on a map is in full color: what a good eye resolves

HEIGHT_STEPS = 65535
"""Steps between the lowest and the highest z in a picture of heights; the last one stands for no surface."""

FRAME_MS = 350  #: time that an animation shows each eye's picture
MAX_SHOWN_EYES = 4  #: largest number of eyes whose pictures a notebook shows

CONE_DEGREES = 40.0
"""Angle between the outermost views of a quilt, which is that of the displays that show quilts."""

MAX_TILES = 1 << 10  #: largest number of tiles of a quilt


class Source(Protocol):
    """Hogels of a scene, by any renderer."""

    name: str  #: The renderer, or where its hogels lie, for people
    settings: (
        DoubleFrustum | None
    )  #: Settings of the cameras that drew them; None where they are not known

    def hogels(self, parts: Mapping[tuple[int, int], FilmPart]) -> Iterator[loss.DrawnHogel]:
        """Yield hogels by column and row, in order; only pixels in the part of each film mean anything."""
        ...


class Drawing:
    """Hogels drawn when they are asked for, one sample a pixel; None are the effects a scene calls for."""

    settings: DoubleFrustum | None

    def __init__(
        self, scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None
    ) -> None:
        settings.check_against(scene.frustum)
        self.settings = self._how = settings
        self.name = f"near {settings.near:g} {scene.units}, {settings.depth_label}"
        self._scene = replace(scene, sampling=Sampling())
        self._content = PlateContent(color=loss.DEFAULT_COLOR, ids=True, effects=effects)

    def hogels(self, parts: Mapping[tuple[int, int], FilmPart]) -> Iterator[loss.DrawnHogel]:
        """Draw the hogels."""
        with PlateRenderer(self._scene, self._how, self._content) as renderer:
            yield from loss.drawn_hogels(renderer, parts)


class StoredPlate:
    """A plate that `xfrustum plate` has drawn from a scene; InputError where there is no such plate."""

    def __init__(self, path: Path, scene: Scene) -> None:
        self.name = path.name
        try:
            plate = stored.StoredPlate(path)
            said = plate.description["scene"]
            drawn_from = said["hash"], said["look"]
            kind: TypeAdapter[DoubleFrustum | None] = TypeAdapter(DoubleFrustum | None)
            self.settings = kind.validate_python(plate.description.get("settings"))
        except InputError as error:
            raise InputError(f"--plate {error}") from error
        except (KeyError, TypeError, ValidationError) as error:
            raise InputError(
                f"--plate {path}: its description is damaged; draw the plate again"
            ) from error
        if drawn_from != (scene.content_hash, look_hash(scene)):
            raise InputError(
                f"--plate {path}: was drawn from another scene; draw it again with xfrustum plate"
            )
        self._path, self._scene, self._plate = path, scene, plate
        self._arrays = {
            name: plate.arrays[name] for name in (TRIANGLE, COLOR) if name in plate.arrays
        }
        width, height = scene.frustum.resolution
        expected = (*scene.plate.hogels[::-1], height, width)
        if COLOR not in self._arrays or any(a.shape[:4] != expected for a in self._arrays.values()):
            raise InputError(f"--plate {path}: its arrays are damaged; draw the plate again")

    def hogels(self, parts: Mapping[tuple[int, int], FilmPart]) -> Iterator[loss.DrawnHogel]:
        """Read the hogels; InputError where some have not been drawn, or cannot be read."""
        missing = [i for i in parts if not self._plate.finished(self._scene.plate.aperture(*i))]
        if missing:
            raise InputError(
                f"--plate {self._path}: {len(missing)} of {len(parts)} hogels that the eyes are shown are "
                f"not there, such as {missing[0][0]},{missing[0][1]}; draw them with xfrustum plate"
            )
        for column, row in parts:
            try:
                arrays = {name: self._plate.image(name, column, row) for name in self._arrays}
            except InputError as error:
                raise InputError(f"--plate {error}") from error
            yield loss.DrawnHogel(
                index=(column, row), color=arrays[COLOR], triangle=arrays.get(TRIANGLE)
            )


class Images:
    """Image files by any renderer, as `verify` reads them: {i} in a name is the column, {j} the row."""

    def __init__(self, pattern: str, scene: Scene, encoding: Encoding = Encoding.RGB) -> None:
        self.name = pattern
        self.settings: DoubleFrustum | None = None
        self._scene = scene
        self._files = Files(pattern=pattern, reference=Reference(scene), encoding=encoding)

    def hogels(self, parts: Mapping[tuple[int, int], FilmPart]) -> Iterator[loss.DrawnHogel]:
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
            said = (image.triangle != NOTHING) | (image.object != NOTHING)
            named = image.color is None or bool(said.any())
            yield loss.DrawnHogel(
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
    display: loss.Loss  #: The loss of the true view by replaying it (A against B)
    renderer: loss.Loss | None  #: What the renderer's hogels lose besides (B against C)

    @property
    def losses(self) -> dict[str, loss.Loss]:
        """The losses that are known, by whose they are."""
        both = {"display": self.display, "renderer": self.renderer}
        return {name: lost for name, lost in both.items() if lost is not None}


@dataclass(frozen=True, kw_only=True)
class PairRecord:
    """What two eyes, by their numbers, lose in depth: an element of `stereo` in `view --json`."""

    left: int
    right: int
    display: loss.Disparity
    renderer: loss.Disparity | None


@dataclass(frozen=True, kw_only=True)
class ViewRecord:
    """The object that `view --json` prints."""

    eyes: tuple[EyeRecord, ...]
    stereo: tuple[PairRecord, ...]  #: Empty unless pairs are asked for
    units: str  #: Name of the scene's unit of length
    source: str | None  #: The renderer, or where its hogels lie; None where no renderer is judged
    hogels: int  #: Number of hogels that the eyes are shown


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneView(NotebookRepr):
    """Pictures of all eyes, their losses pixel by pixel (no renderer's where none is judged), and numbers."""

    scene: Scene
    views: tuple[loss.Views, ...]
    display: tuple[loss.LossMaps, ...]
    renderer: tuple[loss.LossMaps, ...]
    record: ViewRecord
    #: Distance by which everything is seen farther from the plate than it is, scene units; None
    #: where that is not one distance, or where the cameras are not known
    gap: float | None = None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `view --json` prints them."""
        return json_object(self.record)

    def images(self, number: int) -> dict[str, EyeImage]:
        """Return the pictures of an eye by name; no drawn one where no renderer is judged."""
        every = {name: getattr(self.views[number], name) for name in NAMES}
        return {name: image for name, image in every.items() if image is not None}

    def _said(self) -> str:
        parts = []
        for name, shows in (
            ("display", "the display shows"),
            ("renderer", f"{self.record.source} besides"),
        ):
            losses = [eye.losses[name] for eye in self.record.eyes if name in eye.losses]
            known = [lost.fraction for lost in losses if lost.fraction is not None]
            if losses:
                share = f"up to {percent(max(known))}" if known else "an unknown share of"
                parts.append(f"{shows} {share} wrong surfaces")
        hogels = counted(self.record.hogels, "hogel")
        seen = f"{self.scene.name!r}, seen by {counted(len(self.views), 'eye')} through {hogels}"
        return f"{seen}; {', '.join(parts)}"

    def _figures(self) -> Sequence[Figure]:
        names = {
            "true": "true view",
            "replayed": "replayed truth",
            "drawn": self.record.source or "",
        }
        return [
            Figure(caption=f"eye {number}, {names[name]}", content=notebook_png(shown(image)))
            for number in range(len(self.views[:MAX_SHOWN_EYES]))
            for name, image in self.images(number).items()
        ]

    def table(self) -> str:
        """Return the numbers as lines for a terminal."""
        values = {"sentences": _sentences(self), "eyes": self.record.eyes, "unknown": UNKNOWN}
        return plain_text("view.txt.j2", values).removesuffix("\n")


def eyes_on_path(eyes: Sequence[Eye], count: int | None) -> tuple[Eye, ...]:
    """Return eyes evenly spaced along the way through some eyes; these alone where no number is asked for."""
    if count is None:
        return tuple(eyes)
    if len(eyes) < 2:
        raise InputError("a path needs at least two eyes: give --eye X,Y,Z;X,Y,Z")
    places = np.array([eye.position for eye in eyes])
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))))
    along = np.linspace(0.0, way[-1], count)
    found = np.stack([np.interp(along, way, places[:, axis]) for axis in range(3)], axis=-1)
    return tuple(replace(eyes[0], position=(x, y, z)) for x, y, z in found.tolist())


def stereo_eyes(eyes: Sequence[Eye], distance: float) -> tuple[Eye, ...]:
    """Return a left and a right eye in place of each eye, a distance apart in x."""
    places = [(eye, *eye.position) for eye in eyes]
    return tuple(
        replace(eye, position=(x + side * distance / 2, y, z))
        for eye, x, y, z in places
        for side in (-1, 1)
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

    Light is that of one sample a pixel, without light transport, and of the given effects (None:
    those that the scene calls for). Without a source the display alone is judged. Two eyes,
    `stereo` apart in scene units, may take the place of each eye. InputError where there is no eye,
    one sees the plate from too far aside, or the hogels cannot be had.
    """
    if not eyes:
        raise InputError("view needs at least one eye: give X,Y,Z with Z before the plate")
    chosen = tuple(eyes) if stereo is None else stereo_eyes(eyes, stereo)
    # Eyes are refused before anything is traced.
    sharpness = [loss.pixels_per_degree(scene, eye) for eye in chosen]
    reference = EyeReference(scene, effects)
    takes = [reference.replay(eye) for eye in chosen]
    drawn: Sequence[EyeImage | None] = [None] * len(chosen)
    numbered, gap = False, None  # whether the hogels say which surfaces they show
    if source is not None:
        settings, both = source.settings, zip(chosen, takes, strict=True)
        collectors = [loss.Collector(scene, eye, taken, settings) for eye, taken in both]
        parts = loss.film_parts(takes)
        with progress_bar(len(parts), "hogels", "hogel", shown=progress) as bar:
            bar.iterable = source.hogels(parts)
            drawn = loss.collected(bar, collectors)
        numbered = any(collector.numbered for collector in collectors)
        if settings is not None and not settings.slabs and settings.offset is not Offset.NONE:
            rigid = (
                moves_rigidly(scene.frustum, settings)
                and settings.fitted_height(scene.frustum) is None
            )
            gap = settings.near if rigid else None
    views = []
    with progress_bar(len(chosen), "eyes", "eye", shown=progress) as bar:
        for eye, taken, image in zip(chosen, takes, drawn, strict=True):
            true, replayed = reference.true_view(eye), reference.replayed(eye)
            views.append(loss.Views(true=true, replayed=replayed, drawn=image, taken=taken))
            bar.update()
    display = tuple(loss.display_loss(reference, seen) for seen in views)
    judged = [seen for seen in views if seen.drawn is not None]
    renderer = tuple(loss.renderer_loss(reference, seen, numbered=numbered) for seen in judged)
    records = tuple(
        EyeRecord(
            eye=eye.position,
            pixels_per_degree=sharpness[number],
            display=display[number].numbers(),
            renderer=renderer[number].numbers() if renderer else None,
        )
        for number, eye in enumerate(chosen)
    )
    pairs = []
    for left in range(0, 0 if stereo is None else len(views), 2):
        by_display, by_renderer = loss.disparity(reference, views[left], views[left + 1])
        pairs.append(
            PairRecord(left=left, right=left + 1, display=by_display, renderer=by_renderer)
        )
    record = ViewRecord(
        eyes=records,
        stereo=tuple(pairs),
        units=scene.units,
        source=None if source is None else source.name,
        hogels=len(loss.hogels_of(takes)),
    )
    return SceneView(
        scene=scene, views=tuple(views), display=display, renderer=renderer, record=record, gap=gap
    )


def shown(image: EyeImage) -> Bytes:
    """Return a view as a screen shows it, (H, W, 3); without colors, surfaces are gray by their height."""
    return as_shown(image.color, image.covered, image.position[..., 2])


def _heights_picture(image: EyeImage, low: float, high: float) -> Bytes:
    """Return heights between two ends in `HEIGHT_STEPS` as red * 256 + green, the last one for none."""
    height = image.position[..., 2]
    known = np.isfinite(height)
    share = np.clip((np.where(known, height, low) - low) / (high - low), 0.0, 1.0)
    steps = np.where(known, np.rint(share * (HEIGHT_STEPS - 1)), HEIGHT_STEPS).astype(np.uint32)
    return np.stack((steps >> 8, steps & 255, 0 * steps), axis=-1).astype(np.uint8)


def file_names(eyes: int, *, drawn: bool) -> tuple[str, ...]:
    """Return the names of the files of a view of some eyes."""
    pictures = list(NAMES)[: 3 if drawn else 2]
    each = [
        f"{name}_{k}.{kind}" for k in range(eyes) for name in pictures for kind in ("exr", "png")
    ]
    return (PAGE, DATA, *([ANIMATION] if eyes > 1 else []), *each)


def write_view(found: SceneView, out: Path) -> tuple[Path, ...]:
    """Write page, numbers and pictures, all or nothing; InputError where the folder cannot be written."""
    with Staging(out, file_names(len(found.views), drawn=bool(found.renderer))) as staging:
        frames = []
        for number in range(len(found.views)):
            # Pictures of an eye side by side, with a gap of a few pixels.
            gap = np.full((found.views[number].eye.resolution[1], 4, 3), LEVELS, dtype=np.uint8)
            parts = []
            for name, image in found.images(number).items():
                picture = shown(image)
                parts += [gap, picture]
                write_eye_image(staging.folder / f"{name}_{number}.exr", image)
                staging.write(f"{name}_{number}.png", png(picture))
            frames.append(np.concatenate(parts[1:], axis=1))
        if len(frames) > 1:
            # Along the path and back, for ever.
            first, *others = map(Image.fromarray, [*frames, *frames[-2:0:-1]])
            place, each = staging.folder / ANIMATION, FRAME_MS
            first.save(place, save_all=True, append_images=others, duration=each, loop=0)
        staging.write(DATA, found.record)
        staging.write(PAGE, _page(found))
        return staging.commit()


def _page(found: SceneView) -> str:
    pictures = [found.images(number) for number in range(len(found.views))]
    heights = np.concatenate(
        [image.position[..., 2].ravel() for some in pictures for image in some.values()]
    )
    known = heights[np.isfinite(heights)]
    low, high = float(known.min(initial=0.0)), float(known.max(initial=0.0))
    high = high if high > low else low + 1.0
    eyes = []
    for number, some in enumerate(pictures):
        losses = {}
        for name, picture in {"display": "replayed", "renderer": "drawn"}.items():
            for lost in getattr(found, name)[number : number + 1]:
                # A dimmed view on which wrong surfaces are red and displaced points blue.
                marks = marked(
                    shown(some[picture]), lost.wrong, lost.displacement_arcmin / SEEN_ARCMIN
                )
                losses[name] = address(png(marks))
        encoded = {
            name: {
                "color": address(png(shown(image))),
                "numbers": address(png(packed(image.triangle))),
                "heights": address(png(_heights_picture(image, low, high))),
            }
            for name, image in some.items()
        }
        record = json_object(found.record.eyes[number])
        eyes.append({"pictures": encoded, "losses": losses, "record": record})
    data = {
        "eyes": eyes,
        "names": NAMES,
        "heights": {"low": low, "high": high, "steps": HEIGHT_STEPS},
        "objects": first_triangles(found.scene),
        "units": found.scene.units,
        "size": found.views[0].eye.resolution,
        "aspect": found.scene.plate.size[0] / found.scene.plate.size[1],
    }
    values = {
        "found": found,
        "record": found.record,
        "sentences": _sentences(found),
        "data_of_page": data,
        "seen_arcmin": SEEN_ARCMIN,
        "animated": len(found.views) > 1,
        "animation": ANIMATION,
        "versions": {**versions(), **machine()},
    }
    return html_page("view.html.j2", values)


def _color_sentence(lost: loss.Loss) -> list[str]:
    """Return how much of a difference of colors that name no surface is shading; nothing for other images."""
    if lost.fraction is not None or lost.color_fraction is None:
        return []
    said = f"Its colors differ in {percent(lost.color_fraction)} of the pixels"
    if lost.shading is None:
        return [f"{said}."]
    reasons = "that is shading (lights, materials or the encoding of colors) and no displacement"
    nowhere = f"have a color that the replayed truth has nowhere within {loss.SHIFT_PX} px"
    return [f"{said}; at least {percent(lost.shading)} of these {nowhere}: {reasons}."]


def _sentences(found: SceneView) -> list[str]:
    """Return what the eyes lose, in words, the worst eye first."""
    eyes, units, told = found.record.eyes, found.record.units, []
    for name in eyes[0].losses:
        losses = [eye.losses[name] for eye in eyes]
        lost = max(losses, key=lambda one: one.fraction or 0.0)
        parts = []
        if lost.fraction is not None:
            parts.append(f"loses {percent(lost.fraction)} of the pixels to wrong surfaces")
        moved = [
            one.displacement_arcmin.p99 for one in losses if one.displacement_arcmin is not None
        ]
        if moved:
            parts.append(f"moves 99 % of the others by at most {digits(max(moved))} arc minutes")
        looks = [one.flip for one in losses if one.flip is not None]
        if looks:
            parts.append(f"looks different by FLIP {digits(max(looks))}")
        where = "" if len(losses) == 1 else f" (the worst of {len(losses)} eyes)"
        unknown = f"; {UNKNOWN}: the hogels name none" if lost.fraction is None else ""
        whole = ", ".join(parts) or "loses nothing that can be told"
        told.append(f"The {name} {whole}{where}{unknown}.")
        told += _color_sentence(lost)
    if found.renderer and any(eye.display.displacement_arcmin for eye in eyes):
        moves = [[one.displacement_arcmin for one in eye.losses.values()] for eye in eyes]
        pairs = [(a, b) for a, b in moves if a is not None and b is not None]
        above, above_half = (
            sum(getattr(b, p) >= getattr(a, p) for a, b in pairs) for p in ("p99", "p50")
        )
        if not pairs:
            unknown = "How far the renderer moves things is not known"
            told.append(f"{unknown}: its hogels do not say where their points lie.")
        elif not above and not above_half:
            told.append(
                "At every eye the renderer moves things by less than the display itself does."
            )
        else:
            more = "the renderer moves things by more than the display does"
            half = "" if above == above_half else f", by p99, and at {above_half} by the median"
            told.append(f"At {above} of {len(pairs)} eyes {more}{half}.")
    if found.gap is not None:
        told.append(
            f"By the theorem of docs/method.md, its near offset opens a gap of {digits(2 * found.gap)} "
            f"{units} at the plate: everything is seen {digits(found.gap)} {units} farther "
            "from the plate than it is, and nothing else is changed but for edges and for what is thereby "
            "newly hidden or uncovered."
        )
    pair = next((pair.renderer for pair in found.record.stereo[:1]), None)
    if pair is not None and pair.depth is None:
        told.append("No surface point is shown to both eyes.")
    elif pair is not None and pair.depth is not None:
        ends = " and ".join(
            f"{digits(abs(value))} {units} {'nearer' if value < 0 else 'farther away'}"
            for value in (pair.depth.p1, pair.depth.p99)
        )
        told.append(f"Two eyes see what the renderer draws between {ends} than it is.")
    top = float(found.scene.vertices[:, 2].max())
    within = sum(eye.eye[2] <= top for eye in eyes)
    if within:
        told.append(
            f"At {within} of {len(eyes)} eyes the numbers say little: these lie within the scene's "
            f"depth, which reaches up to z = {digits(top)} {units}, and hogels show them what is "
            "beside and behind them too."
        )
    return told


def quilt_names(scene: Scene, tiles: tuple[int, int], *, drawn: bool) -> tuple[str, ...]:
    """Return the names of a quilt's files: columns, rows and the aspect of a tile are in them."""
    aspect = scene.plate.size[0] / scene.plate.size[1]
    pictures = list(NAMES)[: 3 if drawn else 2]
    return (DATA, *(f"{name}_qs{tiles[0]}x{tiles[1]}a{aspect:.4g}.png" for name in pictures))


def write_quilt(  # noqa: PLR0913 - one parameter per option of the command
    scene: Scene,
    eye: Eye,
    tiles: tuple[int, int],
    source: Source | None,
    out: Path,
    *,
    effects: frozenset[Effect] | None = None,
    progress: bool = False,
) -> ViewRecord:
    """Write quilts of the scene, of its replayed truth and of a renderer's hogels, and their numbers.

    The eyes lie on a line parallel to the plate, at equal steps of angle from the left, the given
    one in the middle. Each row of tiles is made by itself, so that memory does not grow with the
    number of rows. See `view`; InputError where there are no tiles, columns by rows, or too many.
    """
    count = tiles[0] * tiles[1]
    if min(tiles) < 1 or count > MAX_TILES:
        raise InputError(
            f"a quilt needs 1 to {MAX_TILES} tiles, such as 8x6, not {tiles[0]}x{tiles[1]}"
        )
    x, y, height = eye.position
    turns = [0.0] if count == 1 else [number / (count - 1) - 0.5 for number in range(count)]
    shifts = [height * math.tan(math.radians(CONE_DEGREES) * turn) for turn in turns]
    eyes = [replace(eye, position=(x + shift, y, height)) for shift in shifts]
    names = quilt_names(scene, tiles, drawn=source is not None)
    with Staging(out, names) as staging:
        # Rows of tiles by picture: the first tile is at the bottom left, then to the right, then
        # up.
        rows: dict[str, list[Bytes]] = {}
        records = []
        for first in range(0, count, tiles[0]):
            some = eyes[first : first + tiles[0]]
            found = view(scene, some, source, effects=effects, progress=progress)
            records.append(found.record)
            tiled = [found.images(number) for number in range(len(some))]
            for name in tiled[0]:
                row = np.concatenate([shown(tile[name]) for tile in tiled], axis=1)
                rows.setdefault(name, []).append(row)
        for name, file in zip(rows, names[1:], strict=True):
            staging.write(file, png(np.concatenate(rows[name][::-1], axis=0)))
        record = replace(
            records[0],
            eyes=tuple(one for part in records for one in part.eyes),
            hogels=max(part.hogels for part in records),
        )
        staging.write(DATA, record)
        staging.commit()
    return record
