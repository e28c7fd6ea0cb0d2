"""Notebook display of results: a line, facts and pictures, as HTML and PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from xfrustum.reports.common.templates_environment import fragment
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Singles
from xfrustum.scenes.representation import LEVELS, encoded

# Pictures
# ------------------------------------------------------------------------------------------------

#: darkest and lightest gray of surfaces in pictures without color, by height
SHADES = (0.35, 0.9)
#: Colors of pixels that show a wrong surface or a displaced point; brightness of a picture under
#: marks, and opacity of the mark of a displaced pixel.
WRONG, MOVED, DIMMED, MARKED = (224, 49, 49), (49, 130, 224), 0.5, 0.8
#: Longest side to which small pictures are enlarged by a whole factor, and longest side to which
#: large pictures are reduced, so that notebooks stay small.
MIN_SIDE_PX, MAX_SIDE_PX = 280, 512


def as_shown(color: Singles | None, covered: Mask, height: NDArray[np.floating]) -> Bytes:
    """Return linear RGB as displayed levels (H, W, 3); without colors, shades by height."""
    return by_height(covered, height) if color is None else _levels(encoded(color))


def by_height(covered: Mask, height: NDArray[np.floating]) -> Bytes:
    """Return surfaces as shades of gray (H, W, 3): the lowest dark, the highest light."""
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

    `moved` is the displacement, as a share of the displacement that is drawn in full color, or NaN;
    `wrong` is None if not known.
    """
    shades = np.repeat(picture.mean(axis=-1, keepdims=True) * DIMMED, 3, axis=-1)
    share = np.nan_to_num(np.clip(moved, 0.0, 1.0))[..., None]
    shades = shades * (1 - MARKED * share) + MARKED * share * np.array(MOVED)
    if wrong is not None:
        shades[wrong] = WRONG
    return np.asarray(np.rint(shades), dtype=np.uint8)


def map_of(values: Floats) -> Bytes:
    """Return values (rows, columns) as shades, brightest at the largest; NaN is black."""
    known = np.isfinite(values)
    largest = float(values.max(where=known, initial=0.0))
    share = np.where(
        known, SHADES[0] + (1 - SHADES[0]) * np.nan_to_num(values) / (largest or 1.0), 0.0
    )
    return _levels(np.repeat(share[..., None], 3, axis=-1))


def png(picture: Bytes) -> bytes:
    """Return a picture (H, W, 3) as PNG, scaled by whole factors to a useful size."""
    longest = max(picture.shape[:2])
    factor = max(1, MIN_SIDE_PX // longest)
    image = Image.fromarray(
        np.ascontiguousarray(picture.repeat(factor, axis=0).repeat(factor, axis=1))
    )
    divisor = -(-longest // MAX_SIDE_PX)
    stream = io.BytesIO()
    (image if divisor == 1 else image.reduce(divisor)).save(stream, format="PNG", optimize=True)
    return stream.getvalue()


# Displays
# ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture, PNG, WebP or SVG, with its caption."""

    caption: str
    content: bytes


@dataclass(frozen=True, kw_only=True)
class Display:
    """Content of the display of an object."""

    #: the object in a line, with sizes and units
    line: str
    #: further lines, aligned
    facts: str = ""
    figures: Sequence[Figure] = ()

    def html(self, name: str) -> str:
        """Return HTML without scripts and without colors of its own."""
        return fragment("_notebook.html.j2", {"name": name, "shown": self})

    @property
    def first_png(self) -> bytes | None:
        """The first picture; None if there is none, or it is not a PNG."""
        content = next((figure.content for figure in self.figures), b"")
        return content if content.startswith(b"\x89PNG") else None


class NotebookRepr:
    """A result that a notebook displays, by its line, facts and pictures."""

    def _said(self) -> str:
        """Return the result in one or two lines, with sizes and units, without long computation."""
        raise NotImplementedError

    def table(self) -> str:
        """Return the facts as aligned lines, as a command prints them; empty if there are none."""
        return ""

    def _facts(self) -> str:
        """Return the facts that a notebook shows below the line, as text."""
        return self.table()

    def _figures(self) -> Sequence[Figure]:
        """Return the pictures that a notebook shows."""
        return ()

    def _display(self) -> Display:
        return Display(line=self._said(), facts=self._facts(), figures=self._figures())

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self._said()}"

    def _repr_html_(self) -> str:
        return self._display().html(type(self).__name__)

    def _repr_png_(self) -> bytes | None:
        return self._display().first_png
