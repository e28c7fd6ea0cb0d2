"""Sums over whole plates: for each link, predicted and measured wrong surfaces agree."""

import pytest

from tests.plate_sums import MAX_RATIO, MESHES, NUMERICS, plate, plate_sums
from tests.support.link_sums import LinkSum
from xfrustum.compare.prediction.reasons import Reason


def assert_holds(links: tuple[LinkSum, ...]) -> None:
    for link in links:
        holds = link.predicted / MAX_RATIO <= link.surface <= link.predicted * MAX_RATIO
        assert holds or link.reasons, link


def by_name(links: tuple[LinkSum, ...]) -> dict[str, LinkSum]:
    return {link.name: link for link in links}


def test_the_sum_of_rasterization_holds_although_each_hogel_has_too_few_pixels() -> None:
    """Most wrong pixels of the bunny lie at creases, only one or two of them in a hogel."""
    sums = plate_sums(plate("bunny-transfer", (3, 3), 96), nears=(1e-3, 1e-4))
    assert_holds(sums)
    rasterization = by_name(sums)["rasterization"]
    assert rasterization.surface > 15 and not rasterization.reasons


@pytest.mark.slow
@pytest.mark.parametrize("name", MESHES)
def test_the_sums_of_five_meshes_hold(name: str) -> None:
    sums = plate_sums(plate(name, (9, 7), 160))
    assert_holds(sums)
    assert by_name(sums)["near offset"].reasons == set()


@pytest.mark.parametrize(("name", "reason"), [("needles", Reason.THIN), ("decals", Reason.ALIGNED)])
def test_sums_that_do_not_hold_have_their_reason(name: str, reason: Reason) -> None:
    if not (NUMERICS / f"{name}.toml").exists():
        pytest.skip(f"needs ../shared/data/inputs/numerics/{name}.toml")
    near_offset = by_name(plate_sums(plate(name, (3, 3), 128), nears=(1e-4,)))["near offset"]
    assert near_offset.surface > 3 * near_offset.predicted
    assert reason in near_offset.reasons


def test_traced_links_do_not_depend_on_how_large_triangles_are() -> None:
    sums = by_name(plate_sums(plate("large-triangles", (2, 2), 64), nears=(1e-2,)))
    assert Reason.LARGE in sums["rasterization"].reasons
    assert Reason.LARGE not in sums["near offset"].reasons and sums["near offset"].surface > 100
