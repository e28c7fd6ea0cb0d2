"""Figure 7 of the paper as one page: C, C* as seen and as overlaid, and both cameras."""

import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from xfrustum.raster import Rasterizer
from xfrustum.reports.common.outputs import write_files
from xfrustum.reports.common.templates_environment import address, html_page, png
from xfrustum.reports.scene_check.sight import require_seen
from xfrustum.scenes import (
    Aperture,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelImage,
    Scene,
)
from xfrustum.scenes.representation import LEVELS, encoded

#: Default near offset, share of the reach. Points farther than a percent of the reach from the
#: plate are displaced by less than W/2 1e-4, 0.03 px at 512 pixels; and a reversed float depth
#: buffer resolves 2^-24 of any distance, however small the near plane.
NEAR_PER_REACH = 1e-6

LATTICE = (
    4  #: apertures along each side of the plate among which the second perspective of C* is chosen
)

_PAGE = "index.html"
_DRAWN = (Camera.C, Camera.C_STAR, Camera.BOTH)
#: Names of the pictures of C*: as the camera sees it, and of another aperture.
_AS_SEEN, _OTHER = "c-star-as-seen", "c-star-other"
#: Names of the written files; the other aperture's exists only where the plate has one.
FILES = (
    _PAGE,
    *(f"{name}.png" for name in (*(camera.value for camera in _DRAWN), _AS_SEEN, _OTHER)),
)


def default_settings(scene: Scene, near: float | None) -> DoubleFrustum:
    """Return settings in which neither near plane nor depth buffer shows."""
    near = NEAR_PER_REACH * scene.frustum.longest_reach if near is None else near
    return DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)


def write_figure(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, other: Aperture | None, out: Path
) -> tuple[Path, ...]:
    """Draw C alone, C* alone and both of an aperture, and C* of another; write the page.

    `other` is the aperture of the second perspective of C*; where None the aperture of a coarse
    lattice over the plate from which C* shows most, if the plate has another one. InputError if
    near is not smaller than the reach, the aperture sees nothing of the objects, there is no usable
    OpenGL, or the folder cannot be written.
    """
    require_seen(scene, [aperture])
    times_s, images, alone = {}, {}, replace(settings, camera=Camera.C_STAR)
    columns, rows = (
        [round(place * (count - 1) / (LATTICE - 1)) for place in range(LATTICE)]
        for count in scene.plate.hogels
    )
    lattice = dict.fromkeys(
        scene.plate.aperture(column, row) for row, column in product(rows, columns)
    )
    with Rasterizer(scene) as rasterizer:
        # The first picture compiles the shaders.
        rasterizer.render(aperture, settings, normals=False)
        for camera in _DRAWN:
            begun = time.perf_counter()
            image = rasterizer.render(aperture, replace(settings, camera=camera), normals=False)
            images[camera.value], times_s[camera.value] = image, time.perf_counter() - begun

        def covered(candidate: Aperture) -> int:
            return int(
                rasterizer.render(candidate, alone, normals=False, color=False).covered.sum()
            )

        if other is None:
            other = max(
                (candidate for candidate in lattice if candidate != aperture),
                key=covered,
                default=None,
            )
        if other is not None:
            images[_OTHER] = rasterizer.render(other, alone, normals=False)
        device = rasterizer.device["renderer"]
    pictures = {name: picture(image, as_seen=name == _OTHER) for name, image in images.items()}
    pictures[_AS_SEEN] = picture(images[Camera.C_STAR.value], as_seen=True)
    values = {
        **{
            "scene": scene,
            "aperture": aperture,
            "other": other,
            "settings": settings,
            "device": device,
        },
        "times_s": times_s,
        "covered": {name: float(image.covered.mean()) for name, image in images.items()},
        "pictures": {name: address(encoded) for name, encoded in pictures.items()},
    }
    files = {f"{name}.png": content for name, content in pictures.items()}
    return write_files(out, {_PAGE: html_page("figure7.html.j2", values), **files})


def picture(image: HogelImage, *, as_seen: bool = False) -> bytes:
    """Encode the color image as PNG: clipped, sRGB, 8 bits; transparent where there is no surface.

    An image lies on the film. As C* sees it, which looks from the plate back at the viewer with +y
    upward and so with +x to its left, the sides are the same, and up and down change places.
    """
    assert image.color is not None
    color = np.rint(LEVELS * encoded(image.color))
    pixels = np.dstack((color, np.where(image.covered, LEVELS, 0)))
    return png(np.flipud(pixels) if as_seen else pixels)
