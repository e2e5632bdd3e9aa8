"""Answers the silence of a device: greets it again, then opens its port again, for ever and with growing pauses.

How it works
------------

A device falls silent in many ways. Its power dips, its adapter is pulled out, the computer at the other end dies. Most
of these ways show in nothing but silence. So silence itself is answered, by a ladder that all drivers share:

1. After `patience` s without a sound reading the device is **greeted** again, as on a new line: it may have started
   again in its first mode. A device that takes no commands skips this step.
2. After the same time again its port is **opened** again: the connection may be half open, or the adapter may hang.
3. Then its port is opened again and again. The pauses double, up to LONGEST_PAUSE.

A port that is lost is opened again after FIRST_PAUSE s, then with pauses of up to LOST_LONGEST: nothing is waited for
but the plug. A sound reading ends all this, and the next silence begins at the first step.

`Ladder` says when the next step is due, and which one. It has no clock and does no I/O. `Watched` takes the steps for
a port. A step sends the driver's greeting and nothing else: greetings arm nothing, and switch nothing on.
"""

import asyncio
from collections.abc import Callable
from enum import Enum
from math import inf
from typing import Final

from txt1.errors import HalError
from txt1.link.base import End, Link, Port

# s from the loss of a port to the first attempt to open it, and the longest pause between later attempts
FIRST_PAUSE: Final = 0.1
LOST_LONGEST: Final = 0.9
# s, longest pause between two steps against a device that is silent on an open port
LONGEST_PAUSE: Final = 10.0
# s by which a timer may fire early
TIMER_EARLY: Final = 1e-3


class Step(Enum):
    """A step of the ladder."""

    GREET = "greet"
    OPEN = "open"


class Ladder:
    """The steps against the silence of one device. Times are in s of one clock.

    `patience` is the time of silence after which a step is due; `greets`: the device can be greeted.
    """

    def __init__(self, patience: float, greets: bool = True) -> None:
        self.greeted = self.opened = self.connections = 0
        """In the present silence: how often it was greeted, its port was tried, and its port did open."""
        self._patience, self._greets = patience, greets
        # time of the last sound reading
        self._last = inf
        # when the next step is due; None: there is no silence
        self._due: float | None = None
        self._lost_pause = self._pause = 0.0

    @property
    def silent(self) -> bool:
        """Whether a step was taken, or the port lost, and no sound reading has come since."""
        return self._due is not None

    @property
    def due(self) -> float:
        """When the next step is due if no reading comes; inf while the port is being opened."""
        return self._last + self._patience if self._due is None else self._due

    def heard(self, time: float) -> None:
        """Take a sound reading, which ends the silence."""
        self._last, self._due = time, None

    def take(self, time: float) -> Step:
        """Take the step that is due, and return it."""
        if self._due is None:
            self._begin()
            if self._greets:
                self.greeted += 1
                self._due = time + self._patience
                return Step.GREET
        self.opened += 1
        self._due = inf
        return Step.OPEN

    def lost(self, time: float) -> None:
        """Note that the port is lost, or could not be opened."""
        if self._due is None:
            self._begin()
        self._due = time + self._lost_pause
        self._lost_pause = min(2.0 * self._lost_pause, LOST_LONGEST)

    def connected(self, time: float) -> None:
        """Note that the port is open, and the device greeted."""
        self.connections += 1
        if self._due is None:
            self._last = time
        else:
            self._due = time + self._pause
            self._pause = min(2.0 * self._pause, max(LONGEST_PAUSE, self._patience))

    def _begin(self) -> None:
        self.greeted = self.opened = self.connections = 0
        self._lost_pause, self._pause = FIRST_PAUSE, self._patience

    def __str__(self) -> str:
        """Return the steps taken, in words, such as "greeted again, opened again 3 times"."""
        steps = []
        if self.greeted:
            steps.append("greeted again")
        if self.opened:
            steps.append("opened again" if self.opened == 1 else f"opened again {self.opened} times")
        return ", ".join(steps)


class Watched:
    """An end between a port and a driver. It keeps the port open, and answers the device's silence.

    Args:
        port: the device's port; it may be exchanged before `open`.
        end: the driver's end. It greets the device in `connected`, and calls `heard` for each sound reading.
        patience: s for which the device may be silent.
        greet: greets the device on a line that is open; None: it takes no commands.
        tell: called with the reason why the port cannot be opened.
        fail: called with any other error than HalError.
        give_up: called in place of the end's `lost` when the link of a silent device is closed; None: `lost`.
        wrap: puts faults on the line, if any.

    """

    def __init__(
        self,
        port: Port,
        end: End,
        patience: float,
        greet: Callable[[], None] | None,
        tell: Callable[[str], None],
        fail: Callable[[Exception], None],
        give_up: Callable[[str], None] | None = None,
        wrap: Callable[[End], End] = lambda end: end,
    ) -> None:
        self.port = port
        self.ladder = Ladder(patience, greet is not None)
        self._end, self._greet, self._tell, self._fail = end, greet, tell, fail
        self._give_up = give_up or end.lost
        self._outer = wrap(self)
        self._link: Link | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._opening: asyncio.Task[None] | None = None
        self._closed = True

    async def open(self) -> None:
        """Open the port, which is kept open until `close`. Raises what the port raises."""
        self._closed = False
        self.ladder.heard(inf)
        try:
            await self.port.open(self._outer)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leave the port alone from now on; its link stays as it is. Harmless when closed already."""
        self._closed, self._link = True, None
        self._wait()
        if self._opening is not None:
            self._opening.cancel()
            self._opening = None

    def heard(self) -> None:
        """Take a sound reading of the device."""
        self.ladder.heard(asyncio.get_running_loop().time())

    def give_up(self, reason: str) -> None:
        """Close the link, and open the port again soon."""
        link, self._link = self._link, None
        if link is not None:
            # bytes that the device has not taken are discarded
            link.close()
        self.lost(reason)

    # -- the link's end ----------------------------------------------------------------------------------------

    def connected(self, link: Link) -> None:
        """Take a new link."""
        self._link = link
        self.ladder.connected(asyncio.get_running_loop().time())
        self._end.connected(link)
        self._wait()

    def received(self, data: bytes) -> None:
        """Pass bytes on."""
        self._end.received(data)

    def lost(self, reason: str) -> None:
        """Pass the loss on, and open the port again soon."""
        self._link = None
        if not self._closed:
            self.ladder.lost(asyncio.get_running_loop().time())
        self._end.lost(reason)
        self._wait()

    # -- inside ------------------------------------------------------------------------------------------------

    def _wait(self) -> None:
        """Wait for the next step. Readings do not move the timer: it looks again when it fires."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._closed and self.ladder.due < inf:
            self._timer = asyncio.get_running_loop().call_at(self.ladder.due, self._look)

    def _look(self) -> None:
        self._timer = None
        time = asyncio.get_running_loop().time()
        if time < self.ladder.due - TIMER_EARLY:
            self._wait()
            return
        if self.ladder.take(time) is Step.OPEN:
            self._opening = asyncio.ensure_future(self._open_again())
        elif self._greet is not None:
            self._greet()
        self._wait()

    async def _open_again(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            # bytes that the device has not taken are discarded
            link.close()
            self._give_up(f"{link.address} is silent")
            # the other end of a link in memory notices in the next turn
            await asyncio.sleep(0)
        try:
            await self.port.open(self._outer)
        except HalError as error:
            self._tell(str(error))
            self.ladder.lost(asyncio.get_running_loop().time())
            self._wait()
        except Exception as error:
            self._fail(error)
