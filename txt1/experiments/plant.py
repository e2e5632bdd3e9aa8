"""A small model of the vehicle, identified in a drive, on which tuning tries gains."""

from __future__ import annotations

from math import exp
from typing import Final, NamedTuple

import numpy as np

from txt1.control.pid import CLEAR, Gains, pid
from txt1.experiments.recording import Array
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry

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


def speed_response(
    plant: Plant, gains: Gains, target: float, seconds: float, geometry: Geometry, seed: int, motor_max: float
) -> Array:
    """The speed, m/s, at every tick after a step from rest to `target` m/s, shape (ticks,).

    The encoders count whole edges, and the safety gate limits the motor. The seed repeats what is random.
    """
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
    """The yaw rate, rad/s, at every tick after a step of its set-point at a speed of `v` m/s, shape (ticks,).

    Each wheel's encoder counts whole edges. The seed repeats what is random.
    """
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
