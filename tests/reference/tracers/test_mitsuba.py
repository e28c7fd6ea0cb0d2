"""Mitsuba answers like Embree and the certified truth, and never on an LLVM that kills the process."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy import stats

from tests.support.long_tail import thinned
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.lines.triangles import distance_to_triangles
from xfrustum.reference.llvm import (
    LLVM_VARIABLE,
    OLDEST_LLVM,
    Version,
    accepted_llvm,
    asked_version,
    installed_llvms,
    mitsuba_backend,
    named_version,
)
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer
from xfrustum.reference.tracers.sensor import mitsuba_scene, register_sensor, sensor_parameters
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.arrays import Floats, Mask, Numbers, Singles
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.plate import Aperture

SINGLE = 2.0**-24
"""Unit roundoff of float32."""

TRAVERSAL = 16
"""Roundings between a double ray and a float32 verdict, each relative to the longest length at hand:
origin, direction and corners 1 each, corners relative to the origin 1, the two cross products of an
edge function 6, its comparison with the others 2, and the distance 4."""


def scene_at(name: str, width: int, height: int) -> Scene:
    scene = open_scene(name)
    return dataclasses.replace(scene, frustum=dataclasses.replace(scene.frustum, resolution=(width, height)))


def rays(scene: Scene, aperture: Aperture) -> tuple[Floats, Floats]:
    """Return all lines of an aperture from the viewer's end."""
    pencil = crossed_frustum(scene.frustum, aperture)
    directions = pencil.directions().reshape(-1, 3)
    return np.asarray(pencil.center) + pencil.s_range[0] * directions, directions


def meeting(scene: Scene, triangle: Numbers, o: Floats, d: Floats) -> tuple[Floats, Floats, Floats]:
    """Where each ray meets the plane of a triangle: the parameter, how far outside, 1 / |cosine|."""
    corners = scene.triangles[triangle]
    normals = scene.normals[triangle]
    slope = np.einsum("ij,ij->i", normals, d)
    along = np.einsum("ij,ij->i", normals, corners[:, 0] - o) / slope
    outside = distance_to_triangles(o + along[:, None] * d, corners)
    return along, outside, np.linalg.norm(d, axis=1) / np.abs(slope)


def unexplained(scene: Scene, mine: Numbers, truth: Numbers, o: Floats, d: Floats) -> NDArray[np.intp]:
    """Rays whose answer differs from the truth by more than single precision can account for.

    A length is known to `TRAVERSAL` roundings of the longest one, on a slanted plane 1 / |cosine|
    as much. Within that, the triangle shown must be met and no farther than the true one; one
    that is shown too far away, or not at all, needs a truth that the ray meets as close to an edge.
    """
    differ = np.flatnonzero(mine != truth)
    longest = np.abs(o).max() + np.abs(scene.vertices).max()
    bad = []
    for ray in differ:
        ray_o, ray_d = o[[ray]], d[[ray]]
        far, shown_well, true_far, slack = np.inf, False, np.inf, 0.0
        if mine[ray] != NOTHING:
            along, outside, slant = meeting(scene, mine[[ray]], ray_o, ray_d)
            slack = TRAVERSAL * SINGLE * longest * float(slant[0])
            far, shown_well = float(along[0]), float(outside[0]) <= slack
        grazed = False
        if truth[ray] != NOTHING:
            along, _, slant = meeting(scene, truth[[ray]], ray_o, ray_d)
            true_slack = TRAVERSAL * SINGLE * longest * float(slant[0])
            true_far, slack = float(along[0]), slack + true_slack
            grazed = edge_distance(ray_o + along[0] * ray_d, scene.triangles[truth[ray]]) <= true_slack
        in_order = abs(far - true_far) * np.linalg.norm(ray_d) <= slack or far < true_far
        if not ((mine[ray] == NOTHING or shown_well) and (in_order or grazed)):
            bad.append(ray)
    return np.array(bad, dtype=np.intp)


def edge_distance(point: Floats, corners: Floats) -> float:
    """Return the distance of a point (1, 3) from the nearest edge of a triangle (3, 3)."""
    edges = np.stack([corners, np.roll(corners, -1, axis=0), corners], axis=1)
    return float(distance_to_triangles(np.repeat(point, 3, axis=0), edges).min())


@pytest.fixture(scope="module")
def sphere() -> Scene:
    """Return a sphere of 20,480 triangles behind the plate."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=10.0)
    part = SceneObject(name="sphere", vertices=np.asarray(mesh.vertices), faces=np.asarray(mesh.faces))
    return dataclasses.replace(open_scene("empty"), objects=(part,))


class TestTracer:
    @pytest.mark.parametrize(
        "name", thinned(["car", "asymmetric-recentered", "crossing", "large-triangles"], 2, 1)
    )
    def test_every_difference_from_the_truth_is_explained_by_single_precision(self, name: str) -> None:
        scene = scene_at(name, 320, 240)
        aperture = scene.default_apertures()[-1]
        o, d = rays(scene, aperture)
        truth = Reference(scene).trace(aperture).triangle.ravel()
        mine = MitsubaTracer(scene).first_hits(o, d)
        # Reach ends the truth's lines, not the tracer's rays.
        beyond = (truth == NOTHING) & (mine != NOTHING)
        along = meeting(scene, mine[beyond], o[beyond], d[beyond])[0]
        mine[np.flatnonzero(beyond)[along > sum(scene.frustum.reach)]] = NOTHING
        assert len(unexplained(scene, mine, truth, o, d)) == 0

    @pytest.mark.slow
    def test_an_answer_of_the_next_pixel_is_not_explained(self) -> None:
        scene = scene_at("asymmetric", 320, 240)
        aperture = scene.plate.middle
        o, d = rays(scene, aperture)
        truth = Reference(scene).trace(aperture).triangle
        shifted = np.roll(truth, 1, axis=1)
        differ = np.count_nonzero(shifted != truth)
        assert len(unexplained(scene, shifted.ravel(), truth.ravel(), o, d)) > 0.9 * differ

    def test_rays_at_vertices_meet_the_tip_of_a_neighbor_or_miss_by_a_rounding(self, sphere: Scene) -> None:
        o = np.zeros_like(sphere.vertices)
        mine = MitsubaTracer(sphere).first_hits(o, sphere.vertices)
        met = mine != NOTHING
        along, outside, slant = meeting(sphere, mine[met], o[met], sphere.vertices[met])
        bound = TRAVERSAL * SINGLE * 10.0 * slant
        assert np.all(outside <= bound)
        assert np.all(np.abs(along - 1) * 10.0 <= bound)
        assert np.all((sphere.faces[mine[met]] == np.flatnonzero(met)[:, None]).any(axis=1))

    def test_scaling_by_powers_of_two_changes_no_bit(self) -> None:
        scene = scene_at("asymmetric", 64, 48)
        o, d = rays(scene, scene.plate.middle)
        hits = MitsubaTracer(scene).first_hits(o, d)
        for factor in (2.0**-60, 2.0**60):
            parts = tuple(dataclasses.replace(p, vertices=p.vertices * factor) for p in scene.objects)
            scaled = MitsubaTracer(dataclasses.replace(scene, objects=parts))
            np.testing.assert_array_equal(scaled.first_hits(o * factor, d), hits)

    def test_more_rays_than_one_call_takes(self, monkeypatch: pytest.MonkeyPatch) -> None:
        scene = scene_at("asymmetric", 64, 48)
        o, d = rays(scene, scene.plate.middle)
        tracer = MitsubaTracer(scene)
        hits = tracer.first_hits(o, d)
        monkeypatch.setattr("xfrustum.reference.tracers.mitsuba_tracer.RAYS_PER_CALL", 1000)
        np.testing.assert_array_equal(tracer.first_hits(o, d), hits)

    def test_nothing_is_met_where_there_is_nothing(self) -> None:
        tracer = MitsubaTracer(open_scene("empty"))
        assert tracer.first_hits(np.zeros((3, 3)), np.ones((3, 3))).tolist() == [NOTHING] * 3
        full = MitsubaTracer(open_scene("asymmetric"))
        assert full.first_hits(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


class TestTruth:
    @pytest.mark.parametrize("name", ["asymmetric-recentered", "sheets"])
    def test_the_truth_does_not_depend_on_the_tracer(self, name: str) -> None:
        scene = scene_at(name, 128, 96)
        aperture = scene.default_apertures()[-1]
        embree, mitsuba = (Reference(scene, tracer).trace(aperture) for tracer in TRACERS)
        np.testing.assert_array_equal(mitsuba.triangle, embree.triangle)
        np.testing.assert_array_equal(mitsuba.certainty, embree.certainty)
        np.testing.assert_array_equal(mitsuba.position, embree.position)

    def test_versions_name_what_traced(self) -> None:
        versions = Reference(open_scene("empty"), "mitsuba").versions
        assert set(versions) == {"mitsuba", "mitsuba variant", "llvm"}
        assert versions["mitsuba variant"] == mitsuba_backend().mitsuba.variant()

    def test_an_unknown_tracer_is_refused(self) -> None:
        with pytest.raises(InputError, match="embree"):
            Reference(open_scene("empty"), "optix")


def rendered(scene: Scene, aperture: Aperture, film: dict[str, Any] | None = None) -> Singles:
    """Alpha, position, geometric normal and primitive, (H, W, 8), one line per pixel center."""
    mi = mitsuba_backend().mitsuba
    register_sensor()
    sensor = sensor_parameters(scene, aperture)
    sensor["film"].update(film or {})
    centers = {"type": "stratified", "sample_count": 1, "jitter": False}
    loaded = mi.load_dict(
        {**mitsuba_scene(scene), "sensor": {**sensor, "sampler": centers}, "light": {"type": "constant"}}
    )
    direct = {"type": "direct", "hide_emitters": True}
    aovs = "position:position,normal:geo_normal,primitive:prim_index"
    integrator = mi.load_dict({"type": "aov", "aovs": aovs, "image": direct})
    # Channels R, G, B and A come first.
    return np.array(mi.render(loaded, integrator=integrator, spp=1))[..., 3:]


def interior(truth: HogelImage) -> Mask:
    """Pixels whose triangle is that of all eight neighbors.

    Elsewhere an edge may pass within the sensor's error of the line; that error is far below a pixel.
    """
    padded = np.pad(truth.triangle, 1, mode="edge")
    height, width = truth.triangle.shape
    shifted = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(np.all([s == truth.triangle for s in shifted], axis=0))


class TestSensor:
    @pytest.mark.parametrize("name", thinned(["asymmetric", "asymmetric-recentered"], 2, 1))
    def test_an_ordinary_render_shows_the_true_image(self, name: str) -> None:
        scene = scene_at(name, 320, 240)
        for aperture in scene.default_apertures():
            truth = Reference(scene).trace(aperture)
            image = rendered(scene, aperture)
            inside = interior(truth)
            assert np.count_nonzero(inside & truth.covered) > 500
            np.testing.assert_array_equal((image[..., 0] > 0.5)[inside], truth.covered[inside])
            judged = inside & truth.covered
            np.testing.assert_array_equal(image[judged, 7], truth.triangle[judged])

    def test_heights_and_normals_are_the_truths(self) -> None:
        scene = scene_at("asymmetric-recentered", 320, 240)
        aperture = scene.plate.corners[0]
        truth = Reference(scene).trace(aperture)
        judged = truth.covered & interior(truth)
        image = rendered(scene, aperture)[judged].astype(np.float64)
        o, d = (part.reshape(*truth.triangle.shape, 3)[judged] for part in rays(scene, aperture))
        slant = meeting(scene, truth.triangle[judged], o, d)[2]
        longest = np.abs(o).max() + np.abs(scene.vertices).max()
        assert np.all(
            np.abs(image[:, 3] - truth.position[judged][:, 2]) <= TRAVERSAL * SINGLE * longest * slant
        )
        # A normal turns by the roundings of its corners over the triangle's smallest height.
        corners = scene.triangles[truth.triangle[judged]]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        turn = TRAVERSAL * SINGLE * np.abs(scene.vertices).max() * sides.max(axis=1) / area
        assert np.all(np.linalg.norm(image[:, 4:7] - truth.normal[judged], axis=1) <= turn)

    def test_a_crop_window_is_a_part_of_the_whole(self) -> None:
        scene = scene_at("asymmetric-recentered", 160, 120)
        aperture = scene.plate.corners[1]
        crop = {"crop_offset_x": 37, "crop_offset_y": 21, "crop_width": 80, "crop_height": 60}
        judged = interior(Reference(scene).trace(aperture))[21:81, 37:117]
        part, whole = rendered(scene, aperture, crop), rendered(scene, aperture)[21:81, 37:117]
        np.testing.assert_array_equal(part[judged][:, [0, 7]], whole[judged][:, [0, 7]])

    def test_ray_to_film_and_back(self) -> None:
        scene = scene_at("asymmetric-recentered", 160, 120)
        aperture = scene.plate.corners[0]
        pencil = crossed_frustum(scene.frustum, aperture)
        mi = mitsuba_backend().mitsuba
        register_sensor()
        sensor = mi.load_dict(sensor_parameters(scene, aperture))
        (ax, ay, _), (kx, ky), (tx, ty) = pencil.center, pencil.shear, pencil.half_extent
        longest = abs(ax) + abs(ay) + sum(scene.frustum.reach) * (abs(kx) + tx + abs(ky) + ty + 1)
        for column, row in ((0, 0), (159, 0), (0, 119), (101, 17)):
            position = ((column + 0.5) / 160, (row + 0.5) / 120)
            ray, _ = sensor.sample_ray_differential(0.0, 0.0, mi.Point2f(*position), mi.Point2f(0.5, 0.5))
            start, along, length = (
                np.array(part, dtype=np.float64).ravel() for part in (ray.o, ray.d, ray.maxt)
            )
            next_x, next_y = (np.array(part, dtype=np.float64).ravel() for part in (ray.d_x, ray.d_y))
            for end, height in (
                (start, scene.frustum.reach[0]),
                (start + along * length, -scene.frustum.reach[1]),
            ):
                error = TRAVERSAL * SINGLE * longest
                assert end[2] == pytest.approx(height, abs=error)
                u, v = ((end[0] - ax) / -height - kx) / tx, ((end[1] - ay) / -height - ky) / ty
                reach_error = error / min(scene.frustum.reach) / min(tx, ty) * 160 / 2
                assert (u + 1) * 160 / 2 - 0.5 == pytest.approx(column, abs=reach_error)
                assert (1 - v) * 120 / 2 - 0.5 == pytest.approx(row, abs=reach_error)
            slopes = [d[:2] / -d[2] for d in (along, next_x, next_y)]
            rounding = TRAVERSAL * SINGLE * (abs(kx) + tx + abs(ky) + ty)
            np.testing.assert_allclose(slopes[1] - slopes[0], (2 * tx / 160, 0), atol=rounding)
            np.testing.assert_allclose(slopes[2] - slopes[0], (0, -2 * ty / 120), atol=rounding)

    @pytest.mark.parametrize(
        "crop",
        thinned([{"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 16, "crop_height": 12}, {}], 2),
        ids=["crop window", "whole film"],
    )
    def test_light_traced_from_the_lamp_arrives_as_from_the_eye(self, crop: dict[str, int]) -> None:
        mi = mitsuba_backend().mitsuba
        register_sensor()
        scene = scene_at("asymmetric-recentered", 32, 24)
        sensor = sensor_parameters(scene, scene.plate.corners[0])
        sensor["film"].update(crop)
        lamp = {"type": "point", "position": [10.0, 20.0, 225.0], "intensity": {"type": "rgb", "value": 1e5}}
        sampled = {**sensor, "sampler": {"type": "independent"}}
        loaded = mi.load_dict({**mitsuba_scene(scene), "sensor": sampled, "lamp": lamp})

        def blocks(kind: str, seed: int) -> Floats:
            integrator = mi.load_dict({"type": kind, "max_depth": 2, "hide_emitters": True})
            red = np.array(mi.render(loaded, integrator=integrator, spp=1024, seed=seed))[..., 0]
            return np.asarray(
                red.reshape(red.shape[0] // 4, 4, red.shape[1] // 4, 4).mean((1, 3)), np.float64
            )

        path, light = (np.array([blocks(kind, seed) for seed in range(16)]) for kind in ("path", "ptracer"))
        lit = path.mean(0) > 0.1 * path.mean(0).max()
        found = stats.ttest_ind(path[:, lit], light[:, lit], equal_var=False)
        assert np.count_nonzero(lit) >= 3
        # One false alarm in ten thousand machines, whatever the number of blocks.
        assert np.all(found.pvalue > 1e-4 / np.count_nonzero(lit))

    def test_xml_scenes_can_name_it(self) -> None:
        register_sensor()
        numbers = {"shear_x": 0.1, "shear_y": -0.2, "half_extent_x": 0.5, "half_extent_y": 0.4}
        numbers |= {"reach_viewer": 20.0, "reach_back": 30.0}
        floats = "".join(f'<float name="{key}" value="{value}"/>' for key, value in numbers.items())
        xml = (
            f'<sensor type="crossed_frustum" version="3.0.0"><point name="aperture" value="1, 2, 0"/>{floats}'
        )
        sensor = mitsuba_backend().mitsuba.load_string(xml + "</sensor>")
        assert np.allclose(np.array(sensor.bbox().min), (1, 2, 0))


def versions_of(*known: tuple[str, Version]) -> dict[Path, Version]:
    return {Path(name): version for name, version in known}


class TestLlvm:
    def test_what_a_name_rejects_is_not_even_loaded(self) -> None:
        asked: list[Path] = []
        names = [*(f"libLLVM-{n}.so.1" for n in (11, 13, 14, 15, 16)), "libLLVM.so.16.0"]
        assert accepted_llvm(map(Path, names), asked.append) is None
        assert asked == []

    @pytest.mark.parametrize("actual", [14, 15, 16])
    @pytest.mark.parametrize("name", ["libLLVM.so", "libLLVM-19.so", "libLLVM.so.19.1"])
    def test_a_name_does_not_vouch_for_a_library(self, name: str, actual: int) -> None:
        assert accepted_llvm([Path(name)], lambda _: (actual, 0, 0)) is None

    def test_nineteen_first_then_the_nearest(self) -> None:
        known = versions_of(*((f"libLLVM-{n}.so", (n, 1, 0)) for n in (22, 17, 14, 20, 19, 15, 18)))
        taken = []
        while (library := accepted_llvm(known, known.get)) is not None:
            taken.append(known.pop(library)[0])
        assert taken == [19, 18, 20, 17, 22]

    def test_files_that_are_no_library_are_passed_over(self, tmp_path: Path) -> None:
        fake = tmp_path / "libLLVM.so.19.1"
        fake.write_text("not a library")
        assert asked_version(fake) is None
        assert accepted_llvm([fake]) is None

    def test_a_library_is_named_by_what_it_points_to(self, tmp_path: Path) -> None:
        names = {"libLLVM-14.so.1": 14, "libLLVM-14.0.6.so": 14, "libLLVM.so.19.1": 19, "libLLVM.so": None}
        assert {name: named_version(Path(name)) for name in names} == names
        (tmp_path / "libLLVM-15.so.1").touch()
        (tmp_path / "libLLVM.so").symlink_to("libLLVM-15.so.1")
        assert named_version(tmp_path / "libLLVM.so") == 15


def python(code: str, *arguments: str, llvm: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, LLVM_VARIABLE: llvm}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], env=environment, capture_output=True, text=True, check=False
    )


def refused_llvm() -> str:
    """Return an installed LLVM that ends the process, for tests that need a real one."""
    for library in installed_llvms():
        if named_version(library) in (15, 16):
            return str(library)
    pytest.skip("needs LLVM 15 or 16 to refuse it; neither is installed")


class TestFallback:
    def test_an_llvm_that_ends_the_process_is_loaded_by_dr_jit_but_not_used(self) -> None:
        code = "from xfrustum.reference import llvm; b = llvm.mitsuba_backend(); print(b.variant, b.llvm)"
        done = python(code, llvm=refused_llvm())
        assert done.stdout.startswith("scalar_rgb 1"), done.stderr
        assert f"older than {OLDEST_LLVM}" in done.stdout

    def test_a_variant_that_was_set_on_it_is_refused_in_one_line(self) -> None:
        code = (
            "import mitsuba; mitsuba.set_variant('llvm_ad_rgb')\n"
            "from xfrustum.reference.llvm import mitsuba_backend\n"
            "try: mitsuba_backend()\n"
            "except Exception as e: print(type(e).__name__, e)"
        )
        done = python(code, llvm=refused_llvm())
        assert done.stdout.startswith("InputError"), done.stderr
        assert LLVM_VARIABLE in done.stdout
        assert done.stdout.count("\n") == 1

    def test_a_variant_that_was_set_before_stays(self) -> None:
        code = (
            "import mitsuba; mitsuba.set_variant('scalar_rgb')\n"
            "from xfrustum.reference.llvm import mitsuba_backend\n"
            "print(mitsuba_backend().variant, mitsuba.variant())"
        )
        done = python(code, llvm=os.environ.get(LLVM_VARIABLE, ""))
        assert done.stdout.split() == ["scalar_rgb", "scalar_rgb"], done.stderr
