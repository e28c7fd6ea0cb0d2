"""Scenes by name or path: the path of a scene file, or the name of a built-in scene."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.disk.input_files import regular_size
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library import builtin

if TYPE_CHECKING:
    from xfrustum.scenes.model.scene import Scene

# prefix of the names of hard cases: other names do not need the suite
HARD = "hard/"


def open_scene(text: str | os.PathLike[str]) -> Scene:
    """Open a scene file, or a built-in scene out of `builtin.names()` or `hard_cases.names()`.

    A text that ends in .toml, or a `Path`, is a path; a built-in name has precedence over a file of
    the same name. Raises InputError if it is neither, or if the file is not a valid scene.
    """
    if not isinstance(text, os.PathLike):
        one_of(text, str, "a scene's name or path")
        if build := _builder(text):
            return build(text)
    regular_size(Path(text), "scene file")
    # Built-in scenes and unknown names do not need the readers of tables and meshes, which take a
    # second to load.
    from xfrustum.scenes.files.scene_file import read_scene  # noqa: PLC0415

    return read_scene(Path(text))


def check_scene(text: str) -> None:
    """Raise the InputErrors of `open_scene` that can be detected without reading a mesh."""
    if _builder(text) is None:
        regular_size(Path(text), "scene file")
        from xfrustum.scenes.files.scene_file import checked  # noqa: PLC0415 - loads pydantic

        checked(Path(text))


def _builder(text: str) -> Callable[[str], Scene] | None:
    """Return the function that builds a built-in scene; None for a path, InputError for neither."""
    if text in builtin.SCENES:
        return builtin.build
    is_path = text.endswith(".toml") or Path(text).exists()
    if is_path and not text.startswith(HARD):
        return None
    from xfrustum.scenes.library import hard_cases  # noqa: PLC0415 - loads NumPy

    if text in hard_cases.CASES:
        return hard_cases.build
    if is_path:
        return None
    nearest = difflib.get_close_matches(text, [*builtin.names(), *hard_cases.names()], n=1)
    meant = f" (did you mean {nearest[0]}?)" if nearest else ""
    raise InputError(
        f"no scene file and no built-in scene is called {text!r}{meant}; `xfrustum scenes` "
        "lists all"
    )
