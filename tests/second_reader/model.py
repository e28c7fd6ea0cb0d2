"""Result of the second reader: polygons with a bound on their rounding, or a refusal."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

UNIT = 2.0**-53  #: relative rounding error of one operation in double precision


class Refused(Exception):
    """File without a right reading; the message is the reason."""


@dataclass
class Reading:
    """Polygons of a file in its own order."""

    polygons: list[Floats] = field(default_factory=list)  #: (n, 3) each, n >= 3, double precision
    #: Distance up to which two right readings of each polygon may differ per coordinate; 0 where
    #: the file states the coordinates themselves.
    rounding: list[float] = field(default_factory=list)
    texture: list[Floats | None] = field(default_factory=list)  #: (n, 2) each; v = 0 at the bottom
    #: False where the specification leaves open which way a triangle faces: joints that mirror.
    oriented: bool = True

    def add(self, polygon: Any, rounding: float = 0.0, texture: Any = None) -> None:
        """Append one polygon."""
        self.polygons.append(np.asarray(polygon, dtype=np.float64).reshape(-1, 3))
        self.rounding.append(rounding)
        self.texture.append(
            None if texture is None else np.asarray(texture, dtype=np.float64).reshape(-1, 2)
        )

    def checked(self) -> Reading:
        """Return the reading; refuse one without polygons or with numbers that are not finite."""
        if not self.polygons:
            raise Refused("no triangles")
        if not np.isfinite(np.concatenate(self.polygons)).all():
            raise Refused("coordinates that are not finite")
        return self
