"""Virtual RPLIDARs: an A1 with express answers, an A3 with ultra answers, and an S2 with dense answers."""

import struct
from math import tau
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.sensors import laser_rplidar as wire
from txt1.sensors.base import Reading
from txt1.sensors.laser_rplidar import Whole, announce, packet, xor
from txt1.sensors.readings import Scan
from txt1.sensors.virtual_sensor import VirtualSensor

FORCE_SCAN: Final = 0x21
BOARD_FLAG: Final = 0xFF
MODE_COUNT: Final = 0x70
NAME: Final = 0x7F
DESIRED_SPEED: Final = 0x01
# samples of a packet
SAMPLES: Final = {wire.CAPSULE: 32, wire.ULTRA: 96, wire.DENSE: 40}
# turns a second
TURN_RATE: Final = 10
# angle by which every express sample is early, degrees
SAMPLE_EARLY: Final = 1.0
# quality of a standard sample, of 63
QUALITY: Final = 47
# samples of a turn of the standard mode
STANDARD_SAMPLES: Final = 200


class RplidarModel(NamedTuple):
    """A model: its number, its typical mode, and samples of a turn in this mode, a multiple of those of a packet."""

    model: int
    mode: int
    form: int
    samples: int
    reach: float
    name: bytes


A1: Final = RplidarModel(0x18, 1, wire.CAPSULE, 384, 12.0, b"Express")
A3: Final = RplidarModel(0x31, 3, wire.ULTRA, 1536, 25.0, b"Sensitivity")
S2: Final = RplidarModel(0x71, 1, wire.DENSE, 3200, 30.0, b"DenseBoost")


class VirtualRplidar(VirtualSensor):
    """The scanner's end of the line. `ill`: number of resets that its health takes; `firmware`: of 1.24 on, it knows
    its modes.
    """

    def __init__(self, kind: RplidarModel, ill: int = 0, firmware: tuple[int, int] = (1, 29)) -> None:
        self._kind, self._ill, self._firmware = kind, ill, firmware
        self.turns = kind.model >> 4 in (1, 4)
        """Whether the motor is on: that of an A1 hangs on the line DTR, which this program does not see."""
        # the form of the answers of a running scan, and whether none was sent yet
        self._form: int | None = None
        self._first = False

    def received(self, data: bytes) -> None:
        """Carry out commands; ignore other bytes."""
        data, at = self._rest + data, 0
        while at + 2 <= len(data):
            if data[at] != 0xA5:
                at += 1
                continue
            name = data[at + 1]
            if not name & 0x80:
                self._obey(name, b"")
                at += 2
                continue
            if len(data) < at + 3 or len(data) < at + 4 + data[at + 2]:
                break
            ends = at + 3 + data[at + 2]
            if xor(data[at:ends]) == data[ends]:
                self._obey(name, data[at + 3 : ends])
                at = ends + 1
            else:
                at += 1
        self._rest = data[at:]

    def show(self, reading: Reading[Scan]) -> None:
        """Measure: send a turn."""
        if self._form is None or not self.turns:
            return
        scan, first, self._first = reading.value, self._first, False
        if self._form == wire.STANDARD:
            self.send(nodes(scan))
        else:
            self.send(turn(self._form, self._kind.samples, scan, first))

    def _obey(self, name: int, given: bytes) -> None:
        if name == wire.STOP:
            self._form = None
        elif name == wire.RESET:
            self._form, self._ill = None, max(self._ill - 1, 0)
            self.send(b"RP LIDAR System.\r\n")
        elif name == wire.INFO:
            major, minor = self._firmware
            self._answer(wire.INFO_TOLD, bytes((self._kind.model, minor, major, 7)) + bytes(range(16)))
        elif name == wire.HEALTH:
            self._answer(wire.HEALTH_TOLD, struct.pack("<BH", wire.FAULTY if self._ill else 0, 7 if self._ill else 0))
        elif name == wire.SAMPLE_TIMES:
            times = 1_000_000 // (TURN_RATE * STANDARD_SAMPLES), round(self._sample_time(1))
            self._answer(wire.SAMPLE_TIMES_TOLD, struct.pack("<HH", *times))
        elif name == BOARD_FLAG:
            self._answer(BOARD_FLAG, struct.pack("<I", self._kind.model >> 4 in (2, 3)))
        elif name in (wire.MOTOR_PWM, wire.MOTOR_SPEED) and len(given) == 2:
            series = self._kind.model >> 4
            if series in ((2, 3) if name == wire.MOTOR_PWM else range(6, 16)):
                self.turns = given != b"\0\0"
        elif name == wire.SETTING and len(given) >= 4 and self._firmware >= wire.MODES_SINCE:
            self._tell(given)
        elif name in (wire.SCAN, FORCE_SCAN) and not self._ill:
            self._begin(wire.STANDARD)
        elif name == wire.EXPRESS and len(given) == 5 and not self._ill:
            self._begin(self._kind.form)

    def _begin(self, form: int) -> None:
        self.send(announce(form, wire.LENGTHS[form], many=True))
        self._form, self._first = form, True

    def _answer(self, kind: int, data: bytes) -> None:
        self.send(announce(kind, len(data)) + data)

    def _sample_time(self, mode: int) -> float:
        """Return the time of a sample, us."""
        return 1e6 / (TURN_RATE * (self._kind.samples if mode else STANDARD_SAMPLES))

    def _tell(self, given: bytes) -> None:
        """Tell a setting."""
        asked, mode = int.from_bytes(given[:4], "little"), int.from_bytes(given[4:6], "little")
        told = {
            MODE_COUNT: struct.pack("<H", self._kind.mode + 1),
            wire.TYPICAL: struct.pack("<H", self._kind.mode),
            wire.SAMPLE_TIME: struct.pack("<I", round(self._sample_time(mode) * 256.0)),
            wire.DISTANCE: struct.pack("<I", round(self._kind.reach * 256.0)),
            wire.FORM: bytes((self._kind.form if mode else wire.STANDARD,)),
            NAME: (self._kind.name if mode else b"Standard") + b"\0",
            DESIRED_SPEED: struct.pack("<HH", wire.MOTOR_TURNS, wire.PWM),
        }.get(asked)
        if told is not None:
            self._answer(wire.SETTING_TOLD, given[:4] + told)


def a1() -> VirtualRplidar:
    """Return an A1."""
    return VirtualRplidar(A1)


def a3() -> VirtualRplidar:
    """Return an A3."""
    return VirtualRplidar(A3)


def s2() -> VirtualRplidar:
    """Return an S2."""
    return VirtualRplidar(S2)


def seen(scan: Scan, degrees: NDArray[Any]) -> Whole:
    """Return the ranges of the beams nearest to angles clockwise from straight ahead, mm; 0 for no range."""
    angle = -degrees / 360.0 * tau - scan.angle_min
    index = np.rint(angle % tau / scan.angle_step).astype(int) % max(round(tau / scan.angle_step), 1)
    there = index < len(scan.ranges)
    ranges = np.where(there, scan.ranges[np.where(there, index, 0)], 0.0)
    return np.rint(np.where(np.isfinite(ranges), ranges, 0.0) * 1000.0).astype(np.int64)


def nodes(scan: Scan) -> bytes:
    """Return the standard answers of a turn."""
    angles = 360.0 / STANDARD_SAMPLES * np.arange(STANDARD_SAMPLES)
    data = b""
    for k, (angle, mm) in enumerate(zip(angles, seen(scan, angles), strict=True)):
        start = 1 if k == 0 else 2
        told = min(int(mm) * 4, 0xFFFF)
        data += struct.pack("<BHH", QUALITY << 2 | start, round(float(angle) * 64.0) << 1 | 1, told)
    return data


def turn(form: int, samples: int, scan: Scan, first: bool) -> bytes:
    """Return the packets of a turn; `first`: the first after the start of a scan."""
    turned = 360.0 / samples * np.arange(samples)
    data, size = b"", SAMPLES[form]
    if form == wire.ULTRA:
        mm = seen(scan, turned - wire.parallax(seen(scan, turned - 8.0)))
        packed = squeezed(np.append(mm, seen(scan, np.array((-8.0,)))))
    elif form == wire.DENSE:
        packed = np.minimum(seen(scan, turned), 0xFFFF).astype("<u2").tobytes()
    else:
        packed = cabins(np.minimum(seen(scan, turned - SAMPLE_EARLY), 0x3FFF))
    length = wire.LENGTHS[form] - 4
    for k in range(samples // size):
        start = float(turned[k * size])
        data += packet(form, start, packed[k * length : (k + 1) * length], first and k == 0)
    return data


def cabins(mm: Whole) -> bytes:
    """Return the samples of express packets, in pairs."""
    early = round(SAMPLE_EARLY * 8.0)
    near = mm << 2 | early >> 4
    return b"".join(
        struct.pack("<HHB", int(near[k]), int(near[k + 1]), early & 0xF | (early & 0xF) << 4)
        for k in range(0, len(mm), 2)
    )


def squeezed(mm: Whole) -> bytes:
    """Return the samples of ultra packets, in threes: one in twelve bits, two as differences from their neighbours.

    The last sample is that after the turn.
    """
    bases = mm[::3]
    scaled = np.zeros_like(bases)
    for begins, distance, left_out in wire.SCALES:
        there = bases >= distance
        scaled[there] = np.minimum(begins + ((bases[there] - distance) >> left_out), 0xFFF)
    based, scale = wire.unscaled(scaled)
    ahead = np.where(based[:-1] > 0, based[:-1], based[1:])
    bits: Whole = np.where((based[:-1] > 0) | (based[1:] == 0), scale[:-1], scale[1:])
    middle, last = (mm[1::3] - ahead) >> bits, (mm[2::3] - based[1:]) >> scale[1:]
    middle = np.where((mm[1::3] == 0) | (abs(middle) > 510), 511, middle)
    last = np.where((mm[2::3] == 0) | (abs(last) > 510), 511, last)
    return (scaled[:-1] | (middle & 0x3FF) << 12 | (last & 0x3FF) << 22).astype("<u4").tobytes()
