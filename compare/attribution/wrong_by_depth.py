"""Pixels that show a wrong surface because of the depth buffer: they are right with an exact one.

This is the last link of the chain (docs/method.md, "The error budget"), for wrong surfaces alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.surface import wrong_surface
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthControl:
    """A picture drawn with exact depth: what all depth buffers would show if depth did no harm."""

    settings: DoubleFrustum
    truth: HogelImage
    reference: Reference
    drawn: HogelImage

    @classmethod
    def of(
        cls, rasterizer: Rasterizer, truth: HogelImage, reference: Reference, settings: DoubleFrustum
    ) -> DepthControl:
        """Draw what some settings would show with exact depth, at the truth's aperture."""
        exact = with_exact_depth(settings)
        drawn = rasterizer.render(truth.camera.aperture, exact, normals=False, color=False)
        return cls(settings=exact, truth=truth, reference=reference, drawn=drawn)

    def serves(self, settings: DoubleFrustum) -> bool:
        """Return whether some settings differ from the control in nothing but the depth buffer."""
        return with_exact_depth(settings) == self.settings

    @cached_property
    def wrong(self) -> Mask:
        """(H, W) judged pixels that show the wrong surface with exact depth, too."""
        wrong: Mask = wrong_surface(self.truth, self.drawn, self.reference)
        return wrong & judged_pixels(self.truth)

    def charged(self, wrong: Mask) -> Mask:
        """Return which of the judged pixels that are wrong with some depth buffer are wrong because of it.

        Parameters
        ----------
        wrong
            (H, W) judged pixels that show the wrong surface with that depth buffer.
        """
        return wrong & ~self.wrong if wrong.any() else wrong

    def lost(self, wrong: Mask, drawn: HogelImage) -> Mask:
        """Return which of the charged pixels show nothing where the control shows a surface, (H, W)."""
        return self.charged(wrong) & self.drawn.covered & ~drawn.covered
