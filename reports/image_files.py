"""Images of an aperture as files: `xfrustum trace` writes a truth, `xfrustum compare` compares two.

Tracing a truth takes the memory of one band. Images are compared in numbers and pictures.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from xfrustum.compare.comparison import Comparison, compare_images, transported
from xfrustum.reference import Reference
from xfrustum.reference.alone import TracersAlone, judged
from xfrustum.reference.backend import BAND_PIXELS, PIXEL_BYTES
from xfrustum.reference.pictures import points_per_side
from xfrustum.reports.common import pictures as images
from xfrustum.reports.common.outputs import progress_bar, unexamined_truth, write_files
from xfrustum.scenes import Aperture, HogelCamera, InputError, Scene, open_scene
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.disk import in_words
from xfrustum.scenes.files.exr import image_size, image_writer, read_image, write_image
from xfrustum.scenes.model.effects import ALL_EFFECTS
from xfrustum.scenes.model.images import Certainty, Rendering

MAPS = ("displacement", "triangle", "height", "radiance", "surface")
FILES = (
    "comparison.json",
    *(f"{name}.png" for name in MAPS),
)  #: names of the files that may be written


@dataclass(frozen=True, kw_only=True)
class FileComparison:
    """Two image files compared."""

    #: its `surface` is None if the scene is not available for tracing
    comparison: Comparison
    #: the truth's longest reach, scene units
    reach: float
    #: both ends of the scale of height errors; see `images.height_range`
    heights: tuple[float, float]
    #: reason why the scene is not available; empty if it is
    note: str
    #: note on a truth by an uncertified tracer; empty for a certified truth
    unexamined: str = ""


def compare_files(truth: Path, raster: Path) -> FileComparison:
    """Compare two EXR files; InputError if they do not belong together."""
    # Compare sizes before cameras, because files of two sizes always differ.
    sizes = [image_size(path) for path in (truth, raster)]
    if sizes[0] != sizes[1]:
        (width, height), (other_width, other_height) = sizes
        raise InputError(
            f"{truth} is {width} x {height} and {raster} is {other_width} x {other_height}; "
            "make both of one scene, at one resolution"
        )
    true_image = read_image(truth)
    # An image without a camera takes the camera of the truth.
    raster_image = read_image(raster, true_image.camera)
    scene, note = _scene_again(true_image.camera, truth.parent)
    reference, reach = Reference(scene) if scene else None, max(true_image.camera.reach)
    comparison = compare_images(true_image, raster_image, reference, perceptual=True)
    unexamined = ""
    if true_image.certainty is not None and comparison.certainty["unexamined"]:
        unexamined = unexamined_truth(true_image.camera.renderer.partition(" ")[0] or "a tracer")
    return FileComparison(
        comparison=comparison,
        reach=reach,
        heights=images.height_range(scene, reach),
        note=note,
        unexamined=unexamined,
    )


def _scene_again(camera: HogelCamera, folder: Path) -> tuple[Scene | None, str]:
    """Open the scene of an image; without it, return the reason."""
    unseen = "wrong surfaces are not counted"
    if not camera.scene:
        return None, f"the truth names no scene; {unseen}"
    # Search for the scene at its stored path, then next to the image: a folder with both may have
    # been moved.
    note, moved = "", (folder / camera.scene, folder / Path(camera.scene).name)
    for name in dict.fromkeys((camera.scene, *map(str, moved))):
        try:
            scene = open_scene(name)
        except InputError as error:
            # Report the error of an existing file rather than a missing file.
            if not note or Path(name).is_file():
                note = f"scene {camera.scene} cannot be opened ({error})"
            continue
        if scene.content_hash == camera.scene_hash:
            return scene, ""
        note = f"scene {name} is not the one that the truth was traced from"
    return None, f"{note}; {unseen}"


def write_comparison(compared: FileComparison, out: Path) -> tuple[Path, ...]:
    """Write comparison.json and a picture of each error, all or nothing."""
    comparison, maps = compared.comparison, compared.comparison.maps
    pictures = {
        "displacement": images.displacement_map(comparison.errors.moved),
        "triangle": images.mask(maps.triangle, images.TRIANGLE_COLOR),
        "height": images.height_map(maps.height, compared.reach, compared.heights),
    }
    if maps.radiance is not None:
        pictures["radiance"] = images.radiance_map(maps.radiance)
    if maps.surface is not None:
        pictures["surface"] = images.mask(maps.surface, images.SURFACE_COLOR)
    files = {f"{name}.png": encoded for name, encoded in pictures.items()}
    return write_files(out, {"comparison.json": comparison.numbers, **files})


LARGE_PIXELS = 1 << 23
"""Lines or light paths from which on `trace` prints a forecast; below, it takes seconds."""

FILE_BYTES, VARIANCE_BYTES = 52, 12
"""Bytes of a pixel before compression: 13 channels of 32 bits, 3 more for variance."""


@dataclass(frozen=True, kw_only=True)
class TraceRecord:
    """Record that `trace --json` prints."""

    file: Path
    #: `certified`, or the name of a tracer
    decided_by: str
    #: pixels by class
    certainty: dict[str, int]
    #: judged pixels, and errors of each uncertified tracer
    alone: dict[str, int] | None


def forecast(scene: Scene, *, transported: bool) -> str | None:
    """Return a forecast of pixels, memory and file size; None below `LARGE_PIXELS`."""
    (width, height), sampling = scene.frustum.resolution, scene.sampling
    pixels = width * height
    kind, each = ("light paths", scene.transport.samples) if transported else ("samples", 1)
    each *= sampling.aperture * (1 if transported else points_per_side(sampling) ** 2)
    # Small images take seconds: a forecast would only be noise.
    if pixels * each < LARGE_PIXELS:
        return None

    parts = [f"{width} x {height} are {pixels / 1e6:,.1f} million pixels"]
    if each > 1:
        parts.append(f"each is the mean of {each:,} {kind}")
    else:
        # Memory is bounded by one band, for films of any height.
        rows = min(height, max(1, BAND_PIXELS // width))
        memory = in_words(PIXEL_BYTES * rows * width)
        parts.append(
            f"traced in {-(-height // rows):,} bands, in about {memory} of memory beside the scene"
        )
    file_bytes = pixels * (FILE_BYTES + (VARIANCE_BYTES if transported else 0))
    parts.append(f"the file takes at most {in_words(file_bytes)}")
    return "; ".join(parts)


def trace_alone(reference: Reference, aperture: Aperture, path: str | Path) -> TraceRecord:
    """Write the unexamined picture of a tracer in single precision as EXR.

    InputError if the file cannot be written: it appears complete, or not at all.
    """
    # The proposal of the tracer, before certification.
    image = reference.propose(aperture)
    camera = replace(image.camera, renderer=f"{reference.tracer_name} alone, nothing certified")
    write_image(path, replace(image, camera=camera, rendering=reference.rendering()))
    certainty = {Certainty.UNEXAMINED.name.lower(): image.triangle.size}
    return TraceRecord(
        file=Path(path), decided_by=reference.tracer_name, certainty=certainty, alone=None
    )


def trace_to_file(
    reference: Reference,
    aperture: Aperture,
    path: str | Path,
    *,
    compared: bool = False,
    progress: bool = False,
) -> TraceRecord:
    """Trace the truth of an aperture and write it as EXR while it is being traced.

    `compared` also counts the errors of each uncertified tracer. InputError if the file cannot be
    written: it appears complete, or not at all.
    """
    alone = TracersAlone(reference.scene) if compared else None
    counted: Counter[str] = Counter()
    height, row = reference.scene.frustum.resolution[1], 0
    camera, rendering = reference.camera(aperture), reference.rendering()
    with (
        image_writer(path, camera, ("normal", "color", "certainty"), rendering) as write,
        progress_bar(height, "trace", "row", shown=progress) as bar,
    ):
        # Bands go to the file as they come: no array has the size of the film.
        for band in reference.trace_bands(aperture):
            write(band)
            assert band.certainty is not None, "the truth is certified"
            counts = np.bincount(band.certainty.ravel(), minlength=len(Certainty))
            counted.update({kind.name.lower(): int(counts[kind]) for kind in Certainty})
            if alone is not None:
                counted.update(
                    {name: int(mask.sum()) for name, mask in alone.wrong(band, row).items()}
                )
                counted["judged"] += int(judged(band).sum())
            row += len(band.triangle)
            bar.update(len(band.triangle))
    names = ("judged", "embree", "mitsuba")
    certainty = {kind.name.lower(): counted[kind.name.lower()] for kind in Certainty}
    numbers = None if alone is None else {name: counted[name] for name in names}
    return TraceRecord(file=Path(path), decided_by="certified", certainty=certainty, alone=numbers)


def trace_transported(
    reference: Reference, aperture: Aperture, path: str | Path, *, progress: bool = False
) -> None:
    """Trace the truth of an aperture, color it by light paths, and write it as EXR.

    Surfaces come from the certified truth. The color is a mean, whose variance is stored in
    separate channels; the camera states the number of light paths. InputError if the file cannot be
    written: it appears complete, or not at all.
    """
    scene = reference.scene
    with progress_bar(1 + scene.sampling.aperture, "trace", "image", shown=progress) as bar:
        # One certified line through each pixel's center; light paths spread over the pixel.
        image = reference.trace(aperture, Sampling())
        bar.update()
        estimate = transported(scene, aperture, scene.transport, done=bar.update)
    camera = replace(
        image.camera, light_paths=estimate.samples, renderer="reference, colored by Mitsuba"
    )
    color, variance = estimate.mean.astype(np.float32), estimate.variance_of_mean.astype(np.float32)
    rendering = Rendering.from_effects(ALL_EFFECTS, scene.sampling, scene.transport)
    write_image(
        path, replace(image, camera=camera, color=color, variance=variance, rendering=rendering)
    )
