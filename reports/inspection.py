"""The inspection page: every channel of truth and image at every pixel, where they differ, and why.

It is one file of bounded size with files beside it for what is larger; all can be read back.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from xfrustum.compare.judging.judged import Figures
from xfrustum.compare.metrics.error_maps import displacement, judged_pixels
from xfrustum.compare.run import Evaluator, FrameRequest, JudgedFrame
from xfrustum.raster.rasterizer import normals_of
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.scout import plate_cells
from xfrustum.reports.text import CERTAINTY_LABELS
from xfrustum.scenes import Aperture, DoubleFrustum, HogelImage, InputError, Plate, Scene
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.files.channels import CERTAINTY, COLOR, HEIGHT, OBJECT, POSITION, TRIANGLE
from xfrustum.scenes.files.exr import stored_planes
from xfrustum.scenes.representation import digits, percent

PAGE, FILE = "inspect.html", "inspect-{}x{}.js"
"""Names of the page, and of a file beside it by column and row."""

_BESIDE_START = 'takeStream("'  #: beginning of a file beside the page

MAX_PAGE_BYTES = 18_000_000
"""Largest size of the page. It shall pass through a mail server as an attachment: the usual limit is 25 MB,
of which base64, in which attachments travel, leaves three fourths. Hogels that do not fit lie in
files beside
the page, one each."""

MAX_HOGELS = 12
"""Largest number of hogels of a page and its files: at 512 x 512 pixels each takes several MB."""

MAX_INSPECTED_PIXELS = 1 << 22
"""Largest number of pixels of a hogel that a page shows. A browser holds a hogel as one string in base64, in
Chromium of at most 2^29 - 24 characters. The channels of truth, image and errors take 103 bytes a
pixel, 137 characters, which is 7 % too many for 2^22 pixels. Numbers of triangles, objects and
certainty are 20 of these
bytes, and half of them, the upper ones, are always zero and take no room."""

STATE, CORRECTED, LINK, ROUNDING = "state", "state.corrected", "cause", "rounding"
"""Names of the channels of errors that have labels."""

TYPES = {"float32": "<f4", "uint32": "<u4", "uint8": "u1"}
"""Types of channels by their names on a page: those of the typed arrays of browsers."""

DRAWN = FrameRequest(
    color=True, causes=True
)  #: what frames must be judged with to be inspected: colors and causes

Channel = tuple[NDArray[Any], tuple[str, ...]]
"""(H, W) values, float32, uint32 or uint8, and labels: meanings of the values 0, 1, .. of classes."""

Layer = tuple[str, str, Mapping[str, Channel]]
"""Name (truth, image or error), words for people, and channels by their names, those of OpenEXR if it has
them; all channels of a hogel have one size."""


@dataclass(frozen=True)
class ChannelHead:
    """Name, type (one of `TYPES`) and labels of a channel."""

    name: str
    kind: str
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class LayerHead:
    """Name, words for people, and channels of a layer."""

    name: str
    words: str
    channels: tuple[ChannelHead, ...]


@dataclass(frozen=True, kw_only=True)
class InspectedHogel:
    """One hogel with all its channels."""

    aperture: tuple[int, int]  #: column and row
    size: tuple[int, int]  #: width and height in pixels
    words: str  #: how bad the hogel is
    layers: tuple[LayerHead, ...]
    #: Values of all channels, one layer after the other, little-endian, as one zlib stream. Empty
    #: where the hogel has more than `MAX_INSPECTED_PIXELS`.
    stream: bytes

    @classmethod
    def from_layers(cls, aperture: Aperture, words: str, layers: Sequence[Layer]) -> InspectedHogel:
        """Pack the layers of a hogel."""
        every = [values for _, _, channels in layers for values, _ in channels.values()]
        height, width = every[0].shape
        stream = b""
        if width * height <= MAX_INSPECTED_PIXELS:
            packed = zlib.compressobj()
            contents = (np.ascontiguousarray(one, TYPES[str(one.dtype)]).tobytes() for one in every)
            stream = b"".join((*map(packed.compress, contents), packed.flush()))
        heads = []
        for name, shown, channels in layers:
            kinds = (
                ChannelHead(one, str(values.dtype), labels)
                for one, (values, labels) in channels.items()
            )
            heads.append(LayerHead(name, shown, tuple(kinds)))
        size = (width, height)
        return cls(
            aperture=aperture.index, size=size, words=words, layers=tuple(heads), stream=stream
        )

    def values(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Return the (H, W) values by the names of layer and channel; none of a hogel without a stream.

        Raises ValueError where the stream does not hold these channels.
        """
        found: dict[str, dict[str, NDArray[Any]]] = {}
        content, place = zlib.decompress(self.stream) if self.stream else b"", 0
        for layer in self.layers if self.stream else ():
            found[layer.name] = {}
            for one in layer.channels:
                values = np.frombuffer(content, TYPES[one.kind], math.prod(self.size), place)
                found[layer.name][one.name] = values.reshape(self.size[::-1])
                place += values.nbytes
        if place != len(content):
            raise ValueError(f"{len(content)} bytes are not the channels of {self.size} pixels")
        return found


def image_channels(image: HogelImage, scene: Scene | None = None) -> dict[str, Channel]:
    """Return the channels that an image has in a file, with the bits of that file.

    The height is left out: it is the third coordinate of the position. With a scene, an image
    without normals has those of its triangles: all renderers that name triangles share them.
    Without, the image is a foreign one, and channels in which it says nothing at any pixel are left
    out.
    """
    if scene is not None and image.normal is None:
        image = replace(image, normal=normals_of(scene, image.triangle))
    planes = stored_planes(image)
    if scene is None:
        planes = {
            one: values for one, values in planes.items() if np.nan_to_num(values).any()
        } or planes
    first = [one for one in (*COLOR, TRIANGLE, OBJECT, CERTAINTY, *POSITION) if one in planes]
    labels = {CERTAINTY: tuple(CERTAINTY_LABELS.values())}
    return {
        one: (planes[one], labels.get(one, ()))
        for one in dict.fromkeys((*first, *planes))
        if one != HEIGHT
    }


def _classes(masks: Mapping[str, Mask], otherwise: str) -> Channel:
    """Return a channel of classes: the label of the first mask that has a pixel, else `otherwise`."""
    values = np.zeros(next(iter(masks.values())).shape, dtype=np.uint8)
    for number, mask in reversed(list(enumerate(masks.values(), start=1))):
        values[mask] = number
    return values, (otherwise, *masks)


def _displacements(moved: NDArray[np.floating]) -> dict[str, Channel]:
    """Return (H, W, 2) displacements, px, to the right and down, as two channels of float32."""
    return {
        f"displacement.{name}": (moved[..., axis].astype(np.float32), ())
        for axis, name in enumerate("XY")
    }


def inspected_drawings(
    judge: Evaluator, apertures: Sequence[Aperture], setting: DoubleFrustum, *, causes: bool = True
) -> Iterator[InspectedHogel]:
    """Yield the hogels of some apertures, drawn with a setting, and perhaps the causes of their errors."""
    request = replace(DRAWN, causes=causes)
    with closing(judge.frames(apertures, (setting,), request)) as frames:
        yield from (inspected_frame(judge.scene, frame) for frame in frames)


def inspected_frame(scene: Scene, frame: JudgedFrame) -> InspectedHogel:
    """Return a frame of our own rasterizer with its truth, errors, and causes where these were asked for."""
    numbers, settings, maps = frame.comparison.numbers, frame.settings, frame.comparison.maps
    words = "" if numbers.surface is None else f"wrong surfaces {percent(numbers.surface.fraction)}"
    if numbers.displacement_px is not None:
        words += f", displacement (p99) {digits(numbers.displacement_px.p99)} px"
    assert maps.surface is not None and maps.outside is not None, "a judge has the scene at hand"
    states = {
        "tie, not judged": ~maps.judged,
        "wrong surface, whose point belongs outside the film": maps.outside,
        "wrong surface": maps.surface,
        "right surface, another triangle": maps.triangle,
    }
    errors = {STATE: _classes(states, "right")}
    if (budget := frame.budget) is not None:
        links = {name: budget.surface_charge == number for number, name in enumerate(budget.links)}
        errors[LINK] = _classes(links, "none")
        errors[ROUNDING] = _classes(budget.explanation.masks, "none")
    errors |= _displacements(maps.displacement)
    drawing = f"rasterizer: near {digits(settings.near)}, {settings.depth_label}"
    layers = [
        ("truth", "truth", image_channels(frame.truth, scene)),
        ("image", drawing, image_channels(frame.image, scene)),
        ("error", "errors of the image", errors),
    ]
    return InspectedHogel.from_layers(frame.aperture, words, layers)


def inspected_figures(
    scene: Scene, aperture: Aperture, as_found: Figures, corrected: Figures
) -> InspectedHogel:
    """Return a hogel of another renderer, judged as it was found and after correction."""

    def state(figures: Figures) -> Channel:
        masks = {"tie, not judged": ~judged_pixels(figures.answer), "wrong": figures.error}
        return _classes(masks, "right")

    words = f"{as_found.numbers.limited_words} {percent(as_found.numbers.judged_fraction)}"
    errors = {STATE: state(as_found)}
    if corrected is not as_found:
        words += f", corrected {percent(corrected.numbers.judged_fraction)}"
        errors[CORRECTED] = state(corrected)
    if corrected.cause_masks is not None:
        errors[ROUNDING] = _classes(corrected.cause_masks.masks, "none")
    if np.isfinite(as_found.image.position).any():
        errors |= _displacements(displacement(as_found.image, as_found.answer.camera))
    layers = [
        ("truth", "what it should show", image_channels(as_found.answer, scene)),
        ("image", "image, upright", image_channels(as_found.image)),
        ("error", "errors of the image", errors),
    ]
    return InspectedHogel.from_layers(aperture, words, layers)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMap:
    """One number of the hogels of a plate, told in percent where `words` begin with "Share".

    `cells` are (rows, columns) of cells, the largest value in each; NaN where no hogel is known.
    """

    words: str
    cells: Floats

    @classmethod
    def from_values(
        cls, plate: Plate, words: str, values: Iterable[tuple[int, int, float]]
    ) -> PlateMap:
        """Make a map of hogels by column and row."""
        every = np.reshape(list(values), (-1, 3))
        return cls(words=words, cells=plate_cells(plate.hogels, every[:, :2], every[:, 2])[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Inspection:
    """What a page shows, found out by a command: report, verify or survey."""

    command: str
    scene: Scene
    told: str  #: a sentence about the hogels: what was drawn, and which they are
    hogels: Sequence[InspectedHogel]  #: the worst first; no more than `MAX_HOGELS` are shown
    plate_map: PlateMap  #: how bad the hogels of the plate are


def write_inspection(folder: Path, shown: Inspection) -> None:
    """Write the page into a folder, and the files beside it that it needs."""
    hogels = tuple(shown.hogels)[:MAX_HOGELS]
    texts = [base64.b64encode(one.stream).decode() for one in hogels]
    keys = [hashlib.sha256(text.encode()).hexdigest()[:16] if text else "" for text in texts]
    room = MAX_PAGE_BYTES - len(_rendered(shown, hogels, keys, {}).encode())
    within: dict[str, str] = {}
    for key, text in zip(keys, texts, strict=True):
        size = len(f'<script type="application/json" id="stream-{key}">"{text}"</script>\n')
        if key and size <= room:
            within[key] = text
            room -= size
    (folder / PAGE).write_text(_rendered(shown, hogels, keys, within), encoding="utf-8")
    for one, key, text in zip(hogels, keys, texts, strict=True):
        if key and key not in within:
            # Pages on a disk may run scripts from there, and read nothing else.
            beside = folder / FILE.format(*one.aperture)
            beside.write_text(f'{_BESIDE_START}{key}","{text}");\n', encoding="ascii")


def first_triangles(scene: Scene) -> list[dict[str, Any]]:
    """Return each object by its name, with the number of its first triangle, as scripts of pages read it."""
    firsts = accumulate((len(part.faces) for part in scene.objects), initial=0)
    return [{"name": one.name, "first": n} for one, n in zip(scene.objects, firsts, strict=False)]


def _rendered(
    shown: Inspection,
    hogels: Sequence[InspectedHogel],
    keys: Sequence[str],
    within: Mapping[str, str],
) -> str:
    """Return the page; `within` are the streams that lie on it, by their digests, which are empty of none."""
    nonce = base64.b64encode(hashlib.sha256("".join(keys).encode()).digest()[:18]).decode()
    scene, cells = shown.scene, shown.plate_map.cells
    data = {
        "hogels": [
            {
                **{name: getattr(one, name) for name in ("aperture", "size", "words", "layers")},
                "key": key,
                "file": FILE.format(*one.aperture) if key and key not in within else None,
            }
            for one, key in zip(hogels, keys, strict=True)
        ],
        "objects": first_triangles(scene),
        "units": scene.units,
        "plate": scene.plate.hogels,
        "map_words": shown.plate_map.words,
        "in_percent": shown.plate_map.words.startswith("Share"),
        "cells": [[None if np.isnan(x) else float(f"{x:.4g}") for x in row] for row in cells],
        "nonce": nonce,
    }
    values = {
        "shown": shown,
        "page_data": data,
        "hogels": hogels,
        "left_out": len(shown.hogels) - len(hogels),
        "streams": within,
        "megapixels": MAX_INSPECTED_PIXELS / 1e6,
    }
    return html_page("inspect.html.j2", values, nonce=nonce)


@contextmanager
def replacing_inspection(folder: Path, *, kept: bool = True) -> Iterator[None]:
    """Remove what an earlier run has left beside the page that takes its place, or all where there is none.

    It is removed when the block has ended, which puts the new page there; nothing is where it
    fails.
    """
    page, before = folder / PAGE, _earlier(folder)
    yield
    text = page.read_text(encoding="utf-8") if kept and before else ""
    for path in before[1 if kept else 0 :]:
        if f'"{path.name}"' not in text:
            path.unlink(missing_ok=True)


def _earlier(folder: Path) -> list[Path]:
    """Return the page of an earlier run, and the files with streams beside it; none where it is not ours."""
    found = [folder / PAGE]
    try:
        _element(found[0].read_text(encoding="utf-8"), "data")
    except (OSError, ValueError):
        return []
    for path in folder.glob("inspect-*x*.js"):
        with suppress(OSError), path.open("rb") as file:
            # Others of such a name belong to somebody else.
            if file.read(len(_BESIDE_START)) == _BESIDE_START.encode():
                found.append(path)
    return found


def read_inspection(page: Path) -> list[InspectedHogel]:
    """Return the hogels of a page, with the bits that were written; InputError where a file is damaged."""

    def stream(key: str, file: str | None) -> bytes:
        if not key or file is None:
            return base64.b64decode(json.loads(_element(text, f"stream-{key}"))) if key else b""
        found = re.fullmatch(
            rf'takeStream\("{key}","([\w+/=]*)"\);\n',
            (page.parent / file).read_text(encoding="ascii"),
        )
        if found is None:
            raise ValueError(f"{file} belongs to another page")
        return base64.b64decode(found[1])

    try:
        text = page.read_text(encoding="utf-8")
        hogels = json.loads(_element(text, "data"))["hogels"]
        read = [{"stream": stream(one.pop("key"), one.pop("file")), **one} for one in hogels]
        return TypeAdapter(list[InspectedHogel]).validate_python(read)
    except OSError as error:
        raise InputError(f"{page}: cannot be read ({error.strerror}); write it again") from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{page}: is no inspection page that this version has written") from error


def _element(text: str, identifier: str) -> str:
    """Return the content of an element with JSON, in which no `<` stands."""
    start = f'<script type="application/json" id="{identifier}">'
    begin = text.index(start) + len(start)
    return text[begin : text.index("</script>", begin)]
