"""A radio control's hand beside a robot: one more holder of the wheel, above all others.

While its switch is at "computer" it leaves the wheel alone. Otherwise it holds the wheel: by the sticks, or at zero. So
a program needs a fresh command to drive again, by the commander's ordinary rule. It neither arms the robot nor clears a
stop: it commands velocities, as every source does.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from math import inf
from typing import Final

from txt1.errors import ConfigError
from txt1.kernel.ticks import Ticks
from txt1.link.base import Port
from txt1.rc.frames import Heard, telemetry
from txt1.rc.receiver_port import ReceiverLine
from txt1.rc.settings import RcParameters, take_over
from txt1.rc.take_over import RcState
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

LETTERS: Final = {
    RcState.LOST: "LOST",
    RcState.WAITING: "WAIT",
    RcState.DRIVES: "HAND",
    RcState.HALF_WAY: "HOLD",
    RcState.COMPUTER: "COMPUTER",
}
"""What the transmitter shows while the robot is armed."""


class RcHand:
    """The hand of a radio control on a robot's wheel."""

    def __init__(self, robot: Robot, parameters: RcParameters, port: Port | None = None) -> None:
        _check_priorities(robot)
        self._robot, self._hand = robot, robot.config.hand()
        self._speed = parameters.speed or inf
        self._rule = take_over(parameters)
        self._source = robot.source("rc")
        self.line = ReceiverLine(parameters.protocol, parameters.port or "", self._take, port)
        """The line to the receiver."""
        self._answers = parameters.protocol == "crsf"
        self._heard = -inf
        self._told: RcState | None = None
        self._armed = robot.armed
        self._due = 0.0

    @property
    def state(self) -> RcState:
        """Who drives, by the radio control."""
        return self._rule.look(asyncio.get_running_loop().time()).state

    def _take(self, heard: Heard, arrived: float) -> None:
        self._rule.take(heard.pulses, heard.lost, arrived)
        if heard.pulses is not None:
            self._heard = arrived

    def warning(self) -> str:
        """Return a warning for the screens; "" while somebody may drive."""
        if self.state not in (RcState.LOST, RcState.WAITING):
            return ""
        why = f" ({self.line.problem})" if self.line.problem else ""
        return f"radio control: {TOLD[self.state]}{why}"

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
            self._rule.let_go()
        wish = self._rule.look(time)
        if wish.state is not self._told:
            self._told = wish.state
            robot.tell(f"radio control: {TOLD[wish.state]}")
            if wish.state is RcState.COMPUTER:
                source.release()
        if wish.state is not RcState.COMPUTER:
            if not source.request() and armed:
                robot.disarm("radio control: another source has priority over the hand; give it less")
            v, omega = self._hand.velocity(self._speed, wish.ahead, wish.left, wheel=True)
            driven = wish.state is RcState.DRIVES
            source.command(v, omega, now - min(max(time - self._heard, 0.0), now) if driven else None)
            if robot.runtime.state.panel.manual and armed:
                # counts by hand do not ask who has the wheel
                robot.disarm(f"radio control: {TOLD[wish.state]}, not in manual mode")
        if self._answers and now >= self._due:
            self._due = now + TELEMETRY_PERIOD
            self.line.send(telemetry(robot.battery.battery1, self._mode(wish.state)))

    def _mode(self, state: RcState) -> str:
        if not self._robot.armed:
            return "DISARMED"
        return LETTERS[state]


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
    hand = RcHand(robot, parameters, port)
    await hand.line.open()
    robot.runtime.state.warnings.append(hand.warning)
    robot.add_task("rc", STEER_PERIOD, hand.steer)
    try:
        yield hand
    finally:
        robot.runtime.state.warnings.remove(hand.warning)
        await hand.line.close()
