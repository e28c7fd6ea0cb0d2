"""Everything that a renderer may do otherwise as a whole, with no number in it: one entry for each mistake.

A hypothesis says which fields of `DrawnModel` differ, and the fault in words. Every one is tried on the
images by themselves (`xfrustum.compare.diagnosis.composition`) and found again in a guess (`found_in`).
Faults with numbers are the groups of `xfrustum.compare.renderer_model.parameters`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from xfrustum.compare.renderer_model.drawn_model import FLIPPED, Culled, DrawnModel, Front, OneCamera


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """One mistake: the fault's name, value and words, and the fields of `DrawnModel` by which it draws."""

    fault: str
    value: str
    words: str
    fields: Mapping[str, Any] = field(hash=False)

    def of(self, model: DrawnModel) -> DrawnModel:
        """Return a guess with this mistake."""
        fields = dict(self.fields)
        if "one_camera" in fields:
            fields["one_camera"] = replace(fields["one_camera"], other_near=model.near)
        return replace(model, **fields)

    def in_model(self, model: DrawnModel) -> bool:
        """Return whether a guess has this mistake."""
        return all(_plain(getattr(model, name)) == _plain(value) for name, value in self.fields.items())

    def fits(self, model: DrawnModel) -> bool:
        """Return whether it can be tried on a guess: a camera that is off by itself is not mirrored too."""
        return "one_camera" not in self.fields or model.one_camera is None


def _plain(value: Any) -> Any:
    """Return a value without the near offset of the camera that is right."""
    return replace(value, other_near=0.0) if isinstance(value, OneCamera) else value


def _flipped(one: OneCamera) -> Hypothesis:
    half, where = ("back", "behind") if one.side > 0 else ("front", "before")
    if one.flip_x and one.flip_y:
        fault, value = f"{half}-unturned", "turned by 180 degrees"
    else:
        fault, value = f"{half}-mirrored", f"mirrored {'left to right' if one.flip_x else 'upside down'}"
    words = f"the half {where} the plate is {value}"
    if fault == "front-unturned":
        words += ": C* looks back, so that its picture is to be turned by 180 degrees, and is not"
    return Hypothesis(fault=fault, value=value, words=words, fields={"one_camera": one})


NEAREST = Hypothesis(
    fault="front-nearest",
    value="nearest wins",
    words="on the viewer's side the surface nearest to the plate wins; C* must keep the farthest",
    fields={"front": Front.NEAREST},
)
NOT_OVERLAID = Hypothesis(
    fault="not-overlaid",
    value="back over front",
    words="C is drawn over C*; the viewer's half must cover the other",
    fields={"overlaid": False},
)

HYPOTHESES = (
    Hypothesis(
        fault="front-missing",
        value="missing",
        words="the half on the viewer's side is missing: only C is drawn",
        fields={"front": Front.MISSING},
    ),
    Hypothesis(
        fault="back-missing",
        value="missing",
        words="the half behind the plate is missing: only C* is drawn",
        fields={"back_missing": True},
    ),
    NEAREST,
    NOT_OVERLAID,
    *(
        Hypothesis(
            fault="culling",
            value=str(culled),
            words=f"faces whose corners run {culled} as the viewer sees them are left out",
            fields={"culled": culled},
        )
        for culled in (Culled.COUNTERCLOCKWISE, Culled.CLOCKWISE)
    ),
    *map(_flipped, FLIPPED),
)
"""All of them; of those that images cannot tell apart, the one that comes first here is named first."""

TOGETHER = ((NEAREST, NOT_OVERLAID),)
"""Those that are tried together too: one test of the depth, taken for the other, makes both."""

FIELDS = tuple(dict.fromkeys(name for one in HYPOTHESES for name in one.fields if name != "one_camera"))
"""Fields of `DrawnModel` that say how the halves are put together."""


def found_in(model: DrawnModel) -> Iterator[Hypothesis]:
    """Yield the mistakes that a guess has."""
    return (one for one in HYPOTHESES if one.in_model(model))
