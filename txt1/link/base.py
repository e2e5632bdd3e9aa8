"""The two faces of a byte link: `Link`, which all kinds of links share, and `End`, who uses it."""

from __future__ import annotations

from typing import Final, Protocol

from txt1.errors import LinkLost

BACKLOG: Final = 4096
"""Bytes that may wait for the other side to take them."""


class Link:
    """One end of a byte link; each kind says how it sends, and how it lets go."""

    def __init__(self, address: str, end: End) -> None:
        self.address = address
        """Where it leads, for people: "/dev/ttyUSB0", "socket://127.0.0.1:5000", "memory", "./txt1-board"."""
        self._end = end
        self._overflows = 0
        self._down = ""  # the reason, once it is

    @property
    def overflows(self) -> int:
        """How many writes were dropped, or cut short, because the other side did not take the bytes."""
        return self._overflows

    @property
    def up(self) -> bool:
        """Whether it is neither lost nor closed."""
        return not self._down

    def write(self, data: bytes) -> None:
        """Send these bytes; never waits.

        When more than BACKLOG bytes wait because the other side does not take them, this write is dropped whole and
        counted, as a UART would.

        Raises:
            LinkLost: the link is lost or closed.

        """
        if self._down:
            raise LinkLost(f"nothing was sent: {self._down}")
        self._send(data)

    def close(self) -> None:
        """Let go at once: what is not sent is thrown away, and the end hears nothing any more; harmless when down."""
        if self.shut():
            self._let_go()

    def lose(self, reason: str) -> None:
        """Tell the end, unless the link is down already."""
        if self.up:
            self._down = reason
            self._end.lost(reason)

    def shut(self) -> bool:
        """True the first time: from now on the end hears nothing."""
        if self._down:
            return False
        self._down = f"the link {self.address} was closed"
        if isinstance(self._end, Wrapper):  # whatever is under way in it goes nowhere
            self._end.release()
        return True

    def _send(self, data: bytes) -> None:
        raise NotImplementedError

    def _let_go(self) -> None:
        raise NotImplementedError


class End(Protocol):
    """Who uses a link; called by the event loop."""

    def connected(self, link: Link) -> None:
        """Take the link, which is up."""

    def received(self, data: bytes) -> None:
        """Take bytes, in the order they were sent and cut up as they arrived."""

    def lost(self, reason: str) -> None:
        """The link is down and its `close` was not called; once, with a sentence for people that names the link."""


class Wrapper:
    """An end that stands between a link and another end."""

    def release(self) -> None:
        """Forget what is under way: the link was closed without asking the end."""
        raise NotImplementedError


class Listener(Protocol):
    """A place where hosts connect to an end."""

    @property
    def address(self) -> str:
        """Where, as `open_link` takes it."""

    def close(self) -> None:
        """Let go of it, and of the host that is connected, at once; the end hears nothing any more."""
