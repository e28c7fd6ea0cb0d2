"""The conventions that a renderer's author may declare: their names, which are checked without more."""

from __future__ import annotations

CONVENTIONS = ("orientation", "order", "shift", "fov", "pitch", "near")
"""Conventions that a renderer's author may declare, so that images are judged by them."""

ENCODING = "encoding"
"""Name under which `accept` takes all faults of encoding; lost numbers cannot be accepted."""

ACCEPTABLE = (*CONVENTIONS, ENCODING)
"""Conventions that a renderer's author may declare, so that images are judged by the values found."""
