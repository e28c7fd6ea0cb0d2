"""What images say of themselves: in words, in tables and pictures, and as labelled arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from json import dumps
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Bytes, Mask, Numbers, Singles
from xfrustum.scenes.notebook.labels import NO_UNIT, SCENE_UNITS, Labelled, dataset
from xfrustum.scenes.notebook.numbers import counted, digits, percent, sides
from xfrustum.scenes.notebook.pictures import as_shown, by_height, png
from xfrustum.scenes.notebook.shown import Figure, Shown, Table

if TYPE_CHECKING:
    import xarray

    from xfrustum.scenes.model.eye_image import EyeImage
    from xfrustum.scenes.model.hogel_image import HogelImage

HASH_DIGITS = 12
"""Number of digits of a scene's hash that a table shows: as many as tell all scenes of a lifetime apart."""


@dataclass(frozen=True, kw_only=True)
class Labels:
    """What an image has beside its surfaces.

    Attributes
    ----------
    images
        Further arrays by name; None where the image has none.
    places
        Coordinates that belong to the whole image.
    attributes
        Facts of the image.
    """

    images: Mapping[str, Labelled | None]
    places: Mapping[str, Labelled]
    attributes: Mapping[str, object]


class ShownImage(Shown):
    """An image whose pixels show surfaces: a notebook shows its color and heights, and xarray labels it.

    Attributes
    ----------
    triangle, object, position, color, certainty
        As in `HogelImage`.
    """

    triangle: Numbers
    object: Numbers
    position: NDArray[np.floating]
    color: Singles | None
    certainty: Bytes | None

    @property
    def covered(self) -> Mask:
        """Pixels that show a surface."""
        raise NotImplementedError

    def _labels(self, units: str) -> Labels:
        """Return what the image has beside its surfaces, lengths in some units."""
        raise NotImplementedError

    def to_xarray(self, units: str = SCENE_UNITS) -> xarray.Dataset:
        """Return the arrays with labels, as an `xarray.Dataset` with the names that stored plates have.

        Dimensions are v and u, the film coordinates of the pixels' centers (v upward, u to the right, from
        -1 to 1), and rgb or xyz. The place of a hogel's aperture, or of an eye, is a coordinate; the numbers
        of the camera, and the scene's hash, are attributes. The film of an eye is the rectangle of the plate.

        Parameters
        ----------
        units
            Name of the scene's unit of length (`scene.units`), which images do not know.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        labels = self._labels(units)
        return dataset({**_surfaces(self, units), **labels.images}, labels.places, labels.attributes)

    def _figures(self) -> Sequence[Figure]:
        covered, height = self.covered, self.position[..., 2]
        where = heights_words(height).replace(" at heights", ":")
        shown = Figure(caption=f"height{where}, dark to light", content=png(by_height(covered, height)))
        if self.color is None:
            return (shown,)
        return Figure(caption="color, sRGB", content=png(as_shown(self.color, covered, height))), shown


def said_of_hogel(image: HogelImage) -> str:
    """Return which aperture of which scene an image shows, its size, and what it has."""
    camera = image.camera
    kind = "image"
    if camera.settings is not None:
        kind = f"drawing with near {digits(camera.settings.near)} {camera.settings.depth_label}"
    elif image.certainty is not None:
        kind = "truth"
    column, row = camera.aperture.index
    whose = f"{kind} of aperture {column},{row} of {camera.scene or 'a scene'!r} by {camera.renderer}"
    names = ("color", "normal", "variance", "certainty")
    has = [name for name in names if getattr(image, name) is not None]
    return f"{whose}; {shown_words(image.covered, image.height)}; has {', '.join(['surfaces', *has])}"


def said_of_eye(image: EyeImage) -> str:
    """Return where the eye stands, the size of its picture, and how much of it shows something."""
    place = ", ".join(map(digits, image.eye.position))
    seen = shown_words(image.covered, image.position[..., 2])
    color = "with" if image.color is not None else "without"
    return f"what an eye at ({place}) scene units sees; {seen}; {color} color"


def shown_words(covered: Mask, height: NDArray[np.floating]) -> str:
    """Return the size of an image, how many pixels show a surface, and at which heights."""
    rows, columns = covered.shape
    count = int(np.count_nonzero(covered))
    share = percent(count / covered.size) if covered.size else "0 %"
    return f"{sides((columns, rows))} pixels, {count:,} ({share}) show a surface{heights_words(height)}"


def heights_words(height: NDArray[np.floating]) -> str:
    """Return the range of known heights, after a comma of words; nothing where none is known."""
    known = height[np.isfinite(height)]
    if not known.size:
        return ""
    return f" at heights {digits(float(known.min()))} to {digits(float(known.max()))} scene units"


def table_of_hogel(image: HogelImage) -> Table:
    """Return the facts of a hogel image."""
    camera = image.camera
    rows = [
        ("scene", f"{camera.scene} ({camera.scene_hash[:HASH_DIGITS]})"),
        ("aperture", f"column {camera.aperture.column}, row {camera.aperture.row}, "
         f"at ({digits(camera.aperture.x)}, {digits(camera.aperture.y)}, 0) scene units"),
        ("lines", f"shear {_pair(camera.shear)}, half-extent {_pair(camera.half_extent)}, per unit of depth"),
        ("reach", f"{digits(camera.reach[0])} toward the viewer, {digits(camera.reach[1])} behind the plate"),
        ("renderer", camera.renderer),
        *([] if camera.settings is None else [("settings", str(camera.settings))]),
        *_surface_rows(image.triangle, image.object),
        *([] if image.certainty is None else [("certainty", _certainty_words(image.certainty))]),
    ]  # fmt: skip
    return Table(rows=rows)


def table_of_eye(image: EyeImage) -> Table:
    """Return the facts of an eye's picture."""
    eye = image.eye
    pupil = "a pinhole"
    if eye.pupil:
        pupil = f"pupil of {digits(eye.pupil)} scene units, focus at height {digits(eye.focus)}"
    rows = [("eye", f"{pupil}, beam {eye.beam}"), *_surface_rows(image.triangle, image.object)]
    if image.certainty is not None:
        rows.append(("certainty", _certainty_words(image.certainty)))
    return Table(rows=rows)


def labels_of_hogel(image: HogelImage, units: str) -> Labels:
    """Return what a hogel image has beside its surfaces."""
    camera = image.camera
    places = {
        "column": Labelled(values=camera.aperture.column, meaning="column of the hogel, from the left"),
        "row": Labelled(values=camera.aperture.row, meaning="row of the hogel, from the top"),
        "x": Labelled(values=camera.aperture.x, meaning="x of the aperture", units=units),
        "y": Labelled(values=camera.aperture.y, meaning="y of the aperture", units=units),
    }
    settings = None if camera.settings is None else dumps(asdict(camera.settings))
    attributes = {
        "aperture": list(camera.aperture.index),
        "shear": list(camera.shear),
        "half_extent": list(camera.half_extent),
        "reach": list(camera.reach),
        "scene": camera.scene,
        "scene_hash": camera.scene_hash,
        "renderer": camera.renderer,
        "settings": settings,
        "light_paths": camera.light_paths,
    }
    normal, variance = image.normal, image.variance
    images = {
        "normal": None if normal is None else Labelled(
            values=normal, meaning="unit normal by the mesh's winding", units=NO_UNIT, last="xyz"
        ),
        "variance": None if variance is None else Labelled(
            values=variance, meaning="variance of the color, which is a mean over light paths", units=NO_UNIT
        ),
    }  # fmt: skip
    return Labels(images=images, places=places, attributes=attributes)


def labels_of_eye(image: EyeImage, units: str) -> Labels:
    """Return what an eye's picture has beside its surfaces."""
    eye = image.eye
    places = {
        f"eye_{name}": Labelled(values=value, meaning=f"{name} of the eye", units=units)
        for name, value in zip("xyz", eye.position, strict=True)
    }
    attributes = {"pupil": eye.pupil, "focus": eye.focus, "beam": str(eye.beam)}
    return Labels(images={}, places=places, attributes=attributes)


def _surfaces(image: ShownImage, units: str) -> dict[str, Labelled | None]:
    color, certainty, position = image.color, image.certainty, image.position
    return {
        "triangle": Labelled(values=image.triangle, meaning="triangle number, -1 for no surface"),
        "object": Labelled(values=image.object, meaning="object number, -1 for no surface"),
        "height": Labelled(values=position[..., 2], meaning="height above the plate", units=units),
        "position": Labelled(values=position, meaning="visible surface point", units=units, last="xyz"),
        "color": None if color is None else Labelled(
            values=color, meaning="linear radiance", units=NO_UNIT
        ),
        "certainty": None if certainty is None else Labelled(
            values=certainty, meaning="0 proven, 1 decided exactly, 2 tie, 3 not examined"
        ),
    }  # fmt: skip


def _pair(values: tuple[float, float]) -> str:
    return f"({digits(values[0])}, {digits(values[1])})"


def _surface_rows(triangle: Numbers, number: Numbers) -> list[tuple[str, str]]:
    from xfrustum.scenes.model.hogel_image import NOTHING  # noqa: PLC0415 - it knows this module

    triangles, objects = (len(np.unique(one[one != NOTHING])) for one in (triangle, number))
    return [("shows", f"{counted(triangles, 'triangle')} of {counted(objects, 'object')}")]


def _certainty_words(certainty: NDArray[np.uint8]) -> str:
    from xfrustum.scenes.model.hogel_image import Certainty  # noqa: PLC0415 - it knows this module

    counts = {kind.name.lower(): int(np.count_nonzero(certainty == kind)) for kind in Certainty}
    return ", ".join(f"{count:,} {name}" for name, count in counts.items() if count)
