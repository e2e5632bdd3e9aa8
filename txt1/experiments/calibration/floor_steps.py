"""Steps on the floor: distance, straight ahead, and turning radius."""

import asyncio
from math import asin, atan, cos, degrees, hypot, radians, sin, sqrt, tan
from typing import Final

from txt1.control.limits import clip
from txt1.errors import HalError
from txt1.experiments.calibration.bench import DRIVE_PATIENCE, STAND, STEERING_TIME, Bench, Operator
from txt1.model.odometry import Odometry
from txt1.model.vehicle import STEERING_MAX

# s of turning in place: the error of a guessed angle is some degrees, whatever the time
TURNING: Final = 16.0
# m to drive straight
STRAIGHT_DISTANCE: Final = 3.0
# rad of heading lost per metre that count as straight
DRIFT: Final = radians(0.3)
# smallest share of the other axle's angle that an axle has at full lock
UNLIKE: Final = 0.5
# largest number of drives
DRIVES_MAX: Final = 4
# standard deviation of an axle's middle between its two stops, as a share of full lock; assumed
MIDDLE: Final = 0.03
# m, standard deviation of a measurement with a tape; assumed
TAPE_SIGMA: Final = 0.005
# rad, the same of the heading with which it is put on the line; assumed
ALIGNED: Final = radians(0.3)
LINE: Final = f"Put the vehicle at the beginning of a straight line of {STRAIGHT_DISTANCE + 2.0:g} m, along it."
OFF: Final = "How far left of the line is it (right: negative)?"

# counts of the right and left encoder; None without encoders
Counts = tuple[int, int] | None


async def straight(bench: Bench) -> None:
    """Find the trim for driving straight, and with encoders the metres of a count."""
    ask, geometry = bench.operator, bench.config.geometry
    if bench.skids and not geometry.counts_per_rev:
        await _even_sides(bench)
        return
    # the car's nose may point aside of its way: variances of that angle before a drive, and as a tape tells it
    known, told = (MIDDLE * geometry.steering_max) ** 2, (0.7 * TAPE_SIGMA / geometry.wheelbase) ** 2 + ALIGNED**2
    for number in range(DRIVES_MAX):
        await ask.ready("line", LINE)
        shown = await _go_straight(bench)
        ahead = await _length(ask, "ahead", "How far did it come along the line?")
        if geometry.steering == "both":
            front = await ask.number("front_off", "How far left of the line is the middle of its front axle?", "m")
            rear = await ask.number("rear_off", "... and of its rear axle?", "m")
            bend = (front - rear) / geometry.wheelbase / ahead
            crab = 0.5 * (front + rear) / ahead - 0.5 * bend * ahead
            off = 0.5 * bend * ahead * ahead
            angles = {"front": atan(crab + bend * geometry.lever), "rear": atan(crab - bend * geometry.lever)}
            # over a short wheelbase a tape tells less of the nose than the axles' stops: one measure is weighed
            # against the other, while the errors of the bend are averaged over the drives
            weight, mean = known / (known + told), 1.0 / (1 + number)
            known *= 1.0 - weight
            turned = {"front": atan(mean * bend * geometry.lever), "rear": -atan(mean * bend * geometry.lever)}
            shift = {axle: weight * crab + angle for axle, angle in turned.items()}
        else:
            off = await ask.number("off", OFF, "m")
            bend = _arc(ahead, off)[0]
            angles = shift = {"front": atan(bend * geometry.lever)}
        if shown is not None:
            if shown < 0.1 * ahead:
                raise HalError(f"its odometry shows {shown:.2f} m for {ahead:.2f} m: look after the encoder's wires")
            circumference = bench.config.geometry.circumference * hypot(ahead, off) / shown
            bench.found({"geometry.circumference": round(circumference, 5)})
        if bench.skids:
            # the loops correct this
            return
        if max(abs(tan(angle)) for angle in angles.values()) < DRIFT * geometry.lever:
            return
        for axle, angle in shift.items():
            channel = getattr(bench.config.channels, axle)
            too_far = -STEERING_MAX * angle / geometry.steering_max
            trim = channel.trim - channel.direction * channel.scale * too_far
            bench.found({f"channels.{axle}.trim": float(round(trim))})


async def _length(ask: Operator, key: str, text: str) -> float:
    """Return a positive length in m; ask again for any other answer. Raises HalError after that."""
    for _ in range(DRIVES_MAX):
        length = await ask.number(key, text, "m")
        if length > 0.0:
            return length
        ask.tell(f"{length:g} m is no distance: measure it in metres, more than 0, such as 2.95.")
    raise HalError("it went nowhere, so there is nothing to measure by: look after the motor and its direction")


async def _even_sides(bench: Bench) -> None:
    """Find scales and trims with which both sides have the same speed: two unknowns, so forward and backward."""
    ask, geometry, band = bench.operator, bench.config.geometry, bench.config.car.dead_band
    for _ in range(DRIVES_MAX):
        bends, more = [], []
        for sign, where in ((1.0, ""), (-1.0, " It drives backward.")):
            await ask.ready("line", LINE + where)
            await _go_straight(bench, sign * bench.cruise)
            ahead = await _length(ask, "ahead", "How far did it come along the line?")
            bends.append(_arc(ahead, await ask.number("off", OFF, "m"))[0])
            # counts by which the right side exceeds the left
            more.append(bends[-1] * sign * (bench.cruise - band) * geometry.track_width)
        if max(map(abs, bends)) < DRIFT:
            return
        scale = clip(0.5 * (more[0] - more[1]) / bench.cruise, 0.3)
        trim = clip(0.5 * (more[0] + more[1]), 0.5 * band)
        for name, half in (("right", -0.5), ("left", 0.5)):
            channel = getattr(bench.config.channels, name)
            bench.found(
                {
                    f"channels.{name}.scale": round(channel.scale * (1.0 + half * scale), 4),
                    f"channels.{name}.trim": round(channel.trim + half * channel.direction * channel.scale * trim, 1),
                }
            )


async def _go_straight(bench: Bench, by_hand: float | None = None) -> float | None:
    """Drive straight, by hand or by the hardware's loops; return the distance ahead by the odometry, m."""
    if bench.skids and bench.config.geometry.counts_per_rev:
        v = bench.speed
        async with bench.robot() as robot:
            begin = robot.odometry
            await robot.drive(v, 0.0, STRAIGHT_DISTANCE / v)
            await asyncio.sleep(STAND)
            return _shown(begin, robot.odometry)
    async with bench.by_hand() as hands:
        await hands.wait(STEERING_TIME)
        begin = hands.robot.odometry
        hands.steer(bench.cruise if by_hand is None else by_hand)
        seen = bench.operator.seen(
            "gone", f"Press Enter when it has gone about {STRAIGHT_DISTANCE:g} m, or has turned a good way."
        )
        await hands.until(seen)
        hands.steer(0.0)
        await hands.wait(STAND)
        return None if hands.robot.hal.capabilities.blind else _shown(begin, hands.robot.odometry)


def _shown(begin: Odometry, end: Odometry) -> float:
    """Return the distance from one pose to another, m; negative if it is backward."""
    x, y = end.x - begin.x, end.y - begin.y
    return hypot(x, y) * (1.0 if x * cos(begin.theta) + y * sin(begin.theta) > 0.0 else -1.0)


async def scale(bench: Bench) -> None:
    """Find the scale of distances, for hardware that closes the loops, and the straight position of its servo."""
    ask, v, geometry = bench.operator, bench.speed, bench.config.geometry
    for _ in range(DRIVES_MAX):
        await ask.ready("line", LINE)
        async with bench.robot() as robot:
            options = robot.hal.own_channels
            x, y = robot.odometry[:2]
            await robot.drive(v, 0.0, STRAIGHT_DISTANCE / v)
            await asyncio.sleep(STAND)
            shown = hypot(robot.odometry.x - x, robot.odometry.y - y)
        ahead = await _length(ask, "ahead", "How far did it come along the line?")
        off = 0.0 if options is None else await ask.number("off", OFF, "m")
        if shown < 0.1 * STRAIGHT_DISTANCE:
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


def _arc(ahead: float, off: float) -> tuple[float, float]:
    """Return curvature, 1/m, and length, m, of an arc that begins along the line and ends `ahead` and `off` to
    the left.
    """
    chord = hypot(ahead, off)
    bend = 2.0 * off / (chord * chord)
    return bend, chord if abs(bend) < 1e-6 else 2.0 / bend * asin(max(-1.0, min(1.0, 0.5 * bend * chord)))


async def circle(bench: Bench) -> None:
    """Find the turning radius at full lock, and with encoders the track width and which encoder is which."""
    ask, geometry = bench.operator, bench.config.geometry
    bends, shares, locks = [], [], []
    for sign, way in ((1, "left"), (-1, "right")):
        await ask.ready("circle", f"Put the vehicle where it has room for a circle to the {way}.")
        before, after = await _go_round(bench, sign)
        if geometry.steering == "both":
            front = await _length(ask, "front_diameter", "How wide is the circle of the front axle's middle, across?")
            rear = await _length(ask, "rear_diameter", "... and that of the rear axle's?")
            bend, *lock = _locks(0.5 * front, 0.5 * rear, geometry.lever)
            bends.append(bend)
            locks.append(lock)
        else:
            diameter = await _length(ask, "diameter", "How wide is the circle of that point, across?")
            bends.append(2.0 / diameter)
        if before is not None and after is not None:
            right, left = after[0] - before[0], after[1] - before[1]
            shares.append(sign * (right - left) / (right + left))
    if locks:
        _compare(ask, *(degrees(0.5 * (left + right)) for left, right in zip(*locks, strict=True)))
    bend = 0.5 * (bends[0] + bends[1])
    bench.found({"geometry.radius_min": round(1.0 / bend, 4)})
    if shares:
        channels, share = bench.config.channels, 0.5 * (shares[0] + shares[1])
        # the outer wheel seems to travel less
        if share < 0.0:
            bench.found(
                {
                    "channels.encoders_swapped": not channels.encoders_swapped,
                    "channels.right_encoder": channels.left_encoder,
                    "channels.left_encoder": channels.right_encoder,
                }
            )
        steered = 0.5 * bend * bend * geometry.wheelbase * geometry.lever if geometry.steering == "both" else 0.0
        bench.found({"geometry.track_width": round(2.0 * abs(share) / bend * (1.0 + steered), 4)})


def _locks(front: float, rear: float, lever: float) -> tuple[float, float, float]:
    """Return curvature, 1/m, and angles of the front and rear axle, rad, of a car that drives a circle.

    Args:
        front: radius of the circle of the front axle's middle, m.
        rear: the same of the rear axle's; the car's own middle runs on R, R**2 = (front**2 + rear**2) / 2 - lever**2.
        lever: half of the wheelbase, m.

    The car's nose points out of the curve by beta, with sin(beta) = (front**2 - rear**2) / (4 R lever). By the bicycle
    model the angles of the axles into the curve are

        tan(front) = lever / (R cos(beta)) + tan(beta),    tan(rear) = lever / (R cos(beta)) - tan(beta)

    Raises HalError: there is no such circle.

    """
    squared = 0.5 * (front * front + rear * rear) - lever * lever
    radius = sqrt(max(squared, 0.0))
    crab = (front * front - rear * rear) / (4.0 * radius * lever) if radius else 1.0
    if abs(crab) >= 1.0:
        raise HalError(
            f"no car of this wheelbase drives circles of {2.0 * front:g} m in front and {2.0 * rear:g} m behind: "
            "measure again, in metres, or look after geometry.wheelbase"
        )
    beta = asin(crab)
    bend = lever / (radius * cos(beta))
    return 1.0 / radius, atan(bend + tan(beta)), atan(bend - tan(beta))


def _compare(ask: Operator, front: float, rear: float) -> None:
    """Tell the axles' steering angles at full lock, degrees; raises HalError if an axle steers much less than
    the other.
    """
    told = f"at full lock the front wheels steer {front:.1f} degrees, and the rear ones {rear:.1f}"
    less, more = sorted((front, rear))
    if less < UNLIKE * more:
        axle = "front" if front < rear else "rear"
        raise HalError(f"{told}: look after the {axle} linkage and its servo, then do --step steering again")
    ask.tell(f"{told[0].upper()}{told[1:]}.")


async def _go_round(bench: Bench, sign: int) -> tuple[Counts, Counts]:
    """Drive a circle at full lock, by hand or by the hardware's loops; `sign`: 1 is left."""
    point = (
        "the middles of both axles go" if bench.config.geometry.steering == "both" else "the rear axle's middle goes"
    )
    about = f"Mark where {point}; Enter: once round."
    if bench.own_loops:
        async with bench.robot() as robot:
            v = bench.speed
            driving = asyncio.ensure_future(robot.drive(v, sign * v / bench.config.geometry.radius_min, DRIVE_PATIENCE))
            seeing = asyncio.ensure_future(bench.operator.seen("round", about))
            try:
                await asyncio.wait((driving, seeing), return_when=asyncio.FIRST_COMPLETED)
                for done in filter(asyncio.Future.done, (driving, seeing)):
                    done.result()
            finally:
                driving.cancel()
                seeing.cancel()
                robot.program.release()
            await asyncio.sleep(STAND)
        return None, None
    async with bench.by_hand() as hands:
        hands.steer(0.0, sign * STEERING_MAX)
        await hands.wait(STEERING_TIME)
        before = hands.counts
        hands.steer(bench.cruise, sign * STEERING_MAX)
        await hands.until(bench.operator.seen("round", about))
        return before, hands.counts


async def turn(bench: Bench) -> None:
    """Find the effective track width of a vehicle that turns in place."""
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
    else:
        # the angle added by half of the time, as starting and stopping are the same in both
        rate = (turned[1] - turned[0]) / (0.5 * TURNING)
        bench.found({"geometry.track_width": round(geometry.track_width * omega / rate, 4)})
