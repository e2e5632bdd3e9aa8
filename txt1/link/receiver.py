"""Turns the bytes of a link into events of the protocol; holds the protocol's only rule that needs a clock."""

import asyncio
from collections.abc import Callable
from typing import Final

from txt1.protocol.decoder import Decoder, Event
from txt1.protocol.layout import Role

# s without a byte after which an unfinished frame is given up
FRAME_GAP_MAX: Final = 0.05
# s after which it is given up even if bytes come: at 57600 baud the longest frame takes 42 ms
FRAME_TIME_MAX: Final = 0.3


class Receiver:
    """A decoder that gives up an unfinished frame when the line falls silent.

    It calls `take` with each message and fault.
    """

    def __init__(self, role: Role, take: Callable[[Event], None]) -> None:
        self.decoder = Decoder(role)
        self.take = take
        self._expiry: asyncio.TimerHandle | None = None
        # offset in the stream of the unfinished frame
        self._half = -1
        # loop time at which the wait for it began
        self._since = 0.0

    def feed(self, data: bytes) -> None:
        """Take bytes that have arrived."""
        self._hand_on(self.decoder.feed(data))
        self._stop_waiting()
        if self.decoder.pending:
            loop, half = asyncio.get_running_loop(), self.decoder.position - self.decoder.pending
            if half != self._half:
                self._half, self._since = half, loop.time()
            elif loop.time() - self._since > FRAME_TIME_MAX:
                # the frame's lost bytes will not come any more
                self.give_up()
                return
            self._expiry = loop.call_later(FRAME_GAP_MAX, self.give_up)

    def give_up(self) -> None:
        """Give up the unfinished frame."""
        self._stop_waiting()
        self._hand_on(self.decoder.expire())

    def close(self) -> None:
        """Stop waiting; `take` is not called again."""
        self._stop_waiting()
        self.decoder.expire()

    def _hand_on(self, events: list[Event]) -> None:
        for event in events:
            self.take(event)

    def _stop_waiting(self) -> None:
        if self._expiry is not None:
            self._expiry.cancel()
            self._expiry = None
