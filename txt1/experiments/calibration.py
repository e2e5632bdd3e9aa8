"""Calibration: a dialogue with the vehicle's operator that finds out how the vehicle is wired and moves.

A step asks the operator to put the vehicle somewhere, drives it a little by hand, asks for what was to be seen or
measured, and keeps what follows from it at once, so that whoever breaks it off goes on from there.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from itertools import pairwise
from math import asin, atan, cos, hypot, radians, sin, tan
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from txt1.config import Config
from txt1.config.sources import with_values
from txt1.control.limits import clip
from txt1.control.open_loop import counts_for
from txt1.errors import HalError, NotArmed
from txt1.experiments.identify import identify, try_out
from txt1.experiments.tune import angular_gains, linear_gains
from txt1.hal.base import Hal
from txt1.hal.channels import Rewired
from txt1.kernel.ticks import Ticks
from txt1.model.channels import SIDES
from txt1.model.odometry import Odometry
from txt1.model.vehicle import PWM_MAX, STEERING_MAX
from txt1.robot import Robot

PERIOD: Final = 0.05  # s between two PWM commands by hand
STAND: Final = 2.5  # s after which a vehicle whose motor is in neutral stands
SETTLE: Final = 0.6  # s that the steering gets to arrive
RAMP: Final = 200.0  # counts a second by which the motor's output is raised until encoders count
SLOW_RAMP: Final = 100.0  # likewise, until a person sees something turn
TURNED: Final = 4  # encoder counts that are no noise
BEYOND: Final = 400  # counts beyond those at which it begins to turn: it turns surely
WELL_TURNED: Final = 20  # encoder counts that a wheel makes in the second after that, at least
CRUISE: Final = 1200  # counts beyond the dead band at which distances are driven
SWEEP: Final = 1500.0  # counts a second by which the steering is turned to its stop
SWEEP_FROM: Final = 3000.0  # counts from which it is
REACTION: Final = 0.5  # s by which an operator is late to say that wheels have stopped turning
TURNING: Final = 16.0  # s of turning in place: a guess of the angle is wrong by degrees, however long it takes
DISTANCE: Final = 3.0  # m that are driven straight
DRIFT: Final = radians(0.3)  # rad of heading lost in a metre that are straight enough
TRIES: Final = 4  # drives at most until it is
PATIENCE: Final = 60.0  # s after which a drive ends whatever the operator sees
LEVELS: Final = (1.0, 0.3, 0.6, -0.3, -0.8)  # shares of the largest speed that the speed map has, in this order
TOO_NEAR: Final = 0.15  # share of it by which two of them differ at least
ACCELERATED: Final = 1.3  # s after which a vehicle has nearly its speed
LINE: Final = f"Put the vehicle at the beginning of a straight line of {DISTANCE + 2.0:g} m, along it."
OFF: Final = "How far left of the line is it (right: negative)?"

Counts = tuple[int, int] | None  # of the right and left encoder, where there are some

WIDEST: Final = PWM_MAX / STEERING_MAX  # scale of a steering that may use the whole range of pulses

MOTORS: Final = ("motor",)
OUTPUTS: Final = ("right", "left")


class Operator(Protocol):
    """A person beside the vehicle, or something that answers as one would: by a question's key, its text for people."""

    def tell(self, text: str) -> None:
        """Say something."""

    async def ready(self, key: str, text: str) -> None:
        """Ask for something to be done, and return when it is: nothing moves before."""

    async def seen(self, key: str, text: str) -> None:
        """Return as soon as the operator says that he sees this, while the vehicle moves."""

    async def choose(self, key: str, text: str, options: Sequence[str]) -> str:
        """The option that is the operator's answer."""

    async def number(self, key: str, text: str, unit: str) -> float:
        """The number that the operator has measured."""


class Hands:
    """A robot driven by hand: its PWM as they hold it."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.outputs = (0.0, 0.0, 0.0)
        """Motor, front and rear steering, counts."""

    def steer(self, motor: float, steering: float = 0.0) -> None:
        """Hold these counts, steering left positive."""
        self.outputs = (motor, -steering, steering)

    async def hold(self, ticks: Ticks) -> None:
        """Give the outputs again and again."""
        async for _ in ticks:
            motor, front, rear = self.outputs
            self.robot.pwm_test(round(motor), round(front), round(rear))

    async def wait(self, seconds: float) -> None:
        """Let time pass; raises NotArmed when the safety gate has closed."""
        await asyncio.sleep(seconds)
        if not self.robot.armed:
            raise NotArmed(self.robot.reason)

    async def until(self, seen: Coroutine[Any, Any, None], limit: float = PATIENCE) -> bool:
        """Go on until the operator sees it, or for `limit` s; whether he did. Raises NotArmed as `wait`."""
        seeing, ends = asyncio.ensure_future(seen), self.robot.now + limit
        try:
            while not seeing.done() and self.robot.now < ends:
                await self.wait(0.02)
            if seeing.done():
                seeing.result()
            return seeing.done()
        finally:
            seeing.cancel()

    @property
    def counts(self) -> tuple[int, int] | None:
        """Counts of the right and left encoder now, where there are some."""
        ticks = self.robot.runtime.look().ticks
        hal: Any = self.robot.hal
        return hal.counts if ticks is None and isinstance(hal, Rewired) else ticks


class Bench:
    """A vehicle being calibrated.

    Args:
        config: of the vehicle as far as it is known.
        operator: beside it.
        opened: makes a running robot of a configuration, whose motion the tasks do not see if that is asked for.
        keep: told the values that were found, by dotted key, as soon as they are.
        own_loops: whether its hardware closes the velocity loops, so that nobody drives it by hand.

    """

    def __init__(
        self,
        config: Config,
        operator: Operator,
        opened: Callable[[Config, bool], AbstractAsyncContextManager[Robot]],
        keep: Callable[[Mapping[str, Any]], None],
        own_loops: bool = False,
    ) -> None:
        self.config, self.operator, self.own_loops = config, operator, own_loops
        self.driving = 0.0
        """Time for which it was ready to move, s."""
        self._opened, self._keep = opened, keep

    @property
    def skids(self) -> bool:
        """Whether its sides run at two speeds."""
        return self.config.geometry.steering == "skid"

    @property
    def cruise(self) -> float:
        """Motor counts at which distances are driven."""
        return min(self.config.car.dead_band + CRUISE, float(self.config.safety.motor_max))

    @property
    def speed(self) -> float:
        """Speed at which distances are driven by set-points, m/s."""
        return min(0.5 * self.config.safety.v_max, 0.75)

    def found(self, values: Mapping[str, Any]) -> None:
        """Keep values that were found, by dotted key, and use them from now on."""
        simulated = {f"sim.{key}": value for key, value in values.items() if key.startswith("channels.")}
        values = {**values, **simulated}  # so that the same vehicle is simulated from its file
        self.config = with_values(self.config, values)
        self._keep(values)

    @asynccontextmanager
    async def robot(self, changes: Mapping[str, Any] | None = None, unseen: bool = False) -> AsyncIterator[Robot]:
        """Return the running robot, armed, with some values changed; on leaving it stands."""
        async with self._opened(with_values(self.config, changes or {}), unseen) as robot:
            begin = robot.now
            try:
                yield robot
            finally:
                self.driving += robot.now - begin

    @asynccontextmanager
    async def by_hand(self, changes: Mapping[str, Any] | None = None, unseen: bool = False) -> AsyncIterator[Hands]:
        """Return the robot in somebody's hands; when they let go, it comes to rest."""
        async with self.robot(changes, unseen) as robot:
            hands = Hands(robot)
            await robot.set_manual(True)
            robot.add_task("hands", PERIOD, hands.hold)
            yield hands
            hands.steer(0.0)
            await hands.wait(STAND)


# -- the motor ---------------------------------------------------------------------------------------------------


async def motor(bench: Bench) -> None:
    """Find direction, neutral and dead band of the motor, or of both sides, and which way the encoders count."""
    ask = bench.operator
    await ask.ready("blocks", "Put the vehicle on blocks: no wheel may touch the floor.")
    names = OUTPUTS if bench.skids else MOTORS
    as_they_are = {f"channels.{name}.{key}": value for name in names for key, value in _AS_IT_IS.items()}
    encoders = {"right_encoder": 1, "left_encoder": 1, "encoders_swapped": False}
    as_they_are |= {f"channels.{key}": value for key, value in encoders.items()}
    bands, turned = [], []
    for name in names:
        side = "wheels" if name == "motor" else f"{name} wheels"
        await ask.ready("watch", f"Watch the {side}: they are about to turn slowly, one way and then the other.")
        async with bench.by_hand(as_they_are, unseen=True) as hands:
            begins = await _until_it_turns(hands, ask, name, 1, side)
            before = hands.counts
            _give(hands, name, begins + BEYOND)
            await hands.wait(1.0)
            after = hands.counts
            hands.steer(0.0)
            await hands.wait(STAND)
            way = await ask.choose("turned", f"Which way did the {side} turn?", ("forward", "backward"))
            ends = await _until_it_turns(hands, ask, name, -1, side)
        direction = 1 if way == "forward" else -1
        bands.append(0.5 * (begins - ends))
        trim = round(0.5 * (begins + ends))
        bench.found({f"channels.{name}.direction": direction, f"channels.{name}.trim": float(trim)})
        if before is not None and after is not None:
            turned.append((direction * (after[0] - before[0]), direction * (after[1] - before[1])))
    band = round(sum(bands) / len(bands))
    bench.found({"car.dead_band": float(band), "sim.vehicle.dead_band": float(band)})
    if turned:
        bench.found(_encoders(turned))


def _give(hands: Hands, name: str, counts: float) -> None:
    """Put counts on the motor, or on one side alone."""
    if name == "motor":
        hands.steer(counts)
    else:
        hands.steer(0.5 * counts, (0.5 if name == "right" else -0.5) * SIDES * counts)


async def _until_it_turns(hands: Hands, ask: Operator, name: str, sign: int, side: str) -> float:
    """Raise the output until something turns; the counts at which it does."""
    limit, counts = hands.robot.config.safety.motor_max, 0.0
    before = hands.counts
    seeing = None
    if before is None:
        seeing = asyncio.ensure_future(ask.seen("turning", f"Press Enter as soon as the {side} turn."))
    try:
        while counts < limit:
            counts += PERIOD * (SLOW_RAMP if before is None else RAMP)
            _give(hands, name, sign * counts)
            await hands.wait(PERIOD)
            now = hands.counts
            if before is not None and now is not None:
                if max(abs(now[0] - before[0]), abs(now[1] - before[1])) >= TURNED:
                    return sign * counts
            elif seeing is not None and seeing.done():
                return sign * counts
    finally:
        if seeing is not None:
            seeing.cancel()
    raise HalError(
        f"the {side} do not turn at {limit} counts, the most that safety.motor_max allows: is the motor's power on? "
        "Does its controller want neutral first?"
    )


def _encoders(turned: Sequence[tuple[int, int]]) -> dict[str, Any]:
    """Encoders' directions by what they counted while the wheels turned forward: all of them, or one side at a time."""
    right, left = turned[0][0], turned[0][1]
    swapped = False
    if len(turned) == 2:  # the right side alone, the left side alone
        swapped = abs(turned[0][1]) > abs(turned[0][0])
        right, left = (turned[0][1], turned[1][0]) if swapped else (turned[0][0], turned[1][1])
    for name, counted in (("right", right), ("left", left)):
        if abs(counted) < WELL_TURNED:
            raise HalError(f"the {name} encoder does not count, though its wheel turns: check its supply and its wires")
    return {
        "channels.right_encoder": 1 if right > 0 else -1,
        "channels.left_encoder": 1 if left > 0 else -1,
        "channels.encoders_swapped": swapped,
    }


_AS_IT_IS: Final = {"direction": 1, "trim": 0.0, "scale": 1.0}


# -- the steering ------------------------------------------------------------------------------------------------


async def steering(bench: Bench) -> None:
    """Find direction and range of the steering, and about where straight is."""
    ask = bench.operator
    axles = ("front", "rear") if bench.config.geometry.steering == "both" else ("front",)
    await ask.ready("blocks", "Put the vehicle on blocks, or hold it up: its wheels are about to steer.")
    changes = {f"channels.{axle}.{key}": value for axle in axles for key, value in _AS_IT_IS.items()}
    changes |= {f"channels.{axle}.scale": WIDEST for axle in axles}
    for axle in axles:

        def turn(hands: Hands, wire: float, place: int = 1 if axle == "front" else 2) -> None:
            outputs = [0.0, 0.0, 0.0]
            outputs[place] = wire / WIDEST
            hands.outputs = (outputs[0], outputs[1], outputs[2])

        await ask.ready("watch", f"Watch the {axle} wheels: they are about to steer.")
        async with bench.by_hand(changes) as hands:
            turn(hands, 2.0 * SWEEP_FROM)
            await hands.wait(SETTLE)
            way = await ask.choose(axle, f"Which way do the {axle} wheels point, seen from above?", ("left", "right"))
            stops = []
            for sign in (1, -1):
                turn(hands, sign * SWEEP_FROM)
                await hands.wait(SETTLE)
                seeing = asyncio.ensure_future(
                    ask.seen(f"{axle}_stop", f"Press Enter as soon as the {axle} wheels turn no further.")
                )
                wire = SWEEP_FROM
                while wire < PWM_MAX and not seeing.done():
                    wire += SWEEP * PERIOD
                    turn(hands, sign * wire)
                    await hands.wait(PERIOD)
                stops.append(sign * (wire - SWEEP * REACTION if seeing.done() else float(PWM_MAX)))
                seeing.cancel()
        bench.found({
            f"channels.{axle}.direction": 1 if way == "right" else -1,  # positive counts point either axle to the right
            f"channels.{axle}.trim": float(round(0.5 * (stops[0] + stops[1]))),
            f"channels.{axle}.scale": round(0.5 * (stops[0] - stops[1]) / STEERING_MAX, 4),
        })  # fmt: skip


# -- on the floor ------------------------------------------------------------------------------------------------


async def straight(bench: Bench) -> None:
    """Find the trim with which it goes straight, and with encoders the metres of a count."""
    ask, geometry = bench.operator, bench.config.geometry
    if bench.skids and not geometry.counts_per_rev:
        await _even_sides(bench)
        return
    for number in range(TRIES):
        await ask.ready("line", LINE)
        shown = await _go_straight(bench)
        ahead = await ask.number("ahead", "How far did it come along the line?", "m")
        if geometry.steering == "both":
            front = await ask.number("front_off", "How far left of the line is the middle of its front axle?", "m")
            rear = await ask.number("rear_off", "... and of its rear axle?", "m")
            bend = (front - rear) / geometry.wheelbase / ahead
            crab = 0.5 * (front + rear) / ahead - 0.5 * bend * ahead
            off = 0.5 * bend * ahead * ahead
            angles = {"front": atan(crab + bend * geometry.lever), "rear": atan(crab - bend * geometry.lever)}
        else:
            off = await ask.number("off", OFF, "m")
            bend = _arc(ahead, off)[0]
            angles = {"front": atan(bend * geometry.lever)}
        if shown is not None:
            if shown < 0.1 * ahead:
                raise HalError(f"its odometry shows {shown:.2f} m for {ahead:.2f} m: look after the encoder's wires")
            circumference = bench.config.geometry.circumference * hypot(ahead, off) / shown
            bench.found({"geometry.circumference": round(circumference, 5)})
        if bench.skids:
            return  # the loops see to it
        if max(abs(tan(angle)) for angle in angles.values()) < DRIFT * geometry.lever:
            return
        # a tape tells a heading over a short wheelbase badly: what two axles lack is averaged over the drives
        weight = 1.0 / (1 + number) if geometry.steering == "both" else 1.0
        for axle, angle in angles.items():
            channel = getattr(bench.config.channels, axle)
            too_far = -STEERING_MAX * weight * angle / geometry.steering_max
            trim = channel.trim - channel.direction * channel.scale * too_far
            bench.found({f"channels.{axle}.trim": float(round(trim))})


async def _even_sides(bench: Bench) -> None:
    """Find scales and trims with which both sides run at one speed: forward and backward, as they are two unknowns."""
    ask, geometry, band = bench.operator, bench.config.geometry, bench.config.car.dead_band
    for _ in range(TRIES):
        bends, more = [], []
        for sign, where in ((1.0, ""), (-1.0, " It drives backward.")):
            await ask.ready("line", LINE + where)
            await _go_straight(bench, sign * bench.cruise)
            ahead = await ask.number("ahead", "How far did it come along the line?", "m")
            bends.append(_arc(ahead, await ask.number("off", OFF, "m"))[0])
            # the counts by which the right side has more than the left one
            more.append(bends[-1] * sign * (bench.cruise - band) * geometry.track_width)
        if max(map(abs, bends)) < DRIFT:
            return
        scale = clip(0.5 * (more[0] - more[1]) / bench.cruise, 0.3)
        trim = clip(0.5 * (more[0] + more[1]), 0.5 * band)
        for name, half in (("right", -0.5), ("left", 0.5)):
            channel = getattr(bench.config.channels, name)
            bench.found({
                f"channels.{name}.scale": round(channel.scale * (1.0 + half * scale), 4),
                f"channels.{name}.trim": round(channel.trim + half * channel.direction * channel.scale * trim, 1),
            })  # fmt: skip


async def _go_straight(bench: Bench, by_hand: float | None = None) -> float | None:
    """Drive straight by hand, or where that takes the loops by these; the way that the odometry shows ahead, m."""
    if bench.skids and bench.config.geometry.counts_per_rev:
        v = bench.speed
        async with bench.robot() as robot:
            begin = robot.odometry
            await robot.drive(v, 0.0, DISTANCE / v)
            await asyncio.sleep(STAND)
            return _shown(begin, robot.odometry)
    async with bench.by_hand() as hands:
        await hands.wait(SETTLE)
        begin = hands.robot.odometry
        hands.steer(bench.cruise if by_hand is None else by_hand)
        seen = bench.operator.seen(
            "gone", f"Press Enter when it has gone about {DISTANCE:g} m, or has turned a good way."
        )
        await hands.until(seen)
        hands.steer(0.0)
        await hands.wait(STAND)
        return None if hands.robot.hal.capabilities.blind else _shown(begin, hands.robot.odometry)


def _shown(begin: Odometry, end: Odometry) -> float:
    """The way from one pose to another, m; less than 0 when it is backward."""
    x, y = end.x - begin.x, end.y - begin.y
    return hypot(x, y) * (1.0 if x * cos(begin.theta) + y * sin(begin.theta) > 0.0 else -1.0)


async def servo(bench: Bench) -> None:
    """Find which way motor and steering go, where hardware closes the loops and has settings of its own for that."""
    ask, v = bench.operator, bench.speed
    await ask.ready("blocks", "Put the vehicle on blocks: no wheel may touch the floor.")
    await ask.ready("watch", f"Watch the wheels: they are about to steer, and to turn at {v:g} m/s for six seconds.")
    async with bench.robot() as robot:
        options = own_settings(robot.hal)
        driving = asyncio.ensure_future(robot.drive(v, v / bench.config.geometry.radius_min, 6.0))
        await asyncio.sleep(1.5)
        steered = await ask.choose("front", "Which way do the front wheels point, seen from above?", ("left", "right"))
        turned = await ask.choose("turned", "Which way do the wheels turn?", ("forward", "backward"))
        await driving
    bench.found({
        "hal_options.backwards": options.backwards is not (turned == "backward"),
        "hal_options.servo_range": options.servo_range * (1.0 if steered == "left" else -1.0),
    })  # fmt: skip


async def scale(bench: Bench) -> None:
    """Find how far it goes, where hardware closes the loops, and where a servo of its own points straight ahead."""
    ask, v, geometry = bench.operator, bench.speed, bench.config.geometry
    for _ in range(TRIES):
        await ask.ready("line", LINE)
        async with bench.robot() as robot:
            options = own_settings(robot.hal)
            x, y = robot.odometry[:2]
            await robot.drive(v, 0.0, DISTANCE / v)
            await asyncio.sleep(STAND)
            shown = hypot(robot.odometry.x - x, robot.odometry.y - y)
        ahead = await ask.number("ahead", "How far did it come along the line?", "m")
        off = 0.0 if options is None else await ask.number("off", OFF, "m")
        if shown < 0.1 * DISTANCE:
            raise HalError(f"its odometry shows {shown:.2f} m: no scale corrects that; 'txt1 doctor' looks closer")
        bend, path = _arc(ahead, off)
        if bench.config.hal == "serial":
            bench.found({"odometry.scale": round(bench.config.odometry.scale * path / shown, 4)})
        else:
            bench.found({"geometry.circumference": round(bench.config.geometry.circumference * path / shown, 5)})
        if options is None or abs(bend) < DRIFT:
            return
        share = atan(bend * geometry.lever) / geometry.steering_max
        bench.found({"hal_options.servo_centre": round(options.servo_centre - options.servo_range * share, 4)})


def own_settings(hal: Hal) -> Any:
    """The settings of a hardware layer that has its own for motor and servo in place of channels; else None."""
    options = getattr(hal, "options", None)
    return options if hasattr(options, "servo_centre") else None


def _arc(ahead: float, off: float) -> tuple[float, float]:
    """The curvature, 1/m, and the length, m, of an arc that begins along the line and ends so far ahead and left."""
    chord = hypot(ahead, off)
    bend = 2.0 * off / (chord * chord)
    return bend, chord if abs(bend) < 1e-6 else 2.0 / bend * asin(max(-1.0, min(1.0, 0.5 * bend * chord)))


async def circle(bench: Bench) -> None:
    """Find the turning radius at full lock, and with encoders the track width and which of them is which."""
    ask, geometry = bench.operator, bench.config.geometry
    bends, shares = [], []
    for sign, way in ((1, "left"), (-1, "right")):
        await ask.ready("circle", f"Put the vehicle where it has room for a circle to the {way}.")
        before, after = await _go_round(bench, sign)
        diameter = await ask.number("diameter", "How wide is the circle of that point, across?", "m")
        bends.append(2.0 / diameter)
        if before is not None and after is not None:
            right, left = after[0] - before[0], after[1] - before[1]
            shares.append(sign * (right - left) / (right + left))
    bend = 0.5 * (bends[0] + bends[1])
    bench.found({"geometry.radius_min": round(1.0 / bend, 4)})
    if shares:
        channels, share = bench.config.channels, 0.5 * (shares[0] + shares[1])
        if share < 0.0:  # the outer wheel seems to go the shorter way
            bench.found({
                "channels.encoders_swapped": not channels.encoders_swapped,
                "channels.right_encoder": channels.left_encoder, "channels.left_encoder": channels.right_encoder,
            })  # fmt: skip
        steered = 0.5 * bend * bend * geometry.wheelbase * geometry.lever if geometry.steering == "both" else 0.0
        bench.found({"geometry.track_width": round(2.0 * abs(share) / bend * (1.0 + steered), 4)})


async def _go_round(bench: Bench, sign: int) -> tuple[Counts, Counts]:
    """Drive a circle at full lock, by hand or where that takes the hardware's loops by these; `sign`: 1 is left."""
    what = "axles" if bench.config.geometry.steering == "both" else "rear wheels"
    about = f"Mark where the point midway between the {what} goes; Enter: once round."
    if bench.own_loops:
        async with bench.robot() as robot:
            v = bench.speed
            driving = asyncio.ensure_future(robot.drive(v, sign * v / bench.config.geometry.radius_min, PATIENCE))
            seeing = asyncio.ensure_future(bench.operator.seen("round", about))
            try:
                await asyncio.wait((driving, seeing), return_when=asyncio.FIRST_COMPLETED)
                if driving.done():
                    driving.result()
            finally:
                driving.cancel()
                seeing.cancel()
                robot.program.release()
            await asyncio.sleep(STAND)
        return None, None
    async with bench.by_hand() as hands:
        hands.steer(0.0, sign * STEERING_MAX)
        await hands.wait(SETTLE)
        before = hands.counts
        hands.steer(bench.cruise, sign * STEERING_MAX)
        await hands.until(bench.operator.seen("round", about))
        return before, hands.counts


async def turn(bench: Bench) -> None:
    """Find the track width by which a vehicle that turns in place turns."""
    ask, geometry = bench.operator, bench.config.geometry
    omega = min(1.5, bench.config.safety.omega_max)
    turned = []
    for seconds in (0.5 * TURNING, TURNING):
        await ask.ready("circle", "Put the vehicle on free floor, and mark which way it points: it turns in place.")
        async with bench.robot() as robot:
            before = robot.runtime.look().ticks
            await robot.drive(0.0, omega, seconds)
            await asyncio.sleep(STAND)
            after = robot.runtime.look().ticks
        degrees = "How far has it turned to the left, whole turns included (360 each)?"
        turned.append(radians(await ask.number("turned", degrees, "degrees")))
    if before is not None and after is not None:
        apart = ((after[0] - before[0]) - (after[1] - before[1])) * geometry.count_length
        bench.found({"geometry.track_width": round(apart / turned[1], 4)})
    else:  # by what half of the time adds, as starting and stopping are the same in both
        rate = (turned[1] - turned[0]) / (0.5 * TURNING)
        bench.found({"geometry.track_width": round(geometry.track_width * omega / rate, 4)})


async def speeds(bench: Bench) -> None:
    """Find the speeds that motor counts make, each by the distance that some seconds more of it add."""
    v_max = bench.config.safety.v_max
    measured: list[tuple[float, float]] = []
    for share in (None, *LEVELS):
        wanted = 0.5 * v_max if share is None else share * v_max
        near = min((abs(wanted - v) for _, v in measured), default=v_max)
        if near < TOO_NEAR * v_max:
            continue
        counts = bench.cruise
        if len(measured) == 1:
            counts = bench.config.car.dead_band + wanted * (counts - bench.config.car.dead_band) / measured[0][1]
        elif measured:
            counts = counts_for(wanted, tuple(measured))
        counts = float(round(min(max(counts, -bench.config.safety.motor_max), bench.config.safety.motor_max)))
        speed = await _speed_at(bench, counts, wanted)
        if speed * wanted <= 0.0:
            bench.operator.tell("It went no further in the longer time: that speed is left out.")
            continue
        entries = sorted([*measured, (counts, round(speed, 4))])
        if any(v1 <= v0 for (_, v0), (_, v1) in pairwise(entries)):
            bench.operator.tell("That speed does not fit the others, and is left out.")
            continue
        measured = entries
        bench.found({"control.speed_map": [list(each) for each in measured]})
    forward = [(u, v) for u, v in measured if u > 0.0]
    if len(forward) > 1:
        gain, offset = np.polyfit([u for u, _ in forward], [v for _, v in forward], 1)
        band = max(0.0, round(float(-offset / gain), 1))
        bench.found({
            "car.dead_band": band, "sim.vehicle.dead_band": band, "sim.vehicle.speed_gain": round(float(gain), 8),
        })  # fmt: skip


async def _speed_at(bench: Bench, counts: float, wanted: float) -> float:
    """The speed at motor counts, m/s: it is driven twice from rest, and the way there and to rest again cancels out."""
    ask, longer = bench.operator, min(max(1.5, 1.5 / abs(wanted)), 5.0)
    way = "forward" if counts > 0.0 else "backward"
    gone = []
    for seconds in (ACCELERATED, ACCELERATED + longer):
        await ask.ready(
            "line", f"Put the vehicle on a mark: it drives {seconds:.1f} s {way}, at some {abs(wanted):.1f} m/s."
        )
        async with bench.by_hand() as hands:
            await hands.wait(SETTLE)
            hands.steer(counts)
            await hands.wait(seconds)
        gone.append(await ask.number("gone", "How far did it come from the mark?", "m"))
    return (gone[1] - gone[0]) / longer * (1.0 if counts > 0.0 else -1.0)


async def tune(bench: Bench) -> None:
    """Find gains of the velocity loops, on a model of the vehicle that a drive of a minute gives."""
    await bench.operator.ready(
        "line", "Put the vehicle on a dozen metres of free floor: it drives to and fro, and turns."
    )
    async with bench.robot() as robot:
        plant = identify(await try_out(robot))
    bench.found({
        "car.speed_gain": round(plant.speed_gain, 8), "car.dead_band": round(plant.dead_band, 1),
        "car.time_constant": round(max(plant.time_constant, 0.01), 4),
        "sim.vehicle.speed_gain": round(plant.speed_gain, 8), "sim.vehicle.dead_band": round(plant.dead_band, 1),
        "sim.vehicle.speed_time_constant": round(max(plant.time_constant, 0.01), 4),
    })  # fmt: skip
    bench.operator.tell("Trying gains on its model: that takes some seconds.")
    control, geometry = bench.config.control, bench.config.geometry
    linear = await asyncio.to_thread(
        lambda: linear_gains(plant, geometry, control.linear.gains(), bench.config.safety.motor_max)
    )
    angular = await asyncio.to_thread(lambda: angular_gains(plant, geometry, control.schedule()))
    sets = [{"v_max": each.v_max, **each.gains._asdict()} for each in angular]
    bench.found({"control.linear": linear._asdict(), "control.angular": sets})


class Step(NamedTuple):
    """A step of the calibration."""

    does: Callable[[Bench], Awaitable[None]]
    applies: Callable[[Config, Hal], bool]

    @property
    def about(self) -> str:
        """What it finds, in words."""
        return (self.does.__doc__ or "").rstrip(".")


def _by_pwm(config: Config, hal: Hal) -> bool:
    return hal.capabilities.pwm


def _steers(config: Config, hal: Hal) -> bool:
    return hal.capabilities.pwm and config.geometry.steering != "skid"


def _counts(config: Config, hal: Hal) -> bool:
    return hal.capabilities.pwm and hal.capabilities.ticks


STEPS: Final[dict[str, Step]] = {
    "motor": Step(motor, _by_pwm),
    "steering": Step(steering, _steers),
    "servo": Step(servo, lambda config, hal: own_settings(hal) is not None),
    "straight": Step(straight, _by_pwm),
    "scale": Step(scale, lambda config, hal: not hal.capabilities.pwm),
    "circle": Step(circle, lambda config, hal: _steers(config, hal) or own_settings(hal) is not None),
    "speeds": Step(speeds, lambda config, hal: hal.capabilities.blind),
    "turn": Step(turn, lambda config, hal: hal.capabilities.pwm and config.geometry.steering == "skid"),
    "tune": Step(tune, lambda config, hal: _counts(config, hal) and config.geometry.steering != "skid"),
}
"""The steps by name, in order."""


def steps(config: Config, hal: Hal) -> list[str]:
    """The names of the steps that a vehicle's calibration has, in order."""
    return [name for name, step in STEPS.items() if step.applies(config, hal)]


async def calibrate(bench: Bench, names: Sequence[str]) -> None:
    """Go through these steps, each marked as done when it is."""
    for number, name in enumerate(names, 1):
        bench.operator.tell(f"-- {number} of {len(names)}, {name}: {STEPS[name].about}")
        await STEPS[name].does(bench)
        done = [each for each in bench.config.calibrated if each != name]
        bench.found({"calibrated": [*done, name]})
