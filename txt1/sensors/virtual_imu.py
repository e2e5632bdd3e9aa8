"""A virtual 3DM-GX2: answers commands, and sends replies continuously after the command for it."""

from typing import Final

from txt1.sensors.base import Reading
from txt1.sensors.imu_3dmgx2 import (
    CONFIRMED,
    GAUSS,
    IDENTIFIER,
    LENGTHS,
    MAGNETIC,
    PLAIN,
    TICKS,
    checksum,
    matrix_of,
    pack,
)
from txt1.sensors.readings import STANDARD_GRAVITY, ImuReading
from txt1.sensors.virtual_sensor import VirtualSensor

STOP: Final = 0xFA
# by the requested type
IDENTIFIERS: Final = {0: "6223-4220", 1: "6223-00001", 2: "3DM-GX2", 3: "5g 300d/s"}
# length of commands longer than a byte
LONGEST: Final = {CONFIRMED: 4, IDENTIFIER: 2}


class VirtualImu(VirtualSensor):
    """The device's end of the line."""

    def __init__(self) -> None:
        # the command that is repeated
        self._repeated: int | None = None
        self._now: Reading[ImuReading] | None = None

    def received(self, data: bytes) -> None:
        """Carry out commands; ignore other bytes."""
        data, at = self._rest + data, 0
        while at < len(data):
            command = data[at]
            if len(data) - at < LONGEST.get(command, 1):
                break
            length = LONGEST.get(command, 1)
            self._obey(command, data[at + 1 : at + length])
            at += length
        self._rest = data[at:]

    def show(self, reading: Reading[ImuReading]) -> None:
        """Measure."""
        self._now = reading
        if self._repeated is not None:
            self.send(self._reply(self._repeated))

    def _obey(self, command: int, rest: bytes) -> None:
        if command in (PLAIN, MAGNETIC):
            self.send(self._reply(command))
        elif command == CONFIRMED and rest[:2] == b"\xc1\x29":
            self._repeated = rest[2] if rest[2] in (PLAIN, MAGNETIC) else None
            confirmed = bytes((CONFIRMED, rest[2])) + self._ticks().to_bytes(4)
            self.send(confirmed + checksum(confirmed).to_bytes(2))
        elif command == STOP:
            self._repeated = None
        elif command == IDENTIFIER:
            name = bytes((IDENTIFIER, rest[0])) + IDENTIFIERS.get(rest[0], "").encode().rjust(16)
            self.send(name + checksum(name).to_bytes(2))

    def _ticks(self) -> int:
        return 0 if self._now is None else round(self._now.time * TICKS["gx2"]) & 0xFFFFFFFF

    def _reply(self, command: int) -> bytes:
        if self._now is None:
            return b""
        value = self._now.value
        (ax, ay, az), (p, q, r) = value.acceleration, value.rates
        numbers = [ax / STANDARD_GRAVITY, -ay / STANDARD_GRAVITY, -az / STANDARD_GRAVITY, p, -q, -r]
        if command == MAGNETIC:
            x, y, z = value.magnetic or (0.0, 0.0, 0.0)
            numbers += x / GAUSS, -y / GAUSS, -z / GAUSS
        reply = pack(command, (*numbers, *matrix_of(value.orientation or (0.0, 0.0, 0.0, 1.0))), self._ticks())
        assert len(reply) == LENGTHS[command]
        return reply
