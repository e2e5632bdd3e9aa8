"""The drift and the multi-body model of commonroad-vehicle-models, scaled down to small cars.

The models: M. Althoff and G. Würsching, *CommonRoad: Vehicle models*, 2020; package ``commonroad-vehicle-models``. The
installed equations are called, compiled by numba. The car is the package's vehicle 2, a BMW 320i. The public F1TENTH
simulator's tyre is derived from this car's, too.

**The rule of scale** (Froude's, because gravity is the same): lengths scale with the wheelbase, by s = wheelbase / (a +
b). Times and speeds scale with the root of s, masses with s^3, moments of inertia with s^5. Angles and accelerations do
not change: a tyre that holds 1 g still holds 1 g. In this rule scaling the parameters and scaling the results are
equivalent. The models have fixed speeds in their code at which they switch, so the full-size car is driven and its
motion is scaled. Its parameters are unchanged, except for the limits of driver and engine (steering angle and rate,
acceleration, power, `steering` and `longitudinal`). These limits are removed, and the simulated servo and motor replace
driver and engine (`txt1_physics.foreign`).

**Wheels and encoders.** The motor and the encoders turn with the driven wheels, which are at the rear axle by the
package's torque split. The model has the full-size car's narrow track. So the difference of its wheels is converted to
the configured track.

**Slowly and backwards.** The multi-body model sets the wheels' slip to 0 below 0.1 m/s, and its wheels cannot turn
backwards. There the package's kinematic model drives; above 0.1 m/s the package's `init_mb` sets the other states. The
drift model fades into the kinematic model by itself; where that drives alone, yaw rate and slip are the kinematic ones,
too, as the package's equations only integrate them.

**Sides.** The multi-body model has the SAE's axes, with y to the right: seen from above it is the mirror image of this
package's. So its left wheels are the car's right wheels, and its roll has the opposite sign.

**Steps.** Heun's method, at most 1 ms of the full-size car. A wheel's speed settles at the rate R^2 K / (I v), which
decides the step at low speed; steps of less than half are Euler's.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache
from math import atan, cos, inf, isfinite, nan, sin, sqrt, tan, tanh
from types import ModuleType
from typing import Any, Final

import numpy as np
from vehiclemodels import init_mb, init_std, vehicle_dynamics_mb, vehicle_dynamics_std
from vehiclemodels.utils import acceleration_constraints, steering_constraints, tire_model, vehicle_dynamics_ks_cog
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

from txt1.config import Config
from txt1.errors import ConfigError
from txt1.hal import PWM_MAX
from txt1.model.kinematics import wrap_angle
from txt1.sim.batch import Array
from txt1.sim.dynamics import Motion
from txt1.sim.machine_code import compiled
from txt1.units import GRAVITY
from txt1_physics.foreign import Foreign, MotorDrive

VEHICLE: Final = 2
"""The package's number of the BMW 320i."""
# longest step of the full-size car, s
LONGEST: Final = 1e-3
# largest step times the wheels' rate at rest; 2 is the limit of both methods
STABLE: Final = 1.3
# below this speed the multi-body model has no slip, m/s of the full-size car
KINEMATIC: Final = 0.1


def _elsewhere(*_: Any) -> Any:
    raise NotImplementedError


# placeholders for the package's functions, which `Models` compiles into the movers
kinematics = init = multi_body_rates = drift_rates = _elsewhere


def _values(name: str, keys: str) -> Any:
    """Return a class of parameters at module level, so that numba can keep the code compiled for it on the disk."""
    return namedtuple(name, keys.split())


Steering = _values("Steering", "min max v_min v_max kappa_dot_max kappa_dot_dot_max")
Longitudinal = _values("Longitudinal", "v_min v_max v_switch a_max j_max j_dot_max")
Tyre = _values(
    "Tyre",
    "p_cx1 p_dx1 p_dx3 p_ex1 p_kx1 p_hx1 p_vx1 r_bx1 r_bx2 r_cx1 r_ex1 r_hx1 p_cy1 p_dy1 p_dy3 p_ey1 p_ky1 p_hy1 p_hy3 "
    "p_vy1 p_vy3 r_by1 r_by2 r_by3 r_cy1 r_ey1 r_hy1 r_vy1 r_vy3 r_vy4 r_vy5 r_vy6",
)
Car = _values(
    "Car",
    "steering longitudinal tire l w m m_s m_uf m_ur a b I_Phi_s I_y_s I_z I_xz_s K_sf K_sdf K_sr K_sdr T_f T_r K_ras "
    "K_tsf K_tsr K_rad K_zt h_cg h_raf h_rar h_s I_uf I_ur I_y_w K_lt R_w T_sb T_se D_f D_r E_f E_r",
)
KINDS: Final = {"SteeringParameters": Steering, "LongitudinalParameters": Longitudinal, "TireParameters": Tyre}


def _numbers(parameters: Any) -> Any:
    """Return the package's parameters as named tuples of floats, which the compiler can read."""
    kind = KINDS.get(type(parameters).__name__, Car)
    given = {each.name: getattr(parameters, each.name) for each in fields(parameters)}
    values = {key: given[key] for key in kind._fields}
    return kind(**{key: _numbers(value) if is_dataclass(value) else float(value) for key, value in values.items()})


@cache
def car() -> Any:
    """Return vehicle 2 of the installed package, without the limits of its driver and engine."""
    p = _numbers(setup_vehicle_parameters(VEHICLE))
    return p._replace(
        steering=p.steering._replace(min=-inf, max=inf, v_min=-inf, v_max=inf),
        longitudinal=p.longitudinal._replace(v_min=-inf, v_max=inf, v_switch=inf, a_max=inf),
    )


def move_multi_body(
    x: Array,
    rolled: Array,
    dt: float,
    target: float,
    rate: float,
    driven: bool,
    free: float,
    tau: float,
    loss: float,
    p: Any,
) -> None:
    """Move the multi-body model by `dt`, in the full-size car's units: state `x`, and paths of right and left wheel."""
    stiff = p.R_w * p.R_w * p.tire.p_kx1 * GRAVITY * p.m / (2.0 * p.I_y_w) * max(p.a, p.b) / (p.a + p.b)
    wheelbase = p.a + p.b
    u = np.zeros(2)
    remaining = dt
    while remaining > 0.0:
        kinematic = x[3] < KINEMATIC
        v = x[3]
        if not kinematic:
            v = p.R_w * 0.5 * (p.T_se * (x[23] + x[24]) + (1.0 - p.T_se) * (x[25] + x[26]))
        h = min(remaining, LONGEST)
        if not kinematic:
            h = min(h, STABLE * x[3] / stiff)
        u[0] = min(max((target - x[2]) / h, -rate), rate)
        if driven:
            u[1] = (free - loss * v) / tau
        else:
            friction = free if v > 0.0 else -free if v < 0.0 else 0.0
            u[1] = -(loss * v + friction) / tau
        if kinematic:
            stops = not driven and abs(v) <= abs(u[1]) * h
            if stops:
                u[1] = -v / h
            small = x[:5].copy()
            first = np.array(kinematics(small, u, p))
            second = np.array(kinematics(small + h * first, u, p))
            turned = x[4]
            x[:5] = small + 0.5 * h * (first + second)
            if stops:
                x[3] = 0.0
            slip = atan(tan(x[2]) * p.b / wheelbase)
            yaw_rate = x[3] * cos(slip) * tan(x[2]) / wheelbase
            # the speed at the centre of gravity becomes the forward speed when the whole model takes over
            path, turned = 0.5 * h * (v + x[3]) * cos(slip), 0.5 * p.T_r * (x[4] - turned)
            rolled[0] += path + turned
            rolled[1] += path - turned
            if x[3] >= KINEMATIC:
                x[:] = np.array(init(np.array([x[0], x[1], x[2], x[3], x[4], yaw_rate, slip]), p))
            else:
                x[5] = yaw_rate
        else:
            before_right, before_left = x[25], x[26]
            first = np.array(multi_body_rates(x, u, p))
            if h >= 0.5 * LONGEST:
                ahead = x + h * first
                first = 0.5 * (first + np.array(multi_body_rates(ahead, u, p)))
            x += h * first
            for wheel in range(23, 27):
                x[wheel] = max(x[wheel], 0.0)
            rolled[0] += 0.5 * h * p.R_w * (before_right + x[25])
            rolled[1] += 0.5 * h * p.R_w * (before_left + x[26])
            if x[3] < KINEMATIC:
                x[:] = np.array(init(np.array([x[0], x[1], x[2], x[3], x[4], 0.0, 0.0]), p))
            elif not x[3] < inf:
                return
        remaining -= h


def move_drift(
    x: Array,
    rolled: Array,
    dt: float,
    target: float,
    rate: float,
    driven: bool,
    free: float,
    tau: float,
    loss: float,
    p: Any,
) -> None:
    """Move the drift model by `dt`, in the full-size car's units: state `x`, and paths of right and left wheel."""
    stiff = p.R_w * p.R_w * p.tire.p_kx1 * GRAVITY * p.m / p.I_y_w * max(p.a, p.b) / (p.a + p.b)
    wheelbase = p.a + p.b
    u = np.zeros(2)
    remaining = dt
    while remaining > 0.0:
        rolls = x[3] < 0.1
        v = x[3] * cos(x[6]) if rolls else p.R_w * (p.T_se * x[7] + (1.0 - p.T_se) * x[8])
        # weights of the two models; 0.2 and 0.05 m/s are the model's own
        dynamic = 0.5 * (tanh((x[3] - 0.2) / 0.05) + 1.0)
        settling = dynamic * stiff / max(x[3], 0.1) + (1.0 - dynamic) * 50.0
        h = min(remaining, LONGEST, STABLE / settling)
        u[0] = min(max((target - x[2]) / h, -rate), rate)
        if driven:
            u[1] = (free - loss * v) / tau
        else:
            friction = free if v > 0.0 else -free if v < 0.0 else 0.0
            u[1] = -(loss * v + friction) / tau
        stops = rolls and not driven and abs(v) <= abs(u[1]) * h
        turned = x[4]
        first = np.array(drift_rates(x, u, p))
        if h >= 0.5 * LONGEST:
            ahead = x + h * first
            first = 0.5 * (first + np.array(drift_rates(ahead, u, p)))
        x += h * first
        x[7], x[8] = max(x[7], 0.0), max(x[8], 0.0)
        if stops:
            x[3], x[7], x[8] = 0.0, 0.0, 0.0
        if rolls and x[3] < 0.1:
            # the model's kinematic part integrates slip, and would keep that of a slide for good
            slip = atan(tan(x[2]) * p.b / wheelbase)
            x[3] *= cos(x[6]) / cos(slip)
            x[5], x[6] = x[3] * cos(slip) * tan(x[2]) / wheelbase, slip
        now = x[3] * cos(x[6]) if rolls else p.R_w * (p.T_se * x[7] + (1.0 - p.T_se) * x[8])
        path, turned = 0.5 * h * (v + now), 0.5 * p.T_r * (x[4] - turned)
        rolled[0] += path + turned
        rolled[1] += path - turned
        if not x[3] < inf:
            return
        remaining -= h


class Models:
    """The two movers, compiled, and the package's functions for initial states."""

    def __init__(self) -> None:
        def kept(function: Callable[..., Any], **calls: Any) -> Callable[..., Any]:
            return compiled(function, calls={"__name__": function.__module__, **calls}, cache=True)

        limits = {
            "steering_constraints": kept(steering_constraints.steering_constraints),
            "acceleration_constraints": kept(acceleration_constraints.acceleration_constraints),
        }
        tyres = ModuleType("tyres")
        sign = kept(tire_model.sign)
        for name in (
            "formula_longitudinal",
            "formula_lateral",
            "formula_longitudinal_comb",
            "formula_lateral_comb",
        ):
            setattr(tyres, name, kept(getattr(tire_model, name), sign=sign))
        slow = kept(vehicle_dynamics_ks_cog.vehicle_dynamics_ks_cog, **limits)
        whole = kept(vehicle_dynamics_mb.vehicle_dynamics_mb, **limits, vehicle_dynamics_ks_cog=slow, tireModel=tyres)
        drift = kept(
            vehicle_dynamics_std.vehicle_dynamics_std, **limits, vehicle_dynamics_ks_cog=slow, tire_model=tyres
        )
        self.multi_body = kept(move_multi_body, kinematics=slow, init=kept(init_mb.init_mb), multi_body_rates=whole)
        self.drift = kept(move_drift, drift_rates=drift)
        self.begin_multi_body, self.begin_drift = init_mb.init_mb, init_std.init_std


models: Final = cache(Models)


class CommonRoad(Foreign):
    """A model of the package as a small car.

    Raises ConfigError: the car does not steer by its front wheels only, or it is faster than the model allows.
    """

    def __init__(self, name: str, config: Config) -> None:
        super().__init__(name, config)
        if self.body.steering != "front":
            raise ConfigError(
                f"sim.physics: {name} is a car whose front wheels steer, and {config.vehicle} "
                f"{'steers both axles' if self.body.steering == 'both' else 'has sides at two speeds'}; "
                f"use --vehicle f1tenth, or sim.physics={'mujoco' if self.body.steering == 'both' else 'plain'}"
            )
        p = self.car = car()
        given = setup_vehicle_parameters(VEHICLE)
        self.scale = self.body.wheelbase / (p.a + p.b)
        self.root = sqrt(self.scale)
        fastest, counts = self.root * given.longitudinal.v_max, PWM_MAX - self.vehicle.dead_band
        if self.vehicle.speed_gain * counts > fastest:
            raise ConfigError(
                f"sim.vehicle.speed_gain: full throttle is {self.vehicle.speed_gain * counts:.1f} m/s, and "
                f"{name} holds to {fastest:.1f} m/s at this size; use at most "
                f"{fastest / counts:.6f}"
            )
        if self.body.steering_max > given.steering.max:
            raise ConfigError(
                f"geometry.radius_min: it makes {self.body.steering_max:.2f} rad of steering, and {name} holds to "
                f"{given.steering.max:.2f} rad; use a larger circle"
            )
        self._rate = self.vehicle.servo_rate * self.root
        self._apart = self.body.track_width / (self.scale * p.T_r)
        self._models = models()

    def beginning(self, state: list[float]) -> list[float]:
        """Return the model's state for position, steering, speed, heading, yaw rate and sideslip at the centre
        of gravity.
        """
        raise NotImplementedError

    def settled(self, motion: Motion) -> Array:
        """Return the full-size car's state, rolling without slip."""
        x, y, theta, v, phi, *_ = motion
        p = self.car
        slip = atan(tan(phi) * p.b / (p.a + p.b))
        speed = v / self.root / cos(slip)
        yaw_rate = speed * cos(slip) * tan(phi) / (p.a + p.b)
        x, y = x / self.scale + p.b * cos(theta), y / self.scale + p.b * sin(theta)
        return np.array(self.beginning([x, y, phi, speed, theta, yaw_rate, slip]), dtype=float)

    def step(
        self, motion: Motion, hidden: Array, drive: MotorDrive, front: float, rear: float, dt: float
    ) -> tuple[Motion, Array]:
        """Move the full-size car."""
        state, rolled, p, root = hidden.copy(), np.zeros(2), self.car, self.root
        if not drive.driven and motion[3] == 0.0 and motion[4] == front:
            return motion, hidden
        given = drive.driven, drive.free / root, drive.tau / root, drive.loss
        self.move(state, rolled, dt / root, front, self._rate, *given, p)
        theta = wrap_angle(float(state[4])) if isfinite(state[4]) else nan
        x = self.scale * (state[0] - p.b * cos(theta))
        y = self.scale * (state[1] - p.b * sin(theta))
        mean, half = 0.5 * (rolled[0] + rolled[1]), 0.5 * (rolled[0] - rolled[1]) * self._apart
        right, left = motion[6] + self.scale * (mean + half), motion[7] + self.scale * (mean - half)
        phi = float(state[2])
        v = root * self.forwards(state)
        after: Motion = (float(x), float(y), theta, v, phi, -phi, float(right), float(left), 0.0)
        if state[3] != 0.0 and not self.holds(state):
            raise self.lost(motion, "both wheels of a side have left the floor, and the model knows no roll-over")
        return after, state

    def move(self, *arguments: Any) -> None:
        """Move the model; the arguments are those of `move_multi_body`."""
        raise NotImplementedError

    def forwards(self, state: Array) -> float:
        """Return the speed along the heading, m/s."""
        raise NotImplementedError

    def holds(self, state: Array) -> bool:
        """Return whether the model is valid in a state."""
        return True


class SingleTrackDrift(CommonRoad):
    """The single-track drift model: two wheels on the middle line, with tyres that slide."""

    def beginning(self, state: list[float]) -> list[float]:
        """Return the package's initial state."""
        begun: list[float] = self._models.begin_drift(state, self.car)
        return [*begun[:7], max(begun[7], 0.0), max(begun[8], 0.0)]

    def move(self, *arguments: Any) -> None:
        """Move the model."""
        self._models.drift(*arguments)

    def forwards(self, state: Array) -> float:
        """Return the speed along the heading, m/s."""
        return float(state[3] * cos(state[6]))


class MultiBody(CommonRoad):
    """The multi-body model: four wheels with tyres, springs and dampers, a body that rolls, pitches and bounces."""

    def beginning(self, state: list[float]) -> list[float]:
        """Return the package's initial state."""
        begun: list[float] = self._models.begin_multi_body(state, self.car)
        return [*begun[:23], *(max(wheel, 0.0) for wheel in begun[23:27]), *begun[27:]]

    def move(self, *arguments: Any) -> None:
        """Move the model."""
        self._models.multi_body(*arguments)

    def forwards(self, state: Array) -> float:
        """Return the speed along the heading, m/s."""
        return float(state[3])

    def leaning(self, hidden: Array) -> tuple[float, float]:
        """Return roll, left side up, and pitch, nose down."""
        return -float(hidden[6]), -float(hidden[8])

    def pressing(self, hidden: Array) -> tuple[float, ...]:
        """Return the tyres' loads, from their springs in the equations (F_z)."""
        p = self.car
        loads = []
        for bounce, roll, track, arm in ((16, 13, p.T_f, p.b), (21, 18, p.T_r, p.a)):
            axle = p.m_s * GRAVITY * arm / (p.a + p.b) + (p.m_uf if bounce == 16 else p.m_ur) * GRAVITY
            middle, tilt = hidden[bounce] + p.R_w * (cos(hidden[roll]) - 1.0), 0.5 * track * sin(hidden[roll])
            loads += [float(2.0 * p.K_zt * (middle - side * tilt) / axle) for side in (-1.0, 1.0)]
        return tuple(loads)

    def rising(self, hidden: Array) -> tuple[float, ...]:
        """Return the heights of the tyres over the floor; a lifted tyre's spring would have to pull."""
        p = self.car
        static = 0.25 * p.m * GRAVITY
        return tuple(self.scale * max(0.0, -load * static / p.K_zt) for load in self.pressing(hidden))

    def holds(self, state: Array) -> bool:
        """Return whether a wheel of each side stands on the floor."""
        loads = self.pressing(state)
        return max(loads[0], loads[2]) > 0.0 and max(loads[1], loads[3]) > 0.0


def single_track_drift(config: Config) -> SingleTrackDrift:
    """Make the physics ``single-track-drift``."""
    return SingleTrackDrift("single-track-drift", config)


def multi_body(config: Config) -> MultiBody:
    """Make the physics ``multi-body``."""
    return MultiBody("multi-body", config)
