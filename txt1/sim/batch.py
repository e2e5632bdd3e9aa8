"""Many vehicles at once: `txt1.sim.dynamics.move` in a form that compiles to vector instructions.

How it works
------------

A processor can take several numbers in one instruction, but only if the same is done to each of them. `dynamics.move`
is written for one vehicle: it branches, and it loops as often as a servo's turn takes pieces. So here the loops change
places. The outer loop goes over the pieces of a tick. The inner loop goes over the vehicles, and has no branch.

*Arrays.* The state of n vehicles is an array of shape (8, n): a row for each quantity, so numbers that are used
together lie side by side.

*Pieces.* Each vehicle has its own time left of the tick (`remaining`). A pass of `_drive` moves every vehicle by a
piece of its own. While its servo turns, a piece is at most the ramp step; afterwards it is all the rest. A vehicle that
has arrived moves by a piece of 0 s, which changes nothing. `_move` makes passes until no vehicle has time left: two or
three.

*No branches.* Where `dynamics.move` says "if", this form computes both values and chooses. The equations and their
order are the same.

*No calls.* The functions of `math` take a single number, and would break the vectors. Taylor series replace them. They
are long enough to be exact to the last bits of a double within SERIES_MAX and EXPONENT_MAX, and a tick stays within
these bounds. Angles of a few turns are first brought to a quarter turn (`_sine_cosine`), with pi / 2 in two parts, as
its double alone would cost digits.

*Limits.* This form holds for vehicles under power that steer front and rear by opposite angles, as the velocity loops
do. `dynamics.move` itself moves a vehicle that coasts, whose wheels spin, or whose tyres are near the friction circle.
It moves all vehicles if the parameters or the tick exceed the range of the series.

numba compiles it (extra `fast`): eight times as fast as vehicle by vehicle. Without numba it gives the same results
slowly. tests/unit/sim/test_many_vehicles.py checks that the two forms agree to 1e-12.
"""

from dataclasses import replace
from math import copysign, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.model.kinematics import TWO_PI
from txt1.model.vehicle import STEERING_MAX
from txt1.sim import dynamics, sliding
from txt1.sim.battery import Packs, voltage_share
from txt1.sim.dynamics import SHORT_RAMP, Dynamics
from txt1.sim.machine_code import compiled
from txt1.sim.parameters import Batteries, VehicleParameters

Array = NDArray[np.float64]

X, Y, THETA, V, PHI, RIGHT, LEFT, SPIN = range(8)
"""Rows of a batch's state: as in `VehicleState`, but with the front steering angle only; the rear angle is its
negative.
"""

# largest angle, rad, for which `sine` and `cosine` are exact
SERIES_MAX: Final = pi / 4.0
# largest exponent for which `exponential` is exact
EXPONENT_MAX: Final = 0.25
# largest 1 + scrub + drag: larger values are rare, and cost the exponential a digit or two
LOSS_MAX: Final = 2.0

# difference between pi / 2 and its double
_HALF_PI_REST: Final = 6.123233995736766e-17


def powered(vehicle: VehicleParameters, batteries: Batteries) -> VehicleParameters:
    """Return the parameters with the free speed at the packs' initial voltage, for a vehicle without batteries
    of its own.
    """
    voltages = Packs(batteries.used_1, batteries.used_2).voltages()
    share = voltage_share(vehicle, max(*voltages, batteries.external or 0.0))
    return replace(vehicle, speed_gain=vehicle.speed_gain * share) if share != 1.0 else vehicle


def _sine(x: float) -> float:
    """Return the sine of x for abs(x) <= SERIES_MAX, by its Taylor series."""
    q = x * x
    return x * (
        1.0
        + q
        * (
            -1 / 6
            + q
            * (
                1 / 120
                + q
                * (-1 / 5040 + q * (1 / 362880 + q * (-1 / 39916800 + q * (1 / 6227020800 + q * (-1 / 1307674368000)))))
            )
        )
    )


def _cosine(x: float) -> float:
    """Return the cosine of x for abs(x) <= SERIES_MAX, by its Taylor series."""
    q = x * x
    return 1.0 + q * (
        -1 / 2
        + q
        * (
            1 / 24
            + q
            * (
                -1 / 720
                + q
                * (
                    1 / 40320
                    + q * (-1 / 3628800 + q * (1 / 479001600 + q * (-1 / 87178291200 + q * (1 / 20922789888000))))
                )
            )
        )
    )


def _exponential(x: float) -> float:
    """Return the exponential of x for abs(x) <= EXPONENT_MAX, by its Taylor series."""
    return 1.0 + x * (
        1.0
        + x
        * (
            1 / 2
            + x
            * (
                1 / 6
                + x
                * (
                    1 / 24
                    + x
                    * (
                        1 / 120
                        + x
                        * (
                            1 / 720
                            + x
                            * (1 / 5040 + x * (1 / 40320 + x * (1 / 362880 + x * (1 / 3628800 + x * (1 / 39916800)))))
                        )
                    )
                )
            )
        )
    )


sine = compiled(_sine, reorder=True, forceinline=True)
cosine = compiled(_cosine, reorder=True, forceinline=True)
exponential = compiled(_exponential, reorder=True, forceinline=True)


def _sine_cosine(x: float) -> tuple[float, float]:
    """Return sine and cosine of x, any angle of a few turns, without a branch."""
    quarter = np.floor(x * (2.0 / pi) + 0.5)
    rest = (x - quarter * (0.5 * pi)) - quarter * _HALF_PI_REST
    s, c = sine(rest), cosine(rest)
    half = np.floor(0.5 * quarter)
    # 1 if sine and cosine change places
    odd = quarter - 2.0 * half
    sign = 1.0 - 2.0 * (half - 2.0 * np.floor(0.5 * half))
    return sign * (s + odd * (c - s)), sign * (1.0 - 2.0 * odd) * (c + odd * (s - c))


sine_cosine = compiled(_sine_cosine, reorder=True, forceinline=True)


def _drive(
    x: Array,
    y: Array,
    theta: Array,
    v: Array,
    phi: Array,
    right: Array,
    left: Array,
    target: Array,
    remaining: Array,
    motor: Array,
    drag: Array,
    p: Dynamics,
) -> float:
    """Move each vehicle by a piece; return the sum of the vehicles' times left of the tick, s (see `dynamics.move`)."""
    (
        wheelbase,
        track_width,
        _,
        speed_gain,
        dead_band,
        speed_time_constant,
        _,
        _,
        servo_rate,
        scrub,
        slip,
        understeer,
        _,
        _,
        _,
        _,
        ramp_step,
        steered,
        tan_max,
        _,
        sideways,
        _,
        _,
    ) = p
    scrub_by_tan = scrub / tan_max**2
    rate = 1.0 / speed_time_constant
    left_over = 0.0
    for i in range(len(x)):
        # -- steering
        gap, time = target[i] - phi[i], remaining[i]
        size = abs(gap)
        turns = size > 0.0
        h = min(time, min(ramp_step, size / servo_rate)) if turns else time
        travel = servo_rate * h * (1.0 + 1e-12)
        arrives = size <= travel
        angle = target[i] if arrives else phi[i] + copysign(travel, gap)
        mean = 0.5 * (phi[i] + angle)
        short = turns and arrives and h < SHORT_RAMP * ramp_step and time > 0.0
        mean = angle + h / time * (mean - angle) if short else mean
        h = time if short else h
        phi[i] = angle
        remaining[i] = time - h
        left_over += time - h
        # -- speed
        tangent = sine(mean) / cosine(mean)
        loss = 1.0 + scrub_by_tan * tangent * tangent + drag[i]
        v_end = speed_gain * (motor[i] - copysign(dead_band, motor[i])) / loss
        decay = exponential(-h * loss * rate)
        distance = v_end * h + (v[i] - v_end) * (1.0 - decay) / (loss * rate)
        v[i] = v_end + (v[i] - v_end) * decay
        # -- curvature, and the encoder wheels
        mean_v = distance / h if h > 0.0 else 0.0
        curvature = 2.0 * tangent / (wheelbase * (1.0 + understeer * mean_v * mean_v))
        slide = -sideways * mean_v * abs(mean_v) * curvature
        level = sqrt(1.0 - slide * slide)
        lean = tangent * steered
        cos_front = 1.0 / sqrt(1.0 + lean * lean)
        forward = (level + (slide + 0.5 * curvature * wheelbase) * lean) * cos_front
        apart = 0.5 * curvature * track_width * cos_front
        rolled = distance * (1.0 + slip)
        right[i] += rolled * (forward + apart)
        left[i] += rolled * (forward - apart)
        # -- the arc
        half = 0.5 * distance * curvature
        q = half * half
        chord = distance * (1.0 - q * (1 / 6) * (1.0 - q * (1 / 20) * (1.0 - q * (1 / 42))))
        ahead, aside = chord * level, chord * slide
        sin_theta, cos_theta = sine_cosine(theta[i] + half)
        x[i] += ahead * cos_theta - aside * sin_theta
        y[i] += ahead * sin_theta + aside * cos_theta
        heading = theta[i] + 2.0 * half
        heading = heading - TWO_PI if heading > pi else heading
        theta[i] = heading + TWO_PI if heading <= -pi else heading
    return left_over


_drive_compiled = compiled(_drive, reorder=True)

# numba calls only functions that it has compiled itself
_EQUATIONS: Final = (
    *("servo_angle", "steer", "direction", "asks", "coast"),
    *("wheels", "along_arc"),
)
_calls = {name: compiled(getattr(dynamics, name)) for name in _EQUATIONS}
_move_one = compiled(dynamics.move, calls={**_calls, "slide": compiled(sliding.slide)})


def _move(
    batch: Array,
    motor: Array,
    steering: Array,
    drag: Array,
    dt: float,
    p: Dynamics,
    target: Array,
    remaining: Array,
) -> None:
    """Let vehicles move for `dt` seconds.

    Args:
        batch: states, shape (8, n), changed in place.
        motor: PWM counts, shape (n,).
        steering: PWM counts of the rear servos, shape (n,); the front servos get the negative.
        drag: drag of the floor as a share of the speed, shape (n,).
        dt: s.
        p: parameters of all vehicles.
        target: work space for n numbers.
        remaining: work space for n numbers.

    """
    steering_max, speed_gain, dead_band, speed_time_constant = p[2], p[3], p[4], p[5]
    calm_v, calm_pull = p[-2], p[-1]
    series_suffice = steering_max <= SERIES_MAX and dt * LOSS_MAX <= EXPONENT_MAX * speed_time_constant
    for i in range(batch.shape[1]):
        target[i] = steering_max * (min(max(steering[i], -STEERING_MAX), STEERING_MAX) / STEERING_MAX)
        remaining[i] = dt
        v = batch[V, i]
        free = speed_gain * (motor[i] - copysign(dead_band, motor[i]))
        calm = batch[SPIN, i] == 0.0 and abs(v) <= calm_v and abs(free - v) <= calm_pull
        if abs(motor[i]) <= dead_band or not series_suffice or not calm:
            before = (
                batch[X, i],
                batch[Y, i],
                batch[THETA, i],
                batch[V, i],
                batch[PHI, i],
                -batch[PHI, i],
                batch[RIGHT, i],
                batch[LEFT, i],
                batch[SPIN, i],
            )
            x, y, theta, v, phi, _, right, left, spin = _move_one(
                before, motor[i], -steering[i], steering[i], dt, drag[i], p
            )
            batch[X, i], batch[Y, i], batch[THETA, i], batch[V, i] = x, y, theta, v
            batch[PHI, i], batch[RIGHT, i], batch[LEFT, i], batch[SPIN, i] = phi, right, left, spin
            remaining[i] = 0.0
    while (
        _drive_compiled(
            batch[X],
            batch[Y],
            batch[THETA],
            batch[V],
            batch[PHI],
            batch[RIGHT],
            batch[LEFT],
            target,
            remaining,
            motor,
            drag,
            p,
        )
        > 0.0
    ):
        pass


move = compiled(_move, cache=True)
