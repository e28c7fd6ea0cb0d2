"""Images of uncertified ray tracers in single precision, and their errors against the truth."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from xfrustum.reference.lines import crossed_frustum, model_cameras
from xfrustum.reference.pictures import averages
from xfrustum.reference.proposals import proposed, uncertified
from xfrustum.reference.tracers import TRACERS, EmbreeTracer, MitsubaTracer, Tracer
from xfrustum.reference.truth import Reference
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.images import Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Cull, DoubleFrustum

CERTIFIED = "certified"  #: name of the decision that is proven for every pixel
#: names of the ways to decide the surface of a pixel
DECISIONS = (CERTIFIED, *TRACERS)


class PlainReference(Reference):
    """Ray tracer of a scene in place of the certified truth; parameters as for `Reference`.

    Raises InputError for a scene with several samples a pixel: these need certified lines.
    """

    def __init__(
        self, scene: Scene, tracer: str = "embree", effects: frozenset[Effect] | None = None
    ) -> None:
        super().__init__(scene, tracer, effects)
        if averages(scene.sampling):
            raise InputError(
                f"{scene.name}: has several samples a pixel, {tracer} alone draws one; give "
                "--supersample 1 --multisample 1 --aperture-samples 1, or --decided-by certified"
            )

    @property
    def decided_by(self) -> str:
        """Name of the tracer."""
        return self.tracer_name

    def trace(
        self, aperture: Aperture, sampling: Sampling | None = None, *, colored: bool = True
    ) -> HogelImage:
        """Return the tracer's image of an aperture, with one sample a pixel."""
        image = self.propose(aperture, colored=colored)
        camera = replace(image.camera, renderer=f"{self.tracer_name} alone, nothing certified")
        image = replace(image, camera=camera)
        return replace(image, rendering=self.rendering(sampling)) if colored else image

    def trace_model(
        self, aperture: Aperture, settings: DoubleFrustum, *, shaded: bool = True
    ) -> HogelImage:
        """Return the tracer's image along the lines of the cameras of some settings.

        Raises InputError for settings that cull faces: the tracer always contains all faces.
        """
        settings.check_against(self.scene.frustum)
        if settings.cull is not Cull.NONE:
            raise InputError(
                f"{self.tracer_name} alone culls no faces: leave out --cull, or give "
                "--decided-by certified"
            )
        rows = range(crossed_frustum(self.scene.frustum, aperture).resolution[1])
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        # The image of each camera is traced separately and overlaid, as in certified images.
        layers = [
            (camera.bundle, uncertified(self.tracer, self.scene, camera.bundle, rows))
            for camera in cameras
        ]
        camera = self._pictures.camera(aperture, settings)
        return self._pictures.image(camera, rows, layers, normals=shaded, colored=shaded)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision method, one of `DECISIONS`, and the tracer that gives second opinions."""

    by: str = CERTIFIED
    tracer: str = "embree"

    def __post_init__(self) -> None:
        if self.by not in DECISIONS:
            raise InputError(f"decided by must be one of {', '.join(DECISIONS)}, not {self.by!r}")


def open_reference(
    scene: Scene, decision: Decision, effects: frozenset[Effect] | None = None
) -> Reference:
    """Return a scene's certified reference, or a `PlainReference`; `effects` as in `Reference`.

    Raises InputError for an unknown tracer, and for a scene that a single tracer does not support.
    """
    if decision.by == CERTIFIED:
        return Reference(scene, tracer=decision.tracer, effects=effects)
    return PlainReference(scene, decision.by, effects)


@dataclass(frozen=True, kw_only=True)
class AloneNumbers:
    """Number of judged pixels of one truth, and numbers of pixels that each tracer gets wrong."""

    judged: int
    embree: int
    mitsuba: int


@dataclass(frozen=True, kw_only=True, eq=False)
class AloneFound:
    """Errors of single tracers against one truth: numbers, and (H, W) masks by tracer."""

    numbers: AloneNumbers
    wrong: dict[str, Mask]


class TracersAlone:
    """Both ray tracers of a scene, each judged by the certified truth."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    @cached_property
    def _tracers(self) -> dict[str, Tracer]:
        # Import Mitsuba only for the first truth: other threads of a report work meanwhile.
        return {"embree": EmbreeTracer(self._scene), "mitsuba": MitsubaTracer(self._scene)}

    def wrong(self, truth: HogelImage, first_row: int = 0) -> dict[str, Mask]:
        """Return the wrong pixels (rows, W) of each tracer in a truth or a band of it."""
        bundle = crossed_frustum(self._scene.frustum, truth.camera.aperture)
        rows = range(first_row, first_row + len(truth.triangle))
        return {
            name: (proposed(tracer, self._scene, bundle, rows) != truth.triangle) & judged(truth)
            for name, tracer in self._tracers.items()
        }

    def find(self, truth: HogelImage) -> AloneFound:
        """Return the errors of each tracer in a whole truth."""
        wrong = self.wrong(truth)
        counts = {name: int(pixels.sum()) for name, pixels in wrong.items()}
        return AloneFound(
            numbers=AloneNumbers(judged=int(judged(truth).sum()), **counts), wrong=wrong
        )


def judged(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose truth is not a tie."""
    assert truth.certainty is not None, "the truth is certified"
    return np.not_equal(truth.certainty, Certainty.TIE)
