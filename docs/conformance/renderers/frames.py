"""Frames that were recorded on a graphics card, judged by the suite's rule: python frames.py FRAMES.npz.

They were recorded before the suite, on films of 192 x 144 pixels that no case has. So this asks the
questions of L2 about them, each frame with its own near offset and depth buffer; and, of those
whose offset is that of the cameras which cases without a stated one hand out, the question of L1,
L3 and L5: the true frustum.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

from xfrustum.compare.device.recorded import read_frames
from xfrustum.compare.judging.conformance import Pixels, judged, trace
from xfrustum.reference import Reference
from xfrustum.reports.conformance.statement import counted_pixels
from xfrustum.scenes import DepthFormat, DepthMapping, HogelImage
from xfrustum.scenes.conformance_suite import CLOSE_NEAR, Case
from xfrustum.scenes.model.device_model import model_of


def main() -> None:
    """Judge all frames of a file; print those that fail, and how many pass."""
    device, frames = read_frames(Path(sys.argv[1]))
    passed, asked, total = Counter[str](), Counter[str](), Counter[str]()
    for frame in frames:
        name, part, depth, mapping, place = frame.name.split("|")
        height, width = frame.triangle.shape
        column, row = map(int, place.split(","))
        case = Case(
            name=frame.name, level="L2", scene=name, hogels=((column, row),), encoding="triangle-id", why="",
            resolution=(width, height), depth=DepthFormat(depth), mapping=DepthMapping(mapping),
        )  # fmt: skip
        scene = case.open()
        reference, aperture = Reference(scene), scene.plate.aperture(column, row)
        questions = {"offset cameras": float(part) * scene.frustum.longest_reach}
        if float(part) == CLOSE_NEAR and mapping == "reversed" and depth == "d32f":
            questions["true frustum"] = 0.0
        for question, near in questions.items():
            one = Case(**{**vars(case), "near": near or None})
            truth = trace(one, reference, aperture)
            image = HogelImage(
                camera=truth.camera,
                triangle=frame.triangle,
                object=np.append(scene.object_of_triangle, np.int32(-1))[frame.triangle],
                position=np.full((height, width, 3), np.nan),
            )
            pixels: Pixels = judged(one, scene, truth, image, model_of(device))
            asked[question] += 1
            passed[question] += pixels.within(one)
            total.update(vars(pixels))
            if not pixels.within(one):
                sys.stdout.write(f"{frame.name}, {question}: {counted_pixels(pixels)}\n")
    for question, count in asked.items():
        sys.stdout.write(
            f"{device['renderer']}, {question}: {passed[question]} of {count} frames pass\n"
        )
    sys.stdout.write(", ".join(f"{count:,} {name}" for name, count in total.items()) + "\n")


if __name__ == "__main__":
    main()
