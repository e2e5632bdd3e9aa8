"""What the sensors' doubles on the desk have in common: a link, and readings that are told to the host over it."""

from collections.abc import Callable
from typing import Any, Protocol

from txt1.link.base import Link
from txt1.link.station import Station
from txt1.sensors.base import Reading


class Talker:
    """A device that sends its readings unasked, as `encode` makes bytes of them, and has no commands."""

    def __init__(self, encode: Callable[[Reading[Any]], bytes]) -> None:
        self._station, self._encode = Station(), encode

    def connected(self, link: Link) -> None:
        """Take the link."""
        self._station.connected(link)

    def lost(self, reason: str) -> None:
        """Go on without a host."""
        self._station.lost(reason)

    def received(self, data: bytes) -> None:
        """Pass over bytes of the host."""

    def show(self, reading: Reading[Any]) -> None:
        """Send a reading."""
        self._station.send(self._encode(reading))


class Double(Protocol):
    """A device on the desk: an end of a link that is shown the readings of a simulated sensor."""

    def connected(self, link: Link) -> None:
        """Take the link."""

    def received(self, data: bytes) -> None:
        """Take bytes of the host."""

    def lost(self, reason: str) -> None:
        """The host has gone."""

    def show(self, reading: Reading[Any]) -> None:
        """Tell the host of a reading, as the device would."""
