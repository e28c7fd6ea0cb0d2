"""Evidence from a renderer's images: claims of pixels, and the test set of candidate models.

A claim is a pixel and the triangle that it names; a failed claim has a distance in pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from xfrustum.compare.error_maps import covered_by
from xfrustum.compare.judging.judged import Judging, wrong_pixels
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    COMPOSITION_FIELDS,
    EVEN,
    GROUPS,
    OTHER_FIELDS,
    RendererModel,
    field_of,
)
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.images import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

# Size of the triangle that represents a claimed point, relative to the point's largest coordinate.
# It equals the float32 rounding of stored points.
POINT_SIZE = 2.0**-24

# Largest number of claims taken from one hogel, so that no hogel dominates the fit. Three hogels
# give more than `MAX_BOUNDING_CLAIMS`.
MAX_HOGEL_CLAIMS = 6000

# Smallest depth of a visible surface, as a fraction of near: halfway between the near plane, where
# drawing begins, and the camera, where projection is undefined.
MIN_DEPTH_PER_NEAR = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelClaims:
    """Pixels and the triangles that they claim to show.

    Small triangles represent claimed points. Claimed points are in the renderer's scene, which may
    be moved or scaled; claimed triangles are in the nominal scene.
    """

    scene: Scene
    hogel: Indices  # (N, 2) column and row of the aperture in the file's name
    pixel: Indices  # (N, 2) column and row of the pixel in the file
    corners: Floats  # (N, 3, 3) corners of the triangles, scene units
    of_points: bool

    def __len__(self) -> int:
        """Return the number of claims."""
        return len(self.hogel)

    def chosen(self, index: Indices | Mask) -> PixelClaims:
        """Return the claims at these indices."""
        names = ("hogel", "pixel", "corners")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def thinned(self, count: int) -> PixelClaims:
        """Return at most `count` claims, drawn at random with a fixed seed."""
        if len(self) <= count:
            return self
        some = np.random.default_rng(0).choice(len(self), count, replace=False)
        return self.chosen(np.sort(some))


def claims_of(scene: Scene, images: Sequence[HogelImage]) -> PixelClaims:
    """Collect claims at the outlines of triangles, because outlines reveal small displacements.

    If an image names no triangles, its surface points are the claims.
    """
    hogels, pixels, corners, of_points = [], [], [], True
    for image in images:
        named = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        points = not named.any()
        if points:
            stated = np.isfinite(image.position).all(axis=-1) & (image.height != 0)
        else:
            # Pixels next to another triangle or to the image's border.
            padded = np.pad(image.triangle, 1, constant_values=NOTHING - 1)
            neighbors = (padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1])
            stated = named & np.any([image.triangle != other for other in neighbors], axis=0)
        places = np.argwhere(stated)
        if (count := len(places)) > MAX_HOGEL_CLAIMS:
            some = np.random.default_rng(count).choice(count, MAX_HOGEL_CLAIMS, replace=False)
            places = places[np.sort(some)]
        rows, columns = places.T
        if points:
            there = image.position[rows, columns].astype(np.float64)
            size = POINT_SIZE * np.abs(there).max(axis=1, initial=0.0)
            around = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.0], [-0.5, -0.75, 0.0]])
            corners.append(there[:, None] + size[:, None, None] * around)
        else:
            corners.append(scene.triangles[image.triangle[rows, columns]])
        of_points &= points
        hogels.append(np.tile(np.array(image.camera.aperture.index, np.int64), (len(places), 1)))
        pixels.append(places[:, ::-1])
    return PixelClaims(
        scene=scene,
        hogel=np.concatenate(hogels),
        pixel=np.concatenate(pixels),
        corners=np.concatenate(corners),
        of_points=of_points,
    )


def outside_px(claims: PixelClaims, model: RendererModel, cap: float) -> Floats:
    """Return the distance of pixel centers outside their triangles, at most `cap` px, (N,)."""
    return np.asarray(np.minimum(inside_px(claims, model)[1].min(axis=0), cap))


def inside_px(claims: PixelClaims, model: RendererModel) -> tuple[Floats, Floats]:
    """Return distances of pixel centers from their triangles' edges, and from their triangles.

    Both are in px, for the projections of C and of C*. Distances from edges, (2, N, 3), are
    positive inside and negative outside. Distances from triangles, (2, N), are 0 inside, and
    infinite behind the camera.
    """
    scene, (width, height) = claims.scene, claims.scene.frustum.resolution
    (columns, rows), (sx, sy) = scene.plate.hogels, scene.plate.size
    column, row = model.order.cells(claims.hogel[:, 0], claims.hogel[:, 1], (columns, rows))
    apertures = (column + 0.5) * sx / columns - sx / 2, sy / 2 - (row + 0.5) * sy / rows
    column, row = model.orientation.cells(claims.pixel[:, 0], claims.pixel[:, 1], (width, height))
    u, v = (2 * column + 1) / width - 1, 1 - (2 * row + 1) / height
    # Axes are coordinate, corner, claim, so that all operations below are on whole arrays.
    (px, py, z), following = claims.corners.transpose(2, 1, 0), [1, 2, 0]
    two = [Aperture(column=0, row=0, x=place, y=place) for place in (0.0, 1.0)]
    distances, outsides = [], []
    distance = depth = np.empty(0)
    for side in (1, -1):
        if side < 0 and model.one_pencil:
            # C* has the same lines in the opposite direction: homogeneous coordinates change sign.
            distance, depth = -distance, -depth
        else:
            # Step 1: homogeneous film coordinates of the corners, (3, N). Center and shear of a ray
            # bundle are affine functions of the aperture's position along the same axis, so that
            # two bundles determine all bundles.
            entry, other = (model.bundle(scene, aperture, side) for aperture in two)
            w = side * (entry.center[2] - z)
            x, y = (
                (side * (p - c - (c1 - c) * a) - (k + (k1 - k) * a) * w) / t
                for p, a, c, c1, k, k1, t in zip(
                    *((px, py), apertures, entry.center[:2], other.center[:2]),
                    *(entry.shear, other.shear, entry.half_extent),
                    strict=True,
                )
            )
            # Step 2: the three edges as lines on the film, by cross products of corners. `values`
            # are the line equations at the pixel's center, `volume` is the determinant of the
            # corners.
            x_next, y_next, w_next = x[following], y[following], w[following]
            line_x = y * w_next - w * y_next
            line_y = w * x_next - x * w_next
            line_1 = x * y_next - y * x_next
            across, up = (u, v) if model.film == EVEN else model.film.bent(u, v, entry.half_extent)
            values = line_x * across + line_y * up + line_1
            volume = line_x[0] * x[2] + line_y[0] * y[2] + line_1[0] * w[2]
            # Step 3: divide by the gradient, for a distance in pixels. The depth of the triangle's
            # plane at the point follows from the same quantities. Multiply by the sign of the
            # determinant, so that distances are positive inside.
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = values / np.hypot(line_x * 2 / width, line_y * 2 / height)
                depth = volume / values.sum(axis=0) * model.scene_scale
                distance *= np.sign(volume)
        outside = np.maximum(0.0, -distance.min(axis=0))
        seen = np.isfinite(outside) & (depth > MIN_DEPTH_PER_NEAR * model.camera(side).near)
        distances.append(distance.T)
        outsides.append(np.where(seen, outside, np.inf))
    return np.stack(distances), np.stack(outsides)


MIN_EXPLAINED_FRACTION = 0.9
"""Smallest share of the wrong pixels that a diagnosis must explain.

Under the renderer's true conventions only pixels at outlines are wrong, by rounding, and these are
excused if images have triangle numbers. The remaining tenth allows for pictures without numbers,
whose outlines are not excused, and for a small second defect. A wrong candidate leaves most of the
wrong pixels unexplained."""

# Largest number of right pixels that a diagnosis may make wrong without a known cause, relative to
# the wrong pixels that it makes right. The renderer's true conventions make none wrong. If a defect
# of one camera or object is attributed to all of them, right pixels become wrong.
MAX_SPOILED_FRACTION = 0.02

# Largest number of tested hogels, spread over the sample. Each has thousands of pixels, so that a
# share measured in one hogel is within a few percent of the share in all hogels.
MAX_TESTED_HOGELS = 9

# Smallest net gain of a defect: the pixels that it makes right minus the pixels that it makes
# wrong, in standard deviations of this difference for random changes.
MIN_GAIN_DEVIATIONS = 2.0

# Share of wrong pixels among the covered pixels above which gross mistakes are tried: if a scene is
# scaled by ten, nearly all covered pixels are wrong.
GROSS_WRONG_FRACTION = 0.5

# Share of pixels that are wrong without a known cause, above which a hogel is an outlier.
MIN_OUTLYING_FRACTION = 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class TestSet:
    """Images by which candidate models are tested.

    `images` are decoded hogels of the renderer, before any correction, each with the camera of the
    aperture in its file's name. `nominal` is the model of the renderer according to its author:
    pixels that are wrong under this model need an explanation.
    """

    __test__: ClassVar[bool] = False  # keeps pytest from collecting this class

    reference: Reference
    images: Sequence[HogelImage]
    nominal: RendererModel
    judging: Judging = field(default_factory=Judging)
    #: cache of wrong pixels (N, H, W), by candidate and by whether causes excuse pixels
    masks: dict[tuple[RendererModel, bool], Mask] = field(default_factory=dict, repr=False)

    def of(self, images: Sequence[HogelImage], judging: Judging | None = None) -> TestSet:
        """Return a test set of other images of the renderer, with other rules if given."""
        return replace(self, images=images, judging=judging or self.judging, masks={})

    def few(self) -> TestSet:
        """Return a test set of only the first and the last tested image, to select candidates."""
        return self.of(self.tested[:: max(1, len(self.tested) - 1)])

    @property
    def tested(self) -> list[HogelImage]:
        """At most `MAX_TESTED_HOGELS` images, spread evenly over all images."""
        return spread(self.images, MAX_TESTED_HOGELS)

    @property
    def _covered(self) -> Mask:
        """Mask (N, H, W) of pixels at which the tested images show a surface."""
        colored = [image.color is not None and shows_something(image) for image in self.tested]
        pairs = zip(map(covered_by, self.tested), colored, strict=True)
        return np.stack([covered | color for covered, color in pairs])

    @property
    def infeasible(self) -> bool:
        """True if most of the covered pixels are wrong; False if no pixel is covered."""
        speaking = np.array([shows(image) for image in self.tested])
        shown = int(self._covered[speaking].sum()) if speaking.any() else 0
        return bool(shown) and self.wrong(self.nominal) > GROSS_WRONG_FRACTION * shown

    def mask(self, model: RendererModel, *, explained: bool = False) -> Mask:
        """Return a candidate's wrong pixels (N, H, W); `explained` omits pixels with a cause."""
        if (model, explained) not in self.masks:
            pairs = [
                wrong_pixels(self.reference, model, image, self.judging, explained=explained)
                for image in self.tested
            ]
            for place, excused in enumerate((False, explained)):
                masks = [model.orientation.applied(pair[place]) for pair in pairs]
                self.masks[model, excused] = np.array(masks, dtype=np.bool_)
        return self.masks[model, explained]

    def wrong(self, model: RendererModel, *, explained: bool = False) -> int:
        """Count a candidate's wrong pixels; if `explained`, only pixels without a known cause."""
        return int(self.mask(model, explained=explained).sum())

    def outliers(self, model: RendererModel) -> Iterator[TestSet]:
        """Yield each hogel in which a candidate leaves many wrong pixels without a cause."""
        many = MIN_OUTLYING_FRACTION * np.prod(self.reference.scene.frustum.resolution)
        alone = (self.of([image]) for image in self.images)
        return (test for test in alone if test.wrong(model, explained=True) > many)

    def leaves_outliers(self, model: RendererModel) -> bool:
        """Return whether a candidate leaves any hogel with many wrong pixels without a cause."""
        return any(True for _ in self.outliers(model))

    def share(self, model: RendererModel) -> float | None:
        """Return the share of wrong pixels that a candidate explains; None if no pixel is wrong.

        A pixel is explained if it is wrong under the nominal model, and under the candidate either
        right or wrong by a cause that is not a defect: edge, order, lost. Pixels that only the
        candidate makes wrong count against it. The share is computed over all pixels and over
        covered pixels, and the smaller share is returned: a candidate without visible surfaces
        explains black pixels, but no covered pixels.
        """
        before, after = self.mask(self.nominal), self.mask(model, explained=True)
        if not before.any():
            return None
        covered = self._covered
        counts = [(before.sum(), after.sum()), ((before & covered).sum(), (after & covered).sum())]
        return float(max(0.0, min(1 - left / wrong for wrong, left in counts if wrong)))

    def explains(self, model: RendererModel) -> bool:
        """Return whether a candidate explains enough for a diagnosis, or no pixel is wrong."""
        share = self.share(model)
        return share is None or share >= MIN_EXPLAINED_FRACTION

    def spares(self, model: RendererModel) -> bool:
        """Return whether right pixels of the nominal model stay right, except by rounding."""
        # Only triangle numbers separate rounding from errors. Other images are judged only by
        # `share`.
        named = [bool((image.triangle != NOTHING).any()) for image in self.tested]
        before, after = self.mask(self.nominal)[named], self.mask(model)[named]
        spoiled = self.mask(model, explained=True)[named] & ~before
        return bool(spoiled.sum() <= MAX_SPOILED_FRACTION * (before & ~after).sum())

    def pays(self, model: RendererModel, simpler: RendererModel | None = None) -> bool:
        """Return whether a candidate has fewer wrong pixels than a simpler one, or than nominal."""
        mine, other = self.mask(model), self.mask(simpler or self.nominal)
        gained, lost = int((other & ~mine).sum()), int((mine & ~other).sum())
        return bool(gained - lost > MIN_GAIN_DEVIATIONS * np.sqrt(gained + lost))

    def reduced(self, model: RendererModel) -> RendererModel:
        """Return a candidate without the defects that do not improve its explanation."""
        while True:
            simpler = list(self._simpler(model))
            rest = [candidate for candidate in simpler if not self.pays(model, candidate)]
            # The last defect remains: `share` determines whether it is a diagnosis.
            if not rest or len(simpler) == 1:
                return model
            model = min(rest, key=self.wrong)

    def _simpler(self, model: RendererModel) -> Iterator[RendererModel]:
        """Yield, for each defect of a candidate, the candidate without it."""
        groups: list[tuple[str, ...]] = [(field_of(group),) for group in GROUPS if group != "near"]
        groups += [(name,) for name in ("orientation", "order", "recentering", "pivot", "fit")]
        groups += [("film",), COMPOSITION_FIELDS]
        groups += [("near", "pivot", "fit")] if model.near != self.nominal.near else []
        groups += [("one_camera", *CAMERA_GROUPS)] if model.one_camera is not None else []
        groups += [(name,) for name in OTHER_FIELDS]
        for fields in groups:
            simpler = replace(model, **{name: getattr(self.nominal, name) for name in fields})
            if simpler != model:
                yield simpler


def spread(images: Sequence[HogelImage], most: int) -> list[HogelImage]:
    """Return at most `most` images, spread evenly over all."""
    chosen = np.linspace(0, len(images) - 1, min(len(images), most)).astype(int)
    return [images[index] for index in dict.fromkeys(chosen.tolist())]


def shows(image: HogelImage) -> bool:
    """Return whether an image names a triangle or an object, or has colors."""
    named = (image.triangle != NOTHING).any() or (image.object != NOTHING).any()
    return bool(named or image.color is not None)
