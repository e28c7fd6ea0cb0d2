"""Sources of a foreign renderer's images: files, a layout, a program, or a function."""

import hashlib
import os
import re
import shlex
import shutil
import signal
import string
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from glob import escape, iglob
from pathlib import Path
from typing import Any, Self

import numpy as np

from xfrustum.compare.judging.verdict import Hogel
from xfrustum.compare.renderer_model.conventions import ACCEPTABLE
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.interrupts import delayed
from xfrustum.reference import Reference
from xfrustum.reports.common.outputs import json_object
from xfrustum.reports.exchange.words import described
from xfrustum.scenes import NOTHING, Aperture, HogelImage, InputError, Plate, Scene
from xfrustum.scenes.arguments import check_program, choice, real
from xfrustum.scenes.disk.durable import TempPath, scratch_folder
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, of_stored, read_foreign
from xfrustum.scenes.files.layouts import LAYOUTS, PlateShape, layouts_named
from xfrustum.scenes.files.plate_files import FileSet, find_files, pictures_at
from xfrustum.scenes.representation import counted

MAX_NAMES_TRIED = 10_000
"""Files whose names are looked up singly before the work, to refuse a wrong pattern at once."""

MAX_LOG_LINES, MAX_LOG_BYTES = 5, 1 << 16
"""Last lines of a failed command's standard error that are reported, of its last bytes."""

#: a renderer in Python
Renderer = Callable[[Scene, Aperture], HogelImage]


class Problem(Exception):
    """Sentence about one missing hogel."""


@dataclass(kw_only=True, eq=False)
class Source:
    """Hogel images by aperture; `encoding` is the meaning of pictures."""

    reference: Reference
    encoding: Encoding = Encoding.RGB
    name: str = field(init=False)

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture, or raise Problem with the reason why there is none."""
        raise NotImplementedError

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError where it is plain beforehand that there will be no image at all."""


FORMAT = re.compile(r"0?\d{0,2}(\.\d{1,2})?[dfeg]?")
"""Format of a number after a colon, such as 04d or .3f: at most 99 characters."""

EXAMPLES: dict[str, object] = {"x": 0.5, "y": 0.5, "i": 1, "j": 1, "out": Path("x")}
"""Values of the kinds that fields stand for."""


def fields_of(template: str, allowed: Sequence[str], what: str) -> set[str]:
    """Return the fields of a template; InputError for unknown fields and formats."""
    try:
        parsed = [part[1:] for part in string.Formatter().parse(template) if part[1] is not None]
    except ValueError as error:
        raise InputError(f"{what} {template!r}: {error}; write {{{{ for a brace") from error
    names = {str(name) for name, _, _ in parsed}
    if unknown := sorted(names - set(allowed)):
        known = ", ".join(f"{{{name}}}" for name in allowed)
        raise InputError(f"{what} {template!r}: {{{unknown[0]}}} is not one of {known}")
    for name, form, conversion in parsed:
        try:
            if not FORMAT.fullmatch(form or "") or conversion:
                raise ValueError
            format(EXAMPLES.get(str(name), Path("x")), form or "")
        except (ValueError, TypeError) as error:
            stated = f"{name}{f'!{conversion}' if conversion else ''}{f':{form}' if form else ''}"
            raise InputError(
                f"{what} {template!r}: {{{stated}}} is no way to write {{{name}}}; "
                "write the name alone, or such as {i:03d} and {x:.6f}"
            ) from error
    return names


def named_as_given(hogel: Hogel, named_from: Path | None) -> Hogel:
    """Return a hogel whose problem names files as the user did, from a folder."""
    root = named_from is None or named_from == Path(named_from.anchor)
    if root or hogel.problem is None:
        return hogel
    # Not within a longer path, which names another folder.
    pattern = rf"(?<![\w./-]){re.escape(str(named_from))}/"
    return replace(hogel, problem=re.sub(pattern, "", hogel.problem))


@dataclass(kw_only=True, eq=False)
class Files(Source):
    """Files whose names come from a pattern with {i} and {j}."""

    pattern: str

    def __post_init__(self) -> None:
        self.name = self.pattern
        named = fields_of(self.pattern, ("i", "j"), "SOURCE")
        hogels = zip("ij", self.reference.scene.plate.hogels, strict=True)
        if missing := [axis for axis, count in hogels if count > 1 and axis not in named]:
            what = (
                f"has no {{{missing[0]}}}"
                if named or Path(self.pattern).exists()
                else "does not exist"
            )
            raise InputError(
                f"SOURCE {self.pattern!r} {what}: give a folder, or files of every hogel, such as "
                "'DIR/hogel_{i}x{j}.png', {i} the column and {j} the row"
            )

    def path(self, aperture: Aperture) -> Path:
        """Return the file of an aperture."""
        return Path(self.pattern.format(i=aperture.column, j=aperture.row))

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError where there are apertures, and none of their files exists."""
        # As for an eye that sees no hogel.
        if not apertures:
            return
        parsed = string.Formatter().parse(self.pattern)
        any_name = "".join(
            escape(literal) + ("" if name is None else "*") for literal, name, _, _ in parsed
        )
        # On a plate of millions it is enough that some file has such a name.
        some = next(iglob(any_name), None) is not None  # noqa: PTH207 - names are no paths of ours
        if some and len(apertures) <= MAX_NAMES_TRIED:
            some = any(self.path(aperture).exists() for aperture in apertures)
        if not some:
            first = self.path(apertures[0])
            raise InputError(
                f"SOURCE {self.pattern!r}: none of its files exists, such as {first}; check the "
                "pattern"
            )

    def image(self, aperture: Aperture) -> HogelImage:
        """Read the file of an aperture."""
        try:
            return read_foreign(self.path(aperture), self.reference.camera(aperture), self.encoding)
        except InputError as error:
            raise Problem(str(error)) from error


def shape_of(scene: Scene) -> PlateShape:
    """Return the numbers of hogels and pixels of a scene."""
    return PlateShape(hogels=scene.plate.hogels, resolution=scene.frustum.resolution)


def is_place(source: str, plate: Plate) -> bool:
    """Return whether a source names a folder, or one picture of a plate of several hogels."""
    # A string that is invalid as a file name may still be a pattern.
    with suppress(OSError, ValueError):
        return Path(source).is_dir() or (plate.hogels != (1, 1) and Path(source).is_file())
    return False


@dataclass(kw_only=True, eq=False)
class LaidOut(Source):
    """Files in a layout."""

    files: FileSet

    def __post_init__(self) -> None:
        self.name = f"{self.files.place}, layout {described(self.files)}"
        self.fits = self.files.shape == shape_of(self.reference.scene)

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError where there is a file for none of the hogels."""
        known = self.files.layout.in_hogels and self.fits
        if known and not any(self.files.file_of_hogel(*aperture.index) for aperture in apertures):
            raise InputError(
                f"SOURCE {self.files.place}: has no file of the hogels that are asked for"
            )

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture, upright by its layout, with all OpenEXR channels."""
        files, layout, camera = self.files, self.files.layout, self.reference.camera(aperture)
        if not self.fits:
            lacking = f" ({files.missing} are not there)" if files.missing else ""
            raise Problem(
                f"read as {layout.name}, the {counted(len(files.files), 'file')} would be "
                f"{files.shape}"
                f"{lacking}, and the scene says {shape_of(self.reference.scene)}"
            )
        try:
            path = files.file_of_hogel(*aperture.index)
            if path is not None and path.suffix.lower() == ".exr":
                image = read_foreign(path, camera, self.encoding)
                names = ("triangle", "object", "position", "normal", "color", "uncertainty")
                stored = {name: getattr(image, name) for name in names} if layout.turned else {}
                turned = {
                    name: array[::-1, ::-1] for name, array in stored.items() if array is not None
                }
                return replace(image, **turned)
            picture = files.hogel(*aperture.index)
        except InputError as error:
            raise Problem(str(error)) from error
        # Nothing but colors.
        if picture.pixels.dtype.kind == "f":
            color = picture.pixels.astype(np.float32)
            nothing = np.full(color.shape[:2], NOTHING, dtype=np.int32)
            position = np.full(color.shape, np.nan, dtype=np.float32)
            storage = f"{picture.lossy}, lossy" if picture.lossy else None
            return HogelImage(
                camera=camera,
                triangle=nothing,
                object=nothing,
                position=position,
                color=color,
                storage=storage,
            )
        rgb = StoredPixels(rgb=picture.pixels, lossy=picture.lossy)
        return of_stored(rgb, camera, self.encoding)


@dataclass(kw_only=True, eq=False)
class Function(Source):
    """A renderer in Python: a function of scene and aperture that returns a hogel image."""

    function: Renderer

    def __post_init__(self) -> None:
        self.name = getattr(self.function, "__name__", type(self.function).__name__)

    def image(self, aperture: Aperture) -> HogelImage:
        """Call the function, and check that it returns an image of the right size."""
        try:
            image = self.function(self.reference.scene, aperture)
        except Exception as error:
            # Whatever a stranger's code raises is a finding about that hogel.
            raise Problem(f"{self.name} raised {type(error).__name__}: {error}") from error
        if not isinstance(image, HogelImage):
            raise Problem(f"{self.name} returned {type(image).__name__}, not a HogelImage")
        # A wrong size would otherwise broadcast, or fail far from its cause.
        width, height = self.reference.scene.frustum.resolution
        arrays = (image.triangle, image.object, image.position, image.color)
        if any(array is not None and array.shape[:2] != (height, width) for array in arrays):
            raise Problem(f"{self.name} returned an image that is not {width} x {height}")
        # The function is taken at its word about which aperture its image answers for. It may draw
        # all hogels into the same arrays, and the next one while this one is judged.
        copies = {name: getattr(image, name).copy() for name in ("triangle", "object", "position")}
        color = None if image.color is None else image.color.copy()
        return HogelImage(camera=self.reference.camera(aperture), color=color, **copies)


def run_program(arguments: list[str], folder: Path, timeout_s: float, working: Path | None) -> None:
    """Run a program to its end, its standard error in a folder, and end all that it started.

    Raises Problem where it cannot be run, fails, or takes longer.
    """
    log, process = folder / "stderr", None

    def last_lines() -> str:
        with log.open("rb") as file:
            # A looping renderer may write gigabytes: only the end is read.
            file.seek(max(0, log.stat().st_size - MAX_LOG_BYTES))
            lines = file.read().decode(errors="replace").strip().splitlines()[-MAX_LOG_LINES:]
        return ": " + " | ".join(line.strip() for line in lines) if lines else ""

    try:
        # A process that was started is noted before a signal is obeyed. It has a session of its
        # own, so that children of a hanging command end with it.
        with delayed(), log.open("wb") as stderr:
            process = subprocess.Popen(
                arguments,
                cwd=working,
                # A renderer that waits for input would hang until the timeout.
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                start_new_session=True,
            )
        status = process.wait(timeout_s)
    except OSError as error:
        raise Problem(f"the command cannot be run: {arguments[0]}: {error.strerror}") from error
    except subprocess.TimeoutExpired as error:
        how = f"ran longer than {timeout_s:g} s and was ended"
        raise Problem(f"the command {how}{last_lines()}") from error
    finally:
        if process is not None:
            with delayed():
                with suppress(ProcessLookupError):
                    # The whole session ends, also after success: background children keep files
                    # open.
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    if status:
        how = (
            f"was ended by signal {-status}" if status < 0 else f"failed with exit status {status}"
        )
        raise Problem(f"the command {how}{last_lines()}")


@dataclass(kw_only=True, eq=False)
class Command(Source):
    """A program that runs once per aperture, without a shell; words split as by a shell."""

    template: (
        str  #: {x}, {y}: the aperture's center, scene units; {i}, {j}: column, row; {out}: the file
    )
    #: that {out} lies in
    folder: Path
    timeout_s: float
    suffix: str = ".png"
    #: in which the program runs; None: this process's
    working: Path | None = None

    def __post_init__(self) -> None:
        self.name = self.template
        if "out" not in fields_of(self.template, tuple(EXAMPLES), "--command"):
            raise InputError(
                f"--command {self.template!r} has no {{out}}: tell the renderer which file to write"
            )
        check_program(self.template, self.working)
        # Split before the substitution: blanks and quotes in paths stay within one argument.
        self._arguments = shlex.split(self.template)

    def image(self, aperture: Aperture) -> HogelImage:
        """Run the program and read its file."""
        out = self.folder / f"hogel_{aperture.column}x{aperture.row}{self.suffix}"
        values = {
            "x": float(aperture.x),
            "y": float(aperture.y),
            "i": aperture.column,
            "j": aperture.row,
        }
        arguments = [argument.format(**values, out=out) for argument in self._arguments]
        run_program(arguments, self.folder, self.timeout_s, self.working)
        # An exit status of zero alone proves no image.
        if not out.is_file():
            raise Problem("the command ended well, but wrote no file where {out} told it to")
        try:
            return read_foreign(out, self.reference.camera(aperture), self.encoding)
        except InputError as error:
            # The name of a temporary file is no help.
            raise Problem(str(error).replace(str(out), "what the command wrote")) from error
        finally:
            # The next hogel must not pass with an old file.
            out.unlink(missing_ok=True)


@dataclass(frozen=True, kw_only=True)
class ForeignRenderer:
    """Origin of a renderer's images, and its author's statements; see `VerifyOptions`."""

    source: str | Renderer | None = None
    command: str | None = None
    encoding: Encoding | str | None = None
    near: float | None = None
    accept: tuple[str, ...] = ()
    timeout_s: float = 60.0
    #: in which a command runs; None: the process's
    folder: Path | None = None
    named_from: Path | None = (
        None  #: folder from which the user named the files of an absolute `source`
    )
    #: of folders and pictures
    layout: str | None = None

    def nominal(self, scene: Scene) -> RendererModel:
        """Return the model by the author's statements; InputError for impossible ones."""
        if strange := [name for name in self.accept if name not in ACCEPTABLE]:
            raise InputError(f"accept: {strange[0]!r} is not one of {', '.join(ACCEPTABLE)}")
        reach = scene.frustum.longest_reach
        if self.near is not None and not 0 <= real(self.near) < reach:
            raise InputError(
                f"near {self.near} must be at least 0 and smaller than the reach, {reach}"
            )
        return RendererModel(near=real(self.near or 0.0))

    @contextmanager
    def opened(self, reference: Reference) -> Iterator[Source]:
        """Open the source of images, with a scratch folder for a command."""
        source, command = self.source, self.command
        # Exactly one of both.
        if (source is None) == (command is None):
            raise InputError(
                "give either SOURCE, a pattern of files with {i} and {j}, or --command"
            )
        if self.layout is not None and not isinstance(source, str):
            raise InputError("layout is that of files; name their folder as SOURCE")
        meant = (
            Encoding.RGB if self.encoding is None else choice(Encoding, self.encoding, "encoding")
        )
        if command is not None:
            if not real(self.timeout_s) > 0:
                raise InputError(f"timeout must be positive, not {self.timeout_s}")
            with TempPath(scratch_folder(), folder=True) as aside:
                yield Command(
                    template=command,
                    reference=reference,
                    encoding=meant,
                    folder=aside.path,
                    timeout_s=self.timeout_s,
                    suffix=".exr" if self.encoding is None else ".png",
                    working=self.folder,
                )
        elif not isinstance(source, str):
            assert source is not None
            yield Function(function=source, reference=reference)
        elif self.layout is not None or is_place(source, reference.scene.plate):
            layouts = LAYOUTS if self.layout is None else layouts_named(self.layout)
            files = find_files(Path(source), shape_of(reference.scene), layouts)
            yield LaidOut(files=files, reference=reference, encoding=meant)
        else:
            yield Files(pattern=source, reference=reference, encoding=meant)

    # Several processes may have other working folders than the command.

    def placed(self, scene: Scene) -> Self:
        """Return the renderer with absolute file names, or the folder of its command."""
        here = Path.cwd()
        if self.command is not None:
            return self if self.folder is not None else replace(self, folder=here)
        assert isinstance(self.source, str)
        named = self.layout is not None or is_place(self.source, scene.plate)
        # In the folder's part of a pattern, braces are no fields.
        folder = str(here) if named else str(here).replace("{", "{{").replace("}", "}}")
        named_from = None if Path(self.source).is_absolute() else here
        return replace(self, source=str(Path(folder) / self.source), named_from=named_from)

    @property
    def description(self) -> dict[str, Any]:
        """Description of a placed renderer, independent of the folder of its names."""
        return {name: value for name, value in json_object(self).items() if name != "named_from"}

    def state(self, apertures: Sequence[Aperture]) -> str:
        """Return a digest of names, sizes and times of the files that its images depend on.

        For a command: its program, and every file that its words name.
        """
        if self.command is not None:
            words, folder = shlex.split(self.command), self.folder or Path.cwd()
            program = shutil.which(words[0]) if words and os.sep not in words[0] else None
            # A word may be a whole script, longer than any name of a file.
            isfile = os.path.isfile
            named = [str(file) for word in words if isfile(file := folder / word)]
            paths = iter(dict.fromkeys(([program] if program else []) + named))
        else:
            assert isinstance(self.source, str)
            pattern, place = self.source, Path(self.source)
            if self.layout is None:
                paths = (
                    pattern.format(i=aperture.column, j=aperture.row) for aperture in apertures
                )
            else:
                paths = map(str, pictures_at(place))
        digest = hashlib.sha256()
        for path in paths:
            with suppress(OSError, ValueError):
                status = os.stat(path)  # noqa: PTH116 - faster than Path for millions of names
                line = f"{path}\0{status.st_size}\0{status.st_mtime_ns}\n"
                digest.update(line.encode(errors="surrogateescape"))
        return digest.hexdigest()

    def require_state(self, apertures: Sequence[Aperture], state: str) -> None:
        """Raise InputError where this process finds other files than the command did."""
        if self.folder is not None and not self.folder.is_dir():
            raise InputError(
                f"--command {self.command!r}: there is no folder {self.folder}, in which it is "
                "to run; start "
                "it from one that the command and all workers share"
            )
        if self.state(apertures) != state:
            name = self.source if self.command is None else f"--command {self.command!r}"
            raise InputError(
                f"{name}: a worker finds other image files than the command, or another program; "
                "give all "
                "the same files by the same paths, and leave them as they are while hogels are "
                "judged"
            )
