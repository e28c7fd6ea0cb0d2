"""`report`, `compare`, `budget`: a sweep of settings, errors of one image, errors by cause."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from xfrustum.cli import options
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
from xfrustum.cli.pictures import check_no_other_tracer
from xfrustum.scenes.plate import Cull, Offset, Pivot

if TYPE_CHECKING:
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.plate import Aperture

# In a sweep, the word none selects frusta without cuts, in addition to frusta with cuts.
_CUT = options.Read("Z,Z", lambda text: () if text.lower() == "none" else NUMBERS.read(text), "")
_CUTS = list_of(_CUT, ";", "Z,Z;none", "lists of heights such as '15,40;20;none'")


class _Report(options.Measured):
    scene = options.scene_argument
    sweep = several(
        nears=option(
            NUMBERS,
            "Near offsets, scene units.  [default: 25, from 1e-1 to 1e-8 of the reach]",
            "--near",
        ),
        depths=option(
            DEPTHS, "Depth buffers, such as d24,d32f:reversed.  [default: five of them]", "--depth"
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
            list_of(one_of(Offset)),
            "Move cameras off the plate (plate) or not (none).  [default: plate]",
            "--offset",
        ),
        slabs=option(
            _CUTS, "Heights |z| of cuts: sets to sweep, such as '15,40;20;none'.  [default: none]"
        ),
        # Click would print the member's name instead of its value.
        cull=option(
            one_of(Cull),
            "Faces to leave out, by winding.  [default: none]",
            default=Cull.NONE,
            show_default=False,
        ),
        causes=flag(
            "Charge wrong pixels to causes, and predict errors.",
            "--causes/--no-causes",
            default=True,
        ),
    )
    apertures = option(
        options.or_auto(INDICES),
        "Columns,rows, or auto.  [default: the middle; if recentered, also two corners]",
    )
    tracer = options.tracer_option
    decided_by = options.decided_by_option
    light = light_options(*ALL)
    device = options.device_option
    out = option(FOLDER, "Folder for the report.  [default: report/NAME]")


@options.command("xfrustum report car --near 1,0.1,0.01 --depth d24,d32f:reversed --out report")
def report(request: _Report) -> None:
    """Sweep near planes and depth formats; write pages, report.json and measurements.parquet.

    Every combination of near, depth buffer, pivot, fit, offset and cuts is measured. A recentered
    frustum is measured at two corners of the plate too. With --apertures auto, a scan of hundreds
    of apertures chooses the worst, and the page has a map of the plate. --no-causes takes a third
    of the time: wrong pixels are counted and shown, but not explained.
    """
    check_no_other_tracer(
        # Only a tracer that the user names may conflict with other options.
        request.tracer if options.is_given("tracer") else None,
        request.decided_by,
    )
    opened = request.light.applied(options.open_scene(request.scene))
    from xfrustum.reports.error_report.report import make_report
    from xfrustum.reports.error_report.sweep import ReportOptions

    chosen: AutoApertures | tuple[Aperture, ...]
    if isinstance(request.apertures, str):
        chosen = options.auto_apertures(opened, progress=request.progress)
    else:
        apertures = tuple(opened.plate.aperture(*index) for index in request.apertures or ())
        chosen = apertures or opened.default_apertures()
        options.look_at(opened, chosen)
    options.warn_of_culling(opened, request.sweep["cull"])
    how = ReportOptions(
        apertures=chosen,
        tracer=request.tracer,
        effects=request.light.effects,
        decided_by=request.decided_by,
        progress=request.progress,
        device=request.device,
        **request.sweep,
    )
    files = make_report(opened, request.out, how)
    request.tell(
        lambda: {"files": files.places, **files.content},
        lambda: "\n".join(
            (files.sentence, files.command, *files.notes, files.cost, str(files.html))
        ),
    )


class _Compare(options.Printed):
    truth: Path = options.argument(type=FOLDER)
    raster: Path = options.argument(type=FOLDER)
    out = option(FOLDER, "Folder for pictures of the errors.")


@options.command("xfrustum compare truth.exr raster.exr --out compared")
def compare(request: _Compare) -> None:
    """Compare a raster image with the truth; both are EXR files."""
    from xfrustum.scenes.disk import regular_size

    options.check_out(request.out, ())
    for image in (request.truth, request.raster):
        # Refuse pipes and devices before they block, and before imports that take seconds.
        regular_size(image, "image file")
    from xfrustum.reports import image_files
    from xfrustum.reports.text import comparison_table

    options.check_out(request.out, image_files.FILES)
    compared = image_files.compare_files(request.truth, request.raster)
    for line in filter(None, (compared.note, compared.unexamined)):
        options.note(line)
    if request.out is not None:
        image_files.write_comparison(compared, request.out)
    request.tell(compared.comparison.summary, lambda: comparison_table(compared.comparison))


class _Budget(options.OneOrAuto):
    settings = options.settings_options(required=True)
    light = light_options(*BUDGET)
    device = options.device_option
    out = option(FOLDER, "Folder for a page and pictures of causes and links.")


@options.command("xfrustum budget car --near 0.1 --out budget")
def budget(request: _Budget) -> None:
    """Charge every wrong pixel of an image to its cause, and split the radiance error by cause.

    --apertures auto does so at the middle aperture and the worst apertures.
    """
    opened = request.light.applied(options.open_scene(request.scene))
    # Test the settings first: the scan of a plate takes longer.
    request.settings.check_against(opened.frustum)
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.reports import budget as budgeting

    # With several apertures, each aperture has its own folder: test it after the choice.
    options.check_out(request.out, () if request.auto else budgeting.FILES)
    chosen = request.chosen(opened)
    charge: Any = budgeting.budget
    if isinstance(chosen, AutoApertures):
        charge = budgeting.auto_budget
        for aperture in chosen.apertures:
            options.check_out(
                request.out and request.out / budgeting.folder_of(aperture), budgeting.FILES
            )
    charged = charge(
        opened, request.settings, chosen, progress=request.progress, device=request.device
    )
    files = () if request.out is None else budgeting.write_budget(charged, request.out)
    pages = [str(file) for file in files if file.name == budgeting.PAGE]
    request.tell(charged.summary, lambda: "\n".join((charged.table(), *pages)))
