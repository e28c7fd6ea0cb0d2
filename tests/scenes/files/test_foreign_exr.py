"""OpenEXR files of other programs: read as our own, or refused with their channels."""

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from xfrustum.scenes import NOTHING, HogelCamera, HogelImage, InputError
from xfrustum.scenes.files.exr import read_channels
from xfrustum.scenes.files.exr_storage import uncertainty
from xfrustum.scenes.files.foreign_images import Encoding, read_foreign
from xfrustum.scenes.plate.plate import Plate

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
Planes = dict[str, NDArray[Any]]
Part = tuple[str, Planes]


def numbers() -> NDArray[np.uint32]:
    number = np.arange(WIDTH * HEIGHT, dtype=np.uint32).reshape(HEIGHT, WIDTH)
    number[:2] = 0  # nothing
    return number


def points(missing: float = np.nan) -> NDArray[np.float32]:
    """Points whose coordinates half precision holds exactly."""
    position: NDArray[np.float32] = np.empty((HEIGHT, WIDTH, 3), np.float32)
    position[:] = np.random.default_rng(3).integers(1, 64, position.shape) / 8
    position[:2] = missing
    return position


def vector(name: str, values: NDArray[Any], axes: str = "XYZ") -> Planes:
    return {name + axis: np.ascontiguousarray(values[..., at]) for at, axis in enumerate(axes)}


def written(path: Path, *parts: Part, **header: Any) -> Path:
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    named = [
        OpenEXR.Part(
            kind | ({"name": name} if name else {}), {n: p.copy() for n, p in planes.items()}, name
        )
        for name, planes in parts
    ]
    OpenEXR.File(named).write(str(path))
    return path


def read(path: Path, encoding: Encoding = Encoding.RGB) -> HogelImage:
    return read_foreign(path, CAMERA, encoding)


@pytest.mark.parametrize("background", [0.0, 1e10, -1e10, 3e38, np.inf, np.nan])
@pytest.mark.parametrize("numbered", [True, False])
def test_a_background_has_no_surface_at_any_position(
    tmp_path: Path, background: float, numbered: bool
) -> None:
    planes = vector("P.", points(background)) | ({"id.triangle": numbers()} if numbered else {})
    image = read(written(tmp_path / "a.exr", ("", planes)))
    np.testing.assert_array_equal(image.position, points())
    np.testing.assert_array_equal(image.covered, numbers() > 0)


ZERO = np.zeros((HEIGHT, WIDTH), np.uint32)


def test_the_number_0_is_a_background_and_numbers_that_were_never_set_hide_nothing(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.exr"
    numbered = vector("P.", points(7.5)) | {"id.triangle": numbers()}
    np.testing.assert_array_equal(read(written(path, ("", numbered))).position, points())
    for background in (0.0, 7.5, 1e10):
        everywhere = np.full((HEIGHT, WIDTH, 3), background, np.float32)
        empty = vector("P.", everywhere) | {"id.triangle": ZERO}
        assert not read(written(path, ("", empty))).covered.any()
    unset = vector("ViewLayer.Position.", points(0.0))
    unset["ViewLayer.IndexOB.X"] = ZERO.astype(np.float32)
    np.testing.assert_array_equal(read(written(path, ("", unset))).position, points())
    compressed = written(
        path, ("", vector("P.", points(0.0))), compression=OpenEXR.DWAA_COMPRESSION
    )
    np.testing.assert_array_equal(read(compressed).covered, numbers() > 0)


def layers(prefix: str, position: str, number: str, axes: str = "XYZ") -> list[Part]:
    """Return the part of a renderer that writes color, normal, Cryptomatte and depth, too."""
    planes = vector(position, points(0.0), axes) | {number: numbers().astype(np.float32)}
    for layer, names in (("Combined", "RGBA"), ("Normal", "XYZ"), ("CryptoObject00", "RGBA")):
        values = np.ones((HEIGHT, WIDTH, len(names)), np.float32)
        planes |= vector(f"{prefix}{layer}.", values, names)
    return [("", planes | {f"{prefix}Depth.Z": np.full((HEIGHT, WIDTH), 4.0, np.float32)})]


WHITE = np.ones((HEIGHT, WIDTH, 3), np.float32)
RGB, DATA = vector("", WHITE, "RGB"), ("data", {"id.triangle": numbers()})


@pytest.mark.parametrize(
    ("parts", "number"),
    [
        (layers("ViewLayer.", "ViewLayer.Position.", "ViewLayer.IndexOB.X"), "object"),
        (layers("A.B.", "A.B.Position.", "A.B.Object Index.X"), "object"),
        (layers("", "P.", "id.object", "RGB"), "object"),
        (layers("", "pos.", "id.triangle"), "triangle"),
        (layers("", "P.", "id.triangle", "xyz"), "triangle"),
        ([("rgba", RGB), ("P", vector("", points(0.0), "RGB")), DATA], "triangle"),
        (
            [
                ("beauty", RGB),
                ("diffuse", vector("", 0 * WHITE, "RGB")),
                ("Position", vector("", points(0.0))),
                DATA,
            ],
            "triangle",
        ),
    ],
)
def test_channels_have_the_names_of_other_programs(
    tmp_path: Path, parts: list[Part], number: str
) -> None:
    image = read(written(tmp_path / "a.exr", *parts))
    np.testing.assert_array_equal(image.position, points())
    np.testing.assert_array_equal(getattr(image, number), numbers().astype(np.int64) - 1)
    assert image.color is not None and (image.color == 1).all()


def test_the_encoding_states_the_meaning_of_a_number(tmp_path: Path) -> None:
    path = written(tmp_path / "a.exr", ("", {"id": numbers()}))
    expected = numbers().astype(np.int64) - 1
    np.testing.assert_array_equal(read(path, Encoding.TRIANGLE_ID).triangle, expected)
    np.testing.assert_array_equal(read(path, Encoding.OBJECT_ID).object, expected)
    with pytest.raises(
        InputError, match=r"state with --encoding triangle-id or object-id .* it has id"
    ):
        read(path)
    placed = written(tmp_path / "b.exr", ("", {"id": numbers()} | vector("P.", points(7.5))))
    np.testing.assert_array_equal(read(placed).position, points())
    assert (read(placed).triangle == NOTHING).all()


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([("", {"depth": points()[..., 0]})], "none of .* it has depth"),
        (
            [("", vector("CryptoObject00.", points(), "RGB"))],
            r"it has Crypto.*\(Cryptomatte is not read\)",
        ),
        (
            [("", vector("A.Position.", points()) | vector("B.Position.", points()))],
            "P.X lies in A.Position.X, B.Position.X; keep one",
        ),
        (
            [("left", DATA[1]), ("right", DATA[1])],
            "id.triangle lies in left/id.triangle, right/id.triangle; keep one",
        ),
        (
            [("", {"id.triangle": np.full((HEIGHT, WIDTH), 2050, np.float16)})],
            "above 2,048, which its type",
        ),
    ],
)
def test_a_file_without_usable_channels_is_refused_with_the_present_ones(
    tmp_path: Path, parts: list[Part], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read(written(tmp_path / "a.exr", *parts))


def test_the_display_window_is_the_picture_whatever_pixels_are_stored(tmp_path: Path) -> None:
    def framed(
        planes: Planes, data: tuple[int, int, int, int], display: tuple[int, int, int, int]
    ) -> HogelImage:
        windows = {
            name: (np.array(box[:2], np.int32), np.array(box[2:], np.int32))
            for name, box in (("dataWindow", data), ("displayWindow", display))
        }
        return read(written(tmp_path / "a.exr", ("", planes), **windows))

    planes = vector("P.", points()) | {"id.triangle": numbers()}
    over = {name: np.pad(plane, 2, constant_values=9) for name, plane in planes.items()}
    overscan = framed(over, (3, 8, 3 + WIDTH + 3, 8 + HEIGHT + 3), (5, 10, 4 + WIDTH, 9 + HEIGHT))
    np.testing.assert_array_equal(overscan.position, points())
    part = {name: np.ascontiguousarray(plane[3:5, 1:6]) for name, plane in planes.items()}
    crop = framed(part, (1, 3, 5, 4), (0, 0, WIDTH - 1, HEIGHT - 1))
    inside = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    inside[3:5, 1:6] = True
    np.testing.assert_array_equal(crop.covered, inside)
    np.testing.assert_array_equal(crop.position[inside], points()[inside])
    np.testing.assert_array_equal(crop.triangle[inside], numbers()[inside].astype(np.int64) - 1)


def test_storage_says_how_exactly_it_holds_positions(tmp_path: Path) -> None:
    position = points() * np.float32(1.0001)

    def stored(kind: Any, compression: Any, axes: str = "XYZ") -> HogelImage:
        planes = vector("P.", position.astype(kind), axes) | {"id.triangle": numbers()}
        return read(written(tmp_path / "a.exr", ("", planes), compression=compression))

    for kind, compression, dwa in (
        (np.float16, OpenEXR.ZIP_COMPRESSION, False),
        (np.float32, OpenEXR.PXR24_COMPRESSION, False),
        (np.float32, OpenEXR.DWAA_COMPRESSION, True),
        (np.float16, OpenEXR.DWAB_COMPRESSION, True),
    ):
        image = stored(kind, compression)
        assert image.uncertainty is not None
        share = np.nanmax(
            np.abs(image.position - position) / np.maximum(image.uncertainty, 1e-30), axis=(0, 1)
        )
        assert (share <= 1 + 1e-6).all() if kind == np.float16 or not dwa else share[1] <= 1
        assert share[1] > 0.05, "no more than a derived bound has to be"
        # DWA keeps channels that are not named R, G, B or Y, in float32 here.
        assert not dwa or kind == np.float16 or (image.uncertainty[..., [0, 2]] == 0).all()
        assert (image.storage is not None) == dwa
    assert stored(np.float32, OpenEXR.ZIP_COMPRESSION).uncertainty is None
    for kind, compression, axes in (
        (np.float32, OpenEXR.DWAA_COMPRESSION, "RGB"),
        (np.float16, OpenEXR.B44_COMPRESSION, "XYZ"),
    ):
        with pytest.raises(
            InputError, match=r"channel P\.[XR] is stored with (DWAA|B44), which changes"
        ):
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
