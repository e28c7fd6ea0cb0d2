"""What culling costs on open meshes: charged to a link of its own, predicted, and told."""

from __future__ import annotations

import json
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.support.views import reversed_d32f, soup, view
from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.prediction.chain import LINKS
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.budget import budget_of
from xfrustum.reports.comparison import table
from xfrustum.reports.error_report.report import make_report
from xfrustum.reports.error_report.settings import ReportOptions
from xfrustum.scenes import Cull, DepthFormat, DepthMapping, DoubleFrustum, Frustum, Scene

CULLED_LINKS = ["near offset", "pivot", "fit", "slabs", "culling", "rasterization", "depth"]
FILM = (96, 72)


def culled(scene: Scene, near_per_reach: float) -> DoubleFrustum:
    return replace(reversed_d32f(near_per_reach * scene.frustum.longest_reach), cull=Cull.BACK)


def charged(scene: Scene, settings: DoubleFrustum) -> Budget:
    return budget_of(scene, scene.plate.middle, settings)[0]


def test_backs_of_open_meshes_are_charged_to_culling() -> None:
    """Nothing else is wrong with so small an offset: culling loses precisely the pixels with a back."""
    scene = view("large-triangles", FILM)
    numbers = charged(scene, culled(scene, 1e-5)).numbers
    assert [link.name for link in numbers.links] == CULLED_LINKS
    counts = {link.name: link for link in numbers.links}
    assert counts["culling"].predicted_surface == pytest.approx(counts["culling"].surface, abs=2)
    assert counts["culling"].surface > 500
    assert counts["culling"].predicted_displacement_rms_px is None
    assert sum(link.triangle for link in numbers.links) == numbers.wrong
    assert numbers.unexplained == 0


@pytest.mark.parametrize("name", ["large-triangles", "crossing"])
def test_what_is_predicted_where_other_links_are_wrong_too(name: str) -> None:
    """Taken as independent of what was wrong before: within a factor of two."""
    scene = view(name, FILM)
    culling = charged(scene, culled(scene, 0.05)).numbers.links[4]
    assert culling.predicted_surface is not None
    assert culling.surface / 2 < culling.predicted_surface < 2 * culling.surface


@pytest.mark.parametrize(
    "buffer", [(DepthFormat.D16, DepthMapping.STANDARD), (DepthFormat.D24, DepthMapping.GL)]
)
def test_rounding_explains_all_that_culled_cameras_draw_otherwise(
    buffer: tuple[DepthFormat, DepthMapping],
) -> None:
    """Loose triangles turned every way, many of them nearly edge-on, on both sides and across the plate."""
    rng = np.random.default_rng(1997)
    places, sides = rng.uniform(-10, 10, (400, 1, 3)), rng.normal(0, 3.0, (400, 3, 3))
    frustum = Frustum(resolution=(64, 48), reach=(12.0, 12.0), fov=(radians(70), radians(60)))
    scene = soup(places + sides, frustum)
    depth, mapping = buffer
    for slabs in ((), (3.0,)):
        settings = DoubleFrustum(near=1e-2, depth=depth, mapping=mapping, slabs=slabs, cull=Cull.BACK)
        found = charged(scene, settings)
        assert found.explanation.unexplained.sum() == 0
        assert (found.charge == CULLED_LINKS.index("culling")).sum() > 100


def test_a_comparison_says_how_many_wrong_surfaces_were_culled() -> None:
    scene = view("large-triangles", FILM)
    reference, settings = Reference(scene), culled(scene, 1e-5)
    truth = reference.trace(scene.plate.middle)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(scene.plate.middle, settings)
        whole = rasterizer.render(scene.plate.middle, replace(settings, cull=Cull.NONE))
    found, without = (compare_images(truth, image, reference) for image in (drawn, whole))
    assert found.surface is not None and found.surface.culled is not None
    assert found.surface.wrong - 2 <= found.surface.culled <= found.surface.wrong
    told = next(line for line in table(found).splitlines() if "a face culled" in line)
    assert told.split()[-1] == f"{found.surface.culled:,}"
    assert without.surface is not None and without.surface.culled is None
    assert "culled" not in table(without)


def test_a_report_charges_culling_in_every_row(tmp_path: Path) -> None:
    scene = view("large-triangles", (48, 36))
    files = make_report(
        scene,
        str(tmp_path / "report"),
        ReportOptions(nears=[0.01], depths=[(DepthFormat.D24, DepthMapping.STANDARD)], cull=Cull.BACK),
    )
    (row,) = json.loads(files.json.read_text())["rows"]
    assert row["settings"]["cull"] == "back"
    assert [cause["name"] for cause in row["causes"]] == CULLED_LINKS
    assert sum(cause["surface"] for cause in row["causes"]) == row["comparison"]["surface"]["wrong"]
    assert row["causes"][4]["surface"] > 100
    assert row["unexplained"] == 0
    (flat,) = pq.read_table(files.parquet).to_pylist()
    assert flat["cause_culling_surface"] == row["causes"][4]["surface"]
    assert flat["surface_culled"] == row["comparison"]["surface"]["culled"]
    assert "faces turned away from the viewer culled" in files.html.read_text()
    assert "--cull back" in files.command


def test_without_culling_the_chain_is_as_it_was() -> None:
    scene = view("large-triangles", FILM)
    settings = replace(culled(scene, 1e-5), cull=Cull.NONE)
    assert [link.name for link in charged(scene, settings).numbers.links] == list(LINKS)
