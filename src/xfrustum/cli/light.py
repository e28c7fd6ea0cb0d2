"""Options of the command line about light: effects, numbers of samples, light transport."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import Asked, flag, option, present
from xfrustum.scenes.appearance import MAX_SAMPLES

if TYPE_CHECKING:
    from xfrustum.scenes.model.effects import Effect
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate import Aperture, DoubleFrustum

_SAMPLES = click.IntRange(1, MAX_SAMPLES)


def _points(text: str) -> int | float:
    """Return a number of points, or a largest error below one for a share such as 5%."""
    if text.endswith("%"):
        # The type distinguishes the meanings: a float is an error, an integer a number of points.
        return float(options.BELOW_1.read(str(float(text[:-1]) / 100)))
    return int(options.number(text, int, 1, MAX_SAMPLES + 1))


_POINTS = options.or_auto(options.Read("N|P%", _points, "a number of points, a share such as 5%"))

_OF_SCENE = "  [default: the scene's]"

RASTER = ("effects", "supersample", "multisample", "aperture_samples")
BUDGET = ("supersample", "aperture_samples", "shadows", "interreflection", "samples", "multisample")
REFERENCE = ("effects", *BUDGET[:-1])
ALL = (*RASTER, "shadows", "interreflection", "samples")


class Light(Asked):
    """Settings of light on the command line; None: the setting of the scene."""

    effects = option(
        options.Read("all|auto|NAME,..", str, ""),
        "Effects to simulate; auto: the effects that `check` lists.",
        default="auto",
    )
    supersample = option(_SAMPLES, f"Sample points along each side of a pixel.{_OF_SCENE}")
    multisample = option(_SAMPLES, f"Multisampling by OpenGL, samples per pixel.{_OF_SCENE}")
    aperture_samples = option(
        _POINTS,
        f"Sample points of an aperture; P%: error of edges at most P%; auto: 1/255.{_OF_SCENE}",
    )
    shadows = flag(
        f"Simulate shadows: exactly, or with --interreflection by Mitsuba.{_OF_SCENE}",
        "--shadows/--no-shadows",
        default=None,
    )
    interreflection = flag(
        f"Simulate light from other surfaces, by Mitsuba.{_OF_SCENE}",
        "--interreflection/--no-interreflection",
        default=None,
    )
    samples = option(click.IntRange(2), f"Light paths per pixel.{_OF_SCENE}")

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with these settings; `auto` is computed and printed."""
        points = self.aperture_samples
        if points == options.AUTO or isinstance(points, float):
            from xfrustum.compare.prediction.band_limiting import LEVEL, needed_sub_apertures

            error = LEVEL if points == options.AUTO else points
            amount = points if points == options.AUTO else f"{100 * points:g}%"
            # Computed before drawing starts: the bound needs only the scene's depth.
            points = needed_sub_apertures(scene, error=error)
            options.note(
                f"--aperture-samples {amount}: {points} points stand for the area of each hogel"
            )
        sampling = present(
            supersample=self.supersample, multisample=self.multisample, aperture=points
        )
        transport = present(
            shadows=self.shadows, interreflection=self.interreflection, samples=self.samples
        )
        changed = replace(
            scene,
            sampling=replace(scene.sampling, **sampling),
            transport=replace(scene.transport, **transport),
        )
        # --samples has no effect without simulated transport.
        if self.samples is not None and not changed.transport.simulated:
            raise click.UsageError("--samples are light paths: add --shadows or --interreflection")
        return changed

    def chosen(
        self,
        scene: Scene,
        apertures: tuple[Aperture, ...] | None = None,
        drawn: DoubleFrustum | None = None,
    ) -> frozenset[Effect]:
        """Return the effects of images at some apertures (None: all), drawn or traced."""
        from xfrustum.scenes.model.effects import Question, chosen
        from xfrustum.scenes.plate import Camera

        # Effects of surfaces that this drawing cannot show are left out.
        camera, settings = (Camera.BOTH, ()) if drawn is None else (drawn.camera, (drawn,))
        question = Question(camera=camera, apertures=apertures, settings=settings)
        return chosen(scene, self.effects, question=question)

    def tracer(self, scene: Scene, named: str | None) -> tuple[str, bool]:
        """Return the tracer's name, and whether it traces light paths; UsageError if it cannot."""
        if not scene.transport.simulated:
            return named or "embree", False
        # Options must be obeyed or refused; settings of the scene may be dropped with a note.
        insisted = bool(self.shadows or self.interreflection)
        local_effects = self.effects != "auto"
        if named == "mitsuba" or (named is None and (insisted or not local_effects)):
            if local_effects:
                words = "light paths have all effects: leave out --effects, or light transport"
                raise click.UsageError(words)
            return "mitsuba", True
        if insisted:
            raise click.UsageError(f"{named} traces no light transport; leave out --tracer {named}")
        cause = f"--tracer {named}" if named else "--effects"
        options.note(f"{cause} leaves out the scene's shadows and interreflection")
        return named or "embree", False


def light_options(*names: str) -> Any:
    """Return some of the options as one Light; all other options are None."""
    own = {name: vars(Light)[name] for name in names}
    # A command without an option reads None, as if the user had left it out.
    return options.group(lambda **stated: Light(**(dict.fromkeys(ALL) | stated)), **own)
