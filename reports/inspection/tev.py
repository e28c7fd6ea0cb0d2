"""The channels of a page sent to a running tev viewer, github.com/Tom94/tev, through its TCP port."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.reports.inspection.page import read_inspection
from xfrustum.scenes.errors import InputError


def check_tev() -> None:
    """Raise InputError where the library that speaks with tev is missing.

    Raises
    ------
    InputError
        It is not installed.
    """
    if importlib.util.find_spec("tevclient") is None:
        raise InputError("--tev needs the package tevclient: pip install '.[tev]' in the checkout")


def send_page(page: Path, title: str, address: str) -> int:
    """Send truth, image and errors of every hogel of a page to tev; return the number of images sent.

    Parameters
    ----------
    page
        Inspection page that was written.
    title
        Beginning of the names under which tev lists the images.
    address
        Host and port of the viewer.

    Raises
    ------
    InputError
        No viewer answers, or the page cannot be read.
    """
    check_tev()
    from tevclient import Ipc  # noqa: PLC0415 - an optional dependency

    host, _, port = address.rpartition(":")
    sent = 0
    try:
        with Ipc(host, int(port)) as viewer:
            for hogel in read_inspection(page):
                for name, channels in hogel.values().items():
                    _send(viewer, f"{title} {hogel.aperture[0]},{hogel.aperture[1]} {name}", hogel, channels)
                    sent += 1
    except (OSError, OverflowError) as error:  # a port beyond 65535 overflows
        raise InputError(
            f"--tev {address}: no viewer answers ({getattr(error, 'strerror', None) or error}); start one "
            f"first: tev --host {address.replace('localhost', '127.0.0.1')}; {page} is written, all the same"
        ) from error
    return sent


def _send(viewer: Any, name: str, hogel: InspectedHogel, channels: dict[str, NDArray[Any]]) -> None:
    """Send one image: numbers become floats, which are exact up to 2^24."""
    names = list(channels)
    width, height = hogel.size
    pixels = np.stack([values.astype(np.float32) for values in channels.values()], axis=-1)
    viewer.create_image(name, width=width, height=height, channel_names=names, grab_focus=False)
    viewer.update_image(name, pixels, names)
