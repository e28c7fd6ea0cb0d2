"""Mitsuba answers like Embree and the certified truth, and never on an LLVM that kills the process."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tests.support.images import interior
from tests.support.long_tail import thinned
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.lines.lines import crossed_frustum
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
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


def scene_at(name: str, width: int, height: int) -> Scene:
    scene = open_scene(name)
    return dataclasses.replace(
        scene, frustum=dataclasses.replace(scene.frustum, resolution=(width, height))
    )


def rays(scene: Scene, aperture: Aperture) -> tuple[Floats, Floats]:
    """Return all lines of an aperture from the viewer's end."""
    bundle = crossed_frustum(scene.frustum, aperture)
    directions = bundle.directions().reshape(-1, 3)
    return np.asarray(bundle.center) + bundle.s_range[0] * directions, directions


class TestTracer:
    @pytest.mark.parametrize("tracer", TRACERS)
    @pytest.mark.parametrize(
        "name", thinned(["car", "asymmetric-recentered", "crossing", "large-triangles"], 2, 1)
    )
    def test_away_from_edges_a_tracer_meets_what_the_truth_shows(
        self, name: str, tracer: str
    ) -> None:
        scene = scene_at(name, 160, 120)
        aperture = scene.default_apertures()[-1]
        truth = Reference(scene).trace(aperture)
        mine = Reference(scene, tracer).tracer.first_hits(*rays(scene, aperture)).reshape(120, 160)
        inside = interior(truth)
        assert inside.sum() > 300
        np.testing.assert_array_equal(mine[inside], truth.triangle[inside])
        # An answer one pixel beside would be wrong along every edge; rays go on beyond the reach.
        assert ((mine != truth.triangle) & truth.covered).mean() < 1e-3

    def test_scaling_by_powers_of_two_changes_no_bit(self) -> None:
        scene = scene_at("asymmetric", 64, 48)
        o, d = rays(scene, scene.plate.middle)
        hits = MitsubaTracer(scene).first_hits(o, d)
        for factor in (2.0**-60, 2.0**60):
            parts = tuple(
                dataclasses.replace(p, vertices=p.vertices * factor) for p in scene.objects
            )
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
    """Alpha and primitive, (H, W, 2), one line per pixel center."""
    mi = mitsuba_backend().mitsuba
    register_sensor()
    sensor = sensor_parameters(scene, aperture)
    sensor["film"].update(film or {})
    centers = {"type": "stratified", "sample_count": 1, "jitter": False}
    loaded = mi.load_dict(
        {
            **mitsuba_scene(scene),
            "sensor": {**sensor, "sampler": centers},
            "light": {"type": "constant"},
        }
    )
    direct = {"type": "direct", "hide_emitters": True}
    integrator = mi.load_dict({"type": "aov", "aovs": "primitive:prim_index", "image": direct})
    # Channels R, G, B and A come first.
    return np.array(mi.render(loaded, integrator=integrator, spp=1))[..., 3:]


class TestSensor:
    @pytest.mark.parametrize("name", thinned(["asymmetric", "asymmetric-recentered"], 2, 1))
    def test_an_ordinary_render_shows_the_true_image(self, name: str) -> None:
        scene = scene_at(name, 320, 240)
        for aperture in scene.default_apertures():
            truth = Reference(scene).trace(aperture)
            image = rendered(scene, aperture)
            inside = interior(truth)
            assert inside.sum() > 500
            np.testing.assert_array_equal(image[inside, 1], truth.triangle[inside])
            # Single precision moves an outline by far less than a pixel.
            assert ((image[..., 0] > 0.5) != truth.covered).mean() < 1e-3

    def test_a_crop_window_is_a_part_of_the_whole(self) -> None:
        scene = scene_at("asymmetric-recentered", 160, 120)
        aperture = scene.plate.corners[1]
        crop = {"crop_offset_x": 37, "crop_offset_y": 21, "crop_width": 80, "crop_height": 60}
        judged = interior(Reference(scene).trace(aperture))[21:81, 37:117]
        part, whole = rendered(scene, aperture, crop), rendered(scene, aperture)[21:81, 37:117]
        np.testing.assert_array_equal(part[judged], whole[judged])

    @pytest.mark.parametrize(
        "crop",
        thinned(
            [{"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 16, "crop_height": 12}, {}], 2
        ),
        ids=["crop window", "whole film"],
    )
    def test_light_traced_from_the_lamp_arrives_as_from_the_eye(self, crop: dict[str, int]) -> None:
        mi = mitsuba_backend().mitsuba
        register_sensor()
        scene = scene_at("asymmetric-recentered", 32, 24)
        sensor = sensor_parameters(scene, scene.plate.corners[0])
        sensor["film"].update(crop)
        lamp = {
            "type": "point",
            "position": [10.0, 20.0, 225.0],
            "intensity": {"type": "rgb", "value": 1e5},
        }
        sampled = {**sensor, "sampler": {"type": "independent"}}
        loaded = mi.load_dict({**mitsuba_scene(scene), "sensor": sampled, "lamp": lamp})

        def blocks(kind: str, seed: int) -> Floats:
            integrator = mi.load_dict({"type": kind, "max_depth": 2, "hide_emitters": True})
            red = np.array(mi.render(loaded, integrator=integrator, spp=1024, seed=seed))[..., 0]
            return np.asarray(
                red.reshape(red.shape[0] // 4, 4, red.shape[1] // 4, 4).mean((1, 3)), np.float64
            )

        path, light = (
            np.array([blocks(kind, seed) for seed in range(16)]) for kind in ("path", "ptracer")
        )
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
        xml = f'<sensor type="crossed_frustum" version="3.0.0"><point name="aperture" value="1, 2, 0"/>{floats}'
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


def test_dr_jit_says_nothing_of_its_own_where_home_is_not_set() -> None:
    code = "from xfrustum.reference.llvm import require_llvm; require_llvm(); from drjit.llvm import Float; "
    bare = {
        name: value for name, value in os.environ.items() if name not in ("HOME", "DRJIT_CACHE_DIR")
    }
    line = [sys.executable, "-c", f"{code}print(Float(1) + 1)"]
    done = subprocess.run(line, env=bare, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("[2]\n", "")


def python(code: str, *arguments: str, llvm: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, LLVM_VARIABLE: llvm}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
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
