"""OpenEXR files of other programs: read like the project's own, or refused with their channels."""

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from xfrustum.scenes import NOTHING, HogelCamera, HogelImage, InputError
from xfrustum.scenes.files.channels import uncertainty
from xfrustum.scenes.files.exr import read_channels
from xfrustum.scenes.files.pictures import Encoding, read_foreign
from xfrustum.scenes.plate import Plate

WIDTH, HEIGHT = 32, 24
CAMERA = HogelCamera(
    aperture=Plate(size=(2.0, 2.0), hogels=(2, 2)).aperture(1, 1),
    resolution=(WIDTH, HEIGHT),
    shear=(0.0, 0.0),
    half_extent=(0.5, 0.5),
    reach=(10.0, 10.0),
    scene="",
    scene_hash="",
    renderer="",
)
equal = np.testing.assert_array_equal
Planes = dict[str, NDArray[Any]]
SHAPE = (HEIGHT, WIDTH)


def numbers() -> NDArray[np.uint32]:
    number = np.arange(WIDTH * HEIGHT, dtype=np.uint32).reshape(SHAPE)
    number[:2] = 0  # no surface
    return number


def points(missing: float = np.nan) -> NDArray[np.float32]:
    """Return points whose coordinates are exact in half precision."""
    eighths = np.random.default_rng(3).integers(1, 64, (*SHAPE, 3))
    position = (eighths / 8).astype(np.float32)
    position[:2] = missing
    return position


def vector(name: str, values: NDArray[Any], axes: str = "XYZ") -> Planes:
    return {name + axis: values[..., at] for at, axis in enumerate(axes)}


def read(
    folder: Path, *parts: Planes, encoding: Encoding = Encoding.RGB, **header: Any
) -> HogelImage:
    """Write a file of some parts, each named by its key `name`, and read it."""
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    written = []
    for planes in parts:
        copies: dict[str, Any] = {name: plane.copy("C") for name, plane in planes.items()}
        name = str(copies.pop("name", ""))
        written.append(OpenEXR.Part(kind | ({"name": name} if name else {}), copies, name))
    OpenEXR.File(written).write(str(folder / "a.exr"))
    return read_foreign(folder / "a.exr", CAMERA, encoding)


def named(name: str, planes: Planes) -> Planes:
    return {"name": np.array(name)} | planes


@pytest.mark.parametrize("background", [0.0, 1e10, -1e10, 3e38, np.inf, np.nan])
@pytest.mark.parametrize("numbered", [True, False])
def test_a_background_has_no_surface_at_any_position(
    tmp_path: Path, background: float, numbered: bool
) -> None:
    planes = vector("P.", points(background)) | ({"id.triangle": numbers()} if numbered else {})
    image = read(tmp_path, planes)
    equal(image.position, points())
    equal(image.covered, numbers() > 0)


def test_the_number_0_is_a_background_and_numbers_that_were_never_set_hide_nothing(
    tmp_path: Path,
) -> None:
    zero = np.zeros(SHAPE, np.uint32)
    numbered = vector("P.", points(7.5)) | {"id.triangle": numbers()}
    equal(read(tmp_path, numbered).position, points())
    for background in (0.0, 7.5, 1e10):
        everywhere = vector("P.", np.full((*SHAPE, 3), background, np.float32))
        assert not read(tmp_path, everywhere | {"id.triangle": zero}).covered.any()
    unset = vector("ViewLayer.Position.", points(0.0))
    unset["ViewLayer.IndexOB.X"] = zero.astype(np.float32)
    equal(read(tmp_path, unset).position, points())
    dwa = read(tmp_path, vector("P.", points(0.0)), compression=OpenEXR.DWAA_COMPRESSION)
    equal(dwa.covered, numbers() > 0)


def layers(prefix: str, position: str, number: str, axes: str = "XYZ") -> list[Planes]:
    """Return a renderer's part with color, normal, Cryptomatte and depth as further channels."""
    planes = vector(position, points(0.0), axes) | {number: numbers().astype(np.float32)}
    for layer, names in (("Combined", "RGBA"), ("Normal", "XYZ"), ("CryptoObject00", "RGBA")):
        planes |= vector(f"{prefix}{layer}.", np.ones((*SHAPE, 4), np.float32), names)
    return [planes | {f"{prefix}Depth.Z": np.full(SHAPE, 4.0, np.float32)}]


WHITE = np.ones((*SHAPE, 3), np.float32)
RGB, DATA = vector("", WHITE, "RGB"), {"id.triangle": numbers()}
BEAUTY, BLACK = named("beauty", RGB), named("diffuse", vector("", 0 * WHITE, "RGB"))


@pytest.mark.parametrize(
    ("parts", "number"),
    [
        (layers("ViewLayer.", "ViewLayer.Position.", "ViewLayer.IndexOB.X"), "object"),
        (layers("A.B.", "A.B.Position.", "A.B.Object Index.X"), "object"),
        (layers("", "P.", "id.object", "RGB"), "object"),
        (layers("", "pos.", "id.triangle"), "triangle"),
        (layers("", "P.", "id.triangle", "xyz"), "triangle"),
        (
            [named("rgba", RGB), named("P", vector("", points(0.0), "RGB")), named("data", DATA)],
            "triangle",
        ),
        (
            [BEAUTY, BLACK, named("Position", vector("", points(0.0))), named("data", DATA)],
            "triangle",
        ),
    ],
)
def test_channels_have_the_names_of_other_programs(
    tmp_path: Path, parts: list[Planes], number: str
) -> None:
    image = read(tmp_path, *parts)
    equal(image.position, points())
    equal(getattr(image, number), numbers().astype(np.int64) - 1)
    assert image.color is not None and (image.color == 1).all()


def test_the_encoding_states_the_meaning_of_a_number(tmp_path: Path) -> None:
    planes, expected = {"id": numbers()}, numbers().astype(np.int64) - 1
    equal(read(tmp_path, planes, encoding=Encoding.TRIANGLE_ID).triangle, expected)
    equal(read(tmp_path, planes, encoding=Encoding.OBJECT_ID).object, expected)
    with pytest.raises(
        InputError, match=r"state with --encoding triangle-id or object-id .* it has id"
    ):
        read(tmp_path, planes)
    placed = read(tmp_path, planes | vector("P.", points(7.5)))
    equal(placed.position, points())
    assert (placed.triangle == NOTHING).all()


REFUSED: dict[str, list[Planes]] = {
    "none of .* it has depth": [{"depth": points()[..., 0]}],
    r"it has Crypto.*\(Cryptomatte is not read\)": [vector("CryptoObject00.", points(), "RGB")],
    "P.X lies in A.Position.X, B.Position.X; keep one": [
        vector("A.Position.", points()) | vector("B.Position.", points())
    ],
    "id.triangle lies in left/id.triangle, right/id.triangle; keep one": [
        named("left", DATA),
        named("right", DATA),
    ],
    "above 2,048, which its type": [{"id.triangle": np.full(SHAPE, 2050, np.float16)}],
}


@pytest.mark.parametrize("message", REFUSED)
def test_a_file_without_usable_channels_is_refused_with_the_present_ones(
    tmp_path: Path, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, *REFUSED[message])


def window(x: int, y: int, width: int, height: int) -> tuple[NDArray[np.int32], ...]:
    """Return a window by its first pixel and its size."""
    return tuple(np.array([[x, y], [x + width - 1, y + height - 1]], np.int32))


def test_the_display_window_is_the_picture_whatever_pixels_are_stored(tmp_path: Path) -> None:
    planes = vector("P.", points()) | {"id.triangle": numbers()}
    over = {name: np.pad(plane, 2, constant_values=9) for name, plane in planes.items()}
    display, data = window(5, 10, WIDTH, HEIGHT), window(3, 8, WIDTH + 4, HEIGHT + 4)
    overscan = read(tmp_path, over, dataWindow=data, displayWindow=display)
    equal(overscan.position, points())
    part = {name: plane[3:5, 1:6] for name, plane in planes.items()}
    display, data = window(0, 0, WIDTH, HEIGHT), window(1, 3, 5, 2)
    crop = read(tmp_path, part, dataWindow=data, displayWindow=display)
    stored = np.zeros(SHAPE, dtype=np.bool_)
    stored[3:5, 1:6] = True
    equal(crop.covered, stored)
    equal(crop.position[stored], points()[stored])
    equal(crop.triangle[stored], numbers()[stored].astype(np.int64) - 1)


def test_a_display_window_larger_than_memory_is_refused_for_all_its_channels(
    tmp_path: Path,
) -> None:
    planes = vector("P.", points()) | {"id.triangle": numbers()}
    # One plane of this window takes half of the limit of 1 GiB.
    display = window(0, 0, WIDTH, (1 << 27) // WIDTH + 1)
    with pytest.raises(InputError, match="of memory"):
        read(tmp_path, planes, displayWindow=display)


def test_storage_states_its_precision_of_positions(tmp_path: Path) -> None:
    position = points() * np.float32(1.0004)  # nearly half a step of half precision

    def stored(kind: Any, compression: str, axes: str = "XYZ") -> HogelImage:
        planes = vector("P.", position.astype(kind), axes) | {"id.triangle": numbers()}
        return read(tmp_path, planes, compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))

    for kind, compression in (
        (np.float16, "ZIP"),
        (np.float32, "PXR24"),
        (np.float32, "DWAA"),
        (np.float16, "DWAB"),
    ):
        image, dwa = stored(kind, compression), compression.startswith("DWA")
        assert image.uncertainty is not None
        off = np.abs(image.position - position) / np.maximum(image.uncertainty, 1e-30)
        share = np.nanmax(off, axis=(0, 1))
        assert (share <= 1 + 1e-6).all() if kind == np.float16 or not dwa else share[1] <= 1
        assert share[1] > 0.05, "no more than a derived bound has to be"
        # DWA is lossless for channels not named R, G, B or Y, which are float32 here.
        assert not dwa or kind == np.float16 or (image.uncertainty[..., [0, 2]] == 0).all()
        assert (image.storage is not None) == dwa
    assert stored(np.float32, "ZIP").uncertainty is None
    for kind, compression, axes in ((np.float32, "DWAA", "RGB"), (np.float16, "B44", "XYZ")):
        message = r"channel P\.[XR] is stored with (DWAA|B44), which changes"
        with pytest.raises(InputError, match=message):
            stored(kind, compression, axes)


@pytest.mark.parametrize("level", [45.0, 200.0])
def test_dwa_changes_no_value_by_more_than_is_derived(tmp_path: Path, level: float) -> None:
    rng, side = np.random.default_rng(11), 64
    steps = np.where(rng.random((side, side)) < 0.3, 0.0, 50 * rng.random((side, side)) - 20)
    slope = np.add.outer(np.linspace(-30, 30, side), np.linspace(-50, 50, side))
    for values in (
        steps,
        slope,
        rng.normal(size=(side, side)) * 1e-3,
        rng.normal(size=(side, side)) * 1e4,
    ):
        header = {"compression": OpenEXR.DWAA_COMPRESSION, "type": OpenEXR.scanlineimage}
        path = tmp_path / "a.exr"
        planes = {"P.Y": values.astype(np.float32)}
        OpenEXR.File(header | {"dwaCompressionLevel": level}, planes).write(str(path))
        read_planes = read_channels(path, ["P.Y"]).planes
        bound = uncertainty(read_planes["P.Y"], "P.Y", OpenEXR.DWAA_COMPRESSION, level)
        assert bound is not None
        share = np.abs(read_planes["P.Y"] - values) / bound
        assert 0.05 < share.max() < 1
