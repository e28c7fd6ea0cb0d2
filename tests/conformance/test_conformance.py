"""The conformance suite end to end: frozen truths, a right renderer, wrong ones, and what a run leaves."""

from __future__ import annotations

import base64
import io
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.conformance.table import WRONG, tally, tried
from xfrustum import InputError, open_scene
from xfrustum.cli.main import main
from xfrustum.compare.judging.conformance import Pixels, agrees, judged, trace
from xfrustum.compare.judging.judged import wrong_pixels
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.reference import Reference
from xfrustum.reports.blocks import Engine
from xfrustum.reports.conformance.cases import Archive, export, open_archive, traced, write_case
from xfrustum.reports.conformance.run import Contestant, Trial, Verdict, agreed, run, write_hogel
from xfrustum.reports.conformance.statement import FILES, Statement, junit_cases, write_statement
from xfrustum.scenes.appearance.appearance import Appearance, Material
from xfrustum.scenes.conformance.suite import LEVELS, SUITE, Case, cases, chosen
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, of_stored
from xfrustum.scenes.model.device_model import LLVMPIPE
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthMapping

RIGHT = Contestant(python="tests.conformance.renderers:draw")
FEW = ("L0-both-sides", "L0-order", "L0-placed")
SOME = chosen(
    names=(
        "L0-both-sides",
        "L1-torus-before",
        "L2-harbor-d16-standard",
        "L4-lit-from-viewer-before",
    )
)


def of(name: str) -> Case:
    return chosen(names=(name,))[0]


def truth_of(name: str) -> tuple[Case, Any, HogelImage]:
    case = of(name)
    scene = case.open()
    return case, scene, trace(case, Reference(scene), case.apertures(scene)[0])


def traced_anew(case: Case, scene: Scene) -> list[HogelImage]:
    """Return truths of a case that was never frozen."""
    return [trace(case, Reference(scene), aperture) for aperture in case.apertures(scene)]


def test_the_suite_has_some_120_cases_in_all_levels() -> None:
    assert 110 <= len(cases()) <= 140
    assert {case.level for case in cases()} == set(LEVELS)
    assert len({case.name for case in cases()}) == len(cases())
    assert all(case.why and case.digest and case.hogels for case in cases())
    # Texts in place of members would compare equal, and be judged as another depth buffer.
    assert type(Case(**vars(of("L0-behind")) | {"mapping": "gl"}).mapping) is DepthMapping


@pytest.mark.parametrize(
    "name", ["L0-behind", "L1-harbor-middle", "L3-attic-2", "L6-coincident-copies"]
)
def test_a_truth_is_the_frozen_one(name: str) -> None:
    case = of(name)
    assert agrees(case, traced(case, case.open()))


@pytest.mark.slow
def test_all_truths_are_the_frozen_ones() -> None:
    for case in cases():
        assert agrees(case, traced(case, case.open())), case.name


def test_another_truth_is_refused() -> None:
    case = replace(of("L0-behind"), digest="0" * 64)
    with pytest.raises(RuntimeError, match="digest"):
        traced(case, case.open())


def test_a_right_renderer_passes() -> None:
    verdicts = run(SOME, Trial(contestant=RIGHT))
    assert [one.verdict for one in verdicts] == ["pass"] * len(SOME)
    assert all(one.pixels.shown > 100 and one.pixels.unexplained == 0 for one in verdicts)


@pytest.mark.parametrize(
    "name", [pytest.param("mirrored", marks=pytest.mark.slow), "blue-red", "no-front"]
)
def test_a_wrong_convention_fails_its_level_with_its_cause(name: str) -> None:
    one = next(one for one in WRONG if one.name == name)
    found = tried(one, FEW)
    assert found.right_level
    assert found.right_cause
    assert not found.false_reasons


@pytest.mark.parametrize(
    ("case", "name"),
    [
        ("half-over-half", "back-over-front"),
        ("farthest-wins", "nearest"),
        ("nearest-wins", "farthest"),
    ],
)
def test_a_case_fails_the_mistake_that_it_is_there_for(case: str, name: str) -> None:
    found = tried(next(one for one in WRONG if one.name == name), [f"L0-{case}"])
    assert found.level == "L0"
    assert found.right_cause


def test_a_case_that_cannot_tell_faults_apart_is_given_the_one_that_others_name() -> None:
    one = Verdict(name="a", level="L0", verdict="fail", cause="not-overlaid")
    alike = replace(
        one, name="b", cause="front-missing", alternatives={"front-missing": ("not-overlaid",)}
    )
    elsewhere = replace(alike, name="c", level="L1")
    assert [told.cause for told in agreed([one, alike, elsewhere])] == [
        "not-overlaid", "not-overlaid", "front-missing",
    ]  # fmt: skip


@pytest.mark.slow
def test_wrong_renderers_fail_the_right_level_for_the_right_cause(
    capfd: pytest.CaptureFixture[str],
) -> None:
    done = [tried(one) for one in WRONG]
    # Where intervals had no ends, HiGHS wrote to standard output, past Python.
    assert capfd.readouterr().out == ""
    assert len(done) >= 40
    assert not [one.renderer.name for one in done if one.level is None], tally(done)
    assert not [one.renderer.name for one in done if not one.right_level], tally(done)
    assert not [one.renderer.name for one in done if not one.right_cause or one.false_reasons], (
        tally(done)
    )


def test_one_wrong_pixel_fails_and_one_beside_an_edge_does_not() -> None:
    case, scene, truth = truth_of("L1-box-behind")
    inside = truth.triangle.copy()
    row, column = np.argwhere(truth.triangle >= 0)[len(inside) // 2]
    inside[row, column] = (inside[row, column] + 5) % len(scene.faces)
    pixels, left = judged(case, scene, truth, replace(truth, triangle=inside))
    assert pixels.unexplained == left.sum() == 1
    assert not pixels.within(case)
    assert judged(case, scene, truth, truth)[0].wrong == 0


def test_a_trial_explains_by_the_device_that_it_is_given(tmp_path: Path) -> None:
    case, scene, truth = truth_of("L0-behind")
    # Next to outlines each pixel shows its neighbor: within half a step of a grid of whole pixels,
    # or not.
    moved = np.roll(truth.triangle, 1, axis=1)
    for aperture in case.apertures(scene):
        write_hogel(case, tmp_path, aperture.index, moved + 1)
    (tmp_path / case.name).symlink_to(tmp_path)
    trial = Trial(contestant=Contestant(images=str(tmp_path)), device=LLVMPIPE, pictures=False)
    fine = trial.verdict(case).pixels
    coarse = replace(trial, device=replace(LLVMPIPE, subpixel_bits=0)).verdict(case).pixels
    assert coarse.wrong == fine.wrong > 0
    assert coarse.edge > 2 * fine.edge


def test_any_surface_of_a_tie_is_accepted_and_no_other_one() -> None:
    case, scene, truth = truth_of("L6-coincident-copies")
    first = truth.triangle[truth.tied_triangles[:, 0], truth.tied_triangles[:, 1]]
    row, column, other = truth.tied_triangles[truth.tied_triangles[:, 2] != first].T
    second, third = truth.triangle.copy(), truth.triangle.copy()
    second[row, column] = other
    inner = len(row) // 2
    third[row[inner], column[inner]] = (other[inner] + 700) % len(scene.faces)
    assert judged(case, scene, truth, replace(truth, triangle=second))[0].tie > 100
    assert judged(case, scene, truth, replace(truth, triangle=second))[0].within(case)
    assert not judged(case, scene, truth, replace(truth, triangle=third))[0].within(case)


def test_radiance_above_one_counts_as_one_where_an_image_stores_integers() -> None:
    case, scene, _ = truth_of("L0-colors")
    glow = Appearance(
        materials={"glow": Material(ambient=(3.0, 3.0, 3.0), diffuse=(0.0,) * 3)}, lights=()
    )
    objects = tuple(replace(one, material="glow") for one in scene.objects)
    scene = replace(scene, objects=objects, appearance=glow)
    (truth, *_), reference = traced_anew(case, scene), Reference(scene)
    covered = np.repeat(truth.covered[..., None], 3, axis=-1)
    assert np.array_equal(truth.color, np.where(covered, 3, 0))

    def wrong(image: HogelImage) -> list[int]:
        """Return what the suite and `verify` count."""
        return [
            judged(case, scene, truth, image)[0].wrong,
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
    assert wrong(stored(252)) == everything
    assert wrong(floats) == everything


@pytest.mark.slow
def test_pictures_of_objects_lie_beside_a_truth_in_objects(tmp_path: Path) -> None:
    case = of("L0-objects")
    truth, *others = traced(case, case.open())
    numbers = np.where(
        np.arange(len(truth.object))[:, None] < len(truth.object) // 2, 0, truth.object + 1
    )
    (tmp_path / case.name).mkdir()
    for index, drawn in zip(
        case.hogels, (numbers, *(one.object + 1 for one in others)), strict=True
    ):
        write_hogel(case, tmp_path / case.name, index, drawn)
    found = Trial(contestant=Contestant(images=str(tmp_path))).verdict(case)
    shown = [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(found.pictures[name].partition(",")[2]))))
        for name in ("truth", "image")
    ]
    assert found.verdict == "fail"
    assert np.array_equal((shown[0] != shown[1]).any(axis=-1), truth.object + 1 != numbers)


@pytest.mark.parametrize(
    "name", ["L0-placed", "L1-harbor-middle", "L4-smooth", "L4-texture-behind", "L4-band-limiting"]
)
def test_the_handed_mesh_is_the_scene(name: str, tmp_path: Path) -> None:
    case, scene, _ = truth_of(name)
    write_case(case, scene, tmp_path)
    file = tmp_path / "scene.toml"
    file.write_text(
        "[plate]\nsize = [1.0, 1.0]\nhogels = [1, 1]\n[frustum]\nresolution = [8, 8]\nfov_deg = [50.0, 50.0]"
        '\nreach = [1.0, 1.0]\n[[object]]\nmesh = "scene.obj"\n'
    )
    read = open_scene(file)
    assert np.array_equal(read.triangles, scene.triangles)
    if scene.objects[0].vertex_normals is not None:
        normals = [part.vertex_normals[part.faces] for part in scene.objects]
        (mesh,) = read.objects
        assert np.allclose(mesh.vertex_normals[mesh.faces], np.concatenate(normals))
    assert (tmp_path / "scene.glb").read_bytes()[:4] == b"glTF"
    if scene.surface.vertex_colors is not None:
        described = json.loads((tmp_path / "case.json").read_text())
        assert all(one["colored"] for one in described["objects"])
        assert np.array_equal(
            np.load(tmp_path / "scene.npz")["vertex_colors"], scene.surface.vertex_colors
        )
        assert np.allclose(
            read.surface.vertex_colors[read.faces], scene.surface.vertex_colors[scene.faces]
        )
        for number, part in enumerate(scene.objects):
            mesh = trimesh.load_scene(tmp_path / "scene.glb").geometry[f"object_{number}"]
            assert np.array_equal(mesh.visual.vertex_colors[:, :3], 255 * part.vertex_colors)


def test_band_limiting_is_drawn_from_what_is_handed_over() -> None:
    case = replace(of("L4-band-limiting"), resolution=(16, 16))
    contestant = Contestant(python="tests.conformance.renderers:bars")
    trial = Trial(contestant=contestant, truths=traced_anew, pictures=False)
    assert trial.verdict(case).verdict == "pass"


def test_an_archive_gives_the_same_statement_and_nothing_is_traced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = export(SOME, tmp_path)
    fresh = run(SOME, Trial(contestant=RIGHT))
    monkeypatch.setattr("xfrustum.reports.conformance.cases.trace", None)
    monkeypatch.setattr("xfrustum.compare.renderer_model.pictures.first_surfaces", None)
    packed = run(SOME, Trial(contestant=RIGHT, truths=Archive(path=path)))
    statements = [
        json.dumps(Statement(renderer="r", device="d", device_model="m", verdicts=one).summary())
        for one in (fresh, packed)
    ]
    assert statements[0] == statements[1]


def test_images_of_a_folder_are_judged_and_missing_ones_are_named(tmp_path: Path) -> None:
    case, _, truth = truth_of("L0-both-sides")
    (tmp_path / case.name).mkdir()
    write_hogel(case, tmp_path / case.name, case.hogels[0], truth.triangle + 1)
    absent = of("L0-behind")
    (tmp_path / "L0-order").mkdir()
    write_hogel(case, tmp_path / "L0-order", (0, 0), truth.triangle + 1)
    found = run((case, absent, of("L0-order")), Trial(contestant=Contestant(images=str(tmp_path))))
    assert [one.verdict for one in found] == ["pass", "fail", "fail"]
    assert [one.cause for one in found[1:]] == ["missing", "missing"]
    assert main(["conformance", "judge", str(tmp_path), "--case", absent.name, "--quiet"]) == 1
    (tmp_path / absent.name).mkdir()
    (tmp_path / absent.name / "unsupported").write_text("no sky")
    (told,) = run((absent,), Trial(contestant=Contestant(images=str(tmp_path))))
    assert (told.verdict, told.cause) == ("unsupported", "no sky")


def test_nothing_outside_the_folder_of_images_gets_into_the_statement(tmp_path: Path) -> None:
    """Links, pipes and long files are named as what is wrong; their content is not."""
    case, images, secret = of("L0-behind"), tmp_path / "images", tmp_path / "secret"
    reason = images / case.name / "unsupported"
    reason.parent.mkdir(parents=True)
    secret.write_text("my password")

    def found(told: str) -> None:
        (verdict,) = run((case,), Trial(contestant=Contestant(images=str(images))))
        assert (verdict.verdict, verdict.cause) == ("fail", "missing")
        assert told in verdict.words[0] and "password" not in str(verdict)
        reason.unlink()

    reason.symlink_to(secret)
    found("is a link out of")
    os.mkfifo(reason)
    found("is a pipe")
    reason.write_text("password" * 10_000)
    found("more than a file with a reason has")
    # A link within the folder, and an empty file, which states no reason.
    (images / "reason").write_text("")
    reason.symlink_to(images / "reason")
    (told,) = run((case,), Trial(contestant=Contestant(images=str(images))))
    assert (told.verdict, told.cause) == ("unsupported", "not claimed")
    reason.unlink()
    reason.with_name("hogel_1x1.png").symlink_to(secret)
    reason.parent.rename(tmp_path / case.name)
    reason.parent.symlink_to(tmp_path / case.name)
    reason.write_text("my password")
    found("is a link out of")


PROGRAM = """
import json, shutil, sys
from pathlib import Path
case, out, truths = map(Path, sys.argv[1:])
asked = json.loads((case / "case.json").read_text())
with open("calls", "a") as calls: calls.write(asked["name"] + chr(10))
if asked["level"] == "L1": (out / "unsupported").write_text("no surfaces")
elif (truths / asked["name"]).exists():
    for file in (truths / asked["name"]).iterdir(): shutil.copy(file, out)
else: sys.exit("no such truth")
"""


def test_a_command_is_run_once_for_each_case_and_a_stopped_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("program.py").write_text(PROGRAM)
    case, _, truth = truth_of("L0-behind")
    Path("truths", case.name).mkdir(parents=True)
    write_hogel(case, Path("truths", case.name), case.hogels[0], truth.triangle + 1)
    command = f"{sys.executable} program.py {{case}} {{out}} truths"
    names = "L0-behind,L1-box-behind,L0-nothing"
    asked = [
        "conformance",
        "run",
        "--command",
        command,
        "--case",
        names,
        "--out",
        "said",
        "--quiet",
    ]
    assert main(asked) == 1
    statement = json.loads(Path("said/statement.json").read_text())
    assert {one["name"]: one["verdict"] for one in statement["cases"]} == {
        "L0-behind": "pass", "L0-nothing": "fail", "L1-box-behind": "unsupported",
    }  # fmt: skip
    assert all(Path("said", name).exists() for name in FILES)
    assert json.loads(Path("said/badge.json").read_text())["schemaVersion"] == 1
    # A part that is gone is made again, and no other.
    Path("calls").unlink()
    parts = sorted(Path("said/conformance.parquet").glob("part-*"))
    parts[0].unlink()
    capsys.readouterr()
    main([*asked, "--json"])
    out, err = capsys.readouterr()
    assert json.loads(out)["cases"] == statement["cases"]
    assert "2 of 3 cases were judged before" in err
    assert Path("calls").read_text().split() == ["L0-behind"]


def test_a_program_that_is_not_there_is_told_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for program in ("no-such-renderer", "./no-such-renderer"):
        command = f"{program} {{case}} {{out}}"
        assert main(["conformance", "run", "--command", command, "--out", "said"]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert f"{program} is no program" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_workers_say_what_one_process_says(tmp_path: Path) -> None:
    some = SOME[:2]
    alone = run(some, Trial(contestant=RIGHT))
    assert run(some, Trial(contestant=RIGHT), tmp_path / "two", Engine(workers=2)) == alone


def test_list_show_and_export_print_what_they_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["conformance", "list", "--json"]) in (0, None)
    listed = json.loads(capsys.readouterr().out)
    assert listed["suite"] == "1.0"
    assert {"name", "level", "hogels", "digest"} == set(listed["cases"][0])
    main(["conformance", "show", "L0-behind", "--out", str(tmp_path / "first")])
    assert "accepted: the triangle" in capsys.readouterr().out
    # Where the suite is installed is nobody's business, and would make archives differ.
    described = json.loads((tmp_path / "first/case/case.json").read_text())
    assert [one["name"] for one in described["objects"]] == ["behind-f.obj"]
    assert np.load(tmp_path / "first/case/scene.npz")["names"].tolist() == ["behind-f.obj"]
    assert {file.name for file in (tmp_path / "first/case").iterdir()} >= {
        "scene.obj",
        "scene.glb",
        "case.json",
    }
    assert (tmp_path / "first/truth/hogel_1x1.png").exists()
    main(["conformance", "export", "--case", "L0-behind", "--out", str(tmp_path / "a"), "--quiet"])
    assert "1 cases" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ("[[0.5] * w] * h", "float64"),
        ("[[-1] * w] * h", "0 to 16,777,215"),
        ("[[1 << 24] * w] * h", "0 to 16,777,215"),
        ("[[1] * h] * w", "shape"),
    ],
)
def test_no_number_is_wrapped_or_rounded_into_a_right_one(
    numbers: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = of("L0-film-wide")
    (tmp_path / "strange_numbers.py").write_text(
        f"def draw(folder, asked, hogel):\n    w, h = asked['resolution']\n    return {numbers}\n"
    )
    monkeypatch.delitem(sys.modules, "strange_numbers", raising=False)
    contestant = Contestant(python="strange_numbers:draw", working=tmp_path)
    (found,) = run((case,), Trial(contestant=contestant))
    sys.path.remove(str(tmp_path))
    assert found.cause == "missing"
    assert told in found.words[0]


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"command": "program {case}"},
        {"command": "program {scene} {out}"},
        {"images": "nowhere"},
        {"python": "module"},
        {"python": "json:loads", "images": "."},
    ],
)
def test_a_renderer_that_cannot_be_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        Contestant(**given)


def test_unknown_cases_and_modules_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="L0-behind"):
        chosen(names=("L0-behnd",))
    with pytest.raises(InputError, match="nowhere"):
        run(SOME[:1], Trial(contestant=Contestant(python="nowhere_at_all:draw")))
    (tmp_path / "a.zip").write_bytes(b"no archive")
    with pytest.raises(InputError, match="no archive"):
        open_archive(tmp_path / "a.zip")


def test_a_level_of_which_cases_were_not_run_has_a_star() -> None:
    passed = [Verdict(name=case.name, level="L4", verdict="pass") for case in chosen(("L4",))]
    some = Statement(renderer="r", device="d", device_model="m", verdicts=tuple(passed[:1]))
    assert some.sentence == f"r passes L4 (1 of {len(passed)} cases) of suite {SUITE}."
    assert some.badge()["message"] == "L4*"
    assert some.summary()["counts"]["L4"]["not run"] == len(passed) - 1
    whole = replace(some, verdicts=tuple(passed))
    assert whole.sentence == f"r passes L4 of suite {SUITE}."
    assert whole.badge()["message"] == "L4"


def test_junit_says_how_many_pixels_an_unexplained_failure_has() -> None:
    pixels = Pixels(shown=200, wrong=30, edge=10, unexplained=20)
    one = Verdict(name="a", level="L1", verdict="fail", cause="unexplained", pixels=pixels)
    told = "unexplained: 30 of 200 pixels wrong (10 edge, 20 unexplained)"
    assert [case.failure for case in junit_cases([one])] == [told]


def test_a_page_names_what_fails(tmp_path: Path) -> None:
    found = tried(next(one for one in WRONG if one.name == "mirrored"), FEW)
    statement = Statement(
        renderer="<mirror>", device="none", device_model="any", verdicts=found.verdicts
    )
    write_statement(statement, tmp_path)
    page = (tmp_path / "index.html").read_text()
    assert "&lt;mirror&gt;" in page
    assert "orientation" in page
    assert 'failures="3"' in (tmp_path / "junit.xml").read_text()
