"""Arguments that cannot be meant are refused where they are given, with one line that names them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import xfrustum
from xfrustum import DepthFormat, DepthMapping, DoubleFrustum, Fit, InputError, Pivot, Requirement
from xfrustum.scenes import Aperture, Camera, Frustum, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.appearance.appearance import Appearance, DirectionalLight, Environment, Material
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.plate_content import PlateContent

NONSENSE: tuple[Any, ...] = (
    *("banana", b"1", "1", None, True, math.nan, math.inf, -math.inf, -1.0, [], {}, object()),
    *((1.0,), (1.0, math.nan), ("a", "b"), (1, 2, 3, 4), np.nan),
)
"""Values that are neither a positive number nor a pair nor a triple nor a name."""

PLATE = Plate(size=(8, 6), hogels=(3, 3))
FRUSTUM = Frustum(resolution=(8, 6), reach=(10, 20), fov=(1.0, 1.0))
SHEET = SceneObject(name="sheet", vertices=np.eye(3), faces=np.array([[0, 1, 2]]))

MAKERS: dict[str, tuple[Callable[..., object], dict[str, Any]]] = {
    "DoubleFrustum": (DoubleFrustum, {"near": 0.1}),
    "Frustum": (Frustum, {"resolution": (8, 6), "reach": (10.0, 20.0), "fov": (1.0, 1.0)}),
    "Screen": (Screen, {"height": 10.0, "center": (0.0, 0.0), "size": (5.0, 5.0)}),
    "Plate": (Plate, {"size": (8.0, 6.0), "hogels": (3, 3)}),
    "Aperture": (Aperture, {"column": 0, "row": 0, "x": 0.0, "y": 0.0}),
    "Sampling": (Sampling, {}),
    "Transport": (Transport, {}),
    "Material": (Material, {}),
    "DirectionalLight": (DirectionalLight, {"direction": (0.0, 0.0, 1.0)}),
    "Environment": (Environment, {"radiance": np.ones((2, 4, 3))}),
    "Requirement": (Requirement, {}),
    "Scene": (Scene, {"name": "s", "plate": PLATE, "frustum": FRUSTUM, "objects": (SHEET,)}),
    "SceneObject": (SceneObject, {"name": "s", "vertices": np.eye(3), "faces": np.array([[0, 1, 2]])}),
    "Appearance": (Appearance, {}),
}

FIELDS = [
    *(("DoubleFrustum", name) for name in ("near", "depth", "mapping", "camera", "pivot", "offset", "slabs")),
    *(("Frustum", name) for name in ("resolution", "reach", "fov", "screen")),
    *(("Screen", name) for name in ("center", "size")),
    *(("Plate", name) for name in ("size", "hogels")),
    *(("Aperture", name) for name in ("column", "row")),
    *(("Sampling", name) for name in ("supersample", "multisample", "aperture")),
    ("Transport", "samples"),
    *(("Material", name) for name in ("ambient", "diffuse", "specular", "exponent", "reflectivity")),
    *(("DirectionalLight", name) for name in ("direction", "color")),
    *(("Environment", name) for name in ("radiance", "strength")),
    *(("Requirement", name) for name in ("tolerance_px", "max_wrong")),
    *(("Scene", name) for name in ("plate", "frustum", "appearance", "sampling", "transport")),
    *(("SceneObject", name) for name in ("vertices", "faces")),
]

MEANT = {
    ("DoubleFrustum", "slabs"): lambda value: value in ([], {}) or value in ((1.0,), (1, 2, 3, 4)),
    ("Frustum", "screen"): lambda value: value is None,
}
"""Values that make sense for these fields, although they are nonsense for all others."""


@pytest.mark.parametrize(("owner", "name"), FIELDS, ids=str)
def test_no_field_takes_what_it_cannot_mean(owner: str, name: str) -> None:
    make, good = MAKERS[owner]
    make(**good)
    for value in NONSENSE:
        if (owner, name) in MEANT and MEANT[owner, name](value):
            continue
        with pytest.raises(InputError) as refused:
            make(**{**good, name: value})
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("value", ["banana", True, math.nan, math.inf, 0, -1.0, (1.0,), object()])
def test_a_fit_is_a_name_or_a_positive_height(value: object) -> None:
    with pytest.raises(InputError, match="fit must be angle, screen, or a positive height"):
        DoubleFrustum(near=0.1, fit=value)  # type: ignore[arg-type]  # that is the point


@pytest.mark.parametrize("value", ["banana", "True", 1, 0, None, 2.5])
def test_a_switch_is_true_or_false(value: object) -> None:
    with pytest.raises(InputError, match="shadows must be True or False"):
        Transport(shadows=value)  # type: ignore[arg-type]  # that is the point


@pytest.mark.parametrize("slabs", [(2.0, 1.0), (1.0, 1.0), (0.0, 1.0), (-1.0,), (1.0, math.inf), "12", 3.0])
def test_slabs_are_in_ascending_order(slabs: object) -> None:
    with pytest.raises(InputError, match="ascending"):
        DoubleFrustum(near=0.1, slabs=slabs)  # type: ignore[arg-type]  # that is the point


def test_names_are_taken_as_on_the_command_line_and_refused_with_what_would_do() -> None:
    """A name is the same as the member of its enumeration: all that is drawn asks for the member."""
    names: Any = {"depth": "d32f", "mapping": "reversed", "camera": "c", "pivot": "camera", "fit": "screen"}
    named = DoubleFrustum(near=0.1, **names)
    assert (named.depth, named.mapping) == (DepthFormat.D32F, DepthMapping.REVERSED)
    assert (named.camera, named.fit) == (Camera.C, Fit.SCREEN)
    assert named.pivot is Pivot.CAMERA
    with pytest.raises(InputError, match="pivot must be one of aperture, camera, not 'banana'"):
        DoubleFrustum(near=0.1, pivot="banana")  # type: ignore[arg-type]  # that is the point


@given(near=st.floats(1e-6, 1e6), slab=st.floats(1e-3, 1e3))
def test_numbers_of_any_library_are_taken_as_pythons_own(near: float, slab: float) -> None:
    taken = DoubleFrustum(near=np.float64(near), slabs=[np.float64(slab)])  # type: ignore[arg-type]  # a list
    assert taken == DoubleFrustum(near=near, slabs=(slab,))
    assert type(taken.near) is float
    plate = Plate(size=np.array([near, slab]), hogels=np.array([3, 4]))  # type: ignore[arg-type]  # arrays
    assert plate == Plate(size=(near, slab), hogels=(3, 4))


def test_counts_are_not_cut_down_to_whole_numbers() -> None:
    for pair in ((8.5, 6), (8.0, 6.0), (0, 6), (-1, 6)):
        with pytest.raises(InputError, match=r"frustum\.resolution"):
            Frustum(resolution=pair, reach=(1, 1), fov=(1, 1))  # type: ignore[arg-type]  # that is the point
    with pytest.raises(InputError, match="faces must be whole numbers"):
        SceneObject(name="s", vertices=np.eye(3), faces=np.array([[0, 1, 2.5]]))


def test_a_material_that_is_not_there_is_refused() -> None:
    part = SceneObject(name="s", vertices=np.eye(3), faces=np.array([[0, 1, 2]]), material="gold")
    scene = Scene(name="s", plate=PLATE, frustum=FRUSTUM, objects=(part,))
    with pytest.raises(InputError, match="no material 'gold'"):
        _ = scene.materials


def test_functions_refuse_what_they_cannot_mean_too() -> None:
    scene: Any = Scene(name="s", plate=PLATE, frustum=FRUSTUM, objects=(SHEET,))
    anything: Any = "banana"
    calls: list[Callable[[], object]] = [
        lambda: xfrustum.open_scene(anything),
        lambda: xfrustum.open_scene(Path("banana")),
        lambda: xfrustum.open_scene(3),  # type: ignore[arg-type]  # that is the point
        lambda: scene.plate.aperture("a", 0),
        lambda: scene.plate.aperture(0.5, 0),
        lambda: xfrustum.Reference(anything),
        lambda: xfrustum.Reference(scene, tracer="banana"),
        lambda: xfrustum.Reference(scene, effects=anything),
        lambda: xfrustum.Reference(scene).trace((1, 1)),  # type: ignore[arg-type]  # that is the point
        lambda: xfrustum.Rasterizer(scene, effects=frozenset({"banana"})),  # type: ignore[arg-type]  # likewise
        lambda: xfrustum.budget(scene, anything),
        lambda: xfrustum.plan(scene, requirement=anything),
        lambda: xfrustum.cost(scene, tolerance_px=anything),
        lambda: xfrustum.cost(scene, tolerance_px=math.inf),
        lambda: xfrustum.cost(scene, repeat=1.5),  # type: ignore[arg-type]  # that is the point
        lambda: xfrustum.explain(scene, repeat=-1),
        lambda: xfrustum.explain(scene, tracer="banana", repeat=0),
        lambda: PlateContent(color=anything),
        lambda: PlateContent(ids=anything),
    ]
    for number, call in enumerate(calls):
        with pytest.raises(InputError):
            call()
            pytest.fail(f"call {number} took it")


def test_effects_may_be_given_by_name() -> None:
    scene = Scene(name="s", plate=PLATE, frustum=FRUSTUM, objects=(SHEET,))
    names: Any = {"c", "diffuse"}
    with xfrustum.Rasterizer(scene, effects=names) as rasterizer:
        assert rasterizer.effects == {Effect.C, Effect.DIFFUSE}
        assert all(isinstance(effect, Effect) for effect in rasterizer.effects)
