"""Bezier patch files (`.bpt`): read, checked, and tessellated to a chord tolerance."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.input_files import bounded_memory, check_mesh_file
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.geometry.tessellation import tessellate
from xfrustum.scenes.model.scene import SceneObject

#: Default chord tolerance as a share of the diagonal of the box about the control points: half a pixel where
#: the patches fill an image of 512.
RELATIVE_CHORD = 1e-3
#: Largest coordinate of a control point: squares and products with degrees stay far from overflow, 1e308.
LARGEST_COORDINATE = 1e100
#: Largest number of words in a file: more would not fit into memory as Python's own objects.
_MAX_WORDS = 1 << 27


def load_patches(
    path: Path, *, chord_tolerance: float | None = None, material: str | None = None
) -> SceneObject:
    """Read a patch file as one object, in its own coordinates.

    The file is a text: the number of patches, then for each its degrees n m and (n + 1) (m + 1) points x y z,
    those along m one after the other. The tolerance is the largest distance between surface and triangles, in
    the file's unit. Raises InputError where the file is missing or damaged, or there are too many triangles.
    """
    nets = read_patches(path)
    if chord_tolerance is None:
        points = np.concatenate([net.reshape(-1, 3) for net in nets])
        chord_tolerance = RELATIVE_CHORD * float(np.linalg.norm(np.ptp(points, axis=0)))
        if chord_tolerance == 0:
            raise InputError(f"{path}: all control points are the same; write the patches again")
    try:
        return tessellate(nets, chord_tolerance, name=str(path), material=material)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_patches(path: Path) -> list[Floats]:
    """Return the control nets (n + 1, m + 1, 3) of a patch file; InputError where it is none."""
    check_mesh_file(path)
    with bounded_memory(path):
        try:
            words = path.read_text(encoding="ascii").split(maxsplit=_MAX_WORDS)
        except OSError as error:
            raise InputError(f"{path}: cannot read the patches ({error.strerror})") from error
        except ValueError as error:
            raise InputError(f"{path}: is not a text of Bezier patches; write the file again") from error
        count, at = _count(path, words, 0, "the number of patches"), 1
        nets = []
        for number in range(count):
            n, m = (_count(path, words, at + k, f"a degree of patch {number}") for k in (0, 1))
            end = at + 2 + (n + 1) * (m + 1) * 3
            if end > len(words):
                raise InputError(
                    f"{path}: ends within the control points of patch {number}; write the file again"
                )
            point, shape = f"{path}: a control point of patch {number}", (n + 1, m + 1, 3)
            nets.append(_net(point, words[at + 2 : end], shape))
            at = end
    if at < len(words):
        raise InputError(f"{path}: goes on after {count} patches; correct their number in the first line")
    return nets


def _count(path: Path, words: list[str], at: int, what: str) -> int:
    """Return a positive whole number."""
    if at >= len(words):
        raise InputError(f"{path}: ends before {what}; write the file again")
    digits = words[at].lstrip("0")
    if not (digits.isascii() and digits.isdigit()):
        raise InputError(f"{path}: {what} must be a whole number of at least 1, not {words[at][:40]!r}")
    # A file has no more words than this, and Python refuses to read a number of thousands of digits.
    if len(digits) > len(str(_MAX_WORDS)):
        raise InputError(f"{path}: {what} must be at most {_MAX_WORDS:,}, not {words[at][:40]}..")
    return int(digits)


def _net(point: str, words: list[str], shape: tuple[int, int, int]) -> Floats:
    try:
        net = np.array(words, dtype=np.float64).reshape(shape)
    except ValueError as error:
        raise InputError(f"{point} is not a number ({error})") from error
    if not np.isfinite(net).all():
        raise InputError(f"{point} is NaN or infinite; repair it")
    if np.abs(net).max() > LARGEST_COORDINATE:
        raise InputError(f"{point} is beyond {LARGEST_COORDINATE:.0e}; repair it")
    return net
