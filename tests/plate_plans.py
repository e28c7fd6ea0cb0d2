"""Plans of whole plates, each surveyed with its own settings and tolerance; a row of a table for each.

Run as `python -m tests.plate_plans [SCENE..] [--hogels 40] [--tolerance-px T]`: without names, all built-in
scenes and `SHAPES` in or across the plate. It takes minutes for each scene.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from scipy.stats import beta

from tests.support.scene_file import film, named, part
from tests.support.views import SHARED
from xfrustum.compare.planning.plan import Plan, depth_buffers
from xfrustum.compare.planning.views import Requirement
from xfrustum.reports.blocks import Engine
from xfrustum.reports.planning import make_plan
from xfrustum.reports.scene_check.new_scene import new_scene
from xfrustum.reports.survey.survey import Chosen, survey
from xfrustum.scenes import DepthFormat, DepthMapping, InputError, Scene, open_scene
from xfrustum.scenes.library import builtin

SEED = 20261122
"""Seed of the surveyed hogels, by default: none of a plan's own samples starts with it."""

CONFIDENCE = 0.95
"""Confidence from which on a claim about the share of hogels is refuted."""

FILM = film((60.0, 60.0), hogels=(31, 31), resolution=(96, 96), fov_deg=(60.0, 60.0), reach=(60.0, 60.0))

SHAPES = {
    "flat square in the plate": part("square", 40.0, (0.0, 0.0, 0.0)),
    "tilted square through the plate": part("square", 40.0, (0.0, 0.0, 0.0), rotate_deg=[30.0, 0.0, 0.0]),
    "sphere across the plate": part("sphere", 30.0, (0.0, 0.0, 0.0)),
    "box standing on the plate": part("box", 20.0, (0.0, 0.0, 10.0)),
    "two sheets near the plate": part("square", 50.0, (0.0, 0.0, -0.02))
    + part("square", 50.0, (0.0, 0.0, -0.05)),
}
"""Objects in, across or near the plate of `FILM`: its apertures are 1.94 mm apart, and it reaches 60 mm."""

HEADER = "scene | px | plan | holds | no near | beyond, promised | beyond, surveyed | worst"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A plan of a whole plate, and the survey with its settings; None where there is no plan."""

    scene: Scene
    requirement: Requirement
    plan: Plan | None
    survey: Any
    reason: str

    @property
    def kept(self) -> bool:
        """Whether the survey does not refute what the plan promises of the share of hogels beyond.

        The lower bound of that share, with `CONFIDENCE`, is that of Clopper and Pearson (1934).
        """
        assert self.plan is not None and self.plan.plate is not None
        beyond, judged = self.survey.beyond, self.survey.judged
        at_least = float(beta.ppf(1 - CONFIDENCE, beyond, judged - beyond + 1)) if beyond else 0.0
        return at_least <= self.plan.plate.share_beyond_at_most

    def row(self) -> str:
        """Return the row of a table; see `HEADER`."""
        made, tolerance = self.plan, f"{self.requirement.tolerance_px:g}"
        if made is None or made.plate is None or made.settings is None:
            return " | ".join([self.scene.name, tolerance, f"none: {self.reason}"])
        plate, worst = made.plate, self.survey.worst
        cuts = ", ".join(f"{cut:g}" for cut in made.slabs)
        moved = "none" if worst.displacement_p99_px is None else f"{worst.displacement_p99_px:.3g} px"
        cells = [
            self.scene.name,
            tolerance,
            f"near {made.near:g}{', cuts ' + cuts if cuts else ''}, {made.settings.depth_label}",
            "yes" if made.within else "no",
            f"{plate.hopeless} of {plate.scouted}",
            f"at most {plate.share_beyond_at_most:.2%}",
            f"{self.survey.beyond} of {self.survey.judged}{'' if self.kept else ' REFUTED'}",
            f"{worst.aperture[0]},{worst.aperture[1]}: {moved}, {worst.surface_fraction:.2%} wrong",
        ]
        return " | ".join(cells)


def try_plan(
    scene: Scene,
    hogels: int,
    requirement: Requirement,
    buffer: tuple[DepthFormat | None, DepthMapping | None] = (None, None),
    seed: int = SEED,
) -> Trial:
    """Plan for the plate of a scene, and survey hogels of it with what was planned."""
    made, found = None, None
    try:
        made = make_plan(scene, None, requirement, depth_buffers(*buffer))
        reason = made.reason
    except InputError as error:
        reason = str(error)
    if made is not None and made.settings is not None:
        chosen, engine = Chosen(sample=hogels, seed=seed), Engine(workers=1)
        with tempfile.TemporaryDirectory() as folder:
            done = survey(
                scene,
                made.settings,
                Path(folder),
                chosen,
                tolerance_px=requirement.tolerance_px,
                engine=engine,
            )
            found = done.shares[0][1]
    return Trial(scene=scene, requirement=requirement, plan=made, survey=found, reason=reason)


def opened(name: str, resolution: int) -> Scene:
    """Return a scene by name or path, one of `SHAPES`, or a mesh beside the checkout, with a square film.

    A mesh is scaled to 60 mm, and gets the scene that `xfrustum new` fits to it.
    """
    mesh, file = SHARED / "data" / name, SHARED / "scenes" / f"{name}.toml"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        if name in SHAPES:
            path.write_text(named(name, "mm") + FILM + SHAPES[name])
        elif mesh.is_file():
            new_scene(mesh.resolve(), path, units="mm", size=60.0)
        known = str(path) if path.is_file() else str(file) if file.is_file() else name
        scene = open_scene(known)
    return replace(scene, frustum=replace(scene.frustum, resolution=(resolution, resolution)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(prog="python -m tests.plate_plans", description=__doc__)
    parser.add_argument("scene", nargs="*")
    parser.add_argument("--depth", type=DepthFormat)
    parser.add_argument("--mapping", type=DepthMapping)
    parser.add_argument("--hogels", type=int, default=40)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--resolution", type=int, default=96)
    parser.add_argument("--tolerance-px", type=float, default=Requirement().tolerance_px)
    options = parser.parse_args(arguments)
    sys.stdout.write(HEADER + "\n")
    for name in options.scene or (*builtin.names(), *SHAPES):
        scene, asked = opened(name, options.resolution), Requirement(tolerance_px=options.tolerance_px)
        trial = try_plan(scene, options.hogels, asked, (options.depth, options.mapping), options.seed)
        sys.stdout.write(trial.row() + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
