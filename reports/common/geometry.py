"""Camera geometries: pivot, fit, offset and cuts of a setting, without its near and its depth buffer."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from xfrustum.scenes.notebook import digits
from xfrustum.scenes.plate.double_frustum import (
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.scenes.plate.frustum import Frustum


@dataclass(frozen=True, kw_only=True)
class CameraGeometry:
    """Where the two cameras stand and what their films span, for any near and depth buffer."""

    pivot: Pivot = Pivot.APERTURE
    fit: Fit | float | None = None
    offset: Offset = Offset.PLATE
    slabs: tuple[float, ...] = ()

    @classmethod
    def of(cls, settings: DoubleFrustum) -> CameraGeometry:
        """Return the geometry of some settings."""
        return cls(
            pivot=settings.pivot, fit=settings.fit, offset=settings.offset, slabs=tuple(settings.slabs)
        )

    def with_depth(self, near: float, depth: DepthFormat, mapping: DepthMapping) -> DoubleFrustum:
        """Return the settings of this geometry with a near and a depth buffer."""
        return DoubleFrustum(
            near=near,
            depth=depth,
            mapping=mapping,
            pivot=self.pivot,
            fit=self.fit,
            offset=self.offset,
            slabs=self.slabs,
        )

    def admits(self, near: float, frustum: Frustum) -> bool:
        """Return whether a near lies before the first cut, as it must where cameras do not step back."""
        return self.offset is Offset.PLATE or near < min((*self.slabs, *frustum.reach))

    @property
    def described(self) -> str:
        """What is not usual about it, in words, such as `pivot camera, no offset`; empty if all is usual."""
        usual = CameraGeometry()
        return ", ".join(
            words for name, words in self._words() if getattr(self, name) != getattr(usual, name)
        )

    def named_by(self, varied: Iterable[str]) -> str:
        """Return the words for some of its fields."""
        chosen = set(varied)
        return ", ".join(words for name, words in self._words() if name in chosen)

    def _words(self) -> list[tuple[str, str]]:
        match self.fit:
            case None:
                fit = "usual fit"
            case Fit():
                fit = f"fit {self.fit}"
            case height:
                fit = f"fit {digits(height)}"
        cuts = " and ".join(digits(height) for height in self.slabs)
        return [
            ("pivot", f"pivot {self.pivot}"),
            ("fit", fit),
            ("offset", "no offset" if self.offset is Offset.NONE else "offset to the plate"),
            ("slabs", f"cuts at {cuts}" if cuts else "no cuts"),
        ]


def geometries_of(settings: Iterable[DoubleFrustum]) -> tuple[CameraGeometry, ...]:
    """Return the geometries of some settings, each once, in the order in which they first occur."""
    return tuple(dict.fromkeys(CameraGeometry.of(one) for one in settings))


def geometry_names(geometries: Sequence[CameraGeometry]) -> dict[CameraGeometry, str]:
    """Return a name of each geometry, which tells it from the others; a single one may have an empty name."""
    varied = [
        name
        for name in ("pivot", "fit", "offset", "slabs")
        if len({getattr(one, name) for one in geometries}) > 1
    ]
    if not varied:
        return {one: one.described for one in geometries}
    return {one: one.named_by(varied) for one in geometries}


def geometry_grid(
    frustum: Frustum,
    pivots: Iterable[Pivot] | None = None,
    fits: Iterable[Fit | float] | None = None,
    offsets: Iterable[Offset] | None = None,
    slabs: Iterable[tuple[float, ...]] | None = None,
) -> tuple[CameraGeometry, ...]:
    """Return every combination of pivot, fit, offset and cuts, each once: the cuts change fastest.

    Parameters
    ----------
    frustum
        Frustum whose kind decides the pivots where none are given: both of a recentered frustum, but
        `aperture` alone of cameras without an offset, whose own centers are the aperture; and `aperture`
        alone of a centered frustum, which has no shear.
    pivots, fits, offsets, slabs
        Values as `DoubleFrustum` takes them; the usual one where None.
    """
    both = frustum.recentered and pivots is None
    usual = tuple(Pivot) if both else (Pivot.APERTURE,)
    product = itertools.product(
        usual if pivots is None else pivots,
        (None,) if fits is None else fits,
        (Offset.PLATE,) if offsets is None else offsets,
        ((),) if slabs is None else slabs,
    )
    # Made as settings first, which take names for values and refuse what makes no sense.
    return geometries_of(
        DoubleFrustum(near=1.0, pivot=pivot, fit=fit, offset=offset, slabs=tuple(cuts))
        for pivot, fit, offset, cuts in product
        if not (both and pivot is Pivot.CAMERA and offset == Offset.NONE)
    )
