"""Options that commands share, the kinds of values that they take, and how commands print.

A kind is a function that reads text (`Read`); options that belong together reach a command as one argument
(`gathered`). Nothing heavy is imported before a command runs, so that `--help` answers at once.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum, Fit
from xfrustum.terminal import printable, say
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.reports.blocks import Engine
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.plate import Aperture

Command = TypeVar("Command", bound=Callable[..., Any])
Decorator = Callable[[Any], Any]

LIMIT_EXCEEDED = 1
"""Exit status of a command that was done and whose result is no: a limit exceeded, a pixel that differs."""

TRACERS = ("embree", "mitsuba")
"""`xfrustum.reference.TRACERS`, which takes long to load; tests/cli/test_help.py compares the two."""

AUTO = "auto"
"""Word for what the program is to choose: as many sub-apertures as a scene needs, or the worst apertures."""


def option(*names: Any, **settings: Any) -> Decorator:
    """Return an option: its names, then its kind and its help, without keywords."""
    *flags, kind, words = names
    return click.option(*flags, type=kind, help=words, **settings)


def command(example: str, **settings: Any) -> Callable[[Callable[..., Any]], click.Command]:
    """Return the decorator of a command whose help ends with an example."""
    return click.command(epilog=f"\b\nExample:\n  {example}", **settings)


class Read(click.ParamType[Any]):
    """A kind of value: a function that reads text, and what it wants where it raises ValueError."""

    def __init__(self, name: str, read: Callable[[str], Any], wants: str) -> None:
        self.name, self.read, self.wants = name, read, wants

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form of the value, for the help."""
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value that was read."""
        if not isinstance(value, str):  # a default
            return value
        try:
            return self.read(value.strip())
        except (ValueError, OverflowError):
            self.fail(f"{value!r} is not {self.wants}", param, ctx)


def list_of(kind: Read, by: str = ",", name: str | None = None, wants: str | None = None) -> Read:
    """Return the kind of several values, separated by a character."""
    return Read(
        name or f"{kind.name}{by}..",
        lambda text: tuple(kind.read(part.strip()) for part in text.split(by)),
        wants or kind.wants,
    )


def or_auto(kind: Read) -> Read:
    """Return the kind of a value or the word `auto`."""
    return Read(
        f"{kind.name}|{AUTO}",
        lambda text: AUTO if text.lower() == AUTO else kind.read(text),
        f"{kind.wants}, or {AUTO}",
    )


def one_of(names: Iterable[str], read: Callable[[str], Any] = str) -> Read:
    """Return the kind of a name out of some, in small letters."""
    known = tuple(names)

    def chosen(text: str) -> Any:
        if text.lower() not in known:
            raise ValueError
        return read(text.lower())

    return Read(f"[{'|'.join(known)}]", chosen, f"one of {', '.join(known)}")


def member(enumeration: type[StrEnum]) -> Read:
    """Return the kind of a member of an enumeration."""
    return one_of(enumeration, enumeration)


def _positive(text: str, below: float = math.inf) -> float:
    number = float(text)
    if not 0 < number < below:
        raise ValueError
    return number


def _at_least_1(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError
    return number


def _pair(text: str, by: str = ",", read: Callable[[str], int] = int) -> tuple[int, int]:
    first, second = text.split(by)
    return read(first), read(second)


def _share(text: str) -> float:
    share = float(text[:-1]) / 100 if text.endswith("%") else float(text)
    if not 0 <= share <= 1:
        raise ValueError
    return share


def _length(text: str) -> tuple[float, str | None]:
    match = re.fullmatch(r"([-+.\d]+(?:e[-+]?\d+)?)\s*([^\W\d]*)", text)
    if match is None:
        raise ValueError
    return _positive(match[1]), match[2] or None


def _fit(text: str) -> Fit | float:
    return Fit(text.lower()) if text.lower() in set(Fit) else float(text)


def _depth(text: str) -> tuple[DepthFormat, DepthMapping]:
    form, _, mapping = text.lower().partition(":")
    return DepthFormat(form), DepthMapping(mapping or "standard")


POSITIVE = Read("FLOAT", _positive, "a positive, finite number")
BELOW_1 = Read("FLOAT", functools.partial(_positive, below=1.0), "a number between 0 and 1, without both")
SHARE = Read("SHARE", _share, "a share such as 1% or 0.01")
LENGTH = Read("LENGTH", _length, "a length such as 600 or 600mm")
NUMBERS = list_of(Read("N", float, ""), wants="a list of numbers such as 0.1,0.01")
SIZES = list_of(Read("N", _at_least_1, ""), wants="a list of positive whole numbers such as 512,1024")
COUNT = Read("N", _at_least_1, "a number of at least 1")
INDEX = Read("I,J", _pair, "column,row such as 40,30")
INDICES = list_of(INDEX, ";", "I,J;I,J", "a list of column,row such as 40,30;0,0")
RESOLUTION = Read("W,H", functools.partial(_pair, read=_at_least_1), "W,H such as 400,300")
TILES = Read("CxR", functools.partial(_pair, by="x", read=_at_least_1), "COLUMNSxROWS such as 8x6")
FIT = Read("angle|screen|Z", _fit, "angle, screen or a height")
DEPTHS = list_of(
    Read("FORMAT[:MAPPING]", _depth, ""),
    wants=f"a list of {', '.join(DepthFormat)}, each with or without :MAPPING ({', '.join(DepthMapping)})",
)
FOLDER = click.Path(path_type=Path)


def gathered(name: str, make: Callable[..., Any], *options: Decorator) -> Callable[[Command], Command]:
    """Return what adds options that a command receives as one argument: what `make` makes of their values."""

    def probe() -> None: ...

    for option in options:
        option(probe)
    keys = [parameter.name for parameter in probe.__click_params__]  # type: ignore[attr-defined]

    def add(function: Command) -> Command:
        @functools.wraps(function)
        def with_one(**given: Any) -> Any:
            own = {key: given.pop(key) for key in keys}
            return function(**{name: make(**own)}, **given)

        for option in reversed(options):
            option(with_one)
        return with_one  # type: ignore[return-value]  # wraps() keeps the name, not the type

    return add


_SETTINGS_HELP = {
    "near": "Offset of both cameras, 0 < N < reach.",
    "depth": "Depth buffer format.",
    "mapping": "Depth mapping.",
    "pivot": "Center of the shear.",
    "fit": "Height |z| drawn exactly.  [default: the first cut, or angle]",
    "offset": "Whether cameras step back.",
    "slabs": "Heights |z| at which both frusta are cut.",
    "camera": "Which cameras draw.",
    "cull": "Faces left out, by winding.",
}


def settings_options(*, required: bool = False) -> list[Decorator]:
    """Return an option for each field of DoubleFrustum, whose defaults hold where it is left out."""
    kinds = {"near": POSITIVE, "fit": FIT, "slabs": NUMBERS}
    defaults = {field.name: field.default for field in fields(DoubleFrustum)}
    options = []
    for name, words in _SETTINGS_HELP.items():
        default, needed = defaults[name], required and name == "near"
        if isinstance(default, StrEnum):
            words = f"{words}  [default: {default}]"  # noqa: PLW2901
            kinds[name] = member(type(default))
        options.append(option(f"--{name}", kinds[name], words, required=needed))
    return options


def settings_of(**given: Any) -> DoubleFrustum | None:
    """Return the settings that options name; None where none does."""
    named = {name: value for name, value in given.items() if value is not None}
    if named and "near" not in named:
        raise click.UsageError(f"--{next(iter(named))} is a setting of the two cameras: give --near too")
    return DoubleFrustum(**named) if named else None


double_frustum_options = gathered("settings", settings_of, *settings_options(required=True))
optional_double_frustum_options = gathered("settings", settings_of, *settings_options())


def engine_of(part: tuple[int, int] | None = None, **given: Any) -> Engine | None:
    """Return where options say that blocks are done; None where they say nothing."""
    from xfrustum.reports.blocks import Engine, Part

    asked = {name: value for name, value in given.items() if value is not None}
    if part is not None:
        asked["part"] = Part(number=part[0], count=part[1])
        if "scheduler" not in asked:
            asked.setdefault("workers", 1)  # also for part 1/1: a job array may have one job
    return Engine(**asked) if asked else None


def engine_options(default: str, *, draws: bool = True) -> Callable[[Command], Command]:
    """Return what adds the options that say where blocks are done, which a command receives as `engine`.

    It is None where none of them is given: then work is done by `default`, in words. Only where blocks are
    drawn, devices are chosen.
    """
    part = Read("K/N", functools.partial(_pair, by="/"), "a part such as 3/8")
    devices = list_of(Read("I", int, ""), wants="a list of indices such as 0,1")
    added = [
        click.option("--scheduler", help="Address of a Dask scheduler, such as tcp://host:8786."),
        option("--workers", click.IntRange(1), f"Processes of this machine.  [default: {default}]"),
        option("--part", part, "Do one of N parts, without Dask: for job arrays."),
    ]
    if draws:
        words = "EGL devices by index, taken in turn.  [default: GPUs]"
        added.insert(2, option("--devices", devices, words))
    return gathered("engine", engine_of, *added)


def _scenes(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return a wish for names of files, and the built-in scenes whose names begin like a word."""
    del context, parameter  # click hands over both, and neither matters
    from xfrustum.scenes.library import builtin

    named = [CompletionItem(name) for name in builtin.names() if name.startswith(begun)]
    # Files come first: at their turn click's script for bash forgets the names that it has.
    return [CompletionItem(begun, type="file"), *named]


scene_argument = click.argument("scene", shell_complete=_scenes)
aperture_option = option("--aperture", INDEX, "Column,row on the plate.  [default: the middle]")
auto_option = option("--apertures", "auto", one_of([AUTO]), "The middle one and the worst of the plate.")
tracer_option = option("--tracer", one_of(TRACERS), "Ray tracer.", default="embree")
decided_by_option = option(
    "--decided-by",
    click.Choice(["certified", "embree", "mitsuba"]),
    "Certified truth, or a tracer's own picture.",
    default="certified",
)
tolerance_option = option(
    "--tolerance-px", POSITIVE, "Displacement that 99 % may have.", default=TOLERANCE_PX
)
seed_option = option("--seed", click.IntRange(0), "Start of the random numbers.", default=0)
encoding_option = option(
    "--encoding",
    click.Choice(["rgb", "srgb", "triangle-id", "object-id"]),
    "What pixels of pictures hold; not for OpenEXR.  [default: rgb]",
)
quiet_option = click.option("--quiet", is_flag=True, help="No progress bar.")
json_option = click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")


def quiet_and_json(function: Command) -> Command:
    """Add the options `--quiet` and `--json`."""
    added: Command = quiet_option(json_option(function))
    return added


def out_option(what: str, *, required: bool = False) -> Decorator:
    """Return the option for the folder or file that a command writes."""
    return option("--out", FOLDER, what, required=required)


def layout_option(name: str, words: str, *others: str) -> Decorator:
    """Return the option that names a layout of files, or one of some other names."""

    def known(text: str) -> str:
        from xfrustum.scenes.files.layouts import NAMES

        kind = one_of((*NAMES, *others))
        return str(kind.convert(text, None, None))

    return option(name, Read("LAYOUT", known, "the name of a layout"), words)


def accept_option(help_text: str) -> Decorator:
    """Return the option for conventions that are no faults."""

    def names(text: str) -> tuple[str, ...]:
        from xfrustum.compare.renderer_model.conventions import ACCEPTABLE

        if text == "all":
            return ACCEPTABLE
        return tuple(one_of((*ACCEPTABLE, "all")).convert(part, None, None) for part in text.split(","))

    return option("--accept", Read("NAME,NAME,..", names, "a list of conventions"), help_text)


def is_given(parameter: str) -> bool:
    """Return whether the current command's parameter of that name was given, and has not its default."""
    return click.get_current_context().get_parameter_source(parameter) is not ParameterSource.DEFAULT


def open_scene(name: str) -> Scene:
    """Open a scene file or a built-in scene, and print its warnings on standard error."""
    from xfrustum.scenes import open_scene as opened

    scene = opened(name)
    for line in scene.warnings:
        say(f"warning: {line}")
    return scene


def chosen_aperture(scene: Scene, index: tuple[int, int] | None) -> Aperture:
    """Return the aperture of an index, the middle one where there is none."""
    return scene.plate.middle if index is None else scene.plate.aperture(*index)


def auto_apertures(scene: Scene, *, quiet: bool) -> AutoApertures:
    """Choose the worst apertures of the plate, and say on standard error which and why."""
    from xfrustum.reports.scout import auto_apertures as chosen
    from xfrustum.reports.scout import notes

    auto = chosen(scene, progress=not quiet)
    look_at(scene, auto.apertures)
    for note in notes(auto):
        say(f"note: {note}")
    return auto


def one_or_auto(
    scene: Scene, index: tuple[int, int] | None, auto: str | None, *, quiet: bool
) -> Aperture | AutoApertures:
    """Return the aperture of an index, the middle one, or those that `--apertures auto` chooses."""
    if auto is not None and index is not None:
        raise click.UsageError(
            "--aperture names one aperture and --apertures asks for many: give one of them"
        )
    if auto is not None:
        return auto_apertures(scene, quiet=quiet)
    aperture = chosen_aperture(scene, index)
    look_at(scene, [aperture])
    return aperture


def look_at(scene: Scene, apertures: Sequence[Aperture], *, black_is_right: bool = False) -> None:
    """Refuse apertures that see nothing; warn on standard error of cut and of tiny objects.

    Parameters
    ----------
    black_is_right
        Whether the command's answer is a picture, which may be black: then apertures that see nothing are
        a warning as long as another one sees something, and in hard cases, which are empty on purpose.
    """
    from xfrustum.compare import extent_words as extent
    from xfrustum.scenes.errors import InputError
    from xfrustum.scenes.library import hard_cases

    unseen = extent.unseen_sentence(scene, apertures)
    if unseen is None:
        warn_of(scene)
        return
    if not black_is_right:
        raise InputError(unseen)
    if scene.source not in hard_cases.CASES:
        extent.require_seen(scene, scene.plate.apertures())
    say(f"warning: {unseen}")


def warn_of(scene: Scene) -> None:
    """Warn on standard error of objects that the reach cuts, and of those that are tiny beside the plate."""
    from xfrustum.compare import extent_words as extent

    for warning in extent.warnings(scene):
        say(f"warning: {warning}")


def note(line: str) -> None:
    """Print a note on standard error."""
    say(f"note: {line}")


def tell(as_json: bool, summary: Callable[[], Any], text: Callable[[], str]) -> None:
    """Print a command's result on standard output: one JSON object, or text."""
    if not as_json:
        echo(text())
        return
    from xfrustum.reports.common.json_ready import json_ready

    # JSON escapes all other control characters.
    echo(json.dumps(json_ready(summary()), allow_nan=False).replace("\x7f", "\\u007f"))


def echo(text: str) -> None:
    """Print text on standard output, its control characters escaped."""
    click.echo(printable(text))
