"""The page and the files of a view, and quilts: views from an arc as tiles of one picture."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import numpy as np

from xfrustum.compare.eye.loss import Loss
from xfrustum.reports.common.json_ready import json_object, write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.provenance import machine, versions
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.eye.pictures import (
    HEIGHT_STEPS,
    SEEN_ARCMIN,
    animation,
    height_ends,
    heights_picture,
    loss_map,
    png,
    shown,
    side_by_side,
)
from xfrustum.reports.eye.view import EyeRecord, SceneView, Source, ViewRecord, view
from xfrustum.reports.plate.rows import packed
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import write_eye_image
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import digits, percent

PAGE, DATA, ANIMATION = "index.html", "view.json", "views.gif"

NAMES = {"true": "the true view", "replayed": "the replayed truth", "drawn": "the renderer's hogels"}
"""Names of the three pictures: in files, and in words."""

UNKNOWN = "wrong surfaces unknown"
"""Words for the share of wrong surfaces of a picture that does not say which surfaces it shows."""

CONE_DEGREES = 40.0
"""Angle between the outermost views of a quilt, which is that of the displays that show quilts."""

MAX_TILES = 1 << 10
"""Largest number of tiles of a quilt."""


def file_names(eyes: int, *, drawn: bool) -> tuple[str, ...]:
    """Return the names of the files of a view of some eyes."""
    pictures = list(NAMES)[: 3 if drawn else 2]
    each = [f"{name}_{k}.{kind}" for k in range(eyes) for name in pictures for kind in ("exr", "png")]
    return (PAGE, DATA, *([ANIMATION] if eyes > 1 else []), *each)


def write_view(found: SceneView, out: Path) -> tuple[Path, ...]:
    """Write page, numbers and pictures, all or nothing; InputError where the folder cannot be written."""
    with Staging(out, file_names(len(found.views), drawn=bool(found.renderer))) as staging:
        frames = []
        for number in range(len(found.views)):
            pictures = []
            for name, image in images(found, number).items():
                pictures.append(shown(image))
                write_eye_image(staging.folder / f"{name}_{number}.exr", image)
                (staging.folder / f"{name}_{number}.png").write_bytes(png(pictures[-1]))
            frames.append(side_by_side(pictures))
        if len(frames) > 1:
            (staging.folder / ANIMATION).write_bytes(animation(frames))
        write_json(staging.folder / DATA, found.record)
        (staging.folder / PAGE).write_text(render_page(found), encoding="utf-8")
        return staging.commit()


def images(found: SceneView, number: int) -> dict[str, EyeImage]:
    """Return the pictures of an eye by name; no drawn one where no renderer is judged."""
    every = {name: getattr(found.views[number], name) for name in NAMES}
    return {name: image for name, image in every.items() if image is not None}


def render_page(found: SceneView) -> str:
    """Return one HTML document that needs nothing else, online or offline."""
    pictures = [images(found, number) for number in range(len(found.views))]
    low, high = height_ends([image for some in pictures for image in some.values()])
    eyes = []
    for number, (views, some) in enumerate(zip(found.views, pictures, strict=True)):
        losses = {"display": _address(loss_map(views.replayed, found.display[number]))}
        if views.drawn is not None:
            losses["renderer"] = _address(loss_map(views.drawn, found.renderer[number]))
        encoded = {
            name: {
                "color": _address(shown(image)),
                "numbers": _address(packed(image.triangle)),
                "heights": _address(heights_picture(image, low, high)),
            }
            for name, image in some.items()
        }
        record = json_object(found.record.eyes[number])
        eyes.append({"pictures": encoded, "losses": losses, "record": record})
    parts = found.scene.objects
    firsts = accumulate((len(part.faces) for part in parts), initial=0)
    data = {
        "eyes": eyes,
        "names": NAMES,
        "heights": {"low": low, "high": high, "steps": HEIGHT_STEPS},
        "objects": [{"name": part.name, "first": n} for part, n in zip(parts, firsts, strict=False)],
        "units": found.scene.units,
        "size": found.views[0].eye.resolution,
        "aspect": found.scene.plate.size[0] / found.scene.plate.size[1],
    }
    values = {
        "found": found,
        "record": found.record,
        "sentences": sentences(found),
        "data_of_page": data,
        "seen_arcmin": SEEN_ARCMIN,
        "animated": len(found.views) > 1,
        "animation": ANIMATION,
        "versions": {**versions(), **machine()},
    }
    return html_page("view.html.j2", {"digits": digits}, values)


def _address(picture: Bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png(picture)).decode()}"


def sentences(found: SceneView) -> list[str]:
    """Return what the eyes lose, in words, the worst eye first."""
    eyes, units = found.record.eyes, found.record.units
    told = [_sentence("The display", [eye.display for eye in eyes])]
    drawn = [eye.renderer for eye in eyes if eye.renderer is not None]
    if drawn:
        told += [_sentence("The renderer", drawn), *_set_beside(eyes)]
    if found.gap is not None:
        told.append(
            f"By the theorem of docs/method.md, its near offset opens a gap of {digits(2 * found.gap)} "
            f"{units} at the plate: everything is seen {digits(found.gap)} {units} farther "
            "from the plate than it is, and nothing else is changed but for edges and for what is thereby "
            "newly hidden or uncovered."
        )
    for pair in found.record.stereo[:1]:
        if pair.renderer is not None and pair.renderer.depth is None:
            told.append("No surface point is shown to both eyes.")
        elif pair.renderer is not None and pair.renderer.depth is not None:
            ends = [
                f"{digits(abs(value))} {units} {'nearer' if value < 0 else 'farther away'}"
                for value in (pair.renderer.depth.p1, pair.renderer.depth.p99)
            ]
            told.append(f"Two eyes see what the renderer draws between {ends[0]} and {ends[1]} than it is.")
    top = float(found.scene.vertices[:, 2].max())
    within = sum(eye.eye[2] <= top for eye in eyes)
    if within:
        told.append(
            f"At {within} of {len(eyes)} eyes the numbers say little: these lie within the scene's "
            f"depth, which reaches up to z = {digits(top)} {units}, and hogels show them what is "
            "beside and behind them too."
        )
    return told


def _sentence(begin: str, losses: Sequence[Loss]) -> str:
    """Return the largest losses of all eyes in one sentence."""
    loss = max(losses, key=lambda one: one.fraction or 0.0)
    parts = []
    if loss.fraction is not None:
        parts.append(f"loses {percent(loss.fraction)} of the pixels to wrong surfaces")
    moved = [one.displacement_arcmin.p99 for one in losses if one.displacement_arcmin is not None]
    if moved:
        parts.append(f"moves 99 % of the others by at most {digits(max(moved))} arc minutes")
    looks = [one.flip for one in losses if one.flip is not None]
    if looks:
        parts.append(f"looks different by FLIP {digits(max(looks))}")
    where = "" if len(losses) == 1 else f" (the worst of {len(losses)} eyes)"
    unknown = f"; {UNKNOWN}: the hogels name none" if loss.fraction is None else ""
    return f"{begin} {', '.join(parts) or 'loses nothing that can be told'}{where}{unknown}."


def _set_beside(eyes: Sequence[EyeRecord]) -> list[str]:
    """Return whether the renderer's displacement is below the display's own, in one sentence or none."""
    display = [one.display.displacement_arcmin for one in eyes]
    drawn = [None if one.renderer is None else one.renderer.displacement_arcmin for one in eyes]
    pairs = [(a.p99, b.p99) for a, b in zip(display, drawn, strict=True) if a is not None and b is not None]
    if not any(display):
        return []
    if not pairs:
        return [
            "How far the renderer moves things is not known: its hogels do not say where their points lie."
        ]
    above = sum(b >= a for a, b in pairs)
    if not above:
        return ["At every eye the renderer moves things by less than the display itself does."]
    return [f"At {above} of {len(pairs)} eyes the renderer moves things by more than the display does."]


def table(found: SceneView) -> str:
    """Return the numbers as lines for a terminal."""
    lines = sentences(found)
    for number, eye in enumerate(found.record.eyes):
        place = ",".join(f"{value:g}" for value in eye.eye)
        for name, loss in (("display", eye.display), ("renderer", eye.renderer)):
            if loss is not None:
                said = UNKNOWN if loss.fraction is None else f"wrong {percent(loss.fraction)}"
                moved = loss.displacement_arcmin
                if moved is not None:
                    said += f", displaced {digits(moved.p50)}' p50, {digits(moved.p99)}' p99"
                said += "" if loss.flip is None else f", FLIP {digits(loss.flip)}"
                lines.append(f"eye {number} at {place}, {name:<8}  {said}")
    return "\n".join(lines)


def quilt_eyes(eye: Eye, tiles: tuple[int, int]) -> tuple[Eye, ...]:
    """Return the eyes of a quilt, from the left: on a line parallel to the plate, at equal steps of angle.

    The given eye is in the middle. InputError where there are no tiles, columns by rows, or too many.
    """
    count = tiles[0] * tiles[1]
    if min(tiles) < 1 or count > MAX_TILES:
        raise InputError(f"a quilt needs 1 to {MAX_TILES} tiles, such as 8x6, not {tiles[0]}x{tiles[1]}")
    x, y, height = eye.position
    turns = [0.0] if count == 1 else [number / (count - 1) - 0.5 for number in range(count)]
    shifts = [height * math.tan(math.radians(CONE_DEGREES) * turn) for turn in turns]
    return tuple(replace(eye, position=(x + shift, y, height)) for shift in shifts)


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

    Each row of tiles is made by itself, so that memory does not grow with the number of rows. See `view`.
    """
    eyes, names = quilt_eyes(eye, tiles), quilt_names(scene, tiles, drawn=source is not None)
    with Staging(out, names) as staging:
        # Rows of tiles by picture: the first tile is at the bottom left, then to the right, then up.
        rows: dict[str, list[Bytes]] = {}
        records = []
        for first in range(0, len(eyes), tiles[0]):
            some = eyes[first : first + tiles[0]]
            found = view(scene, some, source, effects=effects, progress=progress)
            records.append(found.record)
            tiled = [images(found, number) for number in range(len(some))]
            for name in tiled[0]:
                row = np.concatenate([shown(tile[name]) for tile in tiled], axis=1)
                rows.setdefault(name, []).append(row)
        for name, file in zip(rows, names[1:], strict=True):
            (staging.folder / file).write_bytes(png(np.concatenate(rows[name][::-1], axis=0)))
        record = replace(
            records[0],
            eyes=tuple(one for part in records for one in part.eyes),
            hogels=max(part.hogels for part in records),
        )
        write_json(staging.folder / DATA, record)
        staging.commit()
    return record
