"""Frames recorded on any machine, explained by the model of the device that drew them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from xfrustum.compare.attribution import drawing_cameras, explain
from xfrustum.compare.rounding.causes import HEADINGS
from xfrustum.compare.rounding.edges import per_pixel
from xfrustum.compare.rounding.triangles import PixelTriangles
from xfrustum.reference import Reference
from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.disk import check_picture_size, read_arrays
from xfrustum.scenes.library.builtin import open_scene
from xfrustum.scenes.model.device_model import DeviceModel, Digits, model_of
from xfrustum.scenes.model.images import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DoubleFrustum


@dataclass(frozen=True, kw_only=True)
class RecordedFrame:
    """One frame, named `scene|near/reach|depth|mapping|column,row`."""

    name: str
    #: (H, W) drawn triangle numbers, `NOTHING` without a surface
    triangle: Numbers

    @property
    def scene(self) -> str:
        """Name of the drawn scene."""
        return self.name.split("|")[0]

    def question(self, scene: Scene) -> tuple[Aperture, DoubleFrustum]:
        """Return the aperture and the settings that the frame shows."""
        try:
            _, near, depth, mapping, place = self.name.split("|")
            column, row = (int(number) for number in place.split(","))
            near_of_scene = float(near) * scene.frustum.longest_reach
        except ValueError as error:
            raise InputError(
                f"{self.name!r} names no frame; write scene|near/reach|depth|mapping|column,row"
            ) from error
        # `DoubleFrustum` checks these names.
        depth_buffer: Any = {"depth": depth, "mapping": mapping}
        settings = DoubleFrustum(near=near_of_scene, **depth_buffer)
        return scene.plate.aperture(column, row), settings


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """Differences of recorded frames from exact cameras: the record of `device --replay --json`."""

    frames: int
    #: number of pixels that differ from exact cameras: the sum of `edge`, `order`, `lost` and
    #: `unexplained`
    wrong: int
    edge: int
    order: int
    lost: int
    unexplained: int
    #: name of the device that drew
    device: str
    #: name of the model that explained the pixels
    device_model: str
    #: number of unexplained pixels by frame, for frames with unexplained pixels
    frames_unexplained: dict[str, int]


class _Device(BaseModel):
    """Names of the drawing device, as a recording stores them."""

    renderer: str
    version: str = ""
    subpixel_bits: Digits


def read_frames(path: Path) -> tuple[dict[str, str], list[RecordedFrame]]:
    """Read the device names and frames of a recording; InputError if it is not a recording."""
    arrays = read_arrays(path, "recording of frames", "give a .npz of recorded frames")
    try:
        device = _Device.model_validate_json(str(arrays.pop("device", None)))
    except ValidationError as error:
        reason = error.errors(include_url=False)[0]["msg"]
        raise InputError(
            f"{path} is no recording of frames: it names no device ({reason})"
        ) from error
    if not arrays:
        raise InputError(f"{path} has no frames")
    for triangle in arrays.values():
        if (
            triangle.ndim != 2
            or triangle.dtype.kind != "i"
            or triangle.min(initial=NOTHING) < NOTHING
        ):
            raise InputError(f"{path} is no recording of frames: they are (H, W) triangle numbers")
        check_picture_size(path, triangle.shape[1], triangle.shape[0])
    frames = [RecordedFrame(name=name, triangle=triangle) for name, triangle in arrays.items()]
    return {name: str(value) for name, value in device}, frames


def replay(
    recording: tuple[dict[str, str], list[RecordedFrame]],
    model: DeviceModel | None = None,
    begun: Callable[[RecordedFrame], object] = lambda frame: None,
) -> Replayed:
    """Explain recorded frames by a model, None for the model of their device.

    `begun` is called with each frame before it is explained.
    """
    device, frames = recording
    model = model or model_of(device)
    counts, unexplained = Counter(dict.fromkeys(HEADINGS, 0)), {}
    # A recording has few scenes and many frames of each.
    references: dict[tuple[str, tuple[int, ...]], Reference] = {}
    traced: dict[tuple[str, tuple[int, ...], float, tuple[int, int]], HogelImage] = {}
    for frame in frames:
        begun(frame)
        opened = frame.scene, frame.triangle.shape
        # Building a reference takes longer than explaining a frame.
        if opened not in references:
            scene = open_scene(frame.scene)
            frustum = replace(scene.frustum, resolution=frame.triangle.shape[::-1])
            references[opened] = Reference(replace(scene, frustum=frustum))
        reference = references[opened]
        aperture, settings = frame.question(reference.scene)
        most, count = frame.triangle.max(initial=NOTHING), len(reference.scene.faces)
        if most >= count:
            raise InputError(
                f"{frame.name} shows triangle {most}, and the scene has {count}: record it anew"
            )
        # Pictures of exact cameras are independent of the depth buffer.
        key = (*opened, settings.near, aperture.index)
        if key not in traced:
            traced[key] = reference.trace_model(aperture, settings, shaded=False)
        expected = traced[key]
        shown = recorded_image(reference.scene, expected, frame, model)
        by_heading = explain(reference.scene, expected, shown, model).counts()
        counts.update(by_heading)
        if by_heading["unexplained"]:
            unexplained[frame.name] = by_heading["unexplained"]
    return Replayed(
        frames=len(frames),
        wrong=counts.total(),
        **counts,
        device=device["renderer"],
        device_model=model.name,
        frames_unexplained=unexplained,
    )


OUTSIDE_PX = 0.05
"""Distance outside of a triangle, pixels, up to which a pixel may still belong to it.

Snapping moves edges by 2^-9 of a pixel and float32 by less than a tenth of that, except in
triangles cut beside the camera."""


def recorded_image(
    scene: Scene, expected: HogelImage, frame: RecordedFrame, model: DeviceModel
) -> HogelImage:
    """Return a frame as an image with its surface points (H, W, 3), NaN without surface.

    A recording does not name the camera of a pixel. If C* projects the triangle onto the pixel, the
    camera was C*, which is drawn last. Otherwise it was the camera for which the pixel is least
    outside the triangle.
    """
    camera = replace(expected.camera, settings=frame.question(scene)[1])
    position = np.full((*frame.triangle.shape, 3), np.nan)
    objects = scene.object_of_number[frame.triangle]
    rows, columns = np.nonzero(frame.triangle != NOTHING)
    image = replace(
        expected, camera=camera, triangle=frame.triangle, object=objects, position=position
    )
    cameras = drawing_cameras(scene, image, model)
    # Evaluate each pixel for both cameras, because the recording does not name its camera.
    slots = np.arange(len(cameras) * len(rows))
    number = frame.triangle[rows, columns].astype(np.int64)
    drawn = PixelTriangles.from_pixels(scene.triangles, cameras, number, (columns, rows), slots)
    film, side = drawn.film, np.where(drawn.film.orthoscopic, 1.0, -1.0)
    edges, (plane,) = (
        drawn.linear_at(function, drawn.points) for function in (film.lines, film.plane[None])
    )
    first, last = map(drawn.each, film.planes)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = plane * drawn.each(side / film.volume)
        # A surface beyond a cut plane is not drawn: use the nearest depth between the planes
        # instead.
        w = np.clip(1 / inverse, first, last)
        inside = edges * drawn.each(
            side * np.sign(film.volume) / per_pixel(film.lines, film.resolution)
        )
        beyond = drawn.each(np.abs(film.volume) / per_pixel(film.plane, film.resolution))
        least = np.minimum(np.minimum(inside.min(axis=0), 0.0), -beyond * np.abs(1 / w - inverse))
    # Points behind the camera, and triangles seen edge-on, belong to no camera.
    least = np.where(np.isfinite(least) & (inverse > 0), least, -np.inf).reshape(len(cameras), -1)
    forward = (drawn.each(side) * w).reshape(least.shape)
    best, point = np.full(len(rows), -np.inf), np.full((len(rows), 3), np.nan)
    # C* is drawn last and wins where both cameras may have drawn the pixel.
    for place, drawing in reversed(list(enumerate(cameras))):
        taken = (least[place] > best + OUTSIDE_PX) | np.isnan(point[:, 2])
        bundle = drawing.bundle
        assert isinstance(bundle, RayBundle)
        line = np.stack((bundle.dx[columns], bundle.dy[rows], -np.ones(len(rows))), axis=-1)
        point[taken] = (bundle.center + forward[place][:, None] * line)[taken]
        best[taken] = least[place][taken]
    position[rows, columns] = point
    return image
