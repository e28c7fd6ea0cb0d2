"""Options of the command line about light: effects, numbers of samples, light transport."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import option
from xfrustum.scenes.appearance.sampling import MAX_SAMPLES

if TYPE_CHECKING:
    from xfrustum.scenes.model.effects import Effect
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum
    from xfrustum.scenes.plate.plate import Aperture

_SAMPLES = click.IntRange(1, MAX_SAMPLES)


def _samples(text: str) -> int:
    if not 1 <= int(text) <= MAX_SAMPLES:
        raise ValueError
    return int(text)


_POINTS = options.Read(
    f"N|{options.AUTO}",
    lambda text: text.lower() if text.lower() == options.AUTO else _samples(text),
    "a number of points, or auto",
)
_OF_SCENE = "  [default: the scene's]"

_OPTIONS = {
    "effects": click.option(
        "--effects",
        default="auto",
        metavar="all|auto|NAME,..",
        help="Effects that are simulated; auto: those that `explain` finds.",
    ),
    "supersample": option("--supersample", _SAMPLES, f"Points along each side of a pixel.{_OF_SCENE}"),
    "multisample": option("--multisample", _SAMPLES, f"OpenGL's own samples per pixel.{_OF_SCENE}"),
    "aperture": option(
        "--aperture-samples",
        _POINTS,
        f"Points of the aperture's area; auto: as many as `explain` asks for.{_OF_SCENE}",
    ),
    "shadows": click.option(
        "--shadows/--no-shadows", default=None, help=f"Shadows, traced by Mitsuba.{_OF_SCENE}"
    ),
    "interreflection": click.option(
        "--interreflection/--no-interreflection",
        default=None,
        help=f"Light from other surfaces, by Mitsuba.{_OF_SCENE}",
    ),
    "samples": option("--samples", click.IntRange(2), f"Light paths per pixel.{_OF_SCENE}"),
}
RASTER = ("effects", "supersample", "multisample", "aperture")
ALL = tuple(_OPTIONS)
REFERENCE = ("effects", "supersample", "aperture", "shadows", "interreflection", "samples")


def light_options(*names: str) -> Callable[[options.Command], options.Command]:
    """Return what adds some of the options; the command receives them as one `light`."""
    return options.gathered("light", Light, *(_OPTIONS[name] for name in names))


@dataclass(frozen=True, kw_only=True)
class Light:
    """Settings of light on the command line; None leaves a setting as the scene has it."""

    effects: str = "auto"
    supersample: int | None = None
    multisample: int | None = None
    aperture_samples: int | str | None = None
    shadows: bool | None = None
    interreflection: bool | None = None
    samples: int | None = None

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with these settings instead of its own; `auto` is computed, and said.

        Raises
        ------
        click.UsageError
            Light paths are asked for, but no light transport.
        """
        points = self.aperture_samples
        if points == options.AUTO:
            from xfrustum.compare.prediction.band_limiting import needed_sub_apertures

            points = needed_sub_apertures(scene)
            options.note(
                f"--aperture-samples {options.AUTO}: {points} points stand for the area of each hogel"
            )
        sampling = _given(supersample=self.supersample, multisample=self.multisample, aperture=points)
        transport = _given(shadows=self.shadows, interreflection=self.interreflection, samples=self.samples)
        changed = replace(
            scene,
            sampling=replace(scene.sampling, **sampling),
            transport=replace(scene.transport, **transport),
        )
        if self.samples is not None and not changed.transport.simulated:
            raise click.UsageError("--samples are light paths: ask for --shadows or --interreflection too")
        return changed

    def chosen(
        self,
        scene: Scene,
        apertures: tuple[Aperture, ...] | None = None,
        settings: DoubleFrustum | None = None,
    ) -> frozenset[Effect]:
        """Return the effects that are asked for.

        Parameters
        ----------
        apertures
            Apertures of the images; None for all of the plate.
        settings
            Settings that the images are drawn with; None where they are traced.
        """
        from xfrustum.scenes.model.effects import Question, chosen
        from xfrustum.scenes.plate.double_frustum import Camera

        question = Question(
            camera=Camera.BOTH if settings is None else settings.camera,
            apertures=apertures,
            settings=() if settings is None else (settings,),
        )
        return chosen(scene, self.effects, question=question)

    def tracer(self, scene: Scene, given: str | None) -> tuple[str, bool]:
        """Return the name of the tracer, and whether it traces light paths, which only Mitsuba does.

        Parameters
        ----------
        given
            Tracer that the command line names; None chooses one that can do what is asked for.

        Raises
        ------
        click.UsageError
            Light transport is asked for with another tracer, or without some of the effects.
        """
        if not scene.transport.simulated:
            return given or "embree", False
        insisted = bool(self.shadows or self.interreflection)
        local_effects = self.effects != "auto"
        if given == "mitsuba" or (given is None and (insisted or not local_effects)):
            if local_effects:
                raise click.UsageError(
                    "light paths have all effects: leave out --effects, or light transport"
                )
            return "mitsuba", True
        if insisted:
            raise click.UsageError(f"{given} traces no light transport; leave out --tracer {given}")
        cause = f"--tracer {given}" if given else "--effects"
        options.note(f"{cause} leaves out the scene's shadows and interreflection")
        return given or "embree", False


def _given(**settings: Any) -> dict[str, Any]:
    """Return the settings that are not None."""
    return {name: value for name, value in settings.items() if value is not None}
