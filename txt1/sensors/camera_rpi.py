"""The Raspberry Pi's camera, through picamera2 or the program rpicam-vid: pictures with the times of their exposure.

How it works
------------

libcamera drives the camera. Its Python library, picamera2, comes with Raspberry Pi OS for the system's own Python.
Where it is not there, rpicam-vid runs as a process. It writes pictures to its output: JPEG after JPEG, or raw pictures
of one size, which are compressed here. After each picture it writes the picture's metadata to a pipe, as lines
NAME=VALUE and an empty line. Pictures and metadata come in the same order. A pipe damages nothing, so output that is no
picture ends the process.

*The time of a picture* is SensorTimestamp of its metadata: when the sensor's first row was exposed, in ns since the
start of the system. The kernel takes it from the monotonic clock. A picture without a sound time has the time of its
arrival.

*Silence.* A camera without a picture for PICTURE_PATIENCE s, and a process that ends, are begun again by the ladder of
`txt1.link.silence`: `Frames` does so for every HalError. Of pictures that have waited, only the newest counts.
"""

import os
import selectors
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from signal import SIGINT
from typing import Annotated, Any, Final, Literal

import numpy as np
from annotated_types import Ge, Le

from txt1.config.sources import checked
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.kernel.clock import RealClock, seconds
from txt1.sensors.base import Setup
from txt1.sensors.camera import jpeg
from txt1.sensors.frame_grabber import Exposed, Frames, Wait
from txt1.sensors.readings import CAMERA_MOUNT, Image, Mount, image_topic
from txt1.units import Positive, PositiveInt

PROGRAM: Final = ("rpicam-vid",)
# s without a picture after which the camera is begun again; and without the first, as a busy computer starts slowly
PICTURE_PATIENCE: Final = 5.0
START_PATIENCE: Final = 30.0
# s between two looks whether the sensor was closed
CLOSED_CHECK_PERIOD: Final = 0.1
# s that the program has to end by itself
PROGRAM_END_PATIENCE: Final = 1.0
# s: a picture that seems older has a time of another clock
PICTURE_AGE_MAX: Final = 2.0
# bytes read at once, and kept of the program's complaints
READ_BYTES: Final = 1 << 20
COMPLAINT_BYTES: Final = 4000
# pixels: a row of a raw picture is filled up to a multiple of this
ROW: Final = 64
# bytes of the longest JPEG
JPEG_MAX: Final = 1 << 24

# the first bytes of a JPEG, and its markers of the end and of the start of the scan
BEGIN: Final = b"\xff\xd8"
JPEG_END: Final = 0xD9
JPEG_SCAN: Final = 0xDA
# after 0xff within a scan: a byte 0xff itself, and restarts
WITHIN: Final = frozenset((0x00, *range(0xD0, 0xD8)))

_clock: Final = RealClock()


@dataclass(frozen=True, slots=True)
class RpiCameraOptions:
    """The camera, and its pictures."""

    camera: Annotated[int, Ge(0)] = 0
    """Its number in the list of `rpicam-hello --list-cameras`."""
    width: PositiveInt = 640
    """Pixels."""
    height: PositiveInt = 480
    """Pixels."""
    rate: Positive = 30.0
    """Pictures a second."""
    quality: Annotated[int, Ge(1), Le(95)] = 75
    """Quality of the JPEG."""
    rotation: Literal[0, 180] = 0
    """180 for a camera that hangs upside down, degrees."""
    program: tuple[str, ...] = ()
    """The program and its first arguments; empty: picamera2 where it is there, and rpicam-vid otherwise."""
    codec: Literal["mjpeg", "yuv420"] = "mjpeg"
    """What the program sends: JPEG, or raw pictures, which are compressed here."""
    mount: Mount = CAMERA_MOUNT
    """x, y, z (m) and yaw (rad) of the camera on the vehicle."""


def jpeg_length(data: bytes | bytearray) -> int | None:
    """Return the length of the JPEG that data begins with; 0: there is none, None: it is incomplete."""
    if data[:2] != BEGIN[: len(data)]:
        return 0
    at = 2
    while len(data) >= at + 2:
        if data[at] != 0xFF:
            return 0
        marker = data[at + 1]
        if marker == JPEG_END:
            return at + 2
        if len(data) < at + 4:
            return None
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == JPEG_SCAN:
            at = data.find(b"\xff", at)
            while at >= 0 and at + 1 < len(data) and data[at + 1] in WITHIN:
                at = data.find(b"\xff", at + 2)
            if at < 0:
                return None
    return None


def compressed(raw: bytes, width: int, height: int, quality: int) -> bytes:
    """Return a raw picture (YUV 4:2:0 in the full range: Y, then U and V of half the size) as JPEG."""
    try:
        from PIL import Image as Pillow
    except ImportError:
        raise MissingExtra("pictures as JPEG", "camera") from None
    size, half = (width, height), (width // 2, height // 2)
    luma, chroma = width * height, width * height // 4
    planes = [Pillow.frombytes("L", size, raw[:luma])]
    for at in (luma, luma + chroma):
        planes.append(Pillow.frombytes("L", half, raw[at : at + chroma]).resize(size))
    data = BytesIO()
    Pillow.merge("YCbCr", planes).save(data, "JPEG", quality=quality, subsampling="4:2:0")
    return data.getvalue()


def exposed(image: Image, timestamp: object) -> Exposed[Image] | Image:
    """Return a picture with its age by its time stamp (ns); the picture alone if that makes no sense."""
    try:
        age = seconds(_clock.now_ns() - int(timestamp))  # type: ignore[call-overload]
    except (TypeError, ValueError):
        return image
    return Exposed(image, age) if 0.0 <= age < PICTURE_AGE_MAX else image


class RpicamStream:
    """What rpicam-vid has written: pictures, and their metadata in the same order. It does no I/O."""

    def __init__(self, given: RpiCameraOptions) -> None:
        self._given = given
        self._pictures, self._told = bytearray(), bytearray()
        # whole pictures, and time stamps
        self._waiting: list[bytes] = []
        self._times: list[str] = []

    def picture(self, data: bytes) -> None:
        """Take bytes of its output. Raises HalError: they are no picture."""
        self._pictures += data
        size = self._given.width * self._given.height * 3 // 2
        while self._pictures:
            length = jpeg_length(self._pictures) if self._given.codec == "mjpeg" else size
            if length == 0 or (length is None and len(self._pictures) > JPEG_MAX):
                raise HalError("it sends no JPEG: is options.program a program like rpicam-vid?")
            if length is None or len(self._pictures) < length:
                return
            self._waiting.append(bytes(self._pictures[:length]))
            del self._pictures[:length]

    def metadata(self, data: bytes) -> None:
        """Take bytes of its metadata."""
        self._told += data
        *blocks, rest = bytes(self._told).split(b"\n\n")
        self._told = bytearray(rest)
        for block in blocks:
            values = dict(line.partition("=")[::2] for line in block.decode("latin-1").splitlines())
            self._times.append(values.get("SensorTimestamp", ""))

    def newest(self) -> tuple[bytes, str] | None:
        """Return the newest picture whose metadata has come, and its time stamp; None if there is none."""
        pairs = min(len(self._waiting), len(self._times))
        if not pairs:
            return None
        found = self._waiting[pairs - 1], self._times[pairs - 1]
        del self._waiting[:pairs], self._times[:pairs]
        return found


def command(given: RpiCameraOptions, metadata: int) -> list[str]:
    """Return the program's command line; `metadata` is the descriptor that takes the metadata."""
    options: dict[str, object] = {
        "camera": given.camera,
        "timeout": 0,
        "width": given.width,
        "height": given.height,
        "framerate": f"{given.rate:g}",
        "rotation": given.rotation,
        "codec": given.codec,
        "quality": given.quality,
        "output": "-",
        "metadata": f"/dev/fd/{metadata}",
        "metadata-format": "txt",
        "verbose": 0,
    }
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    return [*(given.program or PROGRAM), *words, "--nopreview", "--flush"]


def by_program(given: RpiCameraOptions, wait: Wait) -> Iterator[Exposed[Image] | Image]:
    """Yield the newest pictures of rpicam-vid as they come. Raises HalError, with the remedy."""
    name = (given.program or PROGRAM)[0]
    reading, writing = os.pipe()
    try:
        process = subprocess.Popen(  # noqa: S603
            command(given, writing),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=(writing,),
            # Ctrl-C is for the robot, which then ends it
            start_new_session=True,
        )
    except OSError as error:
        os.close(reading)
        raise HalError(
            f"{name}: {error.strerror}: on a Raspberry Pi `sudo apt install rpicam-apps`, or give options.program"
        ) from None
    finally:
        os.close(writing)
    try:
        yield from _pictures_of(process, reading, given, name, wait)
    finally:
        os.close(reading)
        _end(process)


def _pictures_of(
    process: subprocess.Popen[bytes], metadata: int, given: RpiCameraOptions, name: str, wait: Wait
) -> Iterator[Exposed[Image] | Image]:
    assert process.stdout is not None
    assert process.stderr is not None
    output, errors = process.stdout.fileno(), process.stderr.fileno()
    stream, complaints, last, patience = RpicamStream(given), b"", _clock.now_ns(), START_PATIENCE
    with selectors.DefaultSelector() as ready:
        for source in (output, errors, metadata):
            ready.register(source, selectors.EVENT_READ)
        while not wait(0.0):
            for key, _ in ready.select(CLOSED_CHECK_PERIOD):
                data = os.read(key.fd, READ_BYTES)
                if not data:
                    ready.unregister(key.fd)
                elif key.fd == metadata:
                    stream.metadata(data)
                elif key.fd == errors:
                    complaints = (complaints + data)[-COMPLAINT_BYTES:]
                else:
                    stream.picture(data)
            if output not in ready.get_map():
                raise HalError(f"{name} has ended: {_last(complaints)}; `rpicam-hello --list-cameras` lists them")
            newest = stream.newest()
            if newest is not None:
                last, patience = _clock.now_ns(), PICTURE_PATIENCE
                data, timestamp = newest
                if given.codec == "yuv420":
                    data = compressed(data, given.width, given.height, given.quality)
                yield exposed(Image(given.width, given.height, data, given.mount), timestamp)
            elif seconds(_clock.now_ns() - last) > patience:
                raise HalError(f"{name} has sent no picture in {patience:g} s: is the camera's cable plugged in?")


def _last(complaints: bytes) -> str:
    """Return the last line of what a program has complained of."""
    lines = complaints.decode("utf-8", "replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it told no reason")


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the program; it ends at its next picture, or is killed."""
    for pipe in (process.stdout, process.stderr):
        if pipe is not None:
            pipe.close()
    with suppress(OSError):
        process.send_signal(SIGINT)
    try:
        process.wait(PROGRAM_END_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def by_library(given: RpiCameraOptions, wait: Wait) -> Iterator[Exposed[Image] | Image]:
    """Yield the pictures of picamera2 as they come. Raises HalError, with the remedy."""
    from picamera2 import Picamera2

    try:
        camera: Any = Picamera2(given.camera)
    except (IndexError, RuntimeError) as error:
        raise HalError(
            f"camera {given.camera}: {error}: is its cable plugged in, and does no other program use it?"
        ) from None
    try:
        wanted: dict[str, Any] = {
            # red comes first in its arrays
            "main": {"size": (given.width, given.height), "format": "BGR888"},
            "controls": {"FrameRate": given.rate},
        }
        if given.rotation:
            from libcamera import Transform

            wanted["transform"] = Transform(hflip=1, vflip=1)
        camera.configure(camera.create_video_configuration(**wanted))
        camera.start()
        while not wait(0.0):
            # with a number it waits no longer, and without it for ever
            request = camera.capture_request(wait=PICTURE_PATIENCE)
            try:
                pixels, metadata = np.asarray(request.make_array("main"), np.uint8), request.get_metadata()
            finally:
                request.release()
            data = jpeg(pixels, given.quality)
            image = Image(pixels.shape[1], pixels.shape[0], data, given.mount)
            yield exposed(image, metadata.get("SensorTimestamp"))
    except (RuntimeError, TimeoutError) as error:
        why = str(error) or f"no picture in {PICTURE_PATIENCE:g} s"
        raise HalError(f"camera {given.camera}: {why}: is its cable plugged in?") from None
    finally:
        camera.close()


def pictures(given: RpiCameraOptions) -> Callable[[Wait], Iterator[Exposed[Image] | Image]]:
    """Return what begins the pictures: by picamera2 where it is there and no program is named."""
    way = by_program if given.program or find_spec("picamera2") is None else by_library
    return lambda wait: way(given, wait)


def create(setup: Setup) -> Frames[Image]:
    """Make the driver ``camera_rpi``; options: those of `RpiCameraOptions`."""
    field = f"sensors.{setup.name}.options"
    given = checked(RpiCameraOptions, setup.options, field)
    if given.codec == "yuv420" and (given.width % ROW or given.height % 2):
        raise ConfigError(
            f"{field}.width, height: {given.width} x {given.height}: rpicam-vid fills up the rows of raw pictures; "
            f"give a width that is a multiple of {ROW} and an even height, or the codec mjpeg"
        )
    return Frames(image_topic(setup.name), 1.0 / given.rate, pictures(given))
