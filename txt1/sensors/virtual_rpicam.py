"""A virtual rpicam-vid: ``python -m txt1.sensors.virtual_rpicam --codec mjpeg --timeout 0 --output - ...``.

It takes the options of rpicam-vid that a program needs, writes pictures and metadata in its order, and shows a bar that
goes to the right. A time stamp is that of the exposure, `READ_OUT_DELAY` s before the picture is written.
"""

import argparse
import os
import signal
import sys
from threading import Event
from typing import Any, BinaryIO, Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from txt1.kernel.clock import RealClock
from txt1.sensors.camera import jpeg

# s from exposure to output, as through the sensor's read-out and the image processor
READ_OUT_DELAY: Final = 0.06
# s of an exposure
EXPOSURE: Final = 0.01
# pictures in which the bar passes the picture
BAR_PERIOD: Final = 64
# brightness of the ground and of the bar
GROUND: Final = 40
BAR: Final = 220
# ms for a time-out of 0
NO_TIME_OUT: Final = 10**9
# of a program that fails
FAILED: Final = 255


class RpicamOptions(argparse.ArgumentParser):
    """Refuses options as rpicam-vid does."""

    def error(self, message: str) -> NoReturn:
        """Tell what is wrong, and end."""
        print(f"ERROR: *** {message} ***", file=sys.stderr)
        sys.exit(FAILED)


def options() -> RpicamOptions:
    """Return the options, with the defaults of rpicam-vid."""
    parser = RpicamOptions(prog="rpicam-vid", allow_abbrev=False, add_help=False)
    parser.add_argument("--camera", type=int, default=0)
    parser.add_argument("-t", "--timeout", type=int, default=5000, help="ms; 0: for ever")
    parser.add_argument("--frames", type=int, default=0)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--framerate", type=float, default=30.0)
    parser.add_argument("--rotation", type=int, choices=(0, 180), default=0)
    parser.add_argument("--codec", choices=("h264", "mjpeg", "yuv420", "libav"), default="h264")
    parser.add_argument("-q", "--quality", type=int, default=50)
    parser.add_argument("-o", "--output", default="")
    parser.add_argument("--flush", action="store_true")
    parser.add_argument("--metadata", default="")
    parser.add_argument("--metadata-format", choices=("json", "txt"), default="json")
    parser.add_argument("-v", "--verbose", type=int, default=1)
    parser.add_argument("-n", "--nopreview", action="store_true")
    return parser


def drawn(given: argparse.Namespace, number: int) -> NDArray[np.uint8]:
    """Return a grey picture (height, width) whose bar stands at `bar`."""
    picture = np.full((given.height, given.width), GROUND, np.uint8)
    picture[:, round(bar(number) * given.width) :][:, : max(given.width // BAR_PERIOD, 1)] = BAR
    return picture[::-1, ::-1] if given.rotation else picture


def bar(number: int) -> float:
    """Return the place of the bar's left edge in a picture, as a share of the width."""
    return number % BAR_PERIOD / BAR_PERIOD


def encoded(given: argparse.Namespace, number: int) -> bytes:
    """Return the bytes of a picture."""
    grey = drawn(given, number)
    if given.codec == "mjpeg":
        return jpeg(np.repeat(grey[:, :, None], 3, 2), given.quality)
    # a buffer of libcamera: each row is filled up to a multiple of 64
    rows = np.zeros((given.height, -(-given.width // 64) * 64), np.uint8)
    rows[:, : given.width] = grey
    return rows.tobytes() + bytes([128]) * (rows.size // 2)


def told(timestamp: int, form: str, first: bool) -> bytes:
    """Return the metadata of a picture."""
    values: dict[str, Any] = {
        "SensorTimestamp": timestamp,
        "ExposureTime": round(EXPOSURE * 1e6),
        "AnalogueGain": 2.0,
        "ColourGains": "[ 1.6, 1.8 ]",
        "FrameDuration": 33333,
    }
    if form == "txt":
        return "".join(f"{name}={value}\n" for name, value in values.items()).encode() + b"\n"
    lines = ",".join(f'\n    "{name}": {value}' for name, value in values.items())
    return ("[\n{" if first else ",\n{").encode() + f"{lines}\n}}".encode()


def film(given: argparse.Namespace, output: BinaryIO, metadata: BinaryIO) -> None:
    """Write pictures at their rate, each `READ_OUT_DELAY` s after its exposure."""
    now, wait = RealClock().now_ns, Event().wait
    period, began, number, first = round(1e9 / given.framerate), now(), 0, True
    ends = began + (given.timeout or NO_TIME_OUT) * 1_000_000
    while now() < ends and not 0 < given.frames <= number:
        # a camera drops what is not fetched in time
        number = max(number, (now() - began) // period - 1)
        exposed = began + number * period
        wait(max(0.0, (exposed - now()) / 1e9 + READ_OUT_DELAY))
        output.write(encoded(given, number))
        if given.flush:
            output.flush()
        metadata.write(told(exposed, given.metadata_format, first))
        metadata.flush()
        number, first = number + 1, False


def main() -> None:
    """Be the program."""
    parser = options()
    given = parser.parse_args()
    if given.camera:
        parser.error("the value of option 'camera' is not valid: no cameras available")
    if given.codec in ("h264", "libav") or given.output != "-":
        parser.error("this virtual camera writes mjpeg and yuv420 to --output -")
    signal.signal(signal.SIGINT, lambda *_: sys.exit())
    with open(given.metadata or os.devnull, "wb") as metadata:
        film(given, sys.stdout.buffer, metadata)


if __name__ == "__main__":
    try:
        main()
    except BrokenPipeError:
        print("ERROR: *** failed to write output bytes ***", file=sys.stderr)
        os._exit(FAILED)
