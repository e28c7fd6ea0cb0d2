"""Versions, machine and scene: what a measurement must carry to be repeated."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from xfrustum.scenes.model.scene import Scene

_LIBRARIES = [
    "xfrustum",
    "numpy",
    "scipy",
    "trimesh",
    "embreex",
    "moderngl",
    "PyOpenGL",
    "scikit-image",
    "flip-evaluator",
]


@dataclass(frozen=True, kw_only=True)
class SceneName:
    """A scene's name and the SHA-256 of its content."""

    name: str
    hash: str

    @classmethod
    def of(cls, scene: Scene) -> SceneName:
        """Return the name and the hash of a scene."""
        return cls(name=scene.name, hash=scene.content_hash)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that make the numbers."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in _LIBRARIES}}


def machine() -> dict[str, str]:
    """Return processor, number of cores that this process may use, and operating system."""
    return {
        "processor": _processor(),
        "cores": str(len(os.sched_getaffinity(0))),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
    }


def _processor() -> str:
    # platform.processor() is empty on most Linux systems; the kernel knows the name.
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()
