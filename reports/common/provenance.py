"""Versions, machine, and commands that repeat a result."""

import os
import platform
import re
import shlex
from importlib import metadata
from pathlib import Path

from xfrustum.reference.llvm import array_device
from xfrustum.scenes import Aperture, DoubleFrustum, Scene

_LIBRARIES = ("xfrustum", "numpy", "scipy", "trimesh", "embreex", "moderngl", "PyOpenGL")
_JUDGING = ("scikit-image", "flip-evaluator")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that make the numbers."""
    libraries = {name: metadata.version(name) for name in (*_LIBRARIES, *_JUDGING)}
    return {"python": platform.python_version(), **libraries}


def machine() -> dict[str, str]:
    """Return processor, usable cores, system, and the place of Dr.Jit arrays."""
    # platform.processor() is empty on most Linux systems; the kernel has the name.
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8", errors="replace") if cpuinfo.exists() else ""
    named = re.search(r"^model name\s*:\s*(.*\S)", text, re.MULTILINE)
    return {
        "processor": named[1] if named else platform.processor() or platform.machine(),
        # Containers and job schedulers grant fewer cores than the machine has.
        "cores": str(len(os.sched_getaffinity(0))),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "arrays": array_device(),
    }


def scene_command(verb: str, scene: Scene, *words: str) -> str:
    """Return a command about a scene, quoted for a shell."""
    return shlex.join(["xfrustum", verb, scene.source or scene.name, *words])


def raster_command(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> str:
    """Return the command that draws an aperture with these settings, quoted for a shell."""
    words = [*aperture_option(scene, aperture), *settings_words(settings)]
    return scene_command("raster", scene, *words, "--out", "raster.exr")


def aperture_option(scene: Scene, aperture: Aperture) -> list[str]:
    """Return the option that names an aperture; nothing for the middle one."""
    return (
        []
        if aperture == scene.plate.middle
        else ["--aperture", f"{aperture.column},{aperture.row}"]
    )


def plate_command(scene: Scene, settings: DoubleFrustum) -> str:
    """Return the command that draws the whole plate with these settings, quoted for a shell."""
    out = f"{Path(scene.source or scene.name).stem}.zarr"
    return scene_command("plate", scene, *settings_words(settings), "--out", out)


def settings_words(settings: DoubleFrustum) -> list[str]:
    """Return the options that name settings, to the last digit; nothing for usual cameras."""
    words = ["--near", _number(settings.near), "--depth", str(settings.depth)]
    words += ["--mapping", str(settings.mapping)]
    usual = DoubleFrustum(near=settings.near)
    for name in ("pivot", "fit", "offset", "slabs", "camera", "cull"):
        value = getattr(settings, name)
        # Options that are left out have their usual values.
        if value != getattr(usual, name):
            every = value if isinstance(value, tuple) else (value,)
            texts = (_number(part) if isinstance(part, float) else str(part) for part in every)
            words += [f"--{name}", ",".join(texts)]
    return words


def _number(value: float) -> str:
    """Write a number with up to six digits if these are exact, else with all its digits."""
    short = f"{value:g}"
    # A printed command must give the same settings, bit for bit.
    return short if float(short) == value else repr(value)


def unexamined_truth(tracer: str) -> str:
    """Return the note on a truth by an uncertified tracer, such as `embree`."""
    return f"truth: {tracer.capitalize()} alone, not examined"
