"""The robot as a user's program sees it: the services of the original's ROS driver, in one class (thesis 3.4.3)."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from functools import partial
from math import inf, nan
from typing import Any, Final, NamedTuple, TypeVar

from txt1.additions import Contained, blamed, priority_of
from txt1.config import Config, load, with_sections
from txt1.control.commander import Driver
from txt1.control.limits import Fault
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet
from txt1.control.standstill import Stop
from txt1.driver import REFRESH, CommandSource, Wheel, finite
from txt1.errors import (
    AdditionFault,
    CommandRefused,
    ConfigError,
    EncodeError,
    HalError,
    NotArmed,
    NotCapable,
    StopNotVerified,
)
from txt1.hal.base import Button, Hal
from txt1.hal.registry import create, in_world
from txt1.kernel.ticks import Ticks
from txt1.model.estimate import Estimate
from txt1.model.odometry import Odometry
from txt1.protocol.layout import encode
from txt1.protocol.messages import (
    PID_SET_PERIOD,
    BatteryLevels,
    BoardMessage,
    CombinedOdometry,
    EncoderOdometry,
    HostMessage,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
)
from txt1.runtime import Runtime
from txt1.sensors.base import Reading, Sensor
from txt1.sensors.polling import Polled
from txt1.sim.world import World
from txt1.tasks.controller import reason_not_to_move
from txt1.tasks.fields import Battery
from txt1.telemetry.snapshot import Snapshot
from txt1.telemetry.topics import Topic

# messages that a slow reader of a stream may lag behind before it loses the oldest
STREAM_MAX: Final = 1000

# command that powers the host down; the only command that this package ever runs
SHUTDOWN: Final = ("shutdown", "-h", "now")

T = TypeVar("T")


class Key(NamedTuple):
    """A key of the terminal."""

    meaning: str
    do: Callable[[], None]
    """Its action; it may raise Txt1Error to refuse."""


class Robot:
    """A running robot; `Robot.open` starts one.

    Commands are requests: they pass the safety gate. A velocity or PWM command is valid only for
    `safety.command_timeout` (0.25 s). So repeat it, or use `drive`, which repeats it.
    """

    def __init__(self, runtime: Runtime) -> None:
        self.runtime = runtime
        """Tasks, state and safety gate, for a closer look."""
        self.config = runtime.config
        """The effective configuration."""
        self.hal = runtime.hal
        """The hardware layer underneath."""
        self.sensors: Mapping[str, Polled[Any]] = runtime.sensors
        """The sensors that the hardware layer does not have itself, by name: last reading and health of each."""
        self._wheel = Wheel(runtime)
        self.program = self.source("program")
        """The source of commands behind `command` and `drive`."""
        self.gains_rejected = False
        """Whether the board refused the last gains that were sent to it."""
        self.touched = False
        """Whether an operator or a program has stopped or disarmed the robot since it started."""
        self.requests: dict[str, Callable[..., object]] = {}
        """Requests that bridges may make beyond driving, by name; an addition enters its own."""
        self.keys: dict[str, Key] = {}
        """Further keys of the terminal."""
        self.on_ready: list[Callable[[], Awaitable[None]]] = []
        """Functions, awaited in turn when the robot is ready to drive: linked, armed if wanted, gains loaded."""
        self.alongside: list[asyncio.Future[Any]] = []
        """Futures; the run ends when one of these is done, with its error if it has one."""
        self.unfinished: list[Callable[[], str]] = []
        """Functions that return why a run that ends by itself has not reached its aim; "" if it has."""
        self._pid_response: asyncio.Future[bool] | None = None
        self._streams: list[tuple[object, asyncio.Queue[Any]]] = []
        runtime.heard = lambda: bool(self._streams)

    @staticmethod
    @asynccontextmanager
    async def open(
        hal: str | Hal | None = None,
        *,
        config: str | os.PathLike[str] | Config | None = None,
        name: str | None = None,
        seed: int | None = None,
        world: World | None = None,
        settings: Sequence[str] = (),
        arm: bool | None = None,
        patience: float = 10.0,
        attach: Callable[[Runtime], None] | None = None,
        additions: Mapping[str, object] | None = None,
    ) -> AsyncIterator[Robot]:
        """Start a robot and wait for its link; it is stopped safely when the block is left.

        ``TXT1_`` variables of the environment are settings, as on the command line. On a simulated HAL the robot arms
        by itself. When a task fails, the robot is stopped and the block is left with a TaskFault.

        Args:
            hal: name of the hardware layer, or the hardware layer itself.
            config: a YAML file or a ready configuration.
            name: of this robot among several; it prefixes the topics, and gives the robot its own random values.
            seed: repeats every random value of a simulation.
            world: shared with other simulated robots on this event loop, instead of the configured room and obstacles.
            settings: ``a.b=c`` each, as with ``--set``.
            arm: whether to arm now; None leaves it to ``safety.auto_arm``.
            patience: s to wait for the link; with 0 it neither waits nor arms, and the caller does both.
            attach: called with the runtime before it starts, for example to record from the first tick on.
            additions: further additions that take part, by name, with their settings.

        Raises:
            ConfigError: a setting is wrong.
            HalError: the hardware cannot be opened, or the board does not answer.
            TaskFault: a task raised an exception; the cause is chained.
            StopNotVerified: zeros were not enough for a stop, or the robot was not seen to stand; raised when the
                block is left. An error that ended the block, or the TaskFault, is its cause.

        """
        given = {"hal": hal if isinstance(hal, str) else None, "name": name, "seed": seed}
        options = {key: value for key, value in given.items() if value is not None}
        if isinstance(config, Config):
            if settings:
                raise ConfigError("settings: they go on top of a file; a ready Config takes model_copy(update=...)")
            effective = config.model_copy(update=options)
        else:
            effective = load(config, settings, os.environ, options).config
        if additions:
            effective = with_sections(effective, additions)
        if world is not None:
            effective = in_world(effective, world)
        robot: Robot
        layer = create(effective, world) if hal is None or isinstance(hal, str) else hal
        runtime = Runtime(effective, lambda m: robot._receive(m), layer, sensing=True, asked=additions)
        robot = Robot(runtime)
        if attach is not None:
            attach(runtime)
        body = asyncio.current_task()
        assert body is not None
        inside, failed = True, False

        def interrupt(ended: asyncio.Future[None]) -> None:
            nonlocal failed
            # the block may have been left in the same turn of the loop: then the code after it must not be cancelled
            if not ended.cancelled() and ended.exception() is not None and inside:
                failed = True
                body.cancel()

        try:
            try:
                await runtime.start()
                runtime.scheduler.ended.add_done_callback(interrupt)
                runtime.add_task("driver", 3, REFRESH, robot._drive_messages)
                async with robot._beside():
                    if patience > 0.0:
                        await robot.linked(patience)
                        if robot.arms_by_itself if arm is None else arm:
                            robot.arm()
                        for begin in robot.on_ready:
                            await begin()
                    yield robot
            except (asyncio.CancelledError, AdditionFault, NotArmed) as error:
                if failed:
                    # the TaskFault is the real cause
                    body.uncancel()
                elif runtime.failed and isinstance(error, NotArmed):
                    # a command came between the fault and its report
                    failed = True
                else:
                    raise
            finally:
                inside = False
                await runtime.stop()
                for _, queue in robot._streams:
                    _put(queue, None)
            if failed:
                # raises the TaskFault
                await runtime.scheduler.ended
        except BaseException as first:
            if robot.trouble:
                raise StopNotVerified(robot.trouble) from first
            raise
        if robot.trouble:
            raise StopNotVerified(robot.trouble)

    @asynccontextmanager
    async def _beside(self) -> AsyncIterator[None]:
        """Run the additions that need a running robot."""
        async with AsyncExitStack() as stack:
            for each in self.runtime.additions:
                name, function = each.addition.name, each.addition.beside
                if function:
                    begun, to_begin = len(self.alongside), len(self.on_ready)
                    await stack.enter_async_context(Contained(each, function, self, self.tell))
                    self.alongside[begun:] = [_blamed(name, function, one) for one in self.alongside[begun:]]
                    self.on_ready[to_begin:] = [partial(_begin, name, function, on) for on in self.on_ready[to_begin:]]
            yield

    async def linked(self, timeout: float = inf) -> None:
        """Wait until host and board hear each other; raises HalError when they do not within `timeout` s."""
        ends = self.now + timeout
        while not self.runtime.linked:
            if self.now >= ends:
                board = self.runtime.state.board
                raise HalError(
                    f"no link after {timeout:g} s: {board.text if board else 'the host is not heard'}; is the board "
                    "on, is the baud rate right, is the cable crossed? 'txt1 doctor' looks closer"
                )
            await asyncio.sleep(REFRESH)

    # -- what the robot does now -------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.runtime.now

    @property
    def odometry(self) -> Odometry:
        """Pose from where odometry started (m, rad), and velocities (m/s, rad/s)."""
        return self.runtime.state.odometry

    @property
    def pose(self) -> tuple[float, float, float] | None:
        """True pose (x, y, theta) in the room, m and rad; None unless the HAL knows it, as in simulation."""
        return self.runtime.state.pose

    @property
    def estimate(self) -> Estimate | None:
        """Pose and velocities fused from all sensors, with covariance; None while ``estimation`` is off."""
        return self.runtime.estimate()

    @property
    def battery(self) -> Battery:
        """Voltages (V), state and remaining time (s)."""
        return self.runtime.state.battery

    @property
    def armed(self) -> bool:
        """Whether the robot is armed, that is, the safety gate is open."""
        return self.runtime.gate.armed

    @property
    def arms_by_itself(self) -> bool:
        """Whether the robot arms by itself at the start, by ``safety.auto_arm``."""
        auto_arm = self.config.safety.auto_arm
        return auto_arm == "always" or (auto_arm == "auto" and self.hal.capabilities.simulated)

    @property
    def arms_again(self) -> bool:
        """Whether a lost link has disarmed the robot, and ``serial.rearm`` will arm it when the link is back."""
        return self.config.serial.rearm and self.runtime.gate.closed_by is Fault.LINK

    @property
    def reason(self) -> str:
        """Why the gate is closed; empty while it is open."""
        return self.runtime.gate.reason

    @property
    def told(self) -> str:
        """Why the gate is closed, as people are told: the remedy first; empty while it is open."""
        return self.runtime.gate.told

    @property
    def stop_state(self) -> Stop | None:
        """Progress of the last stop, if stops are verified; None for a simulation, which always obeys its outputs."""
        return None if self.runtime.watch is None else self.runtime.watch.standstill.stop

    @property
    def trouble(self) -> str:
        """Why a stop of this run failed, or was not seen to end; "" if zeros were enough each time."""
        return "" if self.runtime.watch is None else self.runtime.watch.trouble

    @property
    def faults(self) -> dict[str, int]:
        """Counts of everything that was refused, limited or lost so far, by the fault's name."""
        return self.runtime.faults()

    @property
    def snapshot(self) -> Snapshot:
        """The present values of all topics."""
        return self.runtime.snapshot()

    def odometry_stream(self) -> AsyncIterator[EncoderOdometry]:
        """Every odometry message from now on, 20 a second; ends with the run."""
        return self._stream(EncoderOdometry)

    def battery_stream(self) -> AsyncIterator[BatteryLevels]:
        """Every battery message from now on, one a second; ends with the run."""
        return self._stream(BatteryLevels)

    # -- sensors beside those of the hardware layer -------------------------------------------------------------

    def sensor(self, name: str) -> Reading[Any] | None:
        """The last reading of a sensor: its value, and the time (s of the run) at which it was taken; None: none yet.

        Raises ConfigError: there is no sensor of that name.
        """
        try:
            return self.sensors[name].last
        except KeyError:
            there = ", ".join(self.sensors) or "none"
            raise ConfigError(f"sensors.{name}: there is no such sensor; there are: {there}") from None

    def sensor_stream(self, name: str) -> AsyncIterator[Reading[Any]]:
        """Every reading of a sensor from now on; ends with the run."""
        self.sensor(name)
        return self._stream(self.sensors[name].sensor.topic)

    async def add_sensor(self, name: str, sensor: Sensor[T], period: float | None = None) -> Polled[T]:
        """Open a sensor of your own, read until the run ends; raises HalError, or ValueError: the name is taken."""
        return await self.runtime.sensors.add(name, sensor, period)

    # -- arming ------------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Let commands through, and release the emergency stop; raises NotArmed with the reason when it may not."""
        # earlier commands do not count
        self._wheel.commander.clear(self.now)
        self.runtime.arm()

    def arm_by_hand(self) -> None:
        """Arm, as `arm` does, for a key or a button: within a second after a stop by a safety rule it is refused."""
        self.runtime.refuse_hasty()
        self.arm()

    def disarm(self, reason: str = "disarmed by the program") -> None:
        """Stop, and let no command through until armed again."""
        self.touched = True
        self.runtime.disarm(reason)

    def stop(self) -> None:
        """Emergency stop: neutral outputs at once, latched until armed again."""
        self.touched = True
        self.runtime.emergency_stop()

    # -- driving -----------------------------------------------------------------------------------------------

    def source(self, name: str, priority: int | None = None, timeout: float | None = None) -> CommandSource:
        """Return a new source of commands, beside the keys, the live view and the program.

        Only one source at a time has the wheel (see `txt1.control.commander`); the higher priority wins. `priority`
        None means ``commander.priorities``, or else by the name: keys 50, gamepad 40, web 30, ros 20, any other 10.
        Commands are stale after `timeout` s; None means ``commander.timeouts``, or else the safety gate's.

        Raises ConfigError: the name is taken, or the time-out is longer than ``safety.command_timeout``.
        """
        commander = self.config.commander
        timeout = commander.timeouts.get(name) if timeout is None else timeout
        if priority is None:
            priority = commander.priorities.get(name, priority_of(name))
        try:
            self._wheel.commander.add(name, priority, timeout)
        except ValueError as error:
            raise ConfigError(str(error)) from None
        return CommandSource(name, self._wheel)

    @property
    def driver(self) -> Driver:
        """The driving source, the time since when it drives, and the number of refused commands of each source."""
        return self._wheel.driver

    def command(self, v: float, omega: float) -> bool:
        """Ask for a speed in m/s and a yaw rate in rad/s, for the next 0.25 s, as the source "program".

        Returns whether the command is the set-point now. It is not while a source of higher priority drives. After that
        source has let go, this source has to command zero once first (see `CommandSource.command`). Raises
        CommandRefused: a value is not finite; the command before stays in force until it is stale.
        """
        return self.program.command(v, omega)

    async def drive(self, v: float, omega: float, duration: float) -> None:
        """Drive at v m/s and omega rad/s for `duration` seconds, then command a stop.

        Raises CommandRefused: a value is not finite, the ESC is known to be off, or no gains are loaded; NotArmed: the
        gate is closed, or closes on the way; Overruled: another source drives, or takes the wheel on the way.
        """

        began = self.now

        def give() -> None:
            self.program.insist(v, omega)
            # a switch or gains sent just before take effect with the next tick
            late = (v or omega) and self.now > began
            if late and (reason := reason_not_to_move(self.runtime.state, self.hal.capabilities)):
                raise CommandRefused(reason)

        self.program.begin()
        await self._repeat(give, duration)
        self.program.release()

    def combined_odometry(self, x: float, y: float, theta: float, v: float, omega: float) -> None:
        """Offer odometry from better sensors than the encoders; only v (m/s) and omega (rad/s) are used.

        The loops use it while more than two messages a second come and the last is at most 0.1 s old.

        Raises CommandRefused: a value is not finite.
        """
        self._post(CombinedOdometry, x=x, y=y, theta=theta, v=v, omega=omega)

    async def load_gains(
        self, linear: Gains | None = None, angular: Sequence[GainSet] | None = None, timeout: float = 5.0
    ) -> bool:
        """Send the gains, by default the configured ones, once a second until they are acknowledged.

        Returns True if they were accepted, False if they were rejected or no answer came within `timeout` s. Raises
        CommandRefused: a gain is negative, not finite, or too large for the vehicle (`txt1.control.gains`) or for its
        field on the wire.
        """
        control = self.config.loops()
        gains = control.linear.gains() if linear is None else linear
        sets = control.schedule().sets if angular is None else angular
        try:
            kp, ki, kd = finite("linear gains", **gains._asdict())
            table = []
            for each in sets:
                v_max, *angular_gains = finite("angular gains", v_max=each.v_max, **each.gains._asdict())
                table.append((v_max, *Gains(*angular_gains)))
            message = PidSet((kp, ki, kd), tuple(table))
            encode(message)
            if wrong := self.config.gain_limits().refused((kp, ki, kd), [GainSet(v, Gains(*k)) for v, *k in table]):
                raise CommandRefused(": ".join(map(str, wrong)))
        except (CommandRefused, EncodeError) as error:
            # the gate counts it
            self.runtime.post(PidSet((nan, nan, nan), ()), self.now)
            raise CommandRefused(f"these gains are not loaded: {error}") from None
        answer: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._pid_response = answer
        ends = self.now + timeout
        while self.now < ends:
            self.runtime.post(message, self.now)
            with suppress(TimeoutError):
                return await asyncio.wait_for(asyncio.shield(answer), min(PID_SET_PERIOD, ends - self.now))
        return False

    # -- manual mode, servos and power -------------------------------------------------------------------------

    def press(self, button: Button) -> None:
        """Press a button of the joystick."""
        self.runtime.press(button)

    async def set_manual(self, manual: bool) -> None:
        """Enter or leave manual mode, where `pwm_test` sets the outputs; raises NotCapable without PWM.

        A real board enters it by its own button only; with `serial.allow_host` this says that it has.
        """
        self._require_hand()
        if bool(self.runtime.state.panel.manual) is not manual:
            self.press(Button.CENTRE)
            while self.runtime.state.panel.manual is not manual:
                await asyncio.sleep(REFRESH)

    def pwm_test(self, motor: int, front: int, rear: int, pwm4: int = 0, pwm5: int = 0) -> None:
        """Set all five PWM channels by hand, counts in [-24000, 24000], for the next 0.25 s.

        The motor is limited to `safety.motor_max` and the steering to +-18000.

        Raises CommandRefused: the robot is in controller mode, or a value is not finite; NotCapable: the HAL has no
        PWM.
        """
        self._require_hand()
        self._post(PwmTest, motor=motor, front=front, rear=rear, pwm4=pwm4, pwm5=pwm5)
        if not self.runtime.state.panel.manual:
            raise CommandRefused("a PWM test needs manual mode: call Robot.set_manual(True) or press c")

    async def hold_pwm(
        self, motor: int, front: int, rear: int, pwm4: int = 0, pwm5: int = 0, *, duration: float
    ) -> None:
        """Hold all five PWM channels by hand for `duration` seconds, then go neutral.

        Raises CommandRefused: as `pwm_test`; NotArmed: the gate is closed, or closes on the way.
        """
        await self._repeat(lambda: self.pwm_test(motor, front, rear, pwm4, pwm5), duration)
        self.pwm_test(0, 0, 0, pwm4, pwm5)

    def servos(self, pwm4: int, pwm5: int) -> None:
        """Move the two free servos, counts in [-24000, 24000]; they stay there.

        Raises NotCapable: the HAL has none; NotArmed: the gate is closed; CommandRefused: a value is not finite.
        """
        self._require("servos")
        if not self.armed:
            raise NotArmed(self.reason)
        self._post(PwmCommand, pwm4=pwm4, pwm5=pwm5)

    def switch_power(self, switch: Switch, on: bool) -> None:
        """Turn the ATX supply or the ESC on or off.

        The ESC of a board comes on 3.2 s later at the earliest: first the board's loops have to forget their integral
        part.

        Raises NotCapable: the HAL has no such switch; CommandRefused: it is not safe. The ATX supply feeds the encoders
        and the computer; it cannot be turned off while armed, or before the robot was seen to stand. A board's ESC
        goes off with it, and cannot be turned on without it or while armed.
        """
        self._require("power")
        reason = self.runtime.reason_not_to_switch(switch, on, self.now)
        self.runtime.post(PowerControl(switch, on), self.now)
        if reason is not None:
            raise CommandRefused(reason)

    def toggle_esc(self) -> None:
        """Turn the ESC on if it is known or was asked to be off, else turn it off; raises as `switch_power`."""
        self.switch_power(Switch.ESC, self.runtime.state.power.esc is False)

    async def shutdown_host(self) -> None:
        """Power the host down.

        Raises CommandRefused unless `host.allow_shutdown` is on and the robot is disarmed and was seen to stand. A
        robot without encoders only has to be disarmed.
        """
        if not self.config.host.allow_shutdown:
            raise CommandRefused("host shutdown is off: set host.allow_shutdown=true to allow it")
        if self.armed:
            raise CommandRefused("the robot is armed: call Robot.disarm() before shutting the host down")
        if not self.hal.capabilities.blind and not self.runtime.stands(self.now):
            raise CommandRefused(
                "the robot was not seen to stand: the host still watches it; ask again later, or shut it down by hand"
            )
        process = await asyncio.create_subprocess_exec(*SHUTDOWN)
        if await process.wait() != 0:
            raise CommandRefused(f"'{' '.join(SHUTDOWN)}' failed with exit code {process.returncode}")

    def place(self, x: float, y: float, theta: float) -> None:
        """Place a simulated robot at a pose in the room, at rest; m and rad. Its odometry goes on.

        Raises NotCapable: the robot is not simulated; ValueError: it would stick in a wall.
        """
        self._require("place")
        self.runtime.place(x, y, theta)

    # -- your own tasks ----------------------------------------------------------------------------------------

    def add_task(
        self, name: str, period: float, task: Callable[[Ticks], Coroutine[Any, Any, None]], priority: int = 0
    ) -> None:
        """Run your own coroutine beside the robot's tasks, with a period in seconds and a priority.

        ::

            async def circle(ticks):
                async for now in ticks:
                    robot.command(0.5, 0.5)

            robot.add_task("circle", 0.05, circle)
        """
        self.runtime.add_task(name, priority, period, task)

    def tell(self, text: str) -> None:
        """Add a line to the event log."""
        self.runtime.tell(text)

    async def _drive_messages(self, ticks: Ticks) -> None:
        """Run the driver: send a Velocity message in every period."""
        runtime, rearm = self.runtime, self.config.serial.rearm
        async for now in ticks:
            if rearm and self.arms_again and runtime.linked:
                # it may be disarmed for another reason, which may pass
                with suppress(NotArmed):
                    self.arm()
            self._wheel.tick(now)

    async def _repeat(self, give: Callable[[], None], duration: float) -> None:
        """Repeat a command for `duration` s, as long as the gate is open."""
        if not duration >= 0.0:
            raise CommandRefused(f"duration must be a number of seconds, not {duration!r}")
        ends = self.now + duration
        while True:
            if not self.armed:
                raise NotArmed(self.reason)
            give()
            left = ends - self.now
            if left <= 0.0:
                return
            await asyncio.sleep(min(REFRESH, left))

    def _post(self, kind: Callable[..., HostMessage], **values: float) -> None:
        """Post a message of these values; a value that is not finite is refused, and the gate counts it."""
        try:
            # given in the order of its fields
            message = kind(*finite(kind.__name__, **values))
        except CommandRefused:
            self.runtime.post(kind(**dict.fromkeys(values, nan)), self.now)
            raise
        self.runtime.post(message, self.now)

    def _require_hand(self) -> None:
        if self.config.hal == "serial" and not self.hal.capabilities.by_hand:
            raise NotCapable(
                "an original board in manual mode keeps its last PWM when this host dies: PWM by hand needs "
                "serial.allow_host=true, wheels off the ground, and the board's centre button"
            )
        self._require("by_hand")

    def _require(self, capability: str) -> None:
        if not getattr(self.hal.capabilities, capability):
            raise NotCapable(self.hal.name, capability)

    def _receive(self, message: BoardMessage) -> None:
        """Take a message from the board."""
        if isinstance(message, PidResponse):
            self.gains_rejected = not message.accepted
            if self._pid_response is not None and not self._pid_response.done():
                self._pid_response.set_result(message.accepted)
        for source, queue in self._streams:
            if source is type(message):
                _put(queue, message)

    async def _stream(self, source: type[BoardMessage] | Topic[Any]) -> AsyncIterator[Any]:
        """Yield all messages of a kind or readings of a topic; a slow reader loses the oldest."""
        stream = source, asyncio.Queue[Any](STREAM_MAX)
        self._streams.append(stream)
        leave = None
        if isinstance(source, Topic):
            leave = self.runtime.bus.subscribe(lambda _, value, time: _put(stream[1], Reading(time, value)), [source])
        try:
            while (item := await stream[1].get()) is not None:
                yield item
        finally:
            self._streams.remove(stream)
            if leave is not None:
                leave()


def _blamed(name: str, function: str, future: asyncio.Future[Any]) -> asyncio.Future[Any]:
    """Return a future that ends as an addition's future does; its error names the addition."""
    told: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

    def ended(future: asyncio.Future[Any]) -> None:
        if told.done() or future.cancelled():
            told.cancel()
            return
        try:
            with blamed(name, function):
                told.set_result(future.result())
        except Exception as error:
            told.set_exception(error)
            # whether or not its result is awaited
            told.exception()

    future.add_done_callback(ended)
    return told


async def _begin(name: str, function: str, begin: Callable[[], Awaitable[None]]) -> None:
    with blamed(name, function):
        await begin()


def _put(queue: asyncio.Queue[Any], item: object) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(item)
