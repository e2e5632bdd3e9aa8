"""A virtual receiver of a radio control, and its transmitter: a port whose sticks and faults a program sets."""

import asyncio
import struct
from collections.abc import Sequence
from typing import Final, Literal

from txt1.errors import HalError
from txt1.link.base import End, Link, connect
from txt1.link.virtual_device import VirtualDevice
from txt1.rc.frames import CHANNELS, CRSF_CHANNELS, CRSF_STATISTICS, SBUS_FAILSAFE, SBUS_HEAD, SBUS_LOST, crsf_frame
from txt1.rc.take_over import ModeSwitch, Stick

# s between two frames: of SBUS, of CRSF at 150 Hz; between two pulses of a servo output
PERIODS: Final = {"sbus": 0.014, "crsf": 1.0 / 150.0, "pwm": 0.02}
# frames of channels between two link statistics
STATISTICS_EVERY: Final = 15
# s for which a receiver repeats the channels, marked as lost, before it tells the failsafe
HOLD_TIME: Final = 0.5

Fails = Literal["silent", "flagged", "statistics", "hold", "out of range"]
"""A receiver without its transmitter: it sends nothing; frames with flags (SBUS); an uplink of quality 0 beside the old
channels (CRSF); the old channels as if nothing were; or channels that no stick makes."""

THROTTLE: Final = Stick(2, 1000.0, 1500.0, 2000.0)
STEERING: Final = Stick(1, 1950.0, 1480.0, 1050.0)
SWITCH: Final = ModeSwitch(5, 2000.0, 1000.0)
"""The channels of the virtual transmitter; its steering is reversed."""


def packed(pulses: Sequence[float]) -> bytes:
    """Return the bytes of 16 channels, us."""
    bits = 0
    for k, pulse in enumerate(pulses):
        bits |= min(max(round((pulse - 880.0) * 1.6), 0), 0x7FF) << 11 * k
    return bits.to_bytes(22, "little")


def sbus_frame(pulses: Sequence[float], flags: int = 0) -> bytes:
    """Return a frame of SBUS."""
    return bytes((SBUS_HEAD,)) + packed(pulses) + bytes((flags, 0))


class VirtualReceiver(VirtualDevice):
    """The receiver and its transmitter, as a port. By `pwm` it sends three pulses, us, of two bytes each."""

    address = "a virtual receiver"

    def __init__(self, protocol: str, fails: Fails = "silent") -> None:
        self.throttle = self.steering = 0.0
        """The sticks, -1 to 1: ahead and left positive."""
        self.switch = "hand"
        """Its position: hand, half way, computer."""
        self.on = True
        """Whether the transmitter is on."""
        self.plugged = True
        """Whether the port can be opened."""
        self.got = b""
        """All bytes from the host."""
        self.fails = fails
        """Its behaviour without its transmitter."""
        self._protocol = protocol
        self._lost_at = 0.0
        self._pulses: list[float] = [1500.0] * CHANNELS
        self._sending: asyncio.Task[None] | None = None

    async def open(self, end: End) -> Link:
        """Connect, and send frames from now on."""
        if not self.plugged:
            raise HalError("a virtual receiver is not plugged in")
        link, _ = connect(end, self)
        if self._sending is None:
            self._sending = asyncio.create_task(self._send())
        return link

    async def close(self) -> None:
        """Stop sending."""
        if self._sending is not None:
            self._sending.cancel()
            self._sending = None

    def received(self, data: bytes) -> None:
        """Keep the telemetry."""
        self.got += data

    def unplug(self) -> None:
        """Pull the plug."""
        self.plugged = False
        self.hang_up()

    async def _send(self) -> None:
        count = 0
        while True:
            await asyncio.sleep(PERIODS[self._protocol])
            count += 1
            data = self._frame(count, asyncio.get_running_loop().time())
            self.send(data)

    def _frame(self, count: int, now: float) -> bytes:
        if self.on:
            self._lost_at = now
            self._pulses[THROTTLE.channel - 1] = _pulse(THROTTLE, self.throttle)
            self._pulses[STEERING.channel - 1] = _pulse(STEERING, self.steering)
            middle = 0.5 * (SWITCH.hand + SWITCH.computer)
            places = {"hand": SWITCH.hand, "half way": middle, "computer": SWITCH.computer}
            self._pulses[SWITCH.channel - 1] = places[self.switch]
        elif self.fails == "silent":
            return b""
        elif self.fails == "out of range":
            self._pulses[THROTTLE.channel - 1] = 880.0
        if self._protocol == "pwm":
            return struct.pack("<3H", *(round(self._pulses[each.channel - 1]) for each in (THROTTLE, STEERING, SWITCH)))
        if self._protocol == "sbus":
            flags = 0
            if not self.on and self.fails == "flagged":
                flags = SBUS_LOST | (SBUS_FAILSAFE if now - self._lost_at > HOLD_TIME else 0)
            return sbus_frame(self._pulses, flags)
        if count % STATISTICS_EVERY == 0:
            quality = 100 if self.on or self.fails != "statistics" else 0
            return crsf_frame(CRSF_STATISTICS, bytes((60, 60, quality, 10, 0, 4, 3, 60, quality, 10)))
        return crsf_frame(CRSF_CHANNELS, packed(self._pulses))


def _pulse(stick: Stick, place: float) -> float:
    end = stick.most if place > 0.0 else stick.least
    return stick.middle + abs(place) * (end - stick.middle)
