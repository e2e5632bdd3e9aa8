"""The robot at work: running tasks, made from a configuration, a hardware layer and the running loop's clock."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import AsyncExitStack, suppress
from functools import partial
from math import inf
from typing import Any, Final, TypeVar

from txt1 import additions
from txt1.config import Config
from txt1.config.schema import SensorConfig
from txt1.control.limits import BLOCKED, LOST, Fault, Gate, Guard
from txt1.control.loops import Loops, loops_for
from txt1.control.parameters import Limits
from txt1.control.standstill import coasting_time
from txt1.errors import ConfigError, HalError, NotArmed
from txt1.hal.base import LINK, Button, Hal, Inputs, lacking
from txt1.hal.channels import rewired
from txt1.journal import Journal
from txt1.kernel import garbage
from txt1.kernel.loop import VirtualTimeLoop
from txt1.kernel.scheduler import PeriodicTask, Scheduler, TaskRow
from txt1.kernel.slowness import Slowness
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import Ticks
from txt1.model.estimate import Estimate
from txt1.offers import Offers
from txt1.plugins import settled
from txt1.protocol.layout import numbers
from txt1.protocol.messages import BoardMessage, Message, PidResponse, Switch, Velocity
from txt1.sensors.base import SENSORS, Sensor, Setup
from txt1.sensors.polling import Sensors
from txt1.tasks import battery, controller, encoder, fields, inputs, mode, panel, serial, standstill
from txt1.tasks.arming import reason_after_runaway, reason_not_to_arm
from txt1.tasks.diagnostics import Reports
from txt1.tasks.state import State
from txt1.telemetry.bus import Bus
from txt1.telemetry.snapshot import Snapshot

T = TypeVar("T")
# s after a stop by a safety rule in which the press of a key does not arm
LOOK_FIRST: Final = 1.0
OnFault = Callable[[str, BaseException], None]
Through = Callable[[str, Sensor[Any]], Sensor[Any]]
"""Given the name of a configured sensor and the sensor, not yet opened, returns the sensor to read in its place."""


def robot_tasks(robot: "Runtime") -> Iterable[TaskRow]:
    """The robot's tasks: name, priority, period in s (None: when a message comes) and coroutine.

    At the same instant, higher priorities run first, and equal priorities run in this order (thesis 3.3.3). The tasks
    of sensors, of additions and of the user's programs come after them.
    """
    state, hal, gate, geometry = robot.state, robot.io, robot.gate, robot.config.geometry
    loops: Loops
    if hal.capabilities.blind:
        # few cars are, so it is imported when it is needed
        from txt1.control.open_loop import OpenLoop

        loops = OpenLoop(geometry, robot.config.control.speed_map)
    else:
        loops = loops_for(robot.config.car, geometry)
    serving = partial(
        serial.serial,
        inbox=robot.inbox,
        state=state,
        hal=hal,
        gate=gate,
        send=robot.send,
        answered=robot.answer,
        reason_not_to_switch=robot.reason_not_to_switch,
        gain_limits=robot.config.gain_limits,
    )
    yield (
        "controller",
        4,
        controller.CONTROL_PERIOD,
        partial(controller.controller, state=state, hal=hal, gate=gate, geometry=geometry, loops=loops),
    )
    yield "serial", 4, None, serving
    counting = partial(encoder.encoder, state=state, hal=hal, gate=gate, geometry=geometry)
    yield "encoder", 3, controller.CONTROL_PERIOD, counting
    if robot.watch is not None:
        yield "standstill", 3, standstill.STANDSTILL_PERIOD, partial(standstill.standstill, watch=robot.watch)
    yield "mode", 2, mode.MODE_PERIOD, partial(mode.mode, state=state, gate=gate)
    yield "display", 2, panel.PANEL_PERIOD, partial(panel.display, state=state, hal=hal)
    yield (
        "odometry",
        2,
        encoder.ODOMETRY_PERIOD,
        partial(encoder.odometry, state=state, send=robot.send, heard=robot.heard),
    )
    watching = partial(battery.battery, state=state, hal=hal, gate=gate, send=robot.send)
    yield "battery", 1, battery.BATTERY_PERIOD, watching
    pressed = partial(panel.button, presses=robot.presses, state=state, hal=hal, gate=gate)
    yield "button", 1, panel.PANEL_PERIOD, pressed


class Runtime:
    """The tasks over a hardware layer.

    Args:
        config: of the robot, or of the board that this runtime is.
        send: called with every message that the tasks send to their host.
        hal: the hardware layer.
        limits: of the safety gate; None takes the configured ones.
        name: shown on the screens; None takes the HAL's.
        scheduler: makes a scheduler, given the function to call when a task fails.
        sensing: whether this is the robot itself, with sensors, guards and estimate, and not a board.
        through: replaces every configured sensor in a replay, to give the recorded readings again.
        tasks: builds another list of tasks; the virtual board of 2011 passes its own.
        asked: further additions that take part, by name, with their settings.

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
        tasks: Callable[["Runtime"], Iterable[TaskRow]] | None = None,
        asked: Mapping[str, object] | None = None,
    ) -> None:
        if missing := lacking(hal):
            raise HalError(
                f"the HAL '{config.hal}' lacks {', '.join(missing)}: derive its class from txt1.hal.PlainHal, "
                "which has plain ones (docs/your-own-hal.md)"
            )
        self.config = config
        self._virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        self.bus = Bus(config.name, begin=self._begin_sampling)
        """The robot's telemetry."""
        self.scheduler = scheduler(self._task_failed)
        self.scheduler.on_sleep = self.slept
        self.scheduler.waits = sensing and hal.waits
        # a replay then takes exactly the steps of this run
        stepwise = sensing and not self._virtual
        self.journal = Journal(self.bus, self.scheduler, stepwise)
        self._begin = self.journal.begin
        self._witnessed = stepwise and not hal.capabilities.repeats
        self.hal = rewired(hal, config.channels, config.geometry.steering == "skid")
        hal = self.io = self._reporting(self.hal) if self._witnessed else self.hal
        """The hardware layer as the tasks use it; on the real clock its reports are recorded here."""
        self.name = config.name or hal.name if name is None else name
        self.state = State(self.bus, hal.capabilities)
        if self.scheduler.waits and not self._virtual:
            self.state.warnings.append(Slowness(lambda: self.scheduler.held))
        self.gate = Gate(config.limits() if limits is None else limits, self._gate_closed, config.geometry.count_length)
        self.sensors = Sensors(self.bus, self.add_task, self.state.tell)
        """The sensors that the hardware layer does not have itself, by name."""
        self.bus.offer(SENSORS, lambda: self.sensors.states() or None)
        if sensing and hal.capabilities.pose:
            self.bus.offer(fields.SEEN, lambda: self.sensors.seen(self.state.pose) or None)
        self.additions = additions.active(config, asked) if sensing else ()
        """The additions that take part."""
        self._watching = AsyncExitStack()
        self.parts: list[object] = []
        """Objects that additions have put there, found by `part`."""
        self.estimate: Callable[[], Estimate | None] = lambda: None
        """Returns pose and velocities fused from all sensors, if an addition computes them."""
        self.on_place: list[Callable[[], None]] = []
        """Called when the robot was put down at another place."""
        self._sensing = sensing
        self._through = through
        # a host at the end of a line always listens
        self.send, self.heard = send, lambda: True
        self._make_tasks = robot_tasks if tasks is None else tasks
        self.inbox: serial.Inbox = deque(maxlen=serial.INBOX_MAX)
        """Messages for the serial task."""
        self.presses: deque[Button] = deque(maxlen=100)
        """Presses of the joystick's buttons for the button task."""
        self._reports = Reports(self.statistics, self._virtual)
        self._notify_serial: Callable[[], None] = lambda: None
        self._open = False
        # whether the robot did not obey since it was armed, and whether it may be armed without having been seen to
        # stand, when it has rolled out
        self._ran_away = self._seen_later = False
        # when a robot that did not obey has certainly rolled out, and when a safety rule last disarmed it, s of the run
        self._rolls_until, self._closed_at = 0.0, -inf
        self.failed = False
        """Whether a task has raised."""
        watch = partial(standstill.Watch, self.state, hal, self.gate, config.geometry.track_width, self._switch)
        self.watch = watch() if hal.capabilities.halt else None
        """Verifies stops, if the path from the gate to the actuators may fail to obey one."""
        offers = Offers(self.bus, self.state, self.gate, self.hal, config, self.watch, self._reports, lambda: self.now)
        offers.offer(self.faults, lambda: self._open, self._recorded_snapshot)
        self.line_tapped = self.hal.tap_line(lambda way, data: self.bus.publish(LINK, (way, data), self.now))
        """Whether the bytes on the line to a board are telemetry."""

    def _reporting(self, hal: Hal) -> Hal:
        # on the real clock only
        from txt1.hal.recorded_hal import witnessed

        return witnessed(hal, partial(self.journal.report, "hal"))

    def _switch(self, switch: Switch, on: bool, now: float) -> None:
        serial.switch_power(self.state, self.io, switch, on, now)

    def snapshot(self, topics: Iterable[str] | None = None) -> Snapshot:
        """All telemetry of this instant, or only the topics of these names."""
        return Snapshot.take(self.bus, self.now, self.name, topics)

    def _recorded_snapshot(self) -> Snapshot:
        """The snapshot to record: no configuration, address or points that readings tell, and in virtual time no run
        times of tasks, which vary.
        """
        without = (fields.HAND, fields.PAGE, fields.SEEN, *((fields.TASK_REPORTS,) if self._virtual else ()))
        return Snapshot.take(self.bus, self.now, self.name, without=without)

    async def start(self) -> None:
        """Open the hardware and start the tasks; raises HalError when it cannot be opened."""
        # in a replay the recorded hardware reports again
        needs_simulated = self._virtual and self._through is None
        if needs_simulated and not self.hal.capabilities.simulated:
            raise ConfigError(f"--speed: the HAL '{self.hal.name}' is not simulated and runs in real time only")
        configured = self.config.sensors if self._sensing else {}
        made = {name: self.make_sensor(name, settings) for name, settings in configured.items()}
        for name, sensor in made.items():
            if needs_simulated and not sensor.simulated:
                raise ConfigError(f"--speed: the sensor '{name}' is not simulated and runs in real time only")
        # from here on `stop` closes it, even if opening fails half-way
        self._open = True
        garbage.begin(real_time=not self._virtual)
        for each in self.additions:
            if each.addition.watch:
                context = additions.Contained(each, each.addition.watch, self, self.tell)
                await self._watching.enter_async_context(context)
        await settled(f"the HAL '{self.hal.name}'", "opened", self.hal.open)
        if self._sensing:
            self.journal.report("hal", "hardware", self.hal.name, self.hal.capabilities)
        for name, priority, period, task in self._make_tasks(self):
            if period is None:
                watched = self.journal.watched(name, task, len(self._reports), False)
                self._notify_serial = self.scheduler.add_sporadic(name, priority, watched)
                self._reports.add(name, priority, None)
            else:
                self._add(name, priority, period, task)
        for name, sensor in made.items():
            await self._open_sensor(name, sensor, configured[name].period)
        for addition, settings in self.additions:
            if addition.prepare:
                with additions.blamed(addition.name, addition.prepare):
                    self.parts.append(await additions.load(addition.prepare)(self, settings))
        self.scheduler.start()

    async def stop(self) -> None:
        """Make the outputs neutral, stop the tasks and release the hardware; harmless when stopped already."""
        if not self._open:
            return
        ended = self._begin("end")
        self._open = False
        self.gate.disarm("the run has ended")
        # all of it is done, even if a part fails; last in, first out
        async with AsyncExitStack() as stack:
            stack.push_async_callback(self._watching.aclose)
            stack.push_async_callback(settled, f"the HAL '{self.hal.name}'", "closed", self.hal.close)
            stack.push_async_callback(self.sensors.close)
            stack.callback(garbage.end)
            stack.callback(lambda: self.bus.flush(ended if self.watch is None else self.now))
            if self.watch is not None:
                stack.push_async_callback(standstill.settle, self.watch, self.io, lambda: self.now)
            stack.callback(self.scheduler.stop)
            # after a failure it was made safe already, as far as possible
            if not self.failed:
                self.make_safe(self.now)

    def make_sensor(self, name: str, options: SensorConfig | None = None) -> Sensor[Any]:
        """Make a sensor, not yet opened, from ``sensors.NAME`` of the configuration or from the given options.

        Raises ConfigError: the driver is unknown, or its settings are wrong; HalError: it cannot be imported or made.
        """
        # a plain robot has none, so it is imported when it is needed
        from txt1.sensors.registry import create

        given = self.config.sensors[name] if options is None else options
        pose = (lambda: self.look().pose) if self.hal.capabilities.pose else None
        return create(given, Setup(name, given.options, self.config, pose, self.hal, lambda: self.gate.armed))

    async def open_sensor(self, name: str, options: SensorConfig) -> None:
        """Open a sensor that is not in the configuration; a replay gives its readings again."""
        await self._open_sensor(name, self.make_sensor(name, options), options.period)

    async def _open_sensor(self, name: str, sensor: Sensor[Any], period: float | None) -> None:
        own = partial(self._add, named=self.bus.wanted(inputs.INPUT))
        given = sensor if self._through is None else self._through(name, sensor)
        await self.sensors.add(name, given, period, own, self.journal.reading)

    def guard(self, name: str, guard: Guard) -> None:
        """Let a guard lower every set-point in the safety gate.

        If it fails, it is reported once and then allows 0, and `txt1 run` ends.
        """
        # a plain robot has no guards
        from txt1.control.guarding import add

        add(self, name, guard)

    def part(self, kind: type[T]) -> T | None:
        """Return the object of this class that an addition has put into `parts`; None if there is none."""
        return next((part for part in self.parts if isinstance(part, kind)), None)

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.scheduler.now

    def post(self, message: Message, time: float) -> None:
        """Give the serial task a message; `time` (s of the run) is when its author made it."""
        if self.bus.wanted(inputs.INPUT) or self.bus.wanted(inputs.COMMAND):
            now = self._begin(type(message).__name__, "", numbers(message), time)
            if type(message) is Velocity:
                self.bus.publish(inputs.COMMAND, message, now)
        self.put(message, time)

    def answer(self, accepted: bool) -> None:
        """Take the board's answer to a set of gains."""
        (self.post if self._witnessed else self.put)(PidResponse(accepted), self.now)

    def put(self, message: Message, time: float) -> None:
        """Give the serial task a message of the robot itself, which a replay makes again."""
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
        """Whether the host is heard and a board, if there is one, answers."""
        board = self.state.board
        return self.state.link.alive and (board is None or board.ready)

    def arm(self) -> None:
        """Open the safety gate; raises NotArmed with the reason why it may not be opened now."""
        now = self._begin("arm")
        line = self.config.serial
        held = self.config.hal == "serial" and line.control == "host" and not line.allow_host
        reason = reason_not_to_arm(self.state, self.hal, self.io, self.watch, held, now)
        if reason is None and self._ran_away:
            reason = reason_after_runaway(self._rolls_until, self._seen_later, self.stands(now), now)
        if reason is not None:
            raise NotArmed(reason, remedy="")
        self._ran_away = False
        self.gate.arm(now)
        self.state.tell(now, "armed")

    def refuse_hasty(self) -> None:
        """Raise NotArmed within a second after a safety rule has disarmed it: nobody has looked yet."""
        if self.gate.closed_by is not None and self.now - self._closed_at < LOOK_FIRST:
            raise NotArmed(f"look first, then press again: {self.gate.told}", remedy="")

    def reason_not_to_switch(self, switch: Switch, on: bool, now: float) -> str | None:
        """Return why a supply may not be turned on or off at `now`, with the remedy; None if it may."""
        can, stands = self.hal.capabilities, self.stands(now)
        return standstill.reason_not_to_switch(switch, on, self.state, can, self.gate, self.watch, stands)

    def stands(self, now: float) -> bool:
        """Whether the robot was seen to stand, and still stands at `now`.

        After a runaway nothing was seen before it has had time to roll out: its encoders may be dead.
        """
        return now >= self._rolls_until and standstill.stands(self.state, self.watch, now)

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
        """Disarm after the computer was suspended for `duration` s, as all commands are out of date."""
        now = self._begin("slept", values=(duration,))
        self.gate.slept(duration, controller.CONTROL_PERIOD)
        if not self.gate.armed:
            self.make_safe(now)

    def place(self, x: float, y: float, theta: float) -> None:
        """Put a simulated robot down at a pose in the room (see `Hal.place`)."""
        self.io.place(x, y, theta, self._begin("place", values=(x, y, theta)))
        for told in self.on_place:
            told()

    def look(self) -> Inputs:
        """Return the hardware's report now, for a task of the user's; looking at a simulation moves it on."""
        return self.io.read(self._begin("look"))

    def tell(self, text: str) -> None:
        """Add a line to the event log."""
        self.state.tell(self._begin("tell", text), text)

    def make_safe(self, now: float) -> None:
        """Put neutral outputs on the hardware at `now`, without waiting for a tick."""
        self.io.write(self.gate.neutral(self.state.servos), now)

    def add_task(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task of the user's (see `Scheduler.add`)."""
        self._begin("task", name, (float(priority), period), 0.0)
        self._add(name, priority, period, task, named=self.bus.wanted(inputs.INPUT))

    def add_own_task(self, name: str, priority: int, period: float, task: PeriodicTask) -> None:
        """Add a periodic task of the robot's own, which a replay runs again."""
        self._add(name, priority, period, task)

    def _add(self, name: str, priority: int, period: float, task: PeriodicTask, named: bool = False) -> None:
        self.scheduler.add(name, priority, period, self.journal.watched(name, task, len(self._reports), named))
        self._reports.add(name, priority, period)

    def faults(self) -> dict[str, int]:
        """Counts of everything that was refused, clipped or lost so far, by the fault's name."""
        counted = {fault.value: count for fault, count in self.gate.counts.items()} | self.state.line_faults
        return counted if self.state.board is None else counted | self.state.board.faults

    def statistics(self) -> dict[str, TaskStatistics]:
        """The statistics of every task so far, by name."""
        return self.scheduler.statistics()

    def _begin_sampling(self) -> None:
        # below every task of the robot's and the user's: it sees the results of the same instant
        self._add("telemetry", -100, controller.CONTROL_PERIOD, self._sample)

    async def _sample(self, ticks: Ticks) -> None:
        async for now in ticks:
            self.bus.sample(now)

    def _gate_closed(self, reason: str) -> None:
        if self.gate.closed_by is Fault.RUNAWAY:
            # only some hardware knows, for example a simulation
            blocked = self.hal.blocked_by()
            at_rest = blocked is not None and reason in (BLOCKED, LOST)
            self._ran_away = True
            # without its motor it rolls out; only the next drive shows whether its encoders count
            lost = reason is LOST
            self._seen_later = self.hal.capabilities.blind or lost
            self._rolls_until = self.now + (0.0 if at_rest else coasting_time(self.gate.limits.runaway_speed))
            if blocked is not None:
                self.gate.reason = reason = f"blocked: {blocked}" if at_rest else f"{reason}: it is at {blocked}"
            elif reason is LOST and self.state.battery.state in (fields.BatteryState.WARNING, fields.BatteryState.BAD):
                self.gate.reason = reason = f"{reason}; the battery is empty"
            if lost and self.watch is not None:
                self.watch.lose_sight(self.now)
        if self.gate.closed_by is not None:
            self._closed_at = self.now
        self.state.tell(self.now, f"disarmed: {self.gate.told}")

    def _task_failed(self, name: str, error: BaseException) -> None:
        if self.journal.source:
            self._begin("failure", str(error))
            self.journal.source = ""
        self.failed = True
        self.gate.disarm(f"task '{name}' failed: {error}", Fault.TASK)
        # the hardware itself may have failed; the first error is the important one
        with suppress(Exception):
            self.make_safe(self.now)
