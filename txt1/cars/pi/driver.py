"""A Raspberry Pi (3 to 5) on an R/C car as a HAL: PCA9685 servo board or GPIO pins, wheel encoders, battery sensor.

Another process, `txt1.cars.pi.guard`, owns the outputs. It sets them to neutral when this process is gone.
"""

import asyncio
import json
import os
import select
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from math import inf
from typing import Annotated, Final, Literal, NamedTuple, NoReturn, Protocol

from annotated_types import Ge, Le

from txt1.cars.pi import guard
from txt1.cars.pi.esc import BrakeFirst
from txt1.cars.pi.guard import ANSWER, GuardSetup, pulses_in
from txt1.config import Config, checked
from txt1.control.standstill import SPEED_MAX, coasting_time
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.hal.base import BoardLink, Capabilities, Inputs, Outputs
from txt1.hal.plain_hal import PlainHal
from txt1.hal.registry import BUSES, VIRTUAL
from txt1.installing import installs
from txt1.link.silence import Ladder
from txt1.model.channels import STRAIGHT, Channels
from txt1.model.odometry import Odometry, rolled
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry, sides
from txt1.units import Positive

# s without an answer from the guard
GUARD_SILENCE: Final = 0.3
# s for which a guard may leave pulses unanswered; then it is killed
HANGS: Final = 0.2
# s that a guard may take to end; then it is killed
ENDS: Final = 0.25
# s that a killed guard may take to end: Linux gives up a transfer on the bus after 0.05 s
DIES: Final = 1.0
# s that this process tries to put out neutral in place of a guard
WRITES: Final = 2.0
# s of neutral before the first other output, in which an ESC arms
ESC_ARM_TIME: Final = 1.0
# counts that are neutral: less than a servo board resolves
NEUTRAL_COUNTS: Final = 1.0
# s without an edge of an encoder after which the car stands
EDGE_SILENCE: Final = 0.1
# s for which the bus may fail, and then between the first two attempts to start a new guard
BUS_PATIENCE: Final = 2.0
# s that a guard may take to start, as Python on a Raspberry Pi 3; doubled each time that it was not enough
GUARD_START_TIME: Final = 10.0
NOT_NEUTRAL: Final = (
    "the outputs are perhaps not neutral: their guard was killed, and the bus fails; "
    "switch the ESC off, or take its battery out"
)
# us, limits of every output
PULSES: Final = (500.0, 2500.0)
UNKNOWN: Final = (
    "it does not drive backwards, as hal_options.reverse is not set: the step 'reverse' of txt1 calibrate finds it, "
    "with the wheels up"
)
GET_LGPIO: Final = (
    "from Python 3.13 on, where lgpio has no wheel: sudo apt install python3-lgpio, and an "
    "environment made with --system-site-packages"
)

Reverse = Literal["brake_first", "direct"]
Pulse = Annotated[float, Ge(PULSES[0]), Le(PULSES[1])]
Pin = Annotated[int, Ge(0), Le(27)]


@dataclass(frozen=True, slots=True)
class PiOptions:
    """Settings of the HAL, under `hal_options`."""

    output: Literal["pca9685", "gpio"] = "pca9685"
    """A servo board on the I2C bus, or GPIO pins."""
    bus: int | str = 1
    """Number of the I2C bus; `virtual`: a virtual servo board; or a file with the registers of a virtual one."""
    address: Annotated[int, Ge(3), Le(0x77)] = 0x40
    """I2C address of the servo board."""
    frequency: Annotated[float, Ge(40.0), Le(200.0)] = 50.0
    """Frequency of the pulses, Hz."""
    oscillator: Positive = 25e6
    """Oscillator of the servo board, Hz: many run at 26 to 27 MHz, so that pulses are too short."""
    motor: tuple[Pin, ...] = (0,)
    """Channel or GPIO number of the ESC; of a rover, right and left."""
    steering: tuple[Pin, ...] = (1,)
    """Channel or GPIO number of the steering servo; of a car that steers with both axles, front and rear."""
    motor_neutral: Pulse = 1500.0
    """Pulse at which the motor stands, us."""
    motor_range: float = 500.0
    """From neutral to full speed forward, us; negative if longer pulses drive backwards."""
    reverse: Reverse | None = None
    """Way of the ESC into reverse: at once, or `brake_first`; null: unknown, so the car does not drive backwards."""
    virtual_esc: Reverse = "brake_first"
    """The ESC behind a virtual bus."""
    straight: Pulse = 1500.0
    """Pulse at which it drives straight, us."""
    steering_range: float = 400.0
    """From straight to full lock on the left, us; negative if shorter pulses steer left."""
    rear_straight: Pulse = 1500.0
    """Pulse at which the rear wheels are straight, us."""
    rear_range: float = 400.0
    """From there to the rear wheels' full lock on the left, us; negative if shorter pulses steer them left."""
    encoders: tuple[tuple[Pin, ...], ...] = ()
    """GPIO numbers A and B, or A alone, of an encoder on the drive, or of two, right and left."""
    battery: Literal["none", "ina219", "ads1115"] = "none"
    """Sensor of the battery's voltage."""
    battery_address: Annotated[int, Ge(3), Le(0x77)] | None = None
    """I2C address of this sensor; null: 0x41 of an INA219, as a servo board has 0x40, and 0x48 of an ADS1115."""
    battery_channel: Annotated[int, Ge(0), Le(3)] = 0
    """Input of the ADS1115."""
    divider: Positive = 1.0
    """Battery's voltage over the measured voltage."""
    watchdog: Pin | None = None
    """GPIO number of the pin that feeds a watchdog on the servo board's output-enable pin; null: there is none."""


class GuardAnswer(NamedTuple):
    """An answer of the guard."""

    # whether the pulses were put out
    done: bool
    voltage: float | None  # V
    # counts of the encoders
    counts: tuple[int, int]


class Keeper(Protocol):
    """Holds the outputs, and reads the sensors."""

    async def open(self) -> None:
        """Put out neutral; raises HalError, with the remedy."""

    async def close(self) -> None:
        """Put out neutral, and release the hardware."""

    def put(self, pulses: Sequence[float], now: float) -> None:
        """Put out pulses, us; never waits."""

    def heard(self, now: float) -> GuardAnswer | None:
        """Return the newest answer since the last call; None if there is none.

        Raises HalError, once, if the guard has ended or hangs. The next guard counts its encoders from 0.
        """


def answer_of(data: bytes) -> GuardAnswer:
    """Return the answer in these bytes."""
    done, voltage, one, two = ANSWER.unpack(data)
    return GuardAnswer(done, None if voltage < 0.0 else voltage, (one, two))


class Process:
    """The guard as a process of its own, in its own session, so that no signal of the terminal reaches it.

    A guard that does not answer is killed. A servo board keeps the last pulse. So when a guard was killed, this process
    puts out neutral itself, and only then starts another guard: two processes never write at the same time. A thread
    makes all calls that may block in the bus, and no caller waits for it longer than `WRITES`.

    A bus that fails for `BUS_PATIENCE` s is opened again, by a new guard, for ever and with growing pauses
    (`txt1.link.silence`): the adapter of a bus may have been plugged out and in. The servo board itself gets pulses all
    the time, so it is not greeted; a guard sets it up when it answers again.
    """

    def __init__(self, setup: GuardSetup) -> None:
        self._setup = setup
        self._process: subprocess.Popen[bytes] | None = None
        self._starting: asyncio.Task[None] | None = None
        self._ended: subprocess.Popen[bytes] | None = None
        self._again = inf
        self._rest = b""
        # time since which pulses wait for an answer, s of the run
        self._unanswered = inf
        self._ladder = Ladder(BUS_PATIENCE, greets=False)
        # s that the next guard may take to start
        self._patience = GUARD_START_TIME

    async def open(self) -> None:
        """Start the guard, and wait until it has put out neutral."""
        try:
            self._process = await asyncio.to_thread(_start, self._setup, self._patience)
        except GuardSlow:
            self._patience *= 2.0
            raise
        self._rest, self._again, self._unanswered, self._patience = b"", inf, inf, GUARD_START_TIME

    async def close(self) -> None:
        """End the guard; its outputs are then neutral, even if it had to be killed. Raises HalError if they are not."""
        # a guard that is just starting has to be ended, too
        if self._starting is not None:
            await self._starting
            self._starting = None
        process, self._process, self._ended = self._process or self._ended, None, None
        if process is not None and not await _aside(lambda: _end(process, self._setup)):
            raise HalError(NOT_NEUTRAL)

    def put(self, pulses: Sequence[float], now: float) -> None:
        """Send pulses to the guard, unless it takes none."""
        if self._process is not None and self._process.stdin is not None:
            self._unanswered = min(self._unanswered, now)
            with suppress(OSError):
                os.write(self._process.stdin.fileno(), pulses_in(self._setup, pulses))

    def heard(self, now: float) -> GuardAnswer | None:
        """Return the guard's newest answer; if it has ended or hangs, start another guard."""
        process = self._process
        if process is None or process.stdout is None:
            if now >= self._again and (self._starting is None or self._starting.done()):
                self._begin_again(now)
            return None
        try:
            data = os.read(process.stdout.fileno(), 4096)
        except BlockingIOError:
            if now - self._unanswered > HANGS:
                process.kill()
                self._give_up(process, now, "hung, so it was killed")
            return None
        if not data:
            self._give_up(process, now, "has ended")
        self._unanswered = inf
        data = self._rest + data
        whole = len(data) // ANSWER.size * ANSWER.size
        self._rest = data[whole:]
        if not whole:
            return None
        answer = answer_of(data[whole - ANSWER.size : whole])
        if answer.done:
            self._ladder.heard(now)
        elif self._ladder.due == inf:
            # the first answer of all
            self._ladder.heard(now)
        elif now >= self._ladder.due:
            self._give_up(process, now, "was ended, as the bus fails")
        return answer

    def _give_up(self, process: subprocess.Popen[bytes], now: float, reason: str) -> NoReturn:
        self._process, self._ended = None, process
        self._ladder.lost(now)
        self._begin_again(now)
        raise HalError(f"the outputs are lost: their guard {reason}")

    def _begin_again(self, now: float) -> None:
        """Start another guard, and see when the next one is due if this one does not start."""
        self._ladder.connected(now)
        self._again = self._ladder.due
        self._starting = asyncio.ensure_future(self._start_again())

    async def _start_again(self) -> None:
        ended = self._ended
        if ended is not None:
            await _aside(lambda: _end(ended, self._setup))
            # the kernel holds the guard in the bus
            if ended.poll() is None:
                return
            self._ended = None
        with suppress(HalError, OSError):
            await self.open()


async def _aside(work: Callable[[], bool]) -> bool:
    """Return whether `work` succeeded within `WRITES` s, in a thread that does not keep this process from ending."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[bool] = loop.create_future()

    def tell(result: bool) -> None:
        if not done.done():
            done.set_result(result)

    def body() -> None:
        result = work()
        # the loop is closed if the bus took longer than the rest of the run
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(tell, result)

    threading.Thread(target=body, name="neutral", daemon=True).start()
    try:
        return await asyncio.wait_for(done, WRITES)
    except TimeoutError:
        return False


class GuardSlow(HalError):
    """A guard had not started when its time was over."""


def _start(setup: GuardSetup, patience: float) -> subprocess.Popen[bytes]:
    """Start a guard, which has `patience` s for it; called in a thread."""
    # imports are made now: after a guard was killed there is no time for them
    if setup.output == "pca9685":
        guard.bus_class(setup)
    process = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-P", guard.__file__, json.dumps(setup._asdict())],
        start_new_session=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    begun, _, _ = select.select([process.stdout], [], [], patience)
    if not begun:
        process.kill()
        with suppress(subprocess.TimeoutExpired):
            # also closes the pipes
            process.communicate(timeout=DIES)
        raise GuardSlow(explain(setup, f"nothing within {patience:g} s"))
    if len(process.stdout.read(ANSWER.size)) < ANSWER.size:
        error = process.stderr.read().decode(errors="replace").strip().splitlines()
        process.communicate()
        raise HalError(explain(setup, error[-1] if error else "it ended"))
    for pipe in (process.stdin, process.stdout):
        os.set_blocking(pipe.fileno(), False)
    return process


def _end(process: subprocess.Popen[bytes], setup: GuardSetup) -> bool:
    """Close a guard's pipe, which ends it, and wait; return whether the outputs are neutral. Called in a thread."""
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
    try:
        process.wait(ENDS)
    except subprocess.TimeoutExpired:
        process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.wait(DIES)
    return process.returncode == 0 or (process.returncode is not None and guard.neutral_without_guard(setup))


def explain(setup: GuardSetup, error: str) -> str:
    """Return the remedy for a guard that cannot start, and the reason, from its last output."""
    where = f"I2C bus {setup.bus}" if setup.output == "pca9685" else "GPIO"
    remedy = "see txt1 doctor --hal pi"
    if "No such file" in error:
        remedy = "switch I2C on (sudo raspi-config, Interface Options) and check hal_options.bus"
    elif "Permission" in error:
        remedy = "sudo usermod -aG i2c,gpio $USER, then log out and in again"
    elif "Remote I/O" in error or "Errno 121" in error:
        remedy = f"nothing answers at 0x{setup.address:02x}: check wiring, power and hal_options.address"
    elif "another robot" in error:
        remedy = "end it first: one robot drives a servo board"
    elif "busy" in error:
        remedy = "another program has the pins: end it"
    elif "No module" in error:
        remedy = f"{installs('devices')}; {GET_LGPIO}" if "lgpio" in error else installs("devices")
    return f"{remedy}: the outputs on {where} cannot be opened ({error})"


class PiHal(PlainHal):
    """An R/C car on a Raspberry Pi."""

    name = "pi"
    esc = True

    def __init__(
        self,
        keeper: Keeper,
        options: PiOptions,
        geometry: Geometry,
        channels: Channels = STRAIGHT,
        simulated: bool = False,
        dead_band: float = NEUTRAL_COUNTS,
    ) -> None:
        encoders = len(options.encoders)
        self.capabilities = Capabilities(
            ticks=encoders == 2,
            odometry=encoders == 1,
            pwm=True,
            battery=options.battery != "none",
            simulated=simulated,
        )
        self._keeper, self._options, self._geometry, self._channels = keeper, options, geometry, channels
        self._dead_band = max(dead_band, NEUTRAL_COUNTS)
        self._skids = geometry.steering == "skid"
        self._neutral = neutral(options, geometry, channels)
        self._forget()

    def _forget(self) -> None:
        self._heard, self._heard_since = -inf, inf  # s of the run
        self._counts: tuple[int, int] | None = None
        # encoder counts of earlier guards
        self._past = (0, 0)
        self._odometry = Odometry()
        self._voltage: float | None = None
        self._share, self._forward = 0.0, True
        self._esc = BrakeFirst(2 if self._skids else 1, self._dead_band)
        # when an encoder last turned, and until when a car without encoders may roll forward, s of the run
        self._turned = self._rolls_until = -inf
        self._refused = self._coasts = False
        self._losses, self._failures = 0, 0
        self._text, self._reason = "waiting for the guard of the outputs", ""
        self._link: BoardLink | None = None

    async def open(self) -> None:
        """Start the guard, which puts out neutral."""
        self._forget()
        await self._keeper.open()

    async def close(self) -> None:
        """End the guard: the outputs are neutral, and stay neutral."""
        await self._keeper.close()

    def read(self, now: float) -> Inputs:
        """Return encoder counts and battery voltage from the guard's last answer."""
        answer = None
        try:
            answer = self._keeper.heard(now)
        except HalError as error:
            self._past = self._counts or (0, 0)
            self._lose(str(error))
        if answer is not None and answer.done:
            self._take(answer, now)
        elif answer is not None:
            self._failures += 1
        if now - self._heard > GUARD_SILENCE:
            self._lose("the outputs are lost: the bus fails, or their guard hangs")
        ready = now - self._heard_since >= ESC_ARM_TIME
        link = BoardLink(ready, self._losses, self._reason, self._text, {"bus_failures": self._failures})
        if link != self._link:
            self._link = link
        can, heard = self.capabilities, max(0.0, self._heard)
        return Inputs(
            ticks=(self._counts or (0, 0)) if can.ticks else None,
            odometry=self._odometry if can.odometry else None,
            odometry_time=heard,
            batteries=None if self._voltage is None else (self._voltage, 0.0),
            link=self._link,
            held=self._esc.waits or self._refused or self._coasts,
        )

    def _lose(self, reason: str) -> None:
        """Count a loss and keep its reason, unless the outputs are lost already or were never there."""
        if self._heard_since < inf:
            self._losses += 1
            self._text = self._reason = reason
            self._heard_since = inf

    def _take(self, answer: GuardAnswer, now: float) -> None:
        if self._heard_since == inf:
            self._heard_since = now
            self._counts = None if not self.capabilities.ticks else self._counts
            self._text = "the guard puts the outputs out; it puts them to neutral when nothing comes for 0.2 s"
        dt, self._heard = now - self._heard, now
        before = self._counts
        self._counts = self._past[0] + answer.counts[0], self._past[1] + answer.counts[1]
        if self._counts != before:
            self._turned = now
        self._voltage = answer.voltage if self.capabilities.battery else None
        if self.capabilities.odometry and before is not None and dt > 0.0:
            moved = self._counts[0] - before[0]
            if len(self._options.encoders[0]) == 1 and not self._forward:
                moved = -moved
            distance = moved * self._geometry.count_length
            curvature = self._geometry.curvature(self._share)
            self._odometry = rolled(self._odometry, distance, curvature, distance / dt)

    def write(self, outputs: Outputs, now: float) -> None:
        """Send the pulses of these outputs to the guard."""
        skids = self._skids
        # the ESC reads pulses as the driver means them, whatever the wiring
        motor, front, rear = self._channels.meant(*outputs[:3], skids)
        passes = self._into_reverse(sides(motor, rear) if skids else (motor,), outputs, now)
        if self._options.encoders:
            self._coasts = False
            if motor and all(passes) and not self._esc.waits:
                # an encoder of one pin shows no direction: the car has to stand before its motor turns the other way
                rolls = len(self._options.encoders[0]) == 1 and now - self._turned < EDGE_SILENCE
                self._coasts = rolls and self._forward is not (motor > 0.0)
                if self._coasts:
                    passes = (False,)
                else:
                    self._forward = motor > 0.0
            self._share = min(max(-front / STEERING_MAX, -1.0), 1.0)
        pulses = self._neutral
        if now - self._heard_since >= ESC_ARM_TIME:
            pulses = pulses_of(outputs, self._options, self._geometry)
            if not all(passes):
                each = zip(pulses, self._neutral, (*passes, True, True), strict=False)
                pulses = tuple(pulse if passed else still for pulse, still, passed in each)
        self._keeper.put(pulses, now)

    def _into_reverse(self, motors: Sequence[float], outputs: Outputs, now: float) -> tuple[bool, ...]:
        """Return for each motor whether its pulse may be put out: `motors` are the counts, forward positive."""
        options = self._options
        if options.reverse == "direct":
            return (True,) * len(motors)
        # the set-point of the slower side, m/s
        turning = 0.5 * self._geometry.track_width * abs(outputs.omega) if self._skids else 0.0
        slower = outputs.v - turning
        # a PWM test has no set-point, and neither has a stop, at which loops may brake
        unknown = outputs.v == outputs.omega == 0.0
        forward = tuple(counts > -NEUTRAL_COUNTS for counts in motors)
        if options.reverse is None:
            self._refused = not all(forward)
            if self._refused and (slower < 0.0 or (unknown and not options.encoders)):
                self._text = UNKNOWN
            # a rover whose one side stands would turn
            return (not self._refused,) * len(motors)
        if max(motors) >= NEUTRAL_COUNTS:
            self._rolls_until = now + coasting_time(SPEED_MAX if unknown else abs(outputs.v) + turning)
        stands = now - self._turned >= EDGE_SILENCE if options.encoders else now >= self._rolls_until
        if slower > 0.0 and not all(forward):
            # loops that slow down, so the car rolls on
            self._esc.passes([max(counts, 0.0) for counts in motors], now, stands=stands, brakes=False)
            return forward
        return self._esc.passes(motors, now, stands=stands, brakes=slower < 0.0)


def pulses_of(outputs: Outputs, options: PiOptions, geometry: Geometry) -> tuple[float, ...]:
    """Return the pulses of the motors and the servos, us, in the order of their channels."""
    counts = sides(outputs.motor, outputs.rear) if geometry.steering == "skid" else (outputs.motor,)
    motors = (options.motor_neutral + options.motor_range * min(max(count / PWM_MAX, -1.0), 1.0) for count in counts)
    servos: tuple[float, ...] = ()
    if geometry.steering != "skid":
        servos = (options.straight - options.steering_range * outputs.front / STEERING_MAX,)
    if geometry.steering == "both":
        servos += (options.rear_straight + options.rear_range * outputs.rear / STEERING_MAX,)
    return tuple(min(max(pulse, PULSES[0]), PULSES[1]) for pulse in (*motors, *servos))


def neutral(options: PiOptions, geometry: Geometry, channels: Channels = STRAIGHT) -> tuple[float, ...]:
    """Return the pulses for standing with straight wheels, us, with the trims from `txt1 calibrate`."""
    held = Outputs(*channels.wired(0.0, 0.0, 0.0, geometry.steering == "skid"))
    return pulses_of(held, options, geometry)


def setup_of(options: PiOptions, geometry: Geometry, channels: Channels = STRAIGHT) -> GuardSetup:
    """Return the guard's setup; raises ConfigError if the channels do not fit the vehicle."""
    wanted = {"skid": (2, 0), "front": (1, 1), "both": (1, 2)}[geometry.steering]
    motors, servos = wanted
    car = f"a car with geometry.steering '{geometry.steering}'"
    remedy = "give as many, or choose your car with --vehicle, such as --vehicle donkeycar"
    if len(options.motor) != motors:
        raise ConfigError(f"hal_options.motor: {len(options.motor)} of them; {car} has {motors}: {remedy}")
    if servos and len(options.steering) != servos:
        raise ConfigError(f"hal_options.steering: {len(options.steering)} of them; {car} has {servos}: {remedy}")
    if len(options.encoders) > 2 or any(len(pins) not in (1, 2) for pins in options.encoders):
        raise ConfigError("hal_options.encoders: at most two, of one or two pins each, such as [[17, 27]]")
    if len(options.encoders) == 1 and geometry.steering == "skid":
        raise ConfigError("hal_options.encoders: a rover takes two, right and left, or none")
    if options.encoders and not geometry.counts_per_rev:
        raise ConfigError("geometry.counts_per_rev: 0 says that there are no encoders; set the edges in a turn")
    if len(options.encoders) == 2 and any(len(pins) != 2 for pins in options.encoders):
        raise ConfigError("hal_options.encoders: two encoders need two pins each, as a single pin shows no direction")
    if options.watchdog is not None and options.output != "pca9685":
        raise ConfigError("hal_options.watchdog: it is for output pca9685; pulses from pins end with their guard")
    address = options.battery_address or {"none": 0, "ina219": 0x41, "ads1115": 0x48}[options.battery]
    pins = (*options.motor, *options.steering[:servos])
    return GuardSetup(
        options.bus,
        options.output,
        options.address,
        options.frequency,
        options.oscillator,
        pins,
        neutral(options, geometry, channels),
        options.encoders,
        options.battery,
        address,
        options.battery_channel,
        options.divider,
        options.watchdog,
    )


def create(config: Config) -> PiHal:
    """Make the car as configured."""
    options = checked(PiOptions, config.hal_options, "hal_options")
    if options.bus == "desk":
        raise ConfigError(f"hal_options.bus: the virtual bus is named '{VIRTUAL}', not 'desk'")
    setup = setup_of(options, config.geometry, config.channels)
    if options.bus == VIRTUAL:
        keeper: Keeper = BUSES.make("hal", "pi", config, setup)
        return PiHal(keeper, options, config.geometry, config.channels, True, config.car.dead_band)
    on_file = isinstance(options.bus, str)
    if not on_file and (options.output == "pca9685" or options.battery != "none") and find_spec("smbus2") is None:
        raise MissingExtra("the HAL 'pi'", "devices")
    pins = options.output == "gpio" or options.encoders or (options.watchdog is not None and not on_file)
    if pins and find_spec("lgpio") is None:
        raise HalError(f"hal_options: pins need lgpio, which is missing: {GET_LGPIO}")
    return PiHal(Process(setup), options, config.geometry, config.channels, dead_band=config.car.dead_band)
