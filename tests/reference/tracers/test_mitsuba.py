"""Mitsuba agrees with Embree and the certified truth, and avoids versions of LLVM that abort."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.support.images import interior
from tests.support.long_tail import thinned
from tests.support.views import view
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.lines import crossed_frustum
from xfrustum.reference.llvm import Version, accepted_llvm, mitsuba_backend
from xfrustum.reference.tracers import mitsuba_scene, register_sensor, sensor_parameters
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture


def rays(scene: Scene, aperture: Aperture) -> tuple[Floats, Floats]:
    """Return all lines of an aperture as rays from the viewer's end."""
    bundle = crossed_frustum(scene.frustum, aperture)
    directions = bundle.directions().reshape(-1, 3)
    return np.asarray(bundle.center) + bundle.s_range[0] * directions, directions


class TestTracer:
    @pytest.mark.parametrize("tracer", TRACERS)
    @pytest.mark.parametrize(
        "name", thinned(["car", "asymmetric-recentered", "crossing", "large-triangles"], 2, 1)
    )
    def test_away_from_edges_a_tracer_meets_the_true_triangles(
        self, name: str, tracer: str
    ) -> None:
        scene = view(name, (160, 120))
        aperture = scene.default_apertures()[-1]
        truth = Reference(scene).trace(aperture)
        mine = Reference(scene, tracer).tracer.first_hits(*rays(scene, aperture)).reshape(120, 160)
        inside = interior(truth)
        assert inside.sum() > 300
        np.testing.assert_array_equal(mine[inside], truth.triangle[inside])
        # An answer displaced by a pixel would be wrong at every edge. Rays extend beyond the reach.
        assert ((mine != truth.triangle) & truth.covered).mean() < 1e-3


def rendered(scene: Scene, aperture: Aperture) -> Singles:
    """Return alpha and primitive (H, W, 2), from one line per pixel center."""
    mi = mitsuba_backend().mitsuba
    register_sensor()
    sensor = sensor_parameters(scene, aperture)
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
        scene = view(name, (320, 240))
        for aperture in scene.default_apertures():
            truth = Reference(scene).trace(aperture)
            image = rendered(scene, aperture)
            inside = interior(truth)
            assert inside.sum() > 500
            np.testing.assert_array_equal(image[inside, 1], truth.triangle[inside])
            # Single precision moves outlines by far less than a pixel.
            assert ((image[..., 0] > 0.5) != truth.covered).mean() < 1e-3

    @pytest.mark.slow
    def test_light_traced_from_the_lamp_arrives_as_from_the_eye(self) -> None:
        crop = {"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 16, "crop_height": 12}
        mi = mitsuba_backend().mitsuba
        register_sensor()
        scene = view("asymmetric-recentered", (32, 24))
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
        result = stats.ttest_ind(path[:, lit], light[:, lit], equal_var=False)
        assert np.count_nonzero(lit) >= 3
        # Allow one false alarm in ten thousand machines, whatever the number of blocks.
        assert np.all(result.pvalue > 1e-4 / np.count_nonzero(lit))


class TestLlvm:
    def test_llvm_19_is_tried_first_then_the_nearest_accepted_version(self) -> None:
        numbers = (22, 17, 14, 20, 19, 15, 18)
        known: dict[Path, Version] = {Path(f"libLLVM-{n}.so"): (n, 1, 0) for n in numbers}
        taken = []
        while (library := accepted_llvm(known, known.get)) is not None:
            taken.append(known.pop(library)[0])
        assert taken == [19, 18, 20, 17, 22]

    def test_a_library_with_a_rejected_name_is_not_loaded(self) -> None:
        loaded: list[Path] = []
        names = [*(f"libLLVM-{n}.so.1" for n in (11, 13, 14, 15, 16)), "libLLVM.so.16.0"]
        assert accepted_llvm(map(Path, names), loaded.append) is None
        assert loaded == []

    def test_files_that_are_no_library_are_passed_over(self, tmp_path: Path) -> None:
        fake = tmp_path / "libLLVM.so.19.1"
        fake.write_text("not a library")
        assert accepted_llvm([fake]) is None
