"""What a report says about light beside its rows: effects, the eye vector, and what a rasterizer misses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from tqdm import tqdm

from xfrustum.compare.metrics.left_out import LeftOutNumbers, measure_left_out
from xfrustum.compare.metrics.radiance import PIXELS_PER_DEGREE
from xfrustum.compare.prediction.eye_vector import measured_eye_error, predicted_eye_error
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.shading.shading import Shader
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.error_report import figures, images
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Decision, Effect, Question, chosen, decide, needed
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.notebook import digits, percent
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class EyeError:
    """What the bent eye vector costs at one near plane: root mean squares over points and channels.

    Attributes
    ----------
    near
        Near plane in scene units.
    predicted, measured
        Error at the truth's surface points, by closed form; and at the points that the device drew, with its
        float32 arithmetic.
    """

    near: float
    predicted: float
    measured: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MissedLight:
    """The light that a rasterizer misses in one aperture's image.

    Attributes
    ----------
    picture, difference
        Addresses of the truth with shadows and interreflection, and of its difference from the truth without.
    """

    aperture: Aperture
    numbers: LeftOutNumbers
    picture: str
    difference: str


@dataclass(frozen=True, kw_only=True, eq=False)
class LightReport:
    """What a report says about light beside its rows.

    Attributes
    ----------
    decisions
        For every effect: whether the scene calls for it, and why.
    same_bits
        Whether the rasterizer's images with all effects and with those called for are the same, bit by bit.
    eye
        Error by near; empty where no highlight and no reflection is drawn.
    missed
        Missed light by aperture; empty where no light transport is asked for.
    """

    scene: Scene
    names: str
    decisions: tuple[Decision, ...]
    same_bits: bool
    eye: tuple[EyeError, ...]
    missed: tuple[MissedLight, ...]
    radiance_colors: tuple[str, ...] = tuple(images.radiance_scale())
    radiance_range: tuple[float, float] = images.RADIANCE_RANGE
    pixels_per_degree: float = PIXELS_PER_DEGREE

    @property
    def record(self) -> dict[str, Any]:
        """The numbers as report.json has them."""
        return {
            "effects": self.names,
            "decisions": self.decisions,
            "same_bits": self.same_bits,
            "sampling": self.scene.sampling,
            "eye_vector": self.eye,
            "left_out": [
                {"aperture": part.aperture.index, **json_object(part.numbers)} for part in self.missed
            ],
        }

    def sentences(self) -> Iterator[str]:
        """Say in words how much light is missed."""
        pixels = self.scene.frustum.resolution[0] * self.scene.frustum.resolution[1]
        for part in self.missed:
            numbers = part.numbers
            yield (
                f"Aperture {part.aperture.column},{part.aperture.row}: light transport changes "
                f"{numbers.pixels:,} pixels ({percent(numbers.pixels / pixels)}), "
                f"{numbers.darker:,} of them to darker; rms {digits(numbers.rms)} in radiance, "
                f"after noise of {digits(numbers.rms_noise)} is taken off."
            )

    def curves(self, rows: Sequence[tuple[int, Measurement]]) -> dict[str, go.Figure]:
        """Return the further figures of the rows of an aperture and a camera geometry, by name."""

        def error(row: Measurement, name: str) -> float | None:
            found = row.comparison.radiance
            return None if found is None else getattr(found, name) or None

        drawn = {
            "radiance": ("rms", "rms radiance error, linear"),
            "flip": ("flip", "FLIP, mean over the picture"),
        }
        reach = self.scene.frustum.longest_reach
        return {
            name: figures.number_figure(rows, reach, lambda row, key=key: error(row, key), title)  # type: ignore[misc]
            for name, (key, title) in drawn.items()
        }

    @property
    def eye_figure(self) -> go.Figure | None:
        """The figure of the bent eye vector; None where there is none."""
        if not self.eye:
            return None
        return figures.pair_figure(
            [one.near / self.scene.frustum.longest_reach for one in self.eye],
            [one.measured for one in self.eye],
            [one.predicted for one in self.eye],
            "rms change of radiance at the same surface points",
        )


def measure_light(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    *,
    effects: str = "auto",
    progress: bool = False,
) -> LightReport | None:
    """Measure what a report says about light beside its rows; None where a scene says nothing of light.

    Parameters
    ----------
    apertures, settings
        Apertures and settings of the report. Light that is missed is measured at all apertures, everything
        else at the first one.
    """
    if not is_shaded(scene):
        return None
    shows_eye = bool(needed(scene) & {Effect.SPECULAR, Effect.REFLECTION})
    nears = sorted({one.near for one in settings}, reverse=True) if shows_eye else []
    lit = apertures if scene.transport.simulated else []
    steps = len(nears) + 2 * len(lit) * scene.sampling.aperture
    with progress_bar(steps, "light", "measurement", shown=progress) as bar:
        return LightReport(
            scene=scene,
            names=effects,
            decisions=decide(scene),
            same_bits=_same_bits(scene, apertures[0], settings[0]),
            eye=tuple(_eye_errors(scene, apertures[0], nears, bar)) if nears else (),
            missed=tuple(_missed(scene, aperture, bar) for aperture in lit),
        )


def _same_bits(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> bool:
    drawn, asked = [], Question(settings=(settings,))
    for names in ("auto", "all"):
        with Rasterizer(scene, effects=chosen(scene, names, question=asked)) as rasterizer:
            drawn.append(rasterizer.render(aperture, settings, normals=False))
    one, other = (
        [part.tobytes() for part in (i.color, i.triangle, i.position) if part is not None] for i in drawn
    )
    return one == other


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
        picture=images.address(images.picture(replace(image, color=full))),
        difference=images.address(images.radiance_map(left_out.difference.mean)),
    )


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
