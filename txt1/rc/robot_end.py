"""A radio control's hand beside a robot: one more holder of the wheel, above all others.

While its switch is at "computer" it leaves the wheel alone. Otherwise it holds the wheel: by the sticks, or at zero. So
a program needs a fresh command to drive again, by the commander's ordinary rule. It neither arms the robot nor clears a
stop: it commands velocities, as every source does.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from math import inf
from typing import Final

from txt1.control.limits import Fault
from txt1.errors import ConfigError
from txt1.hal.serial import SerialHal
from txt1.kernel.ticks import Ticks
from txt1.link.base import Port
from txt1.rc.frames import RcFrame, telemetry
from txt1.rc.receiver_port import ReceiverLine
from txt1.rc.settings import BOARD, RcParameters, take_over
from txt1.rc.take_over import FRAME_SILENCE, RcState
from txt1.robot import Robot

PRIORITY: Final = 60
# s between two commands
STEER_PERIOD: Final = 0.02
# s between two pieces of telemetry for the transmitter
TELEMETRY_PERIOD: Final = 0.5
TOLD: Final = {
    RcState.LOST: "the transmitter is not heard: nobody drives",
    RcState.WAITING: "nobody drives until its switch is at hand with the throttle at neutral",
    RcState.DRIVES: "the hand drives",
    RcState.HALF_WAY: "the hand holds it at zero",
    RcState.COMPUTER: "the computer may drive, by a fresh command",
}

OF_THE_HOST: Final = frozenset((Fault.LINK, Fault.MISSED, Fault.SLEPT))
"""Faults of this computer or its line, which say nothing about the car: they bind the hand only while it is heard."""

LETTERS: Final = {
    RcState.LOST: "LOST",
    RcState.WAITING: "WAIT",
    RcState.DRIVES: "HAND",
    RcState.HALF_WAY: "HOLD",
    RcState.COMPUTER: "COMPUTER",
}
"""What the transmitter shows while the robot is armed."""


class RcHand(ABC):
    """The hand of a radio control on a robot's wheel, wherever its receiver is."""

    problem = ""
    """Why the receiver is not heard; "" if that is not known."""

    def __init__(self, robot: Robot) -> None:
        _check_priorities(robot)
        self._robot = robot
        self._source = robot.source("rc")
        self._told: RcState | None = None
        self._armed = robot.armed

    @property
    @abstractmethod
    def state(self) -> RcState:
        """Who drives, by the radio control."""

    @abstractmethod
    def driven(self, time: float) -> tuple[float, float, float]:
        """Return the sticks' velocity, m/s and rad/s, and its age at the loop's `time`, s."""

    @abstractmethod
    def let_go(self) -> None:
        """Let the throttle drive only once it was seen at neutral."""

    @abstractmethod
    def tell(self, now: float, state: RcState) -> None:
        """Tell the other end what the robot does, fifty times a second."""

    @abstractmethod
    async def open(self) -> None:
        """Begin to listen."""

    @abstractmethod
    async def close(self) -> None:
        """End it."""

    def warning(self) -> str:
        """Return a warning for the screens; "" while somebody may drive."""
        if self.state not in (RcState.LOST, RcState.WAITING):
            return ""
        return f"radio control: {TOLD[self.state]}{self.problem and f' ({self.problem})'}"

    async def steer(self, ticks: Ticks) -> None:
        """Hold the wheel or leave it, fifty times a second."""
        async for now in ticks:
            self._step(now, asyncio.get_running_loop().time())

    def _step(self, now: float, time: float) -> None:
        robot, source = self._robot, self._source
        armed, before = robot.armed, self._armed
        self._armed = armed
        if (armed and not before) or source.overruled:
            # as any hand after an arming or a stop: it lets go, and asks anew
            self.let_go()
        state = self.state
        if state is not self._told:
            self._told = state
            robot.tell(f"radio control: {TOLD[state]}")
            if state is RcState.COMPUTER:
                source.release()
        if state is not RcState.COMPUTER:
            if not source.request() and armed:
                robot.disarm("radio control: another source has priority over the hand; give it less")
            if state is RcState.DRIVES:
                v, omega, age = self.driven(time)
                source.command(v, omega, now - min(max(age, 0.0), now))
            else:
                source.command(0.0, 0.0)
            if robot.runtime.state.panel.manual and armed:
                # counts by hand do not ask who has the wheel
                robot.disarm(f"radio control: {TOLD[state]}, not in manual mode")
        self.tell(now, state)


class ReceiverHand(RcHand):
    """The hand of a radio control whose receiver is at this computer."""

    def __init__(self, robot: Robot, parameters: RcParameters, port: Port | None = None) -> None:
        super().__init__(robot)
        self._hand, self._speed = robot.config.hand(), parameters.speed or inf
        self._rule = take_over(parameters)
        self._line = ReceiverLine(parameters.protocol, parameters.port or "", self._take, port)
        self._answers = parameters.protocol == "crsf"
        self._heard = -inf
        self._due = 0.0

    @property
    def state(self) -> RcState:
        """Who drives, by the radio control."""
        return self._rule.look(asyncio.get_running_loop().time()).state

    def driven(self, time: float) -> tuple[float, float, float]:
        """Return the sticks' velocity and its age."""
        wish = self._rule.look(time)
        return *self._hand.velocity(self._speed, wish.ahead, wish.left, wheel=True), time - self._heard

    def let_go(self) -> None:
        """Wait for the throttle's neutral."""
        self._rule.let_go()

    async def open(self) -> None:
        """Open the port."""
        await self._line.open()

    async def close(self) -> None:
        """Close it."""
        await self._line.close()

    def tell(self, now: float, state: RcState) -> None:
        """Show the transmitter battery and mode."""
        self.problem = self._line.problem
        if self._answers and now >= self._due:
            self._due = now + TELEMETRY_PERIOD
            robot = self._robot
            self._line.send(telemetry(robot.battery.battery1, LETTERS[state] if robot.armed else "DISARMED"))

    def _take(self, heard: RcFrame, arrived: float) -> None:
        self._rule.take(heard.pulses, heard.lost, arrived)
        if heard.pulses is not None:
            self._heard = arrived


class BoardHand(RcHand):
    """The hand of a radio control whose receiver is at the board.

    The board decides who drives, and obeys the sticks by itself. It tells both, so this host commands the same, and
    does not take the hand's motion for a fault. It is told whether the robot is armed, which binds the hand.
    """

    problem = "the board tells of no receiver: put `receiver` into its settings.json"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        if not isinstance(robot.hal, SerialHal):
            raise ConfigError(f"rc.port: board: the hardware layer '{robot.hal.name}' has no receiver; give its port")
        self._hal = robot.hal
        # what the board was told last, permitted and stopped, and when it is told again, s of the run
        self._told_board: tuple[bool, bool] | None = None
        self._due = 0.0
        self._was_armed = robot.armed

    async def open(self) -> None:
        """Do nothing: the board reports by itself."""

    async def close(self) -> None:
        """Do nothing: the board keeps what it was told."""

    @property
    def state(self) -> RcState:
        """Who drives, as the board tells."""
        told = self._hal.rc
        if told is None or self._hal.line.time() - told[1] > FRAME_SILENCE:
            return RcState.LOST
        self.problem = ""
        states = tuple(RcState)
        number = int(told[0].state)
        return states[number] if 0 <= number < len(states) else RcState.LOST

    def driven(self, time: float) -> tuple[float, float, float]:
        """Return the sticks' velocity and its age."""
        told = self._hal.rc
        assert told is not None
        return told[0].v / 1000.0, told[0].omega / 1000.0, time - told[1]

    def let_go(self) -> None:
        """Forbid the hand for a moment: a board that permits it again waits for the throttle's neutral."""
        self._hal.permit_hand(False, self._stopped)
        self._told_board = None

    def tell(self, now: float, state: RcState) -> None:
        """Tell the board whether the hand may drive: at once when that changes, and again and again."""
        armed = self._robot.armed
        self._was_armed |= armed
        told = armed, self._stopped
        if self._hal.rc is not None and (told != self._told_board or now >= self._due):
            self._told_board, self._due = told, now + TELEMETRY_PERIOD
            self._hal.permit_hand(*told)

    @property
    def _stopped(self) -> bool:
        """Whether somebody stopped or disarmed the robot, or the car has a fault: this outlives the host."""
        gate = self._robot.runtime.gate
        if gate.armed:
            return False
        return gate.stopped or (self._was_armed and gate.closed_by not in OF_THE_HOST)


def _check_priorities(robot: Robot) -> None:
    """Raise ConfigError for a source that would have priority over the hand."""
    given = robot.config.commander.priorities
    hand = given.get("rc", PRIORITY)
    for name, priority in given.items():
        if name != "rc" and priority >= hand:
            raise ConfigError(
                f"commander.priorities.{name}: {priority} is not below the radio control's {hand}: lower it"
            )
    if hand <= 50:
        raise ConfigError(f"commander.priorities.rc: {hand} is not above the keys' 50: give more, or leave it out")


@asynccontextmanager
async def beside(robot: Robot, parameters: RcParameters, port: Port | None = None) -> AsyncIterator[RcHand]:
    """Let a radio control take over until the block is left."""
    hand = BoardHand(robot) if parameters.port == BOARD else ReceiverHand(robot, parameters, port)
    await hand.open()
    robot.runtime.state.warnings.append(hand.warning)
    robot.add_task("rc", STEER_PERIOD, hand.steer)
    try:
        yield hand
    finally:
        robot.runtime.state.warnings.remove(hand.warning)
        await hand.close()
