"""A robot on the desk that is driven, struck by faults, and watched from outside the safety gate.

There are seven kinds of hardware. Three close their loops in the host (the simulation, a Raspberry Pi's servo board) or
in a board of this protocol (ours, the originals', the Pico's firmware); two are motor controllers of other makers.
"""

import asyncio
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from math import inf, log
from random import Random
from typing import Any, Final

import numpy as np

from rigs.ros_ends import ROS_ENDS
from torture.visitors import Web
from txt1.board.board import Board, BoardEvent, VirtualPort
from txt1.bridges.registry import RobotEnd
from txt1.cars.pico.virtual_pico import port as pico_port
from txt1.cars.vesc.driver import SCALES, PacketId, Unpacker, VescHal, VescOptions
from txt1.cars.vesc.virtual_vesc import VESC_TIMEOUT
from txt1.cars.vesc.virtual_vesc import port as vesc_port
from txt1.cars.waveshare.driver import PWM, SPEED, Lines, WaveshareHal, WaveshareOptions
from txt1.cars.waveshare.virtual_rover import HEARTBEAT_MS
from txt1.cars.waveshare.virtual_rover import port as waveshare_port
from txt1.config import Config, checked, load
from txt1.control.commander import PRIORITIES
from txt1.control.standstill import Stop
from txt1.errors import CommandRefused, NotArmed, NotCapable, StopNotVerified
from txt1.fleet.link import FleetLink
from txt1.hal.base import Button, Hal, Inputs, Outputs
from txt1.hal.registry import create
from txt1.hal.serial import SerialHal
from txt1.hal.simulated_controller import Controller, ControllerPort
from txt1.link.base import End
from txt1.link.impairments import Through
from txt1.model.vehicle import STEERING_MAX
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role
from txt1.protocol.messages import HostMessage, PwmTest, Switch, Velocity
from txt1.robot import Robot
from txt1.sim.parameters import LineFaults, VehicleParameters
from txt1.sim.random_streams import random_stream
from txt1.sim.serial_line import Arrival, SerialLine
from txt1.sim.vehicle import Vehicle

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
UPRIGHT: Final = ("sensors.imu.driver=sim_imu", "roll_guard.enabled=true")
TICK: Final = 0.02  # s, of the controller
FRESH: Final = 0.25  # s for which a command is good
EPSILON: Final = 1e-6  # s
ESC_SILENCE: Final = 2.2  # s without a set-point before that, by which the board's loops forget what they wound up
ESC_TIME: Final = 3.5  # s until the ESC of a board is on again
LINK_RULE: Final = 2.0  # s within which a board without a host stands still by itself
MOVES: Final = 0.05  # m/s above which it does not stand
CREEPS: Final = 0.1  # the same with an original board, which reads 0 below 0.045 m/s and hunts about that
OWN: Final = VehicleParameters()
RULES: Final = {"sim": 0.2, "pi": 0.4, "vesc": 0.5 + VESC_TIMEOUT, "waveshare": 0.5 + HEARTBEAT_MS / 1000.0}
"""Within which time, s, outputs rest by themselves; where not told, 0.5 s and a board's LINK_RULE."""
VEHICLES: Final = {"pi": "donkeycar", "vesc": "f1tenth", "waveshare": "rover"}
WATCHDOG: Final = 26  # the pin that feeds the servo board's watchdog


class Broken(Exception):
    """An invariant does not hold."""


def coasting(v: float, vehicle: VehicleParameters = OWN) -> float:
    """The time in s that the vehicle takes from a speed in m/s until it stands, its motor neutral."""
    return vehicle.coast_time_constant * log((abs(v) + vehicle.coast_friction) / vehicle.coast_friction)


class Way:
    """One direction of a line that can be spoilt and mended while it carries."""

    ends = inf

    def __init__(self, rng: Random) -> None:
        self._rng = rng
        self._line: SerialLine | None = None
        self._last = 0.0

    @property
    def merges(self) -> bool:
        """Whether pieces that arrive together arrive as one."""
        return self._line is not None and self._line.merges

    def spoil(self, faults: LineFaults | None, now: float) -> None:
        """Give it these faults from now on; None: mend it."""
        self._line = None if faults is None else SerialLine(faults, self._rng, start=now)

    def carry(self, data: bytes, now: float) -> list[Arrival]:
        """What arrives of a piece, and when; never before what was given earlier."""
        pieces = [(now, data)] if self._line is None else self._line.carry(data, now)
        arrivals = []
        for when, piece in pieces:
            self._last = max(self._last, when)
            arrivals.append((self._last, piece))
        return arrivals


class Desk:
    """The robot, the hands that drive it, and the eyes that watch it."""

    def __init__(self, kind: str, robot: Robot, port: Any, ways: tuple[Way, Way], seed: int) -> None:
        self.kind = kind
        self.robot = robot
        self._limits = limits = robot.config.limits()
        self.v_max, self.omega_max, self.radius = limits.v_max, limits.omega_max, limits.radius_min or 0.3
        self.v, self.omega = 0.5, 0.0
        """Where the program drives, m/s and rad/s."""
        self.cycles = self.moving = 0
        self.signs: dict[str, float] = {}
        """When each hand gave its last sign, s of the run, by the name of its source."""
        self._port = port
        self._ways = ways
        self._rng = np.random.default_rng([seed, 99])
        self._sources = {name: robot.source(name) for name in ("keys", "gamepad")}
        self._sources["program"] = robot.program
        self._tasks: set[asyncio.Task[None]] = set()
        self._failure: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._quiet_until = 0.0
        self._may_arm_at = 0.0
        self._false_until = self._bad_line_until = self._flips_until = self._silent_until = -inf
        # what the watch knows
        self._given = -inf  # when the newest command was given that may move it, s of the run
        self._given_nonzero = False
        self._armed_at = inf
        self._arms = 0
        self._was_armed = robot.armed
        self._stopped = False
        self._could_move = -inf  # when it last was allowed to, s of the run
        self._speed = 0.0  # the largest since
        self._sent: tuple[float, Velocity] = (-inf, Velocity(0.0, 0.0))
        self._decoder = Decoder(Role.BOARD)
        self._packets, self._lines = Unpacker(), Lines()
        self._ends: dict[str, RobotEnd] = {}
        self._sources["ros"] = self.end("ros").source
        # hands of their own, so that what they do is told from what others do in the name of keys and gamepad
        self._sources |= {name: robot.source(name, PRIORITIES["keys"]) for name in ("hand", "radio pad")}
        self.web = Web(self)
        """The web page's server."""
        self._sources["web"] = self.web.end.source
        self._watch_writes()

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.robot.now

    @property
    def board(self) -> Board | None:
        """The virtual board behind the line, if there is one."""
        return self._port.board if isinstance(self._port, VirtualPort) else None

    @property
    def device(self) -> Any:
        """What is at the far end of the line, or holds the outputs of a Raspberry Pi; None: there is nothing else."""
        if isinstance(self._port, ControllerPort):
            return self._port.device
        return self.board or getattr(self.robot.hal, "_keeper", None)

    @property
    def vehicle(self) -> Vehicle:
        """The simulated vehicle."""
        for place in (self.board, self.device, getattr(self.device, "car", None), getattr(self.device, "hal", None)):
            vehicle: Vehicle | None = getattr(place, "vehicle", None)
            if vehicle is not None:
                return vehicle
        simulated: Any = self.robot.hal
        vehicle = simulated.vehicle
        assert isinstance(vehicle, Vehicle)
        return vehicle

    # -- hands ---------------------------------------------------------------------------------------------------------

    def command(self, source: str, v: float, omega: float, time: float | None = None) -> None:
        """Command as one of the sources."""
        with suppress(CommandRefused):
            if self._sources[source].command(v, omega, time):
                self._note(self.now if time is None else time)

    def hold(self, source: str, v: float, omega: float, time: float | None = None) -> None:
        """Command as a hand that holds."""
        with suppress(CommandRefused):
            if self._sources[source].hold(v, omega, time):
                self._note(self.now if time is None else time)

    def let_go(self, source: str) -> None:
        """Let a hand go."""
        self._sources[source].release()
        self._note(self.now)

    def post(self, message: HostMessage, time: float) -> None:
        """Hand the robot a message past the API."""
        self.robot.runtime.post(message, time)
        if isinstance(message, Velocity) and abs(message.v) < inf and abs(message.omega) < inf and time <= self.now:
            self._note(time)

    def pwm_test(self, motor: int, front: int, rear: int) -> None:
        """Set the outputs by hand."""
        with suppress(CommandRefused):
            self.robot.pwm_test(motor, front, rear)
            self._note(self.now)

    def _note(self, time: float) -> None:
        self._given = max(self._given, time)

    def arm(self) -> None:
        """Arm, if that may be."""
        self._arms += 1
        try:
            self.robot.arm()
        except NotArmed:
            self._arms -= 1
            return
        self._armed_at, self._stopped = self.now, False

    def stop(self, again: float) -> None:
        """Emergency stop; the operator arms after so many s."""
        self.robot.stop()
        self._stopped = True
        self._may_arm_at = self.now + again

    def disarm(self, again: float) -> None:
        """Disarm; the operator arms after so many s."""
        self.robot.disarm()
        self._may_arm_at = self.now + again

    def switch(self, switch: Switch, on: bool) -> None:
        """Turn a supply on or off; behind a line the ESC comes on while disarmed only, and takes its time."""
        if switch is Switch.ESC and on and self.kind != "sim":
            self.disarm(ESC_TIME)
            self._silent_until = self.now + ESC_SILENCE + TICK
        with suppress(CommandRefused, NotCapable):
            self.robot.switch_power(switch, on)

    def press_centre(self) -> None:
        """Press the button on the board."""
        if self.board is not None:
            self.board.happen(BoardEvent("centre"))
            return
        self.device.buttons = Button.CENTRE
        self.later(0.2, lambda: setattr(self.device, "buttons", Button.NONE))

    def noted(self) -> None:
        """Note that somebody has commanded now."""
        self._note(self.now)

    def end(self, name: str, requests: Mapping[str, Callable[..., object]] | None = None) -> RobotEnd:
        """The robot's end of a bridge, which is not there itself."""
        if name not in self._ends:
            makers: dict[str, Callable[[Robot], RobotEnd]] = {
                **ROS_ENDS,
                "fleet": lambda robot: RobotEnd(robot, "fleet", FleetLink(robot).requests),
                "gamepad": lambda robot: RobotEnd(robot, "pad", {}),
                "web": lambda robot: RobotEnd(robot, "web", requests or {}),
            }
            self._ends[name] = makers[name](self.robot)
        return self._ends[name]

    def load_gains(self) -> None:
        """Send the right gains again."""

        async def load() -> None:
            await self.robot.load_gains(timeout=3.0)

        self.spawn(load())

    def drives_until_quiet(self, duration: float) -> None:
        """Let the program fall silent for so many s."""
        self._quiet_until = self.now + duration

    def mend(self, **faults: Any) -> None:
        """Mend parts of the vehicle."""
        self.vehicle.faults = replace(self.vehicle.faults, **faults)

    def falsify(self, duration: float, change: Callable[[tuple[int, int]], tuple[int, int]]) -> None:
        """Change what the encoders say for a while."""
        hal: Any = self.robot.hal if self.board is None else self.board.runtime.hal
        if self.kind == "pico":
            hal = self.device.hal
        if "read" in vars(hal):
            return  # one at a time
        right = hal.read

        def read(now: float) -> Inputs:
            inputs: Inputs = right(now)
            return inputs if inputs.ticks is None else inputs._replace(ticks=change(inputs.ticks))

        self._false_until = self.now + duration
        hal.read = read
        self.later(duration, lambda: delattr(hal, "read"))

    def spoil_line(self, faults: LineFaults, duration: float, ways: tuple[bool, bool] = (True, True)) -> None:
        """Put faults on the line for a while, on the ways out and in."""
        loop = asyncio.get_running_loop()
        for way, wanted in zip(self._ways, ways, strict=True):
            if wanted:
                way.spoil(faults, loop.time())
        self._bad_line_until = max(self._bad_line_until, self.now + duration + 0.5)
        if faults.flip:
            self._flips_until = max(self._flips_until, self.now + duration + RULES["waveshare"])
        self.later(duration, lambda: [way.spoil(None, loop.time()) for way in self._ways] and None)

    # -- what goes on meanwhile ----------------------------------------------------------------------------------------

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Let something go on; an error of it ends the run."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None and not self._failure.done():
            self._failure.set_exception(task.exception() or Broken())

    def later(self, delay: float, action: Callable[[], object]) -> None:
        """Do something after so many s."""

        async def wait() -> None:
            await asyncio.sleep(delay)
            action()

        self.spawn(wait())

    def insist(self, duration: float, action: Callable[[], object]) -> None:
        """Do something every 20 ms for so many s."""

        async def repeat() -> None:
            ends = self.now + duration
            while self.now < ends:
                action()
                await asyncio.sleep(TICK)

        self.spawn(repeat())

    async def drive(self, duration: float) -> None:
        """Drive about for so many s, arm whenever that may be, and watch; raises what broke."""
        self.spawn(self._program())
        self.spawn(self._operator())
        self.spawn(self._watch())
        try:
            with suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(self._failure), duration)
            if self._failure.done():
                self._failure.result()
        finally:
            for task in list(self._tasks):
                task.cancel()
            self._failure.cancel()

    async def _program(self) -> None:
        rng, changes = self._rng, 0.0
        while True:
            now = self.now
            if now >= changes:
                changes = now + rng.uniform(2.0, 4.0)
                self.v = float(rng.uniform(0.25, min(self.v_max, 1.3)) * rng.choice((1.0, 1.0, -1.0)))
                self.omega = float(rng.uniform(-1.0, 1.0) * abs(self.v) / max(self.radius, 0.3))
            if now >= self._quiet_until:
                if self.robot.program.overruled and self.robot.driver.name == "":
                    self.robot.program.request()  # whoever took the wheel has let go of it
                self.command("program", self.v, self.omega)
            await asyncio.sleep(0.05)

    async def _operator(self) -> None:
        while True:
            if not self.robot.armed and self.now >= self._may_arm_at:
                power = self.robot.runtime.state.power
                if power.atx is False or self.robot.stop_state is Stop.UNSEEN:  # it looked at the car
                    self.switch(Switch.ATX, True)
                elif self.kind != "sim" and power.esc is False:
                    self.switch(Switch.ESC, True)
                else:
                    self.arm()
            await asyncio.sleep(0.2)

    # -- eyes ----------------------------------------------------------------------------------------------------------

    def _watch_writes(self) -> None:
        hal: Any = self.robot.hal
        write = hal.write

        def written(outputs: Outputs, now: float) -> None:
            self._check_outputs(outputs)
            write(outputs, now)

        hal.write = written
        if isinstance(hal, SerialHal):
            hal.tap_line(self._on_the_line)
        elif isinstance(hal, VescHal | WaveshareHal):
            hal.line.tap = self._to_a_controller  # what a controller is told, before it is obeyed

    def _may_move(self) -> bool:
        """Whether armed, on a command that is fresh: told without asking the safety gate's judgement of commands."""
        fresh = self._given >= self._armed_at and self.now - self._given <= FRESH + TICK + EPSILON
        return self._was_armed and self.robot.armed and fresh and not self._stopped

    def _check_armed(self) -> None:
        armed = self.robot.armed
        if armed and not self._was_armed and not self._arms:
            raise Broken("it is armed, and nobody armed it")
        if not armed or (armed and not self._was_armed):
            self._arms = 0
        self._was_armed = armed

    def _check_outputs(self, outputs: Outputs) -> None:
        """Check what the tasks want the hardware to do."""
        self._check_armed()
        motor, front, rear, pwm4, pwm5, v, omega = outputs
        limits = self._limits
        if not (
            all(type(count) is int for count in outputs[:5])
            and abs(motor) <= limits.motor_max
            and max(abs(front), abs(rear)) <= STEERING_MAX
            and max(abs(pwm4), abs(pwm5)) <= 24000
            and abs(v) <= limits.v_max
            and abs(omega) <= limits.omega_max
            and (limits.radius_min == 0.0 or abs(omega) <= abs(v) / limits.radius_min + 1e-12)
        ):
            raise Broken(f"outputs outside the limits: {outputs}")
        if any((motor, front, rear, v, omega)) and not self._may_move():
            given = self.now - self._given
            raise Broken(f"outputs {outputs} while armed={self.robot.armed}, the newest command {given:.3f} s old")

    def _on_the_line(self, direction: str, data: bytes) -> None:
        """Check what goes to the board."""
        if direction != "out":
            return
        for message in self._decoder.feed(data):
            if isinstance(message, Velocity):
                self._sent = self.now, message
                if not (message.v or message.omega):
                    continue
                if self._may_move():
                    self._could_move = self.now
                elif self.now - self._could_move > TICK + EPSILON:
                    raise Broken(f"{message} goes to the board, armed={self.robot.armed}")
            elif isinstance(message, PwmTest) and any((message.motor, message.front, message.rear)):
                raise Broken(f"{message} goes to a board that closes its own loops")

    def _to_a_controller(self, direction: str, data: bytes) -> None:
        """Check what goes to a motor controller."""
        if direction != "out":
            return
        asked = self._asked_of_a_vesc(data) if self.kind == "vesc" else self._asked_of_a_rover(data)
        for what, value in asked:
            if not value:
                continue
            if self._may_move():
                self._could_move = self.now
            elif self.now - self._could_move > TICK + EPSILON:
                raise Broken(f"{what} {value:g} goes to the controller, armed={self.robot.armed}")

    def _asked_of_a_vesc(self, data: bytes) -> Iterator[tuple[str, float]]:
        for payload in self._packets.feed(data):
            if payload[0] in (PacketId.SET_RPM, PacketId.SET_DUTY, PacketId.SET_CURRENT):
                command = PacketId(payload[0])
                yield command.name, int.from_bytes(payload[1:5], signed=True) / SCALES[command]

    def _asked_of_a_rover(self, data: bytes) -> Iterator[tuple[str, float]]:
        for found in self._lines.feed(data):
            if found.get("T") in (SPEED, PWM):
                yield from (("right", found["R"]), ("left", found["L"]))

    async def _watch(self) -> None:
        hal, last, up_since = self.robot.hal, self.now, -inf
        while True:
            self._check_armed()
            if isinstance(self.device, Controller):
                await self.device.ended(0.0)  # raises what went wrong inside
            now, v = self.now, abs(self.vehicle.state.v)
            if now - last > 2.0 * TICK:  # the process stood still: what it has to do in time counts from now
                self._could_move, self._speed = now, v
            last = now
            self.cycles += 1
            self.moving += v > MOVES
            if self._may_move() or self.kept_moving_by is not None:
                self._could_move, self._speed = now, v
            else:
                self._check_standing(now - self._could_move, v)
            if not isinstance(hal, SerialHal) or hal.line.link is None:
                up_since = now
            elif now - max(self._could_move, up_since, self._silent_until) > 2.0 * TICK + EPSILON:
                sent = self._sent[1]
                if (sent.v or sent.omega) and self._sent[0] > self._could_move - FRESH:
                    raise Broken("no zero went to the board within a tick")
            await asyncio.sleep(TICK)

    def _check_standing(self, since: float, v: float) -> None:
        """Check that it stands still in time: `since` is how long it may not move any more, s."""
        if self.kind != "sim" or since < 3.0 * TICK:
            self._speed = max(self._speed, v)
        allowed = coasting(self._speed, self.vehicle.parameters) + RULES.get(self.kind, 0.5 + LINK_RULE)
        if v > (CREEPS if self.kind == "original" else MOVES) and since > allowed:
            raise Broken(f"{v:.2f} m/s, {since:.2f} s after it was allowed to move last (at most {allowed:.2f} s)")

    @property
    def kept_moving_by(self) -> str | None:
        """Why it may go on moving whatever the host does; None when it may not."""
        board = self.board
        unheard = self.now < self._bad_line_until or not self.robot.runtime.linked
        if board is not None and self.kind == "original" and board.runtime.state.panel.manual and unheard:
            return "an original board in manual mode keeps its PWM, and cannot be told to leave it"
        if self.kind == "waveshare" and self.now < self._flips_until:
            return "a rover's line has no checksum, so a wrong digit of a command is a command"
        if (board is not None or self.kind == "pico") and self.now < self._false_until + 0.5:
            return "a board makes it stand by its encoders, and they lie"
        return None


def configuration(kind: str, seed: int, physics: str = "plain") -> Config:
    """The configuration of a robot of this kind on the desk, in a physics a vehicle that it models."""
    vehicle = VEHICLES.get(kind, "txt1") if physics in ("plain", "mujoco") else "f1tenth"
    chosen = [*ENDLESS, *(() if vehicle == "txt1" else (f"vehicle={vehicle}",))]
    hal = kind if kind in VEHICLES else "serial"
    if kind == "sim":
        # a car of other people's physics rolls over, from lock to lock at full speed, without its guard
        hal, chosen = "sim", [*chosen, *(() if physics == "plain" else (f"sim.physics={physics}", *UPRIGHT))]
    elif kind == "pi":
        way = ("brake_first", "direct")[seed % 2]  # of its ESC into reverse
        chosen += ["hal_options.bus=virtual", f"hal_options.watchdog={WATCHDOG}"]
        chosen += [f"hal_options.reverse={way}", f"hal_options.virtual_esc={way}"]
    elif kind in ("ours", "original"):
        chosen += ["serial.port=virtual", f"board.habits={kind}"]
    else:
        chosen += [f"serial.port={kind}"]
    return load(None, chosen, {}, {"hal": hal, "seed": seed}).config


def hardware(kind: str, config: Config, wrap: Callable[[End], End]) -> tuple[Hal, Any]:
    """The hardware layer of this kind on the desk, its line wrapped, and the port behind it, if there is a line."""
    if kind in ("sim", "pi"):
        return create(config), None
    port: Any
    if kind == "vesc":
        port = vesc_port(config)
        return VescHal(port, checked(VescOptions, config.hal_options, "hal_options"), config.geometry, wrap, True), port
    if kind == "waveshare":
        port, options = waveshare_port(config), checked(WaveshareOptions, config.hal_options, "hal_options")
        return WaveshareHal(port, options, config.geometry, wrap, True), port
    port = pico_port(config) if kind == "pico" else VirtualPort(config)
    return SerialHal(port, wrap, simulated=True), port


async def on_the_desk(
    kind: str,
    seed: int,
    duration: float,
    strikes: Callable[[Desk], Coroutine[Any, Any, None]],
    physics: str = "plain",
) -> Desk:
    """Drive a robot for so many s while `strikes` does things to it; raises what broke."""
    config = configuration(kind, seed, physics)
    rng = random_stream(seed, "ways")
    ways = Way(rng), Way(rng)
    hal, port = hardware(kind, config, lambda end: Through(end, lambda now: ways))
    held = False
    try:
        async with Robot.open(hal, config=config, arm=False) as robot:
            await robot.load_gains()
            desk = Desk(kind, robot, port, ways, seed)
            desk.spawn(strikes(desk))
            await desk.drive(duration)
            held = True
    except StopNotVerified:  # said at the end: a stop took more than zeros, or nobody saw it
        if not held or kind == "sim":
            raise
    return desk
