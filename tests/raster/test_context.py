"""The OpenGL context: drivers that give exactly what is asked for, and those that are too old."""

from __future__ import annotations

from typing import Any

import moderngl
import pytest

from xfrustum.raster.device import context
from xfrustum.reports.blocks import device_index
from xfrustum.scenes import InputError


def test_opengl_4_5_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """NVIDIA's driver gives the version that is asked for and no newer one; Mesa gives its newest."""
    asked: list[int] = []
    create = moderngl.create_context

    def strict(require: int = 330, **options: Any) -> moderngl.Context:
        asked.append(require)
        return create(require=require, **options)

    monkeypatch.setattr(moderngl, "create_context", strict)
    opened = context.open_context()
    assert opened.version_code >= 450
    opened.release()
    assert asked == [450]


def test_where_opengl_is_too_old_the_error_says_what_the_machine_has(monkeypatch: pytest.MonkeyPatch) -> None:
    create = moderngl.create_context

    def old(require: int = 330, **options: Any) -> moderngl.Context:
        if require > 440:
            raise ValueError("Requested OpenGL version 450, got version 440")
        return create(require=require, **options)

    found = create(standalone=True, backend="egl")  # type: ignore[arg-type]  # a name, as its code takes it
    renderer, version = found.info["GL_RENDERER"], found.info["GL_VERSION"]
    found.release()
    monkeypatch.setattr(moderngl, "create_context", old)
    with pytest.raises(InputError) as caught:
        context.open_context()
    assert renderer in str(caught.value) and version in str(caught.value)
    assert "4.5" in str(caught.value) and "install an EGL driver" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_device_that_draws_is_a_gpu_unless_it_is_software() -> None:
    opened = context.open_context()
    renderer = context.describe(opened)["renderer"].lower()
    opened.release()
    software = any(name in renderer for name in ("llvmpipe", "softpipe", "swrast"))
    assert (device_index() in context.gpu_indices()) == (not software)
