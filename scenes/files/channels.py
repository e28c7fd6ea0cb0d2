"""Names under which renderers store the channels of a hogel image in OpenEXR files.

Blender writes `ViewLayer.Position.X`, Arnold `P.X` or `P.R`, others `pos.X`; in files of several
parts the name of a part may stand for the layer. Names of our own contract (CONVENTIONS.md, "Image
files") come first.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from xfrustum.scenes.errors import InputError

POSITION = ("P.X", "P.Y", "P.Z")
NORMAL = ("N.X", "N.Y", "N.Z")
COLOR = ("R", "G", "B")
VARIANCE = ("variance.R", "variance.G", "variance.B")
HEIGHT, TRIANGLE, OBJECT, CERTAINTY = "Z", "id.triangle", "id.object", "certainty"
#: number of a triangle or of an object
ANY_ID = "id"
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)
#: layers of other programs with the content of our channels, lower case
_LAYERS: Mapping[tuple[str, ...], frozenset[str]] = {
    POSITION: frozenset({"p", "pos", "position", "pworld", "worldposition"}),
    NORMAL: frozenset({"n", "normal"}),
    COLOR: frozenset({"combined", "rgb", "rgba", "beauty", "composite"}),
    (OBJECT,): frozenset({"indexob", "object index"}),
}
_AXES = {3: ("xyz", "rgb"), 1: ("x", "r", "")}  # last letters of the channels of a layer
#: channels in an error message
MAX_LISTED = 24


@dataclass(frozen=True, kw_only=True)
class StoredChannel:
    """A channel of a file."""

    part: int
    part_name: str
    name: str

    @property
    def words(self) -> str:
        """Name of part and channel; the channel alone in files of one part."""
        return f"{self.part_name}/{self.name}" if self.part_name else self.name

    @property
    def layer_and_axis(self) -> tuple[str, str]:
        """Layer name behind its last point, and last letter, lower case."""
        path = f"{self.part_name}.{self.name}" if "." not in self.name else self.name
        layer, _, axis = path.lower().rpartition(".")
        return layer.rpartition(".")[2], axis


def listed(present: Sequence[StoredChannel]) -> str:
    """Return the names of channels, for errors."""
    names = [channel.words for channel in present]
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    # Cryptomatte looks like numbers of objects, and needs its own manifest to be read.
    secret = any("crypto" in name.lower() for name in names)
    return ", ".join(names[:MAX_LISTED]) + more + (" (Cryptomatte is not read)" if secret else "")


def located(
    present: Sequence[StoredChannel], names: Iterable[str]
) -> tuple[dict[str, StoredChannel], dict[str, tuple[StoredChannel, ...]]]:
    """Return the channel of each name, and the channels of names in several layers or parts.

    A name of our contract wins over the one layer with a name of other programs.
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
    # A group of channels comes from one layer, or not at all.
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
    """Return the channels of each layer with one of some names, in the order of their axes."""
    by_layer: dict[tuple[int, str], dict[str, StoredChannel]] = {}
    for channel in present:
        layer, axis = channel.layer_and_axis
        # The same layer can lie in several parts.
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
    """Raise InputError where a channel that is needed lies in several layers or parts."""
    for name, places in several.items():
        where = ", ".join(channel.words for channel in places)
        raise InputError(f"{path}: channel {name} lies in {where}; keep one of them")
