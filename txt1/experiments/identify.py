"""A small model of the vehicle, on which tuning tries gains, found in a short drive.

If this computer closes the velocity loops, the drive uses PWM set by hand. If a board closes them, the drive uses K_P
alone: then the board's output is K_P times the error, which follows from set-point and odometry.
"""

import asyncio
from collections.abc import Sequence
from itertools import pairwise, product
from math import exp
from typing import Final, NamedTuple

import numpy as np

from txt1.control.pid import CLEAR, Gains, pid
from txt1.control.schedule import GainSet
from txt1.errors import HalError
from txt1.experiments.recording import Array
from txt1.kernel.ticks import Ticks
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry
from txt1.robot import Robot

# motor counts, each held from rest
LEVELS: Final = (900, 1500, 2100, -900, -1500, -2100)
# m/s, set-points in their place for a board's loops
SPEEDS: Final = (0.6, 0.9, 1.2, -0.6, -0.9, -1.2)
# rad/s, the same for LOCKS
TURNS: Final = (0.4, 0.0, -0.4, 0.0, 0.8, 0.0, -0.8, 0.0)
# gain with which about half the commanded speed is reached
SPEED_FEEDBACK: Final = Gains(5.0)
# gain for a third of the yaw rate, at the speed below
TURN_FEEDBACK: Final = Gains(10.0)
# m/s below which a hold began at rest
AT_REST: Final = 0.1
# m/s while the steering is tried
CRUISE_SPEED: Final = 0.5
# s, the longest round trip on a line
DELAYS: Final = tuple(0.002 * k for k in range(101))
# s that a response with K_P alone may take
LAGS: Final = tuple(0.002 * 1.02**k for k in range(320))
# s of each hold: seven times the assumed lag
LEVEL_TIME: Final = 4.0
# s between two holds
REST_TIME: Final = 2.5
# motor counts while the steering is tried
STEERING_TRIAL_COUNTS: Final = 1800
# steering counts, left positive, one after the other
LOCKS: Final = (6000, 0, -6000, 0, 12000, 0, -12000, 0)
# s of each
LOCK_TIME: Final = 1.6
# share of a step's time, at its end, that counts as steady
STEADY_SHARE: Final = 0.4


# unevenness of the floor, as a share of the speed, new at every tick; assumed, so that encoders show no patterns
UNEVENNESS: Final = 0.03
# s between two steps of the loops and two readings of the encoders
SAMPLING_PERIOD: Final = 0.02
# age of the loops' input: half a period to measure, a period to wait, half a period to hold
LOOP_DELAY: Final = 2.0 * SAMPLING_PERIOD


class Plant(NamedTuple):
    """A vehicle as its two loops see it."""

    # m/s per PWM count beyond the dead band
    speed_gain: float
    dead_band: float  # counts
    # lag of the speed, s
    time_constant: float
    # yaw rate per count of steering and m/s of speed, rad/m
    steering_gain: float
    # lag of the wheels' steering behind the counts, s
    steering_lag: float


class HeldOutputs(NamedTuple):
    """Outputs that were held, or settled with K_P alone, and the encoders' readings meanwhile."""

    # counts, when steady
    motor: float
    # counts, left positive
    steering: float
    # speed at every tick, or at every message of a board, m/s
    v: tuple[float, ...]
    # the same for the yaw rate, rad/s
    omega: tuple[float, ...]
    # times of these, s since the hold began; empty: at every tick
    times: tuple[float, ...] = ()
    # K_P in counts per m/s; 0: set by hand
    speed_feedback: float = 0.0
    # K_P in counts per rad/s
    turn_feedback: float = 0.0


async def try_out(robot: Robot) -> list[HeldOutputs]:
    """Return the motion for different outputs; the vehicle needs a dozen metres of free floor.

    Raises HalError: the HAL has neither PWM with encoder counts, nor a board's loops with gains.
    """
    can = robot.hal.capabilities
    if can.pwm and can.ticks:
        return await _by_hand(robot)
    if can.gains:
        return await _by_feedback(robot)
    raise HalError(
        f"tuning needs PWM and encoder counts, or a board that takes gains, and the HAL '{robot.hal.name}' has "
        "neither; tune with --hal sim, what is known of the vehicle under sim.vehicle, and load the gains with --config"
    )


async def _by_hand(robot: Robot) -> list[HeldOutputs]:
    """Return the motion for outputs set by hand."""
    readings: list[tuple[float, float]] = []

    async def measure(ticks: Ticks) -> None:
        async for _ in ticks:
            readings.append((robot.odometry.v, robot.odometry.omega))

    robot.add_task("measurement", 0.02, measure, priority=-1)
    holds: list[HeldOutputs] = []

    async def hold(motor: int, steering: int, seconds: float) -> None:
        first = len(readings)
        # front -u, rear +u turns left
        await robot.hold_pwm(motor, -steering, steering, duration=seconds)
        v, omega = zip(*readings[first:], strict=True)
        holds.append(HeldOutputs(motor, steering, v, omega))

    await robot.set_manual(True)
    try:
        for level in LEVELS:
            await hold(level, 0, LEVEL_TIME)
            await hold(0, 0, REST_TIME)
        await hold(STEERING_TRIAL_COUNTS, 0, LEVEL_TIME)
        for lock in LOCKS:
            await hold(STEERING_TRIAL_COUNTS, lock, LOCK_TIME)
    finally:
        await robot.set_manual(False)
    return holds


async def _by_feedback(robot: Robot) -> list[HeldOutputs]:
    """Return the motion with K_P alone in a board's loops; their own gains are restored."""
    # s, m/s, rad/s
    readings: list[tuple[float, float, float]] = []

    async def measure(ticks: Ticks) -> None:
        async for _ in ticks:
            arrived = robot.runtime.state.odometry_time
            if not readings or arrived > readings[-1][0]:
                readings.append((arrived, robot.odometry.v, robot.odometry.omega))

    control = robot.config.loops()
    linear, angular = control.linear.gains(), control.schedule().sets
    turning = tuple(each._replace(gains=TURN_FEEDBACK) for each in angular)
    robot.add_task("measurement", SAMPLING_PERIOD, measure, priority=-1)
    holds: list[HeldOutputs] = []

    async def keep(v: float, omega: float, seconds: float) -> None:
        ends = robot.now + seconds
        while robot.now < ends:
            robot.program.insist(v, omega)
            await asyncio.sleep(SAMPLING_PERIOD)

    async def load(linear: Gains, angular: Sequence[GainSet]) -> None:
        await keep(0.0, 0.0, REST_TIME)
        if not await robot.load_gains(linear, angular):
            raise HalError("the board does not accept the gains that it is tried with, K_P alone; tune with --hal sim")

    async def hold(v: float, omega: float, seconds: float, speed: Gains, turn: Gains) -> None:
        begin, first = robot.now, len(readings)
        await keep(v, omega, seconds)
        times, speeds, rates = zip(*readings[first:], strict=True)
        motor, steering = 1000.0 * speed.kp, 1000.0 * turn.kp
        holds.append(
            HeldOutputs(
                motor * (v - _steady(speeds)),
                steering * (omega - _steady(rates)),
                speeds,
                rates,
                tuple(time - begin for time in times),
                motor,
                steering,
            )
        )

    try:
        await load(SPEED_FEEDBACK, angular)
        for level in SPEEDS:
            await hold(level, 0.0, LEVEL_TIME, SPEED_FEEDBACK, Gains())
            await keep(0.0, 0.0, REST_TIME)
        await load(linear, turning)
        await hold(CRUISE_SPEED, 0.0, LEVEL_TIME, Gains(), Gains())
        for turn in TURNS:
            await hold(CRUISE_SPEED, turn, LOCK_TIME, Gains(), TURN_FEEDBACK)
    finally:
        robot.program.release()
        await robot.load_gains(linear, angular)
    return holds


def identify(holds: Sequence[HeldOutputs], period: float = SAMPLING_PERIOD) -> Plant:
    """Return the vehicle that explains a drive.

    Steady speeds v = K (abs(u) - d) give the gain K and the dead band d as a line. A lag T makes the area between a
    step's end value and its response T times the step, whatever the shape: that gives both lags, dead times included.
    The yaw rate is k v u, its gain k the slope through all steady values.

    With K_P alone the response shows a shorter lag (`_without_feedback`), after the delay of the line.
    """
    straight = [hold for hold in holds if hold.motor and abs(hold.v[0]) < AT_REST]
    counts = np.array([abs(hold.motor) for hold in straight], float)
    speeds = np.array([abs(_steady(hold.v)) for hold in straight])
    gain, offset = np.polyfit(counts, speeds, 1)
    turning = [(before, hold) for before, hold in pairwise(holds) if before.steering or hold.steering]
    turned = np.array([_steady(hold.omega) for _, hold in turning])
    asked = np.array([_steady(hold.v) * hold.steering for _, hold in turning])
    steering_gain = float((asked @ turned) / (asked @ asked))
    dead_band = max(0.0, float(-offset / gain))

    if not holds[0].speed_feedback:
        lag = float(np.median([_area(hold.v, 0.0, period) for hold in straight]))
        steering_lags = [_area(hold.omega, _steady(before.omega), period) for before, hold in turning]
        return Plant(float(gain), dead_band, lag, steering_gain, max(0.0, float(np.mean(steering_lags))))

    delay, followed = _delay_and_lag([(hold.times, _shares(hold.v, 0.0)) for hold in straight], DELAYS)
    turns = [(hold.times, _shares(hold.omega, _steady(before.omega))) for before, hold in turning]
    _, turned_after = _delay_and_lag(turns, (delay,))
    turn_feedback = float(np.mean([abs(_steady(hold.v)) * hold.turn_feedback for _, hold in turning]))
    return Plant(
        float(gain),
        dead_band,
        _without_feedback(followed, float(gain) * holds[0].speed_feedback),
        steering_gain,
        _without_feedback(turned_after, steering_gain * turn_feedback),
    )


def _without_feedback(lag: float, loop_gain: float) -> float:
    """Return the lag T of the vehicle alone, s: in a loop of gain g and delay D it was seen as (T - g D) / (1 + g)."""
    return lag * (1.0 + loop_gain) + loop_gain * LOOP_DELAY


def _shares(values: Sequence[float], before: float) -> Array:
    """Return a response as a share of its step."""
    return (np.array(values) - before) / (_steady(values) - before)


def _delay_and_lag(responses: Sequence[tuple[Sequence[float], Array]], delays: Sequence[float]) -> tuple[float, float]:
    """Return the delay and the lag, s, of the first-order response that fits all of these best, by least squares."""
    times = np.concatenate([each for each, _ in responses])
    shares = np.concatenate([each for _, each in responses])

    def distance(delay: float, lag: float) -> float:
        left = np.exp(-np.maximum(times - delay, 0.0) / lag)
        return float(np.square(1.0 - left - shares).sum())

    return min(product(delays, LAGS), key=lambda each: distance(*each))


def _steady(values: Sequence[float]) -> float:
    return float(np.mean(values[-round(len(values) * STEADY_SHARE) :]))


def _area(values: Sequence[float], before: float, period: float) -> float:
    """Return the area between a response and its end value, divided by the step, s."""
    after = _steady(values)
    return float(np.sum(after - np.array(values)) * period / (after - before))


def speed_response(
    plant: Plant, gains: Gains, target: float, seconds: float, geometry: Geometry, seed: int, motor_max: float
) -> Array:
    """Return the speed, m/s, at every tick after a step from rest to `target` m/s, shape (ticks,)."""
    decay = exp(-SAMPLING_PERIOD / plant.time_constant)
    ticks, rng = round(seconds / SAMPLING_PERIOD), np.random.default_rng(seed)
    v, path, counts = 0.0, rng.random() * geometry.count_length, 0
    bumps = (UNEVENNESS * SAMPLING_PERIOD / plant.time_constant * rng.standard_normal(ticks)).tolist()
    speeds = []
    past, measured = CLEAR, 0.0
    for bump in bumps:
        motor = past[0]
        beyond = max(min(abs(motor), motor_max) - plant.dead_band, 0.0)
        v_free = plant.speed_gain * (beyond if motor > 0.0 else -beyond)
        path += v_free * SAMPLING_PERIOD + (v - v_free) * plant.time_constant * (1.0 - decay)
        v = (v_free + (v - v_free) * decay) * (1.0 - bump)
        now = int(path // geometry.count_length)
        # the controller runs before the encoders are read, so it uses the reading of the tick before
        past = pid(past, 1000.0 * (target - measured), gains, SAMPLING_PERIOD, PWM_MAX)
        measured = (now - counts) * geometry.count_length / SAMPLING_PERIOD
        counts = now
        speeds.append(v)
    return np.array(speeds)


def yaw_response(
    plant: Plant, gains: Gains, v: float, before: float, after: float, seconds: float, geometry: Geometry, seed: int
) -> Array:
    """Return the yaw rate, rad/s, at every tick after a step of its set-point at `v` m/s, shape (ticks,)."""
    gain = plant.steering_gain * abs(v)
    decay = exp(-SAMPLING_PERIOD / max(plant.steering_lag, 1e-6))
    edge, half_track = geometry.count_length, 0.5 * geometry.track_width
    omega = measured = before
    past = (before / gain, 0.0, 0.0)
    ticks, rng = round(seconds / SAMPLING_PERIOD), np.random.default_rng(seed)
    right, left, rights, lefts = rng.random() * edge, rng.random() * edge, 0, 0
    rates = []
    for bump in (0.5 * UNEVENNESS * rng.standard_normal(ticks)).tolist():
        settled = gain * min(max(past[0], -STEERING_MAX), STEERING_MAX)
        turned = settled * SAMPLING_PERIOD + (omega - settled) * plant.steering_lag * (1.0 - decay)
        omega = settled + (omega - settled) * decay
        path = v * (1.0 - bump) * SAMPLING_PERIOD
        right += path + half_track * turned
        left += path - half_track * turned
        past = pid(past, 1000.0 * (after - measured), gains, SAMPLING_PERIOD, STEERING_MAX)
        now = int(right // edge), int(left // edge)
        measured = (now[0] - rights - now[1] + lefts) * edge / (geometry.track_width * SAMPLING_PERIOD)
        rights, lefts = now
        rates.append(omega)
    return np.array(rates)
