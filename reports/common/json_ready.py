"""Values as JSON takes them: one conversion for everything that is written or embedded."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np


def json_ready(value: Any) -> Any:
    """Return the value in JSON's own types.

    A dataclass becomes an object of its fields. NaN and infinity become None, and numpy scalars numbers.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    elif isinstance(value, Path | StrEnum):
        value = str(value)
    if value is None or isinstance(value, int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    return json_object(value) if is_dataclass(value) and not isinstance(value, type) else value


def json_object(record: Any) -> dict[str, Any]:
    """Return a dataclass as a JSON object; see `json_ready`."""
    return {field.name: json_ready(getattr(record, field.name)) for field in fields(record)}


def write_json(path: Path, record: Any) -> None:
    """Write a dataclass or a mapping as a JSON file, without NaN or infinity."""
    text = json.dumps(json_ready(record), allow_nan=False, indent=1)
    path.write_text(text + "\n", encoding="utf-8")
