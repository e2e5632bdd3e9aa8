"""A serial HAL alone: at the other end of its line is a board that says what a test lets it say."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from txt1.hal.base import BoardLink, Inputs, Outputs
from txt1.hal.serial import SerialHal
from txt1.kernel.loop import VirtualTimeLoop
from txt1.link.base import End, Link
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
    EncoderOdometry,
    HostMessage,
    Message,
    PidSet,
    Velocity,
)

TICK, ODOMETRY = 20, 50  # ms between two steps of the host, and between two messages of the board
NEUTRAL, DRIVE = Outputs(), Outputs(v=0.5, omega=0.25)
ZERO, HALF = Velocity(0.0, 0.0), Velocity(0.5, 0.25)
GAINS = PidSet((1.0, 2.0, 3.0), ((1.5, 4.0, 5.0, 6.0),))
OTHERS = PidSet((1.0, 2.0, 4.0), ((1.5, 4.0, 5.0, 6.0),))
STANDING = EncoderOdometry(1.0, 2.0, 0.5, 0.0, 0.0)
ORIGIN = EncoderOdometry(0.0, 0.0, 0.0, 0.0, 0.0)
BEFORE = 0.3  # s of the loop before the run


class Wire(Link):
    """The line: what the host sends is read at once."""

    desk: Desk

    def _send(self, data: bytes) -> None:
        self.desk.hears(data)

    def _let_go(self) -> None:
        self.desk.let_go += 1


class Desk:
    """A serial HAL, its port, and the board: `says` None keeps silent."""

    address = "desk"

    def __init__(self, wrap: Callable[[End], End] | None = None, **options: Any) -> None:
        self.loop = VirtualTimeLoop()
        self.ms = 0  # of the run
        self.says: Message | None = STANDING
        self.sent: list[tuple[float, HostMessage]] = []
        self.opened: list[float] = []
        self.trouble: BaseException | None = None  # when the port is opened
        self.ports_closed = self.let_go = 0
        self.inputs = Inputs()
        self.hal = SerialHal(self, wrap or (lambda end: end), **options)
        self._ear = Decoder(Role.BOARD)

    async def open(self, end: End) -> Link:
        self.opened.append(round(self.loop.time() - BEFORE, 6))
        if self.trouble is not None:
            raise self.trouble
        wire = Wire("desk", end)
        wire.desk = self
        end.connected(wire)
        return wire

    async def close(self) -> None:
        self.ports_closed += 1

    @property
    def now(self) -> float:
        return self.ms / 1000.0

    def hears(self, data: bytes) -> None:
        for message in self._ear.feed(data):
            assert isinstance(message, HostMessage)
            self.sent.append((round(self.loop.time() - BEFORE, 6), message))

    def do(self, what: Any) -> Any:
        """Await it, or call it, while the loop runs."""

        async def doing() -> Any:
            return await what if asyncio.iscoroutine(what) else what()

        return self.loop.run_until_complete(doing())

    def opens(self) -> Desk:
        self.do(asyncio.sleep(BEFORE - 0.1))
        self.do(self.hal.open())
        self.do(asyncio.sleep(0.1))
        return self

    def tells(self, message: Message) -> None:
        """The board says it now."""
        self.do(lambda: self.hal.line.received(encode(message)))

    def runs(self, seconds: float, outputs: Outputs = NEUTRAL, *, held_up: bool = False) -> Desk:
        """Go on for so long, the first tick at once, unless the host is held up."""

        async def running() -> None:
            for _ in range(round(1000 * seconds / 10)):
                if self.says is not None and self.ms % ODOMETRY == 0 and self.hal.line.link is not None:
                    self.hal.line.received(encode(self.says))
                if self.ms % TICK == 0 and not held_up:
                    self.inputs = self.hal.read(self.now)
                    self.hal.write(outputs, self.now)
                await asyncio.sleep(0.01)
                self.ms += 10

        self.do(running())
        return self

    @property
    def link(self) -> BoardLink:
        link = self.hal.read(self.now).link
        assert link is not None
        return link

    def heard(self, *kinds: type[HostMessage], since: float = 0.0) -> list[tuple[float, HostMessage]]:
        """What of these kinds it was sent since then, and when."""
        return [(time, message) for time, message in self.sent if isinstance(message, kinds) and time >= since]

    def times(self, *kinds: type[HostMessage], since: float = 0.0) -> list[float]:
        return [time for time, _ in self.heard(*kinds, since=since)]

    def loads(self, gains: PidSet = GAINS) -> list[bool]:
        """Load gains; the list gets the answer."""
        answers: list[bool] = []
        self.do(lambda: self.hal.load_gains(gains, answers.append))
        return answers
