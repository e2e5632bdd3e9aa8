"""The common part of all virtual devices: a link that comes and goes, and sending over it."""

from txt1.link.base import Link


class VirtualDevice:
    """A virtual device, the end of its host's link. Without a host its bytes are discarded."""

    link: Link | None = None

    def connected(self, link: Link) -> None:
        """Take the link."""
        self.link = link

    def received(self, data: bytes) -> None:
        """Ignore bytes from the host; a device with commands overrides this."""

    def lost(self, reason: str) -> None:
        """Go on without a host."""
        self.link = None

    def hang_up(self) -> None:
        """Close the link."""
        if self.link is not None:
            self.link.close()
            self.link = None

    def send(self, data: bytes) -> None:
        """Send bytes, if a host is connected."""
        if data and self.link is not None and self.link.up:
            self.link.write(data)
