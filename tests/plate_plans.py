"""Plans of whole plates, each surveyed with its own settings and tolerance."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from scipy.stats import beta

from tests.support.scene_file import film, named, part
from tests.support.views import view
from xfrustum.compare.planning.plan import Plan
from xfrustum.compare.planning.requirement import Requirement
from xfrustum.compare.sampling import SampleRequest
from xfrustum.reports.blocks import Engine
from xfrustum.reports.planning import plan
from xfrustum.reports.survey import survey
from xfrustum.reports.survey_rows import SettingStats
from xfrustum.scenes import InputError, Scene, open_scene

SEED = 20261122
"""Seed of the surveyed hogels: none of a plan's own samples starts with it."""

CONFIDENCE = 0.95
"""Confidence from which on a claim about the share of hogels is refuted."""

FILM = film(
    (60.0, 60.0), hogels=(31, 31), resolution=(96, 96), fov_deg=(60.0, 60.0), reach=(60.0, 60.0)
)

SHAPES = {
    "flat square in the plate": part("square", 40.0, (0.0, 0.0, 0.0)),
    "tilted square through the plate": part(
        "square", 40.0, (0.0, 0.0, 0.0), rotate_deg=[30.0, 0.0, 0.0]
    ),
    "sphere across the plate": part("sphere", 30.0, (0.0, 0.0, 0.0)),
    "box standing on the plate": part("box", 20.0, (0.0, 0.0, 10.0)),
    "two sheets near the plate": part("square", 50.0, (0.0, 0.0, -0.02))
    + part("square", 50.0, (0.0, 0.0, -0.05)),
}
"""Objects in, across or near the plate of `FILM`: apertures are 1.94 mm apart, reach is 60 mm."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Plan of a whole plate, and the survey with its settings; None without a plan."""

    plan: Plan | None
    survey: SettingStats | None
    reason: str

    @property
    def kept(self) -> bool:
        """Return whether the survey permits the planned share of hogels beyond the tolerance.

        It does if the lower bound of the share, by Clopper and Pearson (1934), at `CONFIDENCE`, is
        no larger.
        """
        assert self.plan is not None and self.plan.plate is not None and self.survey is not None
        beyond, judged = self.survey.beyond, self.survey.judged
        at_least = float(beta.ppf(1 - CONFIDENCE, beyond, judged - beyond + 1)) if beyond else 0.0
        return at_least <= self.plan.plate.share_beyond_at_most


def try_plan(scene: Scene, hogels: int, requirement: Requirement) -> Trial:
    """Plan a scene's plate, then survey some of its hogels with the planned settings."""
    made, surveyed = None, None
    try:
        report = plan(scene, None, requirement)
        made = report.plan
        reason = report.reason
    except InputError as error:
        reason = str(error)
    if made is not None and made.settings is not None:
        chosen, engine = SampleRequest(sample=hogels, seed=SEED), Engine(workers=1)
        with tempfile.TemporaryDirectory() as folder:
            done = survey(
                scene,
                made.settings,
                Path(folder),
                chosen,
                tolerance_px=requirement.tolerance_px,
                engine=engine,
            )
            surveyed = done.stats[0]
    return Trial(plan=made, survey=surveyed, reason=reason)


def opened(name: str, resolution: int) -> Scene:
    """Return a built-in scene, a scene of `SHAPES`, or a shared scene, with a square film."""
    if name in SHAPES:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.toml"
            path.write_text(named(name, "mm") + FILM + SHAPES[name])
            scene = open_scene(str(path))
        return replace(scene, frustum=replace(scene.frustum, resolution=(resolution, resolution)))
    return view(name, (resolution, resolution))
