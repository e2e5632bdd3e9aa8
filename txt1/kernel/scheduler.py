"""Periodic coroutine tasks by priority, the way an RTOS runs them.

A task is a coroutine with a loop over its ticks::

    async def blink(ticks: Ticks, led: Led) -> None:
        async for now in ticks:
            led.toggle()

    scheduler.add("blink", priority=1, period=0.5, task=partial(blink, led=led))

Cycle k of a periodic task is due at ``t0 + k * period`` and owns the slot until the next one is due. A cycle that
could not start within its slot is missed: counted, and never run later. Tasks that are ready together run in order of
priority, and among equals in the order they were added.

The coroutines are driven from one heap instead of being asyncio tasks: that costs a tenth, and makes the order exact.
The price is that between two ticks a task can await nothing else; what waits belongs in a coroutine of its own.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from heapq import heappop, heappush, heapreplace
from typing import Any, Final

from mypy_extensions import mypyc_attr

from txt1.errors import TaskFault
from txt1.kernel.clock import NS_PER_S, nanoseconds, stopwatch_ns
from txt1.kernel.loop import VirtualTimeLoop, clock_of
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import NEXT_TICK, Ticks

NEVER: Final = 1 << 61
NS_PER_MS: Final = 1_000_000
MARGIN_MIN_NS: Final = 20_000
MARGIN_START_NS: Final = 100_000
MARGIN_MAX_NS: Final = 250_000

TASKS_BITS: Final = 10
"""A place in the queue is one number, due time in ns << TASKS_BITS | the task's index: compared sooner than a tuple."""
TASKS_MAX: Final = 1 << TASKS_BITS
INDEX: Final = TASKS_MAX - 1

PUNCTUAL_MAX: Final = 1000
"""Cycles run at a stretch in virtual time: tasks that wake one another for ever must leave the loop its turn."""

PeriodicTask = Callable[[Ticks], Coroutine[Any, Any, None]]


class _Entry:
    """A task under the scheduler."""

    __slots__ = (
        "coroutine", "due_ns", "index", "name", "period_ns", "priority", "queued", "run_time", "send", "statistics",
        "ticks",
    )  # fmt: skip

    def __init__(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> None:
        self.name = name
        self.priority = priority
        self.index = 0
        self.period_ns = 0 if period is None else nanoseconds(period)  # 0: on arrival
        self.ticks = Ticks(period)
        self.coroutine = task(self.ticks)
        self.send: Callable[[Any], Any] = self.coroutine.send
        self.due_ns = 0
        self.queued = False
        self.statistics = TaskStatistics()
        self.run_time = self.statistics.run_time


@mypyc_attr(allow_interpreted_subclasses=True)
class Scheduler:
    """Runs tasks at their deadlines on the running event loop's clock.

    Args:
        on_fault: called at once, before anything else runs, with the name of a task that raised and the exception;
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
        self._entries: list[_Entry] = []
        self._ranked: list[_Entry] = []  # by priority, then in the order they were added: an entry's index is in here
        self._waiting: list[int] = []  # heap by due time, then index; what has arrived is due at once
        self._ready: list[int] = []  # heap of indices: who is due, when somebody is late
        self._origin_ns = self._clock.now_ns()
        self._started_ns = stopwatch_ns()
        self._stop_ns = NEVER
        self._margin_ns = MARGIN_START_NS
        self._timer: asyncio.Handle | None = None
        self._running = False
        self._dispatching = False
        self.steps = 0
        """Cycles of all tasks so far, the present one included: with it, what happens has a place among them."""
        self.ended: asyncio.Future[None] = self._loop.create_future()
        """Done when the run reaches its end; holds the TaskFault when a task raised."""

    # -- the tasks ---------------------------------------------------------------------------------------------

    def add(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task: its cycles are due at whole multiples of `period` seconds since the start.

        Raises:
            ValueError: the name is taken, the period is not positive, or there are TASKS_MAX tasks already.

        """
        if not NS_PER_S * period >= 1.0 or period == float("inf"):
            raise ValueError(f"task '{name}': period must be positive, at least 1 ns, not {period!r} s")
        entry = self._add(name, priority, period, task)
        # Added in mid-run, a task starts with the next whole multiple of its period.
        entry.due_ns = -(-self._elapsed_ns() // entry.period_ns) * entry.period_ns if self._running else 0
        heappush(self._waiting, entry.due_ns << TASKS_BITS | entry.index)
        self._wake()

    def add_sporadic(self, name: str, priority: int, task: PeriodicTask) -> Callable[[], None]:
        """Add a task that runs on arrival; the function returned makes it due now.

        Arrivals before it has run are one tick: the task drains whatever has come.

        Raises:
            ValueError: the name is taken, or there are TASKS_MAX tasks already.

        """
        entry = self._add(name, priority, None, task)

        def notify() -> None:
            if not entry.queued:
                entry.queued = True
                entry.due_ns = self._elapsed_ns() if self._running else 0  # the clock starts anew
                heappush(self._waiting, entry.due_ns << TASKS_BITS | entry.index)
                self._wake()

        return notify

    def _add(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> _Entry:
        if any(entry.name == name for entry in self._entries):
            raise ValueError(f"there is a task '{name}' already")
        if len(self._entries) == TASKS_MAX:
            raise ValueError(f"task '{name}': there are {TASKS_MAX} tasks already, and no room for more")
        entry = _Entry(name, priority, period, task)
        self._entries.append(entry)
        self._rank(entry)
        if self._running:
            self._prime(entry)
        return entry

    def _rank(self, entry: _Entry) -> None:
        """Give a new task its index; those of lower priority move up by one, also where they wait."""
        index = sum(one.priority >= entry.priority for one in self._ranked)
        self._ranked.insert(index, entry)
        for k in range(index, len(self._ranked)):
            self._ranked[k].index = k
        for queue in (self._waiting, self._ready):
            queue[:] = [place + 1 if place & INDEX >= index else place for place in queue]  # in the same order

    def statistics(self) -> dict[str, TaskStatistics]:
        """What every task has done so far, by name, in the order they were added."""
        return {entry.name: entry.statistics for entry in self._entries}

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
        for entry in self._entries.copy():  # what a task adds before its first tick is run up to it as it is added
            if self._running:  # not after a fault
                self._prime(entry)
        self._wake()

    def end_at(self, time: float) -> None:
        """Let `ended` be done at `time` seconds; a cycle due at that very instant does not run any more."""
        self._stop_ns = nanoseconds(time)
        self._wake()

    def stop(self) -> None:
        """Run nothing more and close every task: its ``finally`` clauses run now.

        Raises:
            TaskFault: one of these clauses raised; all the others have run nevertheless.

        """
        self._running = False
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

    def _elapsed_ns(self) -> int:
        virtual = self._virtual_clock  # which takes no call to read
        return (self._clock.now_ns() if virtual is None else virtual.ns) - self._origin_ns

    def _prime(self, entry: _Entry) -> None:
        try:
            if entry.send(None) is not NEXT_TICK:
                self._waited(entry)
        except BaseException as error:
            self._raised(entry, error)

    def _wake(self) -> None:
        """See to it that whatever is due next is dispatched in time."""
        if self._running and not self._dispatching:
            self._cancel()
            self._timer = self._loop.call_soon(self._dispatch)

    def _cancel(self) -> None:
        """Take back that the dispatch is called."""
        if self._timer is not None:
            self._timer.cancel()
        if self._jumps is not None:
            self._jumps.forget(self._number)

    def _dispatch(self) -> None:
        """Run everything that is due, then set the timer for what is due next."""
        waiting, ready, ranked, origin_ns = self._waiting, self._ready, self._ranked, self._origin_ns
        jumps, clock = self._jumps, self._virtual_clock
        replace, time_ns, next_tick = heapreplace, stopwatch_ns, NEXT_TICK  # found once instead of in every cycle
        if jumps is None:
            self._spin_to_next_deadline()
        self._dispatching = True
        cycles = 0  # in this turn of the loop, or since virtual time has moved
        try:
            while self._running:
                now_ns = (self._clock.now_ns() if clock is None else clock.ns) - origin_ns
                if now_ns >= self._stop_ns:
                    self._end()
                    return
                due_ns = waiting[0] >> TASKS_BITS if waiting else NEVER
                late = due_ns < now_ns or len(ready) > 0
                if cycles > PUNCTUAL_MAX or (late and cycles > len(ranked)):
                    self._timer = self._loop.call_soon(self._dispatch)  # signals, input and coroutines have a turn
                    return
                cycles += 1
                if late:
                    while waiting and waiting[0] >> TASKS_BITS <= now_ns:
                        heappush(ready, heappop(waiting) & INDEX)
                    entry = ranked[heappop(ready)]
                    late_ns = self._take_late(entry, now_ns)
                else:
                    if due_ns > now_ns:
                        if jumps is None or due_ns >= self._stop_ns or not jumps.to(due_ns + origin_ns):
                            break
                        now_ns = due_ns
                        cycles = 0
                    entry = ranked[waiting[0] & INDEX]  # the heap's own order is that of the priorities
                    if entry.period_ns:
                        entry.due_ns = due_ns = due_ns + entry.period_ns
                        replace(waiting, due_ns << TASKS_BITS | entry.index)
                    else:
                        entry.queued = False
                        heappop(waiting)
                self.steps += 1
                started_ns = time_ns()
                try:
                    if entry.send(now_ns / NS_PER_S) is not next_tick:
                        self._waited(entry)
                except BaseException as error:  # CancelledError too: asyncio would only log it
                    self._raised(entry, error)
                entry.run_time.add(time_ns() - started_ns)
                if late:
                    entry.statistics.add_lateness(late_ns)
                    entry.ticks.missed = 0  # as it is for a cycle in time
        finally:
            self._dispatching = False
        if self._running:
            self._set_timer()

    def _take_late(self, entry: _Entry, now_ns: int) -> int:
        """How late a task's present cycle starts, ns; counts the cycles it has missed and queues the next one."""
        late_ns = now_ns - entry.due_ns
        period_ns = entry.period_ns
        if not period_ns:
            entry.queued = False
            return late_ns
        missed = late_ns // period_ns
        entry.ticks.missed = missed
        entry.statistics.misses += missed
        entry.due_ns += (missed + 1) * period_ns
        heappush(self._waiting, entry.due_ns << TASKS_BITS | entry.index)
        return late_ns - missed * period_ns

    def _waited(self, entry: _Entry) -> None:
        entry.coroutine.close()
        raise RuntimeError(
            "it awaited something other than its next tick; a step must not wait, "
            "so start what waits as a coroutine of its own"
        )

    def _raised(self, entry: _Entry, error: BaseException) -> None:
        if isinstance(error, StopIteration):
            error = RuntimeError("its loop over the ticks came to an end")
        if isinstance(error, KeyboardInterrupt | SystemExit):
            self._running = False
            self._on_fault(entry.name, error)
            raise error
        self._fault(entry, error)

    def _fault(self, entry: _Entry, error: BaseException) -> None:
        """Make the robot safe, stop every task, and let the error travel."""
        self._running = False
        if not self.ended.done():
            self.ended.set_exception(_task_fault(entry, error))
        self._on_fault(entry.name, error)

    def _end(self) -> None:
        self._running = False
        for entry in self._entries:
            if entry.period_ns and entry.due_ns < self._stop_ns:  # slots that passed while a step ran late
                entry.statistics.misses += (self._stop_ns - entry.due_ns) // entry.period_ns
        if not self.ended.done():
            self.ended.set_result(None)

    def _next_due_ns(self) -> int:
        """When something is due next, in ns since the start; NEVER when nothing is."""
        due_ns = self._waiting[0] >> TASKS_BITS if self._waiting else NEVER
        return min(due_ns, self._stop_ns)

    def _set_timer(self) -> None:
        """See to it that what is due next is dispatched in time."""
        due_ns = self._next_due_ns() + self._origin_ns
        self._timer = None
        if due_ns < NEVER:
            if self._jumps is not None:
                self._jumps.call_at(due_ns, self._number, self._dispatch)
            else:
                self._timer = self._loop.call_at((due_ns - self._margin_ns) / NS_PER_S, self._dispatch)

    def _spin_to_next_deadline(self) -> None:
        """Wait out the margin by which the timer was set early, and learn how large it has to be.

        A sleeping thread wakes up late by an amount that differs from machine to machine. The margin grows when the
        deadline had passed already and shrinks when it had not, which settles where nine wake-ups of ten are in time.
        """
        if self._waiting and not self._ranked[self._waiting[0] & INDEX].period_ns:
            return  # something has arrived: that is no deadline, and nothing to learn from
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


def _task_fault(entry: _Entry, error: BaseException) -> TaskFault:
    fault = TaskFault(entry.name, error)
    fault.__cause__ = error
    return fault
