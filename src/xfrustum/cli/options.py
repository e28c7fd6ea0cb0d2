"""Options that commands share, kinds of option values, and printing of results.

The options of a command are attributes of a class (`Asked`): name, kind and help. The command
receives one object with the values; the kinds determine their types. A kind is a function that
reads text (`Read`). Nothing heavy is imported before a command runs, so that `--help` prints at
once.
"""

from __future__ import annotations

import functools
import inspect
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, get_type_hints, overload

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from xfrustum.process import printable, say
from xfrustum.scenes.plate import Cull, DepthFormat, DepthMapping, DoubleFrustum, Fit
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.reports.blocks import Engine
    from xfrustum.scenes.model.device_model import DeviceModel
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate import Aperture

T = TypeVar("T")
S = TypeVar("S", bound=str)

#: Exit status of a completed command with a negative result: a limit exceeded, a pixel that
#: differs.
LIMIT_EXCEEDED = 1

#: Copy of `xfrustum.reference.TRACERS`, which loads slowly; tests/cli/test_help.py compares them.
TRACERS = ("embree", "mitsuba")

#: Option value that lets the program choose the number of sub-apertures, or the worst apertures.
AUTO = "auto"


@dataclass(frozen=True)
class Declared:
    """Click parameters of one attribute of a command."""

    parameters: Callable[[str], list[click.Parameter]]
    make: Callable[..., Any] | None = None


@overload
def option(kind: click.ParamType[T], words: str, *flags: str, required: Literal[True]) -> T: ...
@overload
def option(
    kind: click.ParamType[T], words: str, *flags: str, default: Any, **settings: Any
) -> T: ...
@overload
def option(kind: click.ParamType[T], words: str, *flags: str) -> T | None: ...
def option(kind: Any, words: str, *flags: str, **settings: Any) -> Any:
    """Return the option of an attribute, with kind and help text; `flags` replace its flag."""

    def parameters(name: str) -> list[click.Parameter]:
        named = flags or (f"--{name.replace('_', '-')}",)
        return [click.Option([name, *named], type=kind, help=words, **settings)]

    # Create parameters late: the class gives the name of the attribute.
    return Declared(parameters)


def choice(names: str, words: str, *flags: str, **settings: Any) -> Any:
    """Return an option whose value is one of some names, separated by spaces in `names`."""
    return option(click.Choice(names.split()), words, *flags, **settings)


def flag(words: str, *flags: str, default: bool | None = False) -> bool:
    """Return a switch: an option without a value, or a pair `--x/--no-x`."""
    made: bool = option(click.BOOL, words, *flags, default=default, is_flag=True)
    return made


def argument(**settings: Any) -> Any:
    """Return the argument of an attribute."""
    return Declared(lambda name: [click.Argument([name], **settings)])


def group(make: Callable[..., T], **members: Any) -> T:
    """Return several options as one attribute; `make` combines their values."""

    def parameters(_: str) -> list[click.Parameter]:
        return [
            parameter for name, member in members.items() for parameter in member.parameters(name)
        ]

    made: Any = Declared(parameters, make)
    return made  # type: ignore[no-any-return]


def several(**members: Any) -> dict[str, Any]:
    """Return several options as one attribute, a dictionary by name."""
    return group(dict[str, Any], **members)


class Asked:
    """Options of a command; the help lists options of the subclass before inherited options."""

    def __init__(self, **values: Any) -> None:
        vars(self).update(values)


def command(
    example: str, within: click.Group | None = None
) -> Callable[[Callable[[Any], int | None]], click.Command]:
    """Return a decorator that makes a command of a function with the parameter `request`.

    The annotation of `request` is the class of the options. The help ends with the example.
    """

    def made(function: Callable[[Any], int | None]) -> click.Command:
        request_class: type[Asked] = get_type_hints(function)["request"]
        declared: dict[str, tuple[Declared, list[click.Parameter]]] = {}
        # The subclass comes first in the method resolution order, so that its options precede
        # inherited options in the help, and override them.
        for kind in request_class.__mro__:
            for name, member in vars(kind).items():
                if isinstance(member, Declared):
                    declared.setdefault(name, (member, member.parameters(name)))

        def called(**parsed: Any) -> int | None:
            values = {}
            for name, (member, parameters) in declared.items():
                # One attribute may collect several parameters, such as the settings of the cameras.
                own = {str(parameter.name): parsed[str(parameter.name)] for parameter in parameters}
                values[name] = own[name] if member.make is None else member.make(**own)
            return function(request_class(**values))

        own = click.Command(
            # A function whose name would hide a builtin ends with an underscore.
            function.__name__.rstrip("_"),
            callback=called,
            params=[parameter for _, some in declared.values() for parameter in some],
            help=inspect.getdoc(function),
            epilog=f"\b\nExample:\n  {example}",
        )
        if within is not None:
            within.add_command(own)
        return own

    return made


def present(**values: Any) -> dict[str, Any]:
    """Return the values that are not None."""
    return {name: value for name, value in values.items() if value is not None}


def is_given(parameter: str) -> bool:
    """Return whether the user set a parameter of the current command."""
    return (
        click.get_current_context().get_parameter_source(parameter) is not ParameterSource.DEFAULT
    )


def flag_of(parameter: str) -> str:
    """Return the spelling of the current command's option of this name, such as `--near`."""
    options = click.get_current_context().command.params
    return next(str(option_.opts[-1]) for option_ in options if option_.name == parameter)


class Read(click.ParamType[T], Generic[T]):
    """Kind of value: a function that reads text; `wants` is the expected form, for errors."""

    def __init__(self, name: str, read: Callable[[str], T], wants: str) -> None:
        self.name, self.read, self.wants = name, read, wants

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form of the value, for the help."""
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> T:
        """Convert text to a value."""
        # Defaults are values already.
        if not isinstance(value, str):
            return value  # type: ignore[no-any-return]
        try:
            return self.read(value.strip())
        except (ValueError, OverflowError):
            self.fail(f"{value!r} is not {self.wants}", param, ctx)


def list_of(
    kind: Read[T], by: str = ",", name: str | None = None, wants: str | None = None
) -> Read[tuple[T, ...]]:
    """Return the kind of a list of values, separated by a character."""
    return Read(
        name or f"{kind.name}{by}..",
        lambda text: tuple(kind.read(part.strip()) for part in text.split(by)),
        wants or kind.wants,
    )


def or_auto(kind: Read[Any]) -> Read[Any]:
    """Return the kind of a value or the word `auto`."""
    return Read(
        f"{kind.name}|{AUTO}",
        lambda text: AUTO if text.lower() == AUTO else kind.read(text),
        f"{kind.wants}, or {AUTO}",
    )


def one_of(names: Iterable[S]) -> Read[S]:
    """Return the kind of a value that is one of some names or members; case is ignored."""
    known: tuple[Any, ...] = tuple(names)
    words = f"one of {', '.join(known)}"
    return Read(f"[{'|'.join(known)}]", lambda text: known[known.index(text.lower())], words)


def number(
    text: str, kind: type[Any] = float, least: float = -math.inf, below: float = math.inf
) -> Any:
    """Return a number in [least, below); ValueError for any other number."""
    value = kind(text)
    # NaN fails every comparison, and is refused here as well.
    if not least <= value < below:
        raise ValueError
    return value


def pair(text: str, by: str = ",", least: float = -math.inf) -> tuple[int, int]:
    """Return two whole numbers."""
    first, second = text.split(by)
    return number(first, int, least), number(second, int, least)


def _share(text: str) -> float:
    # Both 1% and 0.01 are accepted; a bare 1 is the whole, not one percent.
    share = float(text[:-1]) / 100 if text.endswith("%") else float(text)
    if not 0 <= share <= 1:
        raise ValueError
    return share


def _length(text: str) -> tuple[float, str | None]:
    # The exponent is part of the number: the unit of 1e3mm is mm. A unit may have letters of any
    # script: the scene file defines its name.
    match = re.fullmatch(r"([-+.\d]+(?:e[-+]?\d+)?)\s*([^\W\d]*)", text)
    if match is None:
        raise ValueError
    return POSITIVE.read(match[1]), match[2] or None


def _bytes(text: str) -> int:
    # Units are powers of 1024, with or without a B for bytes.
    match = re.fullmatch(r"([.\d]+)\s*([KMGT]?)(?:I?B)?", text.upper())
    if match is None:
        raise ValueError
    return int(POSITIVE.read(match[1]) * 1024 ** (" KMGT".index(match[2] or " ")))


def _size(text: str) -> tuple[tuple[float, str | None], ...]:
    """Return width and height; a unit after the last applies to both."""
    first, second = (_length(part.strip()) for part in text.split(","))
    # In 600,400mm the unit applies to both sides; 600cm,400mm has two units.
    return (first[0], first[1] or second[1]), second


# First and last index; None for all.
Span = tuple[int, int] | None


def _span(text: str) -> Span:
    """Return the first and the last index of N, N-M; None for *."""
    match = re.fullmatch(r"(\*)|(\d+)(?:-(\d+))?", text.strip())
    if match is None:
        raise ValueError
    every, first, last = match.groups()
    if every:
        return None
    # An inverted range is a mistake, not an empty selection.
    if int(last or first) < int(first):
        raise ValueError
    return int(first), int(last or first)


def _block(text: str) -> tuple[Span, Span]:
    columns, rows = text.split(",")
    return _span(columns), _span(rows)


def _depth(text: str) -> tuple[DepthFormat, DepthMapping]:
    form, _, mapping = text.lower().partition(":")
    return DepthFormat(form), DepthMapping(mapping or "standard")


# Least positive double: an inclusive lower bound that excludes zero.
_LEAST = math.nextafter(0.0, 1.0)
POSITIVE = Read("FLOAT", functools.partial(number, least=_LEAST), "a positive, finite number")
BELOW_1 = Read(
    "FLOAT",
    functools.partial(number, least=_LEAST, below=1.0),
    "a number between 0 and 1, without both",
)
SHARE = Read("SHARE", _share, "a share such as 1% or 0.01")
LENGTH = Read("LENGTH", _length, "a length such as 600 or 600mm")
SIZE = Read("W,H", _size, "width,height such as 600,400 or 600,400mm")
NUMBERS = list_of(Read("N", float, ""), wants="a list of numbers such as 0.1,0.01")
COUNT = Read("N", functools.partial(number, kind=int, least=1), "a number of at least 1")
SIZES = list_of(COUNT, wants="a list of positive whole numbers such as 512,1024")
INDEX = Read("I,J", pair, "column,row such as 40,30")
INDICES = list_of(INDEX, ";", "I,J;I,J", "a list of column,row such as 40,30;0,0")
BLOCKS = list_of(
    Read("I-I,J-J", _block, ""), ";", wants="a list of columns,rows such as 0-80,30;*,0-5"
)
RESOLUTION = Read("W,H", functools.partial(pair, least=1), "W,H such as 400,300")
TILES = Read("CxR", functools.partial(pair, by="x", least=1), "COLUMNSxROWS such as 8x6")
FIT: Read[Fit | float] = Read(
    "angle|screen|Z",
    lambda text: Fit(text.lower()) if text.lower() in set(Fit) else float(text),
    "angle, screen or a height",
)
DEPTHS = list_of(
    Read("FORMAT[:MAPPING]", _depth, ""),
    wants=f"a list of {', '.join(DepthFormat)}, "
    f"each with or without :MAPPING ({', '.join(DepthMapping)})",
)
MEMORY = Read("SIZE", _bytes, "a size in bytes such as 500M or 1G")
_DEVICES = list_of(Read("I", int, ""), wants="a list of indices such as 0,1")
_PART = Read("K/N", functools.partial(pair, by="/"), "a part such as 3/8")
TEXT, COUNT_FROM_1 = click.STRING, click.IntRange(min=1)
FOLDER: click.ParamType[Path] = click.Path(path_type=Path)


_SETTINGS_HELP = {
    "near": "Near offset of both cameras, scene units, 0 < N < reach.",
    "depth": "Depth buffer format.",
    "mapping": "Depth mapping.",
    "pivot": "Center of the shear.",
    "fit": "Height |z| drawn exactly.  [default: the first cut, or angle]",
    "offset": "Move cameras off the plate (plate) or not (none).",
    "slabs": "Heights |z| at which both frusta are cut.",
    "camera": "Which cameras draw.",
    "cull": "Faces to leave out, by winding.",
}


def settings_members(*, required: bool = False) -> dict[str, Any]:
    """Return an option for each field of DoubleFrustum, with the field's default."""
    kinds: dict[str, click.ParamType[Any]] = {"near": POSITIVE, "fit": FIT, "slabs": NUMBERS}
    defaults = {field.name: field.default for field in fields(DoubleFrustum)}
    members: dict[str, Any] = {}
    for name, words in _SETTINGS_HELP.items():
        default = defaults[name]
        if isinstance(default, StrEnum):
            # Only the help names the default of an enumeration: None must mark an absent option.
            kinds[name] = one_of(type(default))
            words = f"{words}  [default: {default}]"  # noqa: PLW2901
        needed = {"required": True} if required and name == "near" else {}
        members[name] = option(kinds[name], words, **needed)
    return members


def settings_of(**values: Any) -> DoubleFrustum | None:
    """Return the settings of the two cameras; None without options."""
    named = present(**values)
    # Without near there are no cameras, and another setting would have no effect.
    if named and "near" not in named:
        raise click.UsageError(
            f"--{next(iter(named))} is a setting of the two cameras: give --near too"
        )
    return DoubleFrustum(**named) if named else None


def settings_options(*, required: bool = False) -> Any:
    """Return the options of the two cameras: a DoubleFrustum, or None if they are left out."""
    return group(settings_of, **settings_members(required=required))


def engine_of(part: tuple[int, int] | None = None, **values: Any) -> Engine | None:
    """Return the engine that options select; None if all are left out."""
    chosen = present(**values)
    if part is None and not chosen:
        return None
    from xfrustum.reports.blocks import Engine, Part

    if part is not None:
        chosen["part"] = Part(number=part[0], count=part[1])
        # A part without a scheduler is a separate job, by default with one process.
        if "scheduler" not in chosen:
            # Also for part 1/1: a job array may have one job.
            chosen.setdefault("workers", 1)
    return Engine(**chosen)


def engine_options(default: str, *, draws: bool = True) -> Any:
    """Return the options of an engine: None if all are left out; `default` describes that case.

    The option `--devices` exists only for commands that draw.
    """
    members = {
        "scheduler": option(TEXT, "Address of a Dask scheduler, such as tcp://host:8786."),
        "workers": option(
            COUNT_FROM_1, f"Number of processes on this machine.  [default: {default}]"
        ),
        "devices": option(
            _DEVICES, "Indices of EGL devices, assigned to processes in turn.  [default: GPUs]"
        ),
        "part": option(_PART, "Compute part K of N, as one job of a job array, without Dask."),
    }
    return group(
        engine_of,
        **{name: member for name, member in members.items() if draws or name != "devices"},
    )


def _scenes(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return completions of a word: file names, and built-in scenes that begin with it."""
    # Click passes both arguments; neither is used.
    del context, parameter
    # Completion must answer within a keystroke: only names are imported.
    from xfrustum.scenes.library import builtin

    named = [CompletionItem(name) for name in builtin.names() if name.startswith(begun)]
    # Files come first, because click's script for bash then drops the names collected before.
    return [CompletionItem(begun, type="file"), *named]


def _layout(text: str, *others: str) -> str:
    from xfrustum.scenes.files.layouts import NAMES

    return str(one_of((*NAMES, *others)).convert(text, None, None))


def _accepted(text: str) -> tuple[str, ...]:
    from xfrustum.compare.renderer_model.conventions import ACCEPTABLE

    kind = one_of((*ACCEPTABLE, "all"))
    return (
        ACCEPTABLE
        # Expand `all`, so that records name each accepted convention.
        if text == "all"
        else tuple(kind.convert(part, None, None) for part in text.split(","))
    )


LAYOUT = Read("LAYOUT", _layout, "the name of a layout")
LAYOUT_OR_ZARR = Read("LAYOUT", lambda text: _layout(text, "zarr"), "the name of a layout")
ACCEPTED = Read("NAME,NAME,..", _accepted, "a list of conventions")

scene_argument: str = argument(shell_complete=_scenes)
aperture_option = option(
    INDEX, "Column,row of the aperture, row 0 at the top.  [default: the middle]"
)


def _device_model(text: str) -> DeviceModel:
    from xfrustum.scenes.model.device_model import DeviceModel

    return DeviceModel.read(Path(text))


device_option = option(
    Read("FILE", _device_model, ""),
    "device.json (written by `device`) of the machine that draws.  [default: detected]",
    "--device",
)
tracer_option = option(one_of(TRACERS), "Ray tracer for the second opinion.", default="embree")
decided_by_option = choice(
    "certified embree mitsuba",
    "Decide pixels by certified truth, or by a bare ray tracer.",
    default="certified",
)
truth_option = choice(
    "auto directions hogels",
    "Order in which the truths of a plate are computed; results are equal.",
    default="auto",
)
tolerance_option = option(
    POSITIVE, "Largest displacement of 99 % of the points, pixels.", default=TOLERANCE_PX
)
seed_option = option(click.IntRange(0), "Seed of the random numbers.", default=0)
encoding_option = choice(
    "rgb srgb triangle-id object-id",
    "Meaning of pixel values in pictures; OpenEXR files have channel names.  [default: rgb]",
)


class Printed(Asked):
    """A command that prints its result as text, or as one JSON object."""

    as_json = flag("Print one JSON object on standard output.", "--json")

    def tell(self, summary: Callable[[], Any], text: Callable[[], str]) -> None:
        """Print the result on standard output."""
        if not self.as_json:
            echo(text())
            return
        from xfrustum.reports.common.outputs import json_ready

        # Escape DEL too, which the JSON standard does not require.
        echo(json.dumps(json_ready(summary()), allow_nan=False).replace("\x7f", "\\u007f"))


class Measured(Printed):
    """Command with a progress bar and printed results."""

    quiet = flag("Show no progress bar.")

    @property
    def progress(self) -> bool:
        """True if a progress bar is shown on standard error."""
        return not self.quiet


class OneOrAuto(Measured):
    """Command about one aperture of a scene, or about the worst apertures."""

    scene = scene_argument
    aperture = aperture_option
    auto: str | None = option(
        one_of([AUTO]), "auto: the middle aperture and the worst of the plate.", "--apertures"
    )

    def chosen(self, scene: Scene) -> Aperture | AutoApertures:
        """Return the aperture of `--aperture`, the middle, or the choice of `--apertures auto`."""
        if self.auto is not None and self.aperture is not None:
            raise click.UsageError(ONE_OR_MANY)
        # The scan of the whole plate takes seconds, and runs only on request.
        if self.auto is not None:
            return auto_apertures(scene, progress=self.progress)
        aperture = chosen_aperture(scene, self.aperture)
        look_at(scene, [aperture])
        return aperture


ONE_OR_MANY = "--aperture selects one aperture and --apertures several: give one of them"


def open_scene(name: str) -> Scene:
    """Open a scene file or a built-in scene, and print its warnings on standard error."""
    from xfrustum.scenes import open_scene as opened

    scene = opened(name)
    for line in scene.warnings:
        say(f"warning: {line}")
    return scene


def check_out(folder: Path | None, files: Sequence[str]) -> None:
    """Refuse an output folder that cannot be written or that holds other files."""
    if folder is not None:
        from xfrustum.reports.common.outputs import check_writable_folder

        check_writable_folder(folder, files)


def chosen_aperture(scene: Scene, index: tuple[int, int] | None) -> Aperture:
    """Return the aperture of an index; the middle aperture for None."""
    return scene.plate.middle if index is None else scene.plate.aperture(*index)


def indices_of(
    scene: Scene, blocks: Sequence[tuple[Span, Span]] | None
) -> Sequence[tuple[int, int]] | None:
    """Return the columns and rows of blocks of apertures; None for the whole plate."""
    from xfrustum.reports.plate.plate import blocks_of_apertures

    # All columns and all rows are the whole plate, which needs no list of indices.
    if blocks is None or (None, None) in blocks:
        return None
    return [aperture.index for aperture in blocks_of_apertures(scene.plate, blocks)]


def auto_apertures(scene: Scene, *, progress: bool) -> AutoApertures:
    """Choose the worst apertures of the plate, and print them with reasons on standard error."""
    from xfrustum.reports import plotting

    auto = plotting.auto_apertures(scene, progress=progress)
    look_at(scene, auto.apertures)
    for line in plotting.notes(auto):
        note(line)
    return auto


def look_at(scene: Scene, apertures: Sequence[Aperture], *, black_is_right: bool = False) -> None:
    """Refuse apertures that show nothing; warn of objects that are tiny or cut by the reach.

    `black_is_right` is for commands that write a picture: such apertures then cause only a warning
    if another aperture of the plate shows something, or if the scene is a hard case.
    """
    from xfrustum.reports import text
    from xfrustum.scenes.arguments import InputError
    from xfrustum.scenes.library import hard_cases

    unseen = text.unseen_sentence(scene, apertures)
    if unseen is None:
        warn_of(scene)
        return
    if not black_is_right:
        raise InputError(unseen)
    # Hard cases may be empty on purpose; any other plate must show something.
    if scene.source not in hard_cases.CASES:
        text.require_seen(scene, scene.plate.apertures())
    say(f"warning: {unseen}")


def warn_of(scene: Scene) -> None:
    """Warn on standard error of objects cut by the reach, and of tiny objects."""
    from xfrustum.reports import text

    for warning in text.warnings(scene):
        say(f"warning: {warning}")


def warn_of_culling(scene: Scene, cull: Cull) -> None:
    """Print warnings about objects that culling mostly removes from view."""
    from xfrustum.reports.text import facing_warnings

    if cull is Cull.BACK:
        for warning in facing_warnings(scene):
            say(f"warning: {warning}")


def note(line: str) -> None:
    """Print a note on standard error."""
    say(f"note: {line}")


def echo(text: str) -> None:
    """Print text on standard output, with control characters escaped."""
    click.echo(printable(text))
