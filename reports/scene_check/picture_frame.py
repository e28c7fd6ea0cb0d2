"""What a view shows of space, and where that lies on the picture."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.compare.extent import aside_of_frusta
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

Box = tuple[float, float, float, float]
"""Left, bottom, right and top, scene units: z to the right, and x or y upward."""

LEFT, TOP, WIDTH, HEIGHT = 58.0, 62.0, 500.0, 400.0
"""Place and size of the part of the picture that shows space, pixels."""

MARGIN = 0.04
"""Shown around everything, as a share of it."""

FARTHEST = 0.75
"""What lies farther beyond the reach, or beside the plate, than this share of the whole reach is not shown
but pointed at: one mesh in other units must not shrink all others to a dot."""


class View(StrEnum):
    """From where a scene is looked at; the viewer's side of the plate is always to the right."""

    SIDE = "side"
    TOP = "top"

    @property
    def axis(self) -> int:
        """The coordinate that points upward in the picture: y from the side, x from above."""
        return 1 if self is View.SIDE else 0


@dataclass(frozen=True, kw_only=True)
class PictureFrame:
    """The rectangle of space that a view shows, in one scale in both directions.

    Attributes
    ----------
    box
        That rectangle.
    scale
        Pixels per scene unit.
    """

    box: Box
    scale: float

    @classmethod
    def of(cls, scene: Scene, view: View) -> PictureFrame:
        """Show the reach, the plate, the frusta and the objects, as far as they are not far away."""
        left, bottom, right, top = _shown(scene, view)
        scale = min(WIDTH / (right - left), HEIGHT / (top - bottom)) / (1 + 2 * MARGIN)
        # The rectangle is as wide and as high as its place on the picture.
        z, across = (left + right) / 2, (bottom + top) / 2
        half = WIDTH / scale / 2, HEIGHT / scale / 2
        return cls(box=(z - half[0], across - half[1], z + half[0], across + half[1]), scale=scale)

    def x(self, z: float) -> float:
        """Return where a height z lies on the picture, pixels from its left."""
        return LEFT + (z - self.box[0]) * self.scale

    def y(self, across: float) -> float:
        """Return where an x or y lies on the picture, pixels from its top."""
        return TOP + (self.box[3] - across) * self.scale

    def place(self, points: Floats) -> Floats:
        """Return where points (N, 2) of z and x or y lie within the frame, pixels from its top left."""
        z, across = points.T
        return np.stack(((z - self.box[0]) * self.scale, (self.box[3] - across) * self.scale), axis=1)


def _shown(scene: Scene, view: View) -> Box:
    toward, back = scene.frustum.reach
    far = FARTHEST * (toward + back)
    plate = scene.plate.size[view.axis] / 2
    low, high = aside_of_frusta(scene.frustum, shown_apertures(scene), view.axis, (-back, toward))
    left, right = -back, toward
    bottom, top = max(low, -plate - far), min(high, plate + far)
    for part in scene.objects:
        z, across = part.vertices[part.faces.ravel()][:, [2, view.axis]].T
        if _near(z, -back - far, toward + far) and _near(across, -plate - far, plate + far):
            left, right = min(left, max(z.min(), -back - far)), max(right, min(z.max(), toward + far))
            bottom = min(bottom, max(across.min(), -plate - far))
            top = max(top, min(across.max(), plate + far))
    return float(left), float(bottom), float(right), float(top)


def _near(values: Floats, low: float, high: float) -> bool:
    return bool(values.max() >= low and values.min() <= high)


def shown_apertures(scene: Scene) -> list[Aperture]:
    """Return the middle aperture and those at the plate's top left and bottom right corner, each once."""
    return list(dict.fromkeys((scene.plate.middle, *scene.plate.corners)))
