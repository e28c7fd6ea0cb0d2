"""What a study's numbers came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from xfrustum.reports.common.records import named_columns

VERSION_COLUMN, DEVICE_COLUMN = "version_{}", "device_{}"
"""Names of the columns of a version and of a fact about the device."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What a study's numbers came from: versions of the libraries and the device, by name."""

    versions: Mapping[str, str] = field(metadata=named_columns(VERSION_COLUMN))
    devices: Mapping[str, str] = field(metadata=named_columns(DEVICE_COLUMN))
