"""Judging many hogels at once gives the same numbers as judging each hogel alone, in order."""

import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest

from tests.support.images import assert_same
from tests.support.views import view
from xfrustum import Evaluator
from xfrustum.compare import run
from xfrustum.compare.attribution import make_budget
from xfrustum.compare.comparison import Comparison, compare_images
from xfrustum.compare.prediction.predict import make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Aperture, DepthFormat, DoubleFrustum, InputError
from xfrustum.scenes.appearance import Sampling

INDICES = [(40, 30), (0, 0), (80, 60), (29, 12)]
SETTINGS = (
    DoubleFrustum(near=2.0),
    DoubleFrustum(near=0.02, depth=DepthFormat.D16),
    DoubleFrustum(near=0.02),
    DoubleFrustum(near=2.0),
)


def judging_threads() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name.startswith("judging")]


@pytest.mark.parametrize("name", ["asymmetric-recentered", "grating"])
def test_a_stream_has_the_numbers_of_each_hogel_judged_alone(name: str) -> None:
    """Results are bit-identical with any number of threads; `grating` has colors to compare."""
    scene, shaded = replace(view(name, (32, 24)), sampling=Sampling()), name == "grating"
    apertures = [scene.plate.aperture(*index) for index in INDICES]
    with Evaluator(scene) as judge:
        hogels = list(judge.stream(iter(apertures), SETTINGS, images=True, causes=not shaded))
        bare = list(judge.stream(apertures, SETTINGS))
    assert [hogel.aperture for hogel in hogels] == apertures
    assert all(hogel.truth is None for hogel in bare)
    reference, wrong = Reference(scene), 0
    with Rasterizer(scene) as rasterizer:
        for hogel, numbers in zip(hogels, bare, strict=True):
            truth = reference.trace(hogel.aperture)
            assert hogel.truth is not None
            assert_same(hogel.truth, truth)
            assert [drawing.settings for drawing in hogel.drawings] == list(SETTINGS)
            for drawing, other in zip(hogel.drawings, numbers.drawings, strict=True):
                image = rasterizer.render(hogel.aperture, drawing.settings, normals=False)
                assert drawing.image is not None and isinstance(drawing.comparison, Comparison)
                assert_same(drawing.image, image)
                alone = compare_images(truth, image, reference, radiance=shaded)
                assert drawing.comparison.numbers == alone.numbers == other.comparison
                assert_same(drawing.comparison.maps, alone.maps)
                assert (alone.radiance is not None) == shaded
                times = drawing.times
                assert min(times.trace, times.raster, times.compare) > 0
                assert (times.predict > 0) == (times.causes > 0) == (drawing.causes is not None)
            for drawing in hogel.drawings[:2] if not shaded else ():
                chain = make_chain(reference, rasterizer, hogel.aperture, drawing.settings)
                budget = make_budget(reference, chain)
                assert drawing.causes == budget.causes
                assert drawing.unexplained == int(budget.explanation.unexplained.sum())
                wrong += sum(cause.surface for cause in drawing.causes or ())
    assert (wrong > 0) == (not shaded)


@pytest.mark.parametrize("broken", ["draw", "trace", "aperture", "compare"])
def test_an_exception_of_any_thread_reaches_the_caller_and_ends_all_threads(
    broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = view("asymmetric", (16, 16))

    def fails(*_: object, **__: object) -> object:
        raise ArithmeticError(broken)

    def apertures() -> Iterator[Aperture]:
        yield scene.plate.middle
        if broken == "aperture":
            fails()
        while True:
            yield scene.plate.middle

    with Evaluator(scene) as judge:
        # Closing a stream ends its threads; the judge works again afterwards.
        if broken != "aperture":
            stream = judge.stream(apertures(), SETTINGS, causes=True)
            next(stream)
            stream.close()  # type: ignore[attr-defined]  # a generator
            assert not judging_threads()
        places: dict[str, tuple[object, str]] = {
            "draw": (Rasterizer, "draw"),
            "trace": (Reference, "trace"),
            "compare": (run, "compare_images"),
        }
        if broken != "aperture":
            target, name = places[broken]
            monkeypatch.setattr(target, name, fails)
        with pytest.raises(ArithmeticError, match=broken):
            list(judge.stream(apertures(), SETTINGS[:2], causes=True))
    assert not judging_threads()


def test_settings_that_make_no_sense_are_refused_before_anything_is_drawn() -> None:
    scene = view("asymmetric", (16, 16))
    with Evaluator(scene) as judge:
        with pytest.raises(InputError, match="near"):
            judge.stream([scene.plate.middle], [DoubleFrustum(near=1e9)])
        with pytest.raises(InputError, match="nothing to judge"):
            judge.stream([scene.plate.middle], [])
    with pytest.raises(InputError, match="tracer"):
        Evaluator(scene, tracer="nobody")
    assert not judging_threads()
