"""Cases of the conformance suite as they are frozen: read, chosen by level and name, and opened."""

from __future__ import annotations

import difflib
import hashlib
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum

if TYPE_CHECKING:
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.plate import Aperture

SUITE = "1.0"  #: version of the suite
FOLDER = Path(__file__).parent / SUITE

LEVELS = {
    "L0": "conventions: orientation, numbering, layout, and which half looks where",
    "L1": "surfaces: every pixel that is not within rounding of an edge, on both sides of the plate",
    "L2": "the paper's two cameras, with a stated near offset and depth buffer",
    "L3": "shear and recentering",
    "L4": "light: Phong on both sides, reflection, texture, band limiting",
    "L5": "whole plates, sampled",
    "L6": "hard cases: slivers, coincident sheets, triangles through the aperture, huge and tiny lengths",
}
"""Levels and what they ask; each is passed by itself."""

CLOSE_NEAR = 1e-6
"""Near offset, as a part of the reach, of the two cameras that a case without a stated offset is handed.

With a reversed depth buffer of 32 bits they keep to the bounds of edges wherever no surface lies
closer to the plate than some ten times the offset: points at |z| move by W / 2 * n / |z| pixels at
most.
"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One frozen question, and what is accepted for an answer."""

    name: str
    level: str
    scene: str  #: scene file of the suite, without .toml, or a built-in scene
    hogels: tuple[tuple[int, int], ...]  #: column and row of each
    asked: str  #: `triangle-id`, `object-id`, `rgb` or `srgb`
    why: str
    resolution: tuple[int, int] | None = None  #: in place of the scene's own
    near: float | None = (
        None  #: offset of the paper's two cameras, scene units; None for the true frustum
    )
    depth: DepthFormat = DepthFormat.D32F
    mapping: DepthMapping = DepthMapping.REVERSED
    wrong: float = (
        0.0  #: largest share of the shown pixels that may be wrong without an accepted reason
    )
    tolerance: float | None = (
        None  #: difference of linear radiance that is accepted; None: `COLOR_TOLERANCE`
    )
    digest: str = ""  #: of the truth: triangles and ties of all hogels
    radiance: float | None = None  #: mean of the true colors

    def __post_init__(self) -> None:
        """Take the members of enumerations by their names too."""
        object.__setattr__(self, "depth", DepthFormat(self.depth))
        object.__setattr__(self, "mapping", DepthMapping(self.mapping))

    @property
    def colored(self) -> bool:
        """Whether colors are asked for, as cases about light do; all others ask for numbers."""
        return self.asked in ("rgb", "srgb")

    @property
    def accepted(self) -> str:
        """What is accepted, in words."""
        if self.colored:
            told = "colors within the tolerance, wherever no edge lies within rounding of the pixel's center"
        elif self.asked == "object-id":
            told = "the object, wherever no edge lies within rounding of the pixel's center"
        else:
            told = "the triangle, any of a tie, or a neighbor at an edge within rounding of the pixel's center"
            told += f"; of surfaces that {self.depth} {self.mapping} stores as one depth, either"
        return f"{told}; else at most {100 * self.wrong:g} % of the pixels" if self.wrong else told

    def open(self) -> Scene:
        """Return the scene of the case."""
        from xfrustum.scenes.opening import open_scene  # noqa: PLC0415 - loads NumPy

        file = FOLDER / "scenes" / f"{self.scene}.toml"
        scene = open_scene(file if file.exists() else self.scene)
        # Meshes are named by their paths: a suite has the same names wherever it is installed.
        objects = tuple(replace(one, name=Path(one.name).name) for one in scene.objects)
        resolution = self.resolution or scene.frustum.resolution
        return replace(
            scene, objects=objects, frustum=replace(scene.frustum, resolution=resolution)
        )

    def apertures(self, scene: Scene) -> list[Aperture]:
        """Return the apertures that are asked for."""
        return [scene.plate.aperture(*index) for index in self.hogels]

    def settings(self, scene: Scene) -> DoubleFrustum:
        """Return the two cameras that the case is handed: those that are stated, or such as come close."""
        near = CLOSE_NEAR * scene.frustum.longest_reach if self.near is None else self.near
        return DoubleFrustum(near=near, depth=self.depth, mapping=self.mapping)


@cache
def cases() -> tuple[Case, ...]:
    """Return all cases of the suite, in their order."""
    tables = tomllib.loads((FOLDER / "cases.toml").read_text(encoding="utf-8"))["case"]
    found = []
    for table in tables:
        lists = {name: tuple(value) for name, value in table.items() if isinstance(value, list)}
        lists["hogels"] = tuple((i, j) for i, j in table["hogels"])
        found.append(Case(**table | lists))
    return tuple(found)


def chosen(levels: Sequence[str] = (), names: Sequence[str] = ()) -> tuple[Case, ...]:
    """Return the cases of some levels and of some names, all without any; InputError for an unknown one."""
    known = {case.name: case for case in cases()}
    for kind, given, there in (("level", levels, LEVELS), ("case", names, known)):
        for name in given:
            if name not in there:
                nearest = difflib.get_close_matches(name, list(there), n=1, cutoff=0.0)[0]
                advice = "xfrustum conformance list shows all"
                raise InputError(
                    f"no {kind} of the suite is called {name!r}; the nearest is {nearest}, and {advice}"
                )
    by_level = [case for case in known.values() if not levels or case.level in levels]
    return tuple(case for case in by_level if not names or case.name in names)


def suite_digest() -> str:
    """Return the SHA-256 of the list of cases, which has the digest of each truth."""
    return hashlib.sha256((FOLDER / "cases.toml").read_bytes()).hexdigest()
