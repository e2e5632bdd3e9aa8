"""The Raspberry Pi's camera: what rpicam-vid writes is read, FFmpeg judges it, and times are those of the exposures."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
import pytest

from tests.patience import LIMIT, until
from txt1.config import load
from txt1.errors import ConfigError, HalError
from txt1.sensors import camera_rpi
from txt1.sensors.base import Setup
from txt1.sensors.camera_rpi import RpiCameraOptions, RpicamStream, command, compressed, exposed, jpeg_length
from txt1.sensors.frame_grabber import Exposed, Frames
from txt1.sensors.readings import Image
from txt1.sensors.registry import DRIVERS
from txt1.sensors.virtual_rpicam import BAR_PERIOD, film, options

Pillow = pytest.importorskip("PIL.Image", reason="JPEG needs the extra 'camera'")

# rpicam_options_common.adoc and rpicam_options_vid.adoc of raspberrypi/documentation; metadata: core/options.cpp of
# raspberrypi/rpicam-apps
DOCUMENTED: Final = {
    *("camera", "timeout", "width", "height", "framerate", "rotation", "codec", "quality", "output"),
    *("metadata", "metadata-format", "verbose", "nopreview", "flush"),
}
DOUBLE: Final = [sys.executable, "-m", "txt1.sensors.virtual_rpicam"]
# starts within 20 ms, as it imports nothing
QUICK: Final = [sys.executable, "-S", "-c"]


def filmed(*words: str) -> tuple[bytes, bytes]:
    """What the virtual program writes: pictures, metadata."""
    output, metadata = BytesIO(), BytesIO()
    film(options().parse_args(["--output", "-", "--metadata-format", "txt", *words]), output, metadata)
    return output.getvalue(), metadata.getvalue()


def camera(name: str, **given: Any) -> Frames[Image]:
    made: Frames[Image] = DRIVERS.make("driver", "camera_rpi", Setup(name, given, load().config))
    return made


def place(data: bytes) -> float:
    """Where the bar of a picture begins, as a share of its width."""
    grey = np.asarray(Pillow.open(BytesIO(data)).convert("L"), float)
    return float(np.argmax(grey.mean(axis=0) > 130.0)) / grey.shape[1]


def test_every_option_that_is_given_is_one_of_rpicam_vids() -> None:
    words = command(RpiCameraOptions(), 7)
    assert words[0] == "rpicam-vid"
    given = {word.removeprefix("--") for word in words if word.startswith("--")}
    assert given <= DOCUMENTED
    # as the virtual one refuses what it does not know
    options().parse_args(words[1:])
    assert words[words.index("--metadata") + 1] == "/dev/fd/7"


def test_ffmpeg_finds_the_same_pictures_in_the_stream(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="FFmpeg needs the extra 'camera'")
    data, _ = filmed("--codec", "mjpeg", "--frames", "5", "--framerate", "100", "--width", "320", "--height", "240")
    found, at = [], 0
    while length := jpeg_length(data[at:]):
        found.append(data[at : at + length])
        at += length
    assert at == len(data)
    file = tmp_path / "stream.mjpeg"
    file.write_bytes(data)
    with av.open(str(file), format="mjpeg") as container:
        packets = [bytes(packet) for packet in container.demux(video=0) if packet.size]
    assert packets == found


def test_a_picture_ends_at_its_end_and_not_within_its_tables() -> None:
    # a quantisation table may hold the bytes of an end
    table = b"\xff\xdb\x00\x06\xff\xd9\xff\xd9"
    scan = b"\xff\xda\x00\x04\x01\x02" + b"\x11\xff\x00\x22\xff\xd3\x33"
    whole = b"\xff\xd8" + table + scan + b"\xff\xd9"
    assert jpeg_length(whole + whole) == len(whole)
    assert [jpeg_length(whole[:k]) for k in range(1, len(whole))] == [None] * (len(whole) - 1)
    assert jpeg_length(b"\x00\x00") == 0


@pytest.mark.parametrize("size", [1, 100, 1 << 20])
@pytest.mark.parametrize("codec", ["mjpeg", "yuv420"])
def test_each_picture_has_the_time_of_its_own_exposure(codec: Any, size: int) -> None:
    given = RpiCameraOptions(codec=codec, width=128, height=64)
    rate = 50
    words = ("--codec", codec, "--frames", "6", "--framerate", f"{rate}", "--width", "128", "--height", "64")
    data, told = filmed(*words)
    stream, found = RpicamStream(given), []
    for at in range(0, max(len(data), len(told)), size):
        stream.picture(data[at : at + size])
        stream.metadata(told[at : at + size])
        if (newest := stream.newest()) is not None:
            picture, stamp = newest
            jpeg = compressed(picture, 128, 64, 90) if codec == "yuv420" else picture
            found.append((round(place(jpeg) * BAR_PERIOD), int(stamp)))
    # of what has waited, only the newest counts
    assert len(found) == 1 if size > len(data) else len(found) > 1
    number, first = found[0]
    for shown, stamp in found:
        assert shown - number == round((stamp - first) * rate / 1e9)


def test_a_time_of_another_clock_is_not_believed() -> None:
    image = Image(1, 1, b"")
    now = time.monotonic_ns()
    told = exposed(image, str(now - 60_000_000))
    assert isinstance(told, Exposed)
    assert told.age >= 0.06
    for strange in (now + 3_600_000_000_000, now - 3_600_000_000_000, "", None, "soon"):
        assert exposed(image, strange) == image


def test_a_raw_picture_keeps_its_colour() -> None:
    # red, in the full range of JPEG
    raw = bytes([76]) * (64 * 32) + bytes([85]) * (32 * 16) + bytes([255]) * (32 * 16)
    pixels = np.asarray(Pillow.open(BytesIO(compressed(raw, 64, 32, 90))), int)
    assert pixels.shape == (32, 64, 3)
    assert abs(pixels - (254, 0, 0)).max() < 6


def test_rows_that_would_be_filled_up_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"sensors\.rpi_odd\.options\.width, height: 600 x 480: .* a multiple of 64"):
        camera("rpi_odd", codec="yuv420", width=600)
    assert camera("rpi_even", width=600)


@pytest.mark.parametrize(
    ("program", "why"),
    [
        (["/nowhere/rpicam-vid"], "No such file or directory: on a Raspberry Pi `sudo apt install rpicam-apps`"),
        ([*QUICK, "import sys; sys.exit('ERROR: *** no cameras available ***')"], "no cameras available"),
        ([*QUICK, "print('no picture', flush=True); import time; time.sleep(60)"], "it sends no JPEG"),
        ([*DOUBLE, "--zoom", "3"], "unrecognized arguments: --zoom"),
    ],
    ids=["missing", "without a camera", "another program", "of other options"],
)
async def test_a_program_that_cannot_film_says_why(program: list[str], why: str) -> None:
    sensor = camera("rpi_failing", program=program)
    with pytest.raises(HalError) as told:
        await sensor.open()
    assert why in str(told.value)
    assert "\n" not in str(told.value)
    await sensor.close()


async def test_a_program_that_hangs_is_ended_and_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(camera_rpi, "START_PATIENCE", 0.5)
    pid = tmp_path / "pid"
    hangs = f"import os, time; open({str(pid)!r}, 'w').write(str(os.getpid())); time.sleep(600)"
    sensor = camera("rpi_hanging", program=[*QUICK, hangs])
    with pytest.raises(HalError, match=r"has sent no picture in 0\.5 s: is the camera's cable plugged in\?"):
        await sensor.open()
    await sensor.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


@pytest.mark.waits
async def test_a_program_that_is_killed_is_begun_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_rpi, "START_PATIENCE", LIMIT)
    begun: list[int] = []
    start = camera_rpi.subprocess.Popen

    def started(*arguments: Any, **given: Any) -> Any:
        process = start(*arguments, **given)
        begun.append(process.pid)
        return process

    monkeypatch.setattr(camera_rpi.subprocess, "Popen", started)
    sensor = camera("rpi_killed", program=DOUBLE, width=64, height=64)
    await sensor.open()
    clock = asyncio.get_running_loop().time
    began, failures, times = clock(), [], []

    def reads(since: float = 0.0) -> bool:
        try:
            reading = sensor.read(clock() - began)
        except HalError as error:
            failures.append(str(error))
            return False
        if reading is not None:
            times.append(reading.time)
        return reading is not None and reading.time > since

    await until(reads)
    os.kill(begun[0], signal.SIGKILL)
    await until(lambda: reads() is False and bool(failures))
    told = len(times)
    await until(reads)
    assert "has ended" in failures[0]
    assert len(begun) >= 2
    assert times[told] > times[0]
    assert times == sorted(times)
    await sensor.close()
    for each in begun:
        with pytest.raises(ProcessLookupError):
            os.kill(each, 0)


# -- picamera2 -----------------------------------------------------------------------------------------------------


class Request:
    """A request of picamera2: two pixels, the left one red, exposed 0.2 s ago."""

    def __init__(self) -> None:
        self.released = False

    def make_array(self, stream: str) -> Any:
        assert (stream, self.released) == ("main", False)
        return np.tile(np.array([[[255, 0, 0]]], np.uint8), (16, 16, 1))

    def get_metadata(self) -> dict[str, Any]:
        return {"SensorTimestamp": time.monotonic_ns() - 200_000_000, "ExposureTime": 9000}

    def release(self) -> None:
        self.released = True


class Picamera2:
    """The methods of picamera2 that its manual shows."""

    made: list[Picamera2]
    silent = False

    def __init__(self, number: int) -> None:
        if number:
            raise IndexError("list index out of range")
        self.wanted: Any = None
        self.requests: list[Request] = []
        self.closed = False
        self.made.append(self)

    def create_video_configuration(self, main: Any, controls: Any) -> Any:
        return main | controls

    def configure(self, wanted: Any) -> None:
        self.wanted = wanted

    def start(self) -> None:
        assert self.wanted

    def capture_request(self, wait: float) -> Request:
        if self.silent:
            raise TimeoutError
        time.sleep(0.01)
        self.requests.append(Request())
        return self.requests[-1]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def picamera2(monkeypatch: pytest.MonkeyPatch) -> type[Picamera2]:
    module = ModuleType("picamera2")
    module.Picamera2 = Picamera2  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "picamera2", module)
    monkeypatch.setattr(camera_rpi, "find_spec", lambda name: name)
    monkeypatch.setattr(Picamera2, "made", [], raising=False)
    return Picamera2


async def test_picamera2_is_used_where_it_is_there(picamera2: type[Picamera2]) -> None:
    sensor = camera("rpi_library", width=16, height=16, rate=20.0)
    await sensor.open()
    clock = asyncio.get_running_loop().time
    began = clock() - 1.0
    found: list[Any] = []
    await until(lambda: found.append(sensor.read(clock() - began)) or found[-1] is not None)
    (made,) = picamera2.made
    assert made.wanted == {"size": (16, 16), "format": "BGR888", "FrameRate": 20.0}
    assert found[-1].time <= clock() - began - 0.2
    pixels = np.asarray(Pillow.open(BytesIO(found[-1].value.data)), int)
    assert abs(pixels - (254, 0, 0)).max() < 6
    await sensor.close()
    assert made.closed
    assert all(each.released for each in made.requests)


async def test_picamera2_without_a_camera_says_so(picamera2: type[Picamera2], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HalError, match=r"camera 1: list index out of range: is its cable plugged in"):
        await camera("rpi_second", camera=1).open()
    monkeypatch.setattr(picamera2, "silent", True)
    with pytest.raises(HalError, match=r"camera 0: no picture in 5 s: is its cable plugged in"):
        await camera("rpi_silent").open()
    assert picamera2.made[-1].closed
