"""`xfrustum budget`: the error of one image link by link, in numbers and pictures."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from plotly.colors import unlabel_rgb

from xfrustum.compare.budget import Budget, make_budget
from xfrustum.compare.chain import LINKS, Chain, make_chain
from xfrustum.compare.extent import require_seen
from xfrustum.compare.radiance_budget import RadianceBudget
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports import images, radiance_budgeting
from xfrustum.reports.outputs import Staging
from xfrustum.reports.tables import json_ready
from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.hogel_image import HogelImage
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.sampling import Sampling
from xfrustum.scenes.scene import Scene

IMAGES = ("T0", "T1", "T2", "T3", "R0", "R1")
"""Names of the chain's images, as the files are called."""

DATA, BY_TRIANGLE, BY_SURFACE = "budget.json", "causes-by-triangle.png", "causes-by-surface.png"
FILES = (DATA, BY_TRIANGLE, BY_SURFACE, *(f"{name}.webp" for name in IMAGES))
"""What is always written."""

LINK_COLORS = ("rgb(0,114,178)", "rgb(86,180,233)", "rgb(0,158,115)", "rgb(230,159,0)", "rgb(213,94,0)")
"""Okabe and Ito's palette, told apart by people with any color vision, in the order of the links."""
UNEXPLAINED_COLOR = "rgb(255,0,255)"
SHOWN_GRAY, EMPTY_GRAY = 215, 250


def budget_of(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> tuple[Budget, Chain]:
    """Trace and draw the chain of one aperture, and charge every wrong pixel to a link.

    Raises
    ------
    InputError
        The aperture sees nothing of the objects, or there is no usable OpenGL.
    """
    require_seen(scene, [aperture])
    # The links of geometry are about what pixels' centers show.
    once = replace(scene, sampling=Sampling())
    reference = Reference(once)
    with Rasterizer(once) as rasterizer:
        chain = make_chain(reference, rasterizer, aperture, settings)
    return make_budget(reference, chain), chain


def summary(budget: Budget, radiance: RadianceBudget | None) -> dict[str, Any]:
    """Return the numbers as `budget --json` prints them."""
    return {**budget.summary(), "radiance": radiance.summary() if radiance else None}


def write_budget(
    budget: Budget, chain: Chain, out: Path, radiance: RadianceBudget | None = None
) -> tuple[Path, ...]:
    """Write budget.json, every image of the chain, and the causes in color, all or nothing.

    With a budget of radiance, a picture of what each of its links changes, too.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    truth = chain.images[0]
    with Staging(out) as staging:
        text = json.dumps(json_ready(summary(budget, radiance)), allow_nan=False, indent=1)
        (staging.folder / DATA).write_text(text + "\n", encoding="utf-8")
        for name, image in zip(IMAGES, chain.images, strict=True):
            (staging.folder / f"{name}.webp").write_bytes(images.picture(image))
        unexplained = budget.explanation.unexplained
        by_triangle = causes(truth, budget.charge, unexplained)
        (staging.folder / BY_TRIANGLE).write_bytes(by_triangle)
        by_surface = causes(truth, budget.surface_charge, unexplained & (budget.surface_charge >= 0))
        (staging.folder / BY_SURFACE).write_bytes(by_surface)
        for name, encoded in radiance_budgeting.pictures(radiance) if radiance else ():
            (staging.folder / name).write_bytes(encoded)
        return staging.commit()


def causes(truth: HogelImage, charge: NDArray[np.int8], unexplained: NDArray[np.bool_]) -> bytes:
    """Encode which link each wrong pixel is charged to, over the truth's outline, as PNG.

    Parameters
    ----------
    truth
        Its surfaces are light gray.
    charge
        (H, W) links, negative where the pixel is right.
    unexplained
        (H, W) pixels shown in `UNEXPLAINED_COLOR` instead.
    """
    pixels = np.repeat(np.where(truth.covered, SHOWN_GRAY, EMPTY_GRAY)[..., None], 3, axis=-1)
    colors = np.array([unlabel_rgb(color) for color in LINK_COLORS])
    pixels[charge >= 0] = colors[charge[charge >= 0]]
    pixels[unexplained] = unlabel_rgb(UNEXPLAINED_COLOR)
    buffer = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def table(budget: Budget) -> str:
    """Return the budget as aligned lines, and below it what was predicted, with the ratios."""
    numbers = budget.summary()
    width = max(map(len, LINKS))
    lines = [f"{numbers['wrong']:,} of {numbers['judged']:,} judged pixels show another triangle"]
    lines.append(f"{'charged to':<{width}}  {'pixels':>9}  {'surface':>9}  {'moves by, px rms':>17}")
    for link in numbers["links"]:
        moved = _three_digits(link["displacement_rms_px"])
        lines.append(f"{link['name']:<{width}}  {link['pixels']:>9,}  {link['surface']:>9,}  {moved:>17}")
    reasons = ", ".join(f"{name} {count:,}" for name, count in numbers["explained"].items())
    lines.append(f"explained: {reasons}; unexplained {numbers['unexplained']:,}")
    lines.append(f"right in the end although some link differed: {numbers['cancelled']:,}")
    return "\n".join([*lines, "", *_prediction_lines(numbers["links"], width)])


def _prediction_lines(links: Sequence[Mapping[str, Any]], width: int) -> list[str]:
    """Return predicted, measured and their ratio of each link, for surfaces and for displacement."""
    three = f"{'predicted':>10} {'measured':>10} {'ratio':>7}"
    lines = [f"{'':<{width}}  {'wrong surface, pixels':>29}  {'moves by, px rms':>29}"]
    lines.append(f"{'predicted for':<{width}}  {three}  {three}")
    for link in links:
        surface = (link["predicted_surface"], link["surface"])
        moved = (link["predicted_displacement_rms_px"], link["displacement_rms_px"])
        columns = [
            f"{_three_digits(predicted):>10} {_three_digits(measured):>10} {_ratio(predicted, measured):>7}"
            for predicted, measured in (surface, moved)
        ]
        lines.append("  ".join([f"{link['name']:<{width}}", *columns]))
    return lines


def _ratio(predicted: float | None, measured: float | None) -> str:
    """Write measured over predicted, where there are both."""
    return _three_digits(measured / predicted) if predicted and measured is not None else "-"


def _three_digits(value: float | None) -> str:
    """Write a number with three digits, without an exponent where it is a count of pixels."""
    if value is None:
        return "-"
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
