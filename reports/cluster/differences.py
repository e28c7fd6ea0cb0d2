"""What differs between two descriptions of work, in words."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice

MAX_NAMED_VALUES = 3
"""Values of one part of a description that are told with what they were and what they are now."""

MAX_VALUE_CHARACTERS = 40
"""Longest text of a value that is told; hashes and longer texts tell a reader nothing."""


def differences_words(found: object, wanted: object) -> str:
    """Return what differs, such as "other settings (near was 0.1, now 0.2) and another scene".

    Parameters
    ----------
    found, wanted
        Description that a folder has, and the one that is asked for, both as JSON has them.
    """
    if not (isinstance(found, dict) and isinstance(wanted, dict)):
        return "another description"
    parts = []
    for key in dict.fromkeys((*wanted, *found)):
        if found.get(key) == wanted.get(key):
            continue
        values = list(islice(_changed_values(found.get(key), wanted.get(key), key), MAX_NAMED_VALUES))
        told = "; ".join(f"{name} was {was}, now {now}" for name, was, now in values)
        # "Content" has no plural.
        article = "other" if key.split()[0].endswith("s") or key == "content" else "another"
        parts.append(f"{article} {key}" + (f" ({told})" if told else ""))
    *first, last = parts or ["another description"]
    return f"{', '.join(first)} and {last}" if first else last


def _changed_values(found: object, wanted: object, name: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, former and present text of the short values that differ, however deep they lie."""
    if found == wanted:
        return
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in dict.fromkeys((*wanted, *found)):
            yield from _changed_values(found.get(key), wanted.get(key), key)
    elif isinstance(found, list) and isinstance(wanted, list) and len(found) == len(wanted):
        for one, other in zip(found, wanted, strict=True):
            yield from _changed_values(one, other, name)
    else:
        was, now = (json.dumps(value, ensure_ascii=False, default=str) for value in (found, wanted))
        if max(len(was), len(now)) <= MAX_VALUE_CHARACTERS:
            yield name, was, now
