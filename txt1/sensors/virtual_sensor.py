"""The common part of the virtual sensors: a link, and readings that are sent to the host over it."""

from collections.abc import Callable
from typing import Any

from txt1.link.base import Link
from txt1.link.virtual_device import VirtualDevice
from txt1.sensors.base import Reading


class VirtualSensor(VirtualDevice):
    """A virtual device: an end of a link. `show` gives it the readings of a simulated sensor."""

    # bytes of an incomplete command
    _rest = b""

    def connected(self, link: Link) -> None:
        """Take the link; a measurement that an earlier host has started goes on."""
        self._rest = b""
        super().connected(link)

    def show(self, reading: Reading[Any]) -> None:
        """Send a reading to the host, as the device would."""
        raise NotImplementedError


class Talker(VirtualSensor):
    """A device that sends its readings unasked and has no commands; `encode` turns a reading into bytes."""

    def __init__(self, encode: Callable[[Reading[Any]], bytes]) -> None:
        self._encode = encode

    def show(self, reading: Reading[Any]) -> None:
        """Send a reading."""
        self.send(self._encode(reading))
