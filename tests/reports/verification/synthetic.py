"""Verifications with synthetic measures, made without tracing; small git repositories."""

import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from tests.support.views import view
from xfrustum import Aperture, Scene, Verification
from xfrustum.compare import Spread
from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.judging.judged import HogelNumbers, MeasuredBy, SurfaceFigures
from xfrustum.compare.judging.verdict import Check, Hogel, Limits
from xfrustum.compare.renderer_model.drawn_model import RendererModel

SHOWN = 1000
"""Number of pixels of a hogel that show a surface."""


@cache
def scene() -> Scene:
    return view("asymmetric", (32, 32))


def hogel_of(place: tuple[int, int], wrong: int | None, p99: float = 0.1) -> Hogel:
    """Return a hogel with `wrong` wrong surfaces, twice as many wrong triangles; None: missing."""
    aperture: Aperture = scene().plate.aperture(*place)
    if wrong is None:
        return Hogel(aperture=aperture, problem="no such file")
    numbers = HogelNumbers(
        shown=SHOWN,
        by="triangle",
        wrong=2 * wrong,
        fraction=2 * wrong / SHOWN,
        surface=SurfaceFigures(wrong=wrong, fraction=wrong / SHOWN, outside=0),
        invalid=0,
        displacement_px=Spread(rms=p99 / 4, p50=0.0, p95=p99 / 2, p99=p99, max=2 * p99),
        displacement_by=MeasuredBy.POINTS,
        radiance=None,
        causes={"edge": 2 * wrong, "order": 0, "lost": 0, "unexplained": 0},
    )
    share = Check(
        figure="wrong surfaces",
        value=wrong / SHOWN,
        limit=0.01,
        unit="share",
        held=wrong <= SHOWN / 100,
    )
    return Hogel(aperture=aperture, as_found=numbers, corrected=numbers, checks=(share,))


def verification(wrong: Mapping[tuple[int, int], int | None], p99: float = 0.1) -> Verification:
    """Return a verification of hogels, each with a number of wrong surfaces."""
    return Verification(
        scene=scene(),
        source="hogels/{i}x{j}.png",
        limits=Limits(),
        diagnosis=Diagnosis(model=RendererModel()),
        hogels=tuple(hogel_of(place, number, p99) for place, number in wrong.items()),
    )


def git(folder: Path, *arguments: str) -> str:
    """Run git in a repository, without settings of this machine."""
    who = ("-c", "user.name=Ada", "-c", "user.email=ada@example.org")
    return subprocess.check_output(["git", "-C", str(folder), *who, *arguments], text=True).strip()


def commit(folder: Path, subject: str) -> str:
    """Commit all files, if any; return the commit's hash. The first commit makes the repository."""
    if not (folder / ".git").exists():
        git(folder, "init", "--quiet", "--initial-branch=main")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--allow-empty", "--message", subject)
    return git(folder, "rev-parse", "HEAD")
