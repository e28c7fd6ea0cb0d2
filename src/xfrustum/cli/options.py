"""Options that commands share: apertures, near planes, settings of the double frustum.

Nothing heavy is imported before a command runs, so that `--help` answers at once.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeVar

import click

from xfrustum.cli import completion
from xfrustum.cli.numbers import AUTO, Positive
from xfrustum.terminal import printable, say
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
    from xfrustum.compare.scouting.automatic import AutoApertures
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum, Fit
    from xfrustum.scenes.plate.plate import Aperture

Command = TypeVar("Command", bound=Callable[..., Any])


class Name(click.ParamType[StrEnum]):
    """One name out of an enumeration of `xfrustum.scenes.plate.double_frustum`."""

    def __init__(self, enumeration: str) -> None:
        self.name = enumeration

    def _names(self) -> type[StrEnum]:
        from xfrustum.scenes.plate import double_frustum

        names: type[StrEnum] = getattr(double_frustum, self.name)
        return names

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the names to choose from."""
        return f"[{'|'.join(self._names())}]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> StrEnum:
        """Return the member of that name."""
        names = self._names()
        try:
            return names(str(value).lower())
        except ValueError:
            self.fail(f"{value!r} is not one of {', '.join(names)}", param, ctx)


class Tracer(click.ParamType[str]):
    """One of `xfrustum.reference.TRACERS`."""

    name = "tracer"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the tracers to choose from."""
        from xfrustum.reference import TRACERS

        return f"[{'|'.join(TRACERS)}]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name of a tracer."""
        from xfrustum.reference import TRACERS

        if value not in TRACERS:
            self.fail(f"{value!r} is not one of {', '.join(TRACERS)}", param, ctx)
        return str(value)


class Numbers(click.ParamType[tuple[float, ...]]):
    """Numbers separated by commas."""

    name = "N,N,.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the numbers in the order given."""
        try:
            return tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 0.1,0.01", param, ctx)


class Sizes(click.ParamType[tuple[int, ...]]):
    """Positive whole numbers separated by commas."""

    name = "N,N,.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Return the numbers in the order given."""
        try:
            sizes = tuple(int(part) for part in str(value).split(","))
        except ValueError:
            sizes = ()
        if min(sizes, default=0) < 1:
            self.fail(f"{value!r} is not a list of positive whole numbers such as 512,1024", param, ctx)
        return sizes


class NameList(click.ParamType[tuple[StrEnum, ...]]):
    """Names out of an enumeration of `xfrustum.scenes.plate.double_frustum`, separated by commas."""

    def __init__(self, enumeration: str) -> None:
        self._one = Name(enumeration)
        self.name = enumeration

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the names to choose from."""
        return f"{self._one.get_metavar(param, ctx)},.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[StrEnum, ...]:
        """Return the members of these names in the order given."""
        return tuple(self._one.convert(part.strip(), param, ctx) for part in str(value).split(","))


class FitHeights(click.ParamType["tuple[Fit | float, ...]"]):
    """Fits as `FitHeight` takes them, separated by commas."""

    name = "angle|screen|Z,.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[Fit | float, ...]:
        """Return the names and heights in the order given."""
        return tuple(FitHeight().convert(part.strip(), param, ctx) for part in str(value).split(","))


class CutLists(click.ParamType[tuple[tuple[float, ...], ...]]):
    """Lists of cuts, as `Numbers` takes them, separated by semicolons; `none` is the list without a cut."""

    name = "Z,Z;none"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[tuple[float, ...], ...]:
        """Return the cuts of each list."""
        parts = [part.strip().lower() for part in str(value).split(";")]
        return tuple(() if part == "none" else Numbers().convert(part, param, ctx) for part in parts)


class FitHeight(click.ParamType["Fit | float"]):
    """The word `angle` or `screen`, or a height."""

    name = "angle|screen|Z"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Fit | float:
        """Return the name or the height."""
        from xfrustum.scenes.plate.double_frustum import Fit

        try:
            return Fit(str(value).lower()) if str(value).lower() in list(Fit) else float(value)
        except ValueError:
            self.fail(f"{value!r} is neither angle nor screen nor a height", param, ctx)


class Indices(click.ParamType[tuple[tuple[int, int], ...]]):
    """Apertures as column,row separated by semicolons."""

    name = "I,J;I,J"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[tuple[int, int], ...]:
        """Return (column, row) of each aperture."""
        try:
            pairs = [[int(part) for part in pair.split(",")] for pair in str(value).split(";")]
            return tuple((column, row) for column, row in pairs)
        except ValueError:
            self.fail(f"{value!r} is not a list of column,row such as 40,30;0,0", param, ctx)


class IndicesOrAuto(click.ParamType["tuple[tuple[int, int], ...] | str"]):
    """Apertures as column,row separated by semicolons, or the word `auto`."""

    name = "I,J;I,J|auto"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[tuple[int, int], ...] | str:
        """Return (column, row) of each aperture, or the word."""
        return AUTO if str(value).lower() == AUTO else Indices().convert(value, param, ctx)


class CountOrAuto(click.ParamType["int | str"]):
    """A number of apertures, or the word `auto`."""

    name = "N|auto"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        """Return the number or the word."""
        return AUTO if str(value).lower() == AUTO else click.IntRange(1).convert(value, param, ctx)


class Index(click.ParamType[tuple[int, int]]):
    """One aperture as column,row."""

    name = "I,J"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return (column, row)."""
        try:
            column, row = (int(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not column,row such as 40,30", param, ctx)
        return column, row


class Depths(click.ParamType[tuple[tuple[StrEnum, StrEnum], ...]]):
    """Depth formats, each with a mapping after a colon; without one it is `standard`."""

    name = "FORMAT[:MAPPING],.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[tuple[DepthFormat, DepthMapping], ...]:
        """Return (format, mapping) of each."""
        from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping

        try:
            parts = [part.strip().lower().partition(":") for part in str(value).split(",")]
            return tuple((DepthFormat(form), DepthMapping(name or "standard")) for form, _, name in parts)
        except ValueError:
            formats, mappings = ", ".join(DepthFormat), ", ".join(DepthMapping)
            self.fail(f"{value!r}: formats are {formats}, mappings are {mappings}", param, ctx)


# One option for each field of DoubleFrustum, whose defaults hold where the option is left out.
_SETTINGS = (
    click.option("--near", type=Positive(), required=True, help="Offset of both cameras, 0 < N < reach."),
    click.option("--depth", type=Name("DepthFormat"), help="Depth buffer format.  [default: d24]"),
    click.option("--mapping", type=Name("DepthMapping"), help="Depth mapping.  [default: standard]"),
    click.option("--pivot", type=Name("Pivot"), help="Center of the shear.  [default: aperture]"),
    click.option(
        "--fit", type=FitHeight(), help="Height |z| drawn exactly.  [default: the first cut, or angle]"
    ),
    click.option("--offset", type=Name("Offset"), help="Whether cameras step back.  [default: plate]"),
    click.option("--slabs", type=Numbers(), help="Heights |z| at which both frusta are cut."),
    click.option("--camera", type=Name("Camera"), help="Which cameras draw.  [default: both]"),
    click.option("--cull", type=Name("Cull"), help="Faces left out, by winding.  [default: none]"),
)

_SETTING_NAMES = ("near", "depth", "mapping", "pivot", "fit", "offset", "slabs", "camera", "cull")
_NEAR_WITHOUT_NEED = click.option("--near", type=Positive(), help="Offset of both cameras, 0 < N < reach.")


def double_frustum_options(command: Command) -> Command:
    """Add the options of the double frustum; the command receives them as one `settings`."""

    @functools.wraps(command)
    def with_settings(**options: Any) -> Any:
        return command(settings=_collect(options), **options)

    for option in reversed(_SETTINGS):
        with_settings = option(with_settings)
    return with_settings  # type: ignore[return-value]  # wraps() keeps the name, not the type


def optional_double_frustum_options(command: Command) -> Command:
    """Add the options of the double frustum; the command receives None where none of them is given.

    Raises
    ------
    click.UsageError
        Some of them are given without --near.
    """

    @functools.wraps(command)
    def with_settings(**options: Any) -> Any:
        given = [name for name in _SETTING_NAMES if options.get(name) is not None]
        if given and "near" not in given:
            raise click.UsageError(f"--{given[0]} is a setting of the two cameras: give --near too")
        if given:
            return command(settings=_collect(options), **options)
        return command(settings=None, **{k: v for k, v in options.items() if k not in _SETTING_NAMES})

    for option in reversed((_NEAR_WITHOUT_NEED, *_SETTINGS[1:])):
        with_settings = option(with_settings)
    return with_settings  # type: ignore[return-value]  # wraps() keeps the name, not the type


def _collect(options: dict[str, Any]) -> DoubleFrustum:
    """Remove the settings from a command's options, and return them."""
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

    given = {name: options.pop(name, None) for name in _SETTING_NAMES}
    return DoubleFrustum(**{name: value for name, value in given.items() if value is not None})


def open_scene(name: str) -> Scene:
    """Open a scene file or a built-in scene, and print its warnings on standard error.

    Raises
    ------
    InputError
        There is no such scene, or its file is not valid; see `xfrustum.open_scene`.
    """
    from xfrustum.scenes import open_scene as opened

    scene = opened(name)
    for line in scene.warnings:
        warn(line)
    return scene


def chosen_aperture(scene: Scene, index: tuple[int, int] | None) -> Aperture:
    """Return the aperture of an index, the middle one where there is none.

    Raises
    ------
    InputError
        The index lies outside the plate.
    """
    return scene.plate.middle if index is None else scene.plate.aperture(*index)


def is_given(parameter: str) -> bool:
    """Return whether the current command's parameter of that name was given, and has not its default."""
    from click.core import ParameterSource

    return click.get_current_context().get_parameter_source(parameter) is not ParameterSource.DEFAULT


def auto_apertures(scene: Scene, *, quiet: bool) -> AutoApertures:
    """Choose apertures by a scout of the plate, and say on standard error which and why.

    Raises
    ------
    InputError
        None of them sees anything.
    """
    from xfrustum.reports.scouting.automatic import auto_apertures as chosen
    from xfrustum.reports.scouting.automatic import notes

    auto = chosen(scene, progress=not quiet)
    look_at(scene, auto.apertures)
    for note in notes(auto):
        say(f"note: {note}")
    return auto


def one_or_auto(
    scene: Scene, index: tuple[int, int] | None, auto: str | None, *, quiet: bool
) -> Aperture | AutoApertures:
    """Return the aperture of an index, the middle one, or those that `--apertures auto` chooses.

    Raises
    ------
    InputError
        The index lies outside the plate, or none of the apertures sees anything.
    click.UsageError
        Both options are given.
    """
    if auto is None:
        aperture = chosen_aperture(scene, index)
        look_at(scene, [aperture])
        return aperture
    if index is not None:
        raise click.UsageError(
            "--aperture names one aperture and --apertures asks for many: give one of them"
        )
    return auto_apertures(scene, quiet=quiet)


def several_or_auto(
    scene: Scene, indices: tuple[tuple[int, int], ...] | str | None, *, quiet: bool
) -> tuple[Aperture, ...] | AutoApertures:
    """Return the apertures of some indices, those of a report by default, or those that `auto` chooses.

    Raises
    ------
    InputError
        An index lies outside the plate, or none of the apertures sees anything.
    """
    if isinstance(indices, str):
        return auto_apertures(scene, quiet=quiet)
    if indices is None:
        given = scene.default_apertures()
    else:
        given = tuple(scene.plate.aperture(*index) for index in indices)
    look_at(scene, given)
    return given


def look_at(scene: Scene, apertures: Sequence[Aperture], *, black_is_right: bool = False) -> None:
    """Refuse apertures that see nothing; warn on standard error of cut and of tiny objects.

    Parameters
    ----------
    scene
        Scene that the command is asked about.
    apertures
        Apertures that the command is asked about.
    black_is_right
        Whether the command's answer is a picture, which may be black: then apertures that see nothing are
        a warning as long as another one sees something, and in hard cases, which are empty on purpose.

    Raises
    ------
    InputError
        None of the apertures sees anything of the objects; with `black_is_right`, no aperture of the plate.
    """
    from xfrustum.compare import extent
    from xfrustum.scenes.errors import InputError
    from xfrustum.scenes.library.hard import cases as hard_cases

    unseen = extent.unseen_sentence(scene, apertures)
    if unseen is None:
        warn_of(scene)
        return
    if not black_is_right:
        raise InputError(unseen)
    if scene.source not in hard_cases.CASES:
        extent.require_seen(scene, scene.plate.apertures())
    warn(unseen)


def warn_of(scene: Scene) -> None:
    """Warn on standard error of objects that the reach cuts, and of those that are tiny beside the plate."""
    from xfrustum.compare import extent

    for warning in extent.warnings(scene):
        warn(warning)


def warn(warning: str) -> None:
    """Print a warning on standard error."""
    say(f"warning: {warning}")


def tell(as_json: bool, summary: Callable[[], dict[str, Any]], text: Callable[[], str]) -> None:
    """Print a command's result on standard output.

    Parameters
    ----------
    as_json
        Whether to print one JSON object instead of text.
    summary, text
        The functions that make the object and the text.
    """
    if as_json:
        print_json(summary())
    else:
        echo(text())


def echo(text: str) -> None:
    """Print text on standard output, its control characters escaped.

    Raises
    ------
    click.ClickException
        Standard output cannot be written, and not because its reader has stopped reading.
    """
    try:
        click.echo(printable(text))
    except BrokenPipeError:
        raise
    except OSError as error:
        reason = error.strerror or "I/O error"
        raise click.ClickException(
            f"standard output: cannot be written ({reason}); send it to a place that has room"
        ) from error


scene_argument = click.argument("scene", shell_complete=completion.scenes)
aperture_option = click.option(
    "--aperture", type=Index(), help="Column,row on the plate.  [default: the middle]"
)
auto_option = click.option(
    "--apertures",
    "auto",
    type=click.Choice([AUTO], case_sensitive=False),
    help="Instead of one aperture: the middle one and the worst of the plate.",
)
tracer_option = click.option(
    "--tracer", type=Tracer(), default="embree", show_default=True, help="Ray tracer."
)
free_tracer_option = click.option(
    "--tracer", type=Tracer(), help="Ray tracer.  [default: embree; mitsuba for light transport]"
)
quiet_option = click.option("--quiet", is_flag=True, help="No progress bar.")
tolerance_option = click.option(
    "--tolerance-px",
    type=Positive(),
    default=TOLERANCE_PX,
    show_default=True,
    help="Displacement that 99 % may have.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object on standard output."""
    from xfrustum.reports.common.json_ready import json_ready

    text = json.dumps(json_ready(value), allow_nan=False)
    # JSON escapes all other control characters.
    echo(text.replace("\x7f", "\\u007f"))
