"""Relit pictures of a mesh that fills the film: no right one fails, and no wrong one passes.

No object ends on this film, but parts of the mesh have outlines before other parts.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import xfrustum
from tests.support.foreign_renderers import saying
from xfrustum.compare.error_maps import true_lines
from xfrustum.compare.judging.judged import Compared, Judging, judge
from xfrustum.compare.judging.verdict import Hogel, Limits
from xfrustum.compare.renderer_model.drawn_model import Back, Front, RendererModel
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import Frustum, HogelImage, Plate, Scene, SceneObject
from xfrustum.tolerances import MAX_WRONG

LONGEST_MM = 80.0  #: longest side of a mesh's bounding box
PLATE_PER_MESH = 0.35  #: plate's side / mesh's side: so small that the mesh fills the films
AMBIENT, DIFFUSE = 0.12, 0.8  #: shading by a light at the camera

ONE_FOR_ALL = "one picture for all"
MODELS = {
    "right": RendererModel(),
    ONE_FOR_ALL: RendererModel(),
    "back only": RendererModel(front=Front.MISSING),
    "front nearest": RendererModel(front=Front.NEAREST),
    "back farthest": RendererModel(back=Back.FARTHEST),
}
"""Renderers with a missing half or a wrong depth test."""


def scene_of(mesh: trimesh.Trimesh, resolution: tuple[int, int]) -> Scene:
    """Return a scene with a mesh, centered in the plate, that fills the films."""
    low, high = mesh.bounds
    scale = LONGEST_MM / (high - low).max()
    width, height, depth = (scale * (high - low)).tolist()
    wide = math.radians(60.0)
    tall = 2 * math.atan(math.tan(wide / 2) * resolution[1] / resolution[0])
    vertices = scale * (mesh.vertices - (low + high) / 2)
    return Scene(
        name="mesh",
        units="mm",
        plate=Plate(size=(PLATE_PER_MESH * width, PLATE_PER_MESH * height), hogels=(5, 5)),
        frustum=Frustum(resolution=resolution, fov=(wide, tall), reach=(depth, depth)),
        objects=(SceneObject(name="mesh", vertices=vertices, faces=np.asarray(mesh.faces)),),
    )


def lit(reference: Reference, shown: HogelImage) -> HogelImage:
    """Return a picture without surface numbers, lit from the camera, with flat triangles."""
    lines = true_lines(shown.camera).directions()
    lines /= np.linalg.norm(lines, axis=2, keepdims=True)
    normal = reference.scene.normals[shown.triangle]
    gray = AMBIENT + DIFFUSE * np.abs(np.einsum("hwi,hwi->hw", normal, lines))
    gray = np.rint(255 * np.where(shown.covered, gray, 0.0)) / 255
    color = np.repeat(gray[..., None], 3, axis=2).astype(np.float32)
    return saying(replace(shown, color=color), "color")


def checked(scene: Scene, indices: list[tuple[int, int]]) -> dict[str, list[tuple[str, float]]]:
    """Return verdict and share of wrong pixels for each renderer's hogels.

    Right pictures must not fail, and wrong ones must not pass.
    """
    reference, limits = Reference(scene), Limits(judging=Judging(compared=Compared.GEOMETRY))
    right, result = RendererModel(), dict[str, list[tuple[str, float]]]()
    for name, model in MODELS.items():
        for index in indices:
            aperture = scene.plate.aperture(*index)
            truth = trace_drawn(reference, right, aperture)
            there = scene.plate.aperture(0, 0) if name == ONE_FOR_ALL else aperture
            shown = replace(trace_drawn(reference, model, there), camera=truth.camera)
            picture = lit(reference, shown)
            points = picture.position.astype(np.float64)
            figures = judge(reference, right, picture, points, limits.judging)
            verdict = Hogel.from_figures(limits, aperture, right, figures, figures).verdict
            wrong = float((shown.triangle != truth.triangle).mean())
            assert name != "right" or verdict != "fail"
            assert wrong <= 1.5 * MAX_WRONG or verdict != "pass", f"{name}: {wrong:.0%} are wrong"
            result.setdefault(name, []).append((verdict, wrong))
    return result


def test_wrong_pictures_of_one_mesh_that_fills_the_film_are_distinguished() -> None:
    """One mesh: a wall with slanted bars before it, on both sides of the plate."""
    wall = trimesh.creation.box((80.0, 80.0, 2.0))
    wall.apply_translation((0.0, 0.0, -30.0))
    parts = [wall]
    for number, (x, z) in enumerate([(-30, 12), (-9, -20), (6, 8), (20, 22), (33, -15)]):
        turn = trimesh.transformations.rotation_matrix(0.4 + 0.3 * number, (0.2, 0.9, 1))
        parts.append(trimesh.creation.box((5.0, 300.0, 3.0)).apply_transform(turn))
        parts[-1].apply_translation((x, 2.0 * number, z))
    grate = trimesh.util.concatenate(parts)
    part = SceneObject(name="grate", vertices=grate.vertices, faces=np.asarray(grate.faces))
    scene = replace(
        scene_of(wall, (64, 48)),
        plate=Plate(size=(20.0, 20.0), hogels=(5, 5)),
        objects=(part,),
    )
    scene = replace(scene, frustum=replace(scene.frustum, reach=(60.0, 60.0)))
    result = checked(scene, [(3, 1)])
    del result["right"]
    assert min(share for hogels in result.values() for _, share in hogels) > 1.5 * MAX_WRONG
    for name in ("back only", ONE_FOR_ALL):
        assert {verdict for verdict, _ in result[name]} == {"fail"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "mesh", ["teapot.obj", "beetle-alt.obj", "CesiumMilkTruck.glb", "foreign/tried-4/spider.stl"]
)
def test_no_wrong_picture_of_a_mesh_that_fills_the_film_passes(
    mesh: str, shared_data: Path
) -> None:
    file = shared_data / "data" / mesh
    if not file.exists():
        pytest.skip(f"needs {mesh}")
    scene = scene_of(trimesh.load(file, force="mesh", process=False), (160, 120))
    checked(scene, [(2, 2), (1, 3), (3, 3)])


@pytest.mark.slow
def test_wrong_pictures_of_a_spider_that_fills_the_film_fail(shared_data: Path) -> None:
    """Another program drew these pictures; 69 % of their surfaces are wrong."""
    folder = shared_data / "data" / "foreign" / "tried-4"
    scene, pattern = str(folder / "spider42.toml"), str(folder / "lit/h_{i}x{j}.png")
    options: dict[str, Any] = {"encoding": "srgb", "compare": "geometry", "apertures": [(30, 15)]}
    result = xfrustum.verify(scene, pattern, **options)
    assert result.verdict == "fail" and not result.diagnosis.faults
