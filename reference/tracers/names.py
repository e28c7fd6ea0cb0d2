"""Names of the tracers that can be asked for."""

from __future__ import annotations

TRACERS = ("embree", "mitsuba")
"""Names of the tracers that can be asked for, the default first."""
