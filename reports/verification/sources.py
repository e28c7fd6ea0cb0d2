"""Sources of a foreign renderer's images: files, a layout, Zarr, a program, or a function."""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import shutil
import signal
import string
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from glob import escape, iglob
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.rounding.causes import DirectionPlate
from xfrustum.process import delayed
from xfrustum.reference import Reference
from xfrustum.reports.exchange.convert import GroupPlate, PlateArray, described, open_plate
from xfrustum.reports.plate.arrays import METADATA
from xfrustum.reports.plate.store import checked_group, direction_plate
from xfrustum.reports.verification.request import Renderer, Request
from xfrustum.scenes import NOTHING, Aperture, HogelImage, InputError, Plate, Scene
from xfrustum.scenes.arguments import check_program
from xfrustum.scenes.disk import TempPath, scratch_folder
from xfrustum.scenes.files.layouts import LAYOUTS, PlateShape, layouts_named
from xfrustum.scenes.files.pictures import Encoding, StoredPixels, of_stored, read_foreign
from xfrustum.scenes.files.plate_files import FileSet, find_files
from xfrustum.scenes.representation import counted

MAX_NAMES_TRIED = 10_000
"""Largest number of files that are looked up by name before the work starts."""

MAX_LOG_LINES, MAX_LOG_BYTES = 5, 1 << 16
"""Number of last lines of a failed command's standard error in a report, and bytes read for
them."""

FORMAT = re.compile(r"0?\d{0,2}(\.\d{1,2})?[dfeg]?")
"""Format of a number after a colon, such as 04d or .3f: at most 99 characters wide."""

EXAMPLES: dict[str, object] = {"x": 0.5, "y": 0.5, "i": 1, "j": 1, "out": Path("x")}
"""Example values of fields, to test formats."""


class Problem(Exception):
    """Reason why a hogel is missing."""


def fields_of(template: str, allowed: Sequence[str], what: str) -> set[str]:
    """Return the fields of a template; InputError for unknown fields and formats."""
    try:
        parts = list(string.Formatter().parse(template))
    except ValueError as error:
        raise InputError(f"{what} {template!r}: {error}; write {{{{ for a brace") from error
    parsed = [(name, form or "", kind) for _, name, form, kind in parts if name is not None]
    for name, form, conversion in parsed:
        if name not in allowed:
            known = ", ".join(f"{{{known}}}" for known in allowed)
            raise InputError(f"{what} {template!r}: {{{name}}} is not one of {known}")
        try:
            if not FORMAT.fullmatch(form) or conversion:
                raise ValueError
            format(EXAMPLES.get(name, Path("x")), form)
        except (ValueError, TypeError) as error:
            stated = f"{name}!{conversion}" if conversion else f"{name}:{form}"
            raise InputError(
                f"{what} {template!r}: {{{stated}}} is no way to write {{{name}}}; "
                "write the name alone, or such as {i:03d} and {x:.6f}"
            ) from error
    return {name for name, _, _ in parsed}


@dataclass(kw_only=True, eq=False)
class Source:
    """Hogel images by aperture; `encoding` is the meaning of pixel values in pictures."""

    reference: Reference
    encoding: Encoding = Encoding.RGB
    name: str = field(init=False)

    @property
    def of_views(self) -> bool:
        """True if hogels are assembled from views."""
        return False

    @cached_property
    def directions(self) -> DirectionPlate | None:
        """Plate drawn by `plate --by directions`; None for other images."""
        return None

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture; raise Problem if there is none."""
        raise NotImplementedError

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError if there is certainly no image."""

    def read(self, path: Path, aperture: Aperture, name: str) -> HogelImage:
        """Read a file; raise Problem with the given name of the file."""
        try:
            return read_foreign(path, self.reference.camera(aperture), self.encoding)
        except InputError as error:
            raise Problem(str(error).replace(str(path), name)) from error


@dataclass(kw_only=True, eq=False)
class Files(Source):
    """Files whose names come from a pattern with {i} and {j}."""

    pattern: str
    #: folder for relative names; None: the current folder
    folder: Path | None = None

    def __post_init__(self) -> None:
        self.name = self.pattern
        named = fields_of(self.pattern, ("i", "j"), "SOURCE")
        hogels = zip("ij", self.reference.scene.plate.hogels, strict=True)
        if missing := [axis for axis, count in hogels if count > 1 and axis not in named]:
            exists = named or Path(self.pattern).exists()
            what = f"has no {{{missing[0]}}}" if exists else "does not exist"
            raise InputError(
                f"SOURCE {self.pattern!r} {what}: give a folder, or files of every hogel, such as "
                "'DIR/hogel_{i}x{j}.png', {i} the column and {j} the row"
            )

    def named(self, aperture: Aperture) -> str:
        """Return the file name of an aperture as the user wrote it."""
        return str(Path(self.pattern.format(i=aperture.column, j=aperture.row)))

    def path(self, aperture: Aperture) -> Path:
        """Return the file of an aperture."""
        return Path(self.folder or "", self.named(aperture))

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError if none of the files of the apertures exists."""
        # `view` passes no apertures for an eye that sees no hogel.
        if not apertures:
            return
        parsed = string.Formatter().parse(self.pattern)
        any_name = "".join(
            escape(text) + ("" if name is None else "*") for text, name, *_ in parsed
        )
        # For plates of millions of hogels test only that some file matches the pattern.
        some = next(iglob(any_name), None) is not None  # noqa: PTH207 - names are no paths of ours
        if some and len(apertures) <= MAX_NAMES_TRIED:
            some = any(self.path(aperture).exists() for aperture in apertures)
        if not some:
            raise InputError(
                f"SOURCE {self.pattern!r}: none of its files exists, such as "
                f"{self.path(apertures[0])}; check the pattern"
            )

    def image(self, aperture: Aperture) -> HogelImage:
        """Read the file of an aperture."""
        return self.read(self.path(aperture), aperture, self.named(aperture))


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

    @property
    def of_views(self) -> bool:
        """True if hogels are assembled from views."""
        return not self.files.layout.in_hogels

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError if none of the hogels has a file."""
        known = not self.of_views and self.fits
        if known and not any(self.files.file_of_hogel(*aperture.index) for aperture in apertures):
            raise InputError(
                f"SOURCE {self.files.place}: has no file of the hogels that are asked for"
            )

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture, turned upright, with all OpenEXR channels."""
        files, camera = self.files, self.reference.camera(aperture)
        if not self.fits:
            lacking = f" ({files.missing} are not there)" if files.missing else ""
            raise Problem(
                f"read as {files.layout.name}, the {counted(len(files.files), 'file')} would be "
                f"{files.shape}{lacking}, and the scene says {shape_of(self.reference.scene)}"
            )
        try:
            path = files.file_of_hogel(*aperture.index)
            if path is not None and path.suffix.lower() == ".exr":
                image = self.read(path, aperture, str(path))
                arrays = vars(image) if files.layout.turned else {}
                turned: dict[str, Any] = {
                    name: array[::-1, ::-1]
                    for name, array in arrays.items()
                    if isinstance(array, np.ndarray)
                }
                return replace(image, **turned)
            picture = files.hogel(*aperture.index)
        except InputError as error:
            raise Problem(str(error)) from error
        pixels = picture.pixels
        if pixels.dtype.kind != "f":
            stored = StoredPixels(rgb=pixels, lossy=picture.lossy)
            return of_stored(stored, camera, self.encoding)
        # The image has only colors.
        nothing = np.full(pixels.shape[:2], NOTHING, dtype=np.int32)
        return HogelImage(
            camera=camera,
            triangle=nothing,
            object=nothing,
            position=np.full(pixels.shape, np.nan, dtype=np.float32),
            color=pixels.astype(np.float32),
            storage=f"{picture.lossy}, lossy" if picture.lossy else None,
        )


@dataclass(kw_only=True, eq=False)
class StoredPlate(Source):
    """A plate in a Zarr group: triangle numbers, colors, or both, by the encoding.

    By default 8-bit colors are not judged if there are triangle numbers, because 8-bit colors are
    clipped at 1 and true colors are not.
    """

    place: Path
    stated: bool  #: encoding stated by the user

    def __post_init__(self) -> None:
        group = checked_group(self.place)
        plates = {name: open_plate(self.place, name) for name in PlateArray if name in group}
        numbers, colors = plates.get(PlateArray.TRIANGLE), plates.get(PlateArray.COLOR)
        levels = None if colors is None or colors.rows.floating else colors
        if not self.stated:
            needs = "array color or triangle"
            colors = None if numbers is not None and levels is not None else colors
        elif self.encoding is Encoding.TRIANGLE_ID:
            needs = "array triangle, or color of type uint8"
            colors = levels if numbers is None else None
        elif self.encoding is Encoding.OBJECT_ID:
            needs, numbers, colors = "array color of type uint8", None, levels
        else:
            needs, numbers = "array color", None
        if numbers is None and colors is None:
            cause = f", which --encoding {self.encoding} needs" if self.stated else ""
            raise InputError(f"SOURCE {self.place}: has no {needs}{cause}")
        self._numbers, self._colors = numbers, colors
        expected = shape_of(self.reference.scene)
        judged = {"triangle": numbers, "color": colors}
        for plate in filter(None, judged.values()):
            if plate.rows.shape != expected:
                raise InputError(
                    f"SOURCE {self.place}: holds {plate.rows.shape}, and the scene says {expected}"
                )
        arrays = " and ".join(name for name, plate in judged.items() if plate is not None)
        self.name = f"{self.place}, array {arrays}"

    @cached_property
    def directions(self) -> DirectionPlate | None:
        """Plate with its depth buffer and tiles, if it was drawn by directions."""
        return direction_plate(self.place)

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture from the judged arrays."""
        colors, numbers = (
            None if plate is None else self._read(plate, aperture)
            for plate in (self._colors, self._numbers)
        )
        camera = self.reference.camera(aperture)
        if colors is not None and colors.dtype == np.uint8:
            return of_stored(StoredPixels(rgb=colors), camera, self.encoding)
        shape = camera.resolution[::-1]
        nothing = np.full(shape, NOTHING, dtype=np.int32)
        # Clip numbers to 32 bits: the largest number is not a triangle of any scene.
        limits = np.iinfo(np.int32)
        triangle = nothing if numbers is None else np.clip(numbers, limits.min, limits.max)
        return HogelImage(
            camera=camera,
            triangle=triangle.astype(np.int32),
            object=nothing,
            position=np.full((*shape, 3), np.nan, dtype=np.float32),
            color=None if colors is None else colors.astype(np.float32),
        )

    def _read(self, plate: GroupPlate, aperture: Aperture) -> NDArray[Any]:
        try:
            image = plate.hogel(*aperture.index)
        except InputError as error:
            raise Problem(str(error)) from error
        if image is None:
            raise Problem(f"{self.place}: hogel {aperture.column},{aperture.row} was never drawn")
        return image


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
            # Any exception of the renderer's code is a problem of this hogel.
            raise Problem(f"{self.name} raised {type(error).__name__}: {error}") from error
        if not isinstance(image, HogelImage):
            raise Problem(f"{self.name} returned {type(image).__name__}, not a HogelImage")
        # Arrays of a wrong size would broadcast, or fail far from the cause. Copy the arrays: the
        # function may draw the next hogel into the same arrays while this hogel is judged.
        width, height = self.reference.scene.frustum.resolution
        names = ("triangle", "object", "position", "color")
        arrays: dict[str, Any] = {
            name: array.copy() for name in names if (array := getattr(image, name)) is not None
        }
        if any(array.shape[:2] != (height, width) for array in arrays.values()):
            raise Problem(f"{self.name} returned an image that is not {width} x {height}")
        # Use the camera of the aperture that was passed to the function, not the image's camera.
        return HogelImage(camera=self.reference.camera(aperture), **arrays)


def run_program(arguments: list[str], folder: Path, timeout_s: float, working: Path | None) -> None:
    """Run a program, log its standard error in a folder, and end all processes that it started.

    Raises Problem if the program cannot be run, fails, or exceeds the time limit.
    """
    log, process = folder / "stderr", None

    def last_lines() -> str:
        with log.open("rb") as file:
            # A looping renderer may write gigabytes: read only the end.
            file.seek(max(0, log.stat().st_size - MAX_LOG_BYTES))
            lines = file.read().decode(errors="replace").strip().splitlines()[-MAX_LOG_LINES:]
        return ": " + " | ".join(line.strip() for line in lines) if lines else ""

    try:
        # Delay signals until the process is recorded. Start it in a new session, so that all
        # children of a hanging command can be ended.
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
                    # End the session also after success: background children keep files open.
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    if status:
        how = (
            f"was ended by signal {-status}" if status < 0 else f"failed with exit status {status}"
        )
        raise Problem(f"the command {how}{last_lines()}")


@dataclass(kw_only=True, eq=False)
class Command(Source):
    """A program that runs once per aperture, without a shell; words are split as by a shell."""

    #: {x}, {y}: the aperture's center, scene units; {i}, {j}: column, row; {out}: the file
    template: str
    #: folder that contains {out}
    folder: Path
    timeout_s: float
    suffix: str = ".png"
    #: folder in which the program runs; None: this process's
    working: Path | None = None

    def __post_init__(self) -> None:
        self.name = self.template
        if "out" not in fields_of(self.template, tuple(EXAMPLES), "--command"):
            raise InputError(
                f"--command {self.template!r} has no {{out}}: tell the renderer which file to write"
            )
        check_program(self.template, self.working)

    def image(self, aperture: Aperture) -> HogelImage:
        """Run the program and read its file."""
        out = self.folder / f"hogel_{aperture.column}x{aperture.row}{self.suffix}"
        values = {"i": aperture.column, "j": aperture.row, "out": out}
        values |= {"x": float(aperture.x), "y": float(aperture.y)}
        # Split before the substitution: blanks and quotes in paths stay within one argument.
        arguments = [word.format(**values) for word in shlex.split(self.template)]
        run_program(arguments, self.folder, self.timeout_s, self.working)
        # Exit status 0 does not prove that there is an image.
        if not out.is_file():
            raise Problem("the command ended well, but wrote no file where {out} told it to")
        try:
            # The name of a temporary file would not help the user.
            return self.read(out, aperture, "what the command wrote")
        finally:
            # Delete the file, so that it cannot count as the next hogel.
            out.unlink(missing_ok=True)


@contextmanager
def opened(request: Request, reference: Reference) -> Iterator[Source]:
    """Open the source of a request's images, with a scratch folder for a command."""
    source, options = request.source, request.options
    common: dict[str, Any] = {"reference": reference, "encoding": request.encoding}
    if options.command is not None:
        with TempPath(scratch_folder(), folder=True) as scratch:
            yield Command(
                template=options.command,
                folder=scratch.path,
                timeout_s=options.timeout_s,
                suffix=".exr" if options.encoding is None else ".png",
                working=request.folder,
                **common,
            )
    elif not isinstance(source, str):
        assert source is not None
        yield Function(function=source, **common)
    elif options.layout is None and _is_group(Path(source)):
        stated = options.encoding is not None
        plate = StoredPlate(place=Path(source), stated=stated, **common)
        if plate.directions is not None and options.near:
            raise InputError(
                f"--near {options.near:g}: SOURCE {source} was drawn by directions, without a near "
                "offset; leave out --near"
            )
        yield plate
    elif options.layout is not None or is_place(source, request.scene.plate):
        layouts = LAYOUTS if options.layout is None else layouts_named(options.layout)
        files = find_files(Path(source), shape_of(request.scene), layouts)
        yield LaidOut(files=files, **common)
    else:
        yield Files(pattern=source, folder=request.folder, **common)


def state_of(request: Request) -> str:
    """Return a digest of names, sizes and times of the image files.

    For a command, the files are its program and every file that its arguments name.
    """
    folder, command = request.folder or Path.cwd(), request.options.command
    paths: Iterator[str]
    if command is not None:
        words = shlex.split(command)
        program = shutil.which(words[0]) if words and os.sep not in words[0] else None
        # An argument may be a whole script, longer than any file name.
        is_file = os.path.isfile
        named = [str(folder / word) for word in words if is_file(folder / word)]
        paths = iter(dict.fromkeys(([program] if program else []) + named))
    else:
        # A growing sample may reach the whole plate.
        grows = request.looks > 1
        apertures = request.scene.plate.apertures() if grows else request.apertures
        pattern = str(request.source)
        names = (pattern.format(i=aperture.column, j=aperture.row) for aperture in apertures)
        paths = (os.path.join(folder, name) for name in names)  # noqa: PTH118 - faster than Path
    digest = hashlib.sha256()
    for path in paths:
        with suppress(OSError, ValueError):
            status = os.stat(path)  # noqa: PTH116 - faster than Path for millions of names
            line = f"{path}\0{status.st_size}\0{status.st_mtime_ns}\n"
            digest.update(line.encode(errors="surrogateescape"))
    return digest.hexdigest()


def require_state(request: Request, state: str) -> None:
    """Raise InputError if a worker's image files differ from the files that the command read."""
    command, folder = request.options.command, request.folder
    name = request.source if command is None else f"--command {command!r}"
    # Absolute names need no folder.
    needed = command is not None or not Path(str(request.source)).is_absolute()
    if needed and folder is not None and not folder.is_dir():
        raise InputError(
            f"{name}: there is no folder {folder} here; start it from one that the command and "
            "all workers share"
        )
    if state_of(request) != state:
        raise InputError(
            f"{name}: a worker finds other image files than the command, or another program; "
            "give all the same files by the same paths, and leave them as they are while hogels "
            "are judged"
        )


def _is_group(place: Path) -> bool:
    """Return whether a folder is a Zarr group; False for names too long for a file."""
    with suppress(OSError):
        return (place / METADATA).is_file()
    return False
