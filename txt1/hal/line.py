"""The line to a motor controller that answers when it is asked: kept open, and watched."""

import asyncio
from collections.abc import Callable
from math import inf
from typing import Final

from txt1.errors import HalError, LinkLost
from txt1.hal.base import BoardLink
from txt1.hal.serial import Port
from txt1.link.base import End, Link

LOST: Final = 0.3  # s without an answer after which the controller is lost
SETTLED: Final = 0.5  # s of answers before the first set-point
BACKOFF: Final = (0.1, 0.9)  # s before the first attempt to open a lost line again, and the longest between later ones
FAREWELLS: Final = 3  # times that the last words are said: lines lose frames


class Line:
    """An end of a link that is opened again whenever it was lost.

    Args:
        port: where the controller is found.
        wrap: may put faults on the line.
        who: the controller's word in sentences, such as "the VESC".
        greet: called when there is a fresh line.
        take: given the bytes that come; calls `heard` for every sound answer.

    """

    def __init__(
        self,
        port: Port,
        wrap: Callable[[End], End],
        who: str,
        greet: Callable[[], None],
        take: Callable[[bytes], None],
    ) -> None:
        self.port = port
        self.time: Callable[[], float] = lambda: 0.0  # the loop's
        self._end, self._who, self._greet, self._take = wrap(self), who, greet, take
        self._link: Link | None = None
        self._reconnecting: asyncio.Task[None] | None = None
        self._closed = True
        self._failure: Exception | None = None
        self._origin = inf  # loop time of the run's start
        self._heard, self._heard_since = -inf, inf  # loop times of the last answer, and of the first since it was lost
        self._losses, self._connections, self._overflows = 0, 0, 0
        self._reason = ""
        self._text = f"connecting to {port.address}"
        self._report: BoardLink | None = None

    async def open(self) -> None:
        """Open the port; from then on a lost link is opened again until `close`."""
        self.time = asyncio.get_running_loop().time
        self._origin, self._failure, self._closed = inf, None, False
        try:
            await self.port.open(self._end)
        except BaseException:
            self._closed = True
            await self.port.close()
            raise

    async def close(self, farewell: bytes, pause: float = 0.02) -> None:
        """Say the last words, more than once and a pause (s) apart, and let go; harmless when closed already."""
        if self._closed:
            return
        self._closed = True
        if self._reconnecting is not None:
            self._reconnecting.cancel()
        for _ in range(FAREWELLS):
            if self._link is not None:
                self.send(farewell)
                await asyncio.sleep(pause)
        if self._link is not None:
            self._link.close()
            self._link = None
        self.down("closed")
        await self.port.close()

    def send(self, data: bytes) -> None:
        """Send, if there is a link."""
        if self._link is not None:
            try:
                self._link.write(data)
            except LinkLost:
                self._drop()  # `lost` is on its way

    def heard(self) -> None:
        """A sound answer has come."""
        self._heard = self.time()
        if self._heard_since == inf:
            self._heard_since = self._heard

    @property
    def ready(self) -> bool:
        """Whether it has answered for long enough to be sent a set-point."""
        return self.time() - self._heard_since >= SETTLED

    def down(self, reason: str) -> None:
        """The controller is not what it was: lost, restarted, in a fault. Counts once, and it has to settle anew."""
        if self._heard_since < inf:
            self._losses += 1
            self._reason = reason
        self._heard_since = inf
        self.tell(reason)

    def tell(self, text: str) -> None:
        """Note what happened last, in words."""
        self._text = text

    def fail(self, error: Exception) -> None:
        """End the run with this at the next report."""
        self._failure = error

    def report(self, now: float, faults: dict[str, int]) -> BoardLink:
        """How the link is, the faults of the stream counted by name; raises HalError when it failed for good."""
        if self._failure is not None:
            if isinstance(self._failure, HalError):
                raise self._failure
            raise HalError(f"the link to {self.port.address} failed: {self._failure!r}") from self._failure
        time = self.time()
        self._origin = min(self._origin, time - now)
        if self._heard_since < inf and time - self._heard > LOST:
            self.down(f"link lost: {self._who} has not answered for {LOST:g} s")
        overflows = self._overflows + (0 if self._link is None else self._link.overflows)
        counts = faults | {"line_overflows": overflows, "reconnects": max(0, self._connections - 1)}
        report = BoardLink(self.ready, self._losses, self._reason, self._text, counts, connected=self._link is not None)
        if report != self._report:
            self._report = report
        assert self._report is not None
        return self._report

    def run_time(self, time: float) -> float:
        """Seconds since the run started, to the ns, at a time of the loop's; 0 before."""
        return round(max(0.0, time - self._origin), 9)

    # -- the link's end ----------------------------------------------------------------------------------------

    def connected(self, link: Link) -> None:
        """Take a fresh line."""
        self._link = link
        self._connections += 1
        self.tell(f"connected to {link.address}, waiting for {self._who}")
        self._greet()

    def received(self, data: bytes) -> None:
        """Hand bytes on; the event loop would only log an error."""
        try:
            self._take(data)
        except Exception as error:
            self.fail(error)

    def lost(self, reason: str) -> None:
        """Look for it."""
        self._drop()
        self.down(f"link lost: {reason}")
        if not self._closed and (self._reconnecting is None or self._reconnecting.done()):
            self._reconnecting = asyncio.ensure_future(self._reconnect())

    def _drop(self) -> None:
        if self._link is not None:
            self._overflows += self._link.overflows
            self._link = None

    async def _reconnect(self) -> None:
        pause, longest = BACKOFF
        while True:
            await asyncio.sleep(pause)
            pause = min(2.0 * pause, longest)
            try:
                await self.port.open(self._end)
                return
            except HalError as error:
                self.tell(str(error))
            except Exception as error:
                self.fail(error)
                return
