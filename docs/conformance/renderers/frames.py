"""Judge frames recorded on a GPU by the suite's rule: python frames.py FRAMES.npz.

The frames are older than the suite, and no case has their films of 192 x 144 pixels. Each frame is
judged as in L2, with its own near offset and depth buffer. A case without a stated near provides
cameras with a default offset. Frames with this offset are also judged as in L1, L3 and L5, against
the true frustum.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

from xfrustum.compare.judging.conformance import Pixels, judged, trace
from xfrustum.compare.recorded import read_frames
from xfrustum.reference import Reference
from xfrustum.reports.conformance import counted_pixels
from xfrustum.scenes import DepthFormat, DepthMapping, HogelImage
from xfrustum.scenes.conformance_suite import CLOSE_NEAR, Case
from xfrustum.scenes.model.device_model import model_of


def main() -> None:
    """Judge all frames of a file; print the failed frames and the number of passed frames."""
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
