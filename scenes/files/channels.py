"""Names of the channels of a hogel image in OpenEXR files, and error bounds of stored values.

Blender writes `ViewLayer.Position.X`, Arnold `P.X` or `P.R`, and other renderers `pos.X`. In files
with several parts, the name of a part may replace the layer name. The names of CONVENTIONS.md,
"Image files", have precedence.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats

POSITION = ("P.X", "P.Y", "P.Z")
NORMAL = ("N.X", "N.Y", "N.Z")
COLOR = ("R", "G", "B")
VARIANCE = ("variance.R", "variance.G", "variance.B")
HEIGHT, TRIANGLE, OBJECT, CERTAINTY = "Z", "id.triangle", "id.object", "certainty"
#: number of a triangle or of an object
ANY_ID = "id"
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)
#: layer names of other programs for our channels, lower case
_LAYERS: Mapping[tuple[str, ...], frozenset[str]] = {
    POSITION: frozenset({"p", "pos", "position", "pworld", "worldposition"}),
    NORMAL: frozenset({"n", "normal"}),
    COLOR: frozenset({"combined", "rgb", "rgba", "beauty", "composite"}),
    (OBJECT,): frozenset({"indexob", "object index"}),
}
_AXES = {3: ("xyz", "rgb"), 1: ("x", "r", "")}  # last letters of the channels of a layer
#: largest number of channels that an error message lists
MAX_LISTED = 24


@dataclass(frozen=True, kw_only=True)
class StoredChannel:
    """A channel of a file."""

    part: int
    part_name: str
    name: str

    @property
    def words(self) -> str:
        """Name of part and channel; only the channel in files with one part."""
        return f"{self.part_name}/{self.name}" if self.part_name else self.name

    @property
    def layer_and_axis(self) -> tuple[str, str]:
        """Last component of the layer name, and last letter of the channel name, lower case."""
        path = f"{self.part_name}.{self.name}" if "." not in self.name else self.name
        layer, _, axis = path.lower().rpartition(".")
        return layer.rpartition(".")[2], axis


def listed(present: Sequence[StoredChannel]) -> str:
    """Return the names of channels, for errors."""
    names = [channel.words for channel in present]
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    # Cryptomatte resembles object numbers, but cannot be read without its manifest.
    secret = any("crypto" in name.lower() for name in names)
    return ", ".join(names[:MAX_LISTED]) + more + (" (Cryptomatte is not read)" if secret else "")


def located(
    present: Sequence[StoredChannel], names: Iterable[str]
) -> tuple[dict[str, StoredChannel], dict[str, tuple[StoredChannel, ...]]]:
    """Return the channel of each name, and the channels of names in several layers or parts.

    A name of CONVENTIONS.md has precedence over a layer name of another program.
    """
    missing = set(names)
    places: dict[str, StoredChannel] = {}
    several: dict[str, tuple[StoredChannel, ...]] = {}
    for name in missing:
        same = _named(present, name)
        if len(same) == 1:
            places[name] = same[0]
        elif same:
            several[name] = same
    missing -= places.keys() | several.keys()
    # All channels of a group must be in one layer; otherwise the group is not used.
    for group, layers in _LAYERS.items():
        if not missing.issuperset(group):
            continue
        sets = _complete_sets(present, layers, len(group))
        if len(sets) == 1:
            places.update(zip(group, sets[0], strict=True))
        elif sets:
            several[group[0]] = tuple(channels[0] for channels in sets)
    return places, several


def _named(present: Sequence[StoredChannel], name: str) -> tuple[StoredChannel, ...]:
    """Return the channels of a name.

    A part called `P` holds positions even in channels called R, G and B.
    """
    same = [channel for channel in present if channel.name == name]
    if name not in COLOR or len({channel.part for channel in present}) == 1:
        return tuple(same)
    others = frozenset[str]().union(
        *(layers for group, layers in _LAYERS.items() if group != COLOR)
    )
    same = [channel for channel in same if channel.layer_and_axis[0] not in others]
    main = [channel for channel in same if channel.layer_and_axis[0] in _LAYERS[COLOR]]
    return tuple(main if len(main) == 1 else same)


def _complete_sets(
    present: Sequence[StoredChannel], layers: frozenset[str], count: int
) -> list[tuple[StoredChannel, ...]]:
    """Return the channels, in the order of axes, of each complete layer with a name in `layers`."""
    by_layer: dict[tuple[int, str], dict[str, StoredChannel]] = {}
    for channel in present:
        layer, axis = channel.layer_and_axis
        # The same layer can be in several parts.
        if layer in layers:
            key = channel.part, channel.name.rpartition(".")[0]
            by_layer.setdefault(key, {})[axis] = channel
        elif count == 1 and axis in layers:  # a number needs no axis
            by_layer.setdefault((channel.part, channel.name), {})[""] = channel
    return [
        tuple(axes[axis] for axis in letters or ("",))
        for axes in by_layer.values()
        for letters in _AXES[count]
        if axes.keys() >= set(letters or ("",))
    ]


def refuse_several(path: object, several: Mapping[str, tuple[StoredChannel, ...]]) -> None:
    """Raise InputError if a required channel is in several layers or parts."""
    for name, places in several.items():
        where = ", ".join(channel.words for channel in places)
        raise InputError(f"{path}: channel {name} lies in {where}; keep one of them")


# Error bounds of numbers, by pixel type and lossy compression
# -------------------------------------------------------------------------------------------------

_DWA = (OpenEXR.DWAA_COMPRESSION, OpenEXR.DWAB_COMPRESSION)
_B44 = (OpenEXR.B44_COMPRESSION, OpenEXR.B44A_COMPRESSION)
#: last letters of channels that DWA changes; DWA keeps every bit of other channels
_DWA_CHANNELS = frozenset({"R", "G", "B", "Y", "RY", "BY"})
#: rounding to half precision: relative error, and absolute error of subnormal numbers
HALF_ROUNDING, HALF_SUBNORMAL = 2.0**-11, 2.0**-25
#: relative error; PXR24 keeps 15 of the 23 bits of a fraction
PXR24_ROUNDING = 2.0**-16
#: default compression level, for files without a level
DWA_LEVEL = 45.0
DWA_TABLE_NORM = 53.668
"""Norm of JPEG's luminance table divided by its smallest entry, 10.

DWA allows the coefficient k of an 8 x 8 block an error of level / 100,000 times table_k / 10.
"""


def lossy(name: str, kind: np.dtype[Any], compression: Any) -> str | None:
    """Return the name of a compression that changes a channel of some type, else None."""
    if compression in _DWA:
        changed = name.rpartition(".")[2].upper() in _DWA_CHANNELS and kind != np.uint32
    else:
        changed = compression in _B44 and kind == np.float16
    return str(compression.name).removesuffix("_COMPRESSION") if changed else None


def largest_whole(kind: np.dtype[Any], compression: Any) -> int:
    """Return the largest n for which a channel can store all integers from 0 to n."""
    if kind == np.float16:
        return 1 << 11
    if kind == np.float32:
        return 1 << (16 if compression == OpenEXR.PXR24_COMPRESSION else 24)
    return int(np.iinfo(np.uint32).max)


def uncertainty(
    values: NDArray[Any], name: str, compression: Any, level: float | None
) -> Floats | None:
    """Return the error bounds of a channel's values; None if they are exact in float32.

    B44 has no useful bound and is refused for positions.
    """
    if lossy(name, values.dtype, compression) is not None:
        assert compression in _DWA
        return _dwa(values.astype(np.float64), DWA_LEVEL if level is None else level)
    if values.dtype == np.float16:
        return np.asarray(HALF_ROUNDING * np.abs(values.astype(np.float64)) + HALF_SUBNORMAL)
    if values.dtype == np.float32 and compression == OpenEXR.PXR24_COMPRESSION:
        return np.asarray(PXR24_ROUNDING * np.abs(values.astype(np.float64)))
    return None


def _dwa(values: Floats, level: float) -> Floats:
    """Return the error bounds of values compressed by DWA.

    DWA rounds a value to half precision and maps it through a curve to v: the power 1 / 2.2 up to
    1, a logarithm above. It rounds the coefficients of the cosine transform of 8 x 8 values v. The
    basis is orthonormal: at each pixel the squares of the basis functions sum to 1. Errors e_k of
    the coefficients therefore change v by at most the square root of the sum of e_k^2. Coefficients
    are also rounded to half precision, which changes v by 2^-11 of their norm, at most 8 max |v|.
    The value v itself is rounded twice.
    """
    magnitude = np.where(np.isfinite(values), np.abs(values), 0.0)
    curve = np.where(
        magnitude <= 1, magnitude ** (1 / 2.2), np.log(np.maximum(magnitude, 1)) / 2.2 + 1
    )
    error = level / 100_000 * DWA_TABLE_NORM + (8 + 2) * HALF_ROUNDING * curve.max(initial=0.0)

    def value(curve: Floats) -> Floats:
        size = np.abs(curve)
        return np.asarray(np.sign(curve) * np.where(size <= 1, size**2.2, np.exp(2.2 * (size - 1))))

    off = np.maximum(value(curve + error) - magnitude, magnitude - value(curve - error))
    # Values are rounded to half precision before compression and after decompression.
    return np.asarray(off + 2 * (HALF_ROUNDING * magnitude + HALF_SUBNORMAL))
