"""`report`: near planes and depth buffers swept, as a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.commands.trace import check_no_other_tracer
from xfrustum.cli.light import ALL, light_options
from xfrustum.cli.options import option
from xfrustum.scenes.plate.double_frustum import Cull, Offset, Pivot

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.plate.plate import Aperture

_CUTS = options.Read(
    "Z,Z;none",
    lambda text: tuple(
        () if part.strip().lower() == "none" else options.NUMBERS.read(part) for part in text.split(";")
    ),
    "lists of heights such as '15,40;20;none'",
)


@options.command("xfrustum report car --near 1,0.1,0.01 --depth d24,d32f:reversed --out report")
@options.scene_argument
@option(
    "--near",
    "nears",
    options.NUMBERS,
    "Offsets in scene units.  [default: 25, from 1e-1 to 1e-8 of the reach]",
)
@option(
    "--apertures",
    options.or_auto(options.INDICES),
    "Column,row of each, or auto.  [default: the middle; if recentered, also two corners]",
)
@option("--depth", "depths", options.DEPTHS, "Depth buffers, such as d24,d32f:reversed.  [default: five]")
@option(
    "--pivot",
    "pivots",
    options.list_of(options.member(Pivot)),
    "Centers of the shear.  [default: as `raster`; if recentered, both]",
)
@option(
    "--fit",
    "fits",
    options.list_of(options.FIT),
    "Heights |z| drawn exactly.  [default: the first cut, or angle]",
)
@option(
    "--offset",
    "offsets",
    options.list_of(options.member(Offset)),
    "Whether cameras step back.  [default: plate]",
)
@option("--slabs", _CUTS, "Heights |z| of cuts, such as '15,40;20;none'.  [default: none]")
@option("--cull", options.member(Cull), "Faces left out.", default=Cull.NONE)
@options.tracer_option
@options.decided_by_option
@light_options(*ALL)
@click.option("--causes/--no-causes", default=True, help="Charge wrong pixels to causes, and predict errors.")
@options.out_option("Folder.  [default: report/NAME]")
@options.quiet_and_json
def report(
    *,
    scene: str,
    apertures: tuple[tuple[int, int], ...] | str | None,
    tracer: str,
    decided_by: str,
    light: Light,
    out: Path | None,
    quiet: bool,
    as_json: bool,
    **sweep: Any,
) -> None:
    """Sweep near planes and depth formats; write index.html, inspect.html, report.json, measurements.parquet.

    Every combination of near, depth buffer, pivot, fit, offset and cuts is measured. A recentered frustum is
    measured at two corners of the plate too. With --apertures auto, a look through hundreds of apertures
    chooses the worst ones, and the page has a map of the plate. Without causes it takes a third of the time:
    wrong pixels are counted and shown, and not explained.
    """
    check_no_other_tracer(tracer if options.is_given("tracer") else None, decided_by)
    opened = light.applied(options.open_scene(scene))
    from xfrustum.reports.error_report.report import make_report

    chosen: AutoApertures | tuple[Aperture, ...]
    if isinstance(apertures, str):
        chosen = options.auto_apertures(opened, quiet=quiet)
    else:
        given = None if apertures is None else tuple(opened.plate.aperture(*index) for index in apertures)
        chosen = given or opened.default_apertures()
        options.look_at(opened, chosen)
    files = make_report(
        opened,
        out,
        apertures=chosen,
        tracer=tracer,
        effects=light.effects,
        decided_by=decided_by,
        progress=not quiet,
        **sweep,
    )
    options.tell(
        as_json,
        lambda: {"files": files.places, **files.content},
        lambda: "\n".join((files.sentence, files.command, *files.notes, files.cost, str(files.html))),
    )
