"""`xfrustum budget`: the error of one image link by link, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from xfrustum.compare.attribution.budget import (
    RIGHT,
    Budget,
    BudgetNumbers,
    LinkNumbers,
    make_budget,
    said_of_budget,
)
from xfrustum.compare.attribution.radiance_budget import RadianceBudget, RadianceNumbers
from xfrustum.compare.extent_words import require_seen
from xfrustum.compare.prediction.chain import Chain, make_chain
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.commands import radiance_budgeting
from xfrustum.reports.common.json_ready import INLINED, Summarized
from xfrustum.reports.scout import ChoiceRecord, spelled
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.numbers import digits
from xfrustum.scenes.notebook.pictures import as_shown, marked, png
from xfrustum.scenes.notebook.shown import Figure, Shown, Table
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class BudgetRecord(BudgetNumbers):
    """JSON object of a `BudgetReport`: the numbers of geometry, and those of radiance after them."""

    radiance: RadianceNumbers


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BudgetReport(Shown, Summarized[BudgetRecord]):
    """The error of one image, charged to its causes.

    Attributes
    ----------
    scene, aperture, settings
        Scene, aperture and settings of the image.
    chain
        The images from the truth to what was drawn.
    geometry
        Every wrong pixel, charged to one link of the chain.
    radiance
        The error of color, link by link.
    why
        Reason for which the aperture was chosen; empty where it was given.
    """

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    chain: Chain
    geometry: Budget
    radiance: RadianceBudget
    why: str = ""

    @property
    def record(self) -> BudgetRecord:
        """The numbers, as they are written."""
        return BudgetRecord(**vars(self.geometry.numbers), radiance=self.radiance.numbers)

    def table(self) -> str:
        """Return the numbers as aligned lines."""
        return f"{table(self.geometry)}\n{radiance_budgeting.table(self.radiance)}"

    def _said(self) -> str:
        column, row = self.aperture.index
        settings = f"near {digits(self.settings.near)} {self.scene.units}, {self.settings.depth_label}"
        return (
            f"{self.scene.name!r}, aperture {column},{row} with {settings}: {said_of_budget(self.geometry)}"
        )

    def _tables(self) -> Sequence[Table]:
        head = ("charged to", "pixels", "surface", "moves by, px rms")
        links = self.geometry.causes
        rows = [
            (link.name, f"{link.triangle:,}", f"{link.surface:,}", _three_digits(link.displacement_rms_px))
            for link in links
        ]
        counts = self.geometry.explanation.counts()
        rounding = ", ".join(f"{count:,} {name}" for name, count in counts.items())
        return (Table(head=head, rows=rows, numbers=True), Table(rows=[("wrong by rounding", rounding)]))

    def _figures(self) -> Sequence[Figure]:
        drawn, wrong = self.geometry.drawn, self.geometry.surface_charge != RIGHT
        shown = as_shown(drawn.color, drawn.covered, drawn.height)
        caption = "wrong surfaces red, displacement blue (full at 1 px)"
        marks = marked(shown, wrong, self.geometry.moved)
        return (Figure(caption=caption, content=png(marks)),)


@dataclass(frozen=True, kw_only=True)
class PlacedBudgetRecord:
    """The budget of one of several apertures."""

    choice: ChoiceRecord = field(metadata=INLINED)
    budget: BudgetRecord = field(metadata=INLINED)


@dataclass(frozen=True, kw_only=True)
class AutoBudgetRecord:
    """JSON object of an `AutoBudget`."""

    apertures: tuple[PlacedBudgetRecord, ...]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AutoBudget(Shown, Summarized[AutoBudgetRecord]):
    """A budget at each of the apertures that were chosen for a plate.

    Attributes
    ----------
    auto
        The apertures, with the reasons for which they were chosen.
    budgets
        One for each aperture, in the same order.
    """

    auto: AutoApertures
    budgets: tuple[BudgetReport, ...]

    @property
    def record(self) -> AutoBudgetRecord:
        """The numbers, as they are written."""
        return AutoBudgetRecord(
            apertures=tuple(
                PlacedBudgetRecord(choice=ChoiceRecord.of(chosen), budget=one.record)
                for chosen, one in zip(self.auto.chosen, self.budgets, strict=True)
            )
        )

    def table(self) -> str:
        """Return the budgets one below the other, each under its aperture."""
        parts = [
            f"{spelled(chosen)}\n{one.table()}"
            for chosen, one in zip(self.auto.chosen, self.budgets, strict=True)
        ]
        return "\n\n".join(parts)

    def _said(self) -> str:
        return f"{len(self.budgets)} apertures; " + "; ".join(
            f"{one.aperture.column},{one.aperture.row}: {said_of_budget(one.geometry)}"
            for one in self.budgets
        )

    def _tables(self) -> Sequence[Table]:
        rows = [
            (*spelled(chosen).split(": ", 1), said_of_budget(one.geometry))
            for chosen, one in zip(self.auto.chosen, self.budgets, strict=True)
        ]
        return (Table(rows=rows),)


def auto_budget(
    scene: Scene, settings: DoubleFrustum, auto: AutoApertures, *, progress: bool = False
) -> AutoBudget:
    """Return a budget at each of the apertures that were chosen for a plate; see `budget`."""
    budgets = [
        replace(budget(scene, settings, one.aperture, progress=progress), why=one.why) for one in auto.chosen
    ]
    return AutoBudget(auto=auto, budgets=tuple(budgets))


def budget(
    scene: Scene, settings: DoubleFrustum, aperture: Aperture | None = None, *, progress: bool = False
) -> BudgetReport:
    """Charge every wrong pixel of one image to its cause, and take its radiance error apart.

    Parameters
    ----------
    scene
        Scene whose sampling and light transport are links of the radiance error.
    settings
        Settings that the image is drawn with.
    aperture
        The middle one where None.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The settings make no sense for the scene, or there is no usable OpenGL.
    """
    one_of(scene, Scene, "scene")
    one_of(settings, DoubleFrustum, "settings")
    aperture = scene.plate.middle if aperture is None else aperture
    settings.check_against(scene.frustum)
    charged, chain = budget_of(scene, aperture, settings)
    radiance = radiance_budgeting.radiance_budget_of(scene, chain, progress=progress)
    return BudgetReport(
        scene=scene, aperture=aperture, settings=settings, chain=chain, geometry=charged, radiance=radiance
    )


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


def table(geometry: Budget) -> str:
    """Return the budget as aligned lines, and below it what was predicted, with the ratios."""
    numbers = geometry.numbers
    width = max(len(link.name) for link in numbers.links)
    lines = [f"{numbers.wrong:,} of {numbers.judged:,} judged pixels show another triangle"]
    lines.append(f"{'charged to':<{width}}  {'pixels':>9}  {'surface':>9}  {'moves by, px rms':>17}")
    for link in numbers.links:
        moved = _three_digits(link.displacement_rms_px)
        lines.append(f"{link.name:<{width}}  {link.pixels:>9,}  {link.surface:>9,}  {moved:>17}")
    reasons = ", ".join(f"{name} {count:,}" for name, count in numbers.explained.items())
    lines.append(f"explained: {reasons}; unexplained {numbers.unexplained:,}")
    lines.append(f"right in the end although some link differed: {numbers.cancelled:,}")
    return "\n".join([*lines, "", *_prediction_lines(numbers.links, width)])


def _prediction_lines(links: Sequence[LinkNumbers], width: int) -> list[str]:
    """Return predicted, measured and their ratio of each link, for surfaces and for displacement."""
    three = f"{'predicted':>10} {'measured':>10} {'ratio':>7}"
    lines = [f"{'':<{width}}  {'wrong surface, pixels':>29}  {'moves by, px rms':>29}"]
    lines.append(f"{'predicted for':<{width}}  {three}  {three}")
    for link in links:
        surface = (link.predicted_surface, link.surface)
        moved = (link.predicted_displacement_rms_px, link.displacement_rms_px)
        columns = [
            f"{_three_digits(predicted):>10} {_three_digits(measured):>10} {_ratio(predicted, measured):>7}"
            for predicted, measured in (surface, moved)
        ]
        lines.append("  ".join([f"{link.name:<{width}}", *columns]))
    return lines


def _ratio(predicted: float | None, measured: float | None) -> str:
    """Write measured over predicted, where there are both."""
    return _three_digits(measured / predicted) if predicted and measured is not None else "-"


def _three_digits(value: float | None) -> str:
    """Write a number with three digits, without an exponent where it is a count of pixels."""
    if value is None:
        return "-"
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
