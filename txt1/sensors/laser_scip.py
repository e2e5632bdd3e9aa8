"""Hokuyo laser scanners with SCIP 2.0 (URG-04LX and its successors): the decoder, and the driver.

The URG-04LX starts in SCIP 1.1, on its serial line at 19 200 baud. The command SCIP2.0 ends this mode, and SS sets
another rate. So a scanner that stays silent at the configured rate is also called at the rates of its first mode.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import inf, nan, tau
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Le, MinLen

from txt1.config.sources import checked
from txt1.errors import HalError
from txt1.link.device import DevicePort
from txt1.sensors.base import Setup
from txt1.sensors.readings import LASER_MOUNT, Mount, Scan, scan_topic
from txt1.sensors.stream import Codec, Measured, Streamed, Unwrapped
from txt1.units import NotNegative, PositiveInt

# characters of a line of data
LINE_CHARACTERS: Final = 64
# milliseconds at which the time stamp starts again at 0
CLOCK_WRAP: Final = 2.0**24
# bytes of the longest answer: 1081 ranges take 3500
ANSWER_BYTES_MAX: Final = 20000
# the command that serves a virtual scanner
SERVER: Final = "txt1 sensor virtual laser"
# rates of a scanner's first mode, bits a second
FIRST_RATES: Final = (19200, 38400, 57600)
# what a status of an answer means, in the words of the protocol's description
STATUSES: Final = {
    "01": "starting step has characters that are no digits",
    "02": "end step has characters that are no digits",
    "03": "cluster count has characters that are no digits",
    "04": "end step is out of range",
    "05": "end step is smaller than the starting step",
    "06": "scan interval has characters that are no digits",
    "07": "number of scans has characters that are no digits",
    "0A": "it cannot make the data, as its memory is short",
    "0B": "its buffer is short, or the command is repeated",
    "0C": "the command has too few parameters",
    "0D": "the command has a wrong parameter",
    "0E": "it does not know the command",
    "0F": "it does not know the command",
    "0G": "the command is too long",
    "0H": "the command has a wrong parameter",
    "10": "its laser is off",
    "98": "it goes on after it has checked itself",
}


def check_character(text: bytes) -> int:
    """Return the checksum of a line: the lower six bits of the sum of its characters, plus 0x30."""
    return (sum(text) & 0x3F) + 0x30


@lru_cache(10_000)
def encode(value: int, length: int) -> bytes:
    """Return a number in `length` characters of six bits, the highest first, each plus 0x30."""
    return bytes(((value >> 6 * (length - 1 - k)) & 0x3F) + 0x30 for k in range(length))


def decode(text: bytes) -> int:
    """Return the number in these characters."""
    value = 0
    for character in text:
        value = value << 6 | (character - 0x30) & 0x3F
    return value


class Parameters(dict[str, int]):
    """The numbers of a PP answer: DMIN, DMAX (mm), ARES, AMIN, AMAX, AFRT (steps), SCAN (rpm)."""

    NEEDED: Final = ("DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN")

    def sound(self) -> bool:
        """Return whether these numbers suffice to request and decode a scan."""
        if any(name not in self for name in self.NEEDED):
            return False
        fits = 0 <= self["AMIN"] <= self["AFRT"] <= self["AMAX"] <= 9999
        return fits and 0 <= self["DMIN"] < self["DMAX"] and self["ARES"] > 0 and self["SCAN"] > 0


class ScipDecoder(Codec[Scan]):
    """Decodes the answers of a scanner into scans. It requests the parameters, then scans continuously.

    `cluster` steps make a beam. An answer ends with an empty line. A damaged answer is discarded whole.
    `wake` is the rate in bits a second that the scanner is told to take, before it is called at that rate; 0: none.
    """

    def __init__(self, cluster: int = 1, mount: Mount = LASER_MOUNT, wake: int = 0) -> None:
        # QT stops scans and the laser
        super().__init__(b"SCIP2.0\n" + (b"SS%06d\n" % wake if wake else b"QT\nPP\n"), b"QT\n")
        self.parameters = Parameters()
        """The scanner's parameters, as reported."""
        self._cluster, self._mount = cluster, mount
        self._clock = Unwrapped(CLOCK_WRAP)
        self._request = b""

    def feed(self, data: bytes) -> list[Measured[Scan]]:
        """Take bytes; return the scans that they complete. Raises HalError if the scanner reports a hardware fault."""
        *answers, self._rest = (self._rest + data).replace(b"\r", b"").split(b"\n\n")
        if len(self._rest) > ANSWER_BYTES_MAX:
            self._rest = b""
            self.faults += 1
        found = []
        for answer in answers:
            echo, *lines = answer.lstrip(b"\n").split(b"\n")
            if echo[:2] == b"PP" and lines[:1] in ([b"E"], [b"0E"]):
                # this form of status is that of SCIP 1.1
                self.faults += 1
                self.trouble = "it speaks SCIP 1.1, and does not obey SCIP2.0"
            elif echo[:2] == b"PP":
                self._take_parameters(lines)
            elif self._request and echo[: len(self._request)] == self._request and lines:
                scan = self._take_scan(lines)
                if scan is not None:
                    found.append(scan)
            elif echo[:2] not in (b"QT", b"SC", b"SS"):
                self.faults += 1
        return found

    def _take_parameters(self, lines: list[bytes]) -> None:
        """Store the parameters, and request scans."""
        for line in lines[1:]:
            # the line ends with ; and the checksum
            name, _, value = line[:-2].partition(b":")
            if line[-2:-1] != b";" or check_character(line[:-2]) != line[-1]:
                self.faults += 1
            elif value.isdigit():
                self.parameters[name.decode("ascii", "replace")] = int(value)
        if not self.parameters.sound():
            self.trouble = f"its parameters make no sense: {self.parameters or 'there are none'}"
            return
        p = self.parameters
        self._request = f"MD{p['AMIN']:04d}{p['AMAX']:04d}{self._cluster:02d}0".encode()
        self._out = self._request + b"00\n"

    def _take_scan(self, lines: list[bytes]) -> Measured[Scan] | None:
        """Return the scan of an answer to MD; None if the answer has none."""
        status, *rest = lines
        code = status[:2]
        if len(status) != 3 or check_character(code) != status[2]:
            self.faults += 1
            return None
        # the scanner will send scans
        if code == b"00":
            return None
        if code != b"99":
            if code.isdigit() and 50 <= int(code) <= 97:
                raise HalError(
                    f"the laser scanner reports hardware trouble (status {code.decode()}): switch it off and on"
                )
            self.faults += 1
            self.trouble = told(code)
            return None
        if not rest or any(len(line) < 2 or check_character(line[:-1]) != line[-1] for line in rest):
            self.faults += 1
            return None
        p, stamp, text = self.parameters, rest[0][:-1], b"".join(line[:-1] for line in rest[1:])
        beams, rest_of_text = divmod(len(text), 3)
        # the steps left over may make another beam
        whole = (p["AMAX"] - p["AMIN"] + 1) // self._cluster
        if len(stamp) != 4 or rest_of_text or not whole <= beams <= whole + 1:
            self.faults += 1
            return None
        characters = (np.frombuffer(text, np.uint8).reshape(-1, 3).astype(np.int32) - 0x30) & 0x3F
        mm = characters @ np.array((4096, 64, 1), np.int32)
        ranges = (mm / 1000.0).astype(np.float32)
        # an error code,
        ranges[mm < p["DMIN"]] = nan
        # of which this code means that nothing is near
        ranges[mm == 0] = inf
        ranges[mm > p["DMAX"]] = inf
        step, turn = tau / p["ARES"], 60.0 / p["SCAN"]
        # the range of a cluster is its smallest, at its middle for want of better knowledge
        centre = 0.5 * (self._cluster - 1)
        scan = Scan(
            (p["AMIN"] + centre - p["AFRT"]) * step,
            self._cluster * step,
            self._cluster * turn / p["ARES"],
            ranges,
            p["DMIN"] / 1000.0,
            p["DMAX"] / 1000.0,
            None,
            self._mount,
            turn,
        )
        return Measured(scan, self._clock(decode(stamp)) / 1000.0, scan.time_step * (beams - 1))


def told(code: bytes) -> str:
    """Return a status of MD in words."""
    text = code.decode("ascii", "replace")
    if code.isdigit() and 20 < int(code) < 50:
        words = "it has stopped, and checks itself"
    else:
        words = STATUSES.get(text, "the description has no such status")
    return f"status {text}: {words}"


def rate_for(connections: int, baud: int) -> int:
    """Return the rate at which a silent scanner is called next, bits a second.

    After as many connections in the present silence. It is the configured rate, and in turns one of the first mode.
    """
    return FIRST_RATES[connections // 2 % len(FIRST_RATES)] if connections % 2 else baud


@dataclass(frozen=True, slots=True)
class ScipOptions:
    """The place of the scanner, and its mounting."""

    port: Annotated[str, MinLen(1)] = "/dev/ttyACM0"
    """Serial device, or socket://host:port (10940 on Ethernet models)."""
    baud: PositiveInt = 115200
    """Bits a second; irrelevant over USB."""
    cluster: Annotated[int, Ge(1), Le(99)] = 1
    """Number of steps that make a beam."""
    latency: NotNegative = 0.0
    """Time from the time stamp to sending, s."""
    mount: Mount = LASER_MOUNT
    """x, y, z (m) and yaw (rad) on the vehicle."""


def create(setup: Setup) -> Streamed[Scan]:
    """Make the driver ``laser_scip``; options: those of `ScipOptions`."""
    given = checked(ScipOptions, setup.options, f"sensors.{setup.name}.options")
    port = DevicePort(given.port, lambda: rate_for(sensor.ladder.connections, given.baud), behind=SERVER)

    def codec() -> ScipDecoder:
        return ScipDecoder(given.cluster, given.mount, 0 if port.rate in (0, given.baud) else given.baud)

    sensor = Streamed(scan_topic(setup.name), 0.1, port, codec, latency=given.latency)
    return sensor
