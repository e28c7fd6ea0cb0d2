"""What objects say of themselves, and how a notebook shows them, on light and on dark pages."""

from __future__ import annotations

import io
import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.appearance.display import LEVELS, encoded
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Singles
from xfrustum.scenes.errors import InputError

if TYPE_CHECKING:
    import xarray

# Numbers as people read them


def digits(value: float) -> str:
    """Write a number with three digits, such as `0.0474` or `2.87e-7`, and thousands in full: `7,470`."""
    written = f"{value:.3g}"
    return f"{float(written):,.0f}" if 1e3 <= abs(value) < 1e9 else plain(written)


def percent(fraction: float) -> str:
    """Write a fraction as percent with two digits, such as `0.012 %`; `100 %` has three."""
    return plain(f"{100 * fraction:.0f} %" if fraction >= 0.1 else f"{100 * fraction:.2g} %")


def sides(lengths: Iterable[float]) -> str:
    """Write lengths or counts of sides, such as `60 x 40`."""
    return " x ".join(f"{length:,.6g}" for length in lengths)


def counted(number: int, name: str) -> str:
    """Write how many there are of something, such as `1 object` or `2,000 triangles`."""
    return f"{number:,} {name if number == 1 else name + 's'}"


def plain(text: str) -> str:
    """Drop the zero that Python puts into small exponents."""
    return re.sub(r"e([+-])0(\d)", r"e\1\2", text).replace("e+", "e")


def aligned(rows: Sequence[Sequence[str]], others: Callable[[str, int], str] = str.rjust) -> str:
    """Return rows of cells as lines: the first column to the left, the others to the right, or as asked."""
    first, *rest = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = ([row[0].ljust(first), *map(others, row[1:], rest)] for row in rows)
    return "\n".join("  ".join(line).rstrip() for line in cells)


# Images as pictures

SHADES = (0.35, 0.9)  #: darkest and lightest gray of surfaces in pictures without color, by height
#: Colors of pixels that show a wrong surface or a displaced point; brightness of a picture under
#: marks, and opacity of the mark of a displaced pixel.
WRONG, MOVED, DIMMED, MARKED = (224, 49, 49), (49, 130, 224), 0.5, 0.8
#: Longest side that smaller pictures are enlarged to, as far as pixels become squares of whole
#: ones, and the longest that larger ones are reduced to, so that notebooks stay small.
MIN_SIDE_PX, MAX_SIDE_PX = 280, 512


def as_shown(color: Singles | None, covered: Mask, height: NDArray[np.floating]) -> Bytes:
    """Return an image of linear RGB as a screen shows it, (H, W, 3); without colors, see `by_height`."""
    return by_height(covered, height) if color is None else _levels(encoded(color))


def by_height(covered: Mask, height: NDArray[np.floating]) -> Bytes:
    """Return surfaces as shades of gray, (H, W, 3): the lowest dark, the highest light, black for none."""
    gray = np.where(covered, SHADES[0], 0.0)
    known = np.isfinite(height)
    if known.any():
        low, high = float(height[known].min()), float(height[known].max())
        share = (height[known] - low) / (high - low if high > low else 1.0)
        gray[known] = SHADES[0] + share * (SHADES[1] - SHADES[0])
    return _levels(np.repeat(gray[..., None], 3, axis=-1))


def _levels(values: Singles | Floats) -> Bytes:
    return np.asarray(np.rint(LEVELS * np.asarray(values)), dtype=np.uint8)


def marked(picture: Bytes, wrong: Mask | None, moved: Floats) -> Bytes:
    """Return a picture (H, W, 3) in dimmed gray, with wrong surfaces red and displaced points blue.

    `moved` is the displacement as a share of the one in full color, NaN for none; `wrong` is None
    if not known.
    """
    found = np.repeat(picture.mean(axis=-1, keepdims=True) * DIMMED, 3, axis=-1)
    share = np.nan_to_num(np.clip(moved, 0.0, 1.0))[..., None]
    found = found * (1 - MARKED * share) + MARKED * share * np.array(MOVED)
    if wrong is not None:
        found[wrong] = WRONG
    return np.asarray(np.rint(found), dtype=np.uint8)


def map_of(values: Floats) -> Bytes:
    """Return numbers (rows, columns) as squares, the largest the brightest; black where there is none."""
    known = np.isfinite(values)
    largest = float(values.max(where=known, initial=0.0))
    share = np.where(
        known, SHADES[0] + (1 - SHADES[0]) * np.nan_to_num(values) / (largest or 1.0), 0.0
    )
    return _levels(np.repeat(share[..., None], 3, axis=-1))


def png(picture: Bytes) -> bytes:
    """Return a picture (H, W, 3) as PNG of `MIN_SIDE_PX` to `MAX_SIDE_PX` pixels, in whole steps of size."""
    from PIL import Image  # noqa: PLC0415 - images are opened without it

    longest = max(picture.shape[:2])
    factor = max(1, MIN_SIDE_PX // longest)
    image = Image.fromarray(
        np.ascontiguousarray(picture.repeat(factor, axis=0).repeat(factor, axis=1))
    )
    divisor = -(-longest // MAX_SIDE_PX)
    stream = io.BytesIO()
    (image if divisor == 1 else image.reduce(divisor)).save(stream, format="PNG", optimize=True)
    return stream.getvalue()


# Images as labelled arrays

#: Unit of lengths where nobody says what a scene's own unit is, and of what has none, as in stored
#: plates.
SCENE_UNITS, NO_UNIT = "scene units", "1"


@dataclass(frozen=True)
class Labelled:
    """One array of an image, (H, W) or (H, W, 3), row 0 at the top, or one value; None for none."""

    values: NDArray[Any] | float | None
    meaning: str  #: in words
    units: str | None = None  #: None of numbers and classes
    last: str = "rgb"  #: name of the third dimension

    @property
    def variable(self) -> tuple[tuple[str, ...], NDArray[Any], dict[str, str]]:
        """Dimensions, values and attributes, as xarray takes them."""
        values = np.asarray(self.values)
        units = {} if self.units is None else {"units": self.units}
        return ("v", "u", self.last)[: values.ndim], values, {"long_name": self.meaning, **units}


def dataset(
    images: Mapping[str, Labelled | None],
    places: Mapping[str, Labelled],
    attributes: Mapping[str, object],
) -> xarray.Dataset:
    """Return arrays of an image as a dataset, with names, units and signs of stored plates.

    Pixels have the dimensions v and u, as in the groups that `plate` writes (CONVENTIONS.md,
    "Plates"). The first of `images` is (H, W); `places` are coordinates of the whole image,
    `attributes` its facts. None is left out. Raises InputError where xarray is not installed.
    """
    try:
        import xarray  # noqa: PLC0415 - it takes a second to load
    except ImportError as error:
        raise InputError(
            "labelled arrays need the package xarray, which is not installed: "
            "pip install '.[notebook]' in the checkout of xfrustum"
        ) from error
    known = {
        n: one.variable for n, one in images.items() if one is not None and one.values is not None
    }
    height, width = next(iter(known.values()))[1].shape[:2]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    film = {
        name: (
            name,
            values,
            {"long_name": f"film coordinate of the pixel's center, {way}", "units": NO_UNIT},
        )
        for name, values, way in (("u", u, "to the right"), ("v", v, "upward"))
    }
    return xarray.Dataset(
        known,
        coords={**film, **{name: one.variable for name, one in places.items()}},
        attrs={name: value for name, value in attributes.items() if value is not None},
    )


# Objects that a notebook shows

#: Line about pictures, in CSS; seen on light and on dark pages.
LINE = "1px solid rgba(128, 128, 128, 0.4)"


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture, PNG, WebP or SVG, with its caption."""

    caption: str
    content: bytes

    @property
    def media_type(self) -> str:
        """Media type of the content."""
        if self.content.startswith(b"\x89PNG"):
            return "image/png"
        return "image/webp" if self.content.startswith(b"RIFF") else "image/svg+xml"

    def html(self) -> str:
        """Return the figure as HTML, with the picture in it."""
        source, caption = b64encode(self.content).decode(), escape(self.caption)
        return (
            '<figure style="margin: 0; width: min-content; min-width: 140px">'
            f'<img src="data:{self.media_type};base64,{source}" alt="{caption}" '
            f'style="border: {LINE}; max-width: none"><figcaption>{caption}</figcaption></figure>'
        )


class NotebookRepr:
    """An object that says in a line what it is (`_said`).

    Notebooks show its facts (`_facts`) and pictures (`_figures`).
    """

    def _said(self) -> str:
        """Return what the object is, in a line or two with sizes and units; cheap to find."""
        raise NotImplementedError

    def table(self) -> str:
        """Return the facts as aligned lines, as a command prints them; empty where no command does."""
        return ""

    def _facts(self) -> str:
        """Return the facts that a notebook shows below that line, as text."""
        return self.table()

    def _figures(self) -> Sequence[Figure]:
        """Return the pictures that a notebook shows."""
        return ()

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self._said()}"

    def _repr_html_(self) -> str:
        name, said = escape(type(self).__name__), escape(self._said())
        figures = "".join(one.html() for one in self._figures())
        row = (
            f'<div style="display: flex; flex-wrap: wrap; gap: 12px">{figures}</div>'
            if figures
            else ""
        )
        facts = (
            f'<pre style="white-space: pre-wrap">{escape(text)}</pre>'
            if (text := self._facts())
            else ""
        )
        return f"<div><p><b>{name}</b>: {said}</p>{row}{facts}</div>"

    def _repr_png_(self) -> bytes | None:
        found = next(iter(self._figures()), None)
        return found.content if found is not None and found.media_type == "image/png" else None


class ShortRepr:
    """A dataclass whose `repr` names its fields, and of arrays and of other objects the kind alone."""

    def __repr__(self) -> str:
        named = (f"{one.name}={_kind(getattr(self, one.name))}" for one in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(named)})"


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, tuple | list) and len(value) > 0:
        return f"{len(value)} of {type(value[0]).__name__}"
    simple = value is None or isinstance(value, bool | int | float | str)
    return repr(value) if simple else f"<{type(value).__name__}>"
