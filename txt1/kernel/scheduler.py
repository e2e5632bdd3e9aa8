"""Periodic coroutine tasks by priority, run as in an RTOS.

A task is a coroutine with a loop over its ticks::

    async def blink(ticks: Ticks, led: Led) -> None:
        async for now in ticks:
            led.toggle()

    scheduler.add("blink", priority=1, period=0.5, task=partial(blink, led=led))

Cycle k of a periodic task is due at ``t0 + k * period`` and owns the slot until the next one is due. A cycle that
could not start within its slot is missed: counted, and never run later. Tasks that are ready together run in order of
priority, and among equals in the order they were added.

How it works
------------

*One queue.* One heap drives the coroutines; they are not asyncio tasks. The scheduler sends a coroutine the time, and
the coroutine runs up to its next tick. That costs a tenth of the time of asyncio tasks, and it makes the order exact.
The price: between two ticks a task cannot await anything else. Code that waits belongs in a coroutine of its own.

*A place in the queue* is one integer: the due time in ns, shifted to the left, and the task's index in its lowest bits.
Indices follow the priorities. So the smallest number is due first, and is the most urgent of all that are due then.

*A dispatch* runs all that is due, and then asks the event loop to call again at the next due time. There are two
ways to run a cycle:

- `_run_late` is the plain way. It takes all tasks that are due, the most urgent first. It counts the cycles that a task
  missed, and how late it is. In real time it runs every cycle, as no cycle is in time to the ns. After one cycle of
  each task the event loop has its turn: signals, input, other coroutines.
- `_run_punctual` is for virtual time, where time stands still while a task runs. So no cycle is late or missed, and the
  order of the heap is already the order in which to run. It runs the cycles off the heap, one after the other. At the
  end of an instant it asks `txt1.kernel.jumps` to move the clock to the next instant. If the clock moves, it goes on
  there, without a turn of the event loop in between. Without this a simulation loses more than a third of its speed.

*When `_run_punctual` stops.* A task may do anything: end the run, add a task, make another task due, let time pass.
Each of these either moves the clock, empties the queue, or sets `_later` to 0, and all three are checked after each
cycle. It also stops if something else is due first on the event loop, and after PUNCTUAL_MAX cycles.

*In real time* a sleeping thread wakes up late. So the timer is set early by a margin, and a busy loop waits for the
rest. The margin follows the machine: it grows after a missed deadline, and shrinks otherwise.

*A simulation on a busy computer.* With `waits` the clock stands still while the next cycle is more than
`txt1.kernel.clock.HOLD_NS` late (`txt1.kernel.clock.SimulationClock`). So simulated time becomes slower, and its tasks
see no gap. Cycles that the wall clock passed over are counted as missed all the same.

*A fault* ends the run. `on_fault` makes the robot safe before anything else runs, and the error travels in `ended`.
"""

import asyncio
from collections.abc import Callable, Coroutine
from heapq import heapify, heappop, heappush, heapreplace
from typing import Any, Final

from mypy_extensions import mypyc_attr

from txt1.errors import TaskFault
from txt1.kernel.clock import NS_PER_S, SimulationClock, nanoseconds, stopwatch_ns
from txt1.kernel.jumps import Jumps
from txt1.kernel.loop import VirtualTimeLoop, clock_of
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import NEXT_TICK, Ticks

NEVER: Final = 1 << 61
NS_PER_MS: Final = 1_000_000
MARGIN_MIN_NS: Final = 20_000
MARGIN_START_NS: Final = 100_000
MARGIN_MAX_NS: Final = 250_000
# more than the difference between two clocks read in sequence
SLEPT_MIN_NS: Final = 10 * NS_PER_MS

# a place in the queue is one number, due time in ns << TASKS_BITS | the task's index: quicker to compare than a tuple
TASKS_BITS: Final = 10
TASKS_MAX: Final = 1 << TASKS_BITS
INDEX: Final = TASKS_MAX - 1

# cycles run at a stretch in virtual time: tasks that wake one another without end must leave the loop its turn
PUNCTUAL_MAX: Final = 1000
# bits of a cycle's number: all 0 in the one cycle of eight that is measured in jumping virtual time, as to read the
# clock each time costs a twentieth
UNMEASURED_BITS: Final = 7

PeriodicTask = Callable[[Ticks], Coroutine[Any, Any, None]]
TaskRow = tuple[str, int, float | None, PeriodicTask]
"""A task in a list of tasks: its name, its priority, its period in s (None: on arrival), and the coroutine function."""


class _Scheduled:
    """A task under the scheduler."""

    __slots__ = (
        "coroutine",
        "index",
        "name",
        "period",
        "period_ns",
        "priority",
        "queued",
        "send",
        "statistics",
        "ticks",
    )

    def __init__(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> None:
        self.name = name
        self.priority = priority
        self.index = 0
        # 0: on arrival
        self.period_ns = 0 if period is None else nanoseconds(period)
        # from one place in the queue to the next
        self.period = self.period_ns << TASKS_BITS
        self.ticks = Ticks(period)
        self.coroutine = task(self.ticks)
        self.send: Callable[[Any], Any] = (
            self._send_watched if self.ticks.begins or self.ticks.ends else self.coroutine.send
        )
        self.queued = False
        self.statistics = TaskStatistics()

    def _send_watched(self, now: float | None) -> Any:
        """Run the coroutine up to its next tick, and tell the cycle's begin and end."""
        if self.ticks.begins is not None and now is not None:
            self.ticks.begins(now)
        waited_for = self.coroutine.send(now)
        if self.ticks.ends is not None:
            self.ticks.ends()
        return waited_for


@mypyc_attr(allow_interpreted_subclasses=True)
class Scheduler:
    """Runs tasks at their deadlines on the running event loop's clock.

    Args:
        on_fault: called at once, before anything else runs, with the name of a failed task and its exception; it
            makes the robot safe.

    """

    def __init__(self, on_fault: Callable[[str, BaseException], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._clock = clock_of(self._loop)
        virtual = self._loop if isinstance(self._loop, VirtualTimeLoop) else None
        self._virtual_clock = None if virtual is None else virtual.clock
        self._jumps = None if virtual is None else virtual.jumps
        self._number = 0 if self._jumps is None else self._jumps.enter()
        self._on_fault = on_fault
        self._entries: list[_Scheduled] = []
        # by priority, then in the order of adding: an entry's index is its place in this list
        self._ranked: list[_Scheduled] = []
        # heap by due time, then index; a task that runs on arrival is due at once
        self._waiting: list[int] = []
        self._origin_ns = self._clock.now_ns()
        self._started_ns = stopwatch_ns()
        self._stop_ns = NEVER
        self._margin_ns = MARGIN_START_NS
        self._timer: asyncio.Handle | None = None
        self._running = False
        self._dispatching = False
        # places in the queue from here on are due after the present instant; 0: look anew, and first
        self._later = 0
        self._suspended_ns = self._clock.suspended_ns()
        self.waits = False
        """Whether all that it drives is simulated in this process, so time may wait for a late cycle; set before the
        start.
        """
        # the clock that it has joined, its function there, and the time that the clock had waited at the last look
        self._joined: SimulationClock | None = None
        self._due: Callable[[], int] | None = None
        self._held_ns = 0
        self.on_sleep: Callable[[float], None] = lambda slept: None
        """Called with the time of a suspension, s, before any task runs after it; in real time only."""
        self.ended: asyncio.Future[None] = self._loop.create_future()
        """Done when the run reaches its end; holds the TaskFault if a task raised."""

    # -- the tasks ---------------------------------------------------------------------------------------------

    def add(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task: its cycles are due at whole multiples of `period` seconds since the start.

        Raises ValueError: the name is taken, the period is not positive, or there are TASKS_MAX tasks already.
        """
        if not NS_PER_S * period >= 1.0 or period == float("inf"):
            raise ValueError(f"task '{name}': period must be positive, at least 1 ns, not {period!r} s")
        entry = self._add(name, priority, period, task)
        # Added in mid-run, a task starts with the next whole multiple of its period.
        due_ns = -(-self._elapsed_ns() // entry.period_ns) * entry.period_ns if self._running else 0
        heappush(self._waiting, due_ns << TASKS_BITS | entry.index)
        self._wake()

    def add_sporadic(self, name: str, priority: int, task: PeriodicTask) -> Callable[[], None]:
        """Add a task that runs on arrival; the function returned makes it due now.

        Arrivals before it has run are one tick: the task takes all that has come.

        Raises ValueError: the name is taken, or there are TASKS_MAX tasks already.
        """
        entry = self._add(name, priority, None, task)

        def notify() -> None:
            if not entry.queued:
                entry.queued = True
                # the clock starts anew
                due_ns = self._elapsed_ns() if self._running else 0
                heappush(self._waiting, due_ns << TASKS_BITS | entry.index)
                self._wake()

        return notify

    def _add(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> _Scheduled:
        if any(entry.name == name for entry in self._entries):
            raise ValueError(f"there is a task '{name}' already")
        if len(self._entries) == TASKS_MAX:
            raise ValueError(f"task '{name}': there are {TASKS_MAX} tasks already, and no room for more")
        entry = _Scheduled(name, priority, period, task)
        if self.ended.done():
            # it came too late to be closed by `stop`, and never runs
            entry.coroutine.close()
        self._entries.append(entry)
        self._rank(entry)
        if self._running:
            self._prime(entry)
        return entry

    def _rank(self, entry: _Scheduled) -> None:
        """Give a new task its index; tasks of lower priority move up by 1, also in the queue."""
        index = sum(one.priority >= entry.priority for one in self._ranked)
        self._ranked.insert(index, entry)
        for k in range(index, len(self._ranked)):
            self._ranked[k].index = k
        # order stays
        self._waiting[:] = [place + 1 if place & INDEX >= index else place for place in self._waiting]

    def statistics(self) -> dict[str, TaskStatistics]:
        """The statistics of every task so far, by name, in the order they were added."""
        return {entry.name: entry.statistics for entry in self._entries}

    @property
    def steps(self) -> int:
        """Number of cycles of all tasks so far, including the present: it gives each event a place among them."""
        return sum([entry.statistics.cycles for entry in self._entries])

    # -- the run -----------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self._elapsed_ns() / NS_PER_S

    @property
    def wall_time(self) -> float:
        """Seconds of real time since the run started, whatever clock it runs on."""
        return (stopwatch_ns() - self._started_ns) / NS_PER_S

    def start(self) -> None:
        """Start the clock at 0 and run every task up to its first tick."""
        self._origin_ns = self._clock.now_ns()
        self._started_ns = stopwatch_ns()
        self._running = True
        self._join()
        # tasks that this task adds before its first tick are started as they are added
        for entry in self._entries.copy():
            # not after a fault
            if self._running:
                self._prime(entry)
        self._wake()

    def end_at(self, time: float) -> None:
        """Let `ended` be done at `time` seconds; a cycle due at exactly this time does not run any more."""
        self._stop_ns = nanoseconds(time)
        self._later = 0
        self._wake()

    def stop(self) -> None:
        """Run nothing more and close every task: its ``finally`` clauses run now.

        Raises TaskFault: one of these clauses raised; the others have run nevertheless.
        """
        self._running, self._later = False, 0
        self._leave()
        self._cancel()
        fault: TaskFault | None = None
        for entry in self._entries:
            try:
                entry.coroutine.close()
            except Exception as error:
                self._on_fault(entry.name, error)
                fault = fault or _task_fault(entry, error)
        if fault is not None:
            if not self.ended.done():
                self.ended.set_exception(fault)
            raise fault
        if not self.ended.done():
            self.ended.set_result(None)

    @property
    def held(self) -> float:
        """Seconds for which simulated time waited for this computer so far."""
        clock = self._clock
        return clock.held_ns / NS_PER_S if isinstance(clock, SimulationClock) else 0.0

    def _join(self) -> None:
        """Let the clock know whether it may wait for this scheduler."""
        clock = self._clock
        if isinstance(clock, SimulationClock):
            self._joined, self._held_ns = clock, clock.held_ns
            self._due = self._next_cycle_ns if self.waits else None
            clock.join(self._due)

    def _leave(self) -> None:
        if self._joined is not None:
            self._joined.leave(self._due)
            self._joined = None

    def _next_cycle_ns(self) -> int:
        """Return the clock's time at which the next cycle is due; NEVER if none is."""
        return self._origin_ns + (self._waiting[0] >> TASKS_BITS) if self._waiting else NEVER

    def _count_held(self, now_ns: int) -> int:
        """Count the cycles that were due while the clock waited, and return for how many ns it did, since the last
        call.
        """
        clock = self._joined
        if clock is None or clock.held_ns == self._held_ns:
            return 0
        held_ns, self._held_ns = clock.held_ns - self._held_ns, clock.held_ns
        for place in self._waiting:
            entry, late_ns = self._ranked[place & INDEX], now_ns - (place >> TASKS_BITS)
            if entry.period_ns and late_ns + held_ns > 0:
                # those that are late on this clock, too, are counted as they run
                seen = max(0, late_ns) // entry.period_ns
                entry.statistics.misses += (late_ns + held_ns) // entry.period_ns - seen
        return held_ns

    def _elapsed_ns(self) -> int:
        # an attribute, which is read without a call
        virtual = self._virtual_clock
        return (self._clock.now_ns() if virtual is None else virtual.ns) - self._origin_ns

    def _prime(self, entry: _Scheduled) -> None:
        try:
            if entry.send(None) is not NEXT_TICK:
                self._waited(entry)
        except BaseException as error:
            self._raised(entry, error)

    def _wake(self) -> None:
        """Make sure that the next due task is dispatched in time."""
        if self._running and not self._dispatching:
            self._cancel()
            self._timer = self._loop.call_soon(self._dispatch)

    def _cancel(self) -> None:
        """Cancel the call of the dispatch."""
        if self._timer is not None:
            self._timer.cancel()
        if self._jumps is not None:
            self._jumps.forget(self._number)

    def _dispatch(self) -> None:
        """Run everything that is due, then set the timer for the next due time."""
        jumps, origin_ns = self._jumps, self._origin_ns
        if jumps is None:
            self._spin_to_next_deadline()
            slept_ns = self._clock.suspended_ns() - self._suspended_ns
            # a simulated world slept, too
            if slept_ns > SLEPT_MIN_NS and not self.waits:
                self._suspended_ns += slept_ns
                self.on_sleep(slept_ns / NS_PER_S)
        self._dispatching = True
        late_cycles, due_ns = 0, NEVER
        try:
            while self._running:
                now_ns = self._elapsed_ns()
                if now_ns >= self._stop_ns:
                    self._end()
                    return
                due_ns = self._next_due_ns()
                if due_ns < now_ns or (jumps is None and due_ns == now_ns):
                    # signals, input and coroutines get a turn
                    if late_cycles > len(self._entries):
                        self._timer = self._loop.call_soon(self._dispatch)
                        return
                    late_cycles += 1
                    self._run_late(now_ns)
                elif jumps is not None and due_ns < self._stop_ns and jumps.reach(due_ns + origin_ns):
                    late_cycles = 0
                    if self._run_punctual(due_ns, jumps):
                        self._timer = self._loop.call_soon(self._dispatch)
                        return
                else:
                    break
        finally:
            self._dispatching = False
        if self._running:
            self._set_timer(due_ns)

    def _run_punctual(self, due_ns: int, jumps: Jumps) -> bool:
        """Run all that is due at an instant that virtual time has just reached, and at the instants that it jumps to.

        It stops before a late cycle and before the end of the run. It returns True if tasks wake one another without
        end and the event loop must have a turn. No cycle is late, so the queue's own order is that of the priorities.
        """
        waiting, ranked, origin_ns = self._waiting, self._ranked, self._origin_ns
        clock, timers = jumps.clock, jumps.timers
        # looked up once instead of in every cycle
        replace, time_ns, next_tick = heapreplace, stopwatch_ns, NEXT_TICK
        now, now_ns = due_ns / NS_PER_S, due_ns + origin_ns
        self._later = due_ns + 1 << TASKS_BITS
        place = waiting[0]
        for _ in range(PUNCTUAL_MAX):
            entry = ranked[place & INDEX]
            if entry.period:
                replace(waiting, place + entry.period)
            else:
                entry.queued = False
                heappop(waiting)
            statistics = entry.statistics
            cycles = statistics.cycles
            statistics.cycles = cycles + 1
            started_ns = 0 if cycles & UNMEASURED_BITS else time_ns()
            try:
                if entry.send(now) is not next_tick:
                    self._waited(entry)
            except BaseException as error:
                # CancelledError too: asyncio would only log it
                self._raised(entry, error)
            if started_ns:
                statistics.run_time.add(time_ns() - started_ns)
            if not waiting or clock.ns != now_ns:
                return False
            place = waiting[0]
            if place >= self._later:
                due_ns = place >> TASKS_BITS
                if not self._later or due_ns >= self._stop_ns or not jumps.to(due_ns + origin_ns, timers):
                    return False
                now, now_ns = due_ns / NS_PER_S, due_ns + origin_ns
                self._later = due_ns + 1 << TASKS_BITS
        return True

    def _run_late(self, now_ns: int) -> None:
        """Run the due cycle of highest priority; count the cycles it has missed and how late it is."""
        place = min((place for place in self._waiting if place >> TASKS_BITS <= now_ns), key=INDEX.__and__)
        entry = self._ranked[place & INDEX]
        late_ns = now_ns - (place >> TASKS_BITS)
        held_ns = self._count_held(now_ns)
        self._waiting.remove(place)
        if entry.period_ns:
            missed, late_ns = divmod(late_ns, entry.period_ns)
            entry.ticks.missed = missed
            entry.statistics.misses += missed
            self._waiting.append(place + (missed + 1) * entry.period)
        entry.queued = False
        heapify(self._waiting)
        entry.statistics.cycles += 1
        started_ns = stopwatch_ns()
        try:
            if entry.send(now_ns / NS_PER_S) is not NEXT_TICK:
                self._waited(entry)
        except BaseException as error:
            # as above
            self._raised(entry, error)
        entry.statistics.run_time.add(stopwatch_ns() - started_ns)
        # on the wall clock, as the misses are
        entry.statistics.add_lateness((late_ns + held_ns) % entry.period_ns if entry.period_ns else late_ns + held_ns)
        # as for a cycle in time
        entry.ticks.missed = 0

    def _waited(self, entry: _Scheduled) -> None:
        entry.coroutine.close()
        raise RuntimeError(
            "it awaited something other than its next tick; a step must not wait, "
            "so start what waits as a coroutine of its own"
        )

    def _raised(self, entry: _Scheduled, error: BaseException) -> None:
        """Make the robot safe, stop every task, and pass the error on."""
        self._running, self._later = False, 0
        self._leave()
        interrupted = isinstance(error, KeyboardInterrupt | SystemExit)
        if isinstance(error, StopIteration):
            error = RuntimeError("its loop over the ticks came to an end")
        if not interrupted and not self.ended.done():
            self.ended.set_exception(_task_fault(entry, error))
            # seen: `on_fault` tells it, and asyncio need not, where nobody waits for the end
            self.ended.exception()
        self._on_fault(entry.name, error)
        if interrupted:
            raise error

    def _end(self) -> None:
        self._running = False
        self._leave()
        for place in self._waiting:
            entry, passed_ns = self._ranked[place & INDEX], self._stop_ns - (place >> TASKS_BITS)
            # slots that passed while a step ran late
            if entry.period_ns and passed_ns > 0:
                entry.statistics.misses += passed_ns // entry.period_ns
        if not self.ended.done():
            self.ended.set_result(None)

    def _next_due_ns(self) -> int:
        """Return the next due time, in ns since the start; NEVER if there is none."""
        due_ns = self._waiting[0] >> TASKS_BITS if self._waiting else NEVER
        return due_ns if due_ns < self._stop_ns else self._stop_ns

    def _set_timer(self, due_ns: int) -> None:
        """Make sure that the next due task, at `due_ns` since the start, is dispatched in time."""
        due_ns += self._origin_ns
        self._timer = None
        if due_ns < NEVER:
            if self._jumps is not None:
                self._jumps.call_at(due_ns, self._number, self._dispatch)
            else:
                # the event loop's timers are on the processor's clock, which waits for nothing
                held_ns = 0 if self._joined is None else self._joined.held_ns
                self._timer = self._loop.call_at((due_ns + held_ns - self._margin_ns) / NS_PER_S, self._dispatch)

    def _spin_to_next_deadline(self) -> None:
        """Wait for the margin by which the timer was set early, and learn how large it has to be.

        A sleeping thread wakes up late, by a time that differs from machine to machine. The margin grows after a
        deadline that had already passed, and shrinks otherwise. So it settles where nine wake-ups of ten are in time.
        """
        if self._waiting and not self._ranked[self._waiting[0] & INDEX].period_ns:
            # a task on arrival is due: it has no deadline, so there is nothing to learn
            return
        now_ns = self._clock.now_ns
        ahead_ns = self._next_due_ns() + self._origin_ns - now_ns()
        if not 0 < ahead_ns <= self._margin_ns:
            if -NS_PER_MS < ahead_ns <= 0:
                self._margin_ns = min(int(self._margin_ns * 1.09), MARGIN_MAX_NS)
            return
        self._margin_ns = max(int(self._margin_ns * 0.99), MARGIN_MIN_NS)
        deadline_ns = now_ns() + ahead_ns
        while now_ns() < deadline_ns:
            pass


def _task_fault(entry: _Scheduled, error: BaseException) -> TaskFault:
    fault = TaskFault(entry.name, error)
    fault.__cause__ = error
    return fault
