"""`xfrustum budget`: the error of one image, split along a chain from the truth to the drawing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare import attribution
from xfrustum.compare.attribution import RIGHT, Budget, BudgetNumbers, LinkNumbers, make_budget
from xfrustum.compare.prediction.predict import Chain, make_chain
from xfrustum.compare.prediction.reasons import MIN_PIXELS, Reason
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common import pictures as images
from xfrustum.reports.common.outputs import (
    aperture_option,
    json_object,
    json_ready,
    progress_bar,
    scene_command,
    settings_words,
    write_files,
)
from xfrustum.reports.common.pictures import CAUSE_COLORS, UNEXPLAINED_COLOR
from xfrustum.reports.common.templates_environment import address, html_page, png
from xfrustum.reports.notebook import Figure, NotebookRepr, as_shown, marked
from xfrustum.reports.notebook import png as png_of
from xfrustum.reports.plotting import why
from xfrustum.reports.text import SENTENCES, aligned, require_seen, sentences
from xfrustum.scenes import Aperture, Cull, DoubleFrustum, HogelImage, Scene
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.representation import LEVELS, digits, percent

CHAIN = ("T0", "T1", "T2", "T3", "T4", "T5", "R0", "R1")
"""Names of the chain's images, used for files; T5 exists only if faces are culled."""

PAGE, DATA = "index.html", "budget.json"
BY_TRIANGLE, BY_SURFACE = "causes-by-triangle.png", "causes-by-surface.png"
FILES = (PAGE, DATA, BY_TRIANGLE, BY_SURFACE, *(f"{name}.webp" for name in CHAIN if name != "T5"))
"""Files that are always written, in addition to `radiance-*.png` for each link of radiance."""

SHOWN, EMPTY = (128, 128, 128, 90), (128, 128, 128, 14)
"""RGBA colors of right pixels with and without a surface, visible on white and on dark paper."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BudgetReport(NotebookRepr):
    """The error of one image, charged to its causes."""

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    #: images from the truth to the drawn frame
    chain: Chain
    #: every wrong pixel, charged to one link of the chain
    geometry: Budget
    #: the error of color, link by link
    radiance: attribution.RadianceBudget
    #: reason for the choice of the aperture; empty if it was given
    why: str = ""

    @property
    def place(self) -> str:
        """Description of the aperture."""
        return f"aperture {self.aperture.column},{self.aperture.row}"

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the chain's images."""
        # T5 differs from T4 only by culling.
        culled = self.settings.cull is not Cull.NONE
        return tuple(name for name in CHAIN if culled or name != "T5")

    def summary(self) -> dict[str, Any]:
        """Return one JSON object: errors of geometry, then errors of radiance."""
        geometry = json_object(with_sentences(self.geometry.numbers))
        return {**geometry, "radiance": json_object(self.radiance.numbers)}

    def table(self) -> str:
        """Return the numbers as aligned lines."""
        columns = ("mean", "rms", "max", "rms_same_triangle", "max_same_triangle", "standard_error")
        rows: list[tuple[str, ...]] = [
            ("radiance changes by", *(name.replace("_", " ") for name in columns))
        ]
        for row in _radiance_rows(self):
            values = (getattr(row, name) for name in columns)
            rows.append((row.name, *("-" if value is None else f"{value:.3g}" for value in values)))
        numbers = self.geometry.numbers
        reasons = ", ".join(f"{name} {count:,}" for name, count in numbers.explained.items())
        lines = [
            headline(numbers),
            aligned(_link_cells(numbers)),
            *prediction_notes(numbers),
            f"explained by the model of {numbers.device_model}: {reasons}; "
            f"unexplained {numbers.unexplained:,}",
            f"right in the end although some link differed: {numbers.cancelled:,}",
            aligned(rows),
        ]
        return "\n".join(lines)

    def _said(self) -> str:
        near = f"near {digits(self.settings.near)} {self.scene.units}"
        settings, numbers = f"{near}, {self.settings.depth_label}", self.geometry.numbers
        return f"{self.scene.name!r}, {self.place} with {settings}: {headline(numbers)}"

    def _figures(self) -> Sequence[Figure]:
        # Pixels without a charge are right or not judged.
        drawn, wrong = self.geometry.drawn, self.geometry.surface_charge != RIGHT
        shown = as_shown(drawn.color, drawn.covered, drawn.height)
        marks = marked(shown, wrong, self.geometry.errors.moved)
        caption = "wrong surfaces red, displacement blue (full at 1 px)"
        return (Figure(caption=caption, content=png_of(marks)),)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AutoBudget(NotebookRepr):
    """Budgets at the apertures chosen for a plate, in the order of the apertures."""

    budgets: tuple[BudgetReport, ...]

    def summary(self) -> dict[str, Any]:
        """Return one JSON object: a budget for each aperture, with the reason of its choice."""
        every = [
            {"aperture": report.aperture.index, "why": report.why, **report.summary()}
            for report in self.budgets
        ]
        return {"apertures": json_ready(every)}

    def table(self) -> str:
        """Return the budgets one below the other, each under its aperture."""
        return "\n\n".join(
            f"{report.place}: {report.why}\n{report.table()}" for report in self.budgets
        )

    def _said(self) -> str:
        lines = (
            f"{report.place.removeprefix('aperture ')}: {headline(report.geometry.numbers)}"
            for report in self.budgets
        )
        return f"{len(self.budgets)} apertures; " + "; ".join(lines)


def auto_budget(
    scene: Scene,
    settings: DoubleFrustum,
    auto: AutoApertures,
    *,
    progress: bool = False,
    device: DeviceModel | None = None,
) -> AutoBudget:
    """Return a budget at each of the apertures that were chosen for a plate; see `budget`."""
    budgets = [
        replace(
            budget(scene, settings, choice.aperture, progress=progress, device=device),
            why=why(choice, scene.units),
        )
        for choice in auto.chosen
    ]
    return AutoBudget(budgets=tuple(budgets))


def budget(
    scene: Scene,
    settings: DoubleFrustum,
    aperture: Aperture | None = None,
    *,
    progress: bool = False,
    device: DeviceModel | None = None,
) -> BudgetReport:
    """Charge every wrong pixel of one image to its cause, and split its radiance error by link.

    Sampling and light transport of the scene are also links of the radiance error. `aperture` None
    selects the middle one, and `progress` draws a bar on standard error. `device` is the model that
    explains rounding; None selects the recorded model of the current device. InputError if the
    settings make no sense for the scene, the aperture shows none of the objects, or there is no
    usable OpenGL.
    """
    one_of(scene, Scene, "scene")
    one_of(settings, DoubleFrustum, "settings")
    aperture = scene.plate.middle if aperture is None else aperture
    # Impossible settings fail before minutes of tracing.
    settings.check_against(scene.frustum)
    charged, chain = budget_of(scene, aperture, settings, device)
    total = attribution.steps(scene)
    with progress_bar(total, "radiance", "image", shown=progress and total > 0) as bar:
        radiance = attribution.make_radiance_budget(scene, chain, bar.update)
    return BudgetReport(
        scene=scene,
        aperture=aperture,
        settings=settings,
        chain=chain,
        geometry=charged,
        radiance=radiance,
    )


def budget_of(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, device: DeviceModel | None = None
) -> tuple[Budget, Chain]:
    """Trace and draw the chain of one aperture, and charge wrong pixels to links."""
    require_seen(scene, [aperture])
    # Averages over samples mix triangles: only single samples can be charged to links.
    once = replace(scene, sampling=Sampling())
    reference = Reference(once)
    with Rasterizer(once, model=device) as rasterizer:
        chain = make_chain(reference, rasterizer, aperture, settings)
    return make_budget(reference, chain), chain


#: name of the total radiance error, in lists of its links
IN_ALL = "in all"


def _radiance_rows(report: BudgetReport) -> tuple[attribution.RadianceLink, ...]:
    """Return the contribution of each link to the radiance error, and the total error."""
    numbers = report.radiance.numbers
    return (
        *numbers.links,
        attribution.RadianceLink(name=IN_ALL, **vars(numbers.total), standard_error=None),
    )


def _radiance_file(name: str) -> str:
    return f"radiance-{'total' if name == IN_ALL else name.replace(' ', '-')}.png"


def _counts(link: LinkNumbers) -> bool:
    """Return whether a link changes any pixel, or is predicted to change pixels."""
    return bool(link.surface or link.pixels or link.predicted_surface or link.displacement_rms_px)


def headline(numbers: BudgetNumbers) -> str:
    """Return the numbers of pixels with wrong surfaces and triangles, and the main cause."""
    wrong = sum(link.surface for link in numbers.links)
    # Ties between causes go to the earlier link of the chain.
    most = max(numbers.links, key=lambda link: link.surface)
    cause = f", {most.surface:,} of them by the {most.name}" if wrong else ""
    return (
        f"{wrong:,} of {numbers.judged:,} judged pixels "
        f"({percent(wrong / max(numbers.judged, 1))}) show the wrong surface{cause}; "
        f"{numbers.wrong:,} show another triangle"
    )


def _link_cells(numbers: BudgetNumbers) -> list[Sequence[str]]:
    """Return a header row, and a row for each link with its prediction and ratios."""
    compared = ("predicted", "ratio")
    rows: list[Sequence[str]] = [
        ("charged to", "pixels", "surface", *compared, "moves by, px rms", *compared)
    ]
    for link in numbers.links:
        cells = [link.name, f"{link.pixels:,}"]
        for measured, predicted in (
            (link.surface, link.predicted_surface),
            (link.displacement_rms_px, link.predicted_displacement_rms_px),
        ):
            # A prediction of zero has no ratio; the row then has a dash in its place.
            ratio = measured / predicted if predicted and measured is not None else None
            cells += map(_three_digits, (measured, predicted, ratio))
        rows.append(cells)
    return rows


def with_sentences(numbers: BudgetNumbers) -> BudgetNumbers:
    """Return the numbers of a budget, with reasons for invalid predictions as sentences."""
    links = tuple(
        replace(link, prediction_reasons=sentences(link.prediction_reasons))
        for link in numbers.links
    )
    return replace(numbers, prediction_reasons=sentences(numbers.prediction_reasons), links=links)


def prediction_notes(numbers: BudgetNumbers) -> list[str]:
    """Return the invalid predictions of a budget, with the reasons."""
    named: dict[str, Reason] = {}
    for link in numbers.links:
        reasons = link.prediction_reasons
        # A prediction of zero is exact for links without effect.
        if reasons.displacement and link.predicted_displacement_rms_px != 0:
            named.setdefault("moves by", Reason(reasons.displacement))
        # Few pixels were predicted but many are wrong: chance does not explain this.
        if reasons.surface == Reason.FEW and link.surface >= MIN_PIXELS:
            # Rounding displaces whole regions of a surface that passes through the aperture.
            crosses = numbers.prediction_reasons.displacement == Reason.CROSSES
            named[f"surface of {link.name}"] = Reason.CROSSES if crosses else Reason.FEW
        elif reasons.surface:
            named[f"surface of {link.name}"] = Reason(reasons.surface)
    return [f"predicted {name}: {SENTENCES[reason]}" for name, reason in named.items()]


def _three_digits(value: float | None) -> str:
    """Write a number with three digits, or from 1,000 on with all digits before the point."""
    if value is None:
        return "-"
    # Counts of pixels stay exact; lengths in pixels need three digits.
    return f"{value:,.0f}" if value >= 1000 else digits(value)


def write_budget(report: BudgetReport | AutoBudget, out: Path) -> tuple[Path, ...]:
    """Write page, budget.json, images of the chain, and causes in color, all or nothing.

    The files include a picture of the change of radiance by each link. Each of several budgets has
    its own folder, named by its aperture. InputError if a folder cannot be written.
    """
    if isinstance(report, AutoBudget):
        # Each folder is written as a whole; a failure keeps the finished folders.
        every = (write_budget(part, out / folder_of(part.aperture)) for part in report.budgets)
        return tuple(path for paths in every for path in paths)
    geometry, numbers, links = (
        report.geometry,
        report.geometry.numbers,
        report.geometry.numbers.links,
    )
    unexplained, wrong = geometry.explanation.unexplained, geometry.surface_charge >= 0
    truth, own = report.chain.images[0], [CAUSE_COLORS[link.name] for link in links]
    chain = zip(report.images, report.chain.images, strict=True)
    pictures = {f"{name}.webp": images.picture(image) for name, image in chain}
    pictures[BY_TRIANGLE] = causes(truth, geometry.charge, unexplained, own)
    pictures[BY_SURFACE] = causes(truth, geometry.surface_charge, unexplained & wrong, own)
    changes = (*report.radiance.steps, report.radiance.total)
    for name, change in zip((*report.radiance.links, IN_ALL), changes, strict=True):
        pictures[_radiance_file(name)] = images.radiance_map(change)
    # A map of a link without effect would be a black picture.
    changing = [part for part in _radiance_rows(report) if part.max]
    words = [*aperture_option(report.scene, report.aperture), *settings_words(report.settings)]
    values = {
        **{name: getattr(report, name) for name in ("scene", "aperture", "why", "settings")},
        "numbers": numbers,
        "headline": headline(numbers),
        "links": [link for link in links if _counts(link)],
        "idle": [link for link in links if not _counts(link)],
        "changing": changing,
        "unchanging": [part for part in _radiance_rows(report) if not part.max],
        "colors": CAUSE_COLORS,
        "notes": prediction_notes(numbers),
        "unexplained_color": UNEXPLAINED_COLOR,
        "chain": report.images,
        "by_triangle": BY_TRIANGLE,
        "by_surface": BY_SURFACE,
        "radiance_pictures": [_radiance_file(part.name) for part in changing],
        "radiance_range": images.RADIANCE_RANGE,
        "radiance_colors": images.RADIANCE_SCALE,
        "pictures": {name: address(encoded) for name, encoded in pictures.items()},
        "command": scene_command("budget", report.scene, *words),
    }
    page = html_page("budget.html.j2", values, {"number": _three_digits})
    return write_files(out, {PAGE: page, DATA: report.summary(), **pictures})


def folder_of(aperture: Aperture) -> str:
    """Return the name of the folder of one of several apertures."""
    return f"aperture-{aperture.column}-{aperture.row}"


def causes(
    truth: HogelImage, charge: NDArray[np.int8], unexplained: Mask, link_colors: Sequence[str]
) -> bytes:
    """Encode the link to which each wrong pixel is charged, over the truth's outline, as PNG.

    `charge` (H, W) is negative where a pixel is right; unexplained pixels have a separate color.
    """
    # Right pixels keep an outline of the scene, readable on light and dark paper.
    pixels = np.where(truth.covered[..., None], SHOWN, EMPTY)
    # Opaque colors over translucent gray: wrong pixels stand out on any paper.
    colors = np.array([(*images.rgb(color), LEVELS) for color in link_colors])
    pixels[charge >= 0] = colors[charge[charge >= 0]]
    pixels[unexplained] = (*images.rgb(UNEXPLAINED_COLOR), LEVELS)
    return png(pixels)
