"""The inspection page: one file of bounded size, files beside it for what is larger, and both read back."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection.channels import (
    MAX_HOGELS,
    MAX_INSPECTED_PIXELS,
    HogelHead,
    InspectedHogel,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Plate

PAGE, FILE = "inspect.html", "inspect-{}x{}.js"
"""Names of the page, and of a file beside it by column and row."""

_BESIDE_START = 'takeStream("'
"""Beginning of a file beside the page."""

MAX_PAGE_BYTES = 18_000_000
"""Largest size of the page. It shall pass through a mail server as an attachment: the usual limit is 25 MB,
of which base64, in which attachments travel, leaves three fourths. Hogels that do not fit lie in files beside
the page, one each."""


MAX_MAP_CELLS = 120
"""Largest number of cells along a side of a map; a cell of a larger plate stands for several hogels. On the
page a map is some 360 pixels wide, so that a cell has at least three."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMap:
    """One number of the hogels of a plate, told in percent where `words` begin with "Share".

    `cells` are (rows, columns) of cells, the largest value in each; NaN where no hogel is known.
    """

    words: str
    cells: Floats

    @classmethod
    def of(cls, plate: Plate, words: str, values: Iterable[tuple[int, int, float]]) -> PlateMap:
        """Make a map of hogels by column and row."""
        columns, rows = (min(count, MAX_MAP_CELLS) for count in plate.hogels)
        cells = np.full((rows, columns), np.nan)
        for column, row, value in values:
            place = row * rows // plate.hogels[1], column * columns // plate.hogels[0]
            cells[place] = np.fmax(cells[place], value)
        return cls(words=words, cells=cells)


@dataclass(frozen=True, kw_only=True, eq=False)
class Inspection:
    """What a page shows, found out by a command: report, verify or survey.

    Sentences about the hogels (`told`): what was drawn, and which they are; the hogels, the worst first, of
    which no more than `MAX_HOGELS` are shown; and how bad the hogels of the plate are.
    """

    command: str
    scene: Scene
    told: tuple[str, ...]
    hogels: Sequence[InspectedHogel]
    plate_map: PlateMap


@dataclass(frozen=True, kw_only=True)
class PageHogel(HogelHead):
    """One hogel as the page's script reads it."""

    key: str  #: digest of the stream, empty where there is none
    file: str | None  #: name of the file beside the page; None where the stream is on the page


def write_inspection(folder: Path, shown: Inspection) -> None:
    """Write the page into a folder, and the files beside it that it needs."""
    hogels = tuple(shown.hogels)[:MAX_HOGELS]
    streams = [base64.b64encode(one.stream).decode() for one in hogels]
    keys = [hashlib.sha256(text.encode()).hexdigest()[:16] if text else "" for text in streams]
    room = MAX_PAGE_BYTES - len(_rendered(shown, hogels, keys, {}).encode())
    within: dict[str, str] = {}
    for key, text in zip(keys, streams, strict=True):
        size = len(f'<script type="application/json" id="stream-{key}">"{text}"</script>\n')
        if key and size <= room:
            within[key] = text
            room -= size
    (folder / PAGE).write_text(_rendered(shown, hogels, keys, within), encoding="utf-8")
    for one, key, text in zip(hogels, keys, streams, strict=True):
        if key and key not in within:
            # Pages on a disk may run scripts from there, and read nothing else.
            beside = folder / FILE.format(*one.aperture)
            beside.write_text(f'{_BESIDE_START}{key}","{text}");\n', encoding="ascii")


def remove_inspection(folder: Path) -> None:
    """Remove the page of an earlier run from a folder, and the files beside it."""
    for path in _earlier(folder):
        path.unlink(missing_ok=True)


@contextmanager
def replacing_inspection(folder: Path) -> Iterator[None]:
    """Remove the files beside the page of an earlier run that the page that takes its place does not need.

    They are removed when the block has ended, which puts the new page there; none are where it fails.
    """
    before = _earlier(folder)[1:]
    yield
    page = (folder / PAGE).read_text(encoding="utf-8") if before else ""
    for path in before:
        if f'"{path.name}"' not in page:
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


def _rendered(
    shown: Inspection, hogels: Sequence[InspectedHogel], keys: Sequence[str], within: dict[str, str]
) -> str:
    nonce = base64.b64encode(hashlib.sha256("".join(keys).encode()).digest()[:18]).decode()
    scene, cells = shown.scene, shown.plate_map.cells
    first = np.cumsum([0, *(len(part.faces) for part in scene.objects)]).tolist()
    files = [FILE.format(*one.aperture) for one in hogels]
    data = {
        "hogels": [
            PageHogel(**one.head, key=key, file=file if key and key not in within else None)
            for one, key, file in zip(hogels, keys, files, strict=True)
        ],
        # An object by its name, and the number of its first triangle.
        "objects": [{"name": p.name, "first": n} for p, n in zip(scene.objects, first, strict=False)],
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
    return html_page("inspect.html.j2", {}, values, nonce=nonce)


def read_inspection(page: Path) -> list[InspectedHogel]:
    """Return the hogels of a page, with the bits that they were written with.

    Raises
    ------
    InputError
        The file cannot be read or is no inspection page, or a file beside it is missing.
    """

    def stream(one: PageHogel) -> bytes:
        if not one.key:
            return b""
        if one.file is None:
            return base64.b64decode(json.loads(_element(text, f"stream-{one.key}")))
        beside = (page.parent / one.file).read_text(encoding="ascii")
        found = re.fullmatch(rf'takeStream\("{one.key}","([\w+/=]*)"\);\n', beside)
        if found is None:
            raise ValueError(f"{one.file} belongs to another page")
        return base64.b64decode(found[1])

    try:
        text = page.read_text(encoding="utf-8")
        hogels = TypeAdapter(list[PageHogel]).validate_python(json.loads(_element(text, "data"))["hogels"])
        return [InspectedHogel(**one.head, stream=stream(one)) for one in hogels]
    except OSError as error:
        raise InputError(f"{page}: cannot be read ({error.strerror}); write it again") from error
    except (KeyError, ValueError) as error:
        raise InputError(f"{page}: is no inspection page that this version has written") from error


def _element(text: str, identifier: str) -> str:
    """Return the content of an element with JSON, in which no `<` stands."""
    start = f'<script type="application/json" id="{identifier}">'
    begin = text.index(start) + len(start)
    return text[begin : text.index("</script>", begin)]
