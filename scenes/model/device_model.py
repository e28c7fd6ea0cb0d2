"""Measured rounding of drawing devices.

`xfrustum.raster.device.fingerprint` makes the test pictures, and `xfrustum.compare.rounding`
explains pixels by this rounding.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.disk import read_small
from xfrustum.scenes.plate import DepthFormat

Range = tuple[FiniteFloat, FiniteFloat]
"""Lowest and highest difference of a stored value from the exact value, steps of a format."""

Digits = Annotated[int, Field(ge=0, le=24)]
"""Number of binary digits of a grid; positions are computed in float32, which has 24 digits."""

LARGEST_FILE = 1 << 20  # largest device.json, bytes; `xfrustum device` writes a few thousand bytes

NEAREST: Range = (-0.5, 0.5)
"""Rounding to the nearest step."""

SIXTEENTH = 1 / 16
"""Fraction of a step to which some devices truncate a depth before rounding it to a step."""


@dataclass(frozen=True, kw_only=True)
class DeviceModel:
    """Rounding of one kind of device."""

    name: str  #: name in reports, and in the JSON key `device_model`
    #: Binary digits of a pixel to which vertices are snapped (GL_SUBPIXEL_BITS)
    subpixel_bits: Digits
    #: True if depth, 1 / w and varyings are interpolated from snapped vertices, so that they move
    #: with edges
    snaps_depth: bool
    #: d16, d24: rounding of a float32 depth to the steps of a format; D32F does not round.
    d16: Range = NEAREST
    d24: Range = NEAREST
    #: True if depth is rounded after each of the two steps of its plane equation, along x and y;
    #: False if only at the end
    rounds_planes: bool = True
    filter_bits: Digits | None = None  #: binary digits of bilinear filter weights; None for float32

    def __post_init__(self) -> None:
        for low, high in (self.d16, self.d24):
            if low > high:
                raise ValueError(f"a lowest difference of {low} is larger than the highest, {high}")

    @property
    def half_step(self) -> float:
        """Largest distance by which snapping moves a vertex along one axis, pixels."""
        return float(2.0 ** -(self.subpixel_bits + 1))

    @property
    def filter_rounding(self) -> float:
        """Largest rounding error of a bilinear filter's weight along one axis."""
        return 0.0 if self.filter_bits is None else float(2.0 ** -(self.filter_bits + 1))

    def stored(self, depth: DepthFormat) -> Range:
        """Return the range of errors of rounding a float32 depth to the steps of a format."""
        return {DepthFormat.D16: self.d16, DepthFormat.D24: self.d24, DepthFormat.D32F: (0.0, 0.0)}[
            depth
        ]

    def stored_steps(self, depth: DepthFormat) -> float:
        """Return the largest difference of the stored values of equal depths, steps; 0 for D32F."""
        low, high = self.stored(depth)
        return high - low

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object under the key `model` of `device.json`."""
        return asdict(self)

    @classmethod
    def read(cls, path: Path) -> DeviceModel:
        """Read the model in a `device.json`; InputError for another file."""
        advice = "xfrustum device --out DIR writes DIR/device.json"
        content = read_small(path, "device.json", LARGEST_FILE, advice)
        try:
            return _Written.model_validate_json(content, strict=True).model
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            wrong = f"{'.'.join(map(str, first['loc']))}: {first['msg'].lower()}".removeprefix(": ")
            raise InputError(
                f"{path} is no device.json ({wrong}); xfrustum device --out DIR writes one "
                "on the machine that draws"
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
    # A depth is truncated to sixteenths of a step, then rounded, with 8/16 rounded down: the next
    # step begins at 9/16.
    d16=(-0.5 - SIXTEENTH, 0.5),
    rounds_planes=False,
    filter_bits=8,
)
"""NVIDIA H100, driver 580.159.04, as measured in November 2026."""

QUADS_OF_A_SPAN = 16
"""Number of 2 x 2 blocks over which softpipe adds the same D16 gradient."""

SOFTPIPE = DeviceModel(
    name="softpipe",
    subpixel_bits=4,
    snaps_depth=False,
    # Depths are truncated. In D16 the gradient is truncated too, by less than a step for each block
    # of a span except the first.
    d16=(-1.0 - (QUADS_OF_A_SPAN - 1), QUADS_OF_A_SPAN - 1.0),
    d24=(-1.0, 0.0),
)
"""Mesa's reference renderer, OpenGL 3.3; no tested snapping explains its coverage."""

FEWEST_SUBPIXEL_BITS = 4
"""Fewest subpixel bits that OpenGL allows (GL_SUBPIXEL_BITS)."""


def safe_model(subpixel_bits: int = FEWEST_SUBPIXEL_BITS) -> DeviceModel:
    """Return the model of an unmeasured device, which may store the next lower or higher step.

    The model is valid if the depth of each pixel is computed independently, unlike D16 in softpipe.
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
