"""The driver, the host's half of driving: it sends the driving source's set-point to the board, 20 times a second."""

from collections.abc import Callable
from math import inf, isfinite, nan
from typing import Final

from txt1.control.commander import Commander, Driver
from txt1.control.holding import PAUSE
from txt1.errors import CommandRefused, NotArmed, Overruled
from txt1.plugins import Registry
from txt1.protocol.messages import Velocity
from txt1.runtime import Runtime
from txt1.tasks.fields import DRIVER

# seconds between two Velocity messages, which the driver sends all the time (20 Hz)
REFRESH: Final = 0.05
SOURCES: Final = Registry("source of commands", "txt1.sources", {})
"""Sources from other packages: ``async def steer(robot: Robot) -> None``, run beside the robot by `run --source NAME`.

It makes a `Robot.source` for itself, and commands from there or from a task that it adds.
"""


class Wheel:
    """A robot's commander, with the clock and the way to the board."""

    def __init__(self, runtime: Runtime) -> None:
        self.runtime = runtime
        self.commander = Commander(runtime.gate.limits.command_timeout)
        self._message = Velocity(0.0, 0.0)
        # whether a message was sent since the driver's last tick
        self._sent = False
        # the source whose hold has moved the robot, and since when it is stopped without its asking, s of the run
        self._drove, self._stopped_since = "", inf
        scheduler, driver = runtime.scheduler, self.commander.driver
        runtime.bus.offer(DRIVER, lambda: driver(scheduler.now))

    @property
    def driver(self) -> Driver:
        """The driving source, and the counts of refused commands."""
        return self.commander.driver(self.runtime.now)

    def send(self, v: float, omega: float, time: float) -> None:
        """Send a set-point at once, m/s and rad/s; its author gave it at `time`."""
        # an unchanged command makes no new message
        if v is not self._message.v or omega is not self._message.omega:
            self._message = Velocity(v, omega)
        self.runtime.post(self._message, time)
        self._sent = True

    def tick(self, now: float) -> None:
        """Send the set-point, unless one was sent since the last tick; sending does not make it fresh."""
        self._end_stopped_hold(now)
        if not self._sent:
            self.send(*self.commander.setpoint(now))
        self._sent = False

    def _end_stopped_hold(self, now: float) -> None:
        """End a hold that moved the robot, and was stopped for more than PAUSE without its asking.

        An obstacle that a guard sees is no such stop: the guard only limits the command.
        """
        state, driver = self.runtime.state, self.commander.driver(now).name
        command, control = state.command, state.control
        asks = driver and command is not None and (command.v or command.omega)
        if not asks or control.v or control.omega:
            self._drove, self._stopped_since = driver if asks else "", inf
        elif self._drove == driver and not self.runtime.gate.limited:
            self._stopped_since = min(self._stopped_since, now)
            if now - self._stopped_since > PAUSE:
                self.commander.interrupt(now)
                self._sent = False
                self.runtime.tell(f"{driver!r} was stopped for more than {PAUSE:g} s: it has to let go and ask again")


class CommandSource:
    """A source of commands, with its name in telemetry and messages; get one from `Robot.source`."""

    def __init__(self, name: str, wheel: Wheel) -> None:
        self.name = name
        self._wheel = wheel

    @property
    def drives(self) -> bool:
        """Whether it has the wheel."""
        return self._wheel.driver.name == self.name

    @property
    def overruled(self) -> str:
        """The source that overruled it; "" after that source has let go and this one has sent a zero or a request."""
        return self._wheel.commander.overruled(self.name)

    def command(self, v: float, omega: float, time: float | None = None) -> bool:
        """Ask for a speed in m/s and a yaw rate in rad/s, until the source's time-out after `time`.

        A command that is not zero takes the wheel or holds it, unless another source keeps it. Zeros stop the robot and
        hold nothing. Commands beyond safety.v_max and abs(v) / R_min are clipped and counted. `time` is when its author
        gave the command, s of the run; None is now.

        Returns whether the command is obeyed; a refused command is counted. Directly after another source that moved
        the robot, an obeyed command counts as zero for 0.1 s. Raises CommandRefused: a value is not finite, or the time
        lies in the future. The command before stays in force until it is stale.
        """
        return self._give(self._wheel.commander.command, v, omega, time)

    def hold(self, v: float, omega: float, time: float | None = None) -> bool:
        """Ask for a velocity, as `command` does, for a hand that holds: a key or a dead-man is down.

        Zeros hold the wheel, too, until `release`. A hold is over when another source takes the wheel, when the robot
        is armed, and after 0.5 s without a command; then the hand has to let go (`release`) and press again.
        """
        return self._give(self._wheel.commander.hold, v, omega, time)

    def _give(
        self, take: Callable[[str, float, float, float, float], bool], v: float, omega: float, time: float | None
    ) -> bool:
        wheel = self._wheel
        now = wheel.runtime.now
        try:
            v, omega = number("velocity command: v", v), number("velocity command: omega", omega)
        except CommandRefused:
            # the gate counts it
            wheel.runtime.post(Velocity(nan, nan), now)
            raise
        try:
            taken = take(self.name, v, omega, now if time is None else time, now)
        except ValueError as error:
            raise CommandRefused(str(error)) from None
        if taken:
            # it is in force, as it is fresh
            wheel.send(*wheel.commander.newest)
        return taken

    def request(self) -> bool:
        """Ask for the wheel, or hold it for another time-out, without a command: the robot stands until a command
        comes.

        Returns whether it has the wheel now. A source that was overruled may ask again when the other has let go.
        """
        wheel = self._wheel
        now, before = wheel.runtime.now, wheel.driver.name
        granted = wheel.commander.request(self.name, now)
        if granted and before not in ("", self.name):
            # in place of the other source's command
            wheel.send(0.0, 0.0, now)
        return granted

    def release(self) -> None:
        """Command zero once, and let go of the wheel, as when a dead-man's handle is released."""
        now = self._wheel.runtime.now
        if self._wheel.commander.release(self.name, now):
            self._wheel.send(0.0, 0.0, now)

    def begin(self) -> None:
        """Ask for the wheel; raises Overruled: another source keeps it."""
        if not self.request():
            raise Overruled(self.name, self.overruled)

    def insist(self, v: float, omega: float) -> None:
        """Drive, as `command` does, but hold the wheel with zeros, too.

        Raises NotArmed: the safety gate is closed; Overruled: another source has taken the wheel since this source
        asked for it; CommandRefused: a value is not finite.
        """
        gate = self._wheel.runtime.gate
        if not gate.armed:
            raise NotArmed(gate.reason)
        if self.overruled or not self.request():
            raise Overruled(self.name, self.overruled)
        self.command(v, omega)


def finite(message: str, **values: float) -> list[float]:
    """Convert values of any kind of number to floats; raises CommandRefused, which names the first not finite."""
    return [number(f"{message}: {name}", value) for name, value in values.items()]


def number(name: str, value: float) -> float:
    """Convert a value of any kind of number to a float; raises CommandRefused, with the name, if it is not finite."""
    try:
        if isfinite(value):
            return float(value)
        told = repr(value)
    except TypeError:
        told = repr(value)[:80]
    except OverflowError:
        told = f"an integer of {value.bit_length()} bits"  # type: ignore[attr-defined]
    raise CommandRefused(f"{name} must be a finite number, not {told}")
