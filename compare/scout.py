"""Coarse films of certified lines through apertures all over a plate, and the apertures that `auto` takes.

The displacement by the near offset is (W/2) |u| n / (|z| + n): the *nearest visible* |z| decides it, and that
changes from aperture to aperture by orders of magnitude while pictures hardly change. So apertures are chosen
by what they see near the plate, never by their position alone (docs/method.md, "The plate").
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from xfrustum.compare.beyond import PERCENTILE
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture, Plate
from xfrustum.tolerances import TOLERANCE_PX

FILM_PIXELS = 24
"""Lines along each side of the coarse film: 576 through an aperture, of which one in a hundred is six."""

LATTICE_APERTURES = 400
"""Apertures of the first lattice, about; a look costs some 10 ms on a mesh of 40,000 triangles."""

MAX_APERTURES = 1000
"""Largest number of apertures that are looked through, those around the worst ones included."""

REFINED_APERTURES = 16
"""Number of worst apertures so far whose neighbors are looked through next."""

MAX_AUTO_APERTURES = 4
"""Largest number of apertures that `auto` takes: the middle one, and the worst one in each of three respects
(the 99th percentile of displacement, the nearest surface, outlines). Each aperture takes a command as long as
the first; more of them, beside the worst, would be as bad for the same reason."""

Index = tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What the coarse film of one aperture shows.

    Attributes
    ----------
    aperture
        The aperture that is looked through.
    height
        (h, w) signed heights of the first surfaces, scene units; NaN where there is none, 0 where the line
        ends in the aperture, on a surface that lies in the plate or passes through it.
    camera
        True frustum of the aperture, with the resolution of the scene.
    outline_widths
        Length of the borders between objects, and between them and nothing, in widths of the film.
    """

    aperture: Aperture
    height: Floats
    camera: HogelCamera
    outline_widths: float

    @classmethod
    def of(cls, image: HogelImage, frustum_resolution: tuple[int, int]) -> Look:
        """Return what a coarse image shows; the camera is given the scene's resolution."""
        return cls(
            aperture=image.camera.aperture,
            height=np.where(image.covered, image.height, np.nan).astype(np.float64),
            camera=replace(image.camera, resolution=frustum_resolution),
            outline_widths=_outline_widths(image),
        )

    @cached_property
    def points(self) -> TruePoints:
        """The surface points that are seen off the plate, at their places on the scene's own film."""
        off_plate = np.where(self.height == 0, np.nan, self.height)
        return TruePoints(height=off_plate, from_middle=self._from_middle, camera=self.camera)

    @property
    def _from_middle(self) -> Floats:
        """Return (h, w, 2) columns and rows from the middle of the scene's film, pixels of that film."""
        sides = [
            ((2 * np.arange(count) + 1) / count - 1) * pixels / 2
            for count, pixels in zip(self.height.shape[::-1], self.camera.resolution, strict=True)
        ]
        return np.stack(np.meshgrid(*sides), axis=-1)

    @property
    def nearest(self) -> float:
        """Smallest visible |z|, scene units; infinite where nothing is seen."""
        return float(np.nanmin(np.abs(self.height), initial=np.inf))

    def farthest(self, camera: Camera) -> float:
        """Return the largest |z| seen on the side of one camera; 0 where it sees nothing."""
        side = -self.height if camera is Camera.C else self.height
        return float(np.nanmax(side, initial=0.0))

    @cached_property
    def pixels_per_near(self) -> float:
        """The 99th percentile of displacement over n, as n tends to 0: pixels per scene unit.

        0 where nothing is seen; infinite where more than one line in a hundred ends in the aperture itself:
        displacement is undefined there at any n.
        """
        seen = np.isfinite(self.height)
        if not seen.any():
            return 0.0
        with np.errstate(divide="ignore"):
            moved = self.points.radius[seen] / np.abs(self.height[seen])
        moved[self.height[seen] == 0] = np.inf
        return float(np.percentile(moved, PERCENTILE, method="higher"))

    def displacement_p99_px(self, settings: DoubleFrustum, scene: Scene) -> float:
        """Return the 99th percentile of displacement that settings cause, by closed form; see above."""
        seen = np.isfinite(self.height)
        if not seen.any():
            return 0.0
        moved = displacement_lengths(self.points, scene.frustum, settings)[seen]
        moved = np.where(self.height[seen] == 0, np.inf, np.nan_to_num(moved, nan=0.0))
        return float(np.percentile(moved, PERCENTILE, method="higher"))


def _outline_widths(image: HogelImage) -> float:
    """Return how long the borders between neighboring pixels of different objects are, in film widths."""
    shown = image.object
    across = (shown[:, 1:] != shown[:, :-1]).sum() / shown.shape[0]
    down = (shown[1:] != shown[:-1]).sum() / shown.shape[1]
    return float(across + down)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scout:
    """Looks through apertures all over a plate.

    Attributes
    ----------
    scene
        The scene that is looked at.
    looks
        One for each aperture, in the order of rows and columns.
    """

    scene: Scene
    looks: tuple[Look, ...]

    @property
    def apertures(self) -> tuple[Aperture, ...]:
        """The apertures that were looked through."""
        return tuple(look.aperture for look in self.looks)

    def displacements(self, settings: DoubleFrustum) -> Floats:
        """Return (A,) the 99th percentile of displacement of each look, pixels, by closed form."""
        return np.array([look.displacement_p99_px(settings, self.scene) for look in self.looks])

    def worst(self, count: int, settings: DoubleFrustum | None = None) -> list[Look]:
        """Return the looks with the largest displacement, the worst first.

        Parameters
        ----------
        count
            Largest number of looks.
        settings
            What is drawn with; None for any small near without slabs.
        """
        if settings is None:
            errors = np.array([look.pixels_per_near for look in self.looks])
        else:
            errors = self.displacements(settings)
        return [self.looks[number] for number in np.argsort(-errors, kind="stable")[:count]]

    def farthest(self, camera: Camera) -> Look:
        """Return the look with the farthest surface on the side of one camera."""
        return max(self.looks, key=lambda look: look.farthest(camera))


def scout(scene: Scene, done: Callable[[int], object] = lambda looks: None) -> Scout:
    """Look through apertures all over the plate, and through more where the error is largest.

    The first lattice has about `LATTICE_APERTURES` and always the corners and the middle. Then the
    neighbors of the worst are looked through, at half the distance each time, down to the hogels beside
    them, until the worst ones have no neighbor left or `MAX_APERTURES` are reached. A plate with no more
    hogels than the lattice is looked at whole.

    Parameters
    ----------
    scene
        The scene; its resolution does not matter to the cost.
    done
        Called after each look, with 1; there are at most `MAX_APERTURES`.
    """
    frustum = replace(scene.frustum, resolution=(FILM_PIXELS, FILM_PIXELS))
    reference = Reference(replace(scene, frustum=frustum), effects=frozenset())
    found: dict[Index, Look] = {}

    def look_through(indices: Iterable[Index]) -> None:
        wanted = [index for index in dict.fromkeys(indices) if index not in found]
        wanted = wanted[: MAX_APERTURES - len(found)]
        for image in reference.stream(scene.plate.aperture(*index) for index in wanted):
            found[image.camera.aperture.index] = Look.of(image, scene.frustum.resolution)
            done(1)

    columns, rows = _lattice(scene.plate)
    look_through([scene.plate.middle.index, *((column, row) for row in rows for column in columns)])
    step = (_largest_gap(columns), _largest_gap(rows))
    while len(found) < MAX_APERTURES:
        before = len(found)
        step = (max(1, step[0] // 2), max(1, step[1] // 2))
        worst = sorted(found.values(), key=lambda look: -look.pixels_per_near)[:REFINED_APERTURES]
        look_through(index for look in worst for index in _neighbors(look.aperture, step, scene.plate))
        if step == (1, 1) and len(found) == before:
            break
    looks = sorted(found.values(), key=lambda look: look.aperture.index[::-1])
    return Scout(scene=scene, looks=tuple(looks))


def _lattice(plate: Plate) -> tuple[list[int], list[int]]:
    """Return columns and rows of the first lattice, as square as the plate's hogels allow, ends included."""
    columns, rows = plate.hogels
    if columns * rows <= LATTICE_APERTURES:
        return list(range(columns)), list(range(rows))
    across = min(columns, max(2, round((LATTICE_APERTURES * columns / rows) ** 0.5)))
    down = min(rows, max(2, LATTICE_APERTURES // across))
    first, second = (
        sorted({round(place) for place in np.linspace(0, hogels - 1, count)})
        for hogels, count in ((columns, across), (rows, down))
    )
    return first, second


def _largest_gap(places: Sequence[int]) -> int:
    return max((after - before for before, after in itertools.pairwise(places)), default=1)


def _neighbors(aperture: Aperture, step: Index, plate: Plate) -> list[Index]:
    """Return the eight apertures at a distance of some columns and rows that lie on the plate."""
    places = [
        (aperture.column + across * step[0], aperture.row + down * step[1])
        for across in (-1, 0, 1)
        for down in (-1, 0, 1)
    ]
    return [(i, j) for i, j in places if 0 <= i < plate.hogels[0] and 0 <= j < plate.hogels[1]]


@dataclass(frozen=True, kw_only=True)
class ChosenAperture:
    """An aperture, and the reason in words for which it was chosen."""

    aperture: Aperture
    why: str


@dataclass(frozen=True, kw_only=True, eq=False)
class AutoApertures:
    """The apertures that `auto` takes.

    Attributes
    ----------
    scout
        Looks through apertures all over the plate, from which they were chosen.
    chosen
        The apertures with their reasons; at least one, and no more than `MAX_AUTO_APERTURES`. The middle one
        is the first, unless it sees nothing and others do.
    blocked
        Number of scouted apertures in which a surface lies: it fills more than a hundredth of their picture
        at |z| = 0, and no settings draw that. They are chosen only where there are no others.
    """

    scout: Scout
    chosen: tuple[ChosenAperture, ...]
    blocked: int

    @property
    def apertures(self) -> tuple[Aperture, ...]:
        """The apertures alone, in the order of `chosen`."""
        return tuple(one.aperture for one in self.chosen)

    @classmethod
    def of(cls, scout: Scout) -> AutoApertures:
        """Choose apertures from what a scout has seen."""
        seeing = [look for look in scout.looks if math.isfinite(look.nearest)]
        free = [look for look in seeing if math.isfinite(look.pixels_per_near)]
        middle = scout.scene.plate.middle
        reasons: dict[Aperture, list[str]] = {}
        if not seeing or any(look.aperture == middle for look in seeing):
            reasons[middle] = ["the middle of the plate"]
        # Of equally bad ones the first is taken: the middle, so that no other is measured for the same.
        ordered = sorted(free or seeing, key=lambda look: look.aperture != middle)
        for aperture, reason in _worst(ordered, scout.scene.units):
            reasons.setdefault(aperture, []).append(reason)
        nearest = {
            look.aperture: f"nearest visible |z| {look.nearest:.2g} {scout.scene.units}" for look in seeing
        }
        return cls(
            scout=scout,
            chosen=tuple(
                ChosenAperture(
                    aperture=aperture, why="; ".join([*parts, nearest.get(aperture, "nothing seen")])
                )
                for aperture, parts in reasons.items()
            ),
            blocked=len(seeing) - len(free),
        )


def _worst(looks: Sequence[Look], units: str) -> list[tuple[Aperture, str]]:
    """Return the worst aperture in each respect, with the respect in words; none where there are no looks.

    The first of several that are equally bad is the worst.
    """
    if not looks:
        return []
    displaced = max(looks, key=lambda look: look.pixels_per_near)
    nearest = min(looks, key=lambda look: look.nearest)
    outlined = max(looks, key=lambda look: look.outline_widths)
    return [
        (displaced.aperture, f"largest displacement ({_tolerated(displaced, units)})"),
        (nearest.aperture, "surface nearest to the plate"),
        (outlined.aperture, f"longest outlines ({outlined.outline_widths:.2g} widths of the picture)"),
    ]


def _tolerated(look: Look, units: str) -> str:
    """Say from which near on the picture of an aperture is displaced by more than the usual tolerance."""
    if look.pixels_per_near == 0:
        return "none at any near"
    near = f"{TOLERANCE_PX / look.pixels_per_near:.2g}".replace("e-0", "e-")
    return f"over {TOLERANCE_PX:g} px from near {near} {units} on"
