"""Devices by their index: what draws in software is no GPU."""

from __future__ import annotations

from xfrustum.raster.device.context import describe, gpu_indices, open_context
from xfrustum.reports.blocks import device_index


def test_the_device_that_draws_is_a_gpu_unless_it_is_software() -> None:
    context = open_context()
    renderer = describe(context)["renderer"].lower()
    context.release()
    software = any(name in renderer for name in ("llvmpipe", "softpipe", "swrast"))
    assert (device_index() in gpu_indices()) == (not software)
