"""Cameras keep the promises of every sensor, also when they fall silent or are unplugged."""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.config import load
from txt1.errors import HalError
from txt1.link.outages import Outage
from txt1.sensors import camera, camera_rpi
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.conformance import CutSource, SensorConformance
from txt1.sensors.registry import DRIVERS

pytest.importorskip("av", reason="cameras need the extra 'camera'")

# s between two pictures
PERIOD = 0.02
PICTURE = camera.jpeg(np.random.default_rng(1).integers(0, 255, (48, 64, 3), dtype=np.uint8))
# what rpicam-vid writes, as long as its file of outages is empty; it imports little, so that it starts at once
RPICAM = """
import os, sys, time
picture, outage = open(sys.argv[1], "rb").read(), sys.argv[2]
metadata = open(sys.argv[sys.argv.index("--metadata") + 1], "w")
while True:
    told = open(outage).read()
    if told == "unplugged":
        sys.exit("ERROR: *** no cameras available ***")
    exposed = time.monotonic_ns()
    time.sleep(0.02)
    if not told:
        sys.stdout.buffer.write(picture)
        sys.stdout.flush()
        print(f"SensorTimestamp={exposed}", end="\\n\\n", file=metadata, flush=True)
"""


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Silence is noticed in a second."""
    monkeypatch.setattr(camera, "PICTURE_PATIENCE", 1.0)
    monkeypatch.setattr(camera_rpi, "PICTURE_PATIENCE", 1.0)


class Streaming:
    """A camera that sends MJPEG to whoever connects."""

    def __init__(self) -> None:
        self._outage: Outage | None = None
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def cut(self, outage: Outage) -> None:
        self._outage = outage

    def restore(self) -> None:
        self._outage = None

    def close(self) -> None:
        self._server.close()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                line, _ = self._server.accept()
                threading.Thread(target=self._send, args=(line,), daemon=True).start()

    def _send(self, line: socket.socket) -> None:
        with line, suppress(OSError):
            if self._outage is None:
                # so many are looked at before the first is handed out
                line.sendall(PICTURE * 130)
            while self._outage is not Outage.UNPLUGGED:
                if self._outage is None:
                    line.sendall(PICTURE)
                time.sleep(PERIOD)


class Cut(CutSource):
    """The file that tells the program of its outage."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.restore()

    def cut(self, outage: Outage) -> None:
        self.path.write_text(outage)

    def restore(self) -> None:
        self.path.write_text("")


class TestStream(SensorConformance):
    """The driver of USB cameras, here with a stream: no computer of the tests has a V4L2 device."""

    speed = None
    settle = 20.0

    @pytest.fixture(autouse=True)
    def camera(self) -> Iterator[None]:
        self.streaming = Streaming()
        yield
        self.streaming.close()

    def make(self) -> Sensor[Any]:
        return self.at(self.streaming.port)

    def absent(self) -> Sensor[Any]:
        return self.at(9)

    def filmed(self) -> tuple[Sensor[Any], CutSource]:
        return self.make(), self.streaming

    def at(self, port: int) -> Sensor[Any]:
        options = {"source": f"tcp://127.0.0.1:{port}", "rate": 50.0}
        made: Sensor[Any] = DRIVERS.make("driver", "camera", Setup("streaming", options, load().config))
        return made


class TestRpicam(SensorConformance):
    """The Raspberry Pi's camera by a program."""

    speed = None
    settle = 20.0

    @pytest.fixture(autouse=True)
    def folder(self, tmp_path: Path) -> None:
        self.picture, self.outages = tmp_path / "picture.jpg", Cut(tmp_path / "outage")
        self.picture.write_bytes(PICTURE)

    def make(self) -> Sensor[Any]:
        program = (sys.executable, "-S", "-c", RPICAM, str(self.picture), str(self.outages.path))
        made: Sensor[Any] = DRIVERS.make(
            "driver", "camera_rpi", Setup("rpicam_cut", {"program": program}, load().config)
        )
        return made

    def filmed(self) -> tuple[Sensor[Any], CutSource]:
        return self.make(), self.outages


class Silent:
    """A V4L2 device that does not block, has sent two pictures, and sends no third one."""

    def __init__(self) -> None:
        self.streams, self.left = self, 2
        self.video = [self]

    def demux(self, video: int) -> Iterator[Silent]:
        while self.left:
            self.left -= 1
            yield self
        raise BlockingIOError(11, "Resource temporarily unavailable")

    def decode(self) -> list[Silent]:
        return [self]

    time, width, height = None, 64, 48

    def to_ndarray(self, format: str) -> Any:
        return np.zeros((48, 64, 3), np.uint8)

    def __enter__(self) -> Silent:
        return self

    def __exit__(self, *_: object) -> None: ...


def test_a_device_that_is_silent_is_left_and_was_opened_without_blocking(monkeypatch: pytest.MonkeyPatch) -> None:
    """FFmpeg's V4L2 input opens the device by O_NONBLOCK if the format has the flag `nonblock`."""
    given: list[dict[str, Any]] = []

    def opened(source: str, **options: Any) -> Silent:
        given.append(options)
        return Silent()

    monkeypatch.setattr("av.open", opened)
    found = camera.pictures(camera.VideoOptions(), time.sleep)
    assert next(found) is not None and next(found) is not None
    with pytest.raises(HalError, match="sends no pictures any more: is it plugged in"):
        next(found)
    assert given[0]["format"] == "v4l2" and given[0]["options"]["fflags"] == "nonblock"
