"""Maps of the studies, as SVG that needs nothing else: near across, depth buffers down."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from xfrustum.reports.common.templates_environment import svg_picture
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One map: a title, and the colors of its squares by line."""

    title: str
    lines: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Map:
    """Panels in rows that share their lines' names and nears.

    The legend has colors with their meanings; the gutter is the width of the lines' names, pixels.
    """

    title: str
    panels: tuple[tuple[Panel, ...], ...]
    names: tuple[str, ...]
    nears: tuple[float, ...]
    legend: tuple[tuple[str, str], ...]
    across: str = "near plane / reach"
    gutter: int = 132


def svg(drawn: Map) -> str:
    """Return a map as an SVG document."""
    return svg_picture("study-map.svg.j2", {"power": _power}, {"map": drawn})


def buffer_name(buffer: tuple[DepthFormat, DepthMapping]) -> str:
    """Write format and mapping as people do, such as `D24 standard`."""
    return f"{buffer[0].upper()} {buffer[1]}"


def near_words(near: float) -> str:
    """Write a share of the reach in half decades in one digit, such as `3e-4` for 3.16e-4."""
    return re.sub(r"e-0", "e-", f"{near:.0e}")


def _power(near: float) -> str:
    """Return a whole power of ten as people write it, nothing for what lies between."""
    exponent = math.log10(near)
    if abs(exponent - round(exponent)) > 1e-6:
        return ""
    return f"10{str(round(exponent)).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
