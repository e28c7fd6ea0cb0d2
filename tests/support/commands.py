"""Run commands in this process and capture their output."""

import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

import pytest

from xfrustum.cli.main import main


@dataclass(frozen=True, kw_only=True)
class Output:
    """Standard output and standard error of a command."""

    out: str
    err: str

    @property
    def record(self) -> dict[str, Any]:
        """The only JSON object on standard output, without NaN and Infinity."""
        value = json.loads(self.out, parse_constant=_refuse)
        assert isinstance(value, dict)
        return value


#: function that runs a command line, split as by a shell, and asserts its exit status (default 0)
Command = Callable[..., Output]


def command_of(capture: pytest.CaptureFixture[str]) -> Command:
    """Return a function that runs a command line and returns its output."""

    def command(line: str, *, status: int = 0) -> Output:
        capture.readouterr()
        assert main(shlex.split(line)) == status
        printed = capture.readouterr()
        return Output(out=printed.out, err=printed.err)

    return command


def _refuse(constant: str) -> NoReturn:
    raise AssertionError(f"{constant} is not JSON")
