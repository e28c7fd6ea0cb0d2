"""Draw the pictures of moved scenes in docs/method.md as PNG: python -m scripts.draw_eye_figures.

Arguments: [FOLDER] [NAME ..], by default docs/images and both pictures.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tests.support.moved_scene import MovedScene, moved_scene

from xfrustum.compare.eye_loss import LossMaps, Views, display_loss
from xfrustum.reference.eye import EyeReference
from xfrustum.reports.view import drawing, shown, view
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, open_scene
from xfrustum.scenes.arrays import Bytes, Mask
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.images import NOTHING

FOLDER = Path("docs") / "images"
SCENES = {"moved-car": "car", "moved-asymmetric": "asymmetric"}  #: scenes by name of the picture

NEAR = 6.0  #: near offset, mm
EYE = Eye(position=(40.0, 20.0, 600.0), resolution=(320, 240))
WRONG = (224, 49, 49)  #: color of wrong surfaces
CAPTION_PX, GAP_PX = 20, 6  #: height of a caption, width of the gap between two pictures


def as_moved(image: EyeImage, moved: MovedScene) -> EyeImage:
    """Return a drawn view with points and triangle numbers of the moved scene."""
    side = np.where(image.position[..., 2] > 0, 1.0, -1.0)
    position = image.position.copy()
    position[..., 2] += side * NEAR
    middle = moved.scene.triangles[..., 2].mean(axis=1)
    number = np.full(image.triangle.shape, NOTHING, dtype=np.int32)
    for before in (False, True):
        # All parts of a triangle on one side lie in one plane: use any of them.
        parts = np.flatnonzero((middle > 0) == before)
        part_of = np.full(int(moved.number.max()) + 2, NOTHING, dtype=np.int32)
        part_of[moved.number[parts]] = parts
        here = (image.triangle != NOTHING) & ((side > 0) == before)
        number[here] = part_of[image.triangle[here]]
    return replace(image, position=position, triangle=number)


def marked(image: EyeImage, wrong: Mask | None) -> Bytes:
    """Return a dimmed view with wrong surfaces marked."""
    gray = shown(image).mean(axis=-1, keepdims=True) * 0.6 + 40.0 * image.covered[..., None]
    picture = np.repeat(gray, 3, axis=-1)
    if wrong is not None:
        picture[wrong] = WRONG
    return np.asarray(np.rint(np.clip(picture, 0, 255)), dtype=np.uint8)


def share(maps: LossMaps) -> str:
    """Return the share of wrong surfaces as text."""
    return f"{100 * (maps.numbers().fraction or 0.0):.2g} %"


def moved_picture(name: str) -> Image.Image:
    """Return C, C against B, C against the true view of the moved scene, and B against A."""
    settings = DoubleFrustum(near=NEAR, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
    scene = open_scene(name)
    seen = view(scene, [EYE], drawing(scene, settings))
    (views,) = seen.views
    display, renderer = views.display, views.renderer
    assert views.drawn is not None and renderer is not None
    moved = moved_scene(scene, settings)
    other = EyeReference(moved.scene)
    of_moved = Views(
        true=other.true_view(EYE, shaded=False),
        replayed=as_moved(views.drawn, moved),
        drawn=None,
        taken=views.taken,
    )
    theorem = display_loss(other, of_moved)
    return row_of_pictures(
        [
            (f"{name}: C, n = {NEAR:g} mm", shown(views.drawn)),
            (f"C against B: {share(renderer)} wrong", marked(views.drawn, renderer.wrong)),
            (
                f"C against A of the moved scene: {share(theorem)}",
                marked(views.drawn, theorem.wrong),
            ),
            (f"B against A: {share(display)}", marked(views.replayed, display.wrong)),
        ]
    )


def row_of_pictures(pictures: Sequence[tuple[str, Bytes]]) -> Image.Image:
    """Return pictures side by side, each under its caption."""
    height, width = pictures[0][1].shape[:2]
    step = width + GAP_PX
    picture = Image.new("RGB", (step * len(pictures) - GAP_PX, height + CAPTION_PX), (255,) * 3)
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(11)
    for column, (caption, pixels) in enumerate(pictures):
        pen.text((column * step + 2, 2), caption, fill=(30, 30, 30), font=font)
        picture.paste(Image.fromarray(pixels), (column * step, CAPTION_PX))
    return picture


def main(folder: Path, names: Sequence[str]) -> None:
    """Draw the pictures with these names."""
    for name in names:
        moved_picture(SCENES[name]).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(Path(arguments[0]) if arguments else FOLDER, arguments[1:] or list(SCENES))
