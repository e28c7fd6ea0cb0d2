"""Wrong renderers with the level that each must fail first and the cause to be named."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.reports.conformance import CaseRenderer, RunOptions, Verdict, agreed, judge_case
from xfrustum.scenes.conformance_suite import chosen

TRIED = {
    "L0": (
        *("L0-both-sides", "L0-order", "L0-half-over-half", "L0-farthest-wins", "L0-nearest-wins"),
        *("L0-reach", "L0-corners", "L0-placed", "L0-two-angles", "L0-film-tall"),
    ),
    "L1": ("L1-harbor-middle", "L1-harbor-se", "L1-attic"),
    "L3": ("L3-attic-0", "L3-attic-2", "L3-attic-4", "L3-screen-behind"),
    "L4": ("L4-harbor", "L4-smooth"),
}
"""Cases of the table by level: each mistake changes some of them."""


OF_LARGE_NUMBERS = ("green-red", "low-byte")
"""Renderers that are wrong only for numbers beyond 8 bits."""


@dataclass(frozen=True, kw_only=True)
class Wrong:
    """A wrong renderer, a toy of `tests.wrong_renderers`."""

    name: str
    level: str  #: lowest level that the renderer must fail
    causes: frozenset[str]  #: accepted names of faults, or beginnings of names


def wrong(level: str, table: str) -> list[Wrong]:
    """Return renderers from lines such as `near: near`."""
    lines = (line.split(":") for line in table.strip().splitlines())
    return [
        Wrong(name=name.strip(), level=level, causes=frozenset(causes.split()))
        for name, causes in lines
    ]


WRONG = [
    *wrong(
        "L0",
        """
        blue-red: channel-order
        green-red: channel-order
        plus-none: id-offset
        plus-two: id-offset
        white-background: background-id
        low-byte: 8-bit-overflow
        restarting: numbers-restarting
        gray: wrong-encoding
        objects-for-triangles: wrong-encoding
        jpeg: lossy resampled wrong-encoding
        mirrored: orientation
        upside-down: orientation
        transposed: orientation
        all-upside-down: orientation aperture-order
        rolled: shift unexplained
        nearest: front-nearest
        no-front: front-missing
        no-back: back-missing
        back-over-front: not-overlaid
        farthest: back-farthest
        half-angle: fov
        culled: nothing-shown culling
        corners: aperture-offset scene-offset
        edge-to-edge: pitch
        tenth: scene-scale pitch nothing-shown
        front-mirrored: front-mirrored
        back-mirrored: back-mirrored
        front-unturned: front-unturned
        back-unturned: back-unturned
        z-negated: z-negated orientation
        xy-exchanged: axes orientation
        z-up: axes nothing-shown
        """,
    ),
    *wrong(
        "L1",
        """
        half-pixel: shift
        near: near
        near-small: near
        fov: fov
        moved-x: scene-offset aperture-offset
        moved-z: scene-offset
        culled-back: culling
        equal-angles: equal-angles
        barrel: unexplained
        resampled-nearest: unexplained
        odd-rows: unexplained
        front-near-offset: front-near-offset
        back-fov: back-fov
        front-shift: front-shift
        """,
    ),
    *wrong(
        "L3",
        """
        not-recentered: not-recentered
        shear-sign: shear-sign
        screen-height: screen-height
        screen-center: screen-center
        """,
    ),
    *wrong(
        "L4",
        """
        lights: lights
        inverted-normals: inverted-normals
        srgb-for-linear: srgb-read-as-linear linear-read-as-srgb
        gamma-for-linear: gamma wrong-transfer
        flat-normals: flat-normals
        """,
    ),
]


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A wrong renderer, and the verdicts of cases up to its level."""

    renderer: Wrong
    verdicts: tuple[Verdict, ...]

    @property
    def failed(self) -> list[Verdict]:
        return [verdict for verdict in self.verdicts if verdict.verdict == "fail"]

    @property
    def level(self) -> str | None:
        """Lowest level that the renderer fails."""
        return min((verdict.level for verdict in self.failed), default=None)

    @property
    def named(self) -> list[str]:
        """Named causes of its failures."""
        return [verdict.cause for verdict in self.failed if verdict.faults]

    def matches(self, cause: str) -> bool:
        """Return whether a cause has an accepted name, or refines one."""
        return any(
            fault == name or fault.startswith(f"{name}-")
            for fault in cause.split(", ")
            for name in self.renderer.causes
        )


def tried(renderer: Wrong, names: Sequence[str] = ()) -> Tried:
    """Judge a wrong renderer in some cases, by default in its level and the levels below."""
    names = list(names) or [
        name for level, some in TRIED.items() if level <= renderer.level for name in some
    ]
    names += ["L0-numbers"] if renderer.name in OF_LARGE_NUMBERS else []
    cases = chosen(names=names)
    os.environ["XFRUSTUM_TOY"] = renderer.name
    toy, options = CaseRenderer(python="tests.conformance.renderers:toy"), RunOptions()
    verdicts = [judge_case(case, toy, options) for case in cases]
    return Tried(renderer=renderer, verdicts=agreed(verdicts))


def row(result: Tried) -> str:
    """Return a line of the table: renderer, lowest level that it fails, causes by count."""
    causes = Counter(verdict.cause for verdict in result.failed).most_common()
    named = ", ".join(f"{cause} ({count})" for cause, count in causes)
    return f"{result.renderer.name}: fails {result.level}: {named}"


def failures(results: Sequence[Tried]) -> dict[str, list[str]]:
    """Return the names of renderers by problem; the lists are empty if all is well."""

    def right(result: Tried) -> list[bool]:
        return [result.matches(cause) for cause in result.named or ["unexplained"]]

    problems = {
        "passed, or failed at another level": [r for r in results if r.level != r.renderer.level],
        "without the right cause": [r for r in results if not any(right(r))],
        "with a false cause": [r for r in results if not all(right(r))],
    }
    return {problem: [r.renderer.name for r in some] for problem, some in problems.items()}
