"""The effects, samples and light transport that made the color of an image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.effects import Effect


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """The simulation that made the color of an image, as it was asked for.

    Attributes
    ----------
    effects
        Effects in the order of `Effect`, so that equal sets are written alike.
    sampling
        Points over which each color is averaged.
    transport
        Light transport that light paths simulated, and their number; None where none were traced.
    """

    effects: tuple[Effect, ...]
    sampling: Sampling
    transport: Transport | None = None

    @classmethod
    def of(
        cls, effects: Iterable[Effect], sampling: Sampling, transport: Transport | None = None
    ) -> Rendering:
        """Return the rendering with its effects in order."""
        asked = frozenset(effects)
        return cls(
            effects=tuple(effect for effect in Effect if effect in asked),
            sampling=sampling,
            transport=transport,
        )
