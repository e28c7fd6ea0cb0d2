"""Images of a renderer with a defect: quantized colors, normals, changed scenes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.support.foreign_renderers import oblong
from xfrustum.compare.renderer_model.drawn_model import Normals, RendererModel
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    colored,
    drawn_scene,
    trace_drawn,
)
from xfrustum.reference import Reference
from xfrustum.scenes.appearance import Material
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.pictures import Transfer
from xfrustum.scenes.representation import decoding_curve, encoding_curve


def twice(radiance: Floats) -> Floats:
    return np.asarray(encoding_curve(encoding_curve(radiance)))


@pytest.mark.parametrize(
    ("transfer", "written"), [(Transfer.DECODED, decoding_curve), (Transfer.TWICE, twice)]
)
def test_a_level_of_the_file_bounds_the_rounding(
    transfer: Transfer, written: Callable[[Floats], Floats]
) -> None:
    radiance = np.linspace(0, 1, 10_001)
    levels = (np.rint(255 * written(radiance)) / 255).astype(np.float32)
    lost, step = np.abs(transfer.linear(levels) - radiance), transfer.step(levels)
    assert (lost <= step).all()
    assert lost.max() > 0.4 * step.max(), "the bound is far from what is lost"
    assert (lost > COLOR_TOLERANCE).any()


def test_inverted_normals_are_lit_as_by_reversed_lights_where_nothing_is_glossy() -> None:
    plain = oblong()
    objects = tuple(replace(part, material="dull") for part in plain.objects)
    dull = replace(plain.appearance, materials={"dull": Material()})
    reversed_lights = tuple(
        replace(entry, direction=(-x, -y, -z))
        for entry, (x, y, z) in ((of, of.direction) for of in dull.lights)
    )
    scene = replace(plain, objects=objects, appearance=dull)
    turned = replace(scene, appearance=replace(dull, lights=reversed_lights))
    answer = trace_drawn(Reference(scene), RendererModel(), scene.plate.middle)
    inverted = colored(scene, RendererModel(normals=Normals.INVERTED), answer)
    expected = colored(turned, RendererModel(), answer)
    assert (
        inverted.color is not None and expected.color is not None and np.ptp(inverted.color) > 0.3
    )
    np.testing.assert_allclose(inverted.color, expected.color, atol=1e-6)


def test_changes_keep_numbers_and_leave_the_scene_as_it_is() -> None:
    reference = Reference(oblong())
    scene, before = reference.scene, reference.scene.vertices.copy()
    other = drawn_scene(reference, RendererModel(axes="x, y, -z", missing=(1,))).scene
    assert (other.faces == scene.faces).all() and (scene.vertices == before).all()
    assert np.allclose(other.objects[0].vertices, scene.objects[0].vertices * (1, 1, -1))
    assert other.objects[1].vertices[:, 2].max() < -max(scene.frustum.reach)
    assert drawn_scene(reference, RendererModel()) is reference
