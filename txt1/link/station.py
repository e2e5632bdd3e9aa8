"""What all devices on the desk have in common: a link that comes and goes, and what is sent over it."""

from txt1.link.base import Link


class Station:
    """A device on the desk, the end of its host's link; sends into the void while there is none."""

    link: Link | None = None

    def connected(self, link: Link) -> None:
        """Take the link."""
        self.link = link

    def received(self, data: bytes) -> None:
        """Pass over bytes of the host; a device that has commands obeys them."""

    def lost(self, reason: str) -> None:
        """Go on without a host."""
        self.link = None

    def hang_up(self) -> None:
        """Let go of the line."""
        if self.link is not None:
            self.link.close()
            self.link = None

    def send(self, data: bytes) -> None:
        """Send, if somebody is there."""
        if data and self.link is not None and self.link.up:
            self.link.write(data)
