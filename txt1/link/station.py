"""The part that all devices on the desk have in common: a link that comes and goes, and what is sent over it."""

from txt1.link.base import Link


class Station:
    """Holds the link of a device on the desk; sends into the void while there is none."""

    def __init__(self) -> None:
        self._link: Link | None = None

    def connected(self, link: Link) -> None:
        """Take the link."""
        self._link = link

    def lost(self, reason: str) -> None:
        """Go on without one."""
        del reason
        self._link = None

    def send(self, data: bytes) -> None:
        """Send, if somebody is there."""
        if data and self._link is not None and self._link.up:
            self._link.write(data)
