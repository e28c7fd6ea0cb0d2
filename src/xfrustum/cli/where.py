"""Options that say where blocks are done: by processes of this machine, a cluster, or in parts."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli.options import Command

if TYPE_CHECKING:
    from xfrustum.reports.cluster.run import Engine


class PartOf(click.ParamType[tuple[int, int]]):
    """A part as K/N."""

    name = "K/N"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return the number of the part and that of all parts."""
        match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", str(value))
        if match is None:
            self.fail(f"{value!r} is not a part such as 3/8", param, ctx)
        return int(match[1]), int(match[2])


class Devices(click.ParamType[tuple[int, ...]]):
    """Indices of devices separated by commas."""

    name = "I,I,.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Return the indices in the order given."""
        if not re.fullmatch(r"\d{1,4}(,\d{1,4})*", str(value)):
            self.fail(f"{value!r} is not a list of indices such as 0,1", param, ctx)
        return tuple(int(part) for part in str(value).split(","))


@dataclass(frozen=True, kw_only=True)
class Where:
    """Values of the options that say where blocks are done.

    Attributes
    ----------
    scheduler, workers, devices, part
        As the options of the same names; None where they are not given.
    """

    scheduler: str | None = None
    workers: int | None = None
    devices: tuple[int, ...] | None = None
    part: tuple[int, int] | None = None

    @property
    def asked(self) -> bool:
        """Whether any of the options is given."""
        return any(value is not None for value in vars(self).values())

    def engine(self) -> Engine:
        """Return where blocks are done."""
        from xfrustum.reports.cluster.run import Engine, Part

        part, workers = self.part, self.workers
        parts = Part() if part is None else Part(number=part[0], count=part[1])
        if part is not None and self.scheduler is None and workers is None:
            workers = 1  # also for part 1/1: a job array may have one job
        return Engine(scheduler=self.scheduler, workers=workers, devices=self.devices or (), part=parts)


def engine_options(
    default: str = "one per processor or GPU", *, draws: bool = True
) -> Callable[[Command], Command]:
    """Return what adds the options that say where blocks are done.

    The command receives them as one `where`.

    Parameters
    ----------
    default
        Processes that work where none of these options is given, in words.
    draws
        Whether blocks are drawn, and devices are chosen.
    """
    added = [
        click.option("--scheduler", help="Address of a Dask scheduler, such as tcp://host:8786."),
        click.option(
            "--workers", type=click.IntRange(1), help=f"Processes of this machine.  [default: {default}]"
        ),
        click.option("--part", type=PartOf(), help="Do one of N parts, without Dask: for job arrays."),
    ]
    if draws:
        words = "EGL devices by index, which these processes take in turn.  [default: GPUs]"
        added.insert(2, click.option("--devices", type=Devices(), help=words))

    def add(command: Command) -> Command:
        @functools.wraps(command)
        def with_where(
            scheduler: str | None,
            workers: int | None,
            part: tuple[int, int] | None,
            devices: tuple[int, ...] | None = None,
            **rest: Any,
        ) -> Any:
            where = Where(scheduler=scheduler, workers=workers, devices=devices, part=part)
            return command(where=where, **rest)

        with_options: Callable[..., Any] = with_where
        for option in reversed(added):
            with_options = option(with_options)
        return with_options  # type: ignore[return-value]  # wraps() keeps the name, not the type

    return add
