"""`report`, `compare`, `budget`: errors between truth and raster, swept, of two images, and by cause."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from xfrustum.cli import options
from xfrustum.cli.commands.aperture import check_no_other_tracer
from xfrustum.cli.light import ALL, BUDGET, light_options
from xfrustum.cli.options import (
    DEPTHS,
    FIT,
    FOLDER,
    INDICES,
    NUMBERS,
    flag,
    list_of,
    one_of,
    option,
    several,
)
from xfrustum.scenes.plate.double_frustum import Cull, Offset, Pivot

if TYPE_CHECKING:
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.plate.plate import Aperture

_CUT = options.Read("Z,Z", lambda text: () if text.lower() == "none" else NUMBERS.read(text), "")
_CUTS = list_of(_CUT, ";", "Z,Z;none", "lists of heights such as '15,40;20;none'")


class _Report(options.Measured):
    scene = options.scene_argument
    sweep = several(
        nears=option(
            NUMBERS,
            "Offsets in scene units.  [default: 25, from 1e-1 to 1e-8 of the reach]",
            "--near",
        ),
        depths=option(
            DEPTHS, "Depth buffers, such as d24,d32f:reversed.  [default: five]", "--depth"
        ),
        pivots=option(
            list_of(one_of(Pivot)),
            "Centers of the shear.  [default: as `raster`; if recentered, both]",
            "--pivot",
        ),
        fits=option(
            list_of(FIT), "Heights |z| drawn exactly.  [default: the first cut, or angle]", "--fit"
        ),
        offsets=option(
            list_of(one_of(Offset)), "Whether cameras step back.  [default: plate]", "--offset"
        ),
        slabs=option(_CUTS, "Heights |z| of cuts, such as '15,40;20;none'.  [default: none]"),
        cull=option(one_of(Cull), "Faces left out.", default=Cull.NONE),
        causes=flag(
            "Charge wrong pixels to causes, and predict errors.",
            "--causes/--no-causes",
            default=True,
        ),
    )
    apertures = option(
        options.or_auto(INDICES),
        "Column,row of each, or auto.  [default: the middle; if recentered, also two corners]",
    )
    tracer = options.tracer_option
    decided_by = options.decided_by_option
    light = light_options(*ALL)
    device = options.device_option
    out = option(FOLDER, "Folder.  [default: report/NAME]")


@options.command("xfrustum report car --near 1,0.1,0.01 --depth d24,d32f:reversed --out report")
def report(asked: _Report) -> None:
    """Sweep near planes and depth formats; write index.html, inspect.html, report.json, measurements.parquet.

    Every combination of near, depth buffer, pivot, fit, offset and cuts is measured. A recentered
    frustum is measured at two corners of the plate too. With --apertures auto, a look through
    hundreds of apertures chooses the worst ones, and the page has a map of the plate. Without
    causes it takes a third of the time: wrong pixels are counted and shown, and not explained.
    """
    check_no_other_tracer(asked.tracer if options.is_given("tracer") else None, asked.decided_by)
    opened = asked.light.applied(options.open_scene(asked.scene))
    from xfrustum.reports.error_report.report import make_report
    from xfrustum.reports.error_report.request import ReportOptions

    chosen: AutoApertures | tuple[Aperture, ...]
    if isinstance(asked.apertures, str):
        chosen = options.auto_apertures(opened, progress=asked.progress)
    else:
        given = tuple(opened.plate.aperture(*index) for index in asked.apertures or ())
        chosen = given or opened.default_apertures()
        options.look_at(opened, chosen)
    options.warn_of_culling(opened, asked.sweep.get("cull"))
    how = ReportOptions(
        apertures=chosen,
        tracer=asked.tracer,
        effects=asked.light.effects,
        decided_by=asked.decided_by,
        progress=asked.progress,
        device=asked.device,
        **asked.sweep,
    )
    files = make_report(opened, asked.out, how)
    asked.tell(
        lambda: {"files": files.places, **files.content},
        lambda: "\n".join(
            (files.sentence, files.command, *files.notes, files.cost, str(files.html))
        ),
    )


class _Compare(options.Printed):
    truth: Path = options.argument(type=FOLDER)
    raster: Path = options.argument(type=FOLDER)
    out = option(FOLDER, "Folder for error pictures.")


@options.command("xfrustum compare truth.exr raster.exr --out compared")
def compare(asked: _Compare) -> None:
    """Compare a raster image with the truth, both EXR."""
    from xfrustum.scenes.disk.input_files import regular_size

    options.check_out(asked.out, ())
    for image in (asked.truth, asked.raster):
        regular_size(image, "image file")
    from xfrustum.reports import comparison
    from xfrustum.reports.text import comparison_table

    options.check_out(asked.out, comparison.FILES)
    compared = comparison.compare_files(asked.truth, asked.raster)
    for note in filter(None, (compared.note, compared.unexamined)):
        options.note(note)
    if asked.out is not None:
        comparison.write_comparison(compared, asked.out)
    asked.tell(compared.comparison.summary, lambda: comparison_table(compared.comparison))


class _Budget(options.OneOrAuto):
    settings = options.settings_options(required=True)
    light = light_options(*BUDGET)
    device = options.device_option
    out = option(FOLDER, "Folder for a page, and pictures of causes and links.")


@options.command("xfrustum budget car --near 0.1 --out budget")
def budget(asked: _Budget) -> None:
    """Charge every wrong pixel of one image to its cause, and take its radiance error apart.

    With --apertures auto, of one image for each of several apertures.
    """
    opened = asked.light.applied(options.open_scene(asked.scene))
    asked.settings.check_against(opened.frustum)
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.reports import budget as budgeting

    options.check_out(asked.out, () if asked.auto else budgeting.FILES)
    chosen = asked.chosen(opened)
    charge: Any = budgeting.budget
    if isinstance(chosen, AutoApertures):
        charge = budgeting.auto_budget
        for one in chosen.apertures:
            options.check_out(asked.out and asked.out / budgeting.folder_of(one), budgeting.FILES)
    charged = charge(opened, asked.settings, chosen, progress=asked.progress, device=asked.device)
    files = () if asked.out is None else budgeting.write_budget(charged, asked.out)
    pages = [str(file) for file in files if file.name == budgeting.PAGE]
    asked.tell(charged.summary, lambda: "\n".join((charged.table(), *pages)))
