"""Every wrong pixel charged to one link of the chain, and every rounding explained.

See docs/method.md, "The error budget".
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.attribution.explain import explain
from xfrustum.compare.metrics.displacement import displacement
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.surface import wrong_surface
from xfrustum.compare.prediction.chain import DEPTH, LINKS, RASTERIZATION, Chain
from xfrustum.compare.prediction.predict import LinkPrediction, Predictor
from xfrustum.compare.rounding.causes import Causes
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.scene import Scene

RIGHT = -1
"""Value in a map of charges of a pixel that is right in the end, or not judged."""


@dataclass(frozen=True, kw_only=True)
class LinkNumbers:
    """What one link of the chain does, measured and predicted; None where nothing is displaced."""

    name: str
    pixels: int
    triangle: int
    surface: int
    displacement_rms_px: float | None
    height_rms: float | None
    predicted_displacement_rms_px: float | None
    predicted_surface: float | None


@dataclass(frozen=True, kw_only=True)
class BudgetNumbers:
    """The numbers of a `Budget`, without its images, as they are written."""

    judged: int
    wrong: int
    links: tuple[LinkNumbers, ...]
    explained: dict[str, int]
    cancelled: int
    unexplained: int
    not_in_every_link: int


@dataclass(frozen=True, kw_only=True, eq=False)
class VectorBudget:
    """What each link adds to a quantity, where every image of the chain shows a surface.

    Attributes
    ----------
    steps
        (links, H, W, components) differences between neighboring images, NaN elsewhere.
    total
        (H, W, components) last image minus first.
    elsewhere
        Number of pixels left out, because some image shows no surface or one in the plate.
    """

    steps: Floats
    total: Floats
    elsewhere: int

    @classmethod
    def of(cls, values: Floats) -> VectorBudget:
        """Take the differences of a quantity (images, H, W, components), NaN where it is undefined."""
        defined: Mask = np.all(np.isfinite(values), axis=(0, -1))
        values = np.where(defined[..., None], values, np.nan)
        return cls(
            steps=np.diff(values, axis=0), total=values[-1] - values[0], elsewhere=int((~defined).sum())
        )

    def rms(self) -> list[float | None]:
        """Return the root mean square length of each link's steps, None where there is none."""
        squared = np.square(self.steps).sum(axis=-1).reshape(len(self.steps), -1)
        return [float(np.sqrt(np.nanmean(link))) if np.isfinite(link).any() else None for link in squared]


@dataclass(frozen=True, kw_only=True, eq=False)
class Budget:
    """The error of one image, link by link.

    Attributes
    ----------
    judged, wrong, cancelled
        Number of pixels whose truth is no tie; of judged pixels that show another triangle in the end; of
        judged pixels that are right although some link changed them.
    charge
        (H, W) number of the link that each wrong pixel is charged to, else `RIGHT`.
    surface_charge
        (H, W) the same by surfaces: number of the link from which on the pixel shows a wrong surface.
    explanation
        Causes of the pixels charged to rasterization and depth.
    displacement, height
        Budgets of both, in pixels (columns and rows) and in scene units.
    predicted
        Prediction of each link by closed forms.
    """

    judged: int
    wrong: int
    cancelled: int
    charge: NDArray[np.int8]
    surface_charge: NDArray[np.int8]
    explanation: Causes
    displacement: VectorBudget
    height: VectorBudget
    predicted: tuple[LinkPrediction, ...]

    @property
    def numbers(self) -> BudgetNumbers:
        """The numbers alone, without the images."""
        counts = self.explanation.counts()
        unexplained = counts.pop("unexplained")
        moved, raised = self.displacement.rms(), self.height.rms()
        links = (
            LinkNumbers(
                name=name,
                pixels=int((self.charge == link).sum()),
                triangle=int((self.charge == link).sum()),
                surface=int((self.surface_charge == link).sum()),
                displacement_rms_px=moved[link],
                height_rms=raised[link],
                predicted_displacement_rms_px=self.predicted[link].displacement_rms_px,
                predicted_surface=self.predicted[link].surface_pixels,
            )
            for link, name in enumerate(LINKS)
        )
        return BudgetNumbers(
            judged=self.judged,
            wrong=self.wrong,
            links=tuple(links),
            explained=counts,
            cancelled=self.cancelled,
            unexplained=unexplained,
            not_in_every_link=self.displacement.elsewhere,
        )

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `budget --json` prints them."""
        numbers = self.numbers
        return {**asdict(numbers), "links": [asdict(link) for link in numbers.links]}


def make_budget(reference: Reference, chain: Chain) -> Budget:
    """Charge every wrong pixel of a chain's last image to one link.

    A pixel is charged to the last link that changed its triangle: the smallest for which every
    later link agrees with the final image.
    """
    truth = chain.images[0]
    judged = judged_pixels(truth)
    numbers = np.stack([image.triangle for image in chain.images])
    changed = numbers[1:] != numbers[:-1]
    wrong = judged & (numbers[-1] != numbers[0])
    charge = np.where(wrong, _last(changed), RIGHT).astype(np.int8)
    moved = np.stack([displacement(image, truth.camera) for image in chain.images])
    heights = np.stack(
        [np.where(image.off_plate, image.height.astype(np.float64), np.nan) for image in chain.images]
    )
    return Budget(
        judged=int(judged.sum()),
        wrong=int(wrong.sum()),
        cancelled=int((judged & ~wrong & changed.any(axis=0)).sum()),
        charge=charge,
        surface_charge=_surface_charge(reference, chain, judged),
        explanation=_explained(reference.scene, chain, charge),
        displacement=VectorBudget.of(moved),
        height=VectorBudget.of(heights[..., None]),
        predicted=_predicted(reference, chain),
    )


def _predicted(reference: Reference, chain: Chain) -> tuple[LinkPrediction, ...]:
    truth = chain.images[0]
    gaps = reference.gaps(truth.camera.aperture)
    predictor = Predictor(truth, gaps, reference.scene.frustum, chain.subpixel_bits)
    return predictor.links(chain.settings)


def _last(changed: Mask) -> Indices:
    """Return the last link that changed each pixel (links, H, W); any where none did."""
    return np.asarray(len(changed) - 1 - np.argmax(changed[::-1], axis=0))


def _surface_charge(reference: Reference, chain: Chain, judged: Mask) -> NDArray[np.int8]:
    truth = chain.images[0]
    wrong = np.stack([wrong_surface(truth, image, reference) & judged for image in chain.images])
    return np.where(wrong[-1], _last(~wrong[:-1]), RIGHT).astype(np.int8)


def _explained(scene: Scene, chain: Chain, charge: NDArray[np.int8]) -> Causes:
    """Explain what rasterization did to the model, and depth to the rasterization."""
    parts = []
    for link in (RASTERIZATION, DEPTH):
        before, after = chain.images[link], chain.images[link + 1]
        explanation = explain(scene, before, after, chain.subpixel_bits)
        parts.append(explanation.within(charge == link))
    return parts[0].joined(parts[1])
