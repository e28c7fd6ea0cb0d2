"""Plans of whole plates, tried at random hogels that took no part in making them; a row for each.

Run as `python -m tests.plate_plans SCENE.. [--depth d16 --mapping standard] [--hogels 200] [--seed S]`.
It takes minutes for each scene: `plan` at the resolution of the film, then hogels that are traced and drawn.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import beta

from xfrustum.compare.planning.hogels import HogelResult, hogel_results
from xfrustum.compare.planning.plan import Plan, depth_buffers
from xfrustum.compare.planning.views import Requirement
from xfrustum.compare.run import Judge
from xfrustum.reports.commands.planning import make_plan
from xfrustum.scenes import DepthFormat, DepthMapping, Scene, open_scene
from xfrustum.scenes.plate.plate import Aperture

SEED = 20261122
"""Seed of the tried hogels, by default: none of the plan's own samples starts with it."""

CONFIDENCE = 0.95
"""Confidence from which on a claim about the share of hogels is refuted."""

HEADER = "scene | depth | near | cuts | hogels without a near | beyond, claimed | beyond, measured | worst"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A plan of a whole plate, and how it does at hogels that took no part in it."""

    scene: Scene
    plan: Plan
    tried: tuple[HogelResult, ...]
    requirement: Requirement

    @property
    def beyond(self) -> list[HogelResult]:
        """The tried hogels that are beyond what is required."""
        return [one for one in self.tried if one.excess(self.requirement) > 1]

    @property
    def worst(self) -> HogelResult | None:
        """The tried hogel with the largest excess; None where there is no plan to try."""
        return max(self.tried, key=lambda one: one.excess(self.requirement), default=None)

    @property
    def share_at_least(self) -> float:
        """Lower bound of the share of hogels beyond what is required (Clopper and Pearson 1934)."""
        beyond, tried = len(self.beyond), len(self.tried)
        return float(beta.ppf(1 - CONFIDENCE, beyond, tried - beyond + 1)) if beyond else 0.0

    def row(self) -> str:
        """Return the row of a table; see `HEADER`."""
        made, plate, worst = self.plan, self.plan.plate, self.worst
        near = "none" if made.near is None else f"{made.near:g}"
        buffer = "any" if made.depth is None or made.mapping is None else f"{made.depth} {made.mapping}"
        cells = [self.scene.name, buffer, near, ", ".join(f"{cut:g}" for cut in made.slabs) or "none"]
        if plate is None or worst is None:
            return " | ".join([*cells, made.reason])
        lower = f"{self.share_at_least:.1%}"
        cells += [
            f"{plate.hopeless} of {plate.scouted}",
            f"at most {plate.share_beyond_at_most:.2%} ({plate.beyond} of {plate.sampled})",
            f"{len(self.beyond)} of {len(self.tried)} (at least {lower})",
            f"{worst.aperture.column},{worst.aperture.row}: {worst.displacement_p99_px:.3g} px, "
            f"by depth {worst.depth_wrong:.2%}, surface {worst.surface_fraction:.2%}",
        ]
        return " | ".join(cells)


def try_plan(
    scene: Scene,
    hogels: int,
    seed: int = SEED,
    depth: DepthFormat | None = None,
    mapping: DepthMapping | None = None,
) -> Trial:
    """Plan for the plate of a scene, and measure the plan at random hogels."""
    requirement = Requirement()
    made = make_plan(scene, None, requirement, depth_buffers(depth, mapping))
    tried = tuple(measured(scene, made, random_hogels(scene, hogels, seed)))
    return Trial(scene=scene, plan=made, tried=tried, requirement=requirement)


def random_hogels(scene: Scene, count: int, seed: int) -> list[Aperture]:
    """Return hogels of a plate, each as likely as any other, none twice."""
    columns, rows = scene.plate.hogels
    numbers = np.random.default_rng(seed).choice(columns * rows, min(count, columns * rows), replace=False)
    return [scene.plate.aperture(int(number) % columns, int(number) // columns) for number in numbers]


def measured(scene: Scene, made: Plan, apertures: list[Aperture]) -> list[HogelResult]:
    """Return how a plan does at some hogels; nothing where there is no plan."""
    if made.settings is None:
        return []
    with Judge(scene) as judge:
        return list(hogel_results(judge, apertures, made.settings))


def main() -> None:
    """Print a row for each scene, and the hogels beyond what is required."""
    parser = argparse.ArgumentParser(prog="python -m tests.plate_plans", description=__doc__)
    parser.add_argument("scene", nargs="+")
    parser.add_argument("--depth", type=DepthFormat)
    parser.add_argument("--mapping", type=DepthMapping)
    parser.add_argument("--hogels", type=int, default=200)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--resolution", type=int, default=192)
    options = parser.parse_args()
    sys.stdout.write(HEADER + "\n")
    for name in options.scene:
        opened = open_scene(name)
        film = (options.resolution, options.resolution)
        scene = replace(opened, frustum=replace(opened.frustum, resolution=film))
        trial = try_plan(scene, options.hogels, options.seed, options.depth, options.mapping)
        sys.stdout.write(trial.row() + "\n")
        for one in trial.beyond:
            sys.stdout.write(
                f"  {one.aperture.column},{one.aperture.row}: {one.displacement_p99_px:.3g} px, "
                f"by depth {one.depth_wrong:.2%}\n"
            )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
