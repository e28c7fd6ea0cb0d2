"""The paper's figure 7: what camera C sees, what camera C* sees, and both, as one page and three pictures."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from xfrustum.compare.extent import require_seen
from xfrustum.compare.metrics.display import LEVELS, encoded
from xfrustum.raster import Rasterizer
from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.common.timing import Stopwatch
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

NEAR_PER_REACH = 1e-6
"""Near offset as a share of the reach, where none is asked for. What is farther than a percent of the reach
from the plate is displaced by less than W/2 1e-4, 0.03 px at 512 pixels; and a reversed float depth buffer
resolves 2^-24 of any distance, however small the near plane."""

_PAGE = "index.html"
_DRAWN = (Camera.C, Camera.C_STAR, Camera.BOTH)
FILES = (_PAGE, *(f"{camera.value}.png" for camera in _DRAWN))


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """The three pictures.

    Attributes
    ----------
    scene, aperture, settings
        What was drawn; the camera of `settings` means nothing.
    images
        By camera, in the paper's order.
    times_s
        Wall seconds of each picture, by the name of its camera.
    device
        What drew them.
    """

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    images: Mapping[Camera, HogelImage]
    times_s: Mapping[str, float]
    device: str


def default_settings(scene: Scene, near: float | None) -> DoubleFrustum:
    """Return settings in which neither near plane nor depth buffer shows."""
    near = NEAR_PER_REACH * scene.frustum.longest_reach if near is None else near
    return DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)


def draw_figure(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> Figure:
    """Draw an aperture with C alone, C* alone and both.

    Raises
    ------
    InputError
        near is not smaller than the reach, the aperture sees nothing of the objects, or there is no usable
        OpenGL.
    """
    require_seen(scene, [aperture])
    watch, images = Stopwatch(), {}
    with Rasterizer(scene) as rasterizer:
        # The first picture compiles the shaders.
        rasterizer.render(aperture, settings, normals=False)
        for camera in _DRAWN:
            with watch.stage(camera.value):
                images[camera] = rasterizer.render(aperture, replace(settings, camera=camera), normals=False)
        device = rasterizer.device["renderer"]
    return Figure(
        scene=scene, aperture=aperture, settings=settings, images=images, times_s=watch.seconds, device=device
    )


def write_figure(figure: Figure, out: Path) -> tuple[Path, ...]:
    """Write index.html and three pictures to a folder, all or nothing.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    pictures = {camera: png(image) for camera, image in figure.images.items()}
    with Staging(out, FILES) as staging:
        for camera, encoded_picture in pictures.items():
            (staging.folder / f"{camera.value}.png").write_bytes(encoded_picture)
        (staging.folder / _PAGE).write_text(_page(figure, pictures), encoding="utf-8")
        return staging.commit()


def png(image: HogelImage) -> bytes:
    """Encode the color image as PNG: clipped, sRGB, 8 bits; transparent where there is no surface."""
    assert image.color is not None
    color = np.rint(LEVELS * encoded(image.color))
    pixels = np.dstack((color, np.where(image.covered, LEVELS, 0)))
    buffer = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _page(figure: Figure, pictures: Mapping[Camera, bytes]) -> str:
    covered = {camera.value: float(image.covered.mean()) for camera, image in figure.images.items()}
    values = {
        "figure": figure,
        "reach": figure.scene.frustum.longest_reach,
        "covered": covered,
        "pictures": {
            camera.value: f"data:image/png;base64,{base64.b64encode(data).decode()}"
            for camera, data in pictures.items()
        },
    }
    return html_page("figure7.html.j2", {"digits": digits}, values)
