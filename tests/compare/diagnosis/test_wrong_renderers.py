"""`verify` passes no renderer with a common mistake, and names no false cause.

The renderers of `tests/wrong_renderers` share only CONVENTIONS.md with this project. Wrong pixels
are counted by brute force, without results of `verify`. `-s` prints the table.
"""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

import xfrustum
from tests.wrong_renderers.new_toys import PAIRS, TOYS
from tests.wrong_renderers.outcomes import (
    BEYOND_DOUBT,
    MUST_EXPLAIN,
    Case,
    Studio,
    cases,
    matches,
    table,
    world_of,
)
from tests.wrong_renderers.ray_caster import draw
from tests.wrong_renderers.toys import ENCODINGS, SRGB, TWINS
from xfrustum.cli.main import main

Verify = Callable[..., tuple[int, str]]

MAX_DISPLACEMENT_PX = 0.5  # default limit of `verify`

DISPLACED = {name for name in TOYS if name.startswith("moved")}
DISPLACED |= {"rolled", "corners", "near", "fov", "half-angle", "square-film"}
"""Renderers that show surfaces in wrong places, most of them by more than a pixel."""

QUICK = (
    *("attic-right-triangle-id", "attic-right-object-id", "attic-blue-red-object-id"),
    *("attic-right-rgb", "harbor-right-triangle-id"),
)
"""Cases that run every time: plain pictures take seconds to register, triangle numbers less."""

NOT_YET_NAMED = {"front-flipped", "transposed", "gamma-for-srgb", "late"} | {
    "+".join(pair) for pair in PAIRS if "flat-normals" not in pair
}
"""Renderers that must neither pass nor get a false cause, but need not be named yet."""

ALL = [
    pytest.param(case, id=str(case), marks=() if str(case) in QUICK else (pytest.mark.slow,))
    for case in cases()
]


@pytest.fixture(scope="session")
def studio(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[Studio]:
    """Draw and verify each case once; with pytest's option `-s`, print the table at the end."""
    studio = Studio(folder=tmp_path_factory.mktemp("wrong_renderers"))
    yield studio
    if request.config.getoption("capture") == "no":
        sys.stdout.write("\n" + table(studio.done.values()) + "\n")


@pytest.mark.parametrize("case", ALL)
def test_no_false_pass_and_no_false_reason(studio: Studio, case: Case) -> None:
    outcome = studio.outcome(case)
    if outcome.truth.different == 0:
        assert TOYS[case.toy].group == "classic" or not TOYS[case.toy].expected, (
            "a wrong renderer is right"
        )
        assert outcome.verdict == "pass"
        assert not outcome.findings, "nothing is wrong, and a reason is given"
        return
    if outcome.truth.wrong > BEYOND_DOUBT:
        assert outcome.verdict == "fail", f"{outcome.truth.wrong:.1%} are wrong"
        # `verify` counts at least half of the wrong pixels that brute force counts.
        assert case.toy == "winding" or outcome.wrong >= outcome.truth.pixels / 2
    for finding in outcome.findings:
        assert finding.explains is not None, f"{finding.name} does not say what it explains"
        assert finding.explains >= MUST_EXPLAIN, f"{finding.name} is printed as a reason"
    # Lost triangle numbers are restored from the truth if one kind of damage explains the images.
    if outcome.findings and outcome.whole:
        left = outcome.residual
        assert left <= (1 - MUST_EXPLAIN) * outcome.wrong, (
            f"{sorted(outcome.names)} leave {left} wrong"
        )
    assert not outcome.false_explanation, f"{outcome.left:.1%} of a corrected hogel are wrong"
    if case.toy in DISPLACED and case.encoding == "triangle-id":
        assert outcome.displacement is None or outcome.displacement > MAX_DISPLACEMENT_PX
    assert not outcome.false_causes
    if case.encoding == "triangle-id":
        assert not outcome.wrong_sizes, [finding.words for finding in outcome.findings]
    expected, names = TOYS[case.toy].names(case.encoding), sorted(outcome.names)
    seldom = case.encoding != "triangle-id"
    # A true cause that corrects too few pixels is listed as a guess, for example if
    # triangle numbers are mixed up.
    guessed = all(
        matches(outcome.rejected, cause) for cause in TOYS[case.toy].causes(case.encoding)
    )
    admitted = outcome.admits and (seldom or guessed or "does-not-explain" in expected)
    assert case.toy in NOT_YET_NAMED or outcome.all_named or admitted, f"said: {names}"
    if (case.scene, case.toy) in TWINS:
        # Two causes make the same pictures: a wrong cause must not be named alone. For
        # pictures of triangle numbers, one or both are named.
        assert outcome.findings or case.encoding != "triangle-id"
        assert not outcome.findings or any(finding.ambiguous for finding in outcome.findings), names
        both = all(outcome.named([name]) for name in TWINS[case.scene, case.toy])
        words = any(finding.alternatives for finding in outcome.findings)
        assert both or not words or case.encoding != "triangle-id", names


def test_renderers_cover_all_encodings_and_exceptions_exist() -> None:
    assert {name for name, toy in TOYS.items() if toy.group != "classic"} >= NOT_YET_NAMED
    encodings = {encoding for toy in TOYS.values() for encoding in toy.encodings}
    assert encodings == {*ENCODINGS, SRGB}


# The command line gives the same result.


@pytest.fixture
def verify(studio: Studio, capsys: pytest.CaptureFixture[str]) -> Verify:
    """Run `verify` on a case; return its exit status and its output."""

    def run(case: Case, *options: str) -> tuple[int, str]:
        pattern, _ = studio.pictures(case)
        arguments = [str(studio.scene_file(case.scene)), pattern, "--encoding", case.encoding]
        return main(["verify", *arguments, "--quiet", *options]), capsys.readouterr().out

    return run


def test_text_and_json_have_the_same_names(verify: Verify) -> None:
    case = Case(scene="attic", toy="blue-red", encoding="triangle-id")
    (status, written), (_, text) = verify(case, "--json"), verify(case)
    shown = json.loads(written)["diagnosis"]
    assert status == 1 and shown
    assert all(entry["words"].split(",")[0] in text for entry in shown)


OF_OUTLINES = ("relit", "gamma", "rolled", "mirrored", "moved-y", "near", "no-front", "white")


@pytest.mark.parametrize(
    "toy", ["right", *(pytest.param(toy, marks=pytest.mark.slow) for toy in OF_OUTLINES)]
)
def test_outlines_are_judged_apart_from_shading(verify: Verify, toy: str) -> None:
    """Judge plain pictures with another shading by their outlines, where this is selected."""
    case = Case(scene="attic", toy=toy, encoding="rgb")
    status, text = verify(case, "--compare", "geometry")
    assert status == (toy not in ("relit", "gamma", "right")), text


@pytest.mark.slow
def test_unlit_surfaces_without_ambient_light_look_like_the_background(verify: Verify) -> None:
    """An unlit half is as black as a missing one: the verdict stays, and the text gives advice."""
    case = Case(scene="attic", toy="headlight", encoding="rgb")
    status, text = verify(case, "--compare", "geometry")
    assert status == 1
    assert "1,348 of the wrong pixels are black where the truth shows a surface" in text
    assert "ambient light" in text


@pytest.mark.parametrize(
    ("add", "nothing"),
    [
        (1, 0),
        # In order: numbers from 0; "no surface" as -1; numbers + 2; numbers out of range;
        # "no surface" out of range.
        *(
            pytest.param(*numbers, marks=pytest.mark.slow)
            for numbers in ((0, 0), (0, 2**32 - 1), (2, 0), (100_000, 0), (1, 2**32 - 1))
        ),
    ],
)
def test_numbers_in_openexr_files(studio: Studio, tmp_path: Path, add: int, nothing: int) -> None:
    """OpenEXR files must store the triangle's number + 1, and 0 where there is no surface."""
    world = world_of("attic")
    for i, j in world.apertures:
        triangle = draw(world, i, j).triangle
        channel = np.where(triangle < 0, nothing, triangle + add).astype(np.uint32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"id.triangle": channel}).write(str(tmp_path / f"{i}-{j}.exr"))
    result = xfrustum.verify(str(studio.scene_file("attic")), str(tmp_path / "{i}-{j}.exr"))
    assert result.passed is ((add, nothing) == (1, 0))


# Hogels of a public double-frustum renderer with unknown conventions


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "offset"),
    [("BT-0.001", None), *((f"DF-{near}", near) for near in (0.1, 0.01, 0.001))],
)
def test_conventions_and_offset_of_another_renderer_are_found(
    name: str, offset: float | None, shared_data: Path
) -> None:
    folder = shared_data / "data" / "foreign"
    pattern = str(folder / name / "Hogel_{i}x{j}.png")
    result = xfrustum.verify(str(folder / "scene.toml"), pattern, encoding="triangle-id")
    named = {fault.fault: fault for fault in result.diagnosis.faults}
    near = named.pop("near", None)
    assert set(named) == {"orientation", "aperture-order", "shift-x", "shift-y"}
    assert named["orientation"].value == "turned by 180 degrees"
    for axis in "xy":
        assert abs(float(named[f"shift-{axis}"].value)) == pytest.approx(0.5, abs=0.01)
    assert (near is None) == (offset is None)
    if near is not None and offset is not None:
        assert near.value == pytest.approx(offset, rel=0.02)
        assert near.low is not None and near.high is not None
        assert near.low <= offset <= near.high
    summary = result.summary()
    corrected, causes = summary["corrected"], summary["corrected"]["causes"]
    assert summary["as_found"]["fraction"] > 0.9 and corrected["fraction"] < 0.01
    assert sum(causes.values()) == corrected["wrong"] and causes["unexplained"] == 0
    assert not result.passed and len(result.hogels) == 25
