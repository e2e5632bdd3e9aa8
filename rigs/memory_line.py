"""A line in memory, for what a device or its driver writes."""

from txt1.link.base import Link


class MemoryLine(Link):
    """Collects what is written."""

    def __init__(self) -> None:
        self.sent = b""
        super().__init__("memory", self)  # type: ignore[arg-type]

    def _send(self, data: bytes) -> None:
        self.sent += data

    def _close(self) -> None:
        pass
