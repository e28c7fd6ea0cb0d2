"""What results print with `--json`: each result has a record, and its summary is the record as JSON."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

from xfrustum.reports.common.json_ready import json_ready

Record = TypeVar("Record")


class Summarized(ABC, Generic[Record]):
    """A result whose record, a frozen dataclass, has the fields of its JSON object in their order."""

    @property
    @abstractmethod
    def record(self) -> Record:
        """The record that is written."""

    def summary(self) -> dict[str, Any]:
        """Return the record as one JSON object, as the command prints it with `--json`."""
        return dict(json_ready(self.record))
