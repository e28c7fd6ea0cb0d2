"""Wrong renderers, the level that each must fail first, and the cause that must be named for it."""

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from xfrustum.reports.conformance.run import CaseRenderer, RunOptions, Verdict, agreed, judge_case
from xfrustum.scenes.conformance.suite import chosen

TRIED = {
    "L0": (
        *("L0-both-sides", "L0-order", "L0-half-over-half", "L0-farthest-wins", "L0-nearest-wins"),
        *("L0-reach", "L0-corners", "L0-placed", "L0-two-angles", "L0-film-tall"),
    ),
    "L1": ("L1-harbor-middle", "L1-harbor-se", "L1-attic"),
    "L3": ("L3-attic-0", "L3-attic-2", "L3-attic-4", "L3-screen-behind"),
    "L4": ("L4-harbor", "L4-smooth"),
}
"""Cases that wrong renderers are taken through, by level: every mistake shows in some of them."""


OF_LARGE_NUMBERS = ("green-red", "low-byte")
"""Wrong renderers that are right as long as numbers have 8 bits."""


@dataclass(frozen=True, kw_only=True)
class Wrong:
    """A wrong renderer, a toy of `tests.wrong_renderers`."""

    name: str
    level: str  # Lowest level that it must fail
    causes: frozenset[str]  # Names of faults, or beginnings of names, of which one must be said


def wrong(level: str, told: str) -> list[Wrong]:
    """Return renderers from lines such as `near: near`."""
    lines = (line.split(":") for line in told.strip().splitlines())
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
        rolled: wrapped shift
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
        barrel: distortion
        resampled-nearest: resampled
        odd-rows: rows-shifted
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
    """A wrong renderer, and the verdicts of the cases up to its level."""

    renderer: Wrong
    verdicts: tuple[Verdict, ...]

    @property
    def failed(self) -> list[Verdict]:
        return [one for one in self.verdicts if one.verdict == "fail"]

    @property
    def level(self) -> str | None:
        """The lowest level that it fails."""
        return min((one.level for one in self.failed), default=None)

    @property
    def named(self) -> list[str]:
        """What was named for its failures, without what was not explained."""
        return [one.cause for one in self.failed if one.faults]

    @property
    def right_level(self) -> bool:
        return self.level == self.renderer.level

    @property
    def right_cause(self) -> bool:
        told = self.named or ["unexplained"]
        return any(self.matches(cause) for cause in told)

    @property
    def false_reasons(self) -> list[str]:
        return [cause for cause in self.named if not self.matches(cause)]

    def matches(self, cause: str) -> bool:
        """Whether one of the right names was said, or one that refines it."""
        said = cause.split(", ")
        return any(
            one == name or one.startswith(f"{name}-")
            for one in said
            for name in self.renderer.causes
        )


def tried(one: Wrong, names: Sequence[str] = ()) -> Tried:
    """Take a wrong renderer through some cases, or those of its level and of the levels before it."""
    names = list(names) or [
        name for level, some in TRIED.items() if level <= one.level for name in some
    ]
    names += ["L0-numbers"] if one.name in OF_LARGE_NUMBERS else []
    cases = chosen(names=names)
    os.environ["XFRUSTUM_TOY"] = one.name
    toy, options = CaseRenderer(python="tests.conformance.renderers:toy"), RunOptions()
    return Tried(renderer=one, verdicts=agreed([judge_case(case, toy, options) for case in cases]))


HEADER = (
    "| renderer | must fail | fails first | causes named | right level | right cause | false reasons |\n|"
    + (7 * " --- |")
)


def row(one: Tried) -> str:
    """Return a line of the table."""
    causes = Counter(verdict.cause for verdict in one.failed)
    told = ", ".join(f"{cause} ({count})" for cause, count in causes.most_common())
    cells = (
        one.renderer.name,
        one.renderer.level,
        one.level or "-",
        told or "-",
        "yes" if one.right_level else "NO",
        "yes" if one.right_cause else "NO",
        "; ".join(one.false_reasons) or "-",
    )
    return f"| {' | '.join(cells)} |"


def tally(done: Sequence[Tried]) -> str:
    """Return the sums of the table."""

    def names(some: Iterable[Tried]) -> str:
        return ", ".join(one.renderer.name for one in some) or "-"

    return (
        f"renderers: {len(done)}; false passes: {names(one for one in done if one.level is None)}\n"
        f"at another level: {names(one for one in done if not one.right_level)}\n"
        f"without the right cause: {names(one for one in done if not one.right_cause)}\n"
        f"with a false reason: {names(one for one in done if one.false_reasons)}"
    )
