"""The contestants in a race against size: rasterizer and tracers, each loaded and set up by itself."""

# ruff: noqa: PLC0415 - a process loads what its one contestant uses: its memory is what is measured

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from types import MappingProxyType

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

RELATIVE_NEAR = 1e-3
"""The step back from the plate, as a fraction of the reach."""

RASTER, PLATE = "raster", "plate"
EMBREE, MITSUBA = "embree", "mitsuba"
CERTIFIED, TRUTH, STREAM = "certified", "truth", "stream"

TRIANGLES, PIXELS, APERTURES = "triangles", "pixels", "apertures"


class UnavailableError(Exception):
    """A contestant does not run here, for the reason given."""


@dataclass(frozen=True, kw_only=True)
class Running:
    """A contestant that is set up.

    Attributes
    ----------
    pictures
        Makes the images of all apertures, and keeps none.
    made_of
        Names and versions of what it runs on.
    """

    pictures: Callable[[], None]
    made_of: dict[str, str]


SetUp = Callable[[Scene, Sequence[Aperture]], AbstractContextManager[Running]]
"""Builds and uploads what is done once for a scene; leaving it frees that."""


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """One way to answer for a scene.

    Attributes
    ----------
    meaning
        What it answers with, in words.
    axes
        Axes along which it is measured.
    load
        Imports what it uses, and returns how it is set up.
    """

    meaning: str
    axes: tuple[str, ...]
    load: Callable[[], SetUp]


def _settings(scene: Scene) -> DoubleFrustum:
    return DoubleFrustum(near=RELATIVE_NEAR * scene.frustum.longest_reach)


def _exhaust(images: Iterable[object]) -> None:
    deque(images, maxlen=0)


def _load_raster() -> SetUp:
    from xfrustum.raster import Rasterizer

    @contextmanager
    def set_up(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[Running]:
        settings = _settings(scene)
        with Rasterizer(scene) as rasterizer:
            yield Running(
                pictures=lambda: _exhaust(rasterizer.render(one, settings) for one in apertures),
                made_of={"OpenGL": rasterizer.device["renderer"]},
            )

    return set_up


def _load_plate() -> SetUp:
    import xfrustum.raster  # noqa: F401 - chooses PyOpenGL's platform
    from xfrustum.raster.plate.renderer import PlateRenderer

    @contextmanager
    def set_up(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[Running]:
        with PlateRenderer(scene, _settings(scene)) as renderer:
            yield Running(
                pictures=lambda: _exhaust(renderer.hogels(apertures)),
                made_of={"OpenGL": renderer.device["renderer"]},
            )

    return set_up


def _load_tracer(name: str) -> SetUp:
    from xfrustum.reference import Reference

    if name == MITSUBA:
        from xfrustum.reference.devices.dr_jit import backend

        if backend().scalar:
            raise UnavailableError("there is only Mitsuba's scalar variant here, one ray at a time")

    @contextmanager
    def set_up(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[Running]:
        reference = Reference(scene, tracer=name)
        yield Running(
            pictures=lambda: _exhaust(reference.propose(one) for one in apertures),
            made_of=reference.versions,
        )

    return set_up


def _load_certified() -> SetUp:
    from xfrustum.reference import Reference

    _load_compiler()

    @contextmanager
    def set_up(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[Running]:
        reference = Reference(scene)
        yield Running(
            pictures=lambda: _exhaust(band for one in apertures for band in reference.decide(one)),
            made_of={},
        )

    return set_up


def _load_truth(*, streamed: bool = False) -> SetUp:
    from xfrustum.reference import Reference

    _load_compiler()

    @contextmanager
    def set_up(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[Running]:
        reference = Reference(scene)
        one_by_one = partial(map, reference.trace)
        images = reference.stream if streamed else one_by_one
        yield Running(pictures=lambda: _exhaust(images(apertures)), made_of=reference.versions)

    return set_up


def _load_compiler() -> None:
    """Import what the narrow phase would import at its first picture."""
    from xfrustum.reference.certify.processors import compiled

    if compiled():
        import_module("xfrustum.reference.certify.narrow_jit")


_ONE_PICTURE = (TRIANGLES, PIXELS)
_ALL = (*_ONE_PICTURE, APERTURES)

CONTESTANTS: MappingProxyType[str, Contestant] = MappingProxyType(
    {
        RASTER: Contestant(
            meaning="Rasterizer: number, point, normal and color of every pixel, read back",
            axes=_ONE_PICTURE,
            load=_load_raster,
        ),
        PLATE: Contestant(
            meaning="PlateRenderer: many hogels a submission, number and color read back",
            axes=(APERTURES,),
            load=_load_plate,
        ),
        EMBREE: Contestant(
            meaning="Embree alone: number, point, normal and color of every pixel, nothing proven",
            axes=_ALL,
            load=lambda: _load_tracer(EMBREE),
        ),
        MITSUBA: Contestant(meaning="Mitsuba alone: the same", axes=_ALL, load=lambda: _load_tracer(MITSUBA)),
        CERTIFIED: Contestant(
            meaning="the certified decision alone: number, place along the line and certainty",
            axes=_ALL,
            load=_load_certified,
        ),
        TRUTH: Contestant(
            meaning="the whole certified image: also points, normals, colors, Embree's second opinion",
            axes=_ALL,
            load=_load_truth,
        ),
        STREAM: Contestant(
            meaning="the same images in one stream, what belongs to the plate done once",
            axes=(APERTURES,),
            load=lambda: _load_truth(streamed=True),
        ),
    }
)
"""In the order in which they are listed."""

RASTERIZERS = (RASTER, PLATE)


def contestants_along(axis: str) -> list[str]:
    """Return the names of those that are measured along an axis.

    Raises
    ------
    InputError
        There is no such axis.
    """
    if axis not in _ALL:
        raise InputError(f"there is no axis {axis!r}; there are {', '.join(_ALL)}")
    return [name for name, one in CONTESTANTS.items() if axis in one.axes]
