"""The common part of the virtual sensors: a link, and readings that are sent to the host over it."""

from collections.abc import Callable
from typing import Any

from txt1.link.base import Link
from txt1.link.station import Station
from txt1.sensors.base import Reading


class Double(Station):
    """A device on the desk: an end of a link that is shown the readings of a simulated sensor."""

    # what came of a command that is not complete
    _rest = b""

    def connected(self, link: Link) -> None:
        """Take the link; what an earlier host has started goes on."""
        self._rest = b""
        super().connected(link)

    def show(self, reading: Reading[Any]) -> None:
        """Tell the host of a reading, as the device would."""
        raise NotImplementedError


class Talker(Double):
    """A device that sends its readings unasked, as `encode` makes bytes of them, and has no commands."""

    def __init__(self, encode: Callable[[Reading[Any]], bytes]) -> None:
        self._encode = encode

    def show(self, reading: Reading[Any]) -> None:
        """Send a reading."""
        self.send(self._encode(reading))
