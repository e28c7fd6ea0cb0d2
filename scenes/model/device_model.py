"""Roundings of a device that draws, by measurement.

`xfrustum.raster.device.fingerprint` measures them, `xfrustum.compare.rounding` explains pixels by
them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from xfrustum.scenes.disk.input_files import read_small
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.double_frustum import DepthFormat

Range = tuple[FiniteFloat, FiniteFloat]
"""Lowest and highest difference of a stored value and the exact one, steps of a format."""

Digits = Annotated[int, Field(ge=0, le=24)]
"""Number of binary digits of a grid; float32, which places are computed in, has 24."""

LARGEST_FILE = 1 << 20  # bytes of the largest device.json; `xfrustum device` writes some thousands

NEAREST: Range = (-0.5, 0.5)
"""Storing the nearest step."""

SIXTEENTH = 1 / 16
"""Part of a step to which some devices cut a depth off before they round it to a step."""


@dataclass(frozen=True, kw_only=True)
class DeviceModel:
    """The roundings of one kind of device."""

    name: str  #: for people, and in what commands print as `device_model`
    #: Binary digits of a pixel to which vertices are snapped (GL_SUBPIXEL_BITS)
    subpixel_bits: Digits
    #: True if depth, 1 / w and varyings are interpolated from snapped vertices, so that they move
    #: with edges
    snaps_depth: bool
    #: d16, d24: rounding of a float32 depth to the steps of a format; D32F does not round.
    d16: Range = NEAREST
    d24: Range = NEAREST
    #: True if a depth is rounded after each of the two steps of its plane, along x and y, not only
    #: at the end
    rounds_planes: bool = True
    filter_bits: Digits | None = None  #: of the weights of a bilinear filter; None for float32

    def __post_init__(self) -> None:
        for low, high in (self.d16, self.d24):
            if low > high:
                raise ValueError(f"a lowest difference of {low} is larger than the highest, {high}")

    @property
    def half_step(self) -> float:
        """Largest distance of a snapped vertex from its place along one axis, pixels."""
        return float(2.0 ** -(self.subpixel_bits + 1))

    @property
    def filter_rounding(self) -> float:
        """Largest rounding of the weight that a bilinear filter gives a texel along one axis."""
        return 0.0 if self.filter_bits is None else float(2.0 ** -(self.filter_bits + 1))

    def stored(self, depth: DepthFormat) -> Range:
        """Return how a float32 depth is rounded to the steps of a format."""
        return {DepthFormat.D16: self.d16, DepthFormat.D24: self.d24, DepthFormat.D32F: (0.0, 0.0)}[
            depth
        ]

    def stored_steps(self, depth: DepthFormat) -> float:
        """Return the largest difference of two equal depths as stored, in steps; 0 for D32F."""
        low, high = self.stored(depth)
        return high - low

    def as_json(self) -> dict[str, Any]:
        """Return the model as `device.json` has it under `model`."""
        return asdict(self)

    @classmethod
    def read(cls, path: Path) -> DeviceModel:
        """Read the model of a `device.json`; InputError if it is not one."""
        advice = "xfrustum device --out DIR writes DIR/device.json"
        content = read_small(path, "device.json", LARGEST_FILE, advice)
        try:
            return _Written.model_validate_json(content, strict=True).model
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            wrong = f"{'.'.join(map(str, first['loc']))}: {first['msg'].lower()}".removeprefix(": ")
            raise InputError(
                f"{path} is no device.json ({wrong}); xfrustum device --out DIR writes one "
                "where it is drawn"
            ) from error


class _Written(BaseModel):
    """The part of `device.json` that is read."""

    model: DeviceModel


LLVMPIPE = DeviceModel(name="llvmpipe", subpixel_bits=8, snaps_depth=False)
"""Mesa's software renderer: edges from snapped vertices, planes from float32 vertices."""

H100 = DeviceModel(
    name="NVIDIA H100",
    subpixel_bits=8,
    snaps_depth=True,
    # A depth is truncated to sixteenths of a step, and half is rounded down: the next step begins
    # at 9 / 16.
    d16=(-0.5 - SIXTEENTH, 0.5),
    rounds_planes=False,
    filter_bits=8,
)
"""NVIDIA H100, driver 580.159.04, as measured in November 2026."""

QUADS_OF_A_SPAN = 16
"""Blocks of 2 x 2 pixels that softpipe steps through with one gradient of D16."""

SOFTPIPE = DeviceModel(
    name="softpipe",
    subpixel_bits=4,
    snaps_depth=False,
    # Depths are truncated; in D16 also the gradient, by less than a step for each block except a
    # span's first.
    d16=(-1.0 - (QUADS_OF_A_SPAN - 1), QUADS_OF_A_SPAN - 1.0),
    d24=(-1.0, 0.0),
)
"""Mesa's reference renderer, OpenGL 3.3; no snapping tried explains its coverage."""

FEWEST_SUBPIXEL_BITS = 4
"""Fewest subpixel bits that OpenGL allows (GL_SUBPIXEL_BITS)."""


def safe_model(subpixel_bits: int = FEWEST_SUBPIXEL_BITS) -> DeviceModel:
    """Return the model of an unmeasured device, which may store the next lower or higher step.

    It holds if the depth of each pixel is computed independently, unlike the D16 of softpipe.
    """
    wide = -1.0, 1.0
    return DeviceModel(
        name=f"any device with {subpixel_bits} subpixel bits",
        subpixel_bits=subpixel_bits,
        snaps_depth=True,
        d16=wide,
        d24=wide,
        filter_bits=8,
    )


KNOWN = {"llvmpipe": LLVMPIPE, "softpipe": SOFTPIPE, "NVIDIA H100": H100}
"""Models by a part of the renderer's name (GL_RENDERER)."""


def kept_at(device: Mapping[str, str]) -> Path:
    """Return the path of the stored measurement of an unknown device, by its names."""
    home = os.path.expanduser("~/.cache")  # noqa: PTH111 - a missing home is no error
    cache = os.environ.get("XDG_CACHE_HOME") or home
    names = f"{device['renderer']}\n{device.get('version', '')}"
    return Path(cache) / "xfrustum" / f"device-{sha256(names.encode()).hexdigest()[:16]}.json"


def model_of(device: Mapping[str, str]) -> DeviceModel:
    """Return the model of a device by its names: known, measured before, or safe."""
    bits = int(device["subpixel_bits"])
    for name, model in KNOWN.items():
        if name in device["renderer"] and model.subpixel_bits == bits:
            return model
    try:
        return DeviceModel.read(kept_at(device))
    except InputError:
        return safe_model(bits)
