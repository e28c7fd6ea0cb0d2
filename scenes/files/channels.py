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
#: Number that does not say whether it counts triangles or objects.
ANY_ID = "id"
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)
#: Layers of others, in lower case, that hold what some of our channels hold.
_LAYERS: Mapping[tuple[str, ...], frozenset[str]] = {
    POSITION: frozenset({"p", "pos", "position", "pworld", "worldposition"}),
    NORMAL: frozenset({"n", "normal"}),
    COLOR: frozenset({"combined", "rgb", "rgba", "beauty", "composite"}),
    (OBJECT,): frozenset({"indexob", "object index"}),
}
_AXES = {3: ("xyz", "rgb"), 1: ("x", "r", "")}  # last letters of the channels of a layer
MAX_LISTED = 24  #: channels that an error lists


@dataclass(frozen=True, kw_only=True)
class StoredChannel:
    """One channel of a file."""

    part: int
    part_name: str
    name: str

    @property
    def words(self) -> str:
        """The name, behind that of its part where there are several."""
        return f"{self.part_name}/{self.name}" if self.part_name else self.name

    @property
    def layer_and_axis(self) -> tuple[str, str]:
        """Layer without what is before its last point, and last letter, in lower case."""
        path = f"{self.part_name}.{self.name}" if "." not in self.name else self.name
        layer, _, axis = path.lower().rpartition(".")
        return layer.rpartition(".")[2], axis


def listed(present: Sequence[StoredChannel]) -> str:
    """Return the names of channels, for errors."""
    names = [one.words for one in present]
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    secret = any("crypto" in name.lower() for name in names)
    return ", ".join(names[:MAX_LISTED]) + more + (" (Cryptomatte is not read)" if secret else "")


def located(
    present: Sequence[StoredChannel], wanted: Iterable[str]
) -> tuple[dict[str, StoredChannel], dict[str, tuple[StoredChannel, ...]]]:
    """Return where each wanted channel lies, and by name those that several layers or parts hold.

    A name of our contract wins; else the one layer that has a name of others.
    """
    names = set(wanted)
    found: dict[str, StoredChannel] = {}
    several: dict[str, tuple[StoredChannel, ...]] = {}
    for name in names:
        same = _named(present, name)
        if len(same) == 1:
            found[name] = same[0]
        elif same:
            several[name] = same
    for group, layers in _LAYERS.items():
        if not names.issuperset(group) or any(name in found or name in several for name in group):
            continue
        sets = _complete_sets(present, layers, len(group))
        if len(sets) == 1:
            found.update(zip(group, sets[0], strict=True))
        elif sets:
            several[group[0]] = tuple(one[0] for one in sets)
    return found, several


def _named(present: Sequence[StoredChannel], name: str) -> tuple[StoredChannel, ...]:
    """Return the channels of a name. A part called `P` has positions, whatever its channels are called."""
    same = [one for one in present if one.name == name]
    if name not in COLOR or len({one.part for one in present}) == 1:
        return tuple(same)
    others = frozenset[str]().union(
        *(layers for group, layers in _LAYERS.items() if group != COLOR)
    )
    same = [one for one in same if one.layer_and_axis[0] not in others]
    main = [one for one in same if one.layer_and_axis[0] in _LAYERS[COLOR]]
    return tuple(main if len(main) == 1 else same)


def _complete_sets(
    present: Sequence[StoredChannel], layers: frozenset[str], count: int
) -> list[tuple[StoredChannel, ...]]:
    """Return the channels of each layer with one of some names, in the order of their axes."""
    by_layer: dict[tuple[int, str], dict[str, StoredChannel]] = {}
    for one in present:
        layer, axis = one.layer_and_axis
        if layer in layers:
            by_layer.setdefault((one.part, one.name.rpartition(".")[0]), {})[axis] = one
        elif count == 1 and axis in layers:  # a number needs no axis
            by_layer.setdefault((one.part, one.name), {})[""] = one
    return [
        tuple(axes[axis] for axis in letters or ("",))
        for axes in by_layer.values()
        for letters in _AXES[count]
        if axes.keys() >= set(letters or ("",))
    ]


def refuse_several(path: object, several: Mapping[str, tuple[StoredChannel, ...]]) -> None:
    """Raise InputError where a channel that is needed lies in several layers or parts."""
    for name, places in several.items():
        raise InputError(
            f"{path}: channel {name} lies in {', '.join(one.words for one in places)}; keep one of them"
        )
