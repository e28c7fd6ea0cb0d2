"""The folder of `xfrustum budget --out`: a page with a legend, budget.json, and the pictures."""

from __future__ import annotations

import base64
import io
import json
import shlex
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from plotly.colors import unlabel_rgb

from xfrustum.compare.prediction.chain import CULLING, LINKS
from xfrustum.reports.commands import radiance_budgeting
from xfrustum.reports.commands.budgeting import AutoBudget, BudgetReport
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.causes import CAUSE_COLORS, UNEXPLAINED_COLOR
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.notebook.numbers import digits
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

IMAGES = ("T0", "T1", "T2", "T3", "T4", "R0", "R1")
"""Names of the chain's images, as the files are called."""

PAGE, DATA = "index.html", "budget.json"
BY_TRIANGLE, BY_SURFACE = "causes-by-triangle.png", "causes-by-surface.png"
FILES = (PAGE, DATA, BY_TRIANGLE, BY_SURFACE, *(f"{name}.webp" for name in IMAGES))
"""Files that are always written; `radiance-*.png` come beside it, one for each link of the radiance error."""

LINK_COLORS = tuple(CAUSE_COLORS[name] for name in LINKS)
"""Colors of the links, in their order."""
SHOWN_GRAY, EMPTY_GRAY = 215, 250

CHAIN_WORDS = (
    "the truth",
    "with the near offset",
    "with the pivot",
    "with the fit",
    "with slabs",
    "rasterized, with linear depth",
    "as it is drawn",
)
"""What each image of the chain shows."""

LINK_WORDS = (
    "both cameras step back from the plate by near",
    "where the shear is centered",
    "which plane is drawn exactly",
    "both frusta are cut, and all but the first slab have cameras of their own",
    "vertices and edges are rounded to 32-bit floats and to subpixels",
    "depth is rounded to what the depth buffer stores",
)
"""What each link of the chain changes."""

CULLED_IMAGE, CULLED_WORDS = "T5", "with faces culled that are turned away from the viewer"
"""Name and words of the image that a chain has after `T4` where faces are culled."""
CULLING_COLOR = CAUSE_COLORS[CULLING]
CULLING_WORDS = "faces that are turned away from the viewer are left out"

EXPLANATION_WORDS = {
    "edge": "the pixel's center lies so near an edge, or a cut, that the rounding of vertices decides",
    "order": "the two surfaces are so near each other that the rounding of depth decides",
    "lost": "the surface lies so near the depth buffer's clear value that the rounding of depth decides",
    "unexplained": "none of these: somebody's bug",
}
"""What pixels that rounding changed are explained by."""

_KINDS = {".png": "image/png", ".webp": "image/webp"}


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One row of the legend, with its numbers; None where there are none."""

    name: str
    color: str
    words: str
    pixels: int
    surface: int | None
    moved_px: float | None
    predicted_px: float | None
    predicted_surface: float | None


def write_budget(report: BudgetReport | AutoBudget, out: Path) -> tuple[Path, ...]:
    """Write a page, budget.json, every image of the chain, and the causes in color, all or nothing.

    With a picture of what each link of the radiance error changes, too. Several budgets are written to
    a folder each, named by their apertures.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    if isinstance(report, AutoBudget):
        every = (write_budget(one, out / folder_of(one.aperture)) for one in report.budgets)
        return tuple(path for paths in every for path in paths)
    pictures = _pictures(report)
    with Staging(out, FILES) as staging:
        text = json.dumps(report.summary(), allow_nan=False, indent=1)
        (staging.folder / DATA).write_text(text + "\n", encoding="utf-8")
        for name, encoded in pictures.items():
            (staging.folder / name).write_bytes(encoded)
        (staging.folder / PAGE).write_text(_page(report, pictures), encoding="utf-8")
        return staging.commit()


def folder_of(aperture: Aperture) -> str:
    """Return the name of the folder of one of several apertures."""
    return f"aperture-{aperture.column}-{aperture.row}"


def _pictures(report: BudgetReport) -> dict[str, bytes]:
    """Return all pictures by the names of their files."""
    budget, truth = report.geometry, report.chain.images[0]
    unexplained = budget.explanation.unexplained
    names = _with_culling(IMAGES, CULLED_IMAGE, report)
    colors = _with_culling(LINK_COLORS, CULLING_COLOR, report)
    found = {
        f"{name}.webp": images.picture(image) for name, image in zip(names, report.chain.images, strict=True)
    }
    wrong = budget.surface_charge >= 0
    found[BY_TRIANGLE] = causes(truth, budget.charge, unexplained, colors)
    found[BY_SURFACE] = causes(truth, budget.surface_charge, unexplained & wrong, colors)
    return found | dict(radiance_budgeting.pictures(report.radiance))


def _with_culling(usual: tuple[str, ...], culled: str, report: BudgetReport) -> tuple[str, ...]:
    """Return one text for each image or link of a chain, with that of culling before the last two."""
    return usual if report.settings.cull is Cull.NONE else (*usual[:-2], culled, *usual[-2:])


def causes(
    truth: HogelImage,
    charge: NDArray[np.int8],
    unexplained: Mask,
    link_colors: tuple[str, ...] = LINK_COLORS,
) -> bytes:
    """Encode which link each wrong pixel is charged to, over the truth's outline, as PNG.

    Parameters
    ----------
    truth
        Image that is right; its surfaces are light gray.
    charge
        (H, W) links, negative where the pixel is right.
    unexplained
        (H, W) pixels shown in `UNEXPLAINED_COLOR` instead.
    link_colors
        Color of each link.
    """
    pixels = np.repeat(np.where(truth.covered, SHOWN_GRAY, EMPTY_GRAY)[..., None], 3, axis=-1)
    colors = np.array([unlabel_rgb(color) for color in link_colors])
    pixels[charge >= 0] = colors[charge[charge >= 0]]
    pixels[unexplained] = unlabel_rgb(UNEXPLAINED_COLOR)
    buffer = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def command(report: BudgetReport) -> str:
    """Return the command that makes this budget again."""
    scene, aperture = report.scene, report.aperture
    words = ["xfrustum", "budget", scene.source or scene.name]
    if aperture != scene.plate.middle:
        words += ["--aperture", f"{aperture.column},{aperture.row}"]
    for field in fields(DoubleFrustum):
        value = getattr(report.settings, field.name)
        if field.default is MISSING or value != field.default:
            text = ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)
            words += [f"--{field.name}", text]
    return shlex.join(words)


def _legend(report: BudgetReport) -> list[Cause]:
    """Return the links in the order of the chain, and after them what no link explains."""
    explanation = report.geometry.explanation
    link_colors = _with_culling(LINK_COLORS, CULLING_COLOR, report)
    link_words = _with_culling(LINK_WORDS, CULLING_WORDS, report)
    rows = [
        Cause(
            name=link.name,
            color=color,
            words=words,
            pixels=link.pixels,
            surface=link.surface,
            moved_px=link.displacement_rms_px,
            predicted_px=link.predicted_displacement_rms_px,
            predicted_surface=link.predicted_surface,
        )
        for link, color, words in zip(report.geometry.numbers.links, link_colors, link_words, strict=True)
    ]
    unexplained = Cause(
        name="unexplained",
        color=UNEXPLAINED_COLOR,
        words=EXPLANATION_WORDS["unexplained"],
        pixels=int(explanation.unexplained.sum()),
        surface=int((explanation.unexplained & (report.geometry.surface_charge >= 0)).sum()),
        moved_px=None,
        predicted_px=None,
        predicted_surface=None,
    )
    return [*rows, unexplained]


def _page(report: BudgetReport, pictures: Mapping[str, bytes]) -> str:
    numbers = report.record
    counts = {**numbers.explained, "unexplained": numbers.unexplained}
    values = {
        "scene": report.scene,
        "aperture": report.aperture,
        "why": report.why,
        "settings": report.settings,
        "numbers": numbers,
        "radiance": numbers.radiance,
        "legend": _legend(report),
        "explained": [(name, words, counts[name]) for name, words in EXPLANATION_WORDS.items()],
        "grays": (
            f"rgb({SHOWN_GRAY},{SHOWN_GRAY},{SHOWN_GRAY})",
            f"rgb({EMPTY_GRAY},{EMPTY_GRAY},{EMPTY_GRAY})",
        ),
        "chain": list(
            zip(
                _with_culling(IMAGES, CULLED_IMAGE, report),
                _with_culling(CHAIN_WORDS, CULLED_WORDS, report),
                strict=True,
            )
        ),
        "by_triangle": BY_TRIANGLE,
        "by_surface": BY_SURFACE,
        "radiance_pictures": [name for name in pictures if name.startswith("radiance-")],
        "radiance_range": images.RADIANCE_RANGE,
        "radiance_colors": images.radiance_scale(),
        "pictures": {name: _data_uri(name, encoded) for name, encoded in pictures.items()},
        "command": command(report),
        "links": len(numbers.links),
    }
    return html_page("budget.html.j2", {"digits": digits}, values)


def _data_uri(name: str, encoded: bytes) -> str:
    return f"data:{_KINDS[Path(name).suffix]};base64,{base64.b64encode(encoded).decode()}"
