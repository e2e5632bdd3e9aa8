"""Guards of the safety gate: what one may know of its robot, and what becomes of one that fails."""

import asyncio
from collections.abc import Callable
from math import isfinite
from typing import Any, Final, NamedTuple

from txt1.commands import UNGUARDED
from txt1.control.limits import Guard
from txt1.errors import TaskFault, Txt1Error

Pose = tuple[float, float, float]


class GuardFault(TaskFault):
    """A guard of the safety gate failed; the robot was stopped."""

    exit_code: Final = UNGUARDED

    def __init__(self, guard: str, why: str) -> None:
        Txt1Error.__init__(self, f"guard '{guard}' failed: {why}; the robot was stopped")
        self.task = f"guard {guard}"


class GuardView:
    """A robot as a guard sees it: present values, at any time from `prepare` on.

    Every value is read and none can be set, but for `holds`.
    """

    def __init__(self, runtime: Any) -> None:
        self._runtime = runtime

    @property
    def pose(self) -> Pose:
        """x, y (m) and theta (rad) in the frame of the odometry: by the filter if there is one, else by the wheels."""
        now = self._runtime.estimate() or self._runtime.state.odometry
        return now.x, now.y, now.theta

    @property
    def velocity(self) -> tuple[float, float]:
        """V (m/s) and omega (rad/s) as measured: by the filter if there is one, else by the wheels."""
        now = self._runtime.estimate() or self._runtime.state.odometry
        return now.v, now.omega

    @property
    def armed(self) -> bool:
        """Whether the safety gate is open."""
        return bool(self._runtime.gate.armed)

    @property
    def size(self) -> tuple[float, float, float]:
        """Length and width of the body, and how far its centre is ahead of the pose, m."""
        geometry = self._runtime.config.geometry
        return geometry.length, geometry.width, geometry.centre

    def reading(self, sensor: str, within: float) -> Any:
        """Return the newest reading of a sensor, by its configured name; None if it is older than `within` s.

        None also stands for a sensor that has no reading yet. Raises KeyError: there is no sensor of this name.
        """
        last = self._runtime.sensors[sensor].last
        return None if last is None or self._runtime.now - last.time > within else last

    @property
    def holds(self) -> bool:
        """Whether the guard holds the robot before something that it sees; the same hold may then drive on later.

        Without it a hold that a guard stops for more than 0.5 s is over, and the holder has to let go and ask again.
        """
        return bool(self._runtime.gate.limited)

    @holds.setter
    def holds(self, value: bool) -> None:
        self._runtime.gate.limited = value


def contained(
    name: str, guard: Guard, tell: Callable[[float, str], None], ends: Callable[[str], None] = lambda why: None
) -> Guard:
    """Return the guard; once it raises, or returns anything but two finite numbers, it allows only 0.

    `tell` then adds a line to the event log, once, and `ends` gets the reason.
    """
    failed = False

    def guarded(v: float, omega: float, now: float) -> tuple[float, float]:
        nonlocal failed
        if failed:
            return 0.0, 0.0
        try:
            answer = guard(v, omega, now)
            try:
                slower, turning = answer
                if isfinite(slower) and isfinite(turning):
                    return float(slower), float(turning)
            except (TypeError, ValueError, OverflowError):
                pass
            why = f"it returned {answer!r}"
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
        failed = True
        why = " ".join(why.split())
        tell(now, f"guard '{name}' failed: {why}; the robot stands for the rest of the run")
        ends(why)
        return 0.0, 0.0

    return guarded


class GuardWatch(NamedTuple):
    """The part of a runtime with guards whose future gets the error of the first guard that fails."""

    fault: asyncio.Future[None]


def add(runtime: Any, name: str, guard: Guard) -> None:
    """Add a guard to the safety gate of a runtime, and a `GuardWatch` to its parts."""
    watch = runtime.part(GuardWatch)
    if watch is None:
        watch = GuardWatch(asyncio.get_running_loop().create_future())
        runtime.parts.append(watch)

    def ends(why: str) -> None:
        if not watch.fault.done():
            watch.fault.set_exception(GuardFault(name, why))
            # seen: the event log tells it, too
            watch.fault.exception()

    runtime.gate.guards.append(contained(name, guard, runtime.state.tell, ends))
