"""The time: the only place in the package that asks for it.

Times are integers in nanoseconds, so a deadline ``t0 + k * period`` is exact for every k. A clock starts at an
origin of its own; only differences mean something.
"""

import sys
import time
from collections.abc import Callable
from typing import Final, Protocol

NS_PER_S: Final = 1_000_000_000
# how late a cycle of a simulation may be before simulated time waits for it: less than the controller's period
HOLD_NS: Final = 19_000_000

stopwatch_ns: Final = time.perf_counter_ns
"""Elapsed real time in ns: how long a step took, whatever clock the tasks run on."""

# in a browser there is no such clock
processor_ns: Final = getattr(time, "thread_time_ns", time.perf_counter_ns)
"""Processor time of the calling thread in ns: without the time in which it waited, or other programs ran."""


def process_time(process: int) -> float | None:
    """Processor time in s that a process has used, all its threads together; None where the system cannot tell."""
    if sys.platform != "linux":
        return None
    try:
        # the number of a process's clock, as the C library's clock_getcpuclockid makes it
        return time.clock_gettime(~process << 3 | 2)
    except OSError:
        # the process has ended
        return None


# the time of day, in ns since 1970; only for records, as no duration is measured with it
wall_ns: Final = time.time_ns


def seconds(ns: int) -> float:
    """Seconds from nanoseconds."""
    return ns / NS_PER_S


def nanoseconds(s: float) -> int:
    """Whole nanoseconds, to nearest, from seconds."""
    return round(s * NS_PER_S)


class Clock(Protocol):
    """A source of monotonic time."""

    def now_ns(self) -> int:
        """The time, in ns since this clock's origin. Never goes backwards."""

    def suspended_ns(self) -> int:
        """Time in ns for which the computer was suspended, which `now_ns` leaves out; exact to 1 ms."""


class RealClock:
    """The processor's monotonic clock."""

    def now_ns(self) -> int:
        """The time, in ns since an instant of the processor's choice."""
        return time.monotonic_ns()

    def suspended_ns(self) -> int:
        """Time in ns for which the computer was suspended since its start; 0 without a clock for it."""
        # Linux's; a browser has its name alone
        if not hasattr(time, "CLOCK_BOOTTIME") or sys.platform == "emscripten":
            return 0
        while True:
            before = time.monotonic_ns()
            boot = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
            # otherwise another program ran between the two readings
            if time.monotonic_ns() - before < NS_PER_S // 1000:
                return boot - before


class SimulationClock(RealClock):
    """The processor's monotonic clock, which stands still for a simulation that the computer cannot keep up with.

    Each scheduler on this clock has a function that returns the time at which its next cycle is due. If all of them
    drive simulations, the time does not pass beyond `HOLD_NS` after the earliest of these: so a busy computer makes
    simulated time slower, and no cycle of a simulation is missed in it. One scheduler that drives hardware is enough,
    and the clock is the processor's: what happens outside this process waits for nobody.
    """

    def __init__(self) -> None:
        self.held_ns = 0
        """Time in ns for which it has stood still."""
        self._simulations: list[Callable[[], int]] = []
        # the number of schedulers that drive hardware
        self._others = 0

    def join(self, due: Callable[[], int] | None) -> None:
        """Add a scheduler, which runs until it leaves; `due` is None for one that drives hardware."""
        if due is None:
            self._others += 1
        else:
            self._simulations.append(due)

    def leave(self, due: Callable[[], int] | None) -> None:
        """Remove a scheduler."""
        if due is None:
            self._others -= 1
        else:
            self._simulations.remove(due)

    def now_ns(self) -> int:
        """The time, in ns since an instant of the processor's choice, without the time for which it stood still."""
        now = time.monotonic_ns() - self.held_ns
        if self._simulations and not self._others:
            latest = min(due() for due in self._simulations) + HOLD_NS
            if now > latest:
                self.held_ns += now - latest
                return latest
        return now


class VirtualClock:
    """A clock that stands still until it is moved.

    The virtual-time event loop moves it to the next timer. A test moves it with `spend` inside a task's step, to make
    the step take that long.
    """

    def __init__(self) -> None:
        self.ns = 0
        """The virtual time in ns; to be read only."""

    def now_ns(self) -> int:
        """The virtual time in ns."""
        return self.ns

    def suspended_ns(self) -> int:
        """0: a simulation sleeps with the computer."""
        return 0

    def advance_to(self, ns: int) -> None:
        """Move forward to an instant in ns.

        Raises ValueError: the instant lies in the past; time cannot go backwards.
        """
        if ns < self.ns:
            raise ValueError(f"time cannot go backwards: it is {self.ns} ns, asked for {ns} ns")
        self.ns = ns

    def spend(self, duration: float) -> None:
        """Let `duration` seconds pass at once, as in a step that computes for this long."""
        self.advance_to(self.ns + nanoseconds(duration))
