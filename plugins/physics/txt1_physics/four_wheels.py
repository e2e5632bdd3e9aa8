"""The TXT-1 in MuJoCo: E. Todorov, T. Erez, Y. Tassa, *MuJoCo: A physics engine for model-based control*, IROS 2012.

The car is `txt1_physics.mjcf`. The motor's torque goes to the four wheels in equal parts, as through open
differentials, and the motor sees their mean speed. While coasting, the dry part of the friction is MuJoCo's dry
friction in the wheels' joints, so that a standing car does not creep. A car slower than `STANDS` stays where it is. The
encoders are at the front wheels.

Steps are equal parts of the requested time, at most `mjcf.STEP` long. MuJoCo repeats to the last bit on the same
machine.
"""

from __future__ import annotations

from math import asin, atan2, ceil, cos, hypot, isfinite, sin, sqrt, tan
from typing import Any, Final

import mujoco
import numpy as np

from txt1.config import Config
from txt1.errors import ConfigError
from txt1.hal import PWM_MAX
from txt1.sim.batch import Array
from txt1.sim.dynamics import Motion
from txt1.units import GRAVITY
from txt1_physics.foreign import Foreign, MotorDrive
from txt1_physics.mjcf import STEP, WHEELS, mjcf, wheel_radius
from txt1_physics.settings import PhysicsSettings

# m/s: a slower coasting car stands
STANDS: Final = 1e-3
# s on the springs before the first drive
SETTLING: Final = 2.0
# largest turn of a wheel in a step, rad
FASTEST: Final = 0.5
# N s/m and N m s/rad: damping of a body on blocks
HELD: Final = 1e4
# rad of roll or pitch: the car lies on its side
OVER: Final = 1.2


class FourWheels(Foreign):
    """The car in MuJoCo.

    Raises ConfigError: an axle does not steer, or the geometry is impossible.
    """

    def __init__(self, config: Config) -> None:
        super().__init__("mujoco", config)
        body, settings = self.body, config.section(PhysicsSettings)
        if body.steering != "both":
            other = "single-track-drift or multi-body" if body.steering == "front" else "plain"
            raise ConfigError(
                f"sim.physics: mujoco is a car whose axles both steer, and {config.vehicle} is none; "
                f"use sim.physics={other}"
            )
        self.radius = wheel_radius(body)
        turns = self.vehicle.speed_gain * (PWM_MAX - self.vehicle.dead_band) * STEP / self.radius
        if turns > FASTEST:
            raise ConfigError(
                f"sim.vehicle.speed_gain: at full throttle a wheel turns {turns:.2f} rad in a step, and mujoco holds "
                f"to {FASTEST:g}; use less, or a larger geometry.circumference"
            )
        for name, apart, least, most in (
            ("wheelbase", body.wheelbase, 2.0 * self.radius, body.length),
            ("track_width", body.track_width, settings.tyre_width, body.width),
        ):
            if not least <= apart <= most:
                where = "overlap" if apart < least else "stand outside the body"
                raise ConfigError(
                    f"geometry.{name}: {apart:g} m, and mujoco's wheels would {where}; use {least:.3g} to {most:.3g} m"
                )
        if settings.mass <= 8.0 * settings.wheel_mass:
            raise ConfigError(
                f"physics.mass: {settings.mass:g} kg with wheels of {settings.wheel_mass:g} kg leaves less than half "
                "to the body; use more, or lighter wheels"
            )
        if settings.gravity_height <= 0.5 * self.radius:
            raise ConfigError(
                f"physics.gravity_height: {settings.gravity_height:g} m lies below the axles' middle; use at least "
                f"{self.radius:.3f} m"
            )
        self.model: Any = mujoco.MjModel.from_xml_string(mjcf(body, settings))
        """MuJoCo's model, for inspection."""
        self.data: Any = mujoco.MjData(self.model)
        """MuJoCo's data, in the state of the last step."""
        self._state = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._size = mujoco.mj_stateSize(self.model, self._state)
        joint = self.model.joint
        self._pins = [int(joint(f"{name}_pin").qposadr[0]) for name in WHEELS]
        self._rolls = [int(joint(f"{name}_roll").qposadr[0]) for name in WHEELS]
        self._rolls_v = [int(joint(f"{name}_roll").dofadr[0]) for name in WHEELS]
        spin = float(self.model.body(WHEELS[0]).inertia[1])
        self._inertia = settings.mass + 4.0 * spin / self.radius**2
        self._weight = 0.25 * settings.mass * GRAVITY
        self._floor = int(self.model.geom("floor").id)
        self._geoms = {int(self.model.geom(name).id): wheel for wheel, name in enumerate(WHEELS)}
        for _ in range(round(SETTLING / STEP)):
            mujoco.mj_step(self.model, self.data)
        self._rest: Array = self.data.qpos.copy()
        self._servo = (0.0, 0.0)

    def settled(self, motion: Motion) -> Array:
        """Return the state of the car on its springs, rolling straight on without slip, with servos as its
        wheels point.
        """
        x, y, theta, v, front, rear, right, left, _ = motion
        data, radius, qpos = self.data, self.radius, self._rest.copy()
        mujoco.mj_resetData(self.model, data)
        qpos[0], qpos[1] = x, y
        qpos[3:7] = cos(0.5 * theta), 0.0, 0.0, sin(0.5 * theta)
        for wheel, angle in enumerate((front, front, rear, rear)):
            qpos[self._pins[wheel]] = angle
            qpos[self._rolls[wheel]] = (right if wheel % 2 else left) / radius
            data.qvel[self._rolls_v[wheel]] = v / radius
            data.ctrl[2 * wheel] = angle
        data.qpos[:] = qpos
        data.qvel[0], data.qvel[1] = v * cos(theta), v * sin(theta)
        data.qvel[5] = v * (tan(front) - tan(rear)) / self.body.wheelbase
        return self._kept()

    def _kept(self) -> Array:
        state = np.empty(self._size)
        mujoco.mj_getState(self.model, self.data, state, self._state)
        return state

    def step(
        self, motion: Motion, hidden: Array, drive: MotorDrive, front: float, rear: float, dt: float
    ) -> tuple[Motion, Array]:
        """Move the car."""
        model, data, radius = self.model, self.data, self.radius
        if hidden is not self._last:
            mujoco.mj_setState(model, data, hidden, self._state)
        servo_front, servo_rear = data.ctrl[0], data.ctrl[4]
        if motion[3] == 0.0 and not drive.driven and (servo_front, servo_rear) == (front, rear):
            return motion, hidden
        steps = ceil(dt / STEP - 1e-9)
        h = model.opt.timestep = dt / steps
        travel, qvel, ctrl, rolls = self.vehicle.servo_rate * h, data.qvel, data.ctrl, self._rolls_v
        dry = 0.0 if drive.driven else 0.25 * self._inertia * drive.free / drive.tau * radius
        for wheel in rolls:
            model.dof_frictionloss[wheel] = dry
        free = drive.free if drive.driven else 0.0
        for _ in range(steps):
            servo_front += min(max(front - servo_front, -travel), travel)
            servo_rear += min(max(rear - servo_rear, -travel), travel)
            v = 0.25 * radius * (qvel[rolls[0]] + qvel[rolls[1]] + qvel[rolls[2]] + qvel[rolls[3]])
            torque = 0.25 * self._inertia * radius * (free - drive.loss * v) / drive.tau
            ctrl[:] = servo_front, torque, servo_front, torque, servo_rear, torque, servo_rear, torque
            mujoco.mj_step(model, data)
        qpos = data.qpos
        theta = self._heading()
        vx, vy = qvel[0:2].tolist()
        speed = vx * cos(theta) + vy * sin(theta)
        if not isfinite(speed) or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise self.lost(motion, "its accelerations grow beyond all bounds")
        roll, pitch = self.leaning(qpos)
        if max(abs(roll), abs(pitch)) > OVER:
            raise self.lost(motion, "the car has rolled over")
        arrived = (servo_front, servo_rear) == (front, rear)
        if not drive.driven and arrived and hypot(vx, vy) < STANDS and np.abs(qvel).max() < 10.0 * STANDS:
            speed = 0.0
        pins, angles = self._pins, self._rolls
        after: Motion = (
            float(qpos[0]),
            float(qpos[1]),
            theta,
            speed,
            0.5 * float(qpos[pins[0]] + qpos[pins[1]]),
            0.5 * float(qpos[pins[2]] + qpos[pins[3]]),
            radius * float(qpos[angles[1]]),
            radius * float(qpos[angles[0]]),
            0.0,
        )
        return after, self._kept()

    def _heading(self) -> float:
        w, i, j, k = self.data.qpos[3:7].tolist()
        return atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))

    def lift(self, up: bool) -> None:
        """Take floor and weight away, and hold the body; put down again, it stands on its springs at the same place."""
        option, no_contact = self.model.opt, int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        option.disableflags = option.disableflags | no_contact if up else option.disableflags & ~no_contact
        option.gravity[2] = 0.0 if up else -GRAVITY
        self.model.dof_damping[:6] = HELD if up else 0.0
        self._hidden.clear()
        self._before = None

    def leaning(self, hidden: Array) -> tuple[float, float]:
        """Return the body's present roll, left side up, and pitch, nose down."""
        w, i, j, k = self.data.qpos[3:7].tolist()
        return atan2(2.0 * (w * i + j * k), 1.0 - 2.0 * (i * i + j * j)), asin(
            min(max(2.0 * (w * j - k * i), -1.0), 1.0)
        )

    def pressing(self, hidden: Array) -> tuple[float, ...]:
        """Return the present normal forces of the contacts."""
        loads, force = [0.0] * 4, np.zeros(6)
        for number in range(self.data.ncon):
            contact = self.data.contact[number]
            wheel = self._geoms.get(int(contact.geom[0]), self._geoms.get(int(contact.geom[1])))
            if wheel is not None:
                mujoco.mj_contactForce(self.model, self.data, number, force)
                loads[wheel] += float(force[0]) / self._weight
        return tuple(loads)

    def rising(self, hidden: Array) -> tuple[float, ...]:
        """Return the present heights of the tyres' lowest points."""
        heights = []
        for name in WHEELS:
            geom, (radius, _, half) = self.data.geom(name), self.model.geom(name).size
            tilt = float(geom.xmat[8]) ** 2
            heights.append(max(0.0, float(geom.xpos[2]) - sqrt(radius**2 * (1.0 - tilt) + half**2 * tilt)))
        return tuple(heights)


def create(config: Config) -> FourWheels:
    """Make the physics ``mujoco``."""
    return FourWheels(config)
