"""Sentences for the reasons for which predictions do not hold."""

from __future__ import annotations

from xfrustum.compare.prediction.reasons import MIN_PIXELS, Reason, Reasons

SENTENCES = {
    Reason.CROSSES: "not predicted: surfaces cross the plate",
    Reason.STARVED: "the depth buffer shows other surfaces than those that are displaced",
    Reason.ROUNDED: "smaller than the rounding of float32 positions",
    Reason.LARGE: (
        "triangles are far larger than the plate: float32 rounds their depth by more than is predicted"
    ),
    Reason.PARALLEL: (
        "surfaces are parallel to the plate: the depth of all their pixels is rounded alike"
    ),
    Reason.FEW: f"fewer than {MIN_PIXELS} pixels are predicted: chance decides",
    Reason.OUTSIDE: "points from outside the film are shown, which the truth does not have",
    Reason.STEPS: "all depths lie within two steps below one: float32 rounds many pixels alike",
    Reason.ALIGNED: "edges run along rows or columns: all pixels beside one become wrong together",
    Reason.THIN: "surfaces are thinner than a pixel: the truth shows a part of their contours",
}


def sentences(reasons: Reasons) -> Reasons:
    """Return reasons in words."""
    words = {name: reason and SENTENCES[Reason(reason)] for name, reason in vars(reasons).items()}
    return Reasons(**words)
