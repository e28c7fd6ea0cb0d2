"""What made the color of an image: which effects, how many samples, which light transport."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.effects import Effect


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """What was simulated of an image, as it was asked for.

    Attributes
    ----------
    effects
        In the order of `Effect`, so that the same ones are written alike.
    sampling
        What each color is the mean of.
    transport
        What light paths simulated, and how many there were; None where none were traced.
    """

    effects: tuple[Effect, ...]
    sampling: Sampling
    transport: Transport | None = None

    @classmethod
    def of(
        cls, effects: Iterable[Effect], sampling: Sampling, transport: Transport | None = None
    ) -> Rendering:
        """Put the effects in order."""
        asked = frozenset(effects)
        return cls(
            effects=tuple(effect for effect in Effect if effect in asked),
            sampling=sampling,
            transport=transport,
        )
