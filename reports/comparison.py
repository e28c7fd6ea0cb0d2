"""`xfrustum compare`: two images from files, compared in numbers and pictures."""

from dataclasses import dataclass
from pathlib import Path

from xfrustum.compare.metrics.comparison import Comparison, compare_images
from xfrustum.reference import Reference
from xfrustum.reports.common import pictures as images
from xfrustum.reports.common.outputs import write_files
from xfrustum.reports.common.provenance import unexamined_truth
from xfrustum.scenes import HogelCamera, InputError, Scene, open_scene
from xfrustum.scenes.files.exr import image_size, read_image

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
    # Search the scene at its stored path, then next to the image: a folder with both may have been
    # moved.
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
