"""A simulated IMU: specific force with gravity and vibration, rates with bias and noise (assumed for a 3DM-GX2)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, exp, hypot, inf, sin, sqrt
from random import Random

from txt1.config.sources import checked
from txt1.model.kinematics import wrap_angle
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.readings import IMU_MOUNT, ImuReading, ImuSigma, Mount, Quaternion, Vector, imu_topic
from txt1.sensors.simulated_sensor import SimulatedSensor, random_of, true_pose
from txt1.units import GRAVITY, NotNegative, Positive

# m/s: a faster vehicle was carried
CARRIED_SPEED = 5.0
Attitude = Callable[[], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """Standard deviations of an IMU's errors; all assumed."""

    rate_noise: NotNegative = 0.005
    """Noise of a rate in each reading, rad/s."""
    rate_bias: NotNegative = 0.003
    """Bias of the rates at power-up, rad/s: 0.2 degrees/s."""
    rate_walk: NotNegative = 0.0001
    """Drift of this bias in the first second, rad/s."""
    noise: NotNegative = 0.03
    """Noise of an acceleration in each reading, m/s^2."""
    bias: NotNegative = 0.05
    """Bias of the accelerations at power-up, m/s^2: 5 mg."""
    vibration: NotNegative = 1.0
    """Further noise of the accelerations by vibration, m/s^2 at 1 m/s."""
    heading: NotNegative = 0.035
    """Error of the heading in its orientation, rad: 2 degrees, by iron around its compass."""
    heading_time: Positive = 30.0
    """Time in which the heading's error changes, s."""
    attitude: NotNegative = 0.005
    """Error of roll and pitch in its orientation, rad."""

    @property
    def sigma(self) -> ImuSigma:
        """Return the standard deviations for its messages, at 1 m/s."""
        acceleration = hypot(self.noise, self.bias, self.vibration)
        return ImuSigma(hypot(self.rate_noise, self.rate_bias), acceleration, self.attitude, self.heading)


def quaternion(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the orientation (x, y, z, w) for angles in rad: turned by roll, then pitch, then yaw about fixed axes."""
    cr, sr, cp, sp = cos(0.5 * roll), sin(0.5 * roll), cos(0.5 * pitch), sin(0.5 * pitch)
    cy, sy = cos(0.5 * yaw), sin(0.5 * yaw)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def level() -> tuple[float, float]:
    """Return roll and pitch on level ground."""
    return 0.0, 0.0


class SimulatedImu(SimulatedSensor[ImuReading]):
    """An IMU on a vehicle whose true pose is `pose` and whose roll and pitch (rad) are `attitude`.

    A reading belongs to the middle of three poses, a period before its arrival. Rates and accelerations are first and
    second differences of the poses, exact to the second order.
    """

    def __init__(
        self,
        name: str,
        pose: Callable[[], Pose | None],
        errors: ImuErrors,
        rng: Random,
        period: float = 0.01,
        mount: Mount = IMU_MOUNT,
        attitude: Attitude = level,
    ) -> None:
        super().__init__(imu_topic(name), period, pose)
        self._attitude, self._errors, self._rng, self._mount = attitude, errors, rng, mount
        self._sigma = errors.sigma
        self._rate_bias = [errors.rate_bias * rng.gauss() for _ in range(3)]
        self._bias = [errors.bias * rng.gauss() for _ in range(3)]
        self._heading = errors.heading * rng.gauss()
        self._poses: list[tuple[float, float, float, float, float, float]] = []

    def see(self, pose: Pose, now: float, before: float) -> Reading[ImuReading] | None:
        """Return the reading of a period ago; None for the first two calls, and after the vehicle was carried."""
        poses = self._poses
        if before == -inf:
            poses.clear()
        poses.append((now, *pose, *self._attitude()))
        if len(poses) < 3:
            return None
        (
            (t0, x0, y0, theta0, roll0, pitch0),
            (t1, x1, y1, theta1, roll1, pitch1),
            (t2, x2, y2, theta2, roll2, pitch2),
        ) = poses
        del poses[0]
        first, second = t1 - t0, t2 - t1
        vx0, vy0, w0 = (x1 - x0) / first, (y1 - y0) / first, wrap_angle(theta1 - theta0) / first
        vx1, vy1, w1 = (x2 - x1) / second, (y2 - y1) / second, wrap_angle(theta2 - theta1) / second
        if hypot(vx0, vy0) > CARRIED_SPEED or hypot(vx1, vy1) > CARRIED_SPEED:
            return None
        whole, half = t2 - t0, 0.5 * (t2 - t0)
        ax, ay, alpha = (vx1 - vx0) / half, (vy1 - vy0) / half, (w1 - w0) / half
        omega = (w0 * second + w1 * first) / whole
        speed = hypot(0.5 * (vx0 + vx1), 0.5 * (vy0 + vy1))
        rates = (roll2 - roll0) / whole, (pitch2 - pitch0) / whole, omega
        c, s, (mx, my, _, _) = cos(theta1), sin(theta1), self._mount
        # a device beside the vehicle's centre circles it: alpha x r + omega x (omega x r)
        forward = c * ax + s * ay - alpha * my - omega * omega * mx
        left = c * ay - s * ax + alpha * mx - omega * omega * my
        force = _tilted(forward, left, GRAVITY, roll1, pitch1)
        return Reading(t1, self._measured(force, rates, (roll1, pitch1, theta1), speed, second))

    def _measured(self, force: Vector, rates: Sequence[float], angles: Vector, speed: float, dt: float) -> ImuReading:
        """Return the device's reading for the true forces, rates and angles."""
        errors, draw = self._errors, self._rng.gauss
        shake = hypot(errors.noise, errors.vibration * speed)
        walk = errors.rate_walk * sqrt(dt)
        bias = self._rate_bias = [each + walk * draw() for each in self._rate_bias]
        fx, fy, fz = (f + b + shake * draw() for f, b in zip(force, self._bias, strict=True))
        wx, wy, wz = (w + b + errors.rate_noise * draw() for w, b in zip(rates, bias, strict=True))
        decay = exp(-dt / errors.heading_time)
        self._heading = decay * self._heading + sqrt(1.0 - decay * decay) * errors.heading * draw()
        roll, pitch, yaw = angles
        roll, pitch = roll + errors.attitude * draw(), pitch + errors.attitude * draw()
        seen = quaternion(roll, pitch, yaw + self._heading)
        return ImuReading((fx, fy, fz), (wx, wy, wz), seen, None, self._mount, self._sigma)


def _tilted(forward: float, left: float, up: float, roll: float, pitch: float) -> Vector:
    """Turn a vector of the level frame into the frame of a body with this roll and pitch."""
    if roll == 0.0 == pitch:
        return forward, left, up
    cr, sr, cp, sp = cos(roll), sin(roll), cos(pitch), sin(pitch)
    x, z = forward * cp - up * sp, forward * sp + up * cp
    return x, left * cr + z * sr, z * cr - left * sr


def simulated(setup: Setup) -> SimulatedImu:
    """Make the driver ``sim_imu``; options: those of `ImuErrors`."""
    errors = checked(ImuErrors, setup.options, f"sensors.{setup.name}.options")
    return SimulatedImu(setup.name, true_pose(setup), errors, random_of(setup), attitude=setup.hal.attitude)
