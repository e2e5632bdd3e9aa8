"""Many simulated robots at once, for training that needs millions of steps (extra `fast`: numba).

The vehicle is `txt1.sim.vehicle.advance`, the light `txt1.sim.light.illuminances`: the runtime's own functions, which
numba compiles as they stand. The loops, the odometry and the filter are written out here once more, over rows of
numbers; tests/unit/learning/test_batch.py holds them against the running robot's. Without numba it is the same, slowly.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import floor
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from txt1.control.limits import Limits
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS
from txt1.learning.light import FILTER_WEIGHT
from txt1.model.light import LUX_MAX, LUX_MIN, SAMPLE_PERIOD
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry
from txt1.sim.light import PointLight, illuminances
from txt1.sim.vehicle import VehicleParameters, VehicleState, advance

Array = NDArray[np.float64]

TICK_MS: Final = 20
"""One vehicle step, ms: the controller's period. The light is sampled with it."""
WEIGHT: Final = FILTER_WEIGHT ** (0.001 * TICK_MS / SAMPLE_PERIOD)
"""Of the past in the filter: (5.10) at 20 ms in place of 16."""

# columns of a robot's row: VehicleState first
X, Y, THETA, V = 0, 1, 2, 3
PHASE, COUNT, SENSED, LINEAR, ANGULAR, OUTPUT, FILTERED = 8, 10, 12, 14, 17, 20, 22
COLUMNS: Final = 26

SHARE_MIN: Final = 200
"""Fewer robots than this are not worth a thread of their own."""

_GAINS: Final = np.array([[s.v_max, *s.gains] for s in ANGULAR_GAINS])
_LINEAR: Final = np.array(LINEAR_GAINS)


def _compiled(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """The function compiled, where numba is installed."""
    try:
        from numba import njit
    except ImportError:
        return function
    return cast("Callable[..., Any]", njit(function, **options))


_advance = _compiled(advance)
_illuminances = _compiled(illuminances)


def _pid(row: Array, at: int, error: float, kp: float, ki: float, kd: float, dt: float, limit: float) -> float:
    """One step of the velocity-form PID (4.7); output and two errors are at row[at:at + 3]."""
    e1, e2 = row[at + 1], row[at + 2]
    u = row[at] + kp * (error - e1) + ki * dt * error + kd / dt * (error - 2.0 * e1 + e2)
    if u > limit:
        u = limit
    elif u < -limit:
        u = -limit
    row[at], row[at + 1], row[at + 2] = u, error, e1
    return float(u)


_step_pid = _compiled(_pid)


def _run(
    rows: Array, commands: Array, first: int, drag: Array, noise: Array, parameters: VehicleParameters,
    light: PointLight, motor_max: float, count_length: float, track_width: float, gains: Array, linear: Array,
    begin: int, end: int,
) -> None:  # fmt: skip
    """Move robots `begin` to `end` by len(drag) ticks, the first of which is number `first`; see `Batch.run`."""
    for i in range(begin, end):
        row = rows[i]
        for k in range(drag.shape[0]):
            tick = first + k
            dt = tick * TICK_MS / 1000.0 - (tick - 1) * TICK_MS / 1000.0  # as the running robot measures it
            if tick > 0:
                before = VehicleState(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7])
                s = _advance(before, row[OUTPUT], -row[OUTPUT + 1], row[OUTPUT + 1], dt, drag[k, i], parameters)
                row[PHASE] += (s.right - before.right) / count_length
                row[PHASE + 1] += (s.left - before.left) / count_length
                row[0], row[1], row[2], row[3] = s.x, s.y, s.theta, s.v
                row[4], row[5], row[6], row[7] = s.phi_front, s.phi_rear, s.right, s.left
            # -- the controller, on the velocities of the tick before
            v, omega, v_now, omega_now = commands[i, 0], commands[i, 1], row[SENSED], row[SENSED + 1]
            if v_now == 0.0 and v == 0.0:
                for column in range(LINEAR, OUTPUT + 2):
                    row[column] = 0.0
            else:
                j = 0
                while j < gains.shape[0] - 1 and gains[j, 0] < v_now:
                    j += 1
                yaw_error = 1000.0 * (omega - omega_now)
                if v_now < 0.0:
                    yaw_error = -yaw_error
                motor = _step_pid(row, LINEAR, 1000.0 * (v - v_now), linear[0], linear[1], linear[2], TICK_MS / 1000.0,
                                  PWM_MAX)  # fmt: skip
                steering = _step_pid(row, ANGULAR, yaw_error, gains[j, 1], gains[j, 2], gains[j, 3], TICK_MS / 1000.0,
                                     STEERING_MAX)  # fmt: skip
                row[OUTPUT] = int(min(max(motor, -motor_max), motor_max))
                row[OUTPUT + 1] = int(steering)
            # -- the encoders
            right, left = floor(row[PHASE]), floor(row[PHASE + 1])
            v_right = (right - row[COUNT]) * count_length / dt
            v_left = (left - row[COUNT + 1]) * count_length / dt
            row[COUNT], row[COUNT + 1] = right, left
            row[SENSED], row[SENSED + 1] = (v_right + v_left) / 2.0, (v_right - v_left) / track_width
            # -- the light
            if noise.shape[0]:
                lux = _illuminances(row[X], row[Y], row[THETA], light)
                for column in range(4):
                    reading = min(max(lux[column] * (1.0 + noise[k, i, column]), LUX_MIN), LUX_MAX)
                    past = row[FILTERED + column]
                    row[FILTERED + column] = WEIGHT * past + (1.0 - WEIGHT) * reading if past else reading


_run_some = _compiled(_run, nogil=True)


class Batch:
    """Simulated robots side by side, each with its velocity loops and its light sensors.

    Args:
        count: how many.
        light: what they see.
        noise: standard deviation of a reading, as a share of it.
        drag: of the floor's drag, as a share of the speed.
        parameters: of the vehicle's dynamics.
        body: its dimensions.
        limits: of its motor.

    """

    def __init__(
        self,
        count: int,
        light: PointLight,
        noise: float,
        drag: float,
        parameters: VehicleParameters,
        body: Geometry,
        limits: Limits,
    ) -> None:
        self.rows: Array = np.zeros((count, COLUMNS))
        self.commands: Array = np.zeros((count, 2))
        self.light = light
        self.noise = noise
        self.drag = drag
        self.tick = 0
        self._parameters = parameters
        self._body = body
        self._limits = limits
        shares = min(len(os.sched_getaffinity(0)), 1 + count // SHARE_MIN)
        self._shares = [(count * k // shares, count * (k + 1) // shares) for k in range(shares)]
        self._threads = ThreadPoolExecutor(shares, "txt1-batch") if shares > 1 else None

    @property
    def poses(self) -> Array:
        """x, y (m) and theta (rad) of each, shape (count, 3)."""
        return self.rows[:, :3]

    @property
    def readings(self) -> Array:
        """Filtered readings FL FR RL RR of each, lux, shape (count, 4); 0 before the first."""
        return self.rows[:, FILTERED : FILTERED + 4]

    @property
    def velocities(self) -> Array:
        """Sensed v (m/s) and omega (rad/s) of each, shape (count, 2)."""
        return self.rows[:, SENSED : SENSED + 2]

    def place(self, which: NDArray[np.bool_], poses: Array, rng: np.random.Generator) -> None:
        """Put some of them down at poses (m, rad), at rest, as new; shape (which.sum(), 3)."""
        self.rows[which] = 0.0
        self.rows[which, :3] = poses
        self.rows[which, PHASE : PHASE + 2] = rng.random((int(which.sum()), 2))
        self.commands[which] = 0.0

    def run(self, ticks: int, rng: np.random.Generator, *, sense: bool = True) -> None:
        """Let them drive on by so many ticks of 20 ms; `sense` has the light sampled."""
        count = len(self.rows)
        drag = self.drag * rng.standard_normal((ticks, count))
        noise = self.noise * rng.standard_normal((ticks if sense else 0, count, 4))
        self.run_with(drag, noise)

    def run_with(self, drag: Array, noise: Array) -> None:
        """The same with given random values: shares of the speed (ticks, count) and of a reading (ticks, count, 4)."""
        run = partial(
            _run_some, self.rows, self.commands, self.tick, drag, noise, self._parameters, self.light,
            float(self._limits.motor_max), self._body.count_length, self._body.track_width, _GAINS, _LINEAR,
        )  # fmt: skip
        if self._threads is None:
            run(*self._shares[0])
        else:  # the compiled loop lets go of the interpreter's lock
            list(self._threads.map(lambda share: run(*share), self._shares))
        self.tick += len(drag)
