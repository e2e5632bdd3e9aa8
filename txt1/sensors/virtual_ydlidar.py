"""Virtual YDLIDARs: an X2, which sends unasked, an X4, and a TG30."""

from typing import Final

import numpy as np

from txt1.sensors.base import Reading
from txt1.sensors.laser_turns import Numbers
from txt1.sensors.laser_ydlidar import (
    MODELS,
    RING,
    SCAN_ANSWER,
    SCAN_COMMAND,
    Model,
    corrections,
    packet,
)
from txt1.sensors.readings import Scan
from txt1.sensors.virtual_rplidar import seen
from txt1.sensors.virtual_sensor import VirtualSensor

# turns a second
TURN_RATE: Final = 10
# samples of a packet
PACKET_SAMPLES: Final = 40
# of the search for what a sample sees: mm at first, steps, and mm by which the last may differ
SEARCH_FROM: Final = 1e6
SEARCHES: Final = 6
SEARCH_SETTLED: Final = 50.0
# answers to A5 90 and A5 91: model 6, firmware 1.5, hardware 1, a serial number; well
INFO: Final = b"\xa5\x5a\x14\x00\x00\x00\x04" + bytes((6, 5, 1, 1)) + bytes(range(16))
HEALTH: Final = b"\xa5\x5a\x03\x00\x00\x00\x06" + bytes(3)
STOPS: Final = (b"\xa5\x65", b"\xa5\x00")


class VirtualYdlidar(VirtualSensor):
    """The scanner's end of the line. `tells`: whether it tells its rate of turns, as newer firmware does."""

    def __init__(self, name: Model, tells: bool = True) -> None:
        self._model, self._tells = MODELS[name], tells
        self.scans = not self._model.commands
        """Whether it sends."""

    def received(self, data: bytes) -> None:
        """Carry out commands; an X2 does not listen."""
        if not self._model.commands:
            return
        data = self._rest + data
        while len(data) >= 2:
            command, data = data[:2], data[2:]
            if command == SCAN_COMMAND:
                self.send(SCAN_ANSWER)
                self.scans = True
            elif command in STOPS:
                self.scans = False
            elif command == b"\xa5\x90":
                self.send(INFO)
            elif command in (b"\xa5\x91", b"\xa5\x92"):
                self.send(HEALTH)
            elif command[:1] != b"\xa5":
                data = command[1:] + data
        self._rest = data

    def show(self, reading: Reading[Scan]) -> None:
        """Measure: send a turn."""
        if not self.scans:
            return
        heads, mm = self.turn(reading.value)
        raw = np.rint(mm * (4.0 if self._model.triangulates else 1.0))
        data = packet(RING | (TURN_RATE * 10 << 1 if self._tells else 0), float(heads[0]), float(heads[0]), raw[:1])
        for at in range(1, len(raw), PACKET_SAMPLES):
            part = heads[at : at + PACKET_SAMPLES]
            data += packet(0, float(part[0]), float(part[-1]), raw[at : at + PACKET_SAMPLES])
        self.send(data)

    def turn(self, scan: Scan) -> tuple[Numbers, Numbers]:
        """Return the turns of the head of a turn's samples, degrees, and their distances, mm."""
        count = round(self._model.rate / TURN_RATE)
        heads: Numbers = 360.0 / count * np.arange(count, dtype=float)
        if not self._model.triangulates:
            return heads, seen(scan, heads).astype(float)
        # where something is seen, the ray depends on its distance
        mm: Numbers = np.full(count, SEARCH_FROM)
        for _ in range(SEARCHES):
            before, mm = mm, seen(scan, heads + corrections(np.where(mm > 0.0, mm, SEARCH_FROM))).astype(float)
        told: Numbers = np.where(abs(mm - before) < SEARCH_SETTLED, np.minimum(mm, 0xFFFF / 4.0), 0.0)
        return heads, told


def x2() -> VirtualYdlidar:
    """Return an X2."""
    return VirtualYdlidar("x2")


def x4() -> VirtualYdlidar:
    """Return an X4."""
    return VirtualYdlidar("x4")


def tg30() -> VirtualYdlidar:
    """Return a TG30."""
    return VirtualYdlidar("tg30")
