"""Finding a vehicle's gains and lags in a short drive with the PWM set by hand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from txt1.errors import HalError
from txt1.experiments.plant import Plant
from txt1.hal.base import Hal
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot

LEVELS: Final = (900, 1500, 2100, -900, -1500, -2100)  # motor counts, each held from rest
LEVEL_TIME: Final = 4.0  # s of each: seven times the assumed lag
REST_TIME: Final = 2.5  # s in between
CRUISE: Final = 1800  # motor counts while the steering is tried
LOCKS: Final = (6000, 0, -6000, 0, 12000, 0, -12000, 0)  # steering counts, left positive, one after the other
LOCK_TIME: Final = 1.6  # s of each
STEADY: Final = 0.4  # share of a step's time, at its end, that counts as steady


class Hold(NamedTuple):
    """Outputs that were held, and what the encoders told meanwhile."""

    motor: int  # counts
    steering: int  # counts, left positive
    v: tuple[float, ...]  # at every tick, m/s
    omega: tuple[float, ...]  # at every tick, rad/s


def require_pwm_and_ticks(hal: Hal) -> None:
    """Refuse a HAL over which a vehicle cannot be identified.

    Raises HalError: it takes no PWM, or gives no encoder counts to judge by.
    """
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


def identify(holds: Sequence[Hold], period: float = 0.02) -> Plant:
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
    return Plant(
        float(gain),
        max(0.0, float(-offset / gain)),
        float(np.median(lags)),
        steering_gain,
        max(0.0, float(np.mean(steering_lags))),
    )


def _steady(values: Sequence[float]) -> float:
    return float(np.mean(values[-round(len(values) * STEADY) :]))


def _area(values: Sequence[float], before: float, period: float) -> float:
    """Area between a response and its end value, per height of the step, s."""
    after = _steady(values)
    return float(np.sum(after - np.array(values)) * period / (after - before))
