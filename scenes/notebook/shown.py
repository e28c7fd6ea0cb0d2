"""Objects that say in a line what they are, and that a notebook shows with tables and pictures.

Jupyter and others look for `_repr_html_` and `_repr_png_`. The HTML has no scripts and no colors of its own
but those of pictures, so that it reads on light and on dark pages.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from html import escape

import numpy as np

LINE = "1px solid rgba(128, 128, 128, 0.4)"
"""Line of tables and about pictures, in CSS; seen on light and on dark pages."""

MAX_TABLE_ROWS = 24
"""Largest number of rows of a table; of a longer one the first are shown, and the rest is counted."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of words.

    Attributes
    ----------
    rows
        Rows of cells.
    head
        Names of the columns; empty for rows of a name and a value.
    numbers
        Whether all columns but the first hold numbers.
    """

    rows: Sequence[Sequence[str]]
    head: Sequence[str] = ()
    numbers: bool = False


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture with its caption.

    Attributes
    ----------
    caption
        What it shows, in words.
    content
        PNG, WebP or SVG.
    """

    caption: str
    content: bytes

    @property
    def media_type(self) -> str:
        """Media type of the content."""
        if self.content.startswith(b"\x89PNG"):
            return "image/png"
        return "image/webp" if self.content.startswith(b"RIFF") else "image/svg+xml"


class Shown:
    """An object that says in a line what it is, and that a notebook shows.

    A class says `_said`, and if it likes `_tables` and `_figures`. Dataclasses are declared with
    `repr=False`, because theirs would write out every array.
    """

    def _said(self) -> str:
        """Return what the object is, in a line or two with sizes and units; cheap to find."""
        raise NotImplementedError

    def _tables(self) -> Sequence[Table]:
        """Return the facts that a notebook shows below that line."""
        return ()

    def _figures(self) -> Sequence[Figure]:
        """Return the pictures that a notebook shows."""
        return ()

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self._said()}"

    def _repr_html_(self) -> str:
        """Return the line, the pictures and the tables as HTML."""
        name, said = escape(type(self).__name__), escape(self._said())
        figures = "".join(map(_figure, self._figures()))
        row = f'<div style="display: flex; flex-wrap: wrap; gap: 12px">{figures}</div>' if figures else ""
        return f"<div><p><b>{name}</b>: {said}</p>{row}{''.join(map(_table, self._tables()))}</div>"

    def _repr_png_(self) -> bytes | None:
        """Return the first picture; None where there is none."""
        found = next(iter(self._figures()), None)
        return found.content if found is not None and found.media_type == "image/png" else None


class Brief:
    """An object whose `repr` names its fields, and of arrays and of other objects the kind alone."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._named())})"

    def _named(self) -> Iterator[str]:
        for one in fields(self):  # type: ignore[arg-type]  # whoever has this mixin is a dataclass
            yield f"{one.name}={_kind(getattr(self, one.name))}"


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, tuple | list) and len(value) > 0:
        return f"{len(value)} of {type(value[0]).__name__}"
    plain = value is None or isinstance(value, bool | int | float | str)
    return repr(value) if plain else f"<{type(value).__name__}>"


def _figure(one: Figure) -> str:
    source = f"data:{one.media_type};base64,{b64encode(one.content).decode()}"
    caption = escape(one.caption)
    return (
        '<figure style="margin: 0; width: min-content; min-width: 140px">'
        f'<img src="{source}" alt="{caption}" style="border: {LINE}; max-width: none">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _table(table: Table) -> str:
    head = f"<tr>{''.join(_cell('th', name, place, table) for place, name in enumerate(table.head))}</tr>"
    rows = [
        f"<tr>{''.join(_cell('td', text, place, table) for place, text in enumerate(row))}</tr>"
        for row in table.rows[:MAX_TABLE_ROWS]
    ]
    if len(table.rows) > MAX_TABLE_ROWS:
        rows.append(f"<tr><td>and {len(table.rows) - MAX_TABLE_ROWS:,} more</td></tr>")
    heading = head if table.head else ""
    style = "border-collapse: collapse; margin: 8px 0"
    return f'<table style="{style}">{heading}{"".join(rows)}</table>'


def _cell(tag: str, text: str, place: int, table: Table) -> str:
    side = "right" if table.numbers and place > 0 else "left"
    style = f"text-align: {side}; padding: 2px 14px 2px 0; border-bottom: {LINE}"
    return f'<{tag} style="{style}">{escape(text)}</{tag}>'
