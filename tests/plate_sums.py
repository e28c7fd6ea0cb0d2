"""Predicted and measured wrong surfaces of whole plates, summed by link.

`python -m tests.plate_sums [SCENE ...]` prints a table for the scenes, by default `MESHES`. Options
such as `--hogels 11x9 --pixels 160 --nears 1e-2,1e-3` select other plates.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace

from tests.support.link_sums import LinkSum, sums_by_link
from tests.support.views import SHARED, reversed_d32f, view
from xfrustum.compare.attribution.budget import Budget, make_budget
from xfrustum.compare.prediction.chain import make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Scene, open_scene

MESHES = ("car", "asymmetric", "beetle", "bunny-transfer", "teapot-recentered")
NUMERICS = SHARED / "data" / "inputs" / "numerics"

NEARS = (1e-2, 1e-3, 1e-4)  #: near offsets relative to the reach
MAX_RATIO = 1.5  #: largest ratio of sums without a reason


def plate(name: str, hogels: tuple[int, int], pixels: int) -> Scene:
    """Return a scene with a small plate and film."""
    path = NUMERICS / f"{name}.toml"
    scene = open_scene(str(path)) if path.exists() else view(name)
    return replace(
        scene,
        plate=replace(scene.plate, hogels=hogels),
        frustum=replace(scene.frustum, resolution=(pixels, pixels)),
    )


def plate_sums(scene: Scene, nears: Sequence[float] = NEARS) -> tuple[LinkSum, ...]:
    """Return the sums over a plate's hogels, with reversed float depth and several near offsets."""
    reference = Reference(scene)
    columns, rows = scene.plate.hogels

    def budgets(rasterizer: Rasterizer) -> Iterator[Budget]:
        for near in nears:
            settings = reversed_d32f(near * scene.frustum.longest_reach)
            for place in range(columns * rows):
                aperture = scene.plate.aperture(place % columns, place // columns)
                yield make_budget(reference, make_chain(reference, rasterizer, aperture, settings))

    with Rasterizer(scene) as rasterizer:
        return sums_by_link(budgets(rasterizer))


def main() -> None:
    """Print the sums of some plates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=MESHES)
    parser.add_argument("--hogels", default="9x7")
    parser.add_argument("--pixels", type=int, default=160)
    parser.add_argument("--nears", default=",".join(map(str, NEARS)))
    arguments = parser.parse_args()
    columns, rows = map(int, arguments.hogels.split("x"))
    nears = [float(near) for near in arguments.nears.split(",")]
    write_line(
        f"{'scene':<18} {'link':<14} {'measured':>9} {'predicted':>10} {'ratio':>6}  reasons"
    )
    for name in arguments.scenes:
        for link in plate_sums(plate(name, (columns, rows), arguments.pixels), nears):
            if link.surface or link.predicted:
                ratio = "-" if link.ratio is None else f"{link.ratio:.2f}"
                numbers = f"{link.surface:>9,} {link.predicted:>10,.1f} {ratio:>6}"
                write_line(
                    f"{name:<18} {link.name:<14} {numbers}  {', '.join(sorted(link.reasons))}"
                )


def write_line(line: str) -> None:
    sys.stdout.write(f"{line.rstrip()}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
