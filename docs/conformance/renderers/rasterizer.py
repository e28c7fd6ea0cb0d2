"""xfrustum's rasterizer through the suite; run in this folder.

    xfrustum conformance run --python rasterizer:draw
    xfrustum conformance run --python rasterizer:d24_standard

`draw` takes the cameras that each case hands out. The others draw the cases that state no offset with another
depth buffer, and the offset of 1e-3 of the reach that such a buffer needs.
"""

from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from xfrustum import DepthFormat, DepthMapping, DoubleFrustum, Rasterizer
from xfrustum.scenes.conformance.suite import chosen


@lru_cache(maxsize=1)
def opened(name: str) -> tuple[Any, Any, Rasterizer]:
    """Return case, scene and rasterizer of a name; the last one is kept."""
    (case,) = chosen(names=(name,))
    scene = case.open()
    return case, scene, Rasterizer(scene).__enter__()


def draw(
    folder: Path, asked: dict[str, Any], hogel: tuple[int, int], buffer: tuple[str, str] | None = None
) -> Any:
    """Draw a hogel with the two cameras of the case, or with another depth buffer where none is stated."""
    del folder
    case, scene, rasterizer = opened(asked["name"])
    settings = case.settings(scene)
    if buffer is not None and asked["near"] is None:
        depth, mapping = DepthFormat(buffer[0]), DepthMapping(buffer[1])
        settings = DoubleFrustum(near=1e-3 * max(asked["reach"]), depth=depth, mapping=mapping)
    image = rasterizer.render(scene.plate.aperture(*hogel), settings)
    if case.colored:
        return image.color
    return (image.triangle if case.asked == "triangle-id" else image.object) + 1


d16_standard = partial(draw, buffer=("d16", "standard"))
d24_standard = partial(draw, buffer=("d24", "standard"))
d24_logarithmic = partial(draw, buffer=("d24", "logarithmic"))
d32f_reversed = partial(draw, buffer=("d32f", "reversed"))
