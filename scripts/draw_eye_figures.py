"""Draw the pictures of eyes in docs as PNG: python -m scripts.draw_eye_figures [FOLDER] [NAME ..].

`moved-car` and `moved-asymmetric` belong to docs/method.md, `plans-car` to docs/noticeable.md.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tests.support.moved_scene import MovedScene, moved_scene

from xfrustum.compare.eye.loss import (
    Collector,
    LossMaps,
    Views,
    collected,
    display_loss,
    film_parts,
    renderer_loss,
)
from xfrustum.compare.eye.noticeable import Viewer
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reports.notebook import WRONG
from xfrustum.reports.planning import plan
from xfrustum.reports.view import Drawing, shown
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, Scene, open_scene
from xfrustum.scenes.arrays import Bytes, Mask
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.hogel_image import NOTHING

FOLDER = Path("docs") / "images"

MOVED_NEAR, MOVED_EYE = 6.0, Eye(position=(40.0, 20.0, 600.0), resolution=(320, 240))
"""Near offset of the pictures of moved scenes, mm, and their eye."""

PLAN_EYES = tuple(
    Eye(position=(x, 0.0, 600.0), resolution=(320, 240)) for x in (-150.0, 0.0, 150.0)
)
"""Eyes that both plans of the car are shown to."""

CAPTION_PX, GAP_PX = 20, 6
"""Height of a line of words over a picture, and width of the gap between two."""


def drawn(
    scene: Scene, eyes: Sequence[Eye], settings: DoubleFrustum
) -> tuple[EyeReference, list[Views]]:
    """Return the three pictures of some eyes."""
    reference = EyeReference(scene)
    takes = [reference.replay(eye) for eye in eyes]
    collectors = [
        Collector(scene, eye, taken, settings) for eye, taken in zip(eyes, takes, strict=True)
    ]
    images = collected(Drawing(scene, settings).hogels(film_parts(takes)), collectors)
    return reference, [
        Views(
            true=reference.true_view(eye),
            replayed=reference.replayed(eye),
            drawn=image,
            taken=taken,
        )
        for eye, image, taken in zip(eyes, images, takes, strict=True)
    ]


def as_moved(image: EyeImage, moved: MovedScene) -> EyeImage:
    """Return a drawn view with its surface points, and their triangles' numbers, where they are seen."""
    side = np.where(image.position[..., 2] > 0, 1.0, -1.0)
    position = image.position.copy()
    position[..., 2] += side * MOVED_NEAR
    middle = moved.scene.triangles[..., 2].mean(axis=1)
    number = np.full(image.triangle.shape, NOTHING, dtype=np.int32)
    for before in (False, True):
        # All parts of a triangle on one side lie in one plane: any of them stands for it.
        parts = np.flatnonzero((middle > 0) == before)
        part_of = np.full(int(moved.number.max()) + 2, NOTHING, dtype=np.int32)
        part_of[moved.number[parts]] = parts
        here = (image.triangle != NOTHING) & ((side > 0) == before)
        number[here] = part_of[image.triangle[here]]
    return replace(image, position=position, triangle=number)


def marked(image: EyeImage, wrong: Mask) -> Bytes:
    """Return a dimmed view on which wrong surfaces are marked."""
    gray = shown(image).mean(axis=-1, keepdims=True) * 0.6 + 40.0 * image.covered[..., None]
    picture = np.repeat(gray, 3, axis=-1)
    picture[wrong] = WRONG
    levels: Bytes = np.rint(np.clip(picture, 0, 255)).astype(np.uint8)
    return levels


def words_of(maps: LossMaps) -> str:
    """Return the share of wrong surfaces in words."""
    assert maps.wrong is not None
    return f"{100 * maps.wrong.sum() / maps.judged.sum():.2g} %"


def moved_picture(name: str) -> Image.Image:
    """Return C, C against B, C against the true view of the moved scene, and B against A."""
    settings = DoubleFrustum(near=MOVED_NEAR, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
    scene = open_scene(name)
    reference, (views,) = drawn(scene, [MOVED_EYE], settings)
    assert views.drawn is not None
    moved = moved_scene(scene, settings)
    other = EyeReference(moved.scene)
    seen = Views(
        true=other.true_view(MOVED_EYE, shaded=False),
        replayed=as_moved(views.drawn, moved),
        drawn=None,
        taken=views.taken,
    )
    renderer = renderer_loss(reference, views, numbered=True)
    theorem, display = display_loss(other, seen), display_loss(reference, views)
    assert renderer.wrong is not None and theorem.wrong is not None and display.wrong is not None
    return sheet(
        [
            [
                (f"{name}: C, n = {MOVED_NEAR:g} mm", shown(views.drawn)),
                (f"C against B: {words_of(renderer)} wrong", marked(views.drawn, renderer.wrong)),
                (
                    f"C against A of the moved scene: {words_of(theorem)}",
                    marked(views.drawn, theorem.wrong),
                ),
                (f"B against A: {words_of(display)}", marked(views.replayed, display.wrong)),
            ]
        ]
    )


def plans_picture() -> Image.Image:
    """Return the car as three eyes see it, and as both plans show it."""
    scene = open_scene("car")
    plans = {
        "to pixels": plan(scene).settings,
        "to eyes": plan(scene, viewer=Viewer(distance=600.0)).settings,
    }
    return settings_picture(
        scene, {words: found for words, found in plans.items() if found is not None}
    )


def settings_picture(scene: Scene, plans: Mapping[str, DoubleFrustum]) -> Image.Image:
    """Return a scene as three eyes see it, truly, replayed, and drawn with some settings."""
    lines: list[list[tuple[str, Bytes]]] = []
    for words, settings in plans.items():
        reference, views = drawn(scene, PLAN_EYES, settings)
        if not lines:
            lines.append(
                [(f"true, eye at {v.eye.position[0]:g}, 0, 600", shown(v.true)) for v in views]
            )
            lines.append([("replayed truth", shown(v.replayed)) for v in views])
        near = f"{words}: n = {settings.near:.3g}, {settings.depth_label}"
        lines.append([plan_cell(near, reference, view) for view in views])
    return sheet(lines)


def plan_cell(words: str, reference: EyeReference, view: Views) -> tuple[str, Bytes]:
    """Return words and picture of what a plan shows to an eye."""
    assert view.drawn is not None
    maps = renderer_loss(reference, view, numbered=True)
    flip = maps.numbers().flip or 0.0
    return f"{words}, FLIP {flip:.2g}, {words_of(maps)} wrong", shown(view.drawn)


def sheet(lines: Sequence[Sequence[tuple[str, Bytes]]]) -> Image.Image:
    """Return pictures in rows, each under a line of words."""
    height, width = lines[0][0][1].shape[:2]
    step = (width + GAP_PX, height + GAP_PX + CAPTION_PX)
    size = (step[0] * max(map(len, lines)) - GAP_PX, step[1] * len(lines) - GAP_PX)
    picture = Image.new("RGB", size, (255, 255, 255))
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(11)
    for row, line in enumerate(lines):
        for column, (words, pixels) in enumerate(line):
            corner = (column * step[0], row * step[1])
            pen.text((corner[0] + 2, corner[1] + 2), words, fill=(30, 30, 30), font=font)
            picture.paste(Image.fromarray(pixels), (corner[0], corner[1] + CAPTION_PX))
    return picture


FIGURES = {
    "moved-car": lambda: moved_picture("car"),
    "moved-asymmetric": lambda: moved_picture("asymmetric"),
    "plans-car": plans_picture,
}


def main(folder: Path, names: Sequence[str]) -> None:
    """Draw some figures."""
    for name in names:
        FIGURES[name]().save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    given = sys.argv[1:]
    main(Path(given[0]) if given else FOLDER, given[1:] or list(FIGURES))
