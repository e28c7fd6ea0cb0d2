"""Textures of material libraries of OBJ (.mtl); the scene file has colors and lights."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.meshes.text_lines import join_continued, plain_text
from xfrustum.scenes.meshes.textures import file_beside, open_picture
from xfrustum.scenes.model.scene import UnreadFeature

#: Statements that show a surface in another color, or not at all, and the value that changes
#: nothing.
_NEUTRAL: Final = {"kd": 1.0, "d": 1.0, "tr": 0.0}
_MAPS: Final = ("bump", "disp", "decal", "refl", "norm")  # beside all whose names begin with map_


@dataclass(kw_only=True)
class MaterialTexture:
    """Base color texture of one material."""

    texture: str | None = None  #: name of the texture
    picture: Any = None  #: Pillow image, opened and not yet decoded
    not_honoured: list[str] = field(default_factory=list)  #: other statements


def read_libraries(
    path: Path, statements: Sequence[str], used: set[str]
) -> tuple[dict[str, MaterialTexture], list[UnreadFeature]]:
    """Return textures by material, the first of a name, and features not honoured.

    Parameters
    ----------
    path : OBJ file
    statements : names of libraries, as each `mtllib` statement lists them
    used : names of materials of which something is not honoured
    """
    looks: dict[str, MaterialTexture] = {}
    unread: list[UnreadFeature] = []
    for statement in dict.fromkeys(statements):
        whole = _content(path, statement)
        for name in [statement] if whole is not None else statement.partition("#")[0].split():
            library = _content(path, name)
            if library is None:
                lost = "is missing or cannot be read; textures that it may name are not shown"
                unread.append(UnreadFeature(feature=f"material library {name}", consequence=lost))
                continue
            for material, look in _library(path, library).items():
                looks.setdefault(material, look)
    for name in sorted(used - looks.keys() - {""}):
        plain = name.partition("#")[0].strip()  # a comment, or part of a name
        if plain in looks:
            looks[name] = looks[plain]
        elif looks:
            lost = "is in no library; its surfaces are drawn without it"
            unread.append(UnreadFeature(feature=f"material {name}", consequence=lost))
    others = dict.fromkeys(
        word for name in used if name in looks for word in looks[name].not_honoured
    )
    if others:
        consequence = "are not applied: colors and lights are those of the scene file"
        listed = ", ".join(sorted(others))
        unread.append(
            UnreadFeature(feature=f"statements {listed} of materials", consequence=consequence)
        )
    return {name: look for name, look in looks.items() if name in used}, unread


def _content(path: Path, name: str) -> bytes | None:
    """Return the content of a library beside an OBJ file; None where it cannot be read."""
    with suppress(InputError):
        library = file_beside(path, name)
        return None if library is None else read_input(library, "material library")
    return None


def _library(path: Path, library: bytes) -> dict[str, MaterialTexture]:
    looks: dict[str, MaterialTexture] = {}
    look = MaterialTexture()
    text = join_continued(plain_text(library)).decode("utf-8", "replace")
    for line in text.split("\n"):
        words = line.split()
        key, values = (words[0].lower(), words[1:]) if words else ("", [])
        if key == "newmtl":
            look = looks.setdefault(" ".join(values), MaterialTexture())
        elif key == "map_kd" and values:
            options, skipped = _options(values)
            look.texture = line.split(None, 1 + skipped)[-1].strip()
            look.picture = open_picture(path, look.texture)
            look.not_honoured += [f"map_Kd {option}" for option in options]
        elif (
            key.startswith("map_")
            or key in _MAPS
            or (key in _NEUTRAL and not all(_is(value, _NEUTRAL[key]) for value in values))
        ):
            look.not_honoured.append(words[0])
    return looks


def _options(values: Sequence[str]) -> tuple[list[str], int]:
    """Return the options before a texture's name, and how many words they take."""
    options, place = [], 0
    while (
        place < len(values) - 1 and values[place].startswith("-") and values[place][1:2].isalpha()
    ):
        option, place = values[place].lower(), place + 1
        options.append(option)
        most = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2}.get(option, 1)
        numbers = [_is(value, None) for value in values[place : place + most]]
        place += max(1, (*numbers, False).index(False)) if most > 1 else 1
    return options, min(place, len(values) - 1)


def _is(word: str, number: float | None) -> bool:
    """Return whether a word is a number, and this one."""
    try:
        value = float(word)
    except ValueError:
        return False
    return number is None or value == number
