"""How a device draws: its roundings, known by measurement and not from its maker.

`xfrustum.raster.device.fingerprint` measures them, `xfrustum.compare.rounding` explains pixels by them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.double_frustum import DepthFormat

Range = tuple[float, float]
"""Lowest and highest difference of what is stored and what is exact, in steps of a format."""

NEAREST: Range = (-0.5, 0.5)
"""Storing the nearest step."""

SIXTEENTH = 1 / 16
"""Part of a step to which some devices cut a depth off before they round it to a step."""


@dataclass(frozen=True, kw_only=True)
class DeviceModel:
    """The roundings of one kind of device."""

    name: str  #: for people, and in what commands print as `device_model`
    #: Binary digits of a pixel to which vertices are snapped (GL_SUBPIXEL_BITS)
    subpixel_bits: int
    #: Whether depth, 1 / w and varyings are interpolated from snapped vertices, so that they move with edges
    snaps_depth: bool
    #: d16, d24: how a depth in float32 is rounded to the steps of a format. D32F keeps it as it is.
    d16: Range = NEAREST
    d24: Range = NEAREST
    filter_bits: int | None = None  #: of the weights of a bilinear filter; None for float32

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
        return {DepthFormat.D16: self.d16, DepthFormat.D24: self.d24, DepthFormat.D32F: (0.0, 0.0)}[depth]

    def stored_steps(self, depth: DepthFormat) -> float:
        """Return within how many steps of a format two equal depths may be stored; 0 for D32F."""
        low, high = self.stored(depth)
        return high - low

    def as_json(self) -> dict[str, Any]:
        """Return the model as `device.json` has it under `model`."""
        return asdict(self)

    @classmethod
    def read(cls, path: Path) -> DeviceModel:
        """Read the model of a `device.json`; InputError where it is not one."""
        try:
            found = json.loads(path.read_text(encoding="utf-8"))["model"]
            model = cls(**{one.name: found[one.name] for one in fields(cls)})
            model = cls(**{**vars(model), "d16": _range(model.d16), "d24": _range(model.d24)})
            whole = type(model.subpixel_bits) is int and type(model.snaps_depth) is bool
            if not whole or type(model.filter_bits) not in (int, type(None)):
                raise ValueError("a value has another type than those that are written")
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}; xfrustum device --out makes one") from error
        except (ValueError, TypeError, KeyError, UnicodeDecodeError) as error:
            raise InputError(
                f"{path} is no device.json ({error}); xfrustum device --out DIR writes one where it is drawn"
            ) from error
        return model


def _range(values: Any) -> Range:
    low, high = values
    return float(low), float(high)


LLVMPIPE = DeviceModel(name="llvmpipe", subpixel_bits=8, snaps_depth=False)
"""Mesa's software renderer, which takes edges from snapped vertices, and planes from those in float32."""

H100 = DeviceModel(
    name="NVIDIA H100",
    subpixel_bits=8,
    snaps_depth=True,
    # A depth is cut off to sixteenths of a step, and half goes down: the next step begins at 9 / 16.
    d16=(-0.5 - SIXTEENTH, 0.5),
    filter_bits=8,
)
"""NVIDIA H100, driver 580.159.04, as measured in November 2026."""

FEWEST_SUBPIXEL_BITS = 4
"""Fewest subpixel bits that OpenGL allows (GL_SUBPIXEL_BITS): every rasterizer has at least so many."""


def safe_model(subpixel_bits: int = FEWEST_SUBPIXEL_BITS) -> DeviceModel:
    """Return the model of a device that nobody has measured: it may store the step below, or that above."""
    wide = -1.0, 1.0
    return DeviceModel(
        name=f"any device with {subpixel_bits} subpixel bits",
        subpixel_bits=subpixel_bits,
        snaps_depth=True,
        d16=wide,
        d24=wide,
        filter_bits=8,
    )


KNOWN = {"llvmpipe": LLVMPIPE, "NVIDIA H100": H100}
"""Models by a part of the renderer's name (GL_RENDERER)."""


def model_of(device: Mapping[str, str]) -> DeviceModel:
    """Return the model of a device by its names: a known one, else one that holds for any."""
    bits = int(device["subpixel_bits"])
    for name, model in KNOWN.items():
        if name in device["renderer"] and model.subpixel_bits == bits:
            return model
    return safe_model(bits)
