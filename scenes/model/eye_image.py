"""What an eye sees, pixel by pixel: truly, or replayed by a plate of hogels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers, Singles
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.image_facts import Labels, ShownImage, labels_of_eye, said_of_eye, table_of_eye
from xfrustum.scenes.notebook.shown import Table


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EyeImage(ShownImage):
    """The picture of one eye. Row 0 is at the top; arrays are (H, W) or (H, W, 3).

    Attributes
    ----------
    eye
        The eye.
    triangle, object
        int32 numbers of the surface on the ray through the pupil's center, `NOTHING` where there is none.
    position
        Surface point that is shown, scene units; NaN where there is none, and where it is not known.
    color
        Linear RGB, float32, averaged over the pupil and over beams; None where it is not known.
    certainty
        uint8 `Certainty` per pixel; None where nothing was certified.
    """

    eye: Eye
    triangle: Numbers
    object: Numbers
    position: Floats
    color: Singles | None = None
    certainty: Bytes | None = None

    @property
    def covered(self) -> Mask:
        """Pixels that show a surface."""
        covered: Mask = (self.triangle != NOTHING) | (self.object != NOTHING)
        return covered

    def _said(self) -> str:
        return said_of_eye(self)

    def _tables(self) -> Sequence[Table]:
        return (table_of_eye(self),)

    def _labels(self, units: str) -> Labels:
        return labels_of_eye(self, units)
