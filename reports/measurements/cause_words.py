"""The causes of wrong surfaces as sentences call them, and the one that makes most of them."""

from __future__ import annotations

from collections.abc import Mapping

from xfrustum.compare.prediction.chain import CULLING, LINKS
from xfrustum.reports.measurements.measurement import Measurement
from xfrustum.scenes.plate.double_frustum import Offset

CAUSE_WORDS = {
    "near offset": "the near offset",
    "pivot": "the shear about the wrong point",
    "fit": "the fit",
    "slabs": "the cuts into slabs",
    CULLING: "culling",
    "rasterization": "rasterization",
    "depth": "the depth buffer",
}
"""What each cause is called in a sentence."""


def words_of(row: Measurement) -> Mapping[str, str]:
    """Return what the causes of a row are called; without an offset the first link is the gap."""
    if row.settings.offset is Offset.NONE:
        return {**CAUSE_WORDS, LINKS[0]: "the gap at the plate"}
    return CAUSE_WORDS


def main_cause(row: Measurement) -> str | None:
    """Return in words the cause of more than half of the wrong surfaces; None where none makes so many.

    It is None too where wrong surfaces were not charged to causes.
    """
    if not row.causes:
        return None
    most = max(row.causes, key=lambda cause: cause.surface)
    wrong = sum(cause.surface for cause in row.causes)
    return words_of(row)[most.name] if 2 * most.surface > wrong else None
