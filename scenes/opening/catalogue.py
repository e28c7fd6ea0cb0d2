"""Scenes by name or path: the path of a scene file, or the name of a built-in scene."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.hard import cases as hard_cases
from xfrustum.scenes.model.scene import Scene


def open_scene(text: str | os.PathLike[str]) -> Scene:
    """Open a scene file or a built-in scene.

    Parameters
    ----------
    text
        Path of a TOML file, or a name out of `builtin.names()` or `hard_cases.names()`. A text
        that ends in .toml is a path even if the file is missing, and so is a `Path`; a built-in name comes
        before a file of the same name.

    Raises
    ------
    InputError
        The text is neither, or the file is not a valid scene.
    """
    if isinstance(text, os.PathLike):
        return _read_file(Path(text))
    one_of(text, str, "a scene's name or path")
    if text in builtin.names():
        return builtin.build(text)
    if text in hard_cases.CASES:
        return hard_cases.build(text)
    if text.endswith(".toml") or Path(text).exists():
        return _read_file(Path(text))
    known = [*builtin.names(), *hard_cases.names()]
    nearest = difflib.get_close_matches(text, known, n=1)
    meant = f" (did you mean {nearest[0]}?)" if nearest else ""
    raise InputError(
        f"no scene file and no built-in scene is called {text!r}{meant}; `xfrustum scenes` lists all"
    )


def _read_file(path: Path) -> Scene:
    """Read a scene file; built-in scenes need none of the libraries for meshes."""
    from xfrustum.scenes.files.scene_file import read_scene  # noqa: PLC0415

    return read_scene(path)
