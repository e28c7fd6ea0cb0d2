"""`make test-device`: device-dependent checks, with a one-page report that users can send.

It uses no network, ends within eight minutes, and lists all skipped work with reasons.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parents[1]
RECORDED = "../shared/data/devices/h100-frames.npz"
REPORT = "build/device-report.md"
LIMIT_S = 470.0  #: total time: at the limit, running work ends and later work is skipped
MOST_LISTED = 30  #: largest number of listed failed and skipped tests in a group

TESTS = {
    "devices and history": "tests/cli/test_device_command.py tests/raster/test_history.py",
    "rounding and causes": "tests/compare/rounding tests/compare/device tests/compare/attribution",
    "rasterizer and plate": "tests/raster --ignore tests/raster/test_history.py",
    "shares of wrong depth": "tests/compare/prediction/test_depth.py",
}
CUDA_TESTS = {"truth on CUDA": "tests/reference"}
"""Groups of tests by name, most important first."""

TRUTH = """
import hashlib, json
from xfrustum import Reference, open_scene
image = Reference(scene := open_scene("car")).trace(scene.plate.middle)
names = "triangle object certainty position normal color".split()
digest = lambda array: hashlib.sha256(array.tobytes()).hexdigest()[:16]
print(json.dumps({name: digest(getattr(image, name)) for name in names}))
"""
"""Prints a digest of each channel of the car's truth; environment variables select the device."""


@dataclass
class Session:
    """Lines of the report so far, and skipped work."""

    limit_s: float
    begun: float = field(default_factory=time.monotonic)
    lines: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    failed: bool = False  #: whether a test failed or a pixel stayed unexplained

    def run(self, name: str, *words: str, **environment: str) -> tuple[int, str]:
        """Run Python; return exit status and output; if skipped, status -1 and a line about it."""
        left_s = self.limit_s - (time.monotonic() - self.begun)
        sys.stdout.write(f"{self.limit_s - left_s:5.0f} s  {name}\n")
        sys.stdout.flush()
        try:
            done = subprocess.run(
                [sys.executable, *words],
                cwd=CHECKOUT,
                env=os.environ | environment,
                capture_output=True,
                text=True,
                timeout=max(left_s, 1.0),
                check=False,
            )
        except subprocess.TimeoutExpired:
            self.skipped.append(f"- {name}: no time was left")
            return -1, ""
        if not done.stdout:
            last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            self.skipped.append(f"- {name}: {last}")
            return -1, ""
        return done.returncode, done.stdout

    def json(self, words: str) -> Any:
        """Return the JSON of a command of xfrustum; None if it prints none."""
        arguments = ("-m", "xfrustum", *words.split(), "--json", "--quiet")
        _, text = self.run(f"xfrustum {words}", *arguments)
        return json.loads(text) if text else None

    def section(self, title: str, lines: Iterable[str]) -> None:
        """Add a section to the report."""
        self.lines += [f"\n## {title}\n", *lines]


def device(session: Session, out: Path) -> bool:
    """Report how the device draws; return whether it is a card."""
    listed = session.json("device --list") or {"devices": [], "overlooked": None}
    rows = [
        f"- EGL {d['index']}: {d['renderer'] or 'none'}, {d['version']}" for d in listed["devices"]
    ]
    session.section("Devices", [*rows, *filter(None, [listed["overlooked"]])])
    arguments = ("-m", "xfrustum", "device", "--quiet", "--out", str(out))
    status, table = session.run("xfrustum device", *arguments)
    if status != 0:
        return False
    session.section("How it rounds", ["```", table.strip(), "```"])
    return not json.loads((out / "device.json").read_text(encoding="utf-8"))["software"]


def pictures(session: Session) -> None:
    """Report the number of unexplained pixels in recorded frames and in new frames."""
    counts = {}
    if (CHECKOUT / RECORDED).exists():
        if answer := session.json(f"device --replay {RECORDED}"):
            name = f"{answer['frames']} frames of {answer['device']}, {answer['wrong']:,} wrong"
            counts[name] = answer["unexplained"]
    else:
        session.skipped.append(f"- replay of recorded frames: no {RECORDED} beside the checkout")
    for scene in ("large-triangles", "car"):
        if answer := session.json(f"report {scene} --out build/device/{scene}"):
            counts[f"report {scene}"] = sum(row["unexplained"] for row in answer["rows"])
    session.failed |= any(counts.values())
    session.section("Unexplained pixels", [f"- {name}: {n:,}" for name, n in counts.items()])


def tests(session: Session, *, card: bool) -> None:
    """Report the number of tests that pass, and list failed and skipped tests with reasons."""
    lines = []
    for name, words in (TESTS | (CUDA_TESTS if card else {})).items():
        environment = {"XFRUSTUM_DEVICE": "cuda"} if name in CUDA_TESTS else {}
        status, text = session.run(
            f"pytest {words}", "-m", "pytest", "-q", "-rfEs", *words.split(), **environment
        )
        session.failed |= status > 0
        listed = re.findall(r"^(?:FAILED|ERROR|SKIPPED) .*", text, re.MULTILINE)
        lines += [f"- {name}: {text.strip().splitlines()[-1] if text else 'not run'}"]
        lines += [f"  - {line}" for line in listed[:MOST_LISTED]]
    session.section("Tests", lines)


def truth(session: Session) -> None:
    """Report whether the truth has the same bits on the card and on the CPU."""
    cuda, llvm = (
        session.run(f"truth on {arrays}", "-c", TRUTH, XFRUSTUM_DEVICE=arrays)[1]
        for arrays in ("cuda", "llvm")
    )
    if cuda and llvm:
        same = json.loads(cuda) == json.loads(llvm)
        session.failed |= not same
        verdict = "the same bits" if same else f"different bits: {cuda} {llvm}"
        session.section("Truth", [f"The car's truth on CUDA and on LLVM has {verdict}."])


def speeds(session: Session) -> None:
    """Report a few speeds."""
    lines = []
    if answer := session.json("bench plate car --resolution 256 --repeat 1"):
        lines.append(f"- hogels a second, car at 256 x 256: {medians(answer['hogels_per_second'])}")
    if answer := session.json("bench truth car --resolution 512 --repeat 3"):
        rates = medians(answer["races"][0]["mpixel_per_s"])
        lines.append(f"- million pixels a second, truth of the car at 512 x 512: {rates}")
    session.section("Speed", lines)


def medians(rates: dict[str, dict[str, float]]) -> str:
    """Return the median rate of each contestant."""
    return ", ".join(f"{name} {rate['median']:.3g}" for name, rate in rates.items())


def main() -> int:
    """Write and print the report; exit status 1 if a test failed or a pixel is unexplained."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=CHECKOUT / "build" / "device")
    parser.add_argument("--limit-s", type=float, default=LIMIT_S, help="seconds, for slow machines")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    session = Session(limit_s=options.limit_s)
    card = device(session, options.out)
    pictures(session)
    if card:
        truth(session)
    else:
        session.skipped.append("- bits of the truth on CUDA and LLVM: the device is no card")
    tests(session, card=card)
    speeds(session)
    session.section("Not done", session.skipped or ["Nothing was skipped."])
    head = f"# Device report of xfrustum, {time.strftime('%Y-%m-%d')}"
    text = "\n".join([head, *session.lines, ""])
    (CHECKOUT / REPORT).parent.mkdir(exist_ok=True)
    (CHECKOUT / REPORT).write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return int(session.failed)


if __name__ == "__main__":
    raise SystemExit(main())
