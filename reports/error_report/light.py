"""Light of a report: effects, the bent eye vector, and light that a raster misses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from xfrustum.compare.metrics.radiance import LeftOutNumbers, measure_left_out
from xfrustum.compare.prediction.eye_vector import measured_eye_error, predicted_eye_error
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.shading.shading import Shader
from xfrustum.reports.common.outputs import json_object, progress_bar
from xfrustum.reports.common.templates_environment import address
from xfrustum.reports.error_report import images
from xfrustum.reports.scene_check.effects import EffectRow, effect_rows
from xfrustum.scenes import Aperture, DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Effect, Question, chosen, needed
from xfrustum.scenes.model.scene import Scene, is_shaded


@dataclass(frozen=True, kw_only=True)
class EyeError:
    """Radiance error by the bent eye vector at one near plane: rms over points and channels.

    `predicted` by closed form, at the truth's surface points; `measured` at the points that the
    device drew, with its float32 arithmetic.
    """

    near: float
    predicted: float
    measured: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MissedLight:
    """The light that a rasterizer misses in one aperture's image."""

    aperture: Aperture
    numbers: LeftOutNumbers
    #: Addresses of the truth with shadows and interreflection, and of its difference from the truth
    #: without
    picture: str
    difference: str


@dataclass(frozen=True, kw_only=True, eq=False)
class LightReport:
    """Light of a report beside its rows."""

    scene: Scene
    #: of the effects, as `--effects` takes them
    names: str
    #: For every effect: whether the scene calls for it, and why.
    decisions: tuple[EffectRow, ...]
    #: True where images with all effects and with the needed effects are equal, bit by bit.
    same_bits: bool
    #: Error by near; empty where no highlight and no reflection is drawn.
    eye: tuple[EyeError, ...]
    #: Missed light by aperture; empty without light transport.
    missed: tuple[MissedLight, ...]

    @property
    def record(self) -> dict[str, Any]:
        """The numbers as report.json has them."""
        return {
            "effects": self.names,
            "decisions": [
                {"effect" if key == "name" else key: value for key, value in vars(row).items()}
                for row in self.decisions
            ],
            "same_bits": self.same_bits,
            "sampling": self.scene.sampling,
            "eye_vector": self.eye,
            "left_out": [
                {"aperture": part.aperture.index, **json_object(part.numbers)}
                for part in self.missed
            ],
        }


def measure_light(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    *,
    effects: str = "auto",
    progress: bool = False,
) -> LightReport | None:
    """Measure the light of a report beside its rows; None for scenes without materials or lights.

    Light that is missed is measured at all apertures of the report, everything else at the first
    one.
    """
    if not is_shaded(scene):
        return None
    first, drawn, question = apertures[0], [], Question(settings=(settings[0],))
    for names in ("auto", "all"):
        with Rasterizer(scene, effects=chosen(scene, names, question=question)) as rasterizer:
            image = rasterizer.render(first, settings[0], normals=False)
            arrays = (image.color, image.triangle, image.position)
            drawn.append([array.tobytes() for array in arrays if array is not None])
    shows_eye = bool(needed(scene) & {Effect.SPECULAR, Effect.REFLECTION})
    nears = sorted({setting.near for setting in settings}, reverse=True) if shows_eye else []
    lit = apertures if scene.transport.simulated else []
    eye, missed = [], []
    steps = len(nears) + 2 * len(lit) * scene.sampling.aperture
    with progress_bar(steps, "light", "measurement", shown=progress) as bar:
        if nears:
            # Single samples: averages would mix the eye vectors of several points.
            once, shader = replace(scene, sampling=Sampling()), Shader(scene)
            surfaces = Reference(once).trace(first)
            with Rasterizer(once) as rasterizer:
                for near in nears:
                    # With a depth buffer that loses nothing.
                    exact = DoubleFrustum(
                        near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED
                    )
                    shown = rasterizer.render(first, exact, normals=False)
                    errors = (
                        predicted_eye_error(scene, surfaces, near),
                        measured_eye_error(shader, shown),
                    )
                    predicted, measured = (
                        float(np.sqrt(np.mean(error**2))) if error.size else 0.0 for error in errors
                    )
                    eye.append(EyeError(near=near, predicted=predicted, measured=measured))
                    bar.update()
        for aperture in lit:
            left_out = measure_left_out(scene, aperture, bar.update)
            truth = Reference(scene).trace(aperture, Sampling())
            # The truth with transport is the sum of the measured parts: nothing is traced twice.
            full = (left_out.without + left_out.difference.mean).astype(np.float32)
            missed.append(
                MissedLight(
                    aperture=aperture,
                    numbers=left_out.numbers,
                    picture=address(images.picture(replace(truth, color=full))),
                    difference=address(images.radiance_map(left_out.difference.mean)),
                )
            )
    return LightReport(
        scene=scene,
        names=effects,
        decisions=tuple(effect_rows(scene)),
        same_bits=drawn[0] == drawn[1],
        eye=tuple(eye),
        missed=tuple(missed),
    )
