"""What an eye sees, pixel by pixel: truly, or replayed by a plate of hogels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers, Singles
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.notebook.labels import SCENE_UNITS
from xfrustum.scenes.notebook.shown import Figure, Shown, Table

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EyeImage(Shown):
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

    def to_xarray(self, units: str = SCENE_UNITS) -> xarray.Dataset:
        """Return the arrays with labels, as an `xarray.Dataset` with the names that stored plates have.

        Dimensions are v and u, the film coordinates of the pixels' centers (v upward, u to the right, from
        -1 to 1), and rgb or xyz. Here the film is the rectangle of the plate. The
        eye's place is a coordinate; pupil, focus and beam are attributes.

        Parameters
        ----------
        units
            Name of the scene's unit of length (`scene.units`), which an image does not know.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        from xfrustum.scenes.model.image_facts import labelled_eye  # noqa: PLC0415 - as below

        return labelled_eye(self, units)

    def _said(self) -> str:
        # Images are made by the thousand: only those that are shown need what shows them.
        from xfrustum.scenes.model.image_facts import said_of_eye  # noqa: PLC0415

        return said_of_eye(self)

    def _tables(self) -> Sequence[Table]:
        from xfrustum.scenes.model.image_facts import table_of_eye  # noqa: PLC0415

        return (table_of_eye(self),)

    def _figures(self) -> Sequence[Figure]:
        from xfrustum.scenes.model.image_facts import figures  # noqa: PLC0415

        return tuple(figures(self))
