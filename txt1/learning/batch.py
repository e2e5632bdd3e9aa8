"""Many simulated robots at once, for training that needs millions of steps (extra `fast`: numba).

The vehicles are `txt1.sim.batch`; the loops and the light are the runtime's own `txt1.control` and
`txt1.sim.lamp.lux_at`. The odometry's velocities and the filter are written out here over arrays;
tests/unit/learning/test_batch.py compares all of it with the running robot. Without numba the results are the same, but
slow.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from math import sqrt
from statistics import NormalDist
from typing import Final
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config
from txt1.control.car import CarParameters, car_of, informed_step, true_velocity
from txt1.control.parameters import KnownCar, Safety
from txt1.control.pid import Gains, at_rest, errors, pid
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS
from txt1.errors import ConfigError
from txt1.installing import installs
from txt1.kernel.processors import processors
from txt1.learning.light_direction import FILTER_WEIGHT
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, SAMPLE_PERIOD
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry
from txt1.sim.batch import LEFT, RIGHT, THETA, Array, X, Y, move
from txt1.sim.dynamics import dynamics
from txt1.sim.lamp import PointLight, lux_at
from txt1.sim.machine_code import compiled
from txt1.sim.parameters import VehicleParameters

# one vehicle step, ms: the controller's period. The light is sampled with it.
TICK_MS: Final = 20
# (5.10) at 20 ms in place of 16
WEIGHT: Final = FILTER_WEIGHT ** (0.001 * TICK_MS / SAMPLE_PERIOD)

# of a robot's own numbers (`Batch.own`): standard deviations of the light's noise and of the floor's drag
NOISE, DRAG = 31, 32

# rows of the robots' state: the rows of `txt1.sim.batch` first, then the encoders', the loops' and the light's
PHASE, COUNT, SENSED, LINEAR, ANGULAR, OUTPUT, FILTERED, LEAD = 8, 10, 12, 14, 17, 20, 22, 26
ROWS: Final = 27

# with fewer robots a thread of their own does not pay
SHARE_MIN: Final = 200
# robots that are moved together: their state stays in the processor's nearest cache
ROBOTS_AT_ONCE: Final = 128

# for loops without knowledge of the car
UNKNOWN: Final = car_of(KnownCar(known=True), Geometry()) or CarParameters(*[1.0] * 9)
# two of these, drawn by a byte each, have a sum that is all but normal, of standard deviation 1: its distribution
# function is right to 0.002, and it ends at 4.09; a normal value of numpy takes five times as long
_QUANTILES: Final = np.array([NormalDist().inv_cdf((k + 0.5) / 256.0) for k in range(256)])
_NORMAL: Final = _QUANTILES / (sqrt(2.0) * _QUANTILES.std())
_GAINS: Final = np.array([[s.v_max, *s.gains] for s in ANGULAR_GAINS])
_at_rest = compiled(at_rest, forceinline=True)
_errors = compiled(errors, forceinline=True)
_pid = compiled(pid, forceinline=True)
_informed_step = compiled(
    informed_step, calls={"pid": _pid, "errors": _errors, "true_velocity": compiled(true_velocity)}
)
_lux_at = compiled(lux_at)


def only_ours(config: Config) -> None:
    """Refuse a configuration with another vehicle physics: a batch of robots has only ours."""
    if config.sim.physics != "plain":
        raise ConfigError(
            f"sim.physics: many robots at once need our own vehicle, not {config.sim.physics}; set "
            "sim.physics=plain, or take one robot at a time (txt1 learn)"
        )


@compiled
def control(
    robots: Array, commands: Array, motor_max: float, gains: Array, linear: Gains, car: CarParameters, known: bool
) -> None:
    """Run the controller on the velocities that the encoders saw a tick before; `known`: by loops that know the car."""
    for i in range(robots.shape[1]):
        v, omega, v_now, omega_now = commands[i, 0], commands[i, 1], robots[SENSED, i], robots[SENSED + 1, i]
        if _at_rest(v, v_now):
            for row in range(LINEAR, OUTPUT + 2):
                robots[row, i] = 0.0
            robots[LEAD, i] = 0.0
            continue
        which = 0
        for k in range(gains.shape[0] - 1):
            which += gains[k, 0] < v_now
        angular = gains[which, 1], gains[which, 2], gains[which, 3]
        if known:
            past = robots[LINEAR, i], robots[LINEAR + 1, i], robots[LINEAR + 2, i]
            other = robots[ANGULAR, i], robots[ANGULAR + 1, i], robots[ANGULAR + 2, i]
            past, other, robots[LEAD, i], motor, steering = _informed_step(
                past, other, robots[LEAD, i], v, omega, v_now, omega_now, linear, angular, TICK_MS / 1000.0, car
            )
            robots[LINEAR, i], robots[LINEAR + 1, i], robots[LINEAR + 2, i] = past
            robots[ANGULAR, i], robots[ANGULAR + 1, i], robots[ANGULAR + 2, i] = other
            robots[OUTPUT, i] = np.trunc(min(max(motor, -motor_max), motor_max))
            robots[OUTPUT + 1, i] = np.trunc(min(max(steering, -float(STEERING_MAX)), float(STEERING_MAX)))
            continue
        error, yaw_error = _errors(v, omega, v_now, omega_now)
        past = robots[LINEAR, i], robots[LINEAR + 1, i], robots[LINEAR + 2, i]
        past = _pid(past, error, linear, TICK_MS / 1000.0, float(PWM_MAX))
        robots[LINEAR, i], robots[LINEAR + 1, i], robots[LINEAR + 2, i] = past
        robots[OUTPUT, i] = np.trunc(min(max(past[0], -motor_max), motor_max))
        past = robots[ANGULAR, i], robots[ANGULAR + 1, i], robots[ANGULAR + 2, i]
        past = _pid(past, yaw_error, angular, TICK_MS / 1000.0, float(STEERING_MAX))
        robots[ANGULAR, i], robots[ANGULAR + 1, i], robots[ANGULAR + 2, i] = past
        robots[OUTPUT + 1, i] = np.trunc(past[0])


@compiled
def encode(robots: Array, rolled: Array, dt: float, count_length: float, track_width: float) -> None:
    """Run the encoders; `rolled` is the place of the two wheels a tick before, shape (2, n)."""
    for i in range(robots.shape[1]):
        robots[PHASE, i] += (robots[RIGHT, i] - rolled[0, i]) / count_length
        robots[PHASE + 1, i] += (robots[LEFT, i] - rolled[1, i]) / count_length
        right, left = np.floor(robots[PHASE, i]), np.floor(robots[PHASE + 1, i])
        v_right = (right - robots[COUNT, i]) * count_length / dt
        v_left = (left - robots[COUNT + 1, i]) * count_length / dt
        robots[COUNT, i], robots[COUNT + 1, i] = right, left
        robots[SENSED, i], robots[SENSED + 1, i] = (v_right + v_left) / 2.0, (v_right - v_left) / track_width


@compiled
def _look(robots: Array, bits: NDArray[np.uint8], noise: float, light: PointLight) -> None:
    """Take a sample of the light, through the filter; `noise` is a share of each reading, `bits` as `_run` has them."""
    for i in range(robots.shape[1]):
        lux = _lux_at(robots[X, i], robots[Y, i], robots[THETA, i], light)
        for k in range(4):
            drawn = _NORMAL[bits[i, 8 + k]] + _NORMAL[bits[i, 12 + k]]
            reading = min(max(lux[k] * (1.0 + noise * drawn), LUX_MIN), LUX_MAX)
            past = robots[FILTERED + k, i]
            robots[FILTERED + k, i] = WEIGHT * past + (1.0 - WEIGHT) * reading if past else reading


@partial(compiled, nogil=True, cache=True)
def _run(robots: Array, commands: Array, first: int, bits: NDArray[np.uint8], own: Array, begin: int, end: int) -> None:
    """Move robots `begin` to `end` by len(bits) ticks, the first of which is number `first`; see `Batch.own`.

    `bits` has 8 random bytes for each tick and robot, and 8 more where the light is sampled.
    """
    alike = own.shape[0] == 1
    size = ROBOTS_AT_ONCE if alike else 1
    for at in range(begin, end, size):
        until = min(at + size, end)
        o = own[0 if alike else at]
        parameters = (
            o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], o[9], o[10], o[11], o[12], o[13], o[14], o[15],
            o[16], o[17], o[18], o[19], o[20], o[21], o[22],
        )  # fmt: skip
        light, motor_max = PointLight(o[23], o[24], o[25], o[26], o[27]), o[28]
        count_length, track_width = o[29], o[30]
        # a copy, so that its rows lie together
        block = robots[:, at:until].copy()
        rolled, target, remaining, drag = block[:2].copy(), block[0].copy(), block[0].copy(), block[0].copy()
        for k in range(bits.shape[0]):
            tick, drawn = first + k, bits[k, at:until]
            # as the running robot measures it
            dt = tick * TICK_MS / 1000.0 - (tick - 1) * TICK_MS / 1000.0
            rolled[0], rolled[1] = block[RIGHT], block[LEFT]
            for i in range(until - at):
                drag[i] = o[DRAG] * (_NORMAL[drawn[i, 0]] + _NORMAL[drawn[i, 1]])
            if tick > 0:
                move(block, block[OUTPUT], block[OUTPUT + 1], drag, dt, parameters, target, remaining)
            control(block, commands[at:until], motor_max, _GAINS, LINEAR_GAINS, UNKNOWN, False)
            encode(block, rolled, dt, count_length, track_width)
            if bits.shape[2] > 8:
                _look(block, drawn, o[NOISE], light)
        robots[:, at:until] = block


@cache
def tell_slow() -> None:
    """Warn, once, if nothing is compiled."""
    if not hasattr(_run, "py_func"):
        # the warning is for whoever makes an environment
        told = "simulated robots take 20 times (one) to 400 times (thousands) as long without numba"
        warn(f"{told}: {installs('fast')}", RuntimeWarning, stacklevel=4)


class Batch:
    """Simulated robots side by side, each with its velocity loops and its light sensors.

    `noise` and `drag` are standard deviations: `noise` of a reading, as its share; `drag` of the floor's drag, as a
    share of the speed. Robots that `differ` have a row each of `own`; the others share the first.
    """

    def __init__(
        self,
        count: int,
        light: PointLight,
        noise: float,
        drag: float,
        parameters: VehicleParameters,
        body: Geometry,
        safety: Safety,
        differ: bool = False,
    ) -> None:
        self.robots: Array = np.zeros((ROWS, count))
        self.commands: Array = np.zeros((count, 2))
        # of the vehicle, of the light (`PointLight`), of loops and encoders, and of what is random
        last = float(safety.motor_max), body.count_length, body.track_width, noise, drag
        self.own: Array = np.array([[*dynamics(parameters, body), *light, *last]] * (count if differ else 1))
        self.tick = 0
        shares = min(processors(), 1 + count // SHARE_MIN)
        self._threads = ThreadPoolExecutor(shares, "txt1-batch") if shares > 1 else None

    @property
    def poses(self) -> Array:
        """x, y (m) and theta (rad) of each robot, shape (count, 3); a view, which changes with the robots."""
        return self.robots[:3].T

    @property
    def readings(self) -> Array:
        """Filtered readings FL FR RL RR of each robot, lux, shape (count, 4); 0 before the first sample."""
        return self.robots[FILTERED : FILTERED + 4].T

    @property
    def velocities(self) -> Array:
        """Sensed v (m/s) and omega (rad/s) of each robot, shape (count, 2)."""
        return self.robots[SENSED : SENSED + 2].T

    def place(self, which: NDArray[np.bool_], poses: Array, rng: np.random.Generator) -> None:
        """Put the robots in `which` at poses (m, rad), at rest and reset; shape (which.sum(), 3)."""
        if which.all():
            self.tick = 0  # the length of a tick is the difference of two times, and its last digits depend on them
        self.robots[:, which] = 0.0
        self.robots[:3, which] = poses.T
        self.robots[PHASE : PHASE + 2, which] = rng.random((int(which.sum()), 2)).T
        self.commands[which] = 0.0

    def run(
        self, ticks: int, rng: np.random.Generator, *, sense: bool = True, which: NDArray[np.bool_] | None = None
    ) -> None:
        """Let all robots, or those in `which`, drive on by `ticks` of 20 ms; `sense`: whether the light is sampled."""
        robots, commands, own = self.robots, self.commands, self.own
        if which is not None:
            robots, commands, own = robots[:, which], commands[which], own[which] if len(own) > 1 else own
        count = robots.shape[1]
        bits = rng.integers(0, 2**64, (ticks, count, 1 + sense), np.uint64).view(np.uint8)
        shares = min(processors(), 1 + count // SHARE_MIN)
        ends = [count * k // shares for k in range(shares + 1)]

        def move_on(begin: int, end: int) -> None:
            _run(robots, commands, self.tick, bits, own, begin, end)

        # the compiled loop releases the interpreter's lock
        list((self._threads.map if self._threads else map)(move_on, ends[:-1], ends[1:]))
        if which is not None:
            self.robots[:, which] = robots
        self.tick += ticks
