"""`budget`: every wrong pixel charged to its cause."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from xfrustum.cli import options
from xfrustum.cli.light import REFERENCE, light_options

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@options.command("xfrustum budget car --near 0.1 --out budget")
@options.scene_argument
@options.aperture_option
@options.auto_option
@options.double_frustum_options
@light_options(*REFERENCE[1:], "multisample")
@options.out_option("Folder for a page, and pictures of causes and links.")
@options.quiet_and_json
def budget(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    auto: str | None,
    settings: DoubleFrustum,
    light: Light,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Charge every wrong pixel of one image to its cause, and take its radiance error apart.

    With --apertures auto, of one image for each of several apertures.
    """
    opened = light.applied(options.open_scene(scene))
    settings.check_against(opened.frustum)
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.reports import budget as budgeting
    from xfrustum.reports.budget import FILES, folder_of, write_budget
    from xfrustum.reports.common.outputs import check_writable_folder

    if out is not None:
        check_writable_folder(out, () if auto else FILES)
    chosen = options.one_or_auto(opened, aperture, auto, quiet=quiet)
    charged: budgeting.BudgetReport | budgeting.AutoBudget
    if isinstance(chosen, AutoApertures):
        if out is not None:
            for one in chosen.apertures:
                check_writable_folder(out / folder_of(one), FILES)
        charged = budgeting.auto_budget(opened, settings, chosen, progress=not quiet)
    else:
        charged = budgeting.budget(opened, settings, chosen, progress=not quiet)
    if out is not None:
        write_budget(charged, out)
    options.tell(as_json, charged.summary, charged.table)
