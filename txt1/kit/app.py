"""Starts and ends a robot or a board. It ends by itself, by its operator, or by a signal.

On every way out it is disarmed, its outputs are neutral, and its recording is complete.
"""

from __future__ import annotations

import asyncio
import json
import os
import select
import signal
import sys
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Protocol

from txt1.commands import DISARMED, FAULT, OK, SIGNALS, STDOUT, UNSTOPPED, View, say, signals_to
from txt1.config import Config
from txt1.control.limits import Fault
from txt1.driver import REFRESH
from txt1.errors import ConfigError, HalError, NotArmed, StopNotVerified, TaskFault
from txt1.hal.base import Hal
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import Speed, run
from txt1.kernel.realtime import SWEEP, realtime
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sidecar import SERVE_PRIORITY as SCREENS_PRIORITY
from txt1.sidecar import TELEMETRY_PERIOD as SCREENS_PERIOD
from txt1.tasks.fields import DRIVER, LOG
from txt1.telemetry.snapshot import plain
from txt1.telemetry.topics import Rule
from txt1.ui import tty
from txt1.ui.summary_line import SHOWN, status_line
from txt1.ui.terminal import Terminal

if TYPE_CHECKING:
    from types import FrameType

# s, shortest time between two heartbeats of the drawing process
BEAT_MIN: Final = 0.005
# s after a first signal in which further ones end nothing: a stop is verified in 3 s, and escalates
STOPPING: Final = 10
STDERR: Final = 2
# s for which a command without an operator waits for the link
LINK_PATIENCE: Final = 10.0
DISARMING: Final = (Fault.LINK, Fault.MISSED, Fault.SLEPT, Fault.RUNAWAY, Fault.ODOMETRY, Fault.BATTERY, Fault.UNMOVED)
"""Faults after which a run has the exit code of a robot that the safety gate disarmed."""


class Subject(Protocol):
    """A robot, a board or a fleet: whatever a command runs, and a signal disarms."""

    def disarm(self, reason: str, /) -> object:
        """Close the safety gate."""


class App:
    """A command that runs a robot or a board, at a speed of time (see `txt1.kernel.loop.run`)."""

    def __init__(self, speed: Speed = None) -> None:
        self.speed = speed
        self.code = OK
        # reason for which the safety gate was closed at the end
        self.reason = ""
        # s of the run, up to its end
        self.report: dict[str, Any] | None = None
        # whether the operator ended the run
        self.quit = False
        self.subject: Subject | None = None
        """Is disarmed when the run ends, or a signal ends it."""

    def run(self, work: Coroutine[Any, Any, None]) -> int:
        """Run it until it ends, a signal ends it or a callback of the event loop fails, and return the exit code.

        Raises TaskFault: a callback of the event loop failed, which asyncio alone would only log.
        """
        unexpected: list[Exception] = []

        async def main() -> None:
            loop, task = asyncio.get_running_loop(), asyncio.current_task()
            assert task is not None

            def interrupt(number: signal.Signals) -> None:
                self.code = 128 + number
                if self.subject is not None:
                    self.subject.disarm("ended by a signal")
                for each in SIGNALS:
                    loop.remove_signal_handler(each)
                    signal.signal(each, partial(_again, since=stopwatch_ns()))
                task.cancel()

            def failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
                error = context.get("exception")
                if not isinstance(error, Exception):
                    loop.default_exception_handler(context)
                elif not unexpected:
                    unexpected.append(error)
                    task.cancel()

            loop.set_exception_handler(failed)
            if is_main_thread:
                for number in SIGNALS:
                    loop.add_signal_handler(number, partial(interrupt, number))
            await work

        is_main_thread = threading.current_thread() is threading.main_thread()
        try:
            with signals_to(lambda number, _: os._exit(128 + number)) if is_main_thread else nullcontext():
                run(main(), speed=self.speed)
        except (asyncio.CancelledError, NotArmed):
            # a signal may close the gate just before the command is cancelled
            if self.code == OK and not unexpected:
                raise
        if unexpected:
            raise TaskFault("event loop", unexpected[0]) from unexpected[0]
        return self.code

    @asynccontextmanager
    async def robot(
        self,
        config: Config,
        *,
        hal: Hal | None = None,
        additions: Mapping[str, object] | None = None,
    ) -> AsyncIterator[Robot]:
        """Return a running robot, disarmed, its link not up yet; on leaving it stands and its recording is complete.

        `hal` replaces the configured hardware layer. `additions` are those of `Robot.open`, such as a recording.
        """
        through = False
        try:
            async with Robot.open(hal, config=config, arm=False, patience=0.0, additions=additions) as robot:
                self.subject = robot
                yield robot
                through = True
        except StopNotVerified as error:
            if not through and not isinstance(error.__cause__, asyncio.CancelledError):
                raise
            self.code, self.reason = UNSTOPPED, str(error)

    async def watch(
        self, runtime: Runtime, terminal: Callable[[], Terminal], view: View, *alongside: asyncio.Future[Any]
    ) -> None:
        """Let the operator watch and drive until the run or a future in `alongside` ends; its error is raised."""
        try:
            await self._watch(runtime, terminal, view, runtime.scheduler.ended, *alongside)
        finally:
            # an interrupted run has a report, too
            self.reason = runtime.gate.told
            self.report = report(runtime)

    async def _watch(
        self, runtime: Runtime, terminal: Callable[[], Terminal], view: View, *ends: asyncio.Future[Any]
    ) -> None:
        if view == "screens" and self.speed != "max" and tty.drawable():
            async with terminal() as screens:
                runtime.add_task("screens", SCREENS_PRIORITY, SCREENS_PERIOD, screens.screens)
                operator = asyncio.ensure_future(screens.wait())
                await _first_of(*ends, operator)
                self.quit = operator.done() and operator.result() == "quit"
                operator.cancel()
                assert self.subject is not None
                # before the screens close, which takes time
                self.subject.disarm("the run has ended")
            if self.quit or any(each.done() for each in ends):
                return
            say("the terminal was lost and the robot disarmed; Ctrl-C ends the run")
            self.code = FAULT
        show = _log_lines if in_journal() else _status_lines
        lines = asyncio.Future() if view == "nothing" else asyncio.ensure_future(show(runtime))
        try:
            await _first_of(*ends, lines)
        finally:
            lines.cancel()

    @property
    def beat(self) -> float:
        """Seconds between two heartbeats of the drawing process: 20 a second of the robot's time."""
        speed = self.speed if isinstance(self.speed, float) else 1.0
        return max(REFRESH / max(speed, 1.0), BEAT_MIN)


def _again(number: int, _: FrameType | None, since: int) -> None:
    """Take a further signal: it ends the process only after the time in which a robot is stopped and seen to stand.

    Otherwise a second Ctrl-C would leave a car that rolls with its ESC on.
    """
    if stopwatch_ns() - since < STOPPING * NS_PER_S:
        os.write(STDERR, b"txt1: the robot is being stopped; that takes some seconds\n")
    else:
        os._exit(128 + number)


async def get_ready(robot: Robot, arm: bool | None) -> None:
    """Wait for the link, arm, and load the gains, without an operator; `arm` None leaves arming to the configuration.

    Raises ConfigError: no operator can arm the robot; HalError: the board does not answer as it should; NotArmed.
    """
    await robot.linked(LINK_PATIENCE)
    if not (robot.arms_by_itself if arm is None else arm):
        raise ConfigError("no operator can arm the robot: add --arm")
    robot.arm()
    if not await robot.load_gains():
        raise HalError(refusal_of_gains(robot))


def refusal_of_gains(robot: Robot) -> str:
    """Return why the gains are not in force, and the remedy."""
    if robot.gains_rejected:
        return "the board did not accept the gains; check control.linear and control.angular"
    return "the board did not acknowledge the gains; 'txt1 doctor' looks closer"


@contextmanager
def real_time(robot: Robot) -> Iterator[None]:
    """Ask for real-time scheduling until the block is left, and print the system's answer."""

    async def keep_off(ticks: Ticks) -> None:
        async for _ in ticks:
            rights.sweep()

    with realtime() as rights:
        more = "; 'txt1 doctor' says how to be granted more" if rights.granted.missing else ""
        say(f"real time: {rights.granted}{more}")
        # for screens and recordings
        robot.tell(f"real time: {rights.granted}")
        robot.runtime.add_task("real time", SCREENS_PRIORITY, SWEEP, keep_off)
        yield


def report(runtime: Runtime) -> dict[str, Any]:
    """Return the report that `--json` prints. Its `wall_time_s` and `run_time_s` are measured on the wall clock."""
    battery = runtime.state.battery
    return {
        "sim_time_s": round(runtime.now, 9),
        "wall_time_s": runtime.scheduler.wall_time,
        "seed": runtime.config.seed,
        "tasks": {
            name: {
                "cycles": task.cycles,
                "misses": task.misses,
                "lateness_s": task.lateness.percentiles()._asdict(),
                "run_time_s": task.run_time.percentiles()._asdict(),
            }
            for name, task in runtime.statistics().items()
        },
        "odometry": runtime.state.odometry._asdict(),
        "battery": {**battery._asdict(), "state": battery.state and battery.state.value},
        "sensors": {name: polled.state()._asdict() for name, polled in runtime.sensors.items()},
        "driver": plain(runtime.bus.read(DRIVER)),
        "armed": runtime.gate.armed,
        "faults": runtime.faults(),
        "topics": {
            topic.name: plain(value)
            for topic in runtime.bus.offered
            if topic.in_snapshots and topic.rule is not Rule.SNAPSHOT and (value := runtime.bus.read(topic)) is not None
        },
    }


def conclude(app: App, as_json: bool) -> int:
    """Print the end of a run in words, and return its exit code."""
    if as_json and app.report is not None:
        print(json.dumps(app.report))
    if app.code == DISARMED:
        say(f"the robot was stopped: {app.reason or 'see the counters'}")
    elif app.code == UNSTOPPED:
        say(app.reason)
    return app.code


async def _first_of(*futures: asyncio.Future[Any]) -> None:
    done, _ = await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
    for future in done:
        future.result()


async def _status_lines(runtime: Runtime) -> None:
    """Print a status line a second, and new lines of the event log. A slow reader misses lines, and never delays the
    robot.
    """
    sys.stdout.flush()
    # what the first steps told, such as a sensor that is in trouble from the start
    for event in runtime.state.events:
        _put(f"t={event.time:8.2f} s  {event.text}")
    runtime.bus.subscribe(lambda topic, event, time: _put(f"t={time:8.2f} s  {event.text}"), [LOG])
    while True:
        _put(status_line(runtime.snapshot(SHOWN)))
        await asyncio.sleep(1.0)


async def _log_lines(runtime: Runtime) -> None:
    """Print new lines of the event log. A journal adds the time itself, and status lines would fill it."""
    runtime.bus.subscribe(lambda topic, event, time: _put(event.text), [LOG])
    for event in runtime.state.events:
        _put(event.text)
    await asyncio.Future()


def _put(text: str) -> None:
    """Print a line without control characters, unless its reader has stopped reading."""
    if not text.isprintable():
        text = "".join(letter if letter.isprintable() else " " for letter in text)
    # a pipe is writable while a line fits
    _, writable, _ = select.select([], [STDOUT], [], 0.0)
    if writable:
        os.write(STDOUT, f"{text}\n".encode(errors="replace"))


def in_journal() -> bool:
    """Return whether standard output goes to systemd's journal."""
    output = os.fstat(STDOUT)
    return os.environ.get("JOURNAL_STREAM") == f"{output.st_dev}:{output.st_ino}"
