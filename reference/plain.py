"""What a ray tracer in single precision shows alone, in the place of the truth; nothing of it is examined."""

from dataclasses import dataclass, replace

from xfrustum.reference.averages import averages
from xfrustum.reference.lines.lines import crossed_frustum, model_cameras
from xfrustum.reference.tracers.proposals import uncertified
from xfrustum.reference.tracers.tracer import TRACERS
from xfrustum.reference.truth import Reference
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

CERTIFIED = "certified"  #: name of the decision that is proven for every pixel
DECISIONS = (CERTIFIED, *TRACERS)  #: names of what can decide which surface a pixel shows


class PlainReference(Reference):
    """A ray tracer whose pictures stand for the truth; InputError for several samples a pixel."""

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

    def trace_model(self, aperture: Aperture, settings: DoubleFrustum, *, shaded: bool = True) -> HogelImage:
        """Return what the tracer shows to these settings' cameras; InputError where faces are culled."""
        settings.check_against(self.scene.frustum)
        if settings.cull is not Cull.NONE:
            raise InputError(
                f"{self.tracer_name} alone culls no faces: leave out --cull, or say --decided-by certified"
            )
        rows = range(crossed_frustum(self.scene.frustum, aperture).resolution[1])
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        layers = [
            (camera.pencil, uncertified(self.tracer, self.scene, camera.pencil, rows)) for camera in cameras
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


CERTIFIED_DECISION = Decision()  #: the decision that is proven for every pixel, with Embree's second opinion


def open_reference(scene: Scene, decision: Decision, effects: frozenset[Effect] | None = None) -> Reference:
    """Return the certified truth of a scene, or what a tracer shows alone; InputError where it cannot."""
    if decision.by == CERTIFIED:
        return Reference(scene, tracer=decision.tracer, effects=effects)
    return PlainReference(scene, decision.by, effects)
