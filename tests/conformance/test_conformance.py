"""Conformance suite: frozen truths, right and wrong renderers, statements and archives."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.conformance.table import WRONG, failures, tried
from tests.support.commands import Command
from tests.support.scene_file import film
from xfrustum import HogelImage, InputError, Reference, Scene, open_scene
from xfrustum.cli.main import main
from xfrustum.compare.judging.conformance import Pixels, is_frozen, judged, trace
from xfrustum.compare.judging.judged import wrong_pixels
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.reports.conformance import (
    FILES,
    CaseOutcome,
    CaseRenderer,
    RunOptions,
    Statement,
    Verdict,
    agreed,
    judge_case,
    run,
    write_hogel,
    write_statement,
)
from xfrustum.reports.conformance_cases import Archive, export, traced, write_case
from xfrustum.scenes.appearance import Appearance, Material
from xfrustum.scenes.conformance_suite import LEVELS, SUITE, Case, cases, chosen
from xfrustum.scenes.files.pictures import Encoding, StoredPixels, of_stored
from xfrustum.scenes.model.device_model import LLVMPIPE

FEW = ("L0-both-sides", "L0-order", "L0-placed")
SOME = ("L0-both-sides", "L1-torus-before", "L2-harbor-d16-standard", "L4-lit-from-viewer-before")


@pytest.fixture(scope="module")
def right() -> CaseRenderer:
    return CaseRenderer(python="tests.conformance.renderers:draw")


def case_named(name: str) -> Case:
    return chosen(names=(name,))[0]


def traced_anew(case: Case, scene: Scene) -> list[HogelImage]:
    """Return truths of a case that was never frozen."""
    return [trace(case, Reference(scene), aperture) for aperture in case.apertures(scene)]


def truth_of(name: str) -> tuple[Case, Any, HogelImage]:
    case = case_named(name)
    scene = case.open()
    return case, scene, trace(case, Reference(scene), case.apertures(scene)[0])


def put_images(case: Case, folder: Path, truths: list[HogelImage]) -> None:
    """Write triangle numbers of the first hogels of a case."""
    (folder / case.name).mkdir(parents=True)
    for truth in truths:
        index = truth.camera.aperture.index
        write_hogel(case, folder / case.name, index, truth.triangle + 1)


def judged_images(folder: Path, *names: str) -> list[tuple[str, str | None]]:
    verdicts = run(chosen(names=names), CaseRenderer(images=str(folder)))
    by_name = {verdict.name: (verdict.verdict, verdict.cause) for verdict in verdicts}
    return [by_name[name] for name in names]


def test_the_suite_has_cases_of_unique_names_in_all_levels() -> None:
    assert {case.level for case in cases()} == set(LEVELS)
    assert len({case.name for case in cases()}) == len(cases())
    assert all(case.why and case.digest and case.hogels for case in cases())
    with pytest.raises(InputError, match="L0-behind"):
        chosen(names=("L0-behnd",))


@pytest.mark.parametrize(
    "name", ["L0-behind", "L1-harbor-middle", "L3-attic-2", "L6-coincident-copies"]
)
def test_a_truth_is_the_frozen_one(name: str) -> None:
    case = case_named(name)
    scene = case.open()
    assert is_frozen(case, traced(case, scene))
    if name == "L0-behind":
        with pytest.raises(RuntimeError, match="digest"):
            traced(replace(case, digest="0" * 64), scene)


@pytest.mark.slow
def test_all_truths_are_the_frozen_ones() -> None:
    for case in cases():
        assert is_frozen(case, traced(case, case.open())), case.name


def test_a_right_renderer_passes_and_an_archive_gives_the_same_statement_without_tracing(
    right: CaseRenderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = chosen(names=SOME)
    path = export(some, tmp_path)
    fresh = run(some, right)
    assert [verdict.verdict for verdict in fresh] == ["pass"] * len(SOME)
    pixels = [verdict.pixels for verdict in fresh]
    assert all(count.shown > 100 and count.unexplained == 0 for count in pixels)
    monkeypatch.setattr("xfrustum.reports.conformance_cases.trace", None)
    monkeypatch.setattr("xfrustum.compare.renderer_model.pictures.first_surfaces", None)
    assert run(some, right, RunOptions(truths=Archive(path=path))) == fresh
    with pytest.raises(InputError, match="a conformance suite that can be read"):
        (tmp_path / "a.zip").write_bytes(b"no archive")
        Archive(path=tmp_path / "a.zip")


@pytest.mark.parametrize(
    ("name", "names"),
    [
        pytest.param("mirrored", FEW, marks=pytest.mark.slow),
        ("blue-red", FEW[:1]),
        ("no-front", FEW[:1]),
        ("back-over-front", ["L0-half-over-half"]),
        ("nearest", ["L0-farthest-wins"]),
        ("farthest", ["L0-nearest-wins"]),
    ],
)
def test_a_wrong_convention_fails_its_level_with_its_cause(name: str, names: list[str]) -> None:
    (renderer,) = (renderer for renderer in WRONG if renderer.name == name)
    assert not any(failures([tried(renderer, names)]).values())


@pytest.mark.slow
def test_wrong_renderers_fail_the_right_level_for_the_right_cause(
    capfd: pytest.CaptureFixture[str],
) -> None:
    problems = failures([tried(renderer) for renderer in WRONG])
    # Before intervals were bounded, HiGHS wrote to standard output, past Python.
    assert capfd.readouterr().out == ""
    assert not any(problems.values()), problems


def test_a_case_with_indistinguishable_faults_gets_the_fault_of_other_cases() -> None:
    first = Verdict(name="a", level="L0", verdict=CaseOutcome.FAIL, cause="not-overlaid")
    alternatives: dict[str, tuple[str, ...]] = {"front-missing": ("not-overlaid",)}
    alike = replace(first, name="b", cause="front-missing", alternatives=alternatives)
    elsewhere = replace(alike, name="c", level="L1")
    causes = [verdict.cause for verdict in agreed([first, alike, elsewhere])]
    assert causes == ["not-overlaid", "not-overlaid", "front-missing"]


def test_a_wrong_pixel_fails_and_one_at_an_edge_does_not() -> None:
    case, scene, truth = truth_of("L1-box-behind")
    inside = truth.triangle.copy()
    row, column = np.argwhere(truth.triangle >= 0)[len(inside) // 2]
    inside[row, column] = (inside[row, column] + 5) % len(scene.faces)
    pixels = judged(case, scene, truth, replace(truth, triangle=inside))
    assert pixels.unexplained == 1 and not pixels.within(case)
    assert judged(case, scene, truth, truth).wrong == 0
    # The picture is shifted by a pixel, so that pixels beside outlines are wrong. Rounding explains
    # them within half a step of a grid of whole pixels, and rarely within half a step of 1/256.
    moved = replace(truth, triangle=np.roll(truth.triangle, 1, axis=1))
    fine = judged(case, scene, truth, moved, LLVMPIPE)
    coarse = judged(case, scene, truth, moved, replace(LLVMPIPE, subpixel_bits=0))
    assert coarse.wrong == fine.wrong > 0 and coarse.edge > 2 * fine.edge


def test_any_surface_of_a_tie_is_accepted_and_no_other_one() -> None:
    case, scene, truth = truth_of("L6-coincident-copies")
    first = truth.triangle[truth.tied_triangles[:, 0], truth.tied_triangles[:, 1]]
    row, column, other = truth.tied_triangles[truth.tied_triangles[:, 2] != first].T
    second, third = truth.triangle.copy(), truth.triangle.copy()
    second[row, column] = other
    inner = len(row) // 2
    third[row[inner], column[inner]] = (other[inner] + 700) % len(scene.faces)
    pixels = judged(case, scene, truth, replace(truth, triangle=second))
    assert pixels.tie > 100 and pixels.within(case)
    assert not judged(case, scene, truth, replace(truth, triangle=third)).within(case)


def test_radiance_above_one_counts_as_one_where_an_image_stores_integers() -> None:
    case, scene, _ = truth_of("L0-colors")
    glow = Appearance(
        materials={"glow": Material(ambient=(3.0, 3.0, 3.0), diffuse=(0.0,) * 3)}, lights=()
    )
    objects = tuple(replace(part, material="glow") for part in scene.objects)
    scene = replace(scene, objects=objects, appearance=glow)
    (truth, *_), reference = traced_anew(case, scene), Reference(scene)
    covered = np.repeat(truth.covered[..., None], 3, axis=-1)
    assert np.array_equal(truth.color, np.where(covered, 3, 0))

    def wrong(image: HogelImage) -> list[int]:
        """Return the counts of wrong pixels by the suite and by `verify`."""
        return [
            judged(case, scene, truth, image).wrong,
            int(wrong_pixels(reference, RendererModel(), image)[0].sum()),
        ]

    def stored(level: int) -> HogelImage:
        pixels = StoredPixels(rgb=np.where(covered, level, 0).astype(np.uint8))
        return of_stored(pixels, truth.camera, Encoding.RGB)

    white = stored(255)
    names = ("camera", "triangle", "object", "position", "color")
    floats = HogelImage(**{name: getattr(white, name) for name in names})
    everything = [int(truth.covered.sum())] * 2
    assert wrong(white) == wrong(stored(253)) == [0, 0]
    assert wrong(stored(252)) == wrong(floats) == everything


@pytest.mark.parametrize(
    "name", ["L0-placed", "L1-harbor-middle", "L4-smooth", "L4-texture-behind", "L4-band-limiting"]
)
def test_the_mesh_that_renderers_get_is_the_scene(name: str, tmp_path: Path) -> None:
    case = case_named(name)
    scene = case.open()
    write_case(case, scene, tmp_path)
    file = tmp_path / "scene.toml"
    file.write_text(
        film((1, 1), (1, 1), (8, 8), (50, 50), (1, 1)) + '[[object]]\nmesh = "scene.obj"\n'
    )
    read = open_scene(file)
    assert np.array_equal(read.triangles, scene.triangles)
    if scene.objects[0].vertex_normals is not None:
        normals = [part.vertex_normals[part.faces] for part in scene.objects]
        (mesh,) = read.objects
        assert np.allclose(mesh.vertex_normals[mesh.faces], np.concatenate(normals))
    colors = scene.surface.vertex_colors
    if colors is not None:
        described = json.loads((tmp_path / "case.json").read_text())
        assert all(part["colored"] for part in described["objects"])
        assert np.array_equal(np.load(tmp_path / "scene.npz")["vertex_colors"], colors)
        assert np.allclose(read.surface.vertex_colors[read.faces], colors[scene.faces])
    for number, part in enumerate(scene.objects):
        mesh = trimesh.load_scene(tmp_path / "scene.glb").geometry[f"object_{number}"]
        assert np.allclose(mesh.triangles, part.vertices[part.faces], rtol=1e-6, atol=1e-6)
        if colors is not None:
            assert np.array_equal(mesh.visual.vertex_colors[:, :3], 255 * part.vertex_colors)


def test_band_limiting_is_drawn_from_the_folder_of_the_case() -> None:
    case = replace(case_named("L4-band-limiting"), resolution=(16, 16))
    bars = CaseRenderer(python="tests.conformance.renderers:bars")
    assert judge_case(case, bars, RunOptions(truths=traced_anew)).verdict == "pass"


def test_images_of_a_folder_are_judged_and_missing_ones_are_named(tmp_path: Path) -> None:
    case, _, truth = truth_of("L0-both-sides")
    put_images(case, tmp_path, [truth])
    put_images(case_named("L0-order"), tmp_path, [truth])
    missing = ("fail", "missing")
    assert judged_images(tmp_path, case.name, "L0-behind", "L0-order") == [
        ("pass", None),
        missing,
        missing,
    ]
    assert main(["conformance", "judge", str(tmp_path), "--case", "L0-behind", "--quiet"]) == 1
    (tmp_path / "L0-behind").mkdir()
    (tmp_path / "L0-behind" / "unsupported").write_text("no sky")
    assert judged_images(tmp_path, "L0-behind") == [("unsupported", "no sky")]


def test_nothing_outside_the_folder_of_images_gets_into_the_statement(tmp_path: Path) -> None:
    """Links, pipes and long files are reported as problems, without their content."""
    case, images, secret = case_named("L0-behind"), tmp_path / "images", tmp_path / "secret"
    reason = images / case.name / "unsupported"
    reason.parent.mkdir(parents=True)
    secret.write_text("my password")

    def refused(message: str) -> None:
        (verdict,) = run((case,), CaseRenderer(images=str(images)))
        assert (verdict.verdict, verdict.cause) == ("fail", "missing")
        assert message in verdict.words[0] and "password" not in str(verdict)
        reason.unlink()

    reason.symlink_to(secret)
    refused("is a link out of")
    os.mkfifo(reason)
    refused("is a pipe")
    reason.write_text("password" * 10_000)
    refused("more than a file with a reason has")
    # A link within the folder is followed; an empty file gives no reason to quote.
    (images / "reason").write_text("")
    reason.symlink_to(images / "reason")
    assert judged_images(images, case.name) == [("unsupported", "not claimed")]
    reason.unlink()
    reason.with_name("hogel_1x1.png").symlink_to(secret)
    reason.parent.rename(tmp_path / case.name)
    reason.parent.symlink_to(tmp_path / case.name)
    reason.write_text("my password")
    refused("is a link out of")


PROGRAM = """
import json, shutil, sys
from pathlib import Path
case, out, truths = map(Path, sys.argv[1:])
question = json.loads((case / "case.json").read_text())
with open("calls", "a") as calls: calls.write(question["name"] + chr(10))
if question["level"] == "L1": (out / "unsupported").write_text("no surfaces")
elif (truths / question["name"]).exists():
    for file in (truths / question["name"]).iterdir(): shutil.copy(file, out)
else: sys.exit("no such truth")
"""


def test_a_command_is_run_once_per_case_and_writes_statement_page_junit_and_badge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("program.py").write_text(PROGRAM)
    case, _, truth = truth_of("L0-behind")
    put_images(case, Path("truths"), [truth])
    command = f"{sys.executable} program.py {{case}} {{out}} truths"
    names = ["L0-behind", "L0-nothing", "L1-box-behind"]
    words = ["--command", command, "--case", ",".join(names), "--out", "statement", "--quiet"]
    assert main(["conformance", "run", *words]) == 1
    statement = json.loads(Path("statement/statement.json").read_text())
    verdicts = [(entry["name"], entry["verdict"]) for entry in statement["cases"]]
    assert verdicts == list(zip(names, ("pass", "fail", "unsupported"), strict=True))
    message = "the command failed with exit status 1: no such truth"
    assert statement["cases"][1]["words"] == [message]
    assert all(Path("statement", name).exists() for name in FILES)
    assert sorted(Path("calls").read_text().split()) == names


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ("[[0.5] * w] * h", "float64"),
        ("[[-1] * w] * h", "0 to 16,777,215"),
        ("[[1 << 24] * w] * h", "0 to 16,777,215"),
        ("[[1] * h] * w", "shape"),
    ],
)
def test_no_number_is_wrapped_or_rounded_into_a_right_one(
    numbers: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = f"w, h = case['resolution']; return {numbers}"
    (tmp_path / "strange_numbers.py").write_text(f"def draw(folder, case, hogel): {body}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "strange_numbers", raising=False)
    (verdict,) = run(chosen(names=("L0-film-wide",)), CaseRenderer(python="strange_numbers:draw"))
    assert verdict.cause == "missing" and message in verdict.words[0]


@pytest.mark.parametrize(
    "words",
    [
        *("", "--command 'program {case}'", "--command 'program {scene} {out}'"),
        *("--command 'no-such-renderer {case} {out}'", "--images nowhere", "--python module"),
        *("--python nowhere_at_all:draw", "--python json:loads --images ."),
    ],
)
def test_an_unusable_renderer_is_refused_before_anything_is_written(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    error = command(f"conformance run {words} --out statement", status=2).err
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_list_show_and_export_print_cases(tmp_path: Path, command: Command) -> None:
    listed = command("conformance list --json").record
    assert listed["suite"] == "1.0" and len(listed["cases"]) == len(cases())
    shown = command(f"conformance show L0-behind --out {tmp_path}/first").out
    assert "accepted: the triangle" in shown
    # Paths of the installation would make archives differ.
    described = json.loads((tmp_path / "first/case/case.json").read_text())
    assert [part["name"] for part in described["objects"]] == ["behind-f.obj"]
    assert np.load(tmp_path / "first/case/scene.npz")["names"].tolist() == ["behind-f.obj"]
    files = {file.name for file in (tmp_path / "first/case").iterdir()}
    assert files == {"scene.obj", "scene.glb", "scene.npz", "case.json", "cameras.json"}
    assert (tmp_path / "first/truth/hogel_1x1.png").exists()
    line = f"conformance export --case L0-behind --out {tmp_path}/a --quiet"
    assert "1 cases" in command(line).out


def test_a_level_with_cases_that_were_not_run_has_a_star_and_failures_have_numbers(
    tmp_path: Path,
) -> None:
    passed = [
        Verdict(name=case.name, level="L4", verdict=CaseOutcome.PASS) for case in chosen(("L4",))
    ]
    parts = {"renderer": "<r>", "device": "d", "device_model": "m"}
    some, whole = (Statement(**parts, verdicts=tuple(part)) for part in (passed[:1], passed))
    assert (some.badge()["message"], whole.badge()["message"]) == ("L4*", "L4")
    assert some.sentence == f"<r> passes L4 (1 of {len(passed)} cases) of suite {SUITE}."
    assert some.summary()["counts"]["L4"]["not run"] == len(passed) - 1
    pixels = Pixels(shown=200, wrong=30, edge=10, unexplained=20)
    failed = replace(
        passed[0], name="a", verdict=CaseOutcome.FAIL, cause="unexplained", pixels=pixels
    )
    write_statement(Statement(**parts, verdicts=(*passed, failed)), tmp_path)
    page, junit = ((tmp_path / name).read_text() for name in ("index.html", "junit.xml"))
    assert "&lt;r&gt;" in page and "30 of 200 pixels wrong" in page
    assert 'failures="1"' in junit and "unexplained: 30 of 200 pixels wrong" in junit
