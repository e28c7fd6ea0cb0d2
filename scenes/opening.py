"""Scenes by name or path: the path of a scene file, or the name of a built-in scene."""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from typing import TYPE_CHECKING

from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.disk.input_files import regular_size
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library import builtin

if TYPE_CHECKING:
    from xfrustum.scenes.model.scene import Scene

HARD = "hard/"  # beginning of the names of hard cases: other names are looked up without loading the suite


def open_scene(text: str | os.PathLike[str]) -> Scene:
    """Open a scene file or a built-in scene.

    Parameters
    ----------
    text
        Path of a TOML file, or a name out of `builtin.names()` or `hard_cases.names()`. A text
        that ends in .toml is a path even if the file is missing, and so is a `Path`; a built-in name comes
        before a file of the same name.

    Raises InputError where the text is neither, or the file is not a valid scene.
    """
    if isinstance(text, os.PathLike):
        return _read(Path(text))
    one_of(text, str, "a scene's name or path")
    _check_name(text)
    if text in builtin.SCENES:
        return builtin.build(text)
    if text.startswith(HARD):
        from xfrustum.scenes.library import hard_cases  # noqa: PLC0415 - loads NumPy

        if text in hard_cases.CASES:
            return hard_cases.build(text)
    return _read(Path(text))


def check_scene(text: str) -> None:
    """Refuse what `open_scene` would refuse, as far as that shows without reading a mesh.

    Raises InputError where there is no such scene, or its file is not valid.
    """
    _check_name(text)
    if text not in builtin.SCENES and not text.startswith(HARD):
        regular_size(Path(text), "scene file")
        from xfrustum.scenes.files.scene_file import checked  # noqa: PLC0415 - loads pydantic

        checked(Path(text))


def _check_name(text: str) -> None:
    """Refuse a text that is neither the path of a file nor the name of a built-in scene."""
    if text in builtin.SCENES or text.endswith(".toml") or Path(text).exists():
        return
    from xfrustum.scenes.library import hard_cases  # noqa: PLC0415 - loads NumPy

    if text in hard_cases.CASES:
        return
    known = [*builtin.names(), *hard_cases.names()]
    nearest = difflib.get_close_matches(text, known, n=1)
    meant = f" (did you mean {nearest[0]}?)" if nearest else ""
    raise InputError(
        f"no scene file and no built-in scene is called {text!r}{meant}; `xfrustum scenes` lists all"
    )


def _read(path: Path) -> Scene:
    regular_size(path, "scene file")
    # Built-in scenes and names of nothing need no reader of tables and meshes, which takes a second to load.
    from xfrustum.scenes.files.scene_file import read_scene  # noqa: PLC0415

    return read_scene(path)
