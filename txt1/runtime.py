"""The robot at work: a configuration, a hardware layer and the running loop's clock make running tasks."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from math import isfinite
from typing import Any, Final, Protocol

from txt1.config import Config
from txt1.config.schema import SensorConfig
from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.errors import ConfigError, HalError, NotArmed, Txt1Error
from txt1.hal.base import Button, Hal, Inputs
from txt1.kernel import collector
from txt1.kernel.loop import VirtualTimeLoop
from txt1.kernel.scheduler import PeriodicTask, Scheduler
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import Ticks
from txt1.model.light import Readings
from txt1.protocol.messages import BoardMessage, Message, PidResponse
from txt1.sensors.base import SENSORS, Sensor, Setup
from txt1.sensors.polling import Sensors
from txt1.sensors.registry import create
from txt1.tasks import battery, button, controller, display, encoder, mode, odometry, serial
from txt1.tasks.fields import TaskReport
from txt1.tasks.state import State
from txt1.telemetry.bus import Bus

OnFault = Callable[[str, BaseException], None]

TELEMETRY_PRIORITY: Final = -100
"""Below every task of the robot's and the user's: it sees what they have done in the same instant."""


class Witness(Protocol):
    """Who is told of everything that is given to the tasks from outside, before it takes effect: a recorder."""

    def message(self, message: Message, time: float) -> None:
        """A message was posted; `time` is when its author gave it, s of the run."""

    def action(self, now: float, kind: str, text: str = "", values: tuple[float, ...] = ()) -> None:
        """At `now`, s of the run, this is done: arm, disarm (text), stop, press, place (x, y, theta), look, tell."""

    def line(self, direction: str, data: bytes) -> None:
        """Bytes have come ("in") or gone ("out") on the line."""

    def task(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> PeriodicTask:
        """A task is added, without a period one that runs on arrival; what is returned runs in its place."""

    def light(self, lux: Readings) -> None:
        """The light sensors were read."""

    def learning_step(self, episode: int, state: int, action: int, reward: float, values: tuple[float, ...]) -> None:
        """A learner has decided; see `txt1.learning.task.Observer`."""


class Runtime:
    """The tasks over a hardware layer.

    Args:
        config: what to run.
        send: called with every message the tasks send to their host.
        hal: the hardware layer.
        limits: of the safety gate; None takes the configured ones.
        name: on the screens; None takes the HAL's.
        scheduler: makes what runs the tasks, given what is told of a task that raised.
        sensing: whether the configured sensors are opened: on the robot itself, on no board and in no replay.

    """

    def __init__(
        self,
        config: Config,
        send: Callable[[BoardMessage], None],
        hal: Hal,
        *,
        limits: Limits | None = None,
        name: str | None = None,
        scheduler: Callable[[OnFault], Scheduler] = Scheduler,
        sensing: bool = False,
    ) -> None:
        self.config = config
        self.hal = hal
        self.name = config.name or hal.name if name is None else name
        self.state = State()
        self.gate = Gate(config.limits() if limits is None else limits, on_close=self._gate_closed)
        self.scheduler = scheduler(self._task_failed)
        self.bus = Bus(config.name, begin=self._begin_sampling)
        """What the robot tells."""
        self.sensors = Sensors(self.bus, self.add_task, self.state.tell)
        """The sensors beside those of the hardware layer, by name."""
        self.bus.offer(SENSORS, lambda: self.sensors.states() or None)
        self.watched = False
        """Whether somebody looks at the statistics in the snapshots; summing them up costs."""
        self.witness: Witness | None = None
        """Told of everything that comes from outside."""
        self._sensing = sensing
        self._send = send
        self._inbox: serial.Inbox = deque(maxlen=serial.INBOX_MAX)
        self._presses: deque[Button] = deque(maxlen=100)
        self._periods: dict[str, tuple[int, float | None]] = {}
        self._reports: dict[str, TaskReport] = {}
        self._next_report = 0
        self._notify_serial: Callable[[], None] = lambda: None
        self._open = False
        self._failed = False

    # -- life --------------------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Open the hardware and start the tasks.

        Raises:
            HalError: the hardware cannot be opened.

        """
        virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        if virtual and not self.hal.capabilities.simulated:
            raise ConfigError(f"--speed: the HAL '{self.hal.name}' is not simulated and runs in real time only")
        made = {name: self.make_sensor(name) for name in self.config.sensors} if self._sensing else {}
        for name, sensor in made.items():
            if virtual and not sensor.simulated:
                raise ConfigError(f"--speed: the sensor '{name}' is not simulated and runs in real time only")
        self._open = True  # from here on `stop` closes it, also when opening fails half-way
        collector.begin(real_time=not virtual)
        await self._hardware("opened", self.hal.open())
        state, hal, gate, config, send = self.state, self.hal, self.gate, self.config, self._send
        geometry = config.geometry
        simulated = hal.capabilities.simulated
        room = (config.sim.room.length, config.sim.room.width)
        # in the order in which tasks of equal priority run
        self.add_task(
            "controller", controller.PRIORITY, controller.PERIOD,
            partial(controller.controller, state=state, hal=hal, gate=gate, geometry=geometry),
        )  # fmt: skip
        self._periods["serial"] = (serial.PRIORITY, None)
        serving = partial(
            serial.serial, inbox=self._inbox, state=state, hal=hal, gate=gate, send=send, answered=self._answered
        )
        self._notify_serial = self.scheduler.add_sporadic(
            "serial", serial.PRIORITY, self._witnessed("serial", serial.PRIORITY, None, serving)
        )
        self.add_task(
            "encoder", encoder.PRIORITY, encoder.PERIOD,
            partial(encoder.encoder, state=state, hal=hal, geometry=geometry),
        )  # fmt: skip
        self.add_task("mode", mode.PRIORITY, mode.PERIOD, partial(mode.mode, state=state, gate=gate))
        self.add_task(
            "display", display.PRIORITY, display.PERIOD,
            partial(
                display.display, state=state, hal=hal, name=self.name, gate=gate, reports=self._task_reports,
                room=room if simulated and all(map(isfinite, room)) else None,
                light=config.sim.room.light if simulated else None,
            ),
        )  # fmt: skip
        self.add_task(
            "odometry", odometry.PRIORITY, odometry.PERIOD, partial(odometry.odometry, state=state, send=send)
        )
        self.add_task(
            "battery", battery.PRIORITY, battery.PERIOD,
            partial(battery.battery, state=state, hal=hal, gate=gate, send=send),
        )  # fmt: skip
        self.add_task(
            "button", button.PRIORITY, button.PERIOD,
            partial(button.button, presses=self._presses, state=state, hal=hal, gate=gate),
        )  # fmt: skip
        for name, sensor in made.items():
            await self.sensors.add(name, sensor, config.sensors[name].period)
        self.scheduler.start()

    async def stop(self) -> None:
        """Leave the outputs neutral, stop the tasks and let go of the hardware; harmless when stopped already."""
        if not self._open:
            return
        self._open = False
        self.gate.disarm("the run has ended")
        try:
            if not self._failed:  # else it was made safe then, as far as that was possible
                self.make_safe(self.now)
        finally:
            try:
                self.scheduler.stop()
            finally:
                collector.end()
                try:
                    await self.sensors.close()
                finally:
                    await self._hardware("closed", self.hal.close())

    def make_sensor(self, name: str, options: SensorConfig | None = None) -> Sensor[Any]:
        """A sensor, not opened yet, as ``sensors.NAME`` of the configuration or as given here.

        Raises:
            ConfigError: there is no such driver, or its settings are wrong.
            HalError: it cannot be imported or made.

        """
        given = self.config.sensors[name] if options is None else options
        pose = (lambda: self.look().pose) if self.hal.capabilities.pose else None
        return create(given, Setup(name, given.options, self.config, pose, self.hal))

    async def _hardware(self, done: str, action: Coroutine[Any, Any, None]) -> None:
        """Wait for the HAL to be opened or closed; whatever a stranger's raises becomes a HalError."""
        try:
            await action
        except Txt1Error:
            raise
        except Exception as error:
            raise HalError(f"the HAL '{self.hal.name}' cannot be {done}: {type(error).__name__}: {error}") from error

    # -- for the host side -------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.scheduler.now

    def post(self, message: Message, time: float) -> None:
        """Hand the serial task a message; `time` (s of the run) is when its author gave it."""
        if self.witness is not None:
            self.witness.message(message, time)
        self._put(message, time)

    def _put(self, message: Message, time: float) -> None:
        if len(self._inbox) == self._inbox.maxlen:
            self.gate.count(Fault.OVERFLOW)
        self._inbox.append((message, time, self.gate.epoch))
        self._notify_serial()

    def _answered(self, accepted: bool) -> None:
        """The board has answered a PID set."""
        self._put(PidResponse(accepted), self.now)

    def press(self, button: Button) -> None:
        """Press a button of the joystick; the button task takes it at its next tick."""
        self._begin("press", values=(float(button),))
        self._presses.append(button)

    @property
    def linked(self) -> bool:
        """Whether the host is heard and, behind a line, the board answers."""
        board = self.state.board
        return self.state.link.alive and (board is None or board.ready)

    def arm(self) -> None:
        """Open the safety gate.

        Raises:
            NotArmed: it may not be opened now; the message says why.

        """
        now = self._begin("arm")
        reason = self._reason_not_to_arm(now)
        if reason is not None:
            raise NotArmed(reason)
        self.gate.arm(now)
        self.state.tell(now, "armed")

    def _reason_not_to_arm(self, now: float) -> str | None:
        state = self.state
        if state.board is not None and not state.board.ready:
            return f"no link to the board yet: {state.board.text}"
        if not state.link.alive:
            return "link lost: the host has not been heard for a second"
        if self.config.hal == "serial" and self.config.serial.control == "host" and not self.config.serial.allow_host:
            return (
                "control: host is experimental: an original board in manual mode keeps its last PWM when this host "
                "dies; with the wheels off the ground, put it into manual mode and set serial.allow_host=true"
            )
        if not state.power.atx:
            return "the ATX supply is off, so the encoders see nothing: switch it on first"
        if self.hal.read(now).cut_off:
            return "the batteries are cut off: change them first"
        if state.battery.exhausted:
            return "batteries bad: change them first"
        return None

    def emergency_stop(self) -> None:
        """Stop at once and latch."""
        now = self._begin("stop")
        self.gate.stop()
        self.make_safe(now)

    def disarm(self, reason: str) -> None:
        """Close the safety gate at once, outputs neutral."""
        now = self._begin("disarm", reason)
        self.gate.disarm(reason)
        self.make_safe(now)

    def place(self, x: float, y: float, theta: float) -> None:
        """Put a simulated robot down at a pose in the room (see `Hal.place`)."""
        now = self._begin("place", values=(x, y, theta))
        self.hal.place(x, y, theta, now)

    def look(self) -> Inputs:
        """What the hardware reports now, for a task of the user's: a simulation is moved on by being looked at."""
        now = self.scheduler.now  # light sensors are read 62 times a second: what `_begin` does, without the calls
        if self.witness is not None:
            self.witness.action(now, "look")
        return self.hal.read(now)

    def tell(self, text: str) -> None:
        """Add a line to the event log."""
        now = self._begin("tell", text)
        self.state.tell(now, text)

    def _begin(self, kind: str, text: str = "", values: tuple[float, ...] = ()) -> float:
        """The time at which something is done from outside; the witness is told of it first."""
        now = self.now
        if self.witness is not None:
            self.witness.action(now, kind, text, values)
        return now

    def make_safe(self, now: float) -> None:
        """Put neutral outputs on the hardware at `now`, without waiting for a tick."""
        self.hal.write(self.gate.neutral(self.state.servos), now)

    def add_task(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task (see `Scheduler.add`)."""
        self.scheduler.add(name, priority, period, self._witnessed(name, priority, period, task))
        self._periods[name] = (priority, period)

    def _witnessed(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> PeriodicTask:
        return task if self.witness is None else self.witness.task(name, priority, period, task)

    @property
    def task_names(self) -> list[str]:
        """The names of all tasks, in the order they were added."""
        return list(self._periods)

    def faults(self) -> dict[str, int]:
        """Everything that was refused, clipped or lost so far, by name."""
        counted = {fault.value: count for fault, count in self.gate.counts.items()} | self.state.line_faults
        return counted if self.state.board is None else counted | self.state.board.faults

    def statistics(self) -> dict[str, TaskStatistics]:
        """What every task has done so far, by name."""
        return self.scheduler.statistics()

    def _begin_sampling(self) -> None:
        self.add_task("telemetry", TELEMETRY_PRIORITY, controller.PERIOD, self._sample)

    async def _sample(self, ticks: Ticks) -> None:
        async for now in ticks:
            self.bus.sample(now)

    # -- inside ------------------------------------------------------------------------------------------------

    def _task_reports(self) -> tuple[TaskReport, ...]:
        """The statistics for the screens, one task's brought up to date at a time; none while nobody looks."""
        if self.watched:
            name = list(self._periods)[self._next_report % len(self._periods)]
            self._next_report += 1
            self._reports[name] = self._task_report(name)
        return tuple(self._reports.values())

    def _task_report(self, name: str) -> TaskReport:
        priority, period = self._periods[name]
        task = self.scheduler.statistics()[name]
        return TaskReport(
            name,
            priority,
            None if period is None else 1.0 / period,
            task.cycles,
            task.misses,
            task.lateness.percentiles(),
            task.run_time.percentiles(),
        )

    def _gate_closed(self, reason: str) -> None:
        self.state.tell(self.now, f"disarmed: {reason}")

    def _task_failed(self, name: str, error: BaseException) -> None:
        self._failed = True
        self.gate.disarm(f"task '{name}' failed: {error}", Fault.TASK)
        with suppress(Exception):  # it may be the hardware itself that failed; the first error is the one that counts
            self.make_safe(self.now)
