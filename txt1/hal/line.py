"""The line to a board or a motor controller: kept open, and watched.

A line is up while there is a link. The device behind it is *found* while it answers. Both come and go: an adapter is
unplugged, a board loses its power. So a lost line is opened again, a device that was silent for too long counts as
lost, and its silence is answered (`txt1.link.silence`). Each loss is counted once and disarms the robot. A device that
was found again has to answer for a while before it gets a set-point; then it has *settled*.
"""

import asyncio
from collections.abc import Callable
from math import inf
from typing import Final

from txt1.errors import HalError, LinkLost
from txt1.hal.base import BoardLink
from txt1.link.base import End, Link, Port
from txt1.link.silence import Watched

# s without an answer after which a motor controller is lost
ANSWER_SILENCE: Final = 0.3
# s of answers before the first set-point
ANSWERS_SETTLED: Final = 0.5
# s of silence after which the port is opened again: longer than the silence of boards whose host clears their loops
LINE_PATIENCE: Final = 6.0
# s of silence or unknown bytes after which the line is examined, and the number of bytes examined
UNDERSTOOD: Final = 1.0
SILENT: Final = 3.0
STRANGE: Final = 4096
# number of times that the farewell is sent: lines lose frames
FAREWELLS: Final = 3


class Line:
    """An end of a link; the link is opened again whenever it was lost.

    Args:
        port: the controller's port.
        wrap: puts faults on the line, if any.
        awaited: the device's answers in words, such as "odometry".
        greet: called when the line is new.
        take: called with the received bytes; it calls `heard` for every intact answer.
        lost: s without an answer after which the device is lost; None: ANSWER_SILENCE.
        settled: s of answers before the first set-point.
        forget: called when the device was lost or has restarted.
        hal: the HAL of the device; if another device answers, that is reported.

    """

    def __init__(
        self,
        port: Port,
        wrap: Callable[[End], End],
        awaited: str,
        greet: Callable[[], None],
        take: Callable[[bytes], None],
        lost: float | None = None,
        settled: float = ANSWERS_SETTLED,
        forget: Callable[[], None] = lambda: None,
        hal: str = "",
    ) -> None:
        self.watched = Watched(port, self, LINE_PATIENCE, None, self.tell, self.fail, self._given_up, wrap)
        """Keeps the port open, and answers the device's silence."""
        self.link: Link | None = None
        self.tap: Callable[[str, bytes], None] = lambda direction, data: None
        """Called with all bytes as they come ("in") and go ("out")."""
        # the loop's
        self.time: Callable[[], float] = lambda: 0.0
        self._awaited, self._greet, self._take = awaited, greet, take
        self._lost, self._settled, self._forget = ANSWER_SILENCE if lost is None else lost, settled, forget
        self._hal = hal
        self._strange: bytes | None = b""
        """Bytes since the connection that were no answer; None: the language was reported."""
        # loop time
        self._connected = inf
        # whether the link was given up as the device is silent
        self._gave_up = False
        self._closed = True
        self._failure: Exception | None = None
        # loop time of the run's start
        self._origin = inf
        self.last = -inf
        """Loop time of the last answer."""
        self.heard_since = inf
        """Loop time of the first answer since the device was lost."""
        self._losses, self._connections, self._overflows = 0, 0, 0
        self._reason = ""
        self._text = f"connecting to {port.address}"
        self._report: BoardLink | None = None

    @property
    def port(self) -> Port:
        """The controller's port."""
        return self.watched.port

    @property
    def opened(self) -> bool:
        """Whether it was opened, and not closed since."""
        return not self._closed

    async def open(self) -> None:
        """Open the port; from then on a lost link is opened again until `close`."""
        self.time = asyncio.get_running_loop().time
        self._origin, self._failure, self._closed = inf, None, False
        try:
            await self.watched.open()
        except BaseException:
            self._closed = True
            await self.port.close()
            raise

    async def close(self, *farewell: bytes, pause: float = 0.02) -> None:
        """Send the farewell, repeated with pauses (s), and close; harmless when closed already."""
        if self._closed:
            return
        self._closed = True
        self.watched.close()
        for _ in range(FAREWELLS):
            if self.link is not None:
                for frame in farewell:
                    self.send(frame)
                await asyncio.sleep(pause)
        if self.link is not None:
            self.link.close()
            self.link = None
        self.down("closed")
        await self.port.close()

    def send(self, data: bytes) -> None:
        """Send bytes, if there is a link."""
        if self.link is not None:
            self.tap("out", data)
            try:
                self.link.write(data)
            except LinkLost:
                # the link calls `lost` next
                self._drop()

    def heard(self) -> bool:
        """Note an intact answer; return whether it is the first since the device was lost."""
        self.last = self.time()
        self.watched.ladder.heard(self.last)
        found = self.heard_since == inf
        if found:
            self.heard_since = self.last
        return found

    @property
    def ready(self) -> bool:
        """Whether the device has answered for long enough to get a set-point."""
        return self.time() - self.heard_since >= self._settled

    def down(self, reason: str) -> None:
        """Note that the device was lost, has restarted or is in a fault.

        It counts once, and the device has to settle again.
        """
        if self.heard_since < inf:
            self._losses += 1
            self._reason = reason
        self.heard_since = inf
        self._forget()
        self.tell(reason)

    def tell(self, text: str) -> None:
        """Note the last event, in words."""
        self._text = text

    def fail(self, error: Exception) -> None:
        """End the run with this error at the next report."""
        self._failure = error

    def report(self, now: float, faults: dict[str, int], busy: bool = False, gains: bool = True) -> BoardLink:
        """Return the state of the link; raises HalError after a final failure.

        `faults` counts faults of the stream by name. A `busy` device takes no set-point. `gains` is as in `BoardLink`.
        """
        if self._failure is not None:
            if isinstance(self._failure, HalError):
                raise self._failure
            raise HalError(f"the link to {self.port.address} failed: {self._failure!r}") from self._failure
        time = self.time()
        self._origin = min(self._origin, time - now)
        if self.heard_since < inf and time - self.last > self._lost:
            self.down(f"link lost: no {self._awaited} for {self._lost:g} s")
        waited = time - self._connected
        if self._strange is not None and self.heard_since == inf and waited > (UNDERSTOOD if self._strange else SILENT):
            self._tell_who_speaks(self._strange)
        overflows = self._overflows + (0 if self.link is None else self.link.overflows)
        counts = faults | {"line_overflows": overflows, "reconnects": max(0, self._connections - 1)}
        ready, connected = self.ready and not busy, self.link is not None
        report = BoardLink(ready, self._losses, self._reason, self._text, counts, gains, connected)
        if report != self._report:
            self._report = report
        assert self._report is not None
        return self._report

    def _tell_who_speaks(self, data: bytes) -> None:
        """Report the language of these bytes if it is another device's."""
        from txt1.hal.languages import named

        self._strange = None
        place = self.port.address
        ask = f"txt1 doctor --port {place} asks which device is there"
        if whose := named(data, but=self._hal) or ("" if data else ask):
            self.tell(f"no {self._awaited} on {place}: {whose}")

    def run_time(self, time: float) -> float:
        """Return the seconds from the start of the run to a loop time, exact to the ns; 0 before the start."""
        return round(max(0.0, time - self._origin), 9)

    # -- the link's end ----------------------------------------------------------------------------------------

    def connected(self, link: Link) -> None:
        """Take a new line."""
        self.link = link
        self._connections += 1
        if self._gave_up:
            # the same device, which gets messages all the time: what is known of it shows whether it has restarted
            self._gave_up = False
            return
        self._strange, self._connected = b"", self.time()
        self.tell(f"connected to {link.address}, waiting for {self._awaited}")
        self._greet()

    def received(self, data: bytes) -> None:
        """Pass bytes on. An error ends the run here, because the event loop would only log it."""
        self.tap("in", data)
        if self._strange is not None and self.heard_since == inf:
            self._strange = (self._strange + data)[-STRANGE:]
        try:
            self._take(data)
        except Exception as error:
            self.fail(error)

    def lost(self, reason: str) -> None:
        """Look for the device."""
        self._drop()
        self._gave_up = False
        self.down(f"link lost: {reason}")

    def _given_up(self, _: str) -> None:
        """Note that a silent device's port is opened again; its loss is told by `report`."""
        self._drop()
        self._gave_up = True

    def _drop(self) -> None:
        if self.link is not None:
            self._overflows += self.link.overflows
            self.link = None
