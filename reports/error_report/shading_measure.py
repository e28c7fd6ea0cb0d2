"""Measuring light for a report: effects and their time, the eye vector, what is missed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from xfrustum.compare.metrics.left_out import measure_left_out
from xfrustum.compare.prediction.eye_error import measured_eye_error, predicted_eye_error
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.shading.shading import Shader
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import FEWEST_DIFFERENCES
from xfrustum.reports.effects.costs import Stopwatches
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.shading import EyeError, MissedLight, ShadingReport
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, chosen, decide, needed
from xfrustum.scenes.model.look import is_shaded
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

REPEAT = FEWEST_DIFFERENCES
"""Measured pairs of images for a time."""


def measure_shading(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    *,
    effects: str = "auto",
    progress: bool = False,
) -> ShadingReport | None:
    """Measure what a report says about light beside its rows; None where a scene says nothing of light.

    Parameters
    ----------
    apertures, settings
        Apertures and settings of the report. Light that is missed is measured at all apertures, everything
        else at the first one.
    effects
        Effects that are simulated, as `--effects` takes them.
    progress
        Show a progress bar on standard error.
    """
    if not is_shaded(scene):
        return None
    nears = sorted({one.near for one in settings}, reverse=True)
    eye = _shows_eye(scene)
    transported = scene.transport.simulated
    steps = 2 + 2 * (scene.sampling.aperture > 1) + eye * len(nears)
    steps += transported * 2 * len(apertures) * scene.sampling.aperture
    middle = apertures[0]
    watches = Stopwatches(scene=scene, aperture=middle, settings=settings[0], tracer="embree", repeat=REPEAT)
    with progress_bar(steps, "light", "measurement", shown=progress) as bar:
        saved = watches.of_effects(ALL_EFFECTS, needed(scene), bar)
        return ShadingReport(
            scene=scene,
            names=effects,
            decisions=decide(scene),
            saved=saved,
            same_bits=_same_bits(scene, middle, settings[0]),
            per_sample=_per_sample(watches, bar) if scene.sampling.aperture > 1 else {},
            eye=tuple(_eye_errors(scene, middle, nears, bar)) if eye else (),
            missed=tuple(_missed(scene, aperture, bar) for aperture in apertures) if transported else (),
        )


def _shows_eye(scene: Scene) -> bool:
    return bool(needed(scene) & {Effect.SPECULAR, Effect.REFLECTION})


def _same_bits(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> bool:
    drawn, asked = [], Question(settings=(settings,))
    for names in ("auto", "all"):
        with Rasterizer(scene, effects=chosen(scene, names, question=asked)) as rasterizer:
            drawn.append(rasterizer.render(aperture, settings, normals=False))
    return all(
        np.array_equal(_bits(getattr(drawn[0], name)), _bits(getattr(drawn[1], name)))
        for name in ("color", "triangle", "position")
    )


def _bits(array: NDArray[np.generic]) -> Bytes:
    return np.ascontiguousarray(array).view(np.uint8)


def _per_sample(watches: Stopwatches, bar: tqdm[NoReturn]) -> dict[str, float]:
    """Return seconds for each further point of the aperture."""
    count = watches.scene.sampling.aperture
    costs = watches.of_sampling(Sampling(aperture=count), bar)
    return {name: (cost.seconds + cost.without) / count for name, cost in costs.items()}


def _eye_errors(
    scene: Scene, aperture: Aperture, nears: Sequence[float], bar: tqdm[NoReturn]
) -> Iterator[EyeError]:
    """Yield the error of the bent eye vector at each near, with a depth buffer that loses nothing."""
    once, shader = replace(scene, sampling=Sampling()), Shader(scene)
    truth = Reference(once).trace(aperture)
    with Rasterizer(once) as rasterizer:
        for near in nears:
            exact = DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
            drawn = rasterizer.render(aperture, exact, normals=False)
            yield EyeError(
                near=near,
                predicted=_rms(predicted_eye_error(scene, truth, near)),
                measured=_rms(measured_eye_error(scene, shader, drawn)),
            )
            bar.update()


def _missed(scene: Scene, aperture: Aperture, bar: tqdm[NoReturn]) -> MissedLight:
    left_out = measure_left_out(scene, aperture, bar.update)
    image = Reference(scene).trace(aperture, Sampling())
    full = (left_out.without + left_out.difference.mean).astype(np.float32)
    return MissedLight(
        aperture=aperture,
        numbers=left_out.numbers,
        picture=images.picture(replace(image, color=full)),
        difference=images.radiance_map(left_out.difference.mean),
    )


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
