"""Predicted and measured wrong surfaces of whole plates, summed by link.

`python -m tests.plate_sums [SCENE ...]` prints a table for the scenes, by default `MESHES`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace

from tests.support.link_sums import LinkSum, sums_by_link
from tests.support.views import SHARED, reversed_d32f, view
from xfrustum.compare.attribution import Budget, make_budget
from xfrustum.compare.prediction.predict import make_chain
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


def main(names: Sequence[str]) -> None:
    """Print the sums of some scenes."""
    sys.stdout.write("scene, link: measured and predicted wrong surfaces, their ratio, reasons\n")
    for name in names or MESHES:
        for link in plate_sums(plate(name, (9, 7), 160)):
            if link.surface or link.predicted:
                ratio = "-" if link.ratio is None else f"{link.ratio:.2f}"
                reasons = " ".join(sorted(link.reasons))
                numbers = f"{link.surface:>9,} {link.predicted:>10,.1f} {ratio:>6}"
                sys.stdout.write(f"{name:<18} {link.name:<14} {numbers}  {reasons}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
