"""Truths compiled by Dr.Jit and truths made in NumPy: the same bits, and colors alike to one rounding."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.light import dressed_scene
from tests.support.processes import threads
from tests.support.views import at, soup, view
from xfrustum.reference import Reference
from xfrustum.reference import film_shifts as shifts_module
from xfrustum.reference import pictures as pictures_module
from xfrustum.reference import truth as truth_module
from xfrustum.reference.certify import certify as certify_module
from xfrustum.reference.certify import processors
from xfrustum.reference.devices import dr_jit
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.film_shifts import film_shifts
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.shading.environment import Surroundings
from xfrustum.reference.shading.textures import Textures
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, HogelImage, Scene, Screen
from xfrustum.scenes.appearance.light import Environment
from xfrustum.scenes.plate.double_frustum import Cull, Pivot

needs_llvm = pytest.mark.skipif(not processors.compiled(), reason="there is no LLVM for Dr.Jit here")
pytestmark = needs_llvm

SINGLE_UNIT = 2.0**-23
"""One unit in the last place of a float32, relative to its size, at most."""

FRUSTA = (
    Frustum(resolution=(12, 9), reach=(12.0, 9.0), fov=(math.radians(70), math.radians(50))),
    Frustum(resolution=(9, 12), reach=(9.0, 12.0), screen=Screen(height=5.0, center=(2, -1), size=(9, 7))),
)


MODELS = (
    DoubleFrustum(near=2.0),
    DoubleFrustum(near=1e-6, pivot=Pivot.CAMERA, fit=30.0),
    DoubleFrustum(near=2.0, slabs=(5.0, 20.0), cull=Cull.BACK),
)
"""Settings whose cameras share lines, have lines of their own, and are more than two."""


@contextmanager
def without_llvm() -> Iterator[None]:
    """Let everything that is certified and made be certified and made in NumPy."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (processors, pictures_module, truth_module, certify_module):
            patch.setattr(module, "compiled", lambda: False)
        yield


def both(scene: Scene, aperture: Aperture) -> tuple[HogelImage, HogelImage]:
    """Return the truth compiled, and the truth in NumPy."""
    compiled = Reference(scene).trace(aperture)
    with without_llvm():
        return compiled, Reference(scene).trace(aperture)


def assert_alike(one: HogelImage, other: HogelImage) -> None:
    for name in ("triangle", "object", "certainty", "position", "normal"):
        a, b = getattr(one, name), getattr(other, name)
        assert a.dtype == b.dtype and a.shape == b.shape
        np.testing.assert_array_equal(a, b, err_msg=name)
    assert one.companions is not None and other.companions is not None
    assert set(map(tuple, one.companions.tolist())) == set(map(tuple, other.companions.tolist()))
    assert one.color is not None and other.color is not None
    assert one.color.dtype == other.color.dtype == np.float32
    np.testing.assert_allclose(one.color, other.color, rtol=SINGLE_UNIT, atol=0)


@pytest.mark.parametrize("name", ["car", "crossing"])
def test_several_threads_make_the_bits_of_one(name: str) -> None:
    """Kernels write by atomic operations in any order; what is decided does not depend on it."""
    scene = view(name, (128, 96))
    aperture = scene.plate.aperture(38, 31)
    with threads(1):
        alone = Reference(scene).trace(aperture)
    with threads(4):
        for _ in range(3):
            assert_alike(Reference(scene).trace(aperture), alone)


GRID = st.integers(-6, 6).map(lambda step: step / 2)


@settings(max_examples=40)
@given(
    corners=st.lists(st.lists(st.tuples(GRID, GRID, GRID), min_size=3, max_size=3), min_size=1, max_size=12),
    x=GRID,
    y=GRID,
    frustum=st.sampled_from(FRUSTA),
)
def test_triangles_on_a_grid_are_decided_and_shown_alike(
    corners: list[list[tuple[float, float, float]]], x: float, y: float, frustum: Frustum
) -> None:
    """Triangles of which many coincide, lie in the plate, contain the aperture, are flat or seen edge-on."""
    assert_alike(*both(soup(np.array(corners), frustum), at(x, y)))


@pytest.mark.parametrize("name", ["crossing", "asymmetric-recentered"])
def test_surfaces_with_every_attribute_have_the_same_light(name: str) -> None:
    """Smooth normals with gaps, vertex colors, two textures a part, three lights and an environment."""
    scene = dressed_scene(name, (24, 20))
    compiled, plain = both(scene, scene.plate.aperture(40, 20))
    assert compiled.covered.sum() > 30
    assert_alike(compiled, plain)


def test_so_have_gray_ones_and_a_scene_without_any() -> None:
    for name in ("car-recentered", "empty"):
        scene = view(name, (20, 16))
        assert_alike(*both(scene, scene.plate.corners[0]))


@pytest.mark.parametrize("settings", MODELS)
def test_models_without_light_have_the_same_bits(settings: DoubleFrustum) -> None:
    scene = view("asymmetric-recentered", (24, 20))
    aperture = scene.plate.corners[0]
    compiled = Reference(scene).trace_model(aperture, settings, shaded=False)
    with without_llvm():
        plain = Reference(scene).trace_model(aperture, settings, shaded=False)
    assert compiled.covered.any()
    for name in ("triangle", "object", "certainty", "position"):
        np.testing.assert_array_equal(getattr(compiled, name), getattr(plain, name), err_msg=name)
    assert compiled.companions is not None and plain.companions is not None
    assert set(map(tuple, compiled.companions.tolist())) == set(map(tuple, plain.companions.tolist()))


def test_images_in_bands_have_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = view("crossing", (20, 30))
    whole = Reference(scene).trace(scene.plate.middle)
    monkeypatch.setattr("xfrustum.reference.devices.bands.WHOLE_PIXELS", 20 * 7)
    assert_alike(Reference(scene).trace(scene.plate.middle), whole)


@pytest.fixture(scope="module")
def jit() -> Any:
    """The module of Dr.Jit's arithmetic, which needs the LLVM that `compiled` has chosen."""
    return import_module("xfrustum.reference.devices.arithmetic_jit")


@pytest.mark.parametrize("exponent", [0.0, 1.0, 7.0, 50.0, 1000.0, 3e4, 2.5, 333.25])
def test_powers_are_those_of_numpy_down_to_nothing(jit: Any, exponent: float) -> None:
    """Near 2^-1023 Dr.Jit's own power is minus infinity."""
    base = np.concatenate(
        (np.linspace(0.0, 1.0, 3001), 2.0 ** (-np.arange(990, 1080) / max(exponent, 1.0)), [-0.5])
    )
    where = base > 0
    digits = int(exponent).bit_length() if exponent.is_integer() else None
    expected = NUMPY.power(base, exponent, where, digits)

    (raised,) = jit.JIT.constants([exponent])
    found = jit.JIT.power(jit.on_device(base), raised, jit.on_device(where), digits).numpy()
    # What is smaller than a float32 can hold is nothing in an image.
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=2.0**-900)


def test_nothing_is_looked_up_outside_a_picture_whatever_the_place(jit: Any) -> None:
    """Places that are not numbers, as behind pixels that show nothing, must not be read from memory."""
    random = np.random.default_rng(2)
    pictures = tuple(random.integers(0, 256, (*size, 4)).astype(np.uint8) for size in ((5, 9), (16, 4)))
    numbers = np.array([1, -1, 0], dtype=np.int32)
    u = np.array([np.nan, np.inf, -np.inf, 1e300, -1e17, 0.999999, -3.2, 1e9 + 0.25])
    triangle = np.arange(len(u)) % 3
    with np.errstate(invalid="ignore"):
        plain = Textures(NUMPY, pictures, numbers).color(triangle, (u, u[::-1]))

    places = jit.on_device(u), jit.on_device(u[::-1])
    compiled = Textures(jit.JIT, pictures, numbers).color(jit.on_device(triangle), places)
    known = np.isfinite(u) & np.isfinite(u[::-1])
    assert known.sum() >= 2
    for a, b in zip(plain, compiled, strict=True):
        np.testing.assert_allclose(np.asarray(b)[known], a[known], rtol=1e-12)
    sky = Environment(radiance=random.uniform(0, 2, (7, 12, 3)).astype(np.float32))
    nowhere = jit.on_device(np.array([np.nan, np.inf, 0.0]))
    for channel in Surroundings(jit.JIT, sky).radiance([nowhere, nowhere, nowhere]):
        assert len(np.asarray(channel)) == 3


@pytest.mark.parametrize("threads", [1, 3])
def test_the_environment_bounds_the_threads_of_compiled_truths(threads: int) -> None:
    # No tracer is asked, and so nothing but the choice of the processor says it to Dr.Jit.
    program = """
from dataclasses import replace
import drjit
from xfrustum.reference import Reference
from xfrustum.scenes import open_scene
scene = open_scene("asymmetric")
scene = replace(scene, frustum=replace(scene.frustum, resolution=(8, 8)))
Reference(scene).trace(scene.plate.middle)
print(drjit.thread_count())
"""
    environment = {**os.environ, "XFRUSTUM_THREADS": str(threads)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == threads


def test_kernels_are_kept_to_one_thread_by_as_many_as_ask_for_it() -> None:
    drjit = import_module("drjit")
    with threads(3):
        with processors.kernels_on_one_thread(processors.MAX_SHORT_PIXELS + 1):
            assert drjit.thread_count() == 3
        with processors.kernels_on_one_thread(1):
            with processors.kernels_on_one_thread(1):
                assert drjit.thread_count() == 1
            assert drjit.thread_count() == 1
        assert drjit.thread_count() == 3


def test_nobody_changes_the_number_of_threads_while_kernels_are_recorded_or_run() -> None:
    drjit = import_module("drjit")
    strict_jit = import_module("xfrustum.reference.devices.strict_jit")
    inside, left = threading.Event(), threading.Event()

    def ask() -> None:
        with processors.kernels_on_one_thread(1):
            inside.set()
            left.wait()

    with threads(2):
        with strict_jit.strict_arithmetic():
            asking = threading.Thread(target=ask)
            asking.start()
            # Nothing keeps a wrong program from going on in this time.
            assert not inside.wait(0.2) and drjit.thread_count() == 2
        assert inside.wait(60) and drjit.thread_count() == 1
        with strict_jit.strict_arithmetic():
            left.set()
            asking.join(0.2)
            assert asking.is_alive() and drjit.thread_count() == 1
        asking.join(60)
        assert drjit.thread_count() == 2


def test_the_threads_are_bounded_once_and_not_whenever_mitsuba_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drjit = import_module("drjit")
    not_yet_bounded = cache(dr_jit._limit_threads_to.__wrapped__)
    monkeypatch.setattr(dr_jit, "_limit_threads_to", not_yet_bounded)
    monkeypatch.setenv("XFRUSTUM_THREADS", "2")
    with threads(3):
        dr_jit.limit_threads()
        assert drjit.thread_count() == 2
        with processors.kernels_on_one_thread(1):
            dr_jit.limit_threads()
            assert drjit.thread_count() == 1
        assert drjit.thread_count() == 2


def test_single_precision_below_its_full_precision_is_no_zero_on_any_thread() -> None:
    # Some of Dr.Jit's threads take such numbers for zero. A point so near the plate is off it all the same.
    if not processors.compiled():
        pytest.skip("needs LLVM for Dr.Jit")
    pencil = crossed_frustum(view("crossing").frustum, view("crossing").plate.middle)
    width, height = 1024, 512
    pencil = replace(pencil, resolution=(width, height))
    position = np.full((height, width, 3), 1e-40, dtype=np.float32)
    found = []
    for count in (1, 2):
        with threads(count):
            found.append(film_shifts(position, pencil))
    np.testing.assert_array_equal(found[0], found[1])
    assert np.isfinite(found[0]).all()


@pytest.mark.parametrize("width", [49, 98, 103])
def test_shifts_are_those_of_numpy_where_products_with_the_reciprocal_of_the_width_are_rounded(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = view("crossing", (width, 24))
    aperture = scene.plate.middle
    position = Reference(scene).trace(aperture, colored=False).position
    pencil = crossed_frustum(scene.frustum, aperture)
    found = film_shifts(position, pencil)
    monkeypatch.setattr(shifts_module, "compiled", lambda: False)
    np.testing.assert_array_equal(found, film_shifts(position, pencil))
