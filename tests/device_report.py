"""`make test-device`: checks that matter on a device that draws, as one page to send.

It uses no network, ends within eight minutes, and lists everything skipped, with the reason.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parents[1]
RECORDED = CHECKOUT.parent / "shared" / "data" / "devices"
REPORT = "build/device-report.md"
LIMIT_S = 470.0  #: total: later work is skipped, and running work is ended
FAILED = "  - failed: "  #: begins the line of a test that failed
MOST_LISTED = (
    30  #: of failures, or of tests skipped for their own reasons, in a group of tests: one page
)

TESTS = (
    (
        "devices, and what was drawn before",
        "tests/cli/test_device_command.py tests/raster/test_history.py",
    ),
    (
        "rounding and causes",
        "tests/compare/rounding tests/compare/device tests/compare/attribution",
    ),
    ("rasterizer and plate", "tests/raster --ignore tests/raster/test_history.py"),
    ("shares of wrong depth", "tests/compare/prediction/test_depth.py"),
)
CUDA_TESTS = ("the truth on CUDA", "tests/reference")
"""Groups of tests by their names, those that matter most first."""

TRUTH = """
import hashlib, json
from xfrustum import Reference, open_scene
image = Reference(scene := open_scene("car")).trace(scene.plate.middle)
names = "triangle object certainty position normal color".split()
digest = lambda array: hashlib.sha256(array.tobytes()).hexdigest()[:16]
print(json.dumps({name: digest(getattr(image, name)) for name in names}))
"""
"""Prints a digest of each channel of the car's truth, by the arrays of the environment."""


@dataclass
class Session:
    """The lines of the report so far, and what there is no time left for."""

    limit_s: float = LIMIT_S
    begun: float = field(default_factory=time.monotonic)
    lines: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    failed: bool = False  #: whether a test failed, or a pixel stayed unexplained

    @property
    def left_s(self) -> float:
        """Seconds until the limit."""
        return self.limit_s - (time.monotonic() - self.begun)

    def run(
        self, name: str, *words: str, **environment: str
    ) -> subprocess.CompletedProcess[str] | None:
        """Run this Python with some words; None, and a line of the page, if there is no time."""
        _say(f"{self.limit_s - self.left_s:5.0f} s  {name}")
        ended = "there was no time left"
        try:
            if self.left_s > 1:
                return subprocess.run(
                    [sys.executable, *words],
                    cwd=CHECKOUT,
                    env=os.environ | environment,
                    capture_output=True,
                    text=True,
                    timeout=self.left_s,
                    check=False,
                )
        except subprocess.TimeoutExpired:
            ended = "it was ended when the time was over"
        self.skip(name, ended)
        return None

    def run_json(self, name: str, *words: str, **environment: str) -> Any:
        """Return a program's JSON output; None, and a line with its last words, if it fails."""
        done = self.run(name, *words, **environment)
        if done is None:
            return None
        try:
            return json.loads(done.stdout)
        except json.JSONDecodeError:
            self.skip(
                name, (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            )
            return None

    def command(self, words: str) -> Any:
        """Return the JSON of a command of xfrustum."""
        return self.run_json(
            f"xfrustum {words}", "-m", "xfrustum", *words.split(), "--json", "--quiet"
        )

    def skip(self, name: str, why: str) -> None:
        """Report skipped work."""
        _say(f"         skipped: {name}: {why}")
        self.skipped.append(f"- {name}: {why}")

    def section(self, title: str, lines: Iterable[str]) -> None:
        """Add a part of the report."""
        self.lines += [f"\n## {title}\n", *lines]

    def text(self) -> str:
        """Return the whole report."""
        self.section("Not done", self.skipped or ["Nothing was skipped."])
        return "\n".join(
            [f"# Device report of xfrustum, {time.strftime('%Y-%m-%d')}", *self.lines, ""]
        )


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def device(session: Session, out: Path) -> bool:
    """Add how the device draws; return whether it is a card."""
    listed = session.command("device --list") or {"devices": [], "overlooked": None}
    rows = [
        f"- EGL {d['index']}: {d['renderer'] or 'none'}, {d['version']}" for d in listed["devices"]
    ]
    session.section("Devices", [*rows, *filter(None, [listed["overlooked"]])])
    # The table is what people read, device.json what programs do.
    table = session.run("xfrustum device", "-m", "xfrustum", "device", "--quiet", "--out", str(out))
    if table is None or table.returncode:
        session.skip("xfrustum device", table.stderr.strip() if table else "no time")
        return False
    session.section("How it rounds", ["```", table.stdout.strip(), "```"])
    return not json.loads((out / "device.json").read_text(encoding="utf-8"))["software"]


def pictures(session: Session) -> None:
    """Add how many pixels of recorded and of new frames stay unexplained."""
    lines, frames = [], RECORDED / "h100-frames.npz"
    if not frames.exists():
        session.skip(
            "replay of recorded frames", "../shared/data/devices is not beside the checkout"
        )
    elif answer := session.command(f"device --replay {os.path.relpath(frames, CHECKOUT)}"):
        session.failed |= answer["unexplained"] > 0
        lines.append(
            f"- {answer['frames']} frames recorded on {answer['device']}, by its model: "
            f"{answer['wrong']:,} "
            f"pixels differ from exact cameras, {answer['unexplained']:,} unexplained"
        )
    for scene in ("large-triangles", "car"):
        if answer := session.command(f"report {scene} --out build/device/{scene}"):
            wrong = sum(row["unexplained"] for row in answer["rows"])
            session.failed |= wrong > 0
            lines.append(
                f"- report {scene}: {wrong:,} unexplained pixels in {len(answer['rows'])} rows"
            )
    session.section("Pictures", lines or ["None."])


def tests(session: Session, *, card: bool) -> None:
    """Run the tests; add how many pass, and which fail or are skipped, and why."""
    if missing := [name for name in ("pytest", "hypothesis") if find_spec(name) is None]:
        return session.skip("all tests", f"{' and '.join(missing)} not installed here")
    groups: list[tuple[str, str, dict[str, str]]] = [(*group, {}) for group in TESTS]
    if card:
        groups.append((*CUDA_TESTS, {"XFRUSTUM_DEVICE": "cuda"}))
    else:
        session.skip(f"tests of {CUDA_TESTS[0]}", "the device that draws is no card")
    lines: list[str] = []
    for name, words, environment in groups:
        log = CHECKOUT / "build" / "device-tests.xml"
        log.unlink(missing_ok=True)
        session.run(
            f"pytest {words}",
            "-m",
            "pytest",
            "-q",
            *words.split(),
            f"--junitxml={log}",
            **environment,
        )
        if log.exists():
            lines += counted(name, log)
    session.failed |= any(line.startswith(FAILED) for line in lines)
    session.section("Tests", lines or ["None."])
    return None


def counted(name: str, log: Path) -> list[str]:
    """Return the lines of one group of tests."""
    cases = list(ET.parse(log).iter("testcase"))
    failed, reasons = [], Counter[str]()
    for case in cases:
        if (skipped := case.find("skipped")) is not None:
            reasons[skipped.get("message", "")] += 1
        for problem in (*case.findall("failure"), *case.findall("error")):
            message = problem.get("message", "").split("\n")[0][:160]
            failed.append(f"{FAILED}{case.get('classname')}::{case.get('name')}: {message}")
    passed = len(cases) - len(failed) - reasons.total()
    head = f"- {name}: {passed} passed, {len(failed)} failed, {reasons.total()} skipped"
    listed = [*failed, *(f"  - skipped {count}: {why}" for why, count in reasons.items())]
    return [head, *listed[:MOST_LISTED]]


def truth(session: Session, *, card: bool) -> None:
    """Add whether the truth has the same bits on the card and on the processors."""
    if not card:
        return session.skip(
            "bits of the truth on CUDA and LLVM", "the device that draws is no card"
        )
    digests = {
        d: session.run_json(f"truth on {d}", "-c", TRUTH, XFRUSTUM_DEVICE=d)
        for d in ("cuda", "llvm")
    }
    if all(digests.values()):
        differ = [
            name for name in digests["llvm"] if digests["llvm"][name] != digests["cuda"][name]
        ]
        verdict = (
            f"differs in {', '.join(differ)}" if differ else "has the same bits in all channels"
        )
        session.section("Truth", [f"The car's truth {verdict} on CUDA and on LLVM."])
    return None


def speeds(session: Session) -> None:
    """Add a few speeds."""
    lines = []
    if answer := session.command("bench plate car --resolution 256 --repeat 1"):
        lines.append(f"- hogels a second, car at 256 x 256: {medians(answer['hogels_per_second'])}")
    if answer := session.command("bench truth car --resolution 512 --repeat 3"):
        rates = medians(answer["races"][0]["mpixel_per_s"])
        lines.append(f"- million pixels a second, truth of the car at 512 x 512: {rates}")
    session.section("Speed", lines or ["None."])


def medians(rates: dict[str, dict[str, float]]) -> str:
    """Return the medians of the contestants of a race."""
    return ", ".join(f"{name} {rate['median']:.3g}" for name, rate in rates.items())


def main() -> int:
    """Write the report and print it; exit status 1 if a test failed or a pixel is unexplained."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=CHECKOUT / "build" / "device")
    parser.add_argument("--limit-s", type=float, default=LIMIT_S, help="seconds, for slow machines")
    run_json = parser.parse_args()
    out: Path = run_json.out
    out.mkdir(parents=True, exist_ok=True)
    session = Session(limit_s=run_json.limit_s)
    card = device(session, out)
    steps: tuple[Callable[[], None], ...] = (
        lambda: pictures(session),
        lambda: truth(session, card=card),
        lambda: tests(session, card=card),
        lambda: speeds(session),
    )
    for step in steps:
        step()
    (CHECKOUT / REPORT).write_text(text := session.text(), encoding="utf-8")
    _say(text)
    return int(session.failed)


if __name__ == "__main__":
    raise SystemExit(main())
