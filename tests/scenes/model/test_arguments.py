"""Invalid arguments are refused at once, with one line that names them."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import xfrustum
from xfrustum import DepthFormat, DepthMapping, DoubleFrustum, Fit, InputError, Pivot, Requirement
from xfrustum.scenes import Aperture, Frustum, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.appearance import DirectionalLight, Environment, Material, Sampling, Transport
from xfrustum.scenes.model.images import PlateContent

NONSENSE: tuple[Any, ...] = (
    *("banana", b"1", "1", None, True, math.nan, math.inf, -math.inf, -1.0, [], {}, object()),
    *((1.0,), (1.0, math.nan), ("a", "b"), (1, 2, 3, 4), np.nan),
)
"""Values that are neither a positive number nor a pair, a triple or a name."""

PLATE = Plate(size=(8, 6), hogels=(3, 3))
FRUSTUM = Frustum(resolution=(8, 6), reach=(10, 20), fov=(1.0, 1.0))
SHEET = SceneObject(name="sheet", vertices=np.eye(3), faces=np.array([[0, 1, 2]]))

#: Classes, valid arguments, and names of fields that reject all values of `NONSENSE`
MAKERS: tuple[tuple[Callable[..., object], dict[str, Any], str], ...] = (
    (DoubleFrustum, {"near": 0.1}, "near depth mapping camera pivot offset slabs"),
    (Frustum, vars(FRUSTUM), "resolution reach fov screen"),
    (Screen, {"height": 10.0, "center": (0.0, 0.0), "size": (5.0, 5.0)}, "center size"),
    (Plate, vars(PLATE), "size hogels"),
    (Aperture, {"column": 0, "row": 0, "x": 0.0, "y": 0.0}, "column row"),
    (Sampling, {}, "supersample multisample aperture"),
    (Transport, {}, "samples"),
    (Material, {}, "ambient diffuse specular exponent reflectivity"),
    (DirectionalLight, {"direction": (0.0, 0.0, 1.0)}, "direction color"),
    (Environment, {"radiance": np.ones((2, 4, 3))}, "radiance strength"),
    (Requirement, {}, "tolerance_px max_wrong"),
    (SceneObject, vars(SHEET), "vertices faces"),
    (
        Scene,
        {"name": "s", "plate": PLATE, "frustum": FRUSTUM, "objects": (SHEET,)},
        "plate frustum appearance sampling transport",
    ),
)
#: Values that are valid for these fields but nonsense for all others
MEANT: dict[str, Callable[[Any], bool]] = {
    "slabs": lambda value: value in ([], {}) or value in ((1.0,), (1, 2, 3, 4)),
    "screen": lambda value: value is None,
}


@pytest.mark.parametrize(("make", "good", "names"), MAKERS)
def test_every_field_refuses_meaningless_values(
    make: Callable[..., object], good: dict[str, Any], names: str
) -> None:
    make(**good)
    for name, value in itertools.product(names.split(), NONSENSE):
        if not (name in MEANT and MEANT[name](value)):
            with pytest.raises(InputError) as refused:
                make(**{**good, name: value})
                pytest.fail(f"{name} took {value!r}")
            assert "\n" not in str(refused.value)


WRONG: dict[str, tuple[type, str, tuple[Any, ...]]] = {
    "fit must be angle, screen, or a positive height": (
        DoubleFrustum, "fit", ("banana", True, math.nan, math.inf, 0, -1.0, (1.0,), object())),
    "aperture must be a count between 1 and": (Sampling, "aperture", (0, 1 << 17)),
    "samples must be a count between 2 and": (Transport, "samples", (1, 1 << 17)),
    "shadows must be True or False": (Transport, "shadows", ("banana", "True", 1, 0, None, 2.5)),
    "ascending": (DoubleFrustum, "slabs",
                  ((2.0, 1.0), (1.0, 1.0), (0.0, 1.0), (-1.0,), (1.0, math.inf), "12", 3.0)),
}  # fmt: skip


@pytest.mark.parametrize("message", WRONG)
def test_errors_state_the_valid_values(message: str) -> None:
    make, name, values = WRONG[message]
    for value in values:
        with pytest.raises(InputError, match=message):
            make(**{"near": 0.1} if make is DoubleFrustum else {}, **{name: value})


def test_names_are_accepted_as_on_the_command_line_and_refused_with_valid_ones() -> None:
    """A name equals the member of its enumeration; drawing code uses only members."""
    names: Any = {"depth": "d32f", "mapping": "reversed", "pivot": "camera", "fit": "screen"}
    named = DoubleFrustum(near=0.1, **names)
    assert (named.depth, named.mapping) == (DepthFormat.D32F, DepthMapping.REVERSED)
    assert named.fit == Fit.SCREEN and named.pivot is Pivot.CAMERA
    with pytest.raises(InputError, match="pivot must be one of aperture, camera, not 'banana'"):
        DoubleFrustum(near=0.1, pivot="banana")  # type: ignore[arg-type]  # deliberately wrong


def test_counts_are_not_cut_down_to_whole_numbers() -> None:
    for pair in ((8.5, 6), (8.0, 6.0), (0, 6), (-1, 6)):
        with pytest.raises(InputError, match=r"frustum\.resolution"):
            Frustum(resolution=pair, reach=(1, 1), fov=(1, 1))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="faces must be whole numbers"):
        SceneObject(name="s", vertices=np.eye(3), faces=np.array([[0, 1, 2.5]]))


SCENE = Scene(name="s", plate=PLATE, frustum=FRUSTUM, objects=(SHEET,))


@pytest.mark.parametrize(
    ("call", "arguments", "options"),
    [
        (xfrustum.open_scene, [3], {}),
        (PLATE.aperture, [0.5, 0], {}),
        (xfrustum.Reference, ["banana"], {}),
        (xfrustum.Reference, [SCENE], {"tracer": "banana"}),
        (xfrustum.Reference, [SCENE], {"effects": "banana"}),
        (xfrustum.Reference(SCENE).trace, [(1, 1)], {}),
        (xfrustum.Rasterizer, [SCENE], {"effects": frozenset({"banana"})}),
        (xfrustum.budget, [SCENE, "banana"], {}),
        (xfrustum.plan, [SCENE], {"requirement": "banana"}),
        (xfrustum.cost, [SCENE], {"tolerance_px": math.inf}),
        (xfrustum.cost, [SCENE], {"repeat": 1.5}),
        (PlateContent, [], {"color": "banana"}),
        (PlateContent, [], {"ids": "banana"}),
    ],
)
def test_functions_refuse_meaningless_arguments_too(
    call: Callable[..., object], arguments: list[Any], options: dict[str, Any]
) -> None:
    with pytest.raises(InputError):
        call(*arguments, **options)
