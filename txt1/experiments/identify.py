"""A small model of the vehicle, on which tuning tries gains, found in a short drive with the PWM set by hand."""

from collections.abc import Sequence
from itertools import pairwise
from math import exp
from typing import Final, NamedTuple

import numpy as np

from txt1.control.pid import CLEAR, Gains, pid
from txt1.errors import HalError
from txt1.experiments.recording import Array
from txt1.hal.base import Hal
from txt1.kernel.ticks import Ticks
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry
from txt1.robot import Robot

LEVELS: Final = (900, 1500, 2100, -900, -1500, -2100)  # motor counts, each held from rest
LEVEL_TIME: Final = 4.0  # s of each: seven times the assumed lag
REST_TIME: Final = 2.5  # s in between
CRUISE: Final = 1800  # motor counts while the steering is tried
LOCKS: Final = (6000, 0, -6000, 0, 12000, 0, -12000, 0)  # steering counts, left positive, one after the other
LOCK_TIME: Final = 1.6  # s of each
STEADY: Final = 0.4  # share of a step's time, at its end, that counts as steady


# unevenness of the floor, as a share of the speed, anew at every tick; assumed, for the encoders show no patterns
UNEVENNESS: Final = 0.03
PERIOD: Final = 0.02  # s between two steps of the loops and two readings of the encoders


class Plant(NamedTuple):
    """A vehicle as its two loops see it."""

    speed_gain: float  # m/s per PWM count beyond the dead band
    dead_band: float  # counts
    time_constant: float  # of the speed, s
    steering_gain: float  # yaw rate per count of steering and m/s of speed, rad/m
    steering_lag: float  # s by which the wheels' turn follows the counts


class Hold(NamedTuple):
    """Outputs that were held, and what the encoders told meanwhile."""

    motor: int  # counts
    steering: int  # counts, left positive
    v: tuple[float, ...]  # at every tick, m/s
    omega: tuple[float, ...]  # at every tick, rad/s


def require_pwm_and_ticks(hal: Hal) -> None:
    """Raise HalError for a HAL that takes no PWM, or gives no encoder counts to judge by."""
    if not (hal.capabilities.pwm and hal.capabilities.ticks):
        raise HalError(
            f"tuning sets PWM by hand and counts encoder ticks 50 times a second, which the HAL '{hal.name}' cannot; "
            "tune with --hal sim, what is known of the vehicle under sim.vehicle, and load the gains with --config"
        )


async def try_out(robot: Robot) -> list[Hold]:
    """Return the motion at outputs set by hand; the vehicle needs a dozen metres of free floor."""
    readings: list[tuple[float, float]] = []

    async def measure(ticks: Ticks) -> None:
        async for _ in ticks:
            readings.append((robot.odometry.v, robot.odometry.omega))

    robot.add_task("measurement", 0.02, measure, priority=-1)
    holds: list[Hold] = []

    async def hold(motor: int, steering: int, seconds: float) -> None:
        first = len(readings)
        # front -u, rear +u turns left
        await robot.hold_pwm(motor, -steering, steering, duration=seconds)
        v, omega = zip(*readings[first:], strict=True)
        holds.append(Hold(motor, steering, v, omega))

    await robot.set_manual(True)
    try:
        for level in LEVELS:
            await hold(level, 0, LEVEL_TIME)
            await hold(0, 0, REST_TIME)
        await hold(CRUISE, 0, LEVEL_TIME)
        for lock in LOCKS:
            await hold(CRUISE, lock, LOCK_TIME)
    finally:
        await robot.set_manual(False)
    return holds


def identify(holds: Sequence[Hold], period: float = PERIOD) -> Plant:
    """The vehicle that explains a drive.

    Steady speeds v = K (abs(u) - d) give the gain K and the dead band d as a line. A lag T makes the area between a
    step's end value and its response T times the step, whatever the shape: that gives both lags, dead times included.
    The yaw rate is k v u, its gain k the slope through all steady values.
    """
    from_rest = [holds[0], *(hold for before, hold in pairwise(holds) if not before.motor)]
    straight = [hold for hold in from_rest if hold.motor and not hold.steering]
    counts = np.array([abs(hold.motor) for hold in straight], float)
    speeds = np.array([abs(_steady(hold.v)) for hold in straight])
    gain, offset = np.polyfit(counts, speeds, 1)
    lags = [_area(hold.v, 0.0, period) for hold in straight]

    turning = [(before, hold) for before, hold in pairwise(holds) if before.steering or hold.steering]
    turned = np.array([_steady(hold.omega) for _, hold in turning])
    asked = np.array([_steady(hold.v) * hold.steering for _, hold in turning])
    steering_gain = float((asked @ turned) / (asked @ asked))
    steering_lags = [_area(hold.omega, _steady(before.omega), period) for before, hold in turning]
    dead_band, steering_lag = max(0.0, float(-offset / gain)), max(0.0, float(np.mean(steering_lags)))
    return Plant(float(gain), dead_band, float(np.median(lags)), steering_gain, steering_lag)


def _steady(values: Sequence[float]) -> float:
    return float(np.mean(values[-round(len(values) * STEADY) :]))


def _area(values: Sequence[float], before: float, period: float) -> float:
    """Area between a response and its end value, per height of the step, s."""
    after = _steady(values)
    return float(np.sum(after - np.array(values)) * period / (after - before))


def speed_response(
    plant: Plant, gains: Gains, target: float, seconds: float, geometry: Geometry, seed: int, motor_max: float
) -> Array:
    """The speed, m/s, at every tick after a step from rest to `target` m/s, shape (ticks,)."""
    decay = exp(-PERIOD / plant.time_constant)
    ticks, rng = round(seconds / PERIOD), np.random.default_rng(seed)
    v, path, counts = 0.0, rng.random() * geometry.count_length, 0
    bumps = (UNEVENNESS * PERIOD / plant.time_constant * rng.standard_normal(ticks)).tolist()
    speeds = []
    past, measured = CLEAR, 0.0
    for bump in bumps:
        motor = past[0]
        beyond = max(min(abs(motor), motor_max) - plant.dead_band, 0.0)
        v_free = plant.speed_gain * (beyond if motor > 0.0 else -beyond)
        path += v_free * PERIOD + (v - v_free) * plant.time_constant * (1.0 - decay)
        v = (v_free + (v - v_free) * decay) * (1.0 - bump)
        now = int(path // geometry.count_length)
        # the controller runs before the encoders are read, so it works on the reading of the tick before
        past = pid(past, 1000.0 * (target - measured), gains, PERIOD, PWM_MAX)
        measured = (now - counts) * geometry.count_length / PERIOD
        counts = now
        speeds.append(v)
    return np.array(speeds)


def yaw_response(
    plant: Plant, gains: Gains, v: float, before: float, after: float, seconds: float, geometry: Geometry, seed: int
) -> Array:
    """The yaw rate, rad/s, at every tick after a step of its set-point at a speed of `v` m/s, shape (ticks,)."""
    gain = plant.steering_gain * abs(v)
    decay = exp(-PERIOD / max(plant.steering_lag, 1e-6))
    edge, half_track = geometry.count_length, 0.5 * geometry.track_width
    omega = measured = before
    past = (before / gain, 0.0, 0.0)
    ticks, rng = round(seconds / PERIOD), np.random.default_rng(seed)
    right, left, rights, lefts = rng.random() * edge, rng.random() * edge, 0, 0
    rates = []
    for bump in (0.5 * UNEVENNESS * rng.standard_normal(ticks)).tolist():
        settled = gain * min(max(past[0], -STEERING_MAX), STEERING_MAX)
        turned = settled * PERIOD + (omega - settled) * plant.steering_lag * (1.0 - decay)
        omega = settled + (omega - settled) * decay
        path = v * (1.0 - bump) * PERIOD
        right += path + half_track * turned
        left += path - half_track * turned
        past = pid(past, 1000.0 * (after - measured), gains, PERIOD, STEERING_MAX)
        now = int(right // edge), int(left // edge)
        measured = (now[0] - rights - now[1] + lefts) * edge / (geometry.track_width * PERIOD)
        rights, lefts = now
        rates.append(omega)
    return np.array(rates)
