"""The museum of wrong hits: only the exact rays are right at every exhibit."""

import pytest

from xfrustum.research import rays
from xfrustum.research.rays import museum


def test_exact_rays_are_right_at_every_exhibit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rays, "RAYS", 40)
    verdicts = museum()
    assert len(verdicts) == 6
    assert all(verdict.wrong["ExactIntersector"] == 0 for verdict in verdicts)
    wrong = [verdict.wrong["Embree by trimesh"] for verdict in verdicts]
    assert wrong.count(0) >= 1 and max(wrong) == 40
