"""Where a foreign renderer's hogel images come from: files, a program, a function; and digests of these."""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import shutil
import signal
import string
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from glob import escape, iglob
from pathlib import Path
from typing import Protocol

from xfrustum.interrupts import delayed
from xfrustum.reference import Reference
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding, read_foreign
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

MAX_NAMES_TRIED = 10_000
"""Files whose names are looked up one by one before the work, to tell a wrong pattern at once."""

Renderer = Callable[[Scene, Aperture], HogelImage]
"""What a renderer in Python looks like from here."""


class Problem(Exception):
    """One hogel that could not be had, in words."""


class Source(Protocol):
    """Hogel images by aperture."""

    name: str

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture.

        Raises
        ------
        Problem
            There is none, and why.
        """

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError where it is plain beforehand that there will be no image at all."""


def fields_of(template: str, allowed: Sequence[str], what: str) -> set[str]:
    """Return the fields of a template, which must all be known."""
    try:
        named = {name for _, name, _, _ in string.Formatter().parse(template) if name is not None}
    except ValueError as error:
        raise InputError(f"{what} {template!r}: {error}; write {{{{ for a brace") from error
    unknown = sorted(named - set(allowed))
    if unknown:
        known = ", ".join(f"{{{name}}}" for name in allowed)
        raise InputError(f"{what} {template!r}: {{{unknown[0]}}} is not one of {known}")
    _check_formats(template, what)
    return named


def absolute_pattern(pattern: str) -> str:
    """Return a pattern of files with its folder's absolute path, in which braces are no fields."""
    return str(Path(str(Path.cwd()).replace("{", "{{").replace("}", "}}")) / pattern)


def as_given(text: str, named_from: Path | None) -> str:
    """Return a text about files with their names as the user gave them: it is then the same in every folder.

    Parameters
    ----------
    named_from
        Folder from which the user named them; None where the names that were given are absolute.
    """
    if named_from is None or named_from == Path(named_from.anchor):
        return text
    # Not within a longer path, which names another folder.
    return re.sub(rf"(?<![\w./-]){re.escape(str(named_from))}/", "", text)


def folder_named_from(pattern: str) -> Path | None:
    """Return the folder from which a pattern of files is named; None of a pattern that is absolute."""
    return None if Path(pattern).is_absolute() else Path.cwd()


FORMAT = re.compile(r"0?\d{0,2}(\.\d{1,2})?[dfeg]?")
"""How a number may be asked for after a colon, such as 04d or .3f: at most 99 characters of it."""

EXAMPLES: dict[str, object] = {"x": 0.5, "y": 0.5, "i": 1, "j": 1, "out": Path("x")}
"""Values of the kinds that fields stand for."""


def _check_formats(template: str, what: str) -> None:
    """Raise InputError where a field asks for its value in a way that there is not, or without bound."""
    for _, name, form, conversion in string.Formatter().parse(template):
        if name is None:
            continue
        try:
            if not FORMAT.fullmatch(form or "") or conversion:
                raise ValueError
            format(EXAMPLES[name], form or "")
        except (ValueError, TypeError) as error:
            asked = name + (f"!{conversion}" if conversion else "") + (f":{form}" if form else "")
            raise InputError(
                f"{what} {template!r}: {{{asked}}} is no way to write {{{name}}}; "
                "write the name alone, or such as {i:03d} and {x:.6f}"
            ) from error


@dataclass(kw_only=True)
class Files:
    """Files whose names come from a pattern with {i} and {j}.

    `reference` knows the cameras that images answer for; `encoding` is what pictures mean.
    """

    pattern: str
    reference: Reference
    encoding: Encoding

    def __post_init__(self) -> None:
        self.name = self.pattern
        named = fields_of(self.pattern, ("i", "j"), "SOURCE")
        several = [
            axis for axis, count in zip("ij", self.reference.scene.plate.hogels, strict=True) if count > 1
        ]
        missing = [axis for axis in several if axis not in named]
        if missing:
            raise InputError(
                f"SOURCE {self.pattern!r} has no {{{missing[0]}}}: every hogel needs a file, such as "
                "'DIR/hogel_{i}x{j}.png', {i} the column and {j} the row"
            )

    def path(self, aperture: Aperture) -> Path:
        """Return the file of an aperture."""
        return Path(self.pattern.format(i=aperture.column, j=aperture.row))

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError where there are apertures, and none of their files exists."""
        if not apertures:  # such as those of an eye that sees no hogel
            return
        # On a plate of millions it is enough that some file has such a name.
        some = next(iglob(self._any_name()), None) is not None  # noqa: PTH207 - names are no paths of ours
        if some and len(apertures) <= MAX_NAMES_TRIED:
            some = any(self.path(aperture).exists() for aperture in apertures)
        if not some:
            first = self.path(apertures[0])
            raise InputError(
                f"SOURCE {self.pattern!r}: none of its files exists, such as {first}; check the pattern"
            )

    def _any_name(self) -> str:
        """Return the pattern for the shell that all names of the template match."""
        parsed = string.Formatter().parse(self.pattern)
        return "".join(escape(literal) + ("" if name is None else "*") for literal, name, _, _ in parsed)

    def image(self, aperture: Aperture) -> HogelImage:
        """Read the file of an aperture."""
        try:
            return read_foreign(self.path(aperture), self.reference.camera(aperture), self.encoding)
        except InputError as error:
            raise Problem(str(error)) from error


@dataclass(kw_only=True)
class Function:
    """A renderer in Python: a function that takes the scene and an aperture, and returns a hogel image."""

    function: Renderer
    reference: Reference

    def __post_init__(self) -> None:
        self.name = getattr(self.function, "__name__", type(self.function).__name__)

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Nothing is known before the first call."""

    def image(self, aperture: Aperture) -> HogelImage:
        """Call it, and see that what it returns is an image of the right size."""
        try:
            image = self.function(self.reference.scene, aperture)
        except Exception as error:
            # Whatever a stranger's code raises is a finding about that hogel.
            raise Problem(f"{self.name} raised {type(error).__name__}: {error}") from error
        if not isinstance(image, HogelImage):
            raise Problem(f"{self.name} returned {type(image).__name__}, not a HogelImage")
        width, height = self.reference.scene.frustum.resolution
        arrays = (image.triangle, image.object, image.position, image.color)
        if any(array is not None and array.shape[:2] != (height, width) for array in arrays):
            raise Problem(f"{self.name} returned an image that is not {width} x {height}")
        # The function is taken at its word about which aperture its image answers for. It may draw all hogels
        # into the same arrays, and the next one while this one is judged.
        return HogelImage(
            camera=self.reference.camera(aperture),
            triangle=image.triangle.copy(),
            object=image.object.copy(),
            position=image.position.copy(),
            color=None if image.color is None else image.color.copy(),
        )


MAX_TOLD_LINES = 5
"""Last lines of a failed command's standard error that are passed on."""

MAX_TOLD_BYTES = 1 << 16
"""Last bytes of its standard error that are looked at."""


@dataclass(kw_only=True)
class Command:
    """A program that is run once for each aperture, without a shell.

    Attributes
    ----------
    template
        Split as a shell would; {x} and {y} are the aperture's center in scene units, {i} and {j} its column
        and row, {out} the file to be written.
    folder, working
        Folder that {out} lies in, which is emptied file by file; and folder in which the program runs, None
        for that of this process.
    """

    template: str
    reference: Reference
    encoding: Encoding
    folder: Path
    timeout_s: float
    suffix: str = ".png"
    working: Path | None = None
    _arguments: list[str] = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.template
        named = fields_of(self.template, ("x", "y", "i", "j", "out"), "--command")
        if "out" not in named:
            raise InputError(
                f"--command {self.template!r} has no {{out}}: tell the renderer which file to write"
            )
        try:
            self._arguments = shlex.split(self.template)
        except ValueError as error:
            raise InputError(f"--command {self.template!r}: {error}; mind the quotes") from error

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Nothing is known before the first run."""

    def image(self, aperture: Aperture) -> HogelImage:
        """Run the program and read what it wrote."""
        out = self.folder / f"hogel_{aperture.column}x{aperture.row}{self.suffix}"
        values = {"x": float(aperture.x), "y": float(aperture.y), "i": aperture.column, "j": aperture.row}
        self._run([argument.format(**values, out=out) for argument in self._arguments])
        if not out.is_file():
            raise Problem("the command ended well, but wrote no file where {out} told it to")
        try:
            return read_foreign(out, self.reference.camera(aperture), self.encoding)
        except InputError as error:
            # The name of a file that nobody will find is no help.
            raise Problem(str(error).replace(str(out), "what the command wrote")) from error
        finally:
            out.unlink(missing_ok=True)

    def _run(self, arguments: list[str]) -> None:
        log = self.folder / "stderr"
        started: list[subprocess.Popen[bytes]] = []
        try:
            with delayed():  # a process that was started is noted before a signal is obeyed
                _start(arguments, self.working, log, started)
            status = started[0].wait(self.timeout_s)
        except subprocess.TimeoutExpired as error:
            raise Problem(
                f"the command ran longer than {self.timeout_s:g} s and was ended{_told(log)}"
            ) from error
        finally:
            with delayed():
                _end(started)
        if status:
            how = f"was ended by signal {-status}" if status < 0 else f"failed with exit status {status}"
            raise Problem(f"the command {how}{_told(log)}")


def _start(
    arguments: list[str], working: Path | None, log: Path, started: list[subprocess.Popen[bytes]]
) -> None:
    """Start a process and note it."""
    try:
        with log.open("wb") as told:
            # A session of its own, so that children of a hanging command end with it.
            process = subprocess.Popen(
                arguments,
                cwd=working,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=told,
                start_new_session=True,
            )
    except OSError as error:
        raise Problem(f"the command cannot be run: {arguments[0]}: {error.strerror}") from error
    started.append(process)


def _end(started: list[subprocess.Popen[bytes]]) -> None:
    """End processes and all that they started, if anything of it is left."""
    for process in started:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        finally:
            process.wait()


def _told(log: Path) -> str:
    """Return the last lines of a command's standard error, ready to be appended."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - MAX_TOLD_BYTES))
        lines = file.read().decode(errors="replace").strip().splitlines()[-MAX_TOLD_LINES:]
    return ": " + " | ".join(line.strip() for line in lines) if lines else ""


def state_of_files(paths: Iterable[str]) -> str:
    """Return a digest of the names, sizes and times of some files; those that do not exist are left out."""
    digest = hashlib.sha256()
    for path in paths:
        try:
            found = os.stat(path)  # noqa: PTH116 - a Path for each of millions of names takes as long again
        except (OSError, ValueError):
            continue
        digest.update(f"{path}\0{found.st_size}\0{found.st_mtime_ns}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def state_of_images(pattern: str, apertures: Iterable[Aperture]) -> str:
    """Return a digest of the image files of some hogels, named by a pattern with {i} and {j}."""
    return state_of_files(pattern.format(i=one.column, j=one.row) for one in apertures)


def state_of_command(template: str, folder: Path) -> str:
    """Return a digest of the program of a command, and of every file that its words name.

    Parameters
    ----------
    folder
        Folder in which it runs, where files with relative names lie.

    Raises
    ------
    ValueError
        The command's quotes do not match.
    """
    words = shlex.split(template)
    # A word may be a whole script, longer than any name of a file: `isfile` takes it for none.
    named = [str(path) for word in words if os.path.isfile(path := folder / word)]  # noqa: PTH113
    program = shutil.which(words[0]) if words and os.sep not in words[0] else None
    return state_of_files(dict.fromkeys(([program] if program else []) + named))


def require_same_command(template: str, found: str, state: str) -> None:
    """Raise InputError where a process finds another program than the command did: by digests of both."""
    if found != state:
        raise InputError(
            f"--command {template!r}: a worker finds another program, or other files that its words name; "
            "give all the same files by the same paths, and leave them as they are while hogels are judged"
        )


def require_same_images(pattern: str, found: str, state: str) -> None:
    """Raise InputError where a process finds other images than the command did: by digests of both."""
    if found != state:
        raise InputError(
            f"{pattern}: a worker finds other image files than the command; give both the same files, and "
            "leave them as they are while they are judged"
        )
