"""`budget`: every wrong pixel charged to its cause."""

from __future__ import annotations

from xfrustum.cli import options
from xfrustum.cli.light import BUDGET, light_options
from xfrustum.cli.options import FOLDER, option


class _Asked(options.OneOrAuto):
    settings = options.settings_options(required=True)
    light = light_options(*BUDGET)
    out = option(FOLDER, "Folder for a page, and pictures of causes and links.")


@options.command("xfrustum budget car --near 0.1 --out budget")
def budget(asked: _Asked) -> None:
    """Charge every wrong pixel of one image to its cause, and take its radiance error apart.

    With --apertures auto, of one image for each of several apertures.
    """
    opened = asked.light.applied(options.open_scene(asked.scene))
    asked.settings.check_against(opened.frustum)
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.reports import budget as budgeting

    options.check_out(asked.out, () if asked.auto else budgeting.FILES)
    chosen = asked.chosen(opened)
    charged: budgeting.BudgetReport | budgeting.AutoBudget
    if isinstance(chosen, AutoApertures):
        for one in chosen.apertures:
            options.check_out(asked.out and asked.out / budgeting.folder_of(one), budgeting.FILES)
        charged = budgeting.auto_budget(opened, asked.settings, chosen, progress=asked.progress)
    else:
        charged = budgeting.budget(opened, asked.settings, chosen, progress=asked.progress)
    files = () if asked.out is None else budgeting.write_budget(charged, asked.out)
    pages = [str(file) for file in files if file.name == budgeting.PAGE]
    asked.tell(charged.summary, lambda: "\n".join((charged.table(), *pages)))
