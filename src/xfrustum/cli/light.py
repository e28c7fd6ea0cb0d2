"""Options of the command line about light: effects, numbers of samples, light transport."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import click

from xfrustum.cli.numbers import AUTO, Samples, SubApertures
from xfrustum.terminal import say

if TYPE_CHECKING:
    from xfrustum.scenes.model.effects import Effect
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum
    from xfrustum.scenes.plate.plate import Aperture

Command = TypeVar("Command", bound=Callable[..., Any])


def _count_option(
    flag: str, meaning: str, kind: click.ParamType[Any] | None = None
) -> Callable[[Command], Command]:
    """Return an option for a count of samples, whose default is the scene's."""
    return click.option(flag, type=kind or Samples(), help=f"{meaning}  [default: the scene's]")


_OPTIONS = {
    "effects": click.option(
        "--effects",
        default="auto",
        metavar="all|auto|NAME,..",
        help="Effects that are simulated; `explain` lists them.  [default: auto, what the scene calls for]",
    ),
    "supersample": _count_option("--supersample", "Points along each side of a pixel."),
    "multisample": _count_option("--multisample", "OpenGL's own samples per pixel."),
    "aperture": _count_option(
        "--aperture-samples",
        "Points of the aperture's area (band limiting); auto: as many as `explain` says are needed.",
        SubApertures(),
    ),
    "shadows": click.option(
        "--shadows/--no-shadows", default=None, help="Shadows, traced by Mitsuba.  [default: the scene's]"
    ),
    "interreflection": click.option(
        "--interreflection/--no-interreflection",
        default=None,
        help="Light from other surfaces, by Mitsuba.  [default: the scene's]",
    ),
    "samples": click.option(
        "--samples", type=click.IntRange(2), help="Light paths per pixel.  [default: the scene's]"
    ),
}
RASTER = ("effects", "supersample", "multisample", "aperture")
ALL = tuple(_OPTIONS)
REFERENCE = ("effects", "supersample", "aperture", "shadows", "interreflection", "samples")


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
        """Return the scene with these settings instead of its own.

        Raises
        ------
        click.UsageError
            Light paths are asked for, but no light transport.
        """
        sampling = _given(
            supersample=self.supersample, multisample=self.multisample, aperture=self._sub_apertures(scene)
        )
        transport = _given(shadows=self.shadows, interreflection=self.interreflection, samples=self.samples)
        changed = replace(
            scene,
            sampling=replace(scene.sampling, **sampling),
            transport=replace(scene.transport, **transport),
        )
        if self.samples is not None and not changed.transport.simulated:
            raise click.UsageError("--samples are light paths: ask for --shadows or --interreflection too")
        return changed

    def _sub_apertures(self, scene: Scene) -> int | None:
        """Return the count that is asked for; `auto` is computed, and said on standard error."""
        if not isinstance(self.aperture_samples, str):
            return self.aperture_samples
        from xfrustum.compare.prediction.band_limiting import needed_sub_apertures

        count = needed_sub_apertures(scene)
        say(f"note: --aperture-samples {AUTO}: {count} points stand for the area of each hogel")
        return count

    def chosen(
        self,
        scene: Scene,
        apertures: tuple[Aperture, ...] | None = None,
        settings: DoubleFrustum | None = None,
    ) -> frozenset[Effect]:
        """Return the effects that are asked for.

        Parameters
        ----------
        scene
            Scene whose images are made.
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
        scene
            Scene with these settings applied.
        given
            Tracer that the command line names; None chooses one that can do what is asked for.

        Raises
        ------
        click.UsageError
            Light transport is asked for with another tracer, or without some of the effects.
        """
        transport = scene.transport
        if not transport.simulated:
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
        say(f"note: {cause} leaves out the scene's shadows and interreflection")
        return given or "embree", False


def _given(**settings: Any) -> dict[str, Any]:
    """Return the settings that are not None."""
    return {name: value for name, value in settings.items() if value is not None}


def light_options(*names: str) -> Callable[[Command], Command]:
    """Add some of the options; the command receives them as one `light`."""

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def with_light(**options: Any) -> Any:
            given = {f.name: options.pop(f.name) for f in fields(Light) if f.name in options}
            return command(light=Light(**given), **options)

        for name in reversed(names):
            with_light = _OPTIONS[name](with_light)
        return with_light  # type: ignore[return-value]  # wraps() keeps the name, not the type

    return decorate
