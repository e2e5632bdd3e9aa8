"""The robot at work: a configuration, a hardware layer and the running loop's clock make running tasks."""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Mapping
from contextlib import AsyncExitStack, suppress
from functools import partial
from math import isfinite
from operator import itemgetter
from typing import Any, TypeVar

from txt1 import additions
from txt1.config import Config
from txt1.config.schema import SensorConfig
from txt1.control.car import loops_for
from txt1.control.limits import Fault, Gate
from txt1.control.open_loop import OpenLoop
from txt1.control.parameters import Limits
from txt1.control.standstill import UNOBEYED
from txt1.errors import ConfigError, HalError, NotArmed
from txt1.hal.base import LINK, Button, Hal, Inputs
from txt1.hal.channels import rewired
from txt1.hal.witness import witnessed
from txt1.kernel import collector
from txt1.kernel.loop import VirtualTimeLoop
from txt1.kernel.scheduler import PeriodicTask, Row, Scheduler
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import Ticks
from txt1.model.estimate import Estimate
from txt1.plugins import settled
from txt1.protocol.layout import numbers
from txt1.protocol.messages import BoardMessage, Message, PidResponse, Switch, Velocity
from txt1.sensors.base import SENSORS, Reading, Sensor, Setup
from txt1.sensors.polling import Sensors
from txt1.sensors.registry import create
from txt1.sim.battery import range_left
from txt1.sim.obstacles import outline
from txt1.tasks import battery, controller, encoder, fields, inputs, mode, panel, serial, standstill
from txt1.tasks.diagnostics import FAULTS, TASKS, Reports
from txt1.tasks.fields import GainTable
from txt1.tasks.markers import MARKERS
from txt1.tasks.state import State
from txt1.telemetry.bus import Bus
from txt1.telemetry.snapshot import SNAPSHOT, Snapshot
from txt1.telemetry.topics import Topic

T = TypeVar("T")
OnFault = Callable[[str, BaseException], None]
Through = Callable[[str, Sensor[Any]], Sensor[Any]]
"""Given the name of a configured sensor and the sensor, not opened yet, returns the one to be read in its place."""


class Runtime:
    """The tasks over a hardware layer.

    Args:
        config: of the robot, or of the board that this is.
        send: called with every message the tasks send to their host.
        hal: the hardware layer.
        limits: of the safety gate; None takes the configured ones.
        name: on the screens; None takes the HAL's.
        scheduler: made with the function that is told of a task that raised.
        sensing: whether this is the robot itself, with its sensors, guards and estimate: no board is.
        through: in a replay, every configured sensor passes it, and the recorded readings are given again there.
        tasks: makes others of it than the robot's own: the firmware of another board.
        asked: additions that take part though the configuration does not want them, by name, with their settings.

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
        through: Through | None = None,
        tasks: Callable[["Runtime"], Iterable[Row]] | None = None,
        asked: Mapping[str, object] | None = None,
    ) -> None:
        self.config = config
        self._virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        self._stepwise = sensing and not self._virtual  # a replay takes the very steps of this run
        self._witnessed = self._stepwise and not hal.capabilities.repeats
        self.hal = rewired(hal, config.channels, config.geometry.steering == "skid")
        hal = self._io = witnessed(self.hal, partial(self._report, "hal")) if self._witnessed else self.hal
        self.name = config.name or hal.name if name is None else name
        self.bus = Bus(config.name, begin=self._begin_sampling)
        """What the robot tells."""
        self.state = State(self.bus, hal.capabilities)
        self.gate = Gate(config.limits() if limits is None else limits, on_close=self._gate_closed)
        self.scheduler = scheduler(self._task_failed)
        self.scheduler.on_sleep = self.slept
        self.sensors = Sensors(self.bus, self.add_task, self.state.tell)
        """The sensors beside those of the hardware layer, by name."""
        self.bus.offer(SENSORS, lambda: self.sensors.states() or None)
        self.additions = additions.active(config, asked) if sensing else ()
        """What takes part beside the tasks."""
        self._watching = AsyncExitStack()
        self.parts: list[object] = []
        """What the additions have put there, for `part`."""
        self.estimate: Callable[[], Estimate | None] = lambda: None
        """Returns pose and velocities by all sensors together, where an addition makes them."""
        self.on_place: list[Callable[[], None]] = []
        """Called when the robot was put down elsewhere."""
        self._source = ""  # the task of the user's, of the driver's or of a sensor that is at work
        self._sensing = sensing
        self._through = through
        self._send = send
        self._make_tasks = Runtime._own_tasks if tasks is None else tasks
        self.inbox: serial.Inbox = deque(maxlen=serial.INBOX_MAX)
        """Messages for the serial task."""
        self.presses: deque[Button] = deque(maxlen=100)
        """Presses of the joystick's buttons for the button task."""
        self._reports = Reports(self.statistics, self._virtual)
        self._notify_serial: Callable[[], None] = lambda: None
        self._open = False
        self._failed = False
        watch = partial(standstill.Watch, self.state, hal, self.gate, config.geometry.track_width, self._switch)
        self.watch = watch() if hal.capabilities.halt else None
        """Verifies stops, where something lies between the gate and the actuators that may not obey one."""
        self._offer()
        self._offer_to_snapshots()

    def _switch(self, switch: Switch, on: bool, now: float) -> None:
        serial.switch_power(self.state, self._io, switch, on, now)

    def _offer(self) -> None:
        """Offer the topics: causes before effects, as a replay names the first difference."""
        state, gate, hal, bus = self.state, self.gate, self.hal, self.bus
        can = hal.capabilities
        gains, told = (state.gains.linear, state.control.gains), mode.Mode()

        def read() -> tuple[Any, ...]:
            nonlocal gains, told
            control, odometry = state.control, state.odometry if state.odometry_time or can.ticks else None
            linear, angular = state.gains.linear, control.gains
            if linear is not gains[0] or angular is not gains[1]:
                gains = linear, angular
            parts = gate.armed, gate.stopped, gate.reason, state.link, state.power, state.panel
            if parts != told:
                told = mode.Mode(*parts)
            return odometry, control, control, odometry, state.encoders, state.pose, told, control.source, gains

        row: dict[Topic[Any], bool] = {
            encoder.ODOMETRY: True, controller.SETPOINT: True, controller.PWM: can.pwm, encoder.TRANSFORM: True,
            encoder.ENCODERS: can.ticks, encoder.POSE: can.pose, mode.MODE: True, controller.MEASURED_BY: can.pwm,
            controller.GAINS: can.pwm,
        }  # fmt: skip
        there = itemgetter(*(place for place, known in enumerate(row.values()) if known))
        topics = [topic for topic, known in row.items() if known]
        bus.offer_row(topics, read if all(row.values()) else lambda: there(read()))
        if can.pose:
            bus.offer(encoder.ROOM, lambda: None if state.pose is None else encoder.origin(state.pose, state.odometry))
        watch = self.watch
        if watch is not None:
            bus.offer(standstill.STOP, lambda: watch.standstill.stop)
        for topic in battery.BATTERIES:
            bus.offer(topic, lambda: None if state.battery.state is None else state.battery)
        bus.offer(battery.RANGE, self._range_left)
        bus.offer(FAULTS, lambda: {name: count for name, count in self.faults().items() if count})
        bus.offer(TASKS, lambda: self._reports.counts(self.now, self._open))
        bus.offer(SNAPSHOT, self._recorded_snapshot)
        tap_line = getattr(hal, "tap_line", None)
        if tap_line is not None:
            tap_line(lambda direction, data: bus.publish(LINK, (direction, data), self.now))

    def _range_left(self) -> float | None:
        """How far the batteries last, m; None where that is not known."""
        remaining, config = self.state.battery.remaining, self.config
        return None if remaining is None else round(range_left(config.sim.battery, remaining, config.safety.v_max))

    def _offer_to_snapshots(self) -> None:
        """Offer what snapshots tell beside that, and its surroundings to views in three dimensions."""
        state, bus, sim, can = self.state, self.bus, self.config.sim, self.hal.capabilities
        size, shape = (sim.room.length, sim.room.width), self.config.geometry
        body = shape.length, shape.width, shape.centre
        surroundings = fields.Surroundings(body=body)
        if can.simulated:
            room, obstacles = size if all(map(isfinite, size)) else None, tuple(map(outline, sim.obstacles))
            surroundings = fields.Surroundings(room, sim.room.light, body, obstacles)
        others = getattr(self.hal, "others", None)
        if others is not None:
            bus.offer(fields.VEHICLES, lambda: others() or None)
        bus.offer(fields.CAPABILITIES, lambda: can)
        bus.offer(fields.BOARD, lambda: state.board)
        bus.offer(fields.COMMAND, lambda: state.command)
        bus.offer(fields.GAIN_TABLE, self._gains)
        bus.offer(fields.SERVOS, lambda: state.servos)
        bus.offer(
            fields.TRAFFIC, lambda: fields.Traffic(state.received, state.transmitted, self.now - state.odometry_time)
        )
        bus.offer(fields.BACKLIGHT, lambda: state.backlight)
        bus.offer(fields.SURROUNDINGS, lambda: surroundings)
        bus.offer(MARKERS, lambda: surroundings)
        bus.offer(fields.TASK_REPORTS, self._reports.newest)
        bus.offer(fields.EVENTS, lambda: tuple(state.events))
        bus.offer(fields.WARNINGS, lambda: state.warned() or None)

    def _gains(self) -> GainTable:
        """The gains, loaded or not: a board that was away has to acknowledge them anew."""
        gains, board = self.state.gains, self.state.board
        return gains if board is None or board.gains else gains._replace(loaded=False)

    def snapshot(self, topics: Iterable[str] | None = None) -> Snapshot:
        """Everything that the robot tells, or the topics of these names, as it is now."""
        return Snapshot.take(self.bus, self.now, self.name, topics)

    def _recorded_snapshot(self) -> Snapshot:
        """The same; in virtual time without the tasks' times, which are the processor's and never the same."""
        without = (fields.TASK_REPORTS,) if self._virtual else ()
        return Snapshot.take(self.bus, self.now, self.name, without=without)

    async def start(self) -> None:
        """Open the hardware and start the tasks; raises HalError when it cannot be opened."""
        needs_simulated = self._virtual and self._through is None  # what a replay has reports again
        if needs_simulated and not self.hal.capabilities.simulated:
            raise ConfigError(f"--speed: the HAL '{self.hal.name}' is not simulated and runs in real time only")
        configured = self.config.sensors if self._sensing else {}
        made = {name: self.make_sensor(name, settings) for name, settings in configured.items()}
        for name, sensor in made.items():
            if needs_simulated and not sensor.simulated:
                raise ConfigError(f"--speed: the sensor '{name}' is not simulated and runs in real time only")
        self._open = True  # from here on `stop` closes it, also when opening fails half-way
        collector.begin(real_time=not self._virtual)
        for addition, settings in self.additions:
            if addition.watch:
                await self._watching.enter_async_context(additions.load(addition.watch)(self, settings))
        await settled(f"the HAL '{self.hal.name}'", "opened", self.hal.open)
        if self._sensing:
            self._report("hal", "hardware", self.hal.name, self.hal.capabilities)
        for name, priority, period, task in self._make_tasks(self):
            if period is None:
                self._notify_serial = self.scheduler.add_sporadic(name, priority, self._watched(name, task))
                self._reports.add(name, priority, None)
            else:
                self._add(name, priority, period, task)
        for name, sensor in made.items():
            await self._open_sensor(name, sensor, configured[name].period)
        for addition, settings in self.additions:
            if addition.prepare:
                self.parts.append(await additions.load(addition.prepare)(self, settings))
        self.scheduler.start()

    def _own_tasks(self) -> Iterable[Row]:
        """The robot's tasks, in the order in which those of equal priority run (thesis 3.3.3)."""
        state, hal, gate, send, geometry = self.state, self._io, self.gate, self._send, self.config.geometry
        loops: controller.Loops
        if hal.capabilities.blind:
            loops = OpenLoop(geometry, self.config.control.speed_map)
        else:
            loops = loops_for(self.config.car, geometry)
        controlling = partial(controller.controller, state=state, hal=hal, gate=gate, geometry=geometry, loops=loops)
        serving = partial(
            serial.serial, inbox=self.inbox, state=state, hal=hal, gate=gate, send=send,
            answered=lambda accepted: (self.post if self._witnessed else self.put)(PidResponse(accepted), self.now),
            reason_to_keep_atx=self.reason_to_keep_atx,
        )  # fmt: skip
        watch = self.watch
        watching: tuple[Row, ...] = ()
        if watch is not None:
            watching = (("standstill", 3, standstill.PERIOD, partial(standstill.standstill, watch=watch)),)
        return (
            ("controller", 4, controller.PERIOD, controlling),
            ("serial", 4, None, serving),
            ("encoder", 3, controller.PERIOD, partial(encoder.encoder, state=state, hal=hal, geometry=geometry)),
            *watching,
            ("mode", 2, 1.0, partial(mode.mode, state=state, gate=gate)),
            ("display", 2, 0.1, partial(panel.display, state=state, hal=hal)),
            ("odometry", 2, 0.05, partial(encoder.odometry, state=state, send=send)),
            ("battery", 1, 1.0, partial(battery.battery, state=state, hal=hal, gate=gate, send=send)),
            ("button", 1, 0.1, partial(panel.button, presses=self.presses, state=state, hal=hal, gate=gate)),
        )

    async def stop(self) -> None:
        """Leave the outputs neutral, stop the tasks and let go of the hardware; harmless when stopped already."""
        if not self._open:
            return
        ended = self._begin("end")
        self._open = False
        self.gate.disarm("the run has ended")
        async with AsyncExitStack() as stack:  # whatever fails on the way; last in, first out
            stack.push_async_callback(self._watching.aclose)
            stack.push_async_callback(settled, f"the HAL '{self.hal.name}'", "closed", self.hal.close)
            stack.push_async_callback(self.sensors.close)
            stack.callback(collector.end)
            stack.callback(lambda: self.bus.flush(ended if self.watch is None else self.now))
            stack.push_async_callback(self._settle)
            stack.callback(self.scheduler.stop)
            if not self._failed:  # else it was made safe then, as far as that was possible
                self.make_safe(self.now)

    async def _settle(self) -> None:
        """Wait until the robot stands, where that has to be verified: 3 s at most, and by stronger means if need be."""
        watch, ends = self.watch, self.now + standstill.END
        with suppress(HalError):  # then nobody sees it stand
            while watch is not None and not watch.settled and self.now < ends:
                await asyncio.sleep(standstill.PERIOD)
                now, neutral = self.now, self.gate.neutral(self.state.servos)
                encoder.take_odometry(self.state, self._io.read(now), now)
                self._io.write(neutral, now)
                watch.step(now, neutral)

    def make_sensor(self, name: str, options: SensorConfig | None = None) -> Sensor[Any]:
        """A sensor, not opened yet, as ``sensors.NAME`` of the configuration or as given here.

        Raises ConfigError: there is no such driver, or its settings are wrong; HalError: it cannot be imported or made.
        """
        given = self.config.sensors[name] if options is None else options
        pose = (lambda: self.look().pose) if self.hal.capabilities.pose else None
        return create(given, Setup(name, given.options, self.config, pose, self.hal))

    async def open_sensor(self, name: str, options: SensorConfig) -> None:
        """Open a sensor of the robot's own that is not configured, whose readings a replay gives again."""
        await self._open_sensor(name, self.make_sensor(name, options), options.period)

    async def _open_sensor(self, name: str, sensor: Sensor[Any], period: float | None) -> None:
        own = partial(self._add, named=self.bus.wanted(inputs.INPUT))
        given = sensor if self._through is None else self._through(name, sensor)
        await self.sensors.add(name, given, period, own, self._note_reading)

    def part(self, kind: type[T]) -> T | None:
        """Return what an addition has put beside the tasks, by its class; None where there is none."""
        return next((part for part in self.parts if isinstance(part, kind)), None)

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.scheduler.now

    def post(self, message: Message, time: float) -> None:
        """Hand the serial task a message; `time` (s of the run) is when its author gave it."""
        if self.bus.heard:
            if type(message) is Velocity:
                now = self._begin("Velocity", "", (message.v, message.omega), time)
                self.bus.publish(inputs.COMMAND, message, now)
            else:
                self._begin(type(message).__name__, "", numbers(message), time)
        self.put(message, time)

    def put(self, message: Message, time: float) -> None:
        """Hand the serial task a message of the robot's own, which a replay makes again."""
        if len(self.inbox) == self.inbox.maxlen:
            self.gate.count(Fault.OVERFLOW)
        self.inbox.append((message, time, self.gate.epoch))
        self._notify_serial()

    def press(self, button: Button) -> None:
        """Press a button of the joystick; the button task takes it at its next tick."""
        self._begin("press", values=(float(button),))
        self.presses.append(button)

    @property
    def linked(self) -> bool:
        """Whether the host is heard and, behind a line, the board answers."""
        board = self.state.board
        return self.state.link.alive and (board is None or board.ready)

    def arm(self) -> None:
        """Open the safety gate; raises NotArmed, which says why it may not be opened now."""
        now = self._begin("arm")
        reason = self._reason_not_to_arm(now)
        if reason is not None:
            raise NotArmed(reason)
        self.gate.arm(now)
        self.state.tell(now, "armed")

    def _reason_not_to_arm(self, now: float) -> str | None:
        state = self.state
        board = None if state.board is None else self.hal.read(now).link  # as it is after what was done just now
        if board is not None and not board.ready:
            return f"no link to the board yet: {board.text}"
        if not state.link.alive:
            return "link lost: the host has not been heard for a second"
        if self.config.hal == "serial" and self.config.serial.control == "host" and not self.config.serial.allow_host:
            return (
                "control: host is experimental: an original board in manual mode keeps its last PWM when this host "
                "dies; with the wheels off the ground, put it into manual mode and set serial.allow_host=true"
            )
        if self.watch is not None and self.watch.standstill.stop in UNOBEYED:
            return "it has not stopped yet"
        if state.power.esc is False and not self.hal.capabilities.power_known:
            return "the ESC is off: switch it on first (e, or Robot.switch_power)"
        if state.power.atx is False:
            return "the ATX supply is off, so the encoders see nothing: switch it on first"
        if self._io.read(now).cut_off:
            return "the batteries are cut off: change them first"
        if state.battery.exhausted:
            return "batteries bad: change them first"
        return None

    def reason_to_keep_atx(self, now: float) -> str | None:
        """Why the ATX supply may not be turned off at `now`, with the remedy; None when it may."""
        return standstill.reason_to_keep_atx(self.state, self.hal.capabilities, self.gate, self.watch, now)

    def stands(self, now: float) -> bool:
        """Whether the robot was seen to stand, and still is at `now`."""
        return standstill.stands(self.state, self.watch, now)

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

    def slept(self, duration: float) -> None:
        """Disarm after the computer was suspended for `duration` s: whatever was to be done then is over."""
        now = self._begin("slept", values=(duration,))
        self.gate.slept(duration, controller.PERIOD)
        if not self.gate.armed:
            self.make_safe(now)

    def place(self, x: float, y: float, theta: float) -> None:
        """Put a simulated robot down at a pose in the room (see `Hal.place`)."""
        self._io.place(x, y, theta, self._begin("place", values=(x, y, theta)))
        for told in self.on_place:
            told()

    def look(self) -> Inputs:
        """The hardware's report now, for a task of the user's: a simulation is moved on by being looked at."""
        return self._io.read(self._begin("look"))

    def tell(self, text: str) -> None:
        """Add a line to the event log."""
        self.state.tell(self._begin("tell", text), text)

    def _begin(self, kind: str, text: str = "", values: tuple[float, ...] = (), given: float | None = None) -> float:
        """The time at which something is done from outside; listeners are told of it before it takes effect."""
        now = self.now
        if self.bus.wanted(inputs.INPUT):
            given = now if given is None else given
            event = inputs.Input(self.scheduler.steps, self._source, kind, text, given, values)
            self.bus.publish(inputs.INPUT, event, now)
        return now

    def _report(self, source: str, kind: str, text: str = "", value: Any = None, time: float = 0.0) -> None:
        """Tell what was read; a replay gives it again."""
        if self.bus.wanted(inputs.REPORT):
            report = inputs.Report(self.scheduler.steps, source, kind, text, time, value)
            self.bus.publish(inputs.REPORT, report, self.now)

    def _note_reading(self, task: str, kind: str, text: str, reading: Reading[Any] | None) -> None:
        time, value = (0.0, None) if reading is None else reading
        self._report(task, kind, text, value, time)

    def make_safe(self, now: float) -> None:
        """Put neutral outputs on the hardware at `now`, without waiting for a tick."""
        self._io.write(self.gate.neutral(self.state.servos), now)

    def add_task(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task of the user's (see `Scheduler.add`)."""
        self._begin("task", name, (float(priority), period), 0.0)
        self._add(name, priority, period, task, named=self.bus.wanted(inputs.INPUT))

    def add_own_task(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task of the robot's own, which a replay runs again."""
        self._add(name, priority, period, task)

    def _add(self, name: str, priority: int, period: float, task: PeriodicTask, named: bool = False) -> None:
        self.scheduler.add(name, priority, period, self._watched(name, task, named))
        self._reports.add(name, priority, period)

    def _watched(self, name: str, task: PeriodicTask, named: bool = False) -> PeriodicTask:
        """The task, its steps told where somebody wants to know; `named`: what comes in meanwhile comes from it."""
        told = self._stepwise and self.bus.wanted(inputs.STEP)
        if not told and not named:
            return task
        number = len(self._reports)

        def watched(ticks: Ticks) -> Coroutine[Any, Any, None]:
            def begins(now: float) -> None:
                if told:
                    self.bus.publish(inputs.STEP, (number, now, ticks.missed), now)
                if named:
                    self._source = name

            def ends() -> None:
                self._source = ""

            ticks.begins = begins
            if named:
                ticks.ends = ends
            return task(ticks)

        return watched

    def faults(self) -> dict[str, int]:
        """Everything that was refused, clipped or lost so far, by name."""
        counted = {fault.value: count for fault, count in self.gate.counts.items()} | self.state.line_faults
        return counted if self.state.board is None else counted | self.state.board.faults

    def statistics(self) -> dict[str, TaskStatistics]:
        """The statistics of every task so far, by name."""
        return self.scheduler.statistics()

    def _begin_sampling(self) -> None:
        # below every task of the robot's and the user's: it sees what they have done in the same instant
        self._add("telemetry", -100, controller.PERIOD, self._sample)

    async def _sample(self, ticks: Ticks) -> None:
        async for now in ticks:
            self.bus.sample(now)

    def _gate_closed(self, reason: str) -> None:
        blocked_by = getattr(self.hal, "blocked_by", None)  # where the hardware knows, as a simulation does
        if self.gate.closed_by is Fault.RUNAWAY and blocked_by is not None and (blocked := blocked_by()) is not None:
            self.gate.reason = reason = f"{reason}: it is at {blocked}"
        way_back = "; arm it again to go on (key m)" if self.gate.closed_by in (Fault.MISSED, Fault.SLEPT) else ""
        self.state.tell(self.now, f"disarmed: {reason}{way_back}")

    def _task_failed(self, name: str, error: BaseException) -> None:
        if self._source:
            self._begin("failure", str(error))
            self._source = ""
        self._failed = True
        self.gate.disarm(f"task '{name}' failed: {error}", Fault.TASK)
        with suppress(Exception):  # it may be the hardware itself that failed; the first error is the one that counts
            self.make_safe(self.now)
