"""Many hogels drawn and judged at once: the numbers that each has alone, in order, and threads that
end.
"""

import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest

from tests.support.images import assert_same
from tests.support.views import view
from xfrustum import Evaluator, JudgedHogel
from xfrustum.compare import run
from xfrustum.compare.attribution.budget import make_budget
from xfrustum.compare.metrics.comparison import Comparison, compare_images
from xfrustum.compare.prediction.chain import make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Aperture, DepthFormat, DoubleFrustum, InputError, Scene
from xfrustum.scenes.appearance.sampling import Sampling

FILM = (32, 24)
INDICES = [(40, 30), (0, 0), (80, 60), (29, 12), (40, 30), (3, 55), (41, 30)]
SETTINGS = (
    DoubleFrustum(near=2.0),
    DoubleFrustum(near=0.02, depth=DepthFormat.D16),
    DoubleFrustum(near=0.02),
    DoubleFrustum(near=2.0),
)


def apertures_of(scene: Scene, indices: list[tuple[int, int]] = INDICES) -> list[Aperture]:
    return [scene.plate.aperture(*index) for index in indices]


def threads() -> set[str]:
    """Names of the threads of judges that run now."""
    names = {thread.name for thread in threading.enumerate()}
    return {name for name in names if name.startswith("judging")}


def endless(scene: Scene) -> Iterator[Aperture]:
    while True:
        yield scene.plate.middle


@pytest.mark.parametrize("name", ["asymmetric-recentered", "grating"])
def test_a_stream_finds_what_judging_each_hogel_alone_finds(name: str) -> None:
    """Equal to the last bit, whatever ran at the same time; `grating` has colors to compare."""
    scene = replace(view(name, FILM), sampling=Sampling())
    shaded = name == "grating"
    apertures = apertures_of(scene)[:4]
    with Evaluator(scene) as judge:
        hogels = list(judge.stream(iter(apertures), SETTINGS, images=True))
        bare = list(judge.stream(apertures, SETTINGS))
    assert [hogel.aperture for hogel in hogels] == apertures
    assert all(hogel.truth is None for hogel in bare)
    reference = Reference(scene)
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


def test_causes_are_those_of_a_budget_made_for_each_drawing() -> None:
    scene = view("asymmetric-recentered", FILM)
    apertures = apertures_of(scene)[:2]
    with Evaluator(scene) as judge:
        hogels = list(judge.stream(apertures, SETTINGS, causes=True))
    reference = Reference(scene)
    wrong = 0
    with Rasterizer(scene) as rasterizer:
        for hogel in hogels:
            for drawing in hogel.drawings:
                budget = make_budget(
                    reference, make_chain(reference, rasterizer, hogel.aperture, drawing.settings)
                )
                assert drawing.causes == budget.causes
                assert drawing.unexplained == int(budget.explanation.unexplained.sum())
                wrong += sum(cause.surface for cause in drawing.causes or ())
    assert wrong


def test_closing_a_stream_ends_its_threads() -> None:
    scene = view("asymmetric", (16, 16))
    with Evaluator(scene) as judge:
        stream = judge.stream(endless(scene), SETTINGS, causes=True)
        assert isinstance(next(stream), JudgedHogel)
        stream.close()  # type: ignore[attr-defined]  # it is a generator
        assert not threads()
        # The judge goes on.
        assert len(list(judge.stream([scene.plate.middle], SETTINGS))) == 1
    assert not threads()


@pytest.mark.parametrize("broken", ["draw", "trace", "aperture", "compare"])
def test_an_exception_of_any_thread_comes_to_the_caller_and_ends_all(
    broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = view("asymmetric", (16, 16))

    def fails(*_: object, **__: object) -> object:
        raise ArithmeticError(broken)

    def apertures() -> Iterator[Aperture]:
        yield scene.plate.middle
        if broken == "aperture":
            fails()
        yield from endless(scene)

    if broken == "draw":
        monkeypatch.setattr(Rasterizer, "draw", fails)
    if broken == "trace":
        monkeypatch.setattr(Reference, "trace", fails)
    if broken == "compare":
        monkeypatch.setattr(run, "compare_images", fails)
    with pytest.raises(ArithmeticError, match=broken), Evaluator(scene) as judge:
        list(judge.stream(apertures(), SETTINGS[:2], causes=True))
    assert not threads()


def test_settings_that_make_no_sense_are_refused_before_anything_is_drawn() -> None:
    scene = view("asymmetric", (16, 16))
    with Evaluator(scene) as judge:
        with pytest.raises(InputError, match="near"):
            judge.stream([scene.plate.middle], [DoubleFrustum(near=1e9)])
        with pytest.raises(InputError, match="nothing to judge"):
            judge.stream([scene.plate.middle], [])
    with pytest.raises(InputError, match="tracer"):
        Evaluator(scene, tracer="nobody")
    assert not threads()


def test_times_are_those_of_stages() -> None:
    scene = view("asymmetric", (16, 16))
    with Evaluator(scene) as judge:
        (plain,) = judge.stream([scene.plate.middle], SETTINGS[:1])
        (charged,) = judge.stream([scene.plate.middle], SETTINGS[:1], causes=True)
    taken = plain.drawings[0].times
    assert min(taken.trace, taken.raster, taken.compare) > 0 == taken.predict == taken.causes
    assert min(vars(charged.drawings[0].times).values()) > 0
