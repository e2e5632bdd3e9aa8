"""Virtual laser scanners: a Hokuyo URG-04LX that speaks SCIP 2.0, and an LDROBOT LD19."""

from math import tau
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.sensors import laser_ld19
from txt1.sensors.base import Reading
from txt1.sensors.laser_scip import LINE_CHARACTERS, check_character, encode
from txt1.sensors.readings import Scan
from txt1.sensors.virtual_sensor import Talker, VirtualSensor

PARAMETERS: Final = {
    "MODL": "URG-04LX(Hokuyo Automatic Co.,Ltd.)", "DMIN": "20", "DMAX": "5600", "ARES": "1024", "AMIN": "44",
    "AMAX": "725", "AFRT": "384", "SCAN": "600",
}  # fmt: skip
VERSION: Final = {
    "VEND": "Hokuyo Automatic Co.,Ltd.",
    "PROD": "SOKUIKI Sensor URG-04LX",
    "FIRM": "3.3.00",
    "PROT": "SCIP 2.0",
    "SERI": "H0000000",
}
FIRST, LAST, FRONT = (int(PARAMETERS[name]) for name in ("AMIN", "AMAX", "AFRT"))
# range for "nothing in reach", mm: values below DMIN are error codes
NOTHING_IN_REACH: Final = 0


def line(text: bytes) -> bytes:
    """Return a line with its checksum."""
    return text + bytes((check_character(text),)) + b"\n"


def listing(values: dict[str, str]) -> bytes:
    """Return the lines of PP and VV."""
    texts = (f"{name}:{value}".encode() for name, value in values.items())
    return b"".join(text + b";" + bytes((check_character(text),)) + b"\n" for text in texts)


class VirtualScip(VirtualSensor):
    """The scanner's end of the line. `old`: as a URG-04LX it starts in SCIP 1.1, and waits for SCIP2.0."""

    def __init__(self, old: bool = False) -> None:
        self._old = old
        # present request for scans, without the number of scans left
        self._echo: bytes | None = None
        # scans still to be sent; 0: continuously
        self._left = 0
        # requests for the next scan
        self._once: list[bytes] = []

    def received(self, data: bytes) -> None:
        """Carry out commands."""
        *commands, self._rest = (self._rest + data)[-4096:].replace(b"\r", b"\n").split(b"\n")
        for command in commands:
            if command:
                self._obey(command)

    def show(self, reading: Reading[Scan]) -> None:
        """Measure: send the scan to the host that requested it."""
        for echo in self._once:
            self._answer(echo, b"00", self._data(echo, reading))
        self._once.clear()
        if self._echo is None:
            return
        left = max(self._left - 1, 0)
        self._answer(self._echo + f"{left:02d}".encode(), b"99", self._data(self._echo, reading))
        if self._left:
            self._left = left
            self._echo = self._echo if left else None

    def _obey(self, command: bytes) -> None:
        name = command[:2]
        if self._old:
            self._old = command != b"SCIP2.0"
            self.send(command + (b"\nE\n\n" if self._old else b"\n0\n\n"))
            return
        if name in (b"MD", b"MS", b"GD", b"GS"):
            numbers = command[2:15] if name[:1] == b"M" else command[2:12]
            wanted = len(numbers) == (13 if name[:1] == b"M" else 10) and numbers.isdigit()
            if not wanted or not FIRST <= int(numbers[:4]) <= int(numbers[4:8]) <= LAST:
                self._answer(command, b"04")
            elif name[:1] == b"G":
                self._once.append(command)
            else:
                self._echo, self._left = command[:13], int(command[13:15])
                self._answer(command, b"00")
        elif name == b"PP":
            self._answer(command, b"00", listing(PARAMETERS))
        elif name == b"VV":
            self._answer(command, b"00", listing(VERSION))
        elif name in (b"QT", b"RS"):
            self._echo = None
            self._answer(command, b"00")
        elif name in (b"BM", b"SC", b"TM", b"SS", b"CR", b"HS"):
            self._answer(command, b"00")
        else:
            self._answer(command, b"0E")

    def _answer(self, echo: bytes, status: bytes, data: bytes = b"") -> None:
        self.send(echo + b"\n" + line(status) + data + b"\n")

    def _data(self, request: bytes, reading: Reading[Scan]) -> bytes:
        """Return time stamp and ranges of the requested steps, in lines of 64 characters."""
        scan = reading.value
        width = 3 if request[1:2] == b"D" else 2
        first, last, cluster = int(request[2:6]), int(request[6:10]), max(int(request[10:12]), 1)
        text, mm = b"", ranges_at(scan, (np.arange(first, last + 1) - FRONT) * tau / 1024.0)
        for start in range(0, len(mm) - cluster + 1, cluster):
            text += encode(min(filter(None, mm[start : start + cluster]), default=NOTHING_IN_REACH), width)
        blocks = (text[at : at + LINE_CHARACTERS] for at in range(0, len(text), LINE_CHARACTERS))
        return line(encode(round(reading.time * 1000.0) % (1 << 24), 4)) + b"".join(map(line, blocks))


def ranges_at(scan: Scan, angles: NDArray[np.floating[Any]]) -> list[int]:
    """Return the ranges of the beams nearest to angles (rad, anticlockwise in the device's frame), mm; 0 for no
    range.
    """
    index = np.rint((angles - scan.angle_min) / scan.angle_step).astype(int)
    there = (index >= 0) & (index < len(scan.ranges))
    mm = np.full(len(angles), np.nan)
    mm[there] = np.rint(scan.ranges[index[there]].astype(np.float64) * 1000.0)
    mm[~np.isfinite(mm)] = NOTHING_IN_REACH
    numbers: list[int] = mm.astype(int).tolist()
    return numbers


def ld19() -> Talker:
    """Return an LD19. It sends each turn, clockwise from straight ahead, in packets of 12 points."""
    return Talker(turn)


def turn(reading: Reading[Scan]) -> bytes:
    """Return the packets of a turn, from the nearest beams of the scan, which turns anticlockwise.

    The last packet reaches into the next turn.
    """
    scan, packets = reading.value, b""
    step, per_second = 360.0 / laser_ld19.BEAMS, abs(scan.angle_step) / tau * 360.0 / abs(scan.time_step)
    count = laser_ld19.POINTS
    angles = step * np.arange(-(-laser_ld19.BEAMS // count) * count)
    mm = ranges_at(scan, -tau * np.where(angles <= 180.0, angles, angles - 360.0) / 360.0)
    for first in range(0, laser_ld19.BEAMS, count):
        begins, ends = float(angles[first]), float(angles[first + count - 1])
        ms = round((reading.time + ends / per_second) * 1000.0)
        points = [(each, 200) for each in mm[first : first + count]]
        packets += laser_ld19.pack(per_second, begins, ends, points, ms)
    return packets
