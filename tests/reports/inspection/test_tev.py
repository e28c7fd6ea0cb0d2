"""`--tev` sends every image of a page in tev's own packets, and says what to do where no viewer answers."""

from __future__ import annotations

import importlib.util
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from tests.reports.inspection.conftest import Inspected
from xfrustum.cli.main import main
from xfrustum.reports.inspection import tev
from xfrustum.reports.inspection.page import PAGE, read_inspection
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.errors import InputError

pytest.importorskip("tevclient", reason="needs tevclient, an optional dependency")

CREATE, UPDATE = 4, 6
"""Packet types of tev: CreateImage, and UpdateImage in its third version."""


@dataclass(kw_only=True)
class Reader:
    """Reads the fields of one packet: little-endian numbers, and strings that end with a zero."""

    content: bytes
    place: int = 0

    def numbers(self, form: str) -> tuple[int, ...]:
        found = struct.unpack_from("<" + form, self.content, self.place)
        self.place += struct.calcsize("<" + form)
        return found

    def text(self) -> str:
        end = self.content.index(0, self.place)
        found = self.content[self.place : end].decode()
        self.place = end + 1
        return found


@dataclass(kw_only=True)
class Viewer:
    """A viewer that understands tev's packets as its source does, and keeps what it is shown."""

    port: int = 0
    images: dict[str, dict[str, Singles]] = field(default_factory=dict)

    def serve(self, listening: socket.socket) -> None:
        with listening.accept()[0] as connection, connection.makefile("rb") as stream:
            while head := stream.read(4):
                (length,) = struct.unpack("<I", head)
                self.take(Reader(content=stream.read(length - 4)))

    def take(self, packet: Reader) -> None:
        kind, _ = packet.numbers("bb")
        name = packet.text()
        if kind == CREATE:
            width, height, count = packet.numbers("iii")
            names = [packet.text() for _ in range(count)]
            self.images[name] = {one: np.full((height, width), -1.0, dtype=np.float32) for one in names}
            return
        assert kind == UPDATE
        (count,) = packet.numbers("i")
        names = [packet.text() for _ in range(count)]
        x, y, width, height = packet.numbers("iiii")
        offsets, strides = (packet.numbers(f"{count}q") for _ in range(2))
        values = np.frombuffer(packet.content, dtype="<f4", offset=packet.place)
        for one, offset, stride in zip(names, offsets, strides, strict=True):
            tile = values[offset::stride][: width * height].reshape(height, width)
            self.images[name][one][y : y + height, x : x + width] = tile


@contextmanager
def listening_viewer() -> Iterator[Viewer]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        viewer = Viewer(port=listening.getsockname()[1])
        thread = Thread(target=viewer.serve, args=(listening,), daemon=True)
        thread.start()
        yield viewer
        thread.join(60)
        assert not thread.is_alive(), "the sender has closed the connection"


def test_a_viewer_is_shown_every_channel_of_every_layer(inspected: Inspected) -> None:
    page = inspected.pages["survey"] / PAGE
    with listening_viewer() as viewer:
        sent = tev.send_page(page, "parts", f"localhost:{viewer.port}")
    hogels = read_inspection(page)
    assert sent == len(viewer.images) == 3 * len(hogels)
    for hogel in hogels:
        for layer, channels in hogel.values().items():
            shown = viewer.images[f"parts {hogel.aperture[0]},{hogel.aperture[1]} {layer}"]
            assert list(shown) == list(channels)
            for name, values in channels.items():
                np.testing.assert_array_equal(shown[name], values.astype(np.float32), err_msg=name)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as one:
        return int(one.getsockname()[1])


def test_where_no_viewer_answers_the_files_are_there_and_one_line_says_how_to_start_one(
    inspected: Inspected, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    address, images = f"localhost:{free_port()}", str(inspected.scene.parent / "image-{i}-{j}.exr")
    arguments = ["verify", str(inspected.scene), images, "--apertures", "1,0", "--quiet"]
    assert main([*arguments, "--out", str(tmp_path / "out"), "--tev", address]) == 1
    told = capsys.readouterr()
    assert "Not right" in told.out
    (line,) = told.err.strip().splitlines()
    assert "no viewer answers" in line and f"tev --host {address.replace('localhost', '127.0.0.1')}" in line
    assert {"index.html", PAGE, "verification.json"} == {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["verify", "two-spheres", "{i}{j}.png", "--tev"], "--out"),
        (["survey", "--near", "1", "--out", "x", "--tev", "two-spheres"], "HOST:PORT"),
        (["survey", "two-spheres", "--near", "1", "--out", "x", "--tev", "localhost:99999"], "65535"),
    ],
)
def test_strange_wishes_are_refused_before_any_work(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert word in capsys.readouterr().err


def test_without_the_library_the_line_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install"):
        tev.check_tev()
