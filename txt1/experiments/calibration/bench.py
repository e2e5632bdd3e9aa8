"""The vehicle under calibration, its operator, and driving by hand."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, Final, Protocol

from txt1.config import Config
from txt1.config.sources import with_values
from txt1.errors import NotArmed
from txt1.hal.channels import Rewired
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot

# s between two PWM commands by hand
HAND_PERIOD: Final = 0.05
# s after which a vehicle with its motor in neutral stands
STAND: Final = 2.5
# s in which the steering arrives
STEERING_TIME: Final = 0.6
# counts beyond the dead band at which distances are driven
CRUISE_COUNTS: Final = 1200
# s after which a drive ends even without the operator
DRIVE_PATIENCE: Final = 60.0


class Operator(Protocol):
    """A person beside the vehicle, or a program that answers like a person.

    A question has a key, for programs, and a text, for people.
    """

    def tell(self, text: str) -> None:
        """Say something."""

    async def ready(self, key: str, text: str) -> None:
        """Ask for an action and return when it is done; the vehicle stands meanwhile."""

    async def seen(self, key: str, text: str) -> None:
        """Return as soon as the operator sees something, while the vehicle moves."""

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        """Return the option that the operator chooses."""

    async def number(self, key: str, text: str, unit: str) -> float:
        """Return the number that the operator has measured."""


class Hands:
    """A robot that is driven by hand, by PWM."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.outputs = (0.0, 0.0, 0.0)
        """Motor, front and rear steering, counts."""

    def steer(self, motor: float, steering: float = 0.0) -> None:
        """Hold these counts, steering left positive."""
        self.outputs = (motor, -steering, steering)

    async def hold(self, ticks: Ticks) -> None:
        """Repeat the outputs."""
        async for _ in ticks:
            motor, front, rear = self.outputs
            self.robot.pwm_test(round(motor), round(front), round(rear))

    async def wait(self, seconds: float) -> None:
        """Let time pass; raises NotArmed if the safety gate has closed."""
        await asyncio.sleep(seconds)
        if not self.robot.armed:
            raise NotArmed(self.robot.reason)

    async def until(self, seen: Coroutine[Any, Any, None], limit: float = DRIVE_PATIENCE) -> bool:
        """Go on until the operator sees it, at most `limit` s; return whether it was seen.

        Raises NotArmed as `wait`.
        """
        seeing, ends = asyncio.ensure_future(seen), self.robot.now + limit
        try:
            while not seeing.done() and self.robot.now < ends:
                await self.wait(0.02)
            if seeing.done():
                seeing.result()
            return seeing.done()
        finally:
            seeing.cancel()

    @property
    def counts(self) -> tuple[int, int] | None:
        """Return the present counts of the right and left encoder; None without encoders."""
        ticks = self.robot.runtime.look().ticks
        hal: Any = self.robot.hal
        return hal.counts if ticks is None and isinstance(hal, Rewired) else ticks


class Bench:
    """A vehicle under calibration.

    Args:
        config: the configuration of the vehicle as far as it is known.
        operator: the operator beside it.
        opened: makes a running robot from a configuration; its flag hides the motion from the tasks.
        keep: called with found values, by dotted key, at once.
        own_loops: whether its hardware closes the velocity loops, so that it cannot be driven by hand.
        esc: whether ESCs drive its motors, whose way into reverse has to be found.

    """

    def __init__(
        self,
        config: Config,
        operator: Operator,
        opened: Callable[[Config, bool], AbstractAsyncContextManager[Robot]],
        keep: Callable[[Mapping[str, Any]], None],
        own_loops: bool = False,
        esc: bool = False,
    ) -> None:
        self.config, self.operator, self.own_loops, self.esc = config, operator, own_loops, esc
        self.driving = 0.0
        """Time in which it was ready to move, s."""
        self._opened, self._keep = opened, keep

    @property
    def skids(self) -> bool:
        """Whether its sides run at two speeds."""
        return self.config.geometry.steering == "skid"

    @property
    def cruise(self) -> float:
        """Motor counts for driving distances."""
        return min(self.config.car.dead_band + CRUISE_COUNTS, float(self.config.safety.motor_max))

    @property
    def speed(self) -> float:
        """Set-point for driving distances, m/s."""
        return min(0.5 * self.config.safety.v_max, 0.75)

    def found(self, values: Mapping[str, Any]) -> None:
        """Keep found values, by dotted key, and use them from now on."""
        simulated = {f"sim.{key}": value for key, value in values.items() if key.startswith("channels.")}
        # so that the same vehicle is simulated from its file
        values = {**values, **simulated}
        self.config = with_values(self.config, values)
        self._keep(values)

    @asynccontextmanager
    async def robot(self, changes: Mapping[str, Any] | None = None, unseen: bool = False) -> AsyncIterator[Robot]:
        """Return the running robot, armed, with some values changed; on leaving it stands."""
        async with self._opened(with_values(self.config, changes or {}), unseen) as robot:
            begin = robot.now
            try:
                yield robot
            finally:
                self.driving += robot.now - begin

    @asynccontextmanager
    async def by_hand(self, changes: Mapping[str, Any] | None = None, unseen: bool = False) -> AsyncIterator[Hands]:
        """Return the robot for driving by hand; on leaving it comes to rest."""
        async with self.robot(changes, unseen) as robot:
            hands = Hands(robot)
            await robot.set_manual(True)
            robot.add_task("hands", HAND_PERIOD, hands.hold)
            yield hands
            hands.steer(0.0)
            await hands.wait(STAND)
