"""Where a foreign renderer's hogel images come from: files, or a function.

The third kind, a command, is `xfrustum.reports.verification.commands`.
"""

from __future__ import annotations

import re
import string
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from glob import escape, iglob
from pathlib import Path
from typing import Protocol

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
    text
        Text in which names of files are absolute.
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

    Attributes
    ----------
    pattern
        {i} is the column, {j} the row.
    reference
        Truth of the scene, which knows the cameras that images answer for.
    encoding
        What pictures mean; OpenEXR files say it themselves.
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
        """Raise InputError where none of the files exists."""
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
    """A renderer in Python.

    Attributes
    ----------
    function
        Takes the scene and an aperture, returns a hogel image.
    reference
        Truth of the scene.
    """

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
        return _answering(_copied(image), self.reference, aperture)


def _copied(image: HogelImage) -> HogelImage:
    """Return an image with surfaces and colors of its own."""
    return replace(
        image,
        triangle=image.triangle.copy(),
        object=image.object.copy(),
        position=image.position.copy(),
        color=None if image.color is None else image.color.copy(),
    )


def _answering(image: HogelImage, reference: Reference, aperture: Aperture) -> HogelImage:
    return HogelImage(
        camera=reference.camera(aperture),
        triangle=image.triangle,
        object=image.object,
        position=image.position,
        color=image.color,
    )
