"""Turn the bytes of a link into events of the protocol, with the one rule that needs a clock."""

import asyncio
from collections.abc import Callable
from typing import Final

from txt1.protocol.decoder import Decoder, Event
from txt1.protocol.layout import Role

# s without a byte after which a half frame is given up
SILENCE: Final = 0.05
# s after which it is given up whatever comes: at 57600 baud the longest frame takes 42 ms
LONGEST: Final = 0.3


class Receiver:
    """A decoder that gives up on a half frame when the line falls silent; `take` is given every message and fault."""

    def __init__(self, role: Role, take: Callable[[Event], None]) -> None:
        self.decoder = Decoder(role)
        self.take = take
        self._expiry: asyncio.TimerHandle | None = None
        # where in the stream the half frame begins that is waited for
        self._half = -1
        # loop time since when
        self._since = 0.0

    def feed(self, data: bytes) -> None:
        """Take bytes that have arrived."""
        self._hand_on(self.decoder.feed(data))
        self._stop_waiting()
        if self.decoder.pending:
            loop, half = asyncio.get_running_loop(), self.decoder.position - self.decoder.pending
            if half != self._half:
                self._half, self._since = half, loop.time()
            elif loop.time() - self._since > LONGEST:
                # what was lost of it will not come
                self.give_up()
                return
            self._expiry = loop.call_later(SILENCE, self.give_up)

    def give_up(self) -> None:
        """No more bytes come for what is held back."""
        self._stop_waiting()
        self._hand_on(self.decoder.expire())

    def close(self) -> None:
        """Wait for nothing any more; nothing is handed on."""
        self._stop_waiting()
        self.decoder.expire()

    def _hand_on(self, events: list[Event]) -> None:
        for event in events:
            self.take(event)

    def _stop_waiting(self) -> None:
        if self._expiry is not None:
            self._expiry.cancel()
            self._expiry = None
