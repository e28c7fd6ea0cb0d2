"""What ray tracers in single precision show alone, unexamined, and what they would have got wrong."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from xfrustum.reference.averages import averages
from xfrustum.reference.lines.lines import crossed_frustum, model_cameras
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer
from xfrustum.reference.tracers.proposals import proposed, uncertified
from xfrustum.reference.tracers.tracer import TRACERS, Tracer
from xfrustum.reference.truth import Reference
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

CERTIFIED = "certified"  #: name of the decision that is proven for every pixel
DECISIONS = (CERTIFIED, *TRACERS)  #: names of what can decide which surface a pixel shows


class PlainReference(Reference):
    """A ray tracer of a scene, whose own pictures stand for the true ones; parameters as of `Reference`.

    Raises InputError where the scene asks for several samples a pixel, taken along certified lines
    alone.
    """

    def __init__(
        self, scene: Scene, tracer: str = "embree", effects: frozenset[Effect] | None = None
    ) -> None:
        super().__init__(scene, tracer, effects)
        if averages(scene.sampling):
            raise InputError(
                f"{scene.name}: asks for several samples a pixel, and {tracer} alone shows one; say "
                "--supersample 1 --multisample 1 --aperture-samples 1, or --decided-by certified"
            )

    @property
    def decided_by(self) -> str:
        """Name of the tracer."""
        return self.tracer_name

    def trace(
        self, aperture: Aperture, sampling: Sampling | None = None, *, colored: bool = True
    ) -> HogelImage:
        """Return what the tracer shows of an aperture; only one sample a pixel is taken."""
        image = self.propose(aperture, colored=colored)
        camera = replace(image.camera, renderer=f"{self.tracer_name} alone, nothing certified")
        image = replace(image, camera=camera)
        return replace(image, rendering=self.rendering(sampling)) if colored else image

    def trace_model(
        self, aperture: Aperture, settings: DoubleFrustum, *, shaded: bool = True
    ) -> HogelImage:
        """Return what the tracer shows along the lines of the cameras of these settings.

        Raises InputError where the settings cull faces: the tracer has all of them.
        """
        settings.check_against(self.scene.frustum)
        if settings.cull is not Cull.NONE:
            raise InputError(
                f"{self.tracer_name} alone culls no faces: leave out --cull, or say --decided-by certified"
            )
        rows = range(crossed_frustum(self.scene.frustum, aperture).resolution[1])
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        layers = [
            (camera.bundle, uncertified(self.tracer, self.scene, camera.bundle, rows))
            for camera in cameras
        ]
        camera = self._pictures.camera(aperture, settings)
        return self._pictures.image(camera, rows, layers, normals=shaded, colored=shaded)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What decides which surface a pixel shows, one of `DECISIONS`; `tracer` gives a second opinion."""

    by: str = CERTIFIED
    tracer: str = "embree"

    def __post_init__(self) -> None:
        if self.by not in DECISIONS:
            raise InputError(f"decided by must be one of {', '.join(DECISIONS)}, not {self.by!r}")


def open_reference(
    scene: Scene, decision: Decision, effects: frozenset[Effect] | None = None
) -> Reference:
    """Return the certified truth of a scene, or what a tracer shows alone; `effects` as for `Reference`.

    Raises InputError where there is no such tracer, or it cannot decide about this scene alone.
    """
    if decision.by == CERTIFIED:
        return Reference(scene, tracer=decision.tracer, effects=effects)
    return PlainReference(scene, decision.by, effects)


@dataclass(frozen=True, kw_only=True)
class AloneNumbers:
    """How many of the `judged` pixels of one truth a tracer alone gets wrong: another triangle, or none."""

    judged: int
    embree: int
    mitsuba: int


@dataclass(frozen=True, kw_only=True, eq=False)
class AloneFound:
    """What single tracers would have got wrong of one truth: numbers, and (H, W) pixels by tracer's name."""

    numbers: AloneNumbers
    wrong: dict[str, Mask]


class TracersAlone:
    """Both ray tracers of a scene, each to be judged by the certified truth."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    @cached_property
    def _tracers(self) -> dict[str, Tracer]:
        # Mitsuba loads when there is a truth to judge by: other threads of a report work meanwhile.
        return {"embree": EmbreeTracer(self._scene), "mitsuba": MitsubaTracer(self._scene)}

    def wrong(self, truth: HogelImage, first_row: int = 0) -> dict[str, Mask]:
        """Return which pixels (rows, W) of a truth, or a band of it, each tracer alone gets wrong."""
        bundle = crossed_frustum(self._scene.frustum, truth.camera.aperture)
        rows = range(first_row, first_row + len(truth.triangle))
        return {
            name: (proposed(tracer, self._scene, bundle, rows) != truth.triangle) & judged(truth)
            for name, tracer in self._tracers.items()
        }

    def find(self, truth: HogelImage) -> AloneFound:
        """Return what each tracer alone would have got wrong of a whole truth."""
        wrong = self.wrong(truth)
        counts = {name: int(pixels.sum()) for name, pixels in wrong.items()}
        return AloneFound(
            numbers=AloneNumbers(judged=int(judged(truth).sum()), **counts), wrong=wrong
        )


def judged(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose truth is no tie."""
    assert truth.certainty is not None, "the truth is certified"
    return np.not_equal(truth.certainty, Certainty.TIE)
