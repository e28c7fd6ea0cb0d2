"""Streams of apertures, and second opinions computed on demand."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.support.images import assert_same
from tests.support.views import view
from xfrustum.reference import Reference
from xfrustum.reference.tracers import EmbreeTracer
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.model.effects import needed
from xfrustum.scenes.model.images import Rendering

APERTURES = [(40, 30), (0, 0)]


def test_a_stream_has_the_images_of_each_aperture_alone() -> None:
    scene = replace(view("grating", (24, 24)), sampling=Sampling(aperture=3))
    apertures = [scene.plate.aperture(*index) for index in APERTURES]
    reference = Reference(scene)
    for image, aperture in zip(reference.stream(apertures), apertures, strict=True):
        assert_same(image, reference.trace(aperture))
        assert image.rendering == Rendering.from_effects(needed(scene), Sampling(aperture=3))


def test_no_ray_is_traced_before_the_second_opinion_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second opinion refers to the decision, also after changes of the image or a pickle."""
    scene = view("car", (40, 30))
    reference, expected = Reference(scene), Reference(scene).trace(scene.plate.middle).overruled
    request: list[str] = []

    def built(_: Reference) -> EmbreeTracer:
        request.append("built")
        return EmbreeTracer(scene)

    monkeypatch.setattr(Reference, "tracer", property(built))
    (image,) = reference.stream([scene.plate.middle])
    changed = replace(image, triangle=image.triangle + 1)
    assert not request
    np.testing.assert_array_equal(changed.overruled, expected)
    assert request == ["built"]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(image)).overruled, expected)
