"""`report`: near planes and depth buffers swept, as a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from xfrustum.cli import options
from xfrustum.cli.commands.trace import check_no_other_tracer
from xfrustum.cli.light import ALL, light_options
from xfrustum.cli.options import DEPTHS, FIT, FOLDER, INDICES, NUMBERS, flag, list_of, member, option, several
from xfrustum.scenes.plate.double_frustum import Cull, Offset, Pivot

if TYPE_CHECKING:
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.plate.plate import Aperture

_CUTS = options.Read(
    "Z,Z;none",
    lambda text: tuple(
        () if part.strip().lower() == "none" else NUMBERS.read(part) for part in text.split(";")
    ),
    "lists of heights such as '15,40;20;none'",
)


class _Asked(options.Measured):
    scene = options.scene_argument
    sweep = several(
        nears=option(
            NUMBERS, "Offsets in scene units.  [default: 25, from 1e-1 to 1e-8 of the reach]", "--near"
        ),
        depths=option(DEPTHS, "Depth buffers, such as d24,d32f:reversed.  [default: five]", "--depth"),
        pivots=option(
            list_of(member(Pivot)),
            "Centers of the shear.  [default: as `raster`; if recentered, both]",
            "--pivot",
        ),
        fits=option(list_of(FIT), "Heights |z| drawn exactly.  [default: the first cut, or angle]", "--fit"),
        offsets=option(list_of(member(Offset)), "Whether cameras step back.  [default: plate]", "--offset"),
        slabs=option(_CUTS, "Heights |z| of cuts, such as '15,40;20;none'.  [default: none]"),
        cull=option(member(Cull), "Faces left out.", default=Cull.NONE),
        causes=flag(
            "Charge wrong pixels to causes, and predict errors.", "--causes/--no-causes", default=True
        ),
    )
    apertures = option(
        options.or_auto(INDICES),
        "Column,row of each, or auto.  [default: the middle; if recentered, also two corners]",
    )
    tracer = options.tracer_option
    decided_by = options.decided_by_option
    light = light_options(*ALL)
    out = option(FOLDER, "Folder.  [default: report/NAME]")


@options.command("xfrustum report car --near 1,0.1,0.01 --depth d24,d32f:reversed --out report")
def report(asked: _Asked) -> None:
    """Sweep near planes and depth formats; write index.html, inspect.html, report.json, measurements.parquet.

    Every combination of near, depth buffer, pivot, fit, offset and cuts is measured. A recentered frustum is
    measured at two corners of the plate too. With --apertures auto, a look through hundreds of apertures
    chooses the worst ones, and the page has a map of the plate. Without causes it takes a third of the time:
    wrong pixels are counted and shown, and not explained.
    """
    check_no_other_tracer(asked.tracer if options.is_given("tracer") else None, asked.decided_by)
    opened = asked.light.applied(options.open_scene(asked.scene))
    from xfrustum.reports.error_report.report import make_report
    from xfrustum.reports.error_report.settings import ReportOptions

    chosen: AutoApertures | tuple[Aperture, ...]
    if isinstance(asked.apertures, str):
        chosen = options.auto_apertures(opened, progress=asked.progress)
    else:
        given = tuple(opened.plate.aperture(*index) for index in asked.apertures or ())
        chosen = given or opened.default_apertures()
        options.look_at(opened, chosen)
    how = ReportOptions(
        apertures=chosen,
        tracer=asked.tracer,
        effects=asked.light.effects,
        decided_by=asked.decided_by,
        progress=asked.progress,
        **asked.sweep,
    )
    files = make_report(opened, asked.out, how)
    asked.tell(
        lambda: {"files": files.places, **files.content},
        lambda: "\n".join((files.sentence, files.command, *files.notes, files.cost, str(files.html))),
    )
