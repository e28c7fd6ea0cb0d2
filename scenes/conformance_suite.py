"""Cases of the frozen conformance suite: reading, selection by level and name, and scenes."""

from __future__ import annotations

import difflib
import hashlib
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.plate import DepthFormat, DepthMapping, DoubleFrustum

if TYPE_CHECKING:
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate import Aperture

#: version of the suite
SUITE = "1.0"
FOLDER = Path(__file__).parent / "conformance" / SUITE

#: levels and their subjects; each level is passed independently
LEVELS = {
    "L0": "conventions: orientation, numbering, layout, and which half looks where",
    "L1": "surfaces: every pixel that is not within rounding of an edge, on both sides of the "
    "plate",
    "L2": "the paper's two cameras, with a stated near offset and depth buffer",
    "L3": "shear and recentering",
    "L4": "light: Phong on both sides, reflection, texture, band limiting",
    "L5": "whole plates, sampled",
    "L6": "hard cases: slivers, coincident sheets, triangles through the aperture, huge and tiny "
    "lengths",
}

CLOSE_NEAR = 1e-6
"""Near offset, as a fraction of the reach, of the two cameras in cases with a true frustum.

Points at |z| move by at most W / 2 * n / |z| pixels. With a reversed 32-bit depth buffer, this
displacement is within the tolerance of edges if no surface is closer to the plate than about ten
offsets."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Frozen test case: the image that a renderer must make, and the accepted results."""

    name: str
    level: str
    #: scene file of the suite without .toml, or a built-in scene
    scene: str
    #: column and row of each hogel
    hogels: tuple[tuple[int, int], ...]
    #: content of pixels: `triangle-id`, `object-id`, `rgb` or `srgb`
    encoding: str
    #: purpose of the case, one sentence
    why: str
    #: W, H, pixels; None for the scene's resolution
    resolution: tuple[int, int] | None = None
    #: offset of the paper's cameras, scene units; None for the true frustum
    near: float | None = None
    depth: DepthFormat = DepthFormat.D32F
    mapping: DepthMapping = DepthMapping.REVERSED
    #: largest share of covered pixels that may be wrong without an accepted reason, 0 to 1. Only
    #: wrong conventions should fail L0: mistakes tested by later levels make at most 26 % of the
    #: pixels of a case wrong, and every wrong convention makes at least 56 % of the pixels of some
    #: case wrong. L0 therefore has 0.3. L4 has 0.005, because slivers narrower than a pixel, and
    #: surfaces beyond the film's border, are not identified by colors.
    wrong: float = 0.0
    #: tolerance of linear radiance; None: `COLOR_TOLERANCE`
    tolerance: float | None = None
    #: SHA-256 of triangles and ties of the truth in all hogels
    digest: str = ""
    #: mean of the true colors
    radiance: float | None = None

    @classmethod
    def from_table(cls, table: dict[str, Any]) -> Case:
        """Return the case that a table of cases.toml describes."""
        encoding = {"encoding": table["asked"]}
        rest = {name: value for name, value in table.items() if name != "asked"}
        return TypeAdapter(cls).validate_python(rest | encoding)

    @property
    def colored(self) -> bool:
        """True if pixels contain colors and not numbers, as in cases of light."""
        return self.encoding in ("rgb", "srgb")

    def open(self) -> Scene:
        """Return the scene of the case."""
        from xfrustum.scenes.library.builtin import open_scene  # noqa: PLC0415 - loads NumPy

        file = FOLDER / "scenes" / f"{self.scene}.toml"
        scene = open_scene(file if file.exists() else self.scene)
        # Objects are named after the paths of their meshes, and these paths depend on the
        # installation.
        objects = tuple(replace(part, name=Path(part.name).name) for part in scene.objects)
        resolution = self.resolution or scene.frustum.resolution
        frustum = replace(scene.frustum, resolution=resolution)
        return replace(scene, objects=objects, frustum=frustum)

    def apertures(self, scene: Scene) -> list[Aperture]:
        """Return the apertures of the case's hogels."""
        return [scene.plate.aperture(*index) for index in self.hogels]

    def settings(self, scene: Scene) -> DoubleFrustum:
        """Return the settings of the two cameras: from the case, or with a tiny near offset."""
        near = CLOSE_NEAR * scene.frustum.longest_reach if self.near is None else self.near
        return DoubleFrustum(near=near, depth=self.depth, mapping=self.mapping)


@cache
def cases() -> tuple[Case, ...]:
    """Return all cases of the suite, in their order."""
    tables = tomllib.loads((FOLDER / "cases.toml").read_text(encoding="utf-8"))["case"]
    return tuple(map(Case.from_table, tables))


def chosen(levels: Sequence[str] = (), names: Sequence[str] = ()) -> tuple[Case, ...]:
    """Return the cases of levels and names, all by default; InputError for an unknown name."""
    by_name = {case.name: case for case in cases()}
    for kind, some, known in (("level", levels, list(LEVELS)), ("case", names, list(by_name))):
        for name in some:
            if name not in known:
                (nearest,) = difflib.get_close_matches(name, known, n=1, cutoff=0.0)
                raise InputError(
                    f"no {kind} of the suite is called {name!r}; the nearest is {nearest}, and "
                    "xfrustum conformance list shows all"
                )
    return tuple(
        case
        for case in by_name.values()
        if (not levels or case.level in levels) and (not names or case.name in names)
    )


def suite_digest() -> str:
    """Return the SHA-256 of the list of cases; the list contains the digest of each truth."""
    return hashlib.sha256((FOLDER / "cases.toml").read_bytes()).hexdigest()
