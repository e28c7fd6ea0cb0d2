"""The page and the files of a view: pictures as PNG, OpenEXR and an animation, in one page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
    numbers_picture,
    png,
    shown,
    side_by_side,
)
from xfrustum.reports.eye.view import EyeRecord, PairRecord, SceneView
from xfrustum.scenes.files.exr import write_eye_image
from xfrustum.scenes.model.eye import EyeImage
from xfrustum.scenes.notebook import digits, percent

PAGE, DATA, ANIMATION = "index.html", "view.json", "views.gif"

NAMES = {"true": "the true view", "replayed": "the replayed truth", "drawn": "the renderer's hogels"}
"""Names of the three pictures: in files, and in words."""

UNKNOWN = "wrong surfaces unknown"
"""Words for the share of wrong surfaces of a picture that does not say which surfaces it shows."""


def file_names(eyes: int, *, drawn: bool) -> tuple[str, ...]:
    """Return the names of the files of a view of some eyes."""
    pictures = list(NAMES)[: 3 if drawn else 2]
    each = [f"{name}_{k}.{kind}" for k in range(eyes) for name in pictures for kind in ("exr", "png")]
    return (PAGE, DATA, *([ANIMATION] if eyes > 1 else []), *each)


def write_view(found: SceneView, out: Path) -> tuple[Path, ...]:
    """Write page, numbers and pictures, all or nothing.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
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
    views = found.views[number]
    pictures = {"true": views.true, "replayed": views.replayed, "drawn": views.drawn}
    return {name: image for name, image in pictures.items() if image is not None}


def render_page(found: SceneView) -> str:
    """Return one HTML document that needs nothing else, online or offline."""
    every = [image for number in range(len(found.views)) for image in images(found, number).values()]
    low, high = height_ends(every)
    data = {
        "eyes": [_eye_data(found, number, (low, high)) for number in range(len(found.views))],
        "names": NAMES,
        "heights": {"low": low, "high": high, "steps": HEIGHT_STEPS},
        "objects": _objects(found),
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


def _eye_data(found: SceneView, number: int, ends: tuple[float, float]) -> dict[str, Any]:
    """Return what the page's script needs of an eye: pictures as data addresses, and numbers."""
    pictures = {}
    for name, image in images(found, number).items():
        pictures[name] = {
            "color": _address(png(shown(image))),
            "numbers": _address(png(numbers_picture(image))),
            "heights": _address(png(heights_picture(image, *ends))),
        }
    losses = {"display": _address(png(loss_map(found.views[number].replayed, found.display[number])))}
    drawn = found.views[number].drawn
    if drawn is not None:
        losses["renderer"] = _address(png(loss_map(drawn, found.renderer[number])))
    return {"pictures": pictures, "losses": losses, "record": json_object(found.record.eyes[number])}


def _objects(found: SceneView) -> list[dict[str, Any]]:
    """Return name and first triangle of every object."""
    first, listed = 0, []
    for part in found.scene.objects:
        listed.append({"name": part.name, "first": first})
        first += len(part.faces)
    return listed


def _address(content: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(content).decode()}"


def sentences(found: SceneView) -> list[str]:
    """Return what the eyes lose, in words, the worst eye first."""
    record = found.record
    told = [_sentence("The display", [eye.display for eye in record.eyes], record.eyes)]
    drawn = [eye.renderer for eye in record.eyes if eye.renderer is not None]
    if drawn:
        told.append(_sentence("The renderer", drawn, record.eyes))
        told += _set_beside(record.eyes)
    if found.gap is not None:
        told.append(
            f"By the theorem of docs/method.md, its near offset opens a gap of {digits(2 * found.gap)} "
            f"{record.units} at the plate: everything is seen {digits(found.gap)} {record.units} farther "
            "from the plate than it is, and nothing else is changed but for edges and for what is thereby "
            "newly hidden or uncovered."
        )
    told += [_stereo_sentence(pair, record.units) for pair in record.stereo[:1] if pair.renderer is not None]
    return told + _within_the_scene(found)


def _within_the_scene(found: SceneView) -> list[str]:
    """Return how many eyes lie no higher than the top of the scene, in one sentence, or none."""
    top = float(found.scene.vertices[:, 2].max())
    count = sum(eye.eye[2] <= top for eye in found.record.eyes)
    if not count:
        return []
    return [
        f"At {count} of {len(found.record.eyes)} eyes the numbers say little: these lie within the scene's "
        f"depth, which reaches up to z = {digits(top)} {found.record.units}, and hogels show them what is "
        "beside and behind them too."
    ]


def _sentence(begin: str, losses: Sequence[Loss], eyes: Sequence[EyeRecord]) -> str:
    """Return the largest losses of all eyes in one sentence."""
    worst = max(range(len(losses)), key=lambda number: losses[number].fraction or 0.0)
    loss = losses[worst]
    parts = []
    if loss.fraction is not None:
        parts.append(f"loses {percent(loss.fraction)} of the pixels to wrong surfaces")
    moved = [one.displacement_arcmin.p99 for one in losses if one.displacement_arcmin is not None]
    if moved:
        parts.append(f"moves 99 % of the others by at most {digits(max(moved))} arc minutes")
    looks = [one.flip for one in losses if one.flip is not None]
    if looks:
        parts.append(f"looks different by FLIP {digits(max(looks))}")
    where = "" if len(eyes) == 1 else f" (the worst of {len(eyes)} eyes)"
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
    below = sum(b < a for a, b in pairs)
    if below == len(pairs):
        return ["At every eye the renderer moves things by less than the display itself does."]
    above = len(pairs) - below
    return [f"At {above} of {len(pairs)} eyes the renderer moves things by more than the display does."]


def _stereo_sentence(pair: PairRecord, units: str) -> str:
    assert pair.renderer is not None
    depth = pair.renderer.depth
    if depth is None:
        return "No surface point is shown to both eyes."
    ends = [
        f"{digits(abs(value))} {units} {'nearer' if value < 0 else 'farther away'}"
        for value in (depth.p1, depth.p99)
    ]
    return f"Two eyes see what the renderer draws between {ends[0]} and {ends[1]} than it is."


def table(found: SceneView) -> str:
    """Return the numbers as lines for a terminal."""
    lines = sentences(found)
    for number, eye in enumerate(found.record.eyes):
        place = ",".join(f"{value:g}" for value in eye.eye)
        for name, loss in (("display", eye.display), ("renderer", eye.renderer)):
            if loss is not None:
                lines.append(f"eye {number} at {place}, {name:<8}  {_row(loss)}")
    return "\n".join(lines)


def _row(loss: Loss) -> str:
    wrong = UNKNOWN if loss.fraction is None else f"wrong {percent(loss.fraction)}"
    moved = loss.displacement_arcmin
    shift = "" if moved is None else f", displaced {digits(moved.p50)}' p50, {digits(moved.p99)}' p99"
    flip = "" if loss.flip is None else f", FLIP {digits(loss.flip)}"
    return wrong + shift + flip
