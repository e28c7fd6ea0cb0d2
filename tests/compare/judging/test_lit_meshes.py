"""Pictures of one mesh that fills the film, in another light: right ones do not fail, no wrong one
passes.

Such a film has no border of an object, but outlines of parts that stand before others.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import xfrustum
from tests.support.scene_file import film, named
from xfrustum.compare.judging.judged import Compared, Judging, judge
from xfrustum.compare.judging.verdict import Hogel, Limits, Outcome
from xfrustum.compare.metrics.error_maps import true_lines
from xfrustum.compare.renderer_model.drawn_model import Back, Front, RendererModel
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import HogelImage, Scene, open_scene
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.tolerances import MAX_WRONG

LONGEST_MM = 80.0  #: longest side of a mesh's bounding box
PLATE_PER_MESH = 0.35  #: side of the plate over the mesh's: films are inside of the mesh's outline
AMBIENT, DIFFUSE = 0.12, 0.8  #: of a light at the camera

WRONG = {
    "back only": RendererModel(front=Front.MISSING),
    "front nearest": RendererModel(front=Front.NEAREST),
    "back farthest": RendererModel(back=Back.FARTHEST),
}
"""Renderers with one half missing, or with a depth test that is wrong."""

ONE_FOR_ALL = "one picture for all"


def scene_of(folder: Path, mesh: Path, resolution: tuple[int, int]) -> Scene:
    """Return a scene whose films a mesh fills, its middle in the plate."""
    low, high = trimesh.load(mesh, force="mesh", process=False).bounds
    scale = LONGEST_MM / (high - low).max()
    width, height, depth = (scale * (high - low)).tolist()
    tall = float(2 * np.degrees(np.arctan(np.tan(np.radians(30)) * resolution[1] / resolution[0])))
    text = named(mesh.stem, "mm") + film(
        (PLATE_PER_MESH * width, PLATE_PER_MESH * height),
        (5, 5),
        resolution,
        (60.0, tall),
        (depth, depth),
    )
    middle = (-scale * (low + high) / 2).tolist()
    text += f'[[object]]\nmesh = "{mesh}"\nscale = {float(scale)}\ntranslate = {middle}\n'
    (folder / "scene.toml").write_text(text)
    return open_scene(str(folder / "scene.toml"))


def lit(reference: Reference, shown: HogelImage) -> HogelImage:
    """Return a picture that names no surfaces, lit from the camera, each triangle in one shade."""
    lines = true_lines(shown.camera).directions()
    lines /= np.linalg.norm(lines, axis=2, keepdims=True)
    normal = reference.scene.normals[shown.triangle]
    gray = AMBIENT + DIFFUSE * np.abs(np.einsum("hwi,hwi->hw", normal, lines))
    gray = np.where(shown.triangle == NOTHING, 0.0, gray)
    color = np.repeat(np.rint(255 * gray)[..., None] / 255, 3, axis=2).astype(np.float32)
    nothing, nowhere = np.full_like(shown.triangle, NOTHING), np.full_like(color, np.nan)
    return HogelImage(
        camera=shown.camera, triangle=nothing, object=nothing, position=nowhere, color=color
    )


def verdicts(scene: Scene, apertures: list[tuple[int, int]]) -> dict[str, list[tuple[str, float]]]:
    """Return each renderer's hogels: the verdict, and which share of the pixels shows another
    triangle.
    """
    reference, limits = Reference(scene), Limits(judging=Judging(compared=Compared.GEOMETRY))
    result: dict[str, list[tuple[str, float]]] = {}
    for name, model in ({"right": RendererModel(), ONE_FOR_ALL: RendererModel()} | WRONG).items():
        for index in apertures:
            aperture = scene.plate.aperture(*index)
            truth = trace_drawn(reference, RendererModel(), aperture)
            there = scene.plate.aperture(0, 0) if name == ONE_FOR_ALL else aperture
            shown = replace(trace_drawn(reference, model, there), camera=truth.camera)
            picture = lit(reference, shown)
            figures = judge(
                reference,
                RendererModel(),
                picture,
                np.full(picture.position.shape, np.nan),
                limits.judging,
            )
            hogel = Hogel(
                aperture=aperture, as_found=figures.numbers, checks=limits.checks(figures)
            )
            wrong = float((shown.triangle != truth.triangle).mean())
            result.setdefault(name, []).append((hogel.verdict, wrong))
    return result


def check(result: dict[str, list[tuple[str, float]]]) -> None:
    """Require that right pictures do not fail, and that wrong ones do not pass."""
    for name, hogels in result.items():
        for verdict, wrong in hogels:
            assert name != "right" or verdict in ("pass", Outcome.NOT_JUDGED), (name, verdict)
            assert wrong <= 1.5 * MAX_WRONG or verdict != "pass", f"{name}: {wrong:.0%} are wrong"


@pytest.fixture(scope="module")
def grate(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A wall and slanted bars before it on both sides of the plate, all of them one mesh."""
    folder, parts = tmp_path_factory.mktemp("grate"), []
    for number, (x, z) in enumerate([(-30, 12), (-9, -20), (6, 8), (20, 22), (33, -15)]):
        parts.append(trimesh.creation.box((5.0, 300.0, 3.0)))
        parts[-1].apply_transform(
            trimesh.transformations.rotation_matrix(0.4 + 0.3 * number, (0.2, 0.9, 1))
        )
        parts[-1].apply_translation((x, 2.0 * number, z))
    wall = trimesh.creation.box((80.0, 80.0, 2.0))
    wall.apply_translation((0.0, 0.0, -30.0))
    trimesh.util.concatenate([*parts, wall]).export(folder / "grate.obj")
    text = named("grate", "mm") + film((20.0, 20.0), (5, 5), (64, 48), (60.0, 47.0), (60.0, 60.0))
    (folder / "scene.toml").write_text(f'{text}[[object]]\nmesh = "grate.obj"\n')
    return open_scene(str(folder / "scene.toml"))


def test_parts_of_one_mesh_that_fill_the_film_are_told_from_wrong_ones(grate: Scene) -> None:
    result = verdicts(grate, [(2, 2), (3, 1)])
    check(result)
    assert all(
        min(share for _, share in result[name]) > 1.5 * MAX_WRONG for name in (*WRONG, ONE_FOR_ALL)
    )
    for name in ("back only", ONE_FOR_ALL):
        assert {verdict for verdict, _ in result[name]} == {"fail"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "mesh",
    [
        "teapot.obj",
        "stanford-bunny.obj",
        "beetle-alt.obj",
        "CesiumMilkTruck.glb",
        "foreign/tried-4/spider.stl",
    ],
)
def test_no_wrong_picture_of_a_mesh_that_fills_the_film_passes(
    mesh: str, shared_data: Path, tmp_path: Path
) -> None:
    file = shared_data / "data" / mesh
    if not file.exists():
        pytest.skip(f"needs {mesh}")
    check(verdicts(scene_of(tmp_path, file, (160, 120)), [(2, 2), (1, 3), (3, 3)]))


@pytest.mark.slow
def test_wrong_pictures_of_a_spider_that_fills_the_film_fail(shared_data: Path) -> None:
    """Pictures of another program, in which 69 % of the surfaces are wrong."""
    folder = shared_data / "data" / "foreign" / "tried-4"
    scene, pattern = str(folder / "spider42.toml"), str(folder / "lit/h_{i}x{j}.png")
    result = xfrustum.verify(
        scene, pattern, encoding="srgb", compare="geometry", apertures=[(30, 15)]
    )
    assert result.verdict == "fail"
    assert not result.diagnosis.faults
