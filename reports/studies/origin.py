"""What a study's numbers came from, and what measures here and now."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common import provenance
from xfrustum.reports.common.records import named_columns
from xfrustum.scenes.library.depth_family import CAR_RATIO, cars
from xfrustum.scenes.plate.double_frustum import Camera

VERSION_COLUMN, DEVICE_COLUMN = "version_{}", "device_{}"
"""Names of the columns of a version and of a fact about the device."""

MEASURING = ("scenes", "reference", "raster", "compare")
"""Packages whose sources decide what is measured."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What a study's numbers came from: versions of the libraries and the device, by name."""

    versions: Mapping[str, str] = field(metadata=named_columns(VERSION_COLUMN))
    devices: Mapping[str, str] = field(metadata=named_columns(DEVICE_COLUMN))


@cache
def measured_by() -> Origin:
    """Return the versions and the device that would measure here and now.

    Raises
    ------
    InputError
        No usable OpenGL context.
    """
    scene = cars(CAR_RATIO, Camera.C, (1, 1))
    with Rasterizer(scene) as rasterizer:
        opengl = {f"OpenGL {name}": value for name, value in rasterizer.device.items()}
    versions = {**provenance.versions(), **Reference(scene).versions}
    return Origin(versions=versions, devices={**provenance.machine(), **opengl})


def origin_hash(origin: Origin, modules: Sequence[str] = ()) -> str:
    """Return a hash of everything but the parameters that a result depends on.

    The sources that make scenes, truth, raster and comparison, the versions of the libraries, and the
    OpenGL that drew. Results of another origin are neither used nor touched.

    Parameters
    ----------
    origin
        What measures.
    modules
        Modules of `reports` whose sources decide what is measured too, as paths in its folder.
    """
    opengl = {name: text for name, text in origin.devices.items() if name.startswith("OpenGL")}
    digest = hashlib.sha256(json.dumps([dict(origin.versions), opengl], sort_keys=True).encode())
    root = files("xfrustum")
    sources = [root / "reports" / name for name in modules]
    for package in MEASURING:
        folder = Path(str(root / package))
        sources += sorted(path for path in folder.rglob("*") if path.suffix in {".py", ".vert", ".frag"})
    for source in sources:
        digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()
