"""Rounding of a device, measured from its fingerprint, and checks of a model against it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from xfrustum.compare.rounding.depth import STEP, Planes
from xfrustum.compare.rounding.triangles import CLIPPED_VERTEX_ROUNDINGS, FLOAT32_ROUNDING
from xfrustum.raster.device.context import is_software
from xfrustum.raster.device.fingerprint import SIZE, Fingerprint
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import KNOWN, SIXTEENTH, DeviceModel, Range, safe_model
from xfrustum.scenes.plate import DepthFormat

FIXED = (DepthFormat.D16, DepthFormat.D24)
LARGEST = {DepthFormat.D16: 2**16 - 1, DepthFormat.D24: 2**24 - 1}
"""The stored number that represents a depth of one."""

MOST_SUBPIXEL_BITS, MOST_FILTER_BITS = 12, 12
"""The finest grids of the search. Exact filter weights are odd multiples of 2^-13, a finer grid."""

FILTER_ROUNDINGS = 4
"""Roundings of 2^-24 in the weight of one of two filtered texels.

The coordinate from 0 to 1, its product with the number of texels, the subtraction of one half, and
the mean are rounded once each."""

PLANE_NOISE = 1.5
"""Deviation from a plane, in roundings, above which the device rounds the steps of the plane.

The measured deviation is 1.01 on an H100 and 2.00 on llvmpipe."""

LEAST_OF_PLANE = 20
"""Smallest number of pixels of a triangle to which a plane, with three unknowns, is fitted."""

NEAREST_EVEN = "nearest, half to even"
ROUNDED: dict[str, Callable[[Floats], Floats]] = {
    NEAREST_EVEN: np.round,
    "nearest, half up": lambda places: np.floor(places + 0.5),
    "nearest, half down": lambda places: np.ceil(places - 0.5),
    "cut off": np.floor,
}
"""Ways to round window positions to the subpixel grid."""

TIES = ("left and bottom", "left and top", "right and bottom", "right and top")
"""Rules for pixel centers on an edge: the sides on which they belong to the triangle."""


@dataclass(frozen=True, kw_only=True)
class Within:
    """Number of a device's measured values that lie between the bounds of a model."""

    pixels: int
    #: number of values between the bounds
    within: int
    #: median ratio of the tolerances to the tolerances of an unmeasured device
    share_of_safe: float

    @classmethod
    def from_ratio(cls, inside: Mask, ratio: Floats | float) -> Within:
        """Count pixels (N,) inside the bounds; the share is 1 if there are no pixels."""
        share = float(np.median(ratio)) if len(inside) else 1.0
        return cls(pixels=len(inside), within=int(inside.sum()), share_of_safe=share)


@dataclass(frozen=True, kw_only=True)
class DepthSteps:
    """Ranges of the difference of stored and exact depth of a format, in steps."""

    written_steps: Range
    interpolated_steps: Range


@dataclass(frozen=True, kw_only=True)
class DeviceRecord:
    """Measurements of a device: the record of `device --json`, and of `device.json`."""

    renderer: str
    version: str
    software: bool
    subpixel_bits: int
    snaps_depth: bool
    depth: dict[str, DepthSteps]
    filter_bits: int | None
    plane_noise: float | None
    ties: dict[str, int]
    viewport: dict[str, int]
    cut_from_px: float | None
    varyings: dict[str, float]
    #: numbers of trials
    tried: dict[str, Any]
    within: dict[str, Within]
    #: model by which pixels are explained
    model: dict[str, Any]


class Measured:
    """Measurements from a device's fingerprint."""

    def __init__(self, fingerprint: Fingerprint) -> None:
        self.fingerprint = fingerprint

    @cached_property
    def model(self) -> DeviceModel:
        """Model of the device from measurements only."""
        fixed = {depth.value: self.stored_range(depth) for depth in FIXED}
        return DeviceModel(
            name=self.fingerprint.device["renderer"],
            subpixel_bits=self.subpixel_bits,
            snaps_depth=self.snaps_depth,
            rounds_planes=self.plane_noise > PLANE_NOISE,
            filter_bits=self.filter_bits,
            **fixed,
        )

    @cached_property
    def known(self) -> DeviceModel:
        """The recorded model of the device; the measured model if none is recorded."""
        names = (name for name in KNOWN if name in self.fingerprint.device["renderer"])
        return next((KNOWN[name] for name in names), self.model)

    @cached_property
    def subpixel_bits(self) -> int:
        """Subpixel bits that explain coverage best, at most the bits that the device reports."""
        reported = min(int(self.fingerprint.device["subpixel_bits"]), MOST_SUBPIXEL_BITS)
        counts = {
            bits: min(self._differs(bits, NEAREST_EVEN).values()) for bits in range(reported + 1)
        }
        return min(counts, key=lambda bits: (counts[bits], -bits))

    @cached_property
    def viewport(self) -> dict[str, int]:
        """Number of wrong pixels for each rounding of corners to the grid, by its best tie rule."""
        return {name: min(self._differs(self.subpixel_bits, name).values()) for name in ROUNDED}

    @cached_property
    def ties(self) -> dict[str, int]:
        """Number of wrong pixels by each of the best tie rules, for the best way of rounding."""
        counts = self._differs(
            self.subpixel_bits, min(self.viewport, key=self.viewport.__getitem__)
        )
        return {rule: count for rule, count in counts.items() if count == min(counts.values())}

    @cached_property
    def cut_from_px(self) -> float | None:
        """Smallest distance of a corner of a cut triangle from the middle of the window, pixels.

        Cut triangles have new corners, which are snapped, so that pixels along the edges differ
        from the pixels of the whole triangle. None if no triangle is cut.
        """
        whole = self._covers(self.subpixel_bits, NEAREST_EVEN)[next(iter(self.ties))]
        # Only triangles that extend beyond the window can be cut.
        cut = self._reach[(whole != self.fingerprint.covered).any(axis=(1, 2))]
        return float(cut.min()) if len(cut) else None

    @cached_property
    def snaps_depth(self) -> bool:
        """True if stored depths are nearer to planes through snapped than through exact corners."""
        off = [np.abs(self._off_planes(snapped=snapped)) for snapped in (False, True)]
        # Use medians, because slivers have errors of any size on both kinds of planes.
        return bool(np.median(off[1]) < np.median(off[0]))

    @cached_property
    def plane_noise(self) -> float:
        """Median deviation of a triangle's depths from the plane fitted to them, in roundings.

        If corners and gradient have errors, depths still form a plane, and the fit removes it. A
        rounding to multiples of 2^-24 has a variance of a twelfth of a unit squared.
        """
        which, points, stored = self._stored(DepthFormat.D32F, self._uncut)
        off, roundings = self._off_planes(snapped=self.snaps_depth), []
        for number in np.unique(which):
            # From 0.5 to 1 the spacing of float32 is 2^-24.
            here = (which == number) & (stored >= 0.5)
            if (count := int(here.sum())) >= LEAST_OF_PLANE:
                # The fit removes any plane that the device interpolates; the rounding remains.
                rest = np.linalg.lstsq(points[here], off[here], rcond=None)[1]
                roundings.append(12 * float(rest.sum()) / (count - 3))
        return float(np.median(roundings)) if roundings else np.inf

    @cached_property
    def filter_bits(self) -> int | None:
        """Bits of the weights of a bilinear filter; None for more than `MOST_FILTER_BITS`."""
        for bits in range(MOST_FILTER_BITS + 1):
            scaled = self.fingerprint.filtered.astype(np.float64) * 2.0**bits
            # Weights on a grid of 2^-bits are integers after scaling; the coarsest such grid
            # counts.
            if np.array_equal(scaled, np.round(scaled)):
                return bits
        return None

    def written_steps(self, depth: DepthFormat) -> Range:
        """Return the range of the difference of stored and written depth, in steps."""
        wrote, kept = self._written(depth)
        off = kept - wrote * LARGEST.get(depth, 1)
        return _ends(off if depth in FIXED else off / FLOAT32_ROUNDING)

    def _written(self, depth: DepthFormat) -> tuple[Floats, Floats]:
        """Return written depths (N,), 0 to 1, and the stored values."""
        wrote, kept = self.fingerprint.written[depth]
        # Values beyond one are clamped; negative values and NaN are not depths.
        valid = (wrote >= 0) & (wrote <= 1)
        return wrote[valid].astype(np.float64), kept[valid].astype(np.float64)

    def interpolated_steps(self, depth: DepthFormat) -> Range:
        """Return the range of the difference of stored and interpolated depth, in steps."""
        return _ends(self._off_planes(snapped=self.snaps_depth, depth=depth))

    def varyings(self) -> dict[str, float]:
        """Return, by interpolation mode, the largest error of varyings with three equal corners."""
        corners, fragment = self.fingerprint.varyings, self.fingerprint.fragment
        equal = (corners == corners[:, :1]).all(axis=(1, 2))
        shown = self.fingerprint.drawn & equal[:, None, None]
        pictures = {
            "smooth": fragment[..., 2:],
            "noperspective": self.fingerprint.others[..., :2],
            "flat": self.fingerprint.others[..., 2:],
        }
        expected = corners[np.nonzero(shown)[0], 0]
        return {
            name: float(np.nanmax(np.abs(values[shown].astype(np.float64) - expected), initial=0.0))
            for name, values in pictures.items()
        }

    def within(self, model: DeviceModel, depth: DepthFormat = DepthFormat.D32F) -> Within:
        """Compare the stored depths of all triangles with the bounds of a model."""
        which, points, stored = self._stored(depth, self.fingerprint.drawn)
        planes = self._planes
        exact = planes.exact(which, points)
        step, (low, high), unknown = (
            STEP[depth],
            model.stored(depth),
            safe_model(model.subpixel_bits),
        )
        # Storing in float32 is one more rounding.
        kept = FLOAT32_ROUNDING * np.abs(exact)
        tolerance = planes.tolerance(which, points, model) + kept + step * (high - low) / 2
        safe = planes.tolerance(which, points, unknown) + kept + step * unknown.stored(depth)[1]
        # Clipped depths lie between zero and one, and are clamped to that range.
        inside = np.abs(stored - np.clip(exact, 0.0, 1.0) - step * (high + low) / 2) <= tolerance
        return Within.from_ratio(inside, tolerance / safe)

    def varyings_within(self, model: DeviceModel) -> Within:
        """Compare the smooth varyings of all triangles with the bounds of a model."""
        which, points, _ = self._stored(DepthFormat.D32F, self.fingerprint.drawn)
        safe, off, bounds = safe_model(model.subpixel_bits), [], []
        for number in range(2):
            corners = self.fingerprint.varyings[..., number].astype(np.float64)
            exact, tolerance = self._planes.varying(corners, which, points, model)
            drawn = self.fingerprint.fragment[..., 2 + number][self.fingerprint.drawn]
            off.append(np.abs(drawn - exact) <= tolerance)
            bounds.append(tolerance / self._planes.varying(corners, which, points, safe)[1])
        return Within.from_ratio(off[0] & off[1], np.array(bounds))

    def filtered_within(self, model: DeviceModel) -> Within:
        """Compare filter weights, measured on texels of 0 and 1, with the bounds of a model."""
        filtered = self.fingerprint.filtered
        exact = (np.arange(len(filtered)) + 0.5) / len(filtered)
        bound, safe = (
            bounded.filter_rounding + FILTER_ROUNDINGS * FLOAT32_ROUNDING
            for bounded in (model, safe_model())
        )
        return Within.from_ratio(np.abs(filtered - exact) <= bound, bound / safe)

    @property
    def record(self) -> DeviceRecord:
        """The measurements, and the model by which pixels are explained."""
        fingerprint, model = self.fingerprint, self.known
        within = {depth.value: self.within(model, depth) for depth in DepthFormat}
        within["varyings"] = self.varyings_within(model)
        within["filter"] = self.filtered_within(model)
        steps = {
            depth.value: DepthSteps(
                written_steps=self.written_steps(depth),
                interpolated_steps=self.interpolated_steps(depth),
            )
            for depth in DepthFormat
        }
        return DeviceRecord(
            renderer=fingerprint.device["renderer"],
            version=fingerprint.device["version"],
            software=is_software(fingerprint.device["renderer"]),
            subpixel_bits=self.subpixel_bits,
            snaps_depth=self.snaps_depth,
            depth=steps,
            filter_bits=self.filter_bits,
            plane_noise=self.plane_noise if np.isfinite(self.plane_noise) else None,
            ties=self.ties,
            viewport=self.viewport,
            cut_from_px=self.cut_from_px,
            varyings=self.varyings(),
            tried={
                "triangles": len(fingerprint.vertices),
                "pixels": int(fingerprint.drawn.sum()),
                "edges": len(fingerprint.edge_vertices),
                "edges_in_window": int((self._reach <= SIZE / 2).sum()),
                "reach_px": float(self._reach.max()),
                "written": {d.value: len(wrote) for d, (wrote, _) in fingerprint.written.items()},
                "filtered": len(fingerprint.filtered),
            },
            within=within,
            model=model.as_json(),
        )

    @cached_property
    def _planes(self) -> Planes:
        corners = self.fingerprint.vertices.astype(np.float64)
        from_zero = self.fingerprint.zero_to_one[:, None]
        w, z = corners[..., 3], corners[..., 2]
        value = np.where(from_zero, z, (z + w) / 2)
        # The recorded clip coordinates are float32 numbers. Only clipping rounds them further.
        moved = CLIPPED_VERTEX_ROUNDINGS * FLOAT32_ROUNDING * np.abs(corners)
        return Planes(
            vertices=corners[..., (0, 1, 3)],
            value=value,
            moved=moved[..., (0, 1, 3)],
            moved_value=np.where(from_zero, moved[..., 2], (moved[..., 2] + moved[..., 3]) / 2),
            uncut=np.asarray(((value >= 0) & (value <= w)).all(axis=1)),
            largest=np.ones(len(corners)),
            resolution=(SIZE, SIZE),
        )

    @cached_property
    def _uncut(self) -> Mask:
        """(T, 64, 64) pixels of uncut triangles whose snapped corners span an area."""
        solid = np.isfinite(self._snapped.gradient).all(axis=1)
        return np.asarray(self.fingerprint.drawn & (self._planes.uncut & solid)[:, None, None])

    def _stored(self, depth: DepthFormat, where: Mask) -> tuple[Indices, Floats, Floats]:
        """Return triangle, film point and stored depth, 0 to 1, of pixels."""
        which, row, column = np.nonzero(where)
        # Rows of a fingerprint count upward.
        u, v = (2 * column + 1) / SIZE - 1, (2 * row + 1) / SIZE - 1
        stored = self.fingerprint.stored[depth][where].astype(np.float64) / LARGEST.get(depth, 1)
        return which, np.stack((u, v, np.ones(len(u))), axis=-1), stored

    @cached_property
    def _snapped(self) -> Planes:
        """Planes through snapped corners."""
        w, per_film = self._planes.vertices[..., 2:], SIZE / 2 * 2.0**self.subpixel_bits
        places = np.round(self._planes.vertices[..., :2] / w * per_film) / per_film
        return replace(self._planes, vertices=np.concatenate((places * w, w), axis=-1))

    def _off_planes(self, *, snapped: bool, depth: DepthFormat = DepthFormat.D32F) -> Floats:
        """Return stored minus exact depths of `_uncut` in steps, 2^-24 for D32F."""
        which, points, stored = self._stored(depth, self._uncut)
        exact = (self._snapped if snapped else self._planes).exact(which, points)
        return np.asarray((stored - exact) / (STEP[depth] or FLOAT32_ROUNDING))

    def stored_range(self, depth: DepthFormat) -> Range:
        """Return the error range of stored float32 depths, to sixteenths of a step.

        Before a depth is stored, its product with the number of steps is rounded to float32. The
        range excludes this rounding.
        """
        drawn, (wrote, kept) = self.fingerprint.drawn, self._written(depth)
        fragments = self.fingerprint.fragment[..., 0][drawn].astype(np.float64)
        values: Floats = np.concatenate((fragments, wrote))
        off = (
            np.concatenate((self.fingerprint.stored[depth][drawn], kept)) - values * LARGEST[depth]
        )
        product = FLOAT32_ROUNDING * values * LARGEST[depth]
        low, high = float((off + product).min()), float((off - product).max())
        # Round outward, because the model must contain all measurements.
        sixteenths = np.ceil(np.array([-low, high]) / SIXTEENTH - 2.0**-10) * SIXTEENTH
        return min(-0.5, -float(sixteenths[0])), max(0.5, float(sixteenths[1]))

    @cached_property
    def _reach(self) -> Floats:
        """(E,) distances of the farthest corners from the window's middle along an axis, pixels."""
        return np.asarray(
            np.abs(self.fingerprint.edge_vertices[..., :2]).max(axis=(1, 2)) * (SIZE / 2)
        )

    def _differs(self, bits: int, rounding: str) -> dict[str, int]:
        """Return the number of wrong pixels by each tie rule, for one way of snapping corners.

        Triangles that extend beyond the window are left out: some devices cut them at the border.
        """
        whole, covered = self._reach <= SIZE / 2, self.fingerprint.covered
        return {
            rule: int((covers != covered)[whole].sum())
            for rule, covers in self._covers(bits, rounding).items()
        }

    def _covers(self, bits: int, rounding: str) -> dict[str, Mask]:
        """Return the covered pixels (E, 64, 64) by each tie rule for one way of snapping.

        Snapped corners are multiples of a grid step, and products of their coordinates have at most
        53 bits: the result is exact.
        """
        corners, grid = self.fingerprint.edge_vertices[..., :2].astype(np.float64), 2.0**bits
        places = ROUNDED[rounding]((corners + 1) / 2 * SIZE * grid) / grid
        rows, columns = np.mgrid[0:SIZE, 0:SIZE] + 0.5
        (x, y), (right, up) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
        # Clockwise triangles are turned around; triangles without area cover nothing.
        turned = np.sign(x * up - y * right)[:, None]
        covers = dict.fromkeys(
            TIES, np.broadcast_to(turned[..., None] != 0, self.fingerprint.covered.shape)
        )
        for i in range(3):
            corner, along = places[:, i], (places[:, (i + 1) % 3] - places[:, i]) * turned
            (x, y), (right, up) = corner.T[:, :, None, None], along.T[:, :, None, None]
            side = right * (rows - y) - up * (columns - x)
            # Triangles are counterclockwise and rows count up: left sides go down, bottom sides go
            # right.
            for rule in TIES:
                left, bottom = (up < 0) == ("left" in rule), (right > 0) == ("bottom" in rule)
                owns = np.where(up != 0, left, bottom)
                covers[rule] = covers[rule] & ((side > 0) | ((side == 0) & owns))
        return covers


def _ends(values: Floats) -> Range:
    return float(values.min()), float(values.max())
