"""What ray tracers in single precision would have got wrong alone, without the certificate."""

from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer
from xfrustum.reference.tracers.proposals import proposed
from xfrustum.reference.tracers.tracer import Tracer
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene


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
        self._tracers: dict[str, Tracer] = {"embree": EmbreeTracer(scene), "mitsuba": MitsubaTracer(scene)}

    def wrong(self, truth: HogelImage, first_row: int = 0) -> dict[str, Mask]:
        """Return which pixels (rows, W) of a truth, or a band of it, each tracer alone gets wrong."""
        pencil = crossed_frustum(self._scene.frustum, truth.camera.aperture)
        rows = range(first_row, first_row + len(truth.triangle))
        return {
            name: (proposed(tracer, self._scene, pencil, rows) != truth.triangle) & judged(truth)
            for name, tracer in self._tracers.items()
        }

    def find(self, truth: HogelImage) -> AloneFound:
        """Return what each tracer alone would have got wrong of a whole truth."""
        wrong = self.wrong(truth)
        counts = {name: int(pixels.sum()) for name, pixels in wrong.items()}
        return AloneFound(numbers=AloneNumbers(judged=int(judged(truth).sum()), **counts), wrong=wrong)


def judged(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose truth is no tie."""
    assert truth.certainty is not None, "the truth is certified"
    return np.not_equal(truth.certainty, Certainty.TIE)
