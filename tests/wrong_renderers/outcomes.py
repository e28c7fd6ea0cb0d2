"""Outcomes of `xfrustum verify` for the renderers of this package, and their table."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from PIL import Image

import xfrustum
from tests.wrong_renderers import worlds
from tests.wrong_renderers.differences import Difference, difference
from tests.wrong_renderers.new_toys import TOYS
from tests.wrong_renderers.ray_caster import Picture
from tests.wrong_renderers.toys import Toy
from tests.wrong_renderers.worlds import World

LIMIT = 0.01  # default limit of `verify` for wrong pixels in each hogel

BEYOND_DOUBT = 1.5 * LIMIT
"""A renderer with a larger wrong share in its worst hogel must not pass; below it, both verdicts
are accepted. Brute force counts only displacements of at least a pixel, and colors that differ by
at least a tenth of white.
"""

MUST_EXPLAIN = 0.9
"""Share of the wrong pixels that a printed reason must explain."""

Sizes = dict[str, float | str]

OF_SCREENS: Sizes = {
    "screen-height": 50.0,
    "screen-center-x": 6.0,
    "screen-center-y": -4.5,
    "not-recentered": "no shear",
    "shear-sign": "C*",
}
SIZES: dict[str, Sizes] = {
    "half-pixel": {"shift-x": -0.5, "shift-y": -0.5},
    "near": {"near": 2.0},
    "near-small": {"near": 0.3},
    "fov": {"fov-x": 1.05, "fov-y": 1.05},
    "moved-x": {"scene-offset-x": 0.8},
    "moved-y": {"scene-offset-y": -1.5},
    "moved-z": {"scene-offset-z": 2.0},
    "moved-all": {"scene-offset-x": 1.0, "scene-offset-y": 0.7, "scene-offset-z": -1.5},
    "tenth": {"scene-scale": 0.1},
    "front-near-offset": {"front-near-offset": 1.0},
    "back-near-offset": {"back-near-offset": 1.0},
    **dict.fromkeys(("screen-height", "screen-center", "not-recentered", "shear-sign"), OF_SCREENS),
    "screen-height-near": {**OF_SCREENS, "near": 2.0},
    "screen-center-near": {**OF_SCREENS, "near": 2.0},
    "z-negated": {"z-negated": "x, y, -z"},
    "yz-exchanged": {"axes-exchanged": "x, z, y"},
    "equal-angles": {"equal-angles": "x and y"},
    "equal-angles-y": {"equal-angles": "y"},
    "fisheye": {"equal-angles": "radius"},
    "stale": {"stale-hogel": "hogel 1,1 shows 0,1's image"},
    "exchanged": {"hogels-exchanged": "hogel 1,0 shows 2,0's image; hogel 2,0 shows 1,0's image"},
}
"""Sizes of mistakes, or words about them, by renderer and fault, if equal in all scenes."""


def sizes_of(toy: str, world: World) -> Sizes:
    """Return the sizes of a renderer's defects that `verify` must give for triangle numbers."""
    if toy != "corners":
        return SIZES.get(toy, {})
    (width, height), (columns, rows) = world.size, world.hogels
    return {"aperture-offset-x": -width / columns / 2, "aperture-offset-y": height / rows / 2}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, a renderer and an encoding."""

    scene: str
    toy: str
    encoding: str

    def __str__(self) -> str:
        return f"{self.scene}-{self.toy}-{self.encoding}"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A printed reason."""

    name: str
    explains: float | None  # share of explained wrong pixels; None if not printed
    alternatives: tuple[str, ...]
    value: float | str
    interval: tuple[float | None, float | None]
    words: str

    def tells(self, size: float | str) -> bool:
        """True if the finding states this size: within 2 % and in its interval, or as a word."""
        if isinstance(size, str):
            return size == self.value or size in self.words
        low, high = (size if end is None else end for end in self.interval)
        inside = low - 1e-3 * abs(size) <= size <= high + 1e-3 * abs(size)
        return inside and abs(float(self.value) - size) <= 0.02 * abs(size)

    @property
    def ambiguous(self) -> bool:
        return bool(self.alternatives)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of `verify` for a case, and the counts by brute force."""

    case: Case
    truth: Difference
    verdict: str
    findings: tuple[Finding, ...]
    rejected: tuple[str, ...]  # names of defects that, by `verify`, do not explain the images
    admits: bool  # whether, by `verify`, no known defect explains the images
    wrong: int  # number of wrong pixels in the images as found, by `verify`
    residual: int  # number of wrong pixels after correction, except pixels that rounding explains
    displacement: float | None  # hogels' largest 99th percentile of displacement by `verify`, px
    left: (
        float  # share of wrong pixels in the worst hogel after correction, except those by rounding
    )

    @property
    def names(self) -> frozenset[str]:
        """Names of all faults in the findings, with alternatives."""
        return frozenset(
            name for finding in self.findings for name in (finding.name, *finding.alternatives)
        )

    @property
    def explained(self) -> float | None:
        """Share of the wrong pixels that correction removes; None if no pixel is wrong."""
        return 1 - self.residual / self.wrong if self.wrong else None

    def named(self, names: Iterable[str]) -> bool:
        """True if findings have one of the names, or a refined one: `pitch-x` refines `pitch`."""
        return matches(self.names, names)

    @property
    def all_named(self) -> bool:
        """True if each mistake is named."""
        return all(self.named(cause) for cause in TOYS[self.case.toy].causes(self.case.encoding))

    @property
    def wrong_sizes(self) -> tuple[str, ...]:
        """Names of findings whose size is not the size of the renderer's mistake."""
        sizes = sizes_of(self.case.toy, world_of(self.case.scene))
        return tuple(
            finding.name
            for finding in self.findings
            if finding.name in sizes and not finding.tells(sizes[finding.name])
        )

    @property
    def false_pass(self) -> bool:
        return self.verdict == "pass" and self.truth.wrong > BEYOND_DOUBT

    @property
    def false_explanation(self) -> bool:
        """True if a cause is named although the corrected images exceed the limit."""
        return bool(self.findings) and self.left > LIMIT

    @property
    def whole(self) -> bool:
        """True if correction must remove all errors: an unnamed cause leaves wrong pixels."""
        return TOYS[self.case.toy].group == "classic" or self.all_named

    @property
    def false_causes(self) -> tuple[str, ...]:
        """Names of findings that explain too little or, if all true causes are known, are false."""
        true = TOYS[self.case.toy].names(self.case.encoding)
        mends = not self.whole or self.residual <= (1 - MUST_EXPLAIN) * self.wrong
        known = TOYS[self.case.toy].group != "classic"
        return tuple(
            finding.name
            for finding in self.findings
            if not mends
            or (finding.explains or 0) < MUST_EXPLAIN
            or (known and not matches((finding.name, *finding.alternatives), true))
        )


def matches(shown: Iterable[str], names: Iterable[str]) -> bool:
    """Return whether one of the names, or a refined name, is present."""
    names = tuple(names)
    return any(entry == name or entry.startswith(f"{name}-") for entry in shown for name in names)


SCENES = {
    "harbor": worlds.harbor,
    "attic": worlds.attic,
    "crowd": worlds.crowd,
    "cove": worlds.cove,
}


@cache
def world_of(scene: str) -> World:
    """Return a scene, which is made only once."""
    return SCENES[scene]()


@dataclass(frozen=True, kw_only=True, eq=False)
class Studio:
    """Folder in which each case is drawn, written and verified once."""

    folder: Path
    done: dict[Case, Outcome] = field(default_factory=dict)

    def scene_file(self, scene: str) -> Path:
        path = self.folder / scene / "scene.toml"
        return path if path.exists() else world_of(scene).write(path.parent)

    def pictures(self, case: Case) -> tuple[str, dict[tuple[int, int], Picture]]:
        """Write a renderer's pictures; return the pattern of their paths, and the pictures."""
        world = world_of(case.scene)
        folder = self.folder / str(case)
        folder.mkdir(exist_ok=True)
        made = {(i, j): TOYS[case.toy].draw(world, i, j, case.encoding) for i, j in world.apertures}
        for (i, j), picture in made.items():
            Image.fromarray(picture).save(folder / f"{i}-{j}.png")
        return str(folder / "{i}-{j}.png"), made

    def outcome(self, case: Case) -> Outcome:
        if case not in self.done:
            pattern, made = self.pictures(case)
            truth = difference(world_of(case.scene), made, case.encoding)
            result = xfrustum.verify(
                str(self.scene_file(case.scene)), pattern, encoding=case.encoding
            )
            self.done[case] = read(case, truth, result.summary())
        return self.done[case]


def read(case: Case, truth: Difference, shown: Mapping[str, Any]) -> Outcome:
    """Return the outcome from the JSON object of `verify`."""
    findings = tuple(
        Finding(
            name=entry["fault"],
            explains=entry["explains"],
            alternatives=tuple(entry["alternatives"]),
            value=entry["value"],
            interval=(entry["low"], entry["high"]),
            words=entry["words"],
        )
        for entry in shown["diagnosis"]
    )
    causes = shown["corrected"]["causes"]
    displacement = shown["as_found"]["displacement_px"]
    return Outcome(
        case=case,
        truth=truth,
        verdict=shown["verdict"],
        findings=findings,
        rejected=tuple(entry["fault"] for entry in shown["does_not_explain"]),
        admits=shown["explained"] is False,
        wrong=shown["as_found"]["wrong"],
        residual=causes["unexplained"] if causes else shown["corrected"]["wrong"],
        displacement=displacement["worst_p99"] if displacement else None,
        left=max(
            (_left(hogel["corrected"]) for hogel in shown["hogels"] if hogel["corrected"]),
            default=0.0,
        ),
    )


def _left(numbers: Mapping[str, Any]) -> float:
    """Return the share of wrong pixels that rounding leaves unexplained in a corrected hogel."""
    surface, radiance, causes = numbers["surface"], numbers["radiance"], numbers["causes"]
    wrong = numbers["wrong"] if surface is None else surface["wrong"]
    # A wrong surface also counts as a wrong triangle: rounding explains at most all wrong
    # triangles.
    rounded = 0 if causes is None else numbers["wrong"] - causes["unexplained"]
    wrong = max(0, wrong - rounded) + (radiance["wrong"] if radiance else 0)
    return wrong / numbers["shown"] if wrong > 1 else 0.0


def cases(
    scenes: Sequence[str] = tuple(SCENES), toys: Sequence[Toy] = tuple(TOYS.values())
) -> list[Case]:
    """Return all cases: a renderer for one scene with this scene, all others with two scenes."""
    return [
        Case(scene=scene, toy=toy.name, encoding=encoding)
        for scene in scenes
        for toy in toys
        for encoding in toy.encodings
        if scene == toy.scene or (not toy.scene and scene in ("harbor", "attic"))
    ]


HEADER = (
    "| scene | renderer | encoding | truly wrong | verdict | found (share explained) | taken away "
    "| alternatives | said not to explain | truth |\n|" + 10 * " --- |"
)


def row(outcome: Outcome) -> str:
    """Return a row of the table.

    `truly wrong` is the count by brute force in the worst hogel; `taken away` is the share of wrong
    pixels that correction removes.
    """
    case = outcome.case
    result = ", ".join(
        f.name + (f" ({100 * f.explains:.0f} %)" if f.explains is not None else "")
        for f in outcome.findings
    )
    alternatives = ", ".join(name for f in outcome.findings for name in f.alternatives)
    taken = (
        ""
        if outcome.explained is None or not outcome.findings
        else f"{100 * outcome.explained:.0f} %"
    )
    truth = " and ".join(
        " or ".join(sorted(names)) for names in TOYS[case.toy].causes(case.encoding)
    )
    cells = (
        case.scene,
        f"{case.toy}: {TOYS[case.toy].words}",
        case.encoding,
        f"{100 * outcome.truth.wrong:.1f} %",
        outcome.verdict,
        result or "-",
        taken,
        alternatives,
        ", ".join(outcome.rejected) or ("yes" if outcome.admits else ""),
        truth,
    )
    return f"| {' | '.join(cells)} |"


def table(outcomes: Iterable[Outcome]) -> str:
    """Return the table in Markdown."""
    return "\n".join([HEADER, *map(row, outcomes)])


def tally(outcomes: Sequence[Outcome]) -> str:
    """Return the numbers of named causes, false passes and false causes as text."""
    known = [o for o in outcomes if o.truth.different and TOYS[o.case.toy].causes(o.case.encoding)]
    silent = [str(o.case) for o in known if not o.all_named]
    passes = [str(o.case) for o in outcomes if o.false_pass]
    causes = [f"{o.case} ({', '.join(o.false_causes)})" for o in outcomes if o.false_causes]
    wrong = [f"{o.case} ({o.left:.1%})" for o in outcomes if o.false_explanation]
    return (
        f"named: {len(known) - len(silent)} of {len(known)}; not: {', '.join(silent) or '-'}\n"
        f"false passes: {len(passes)}; {', '.join(passes) or '-'}\n"
        f"false causes: {len(causes)}; {', '.join(causes) or '-'}\n"
        f"explained, and wrong when corrected: {len(wrong)}; {', '.join(wrong) or '-'}"
    )
