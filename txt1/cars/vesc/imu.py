"""The IMU on a VESC's own board, read over the line that drives the car (COMM_GET_IMU_DATA).

A controller without an IMU answers all the same, with zeros. So nothing is told before the acceleration was once near
1 g, and never an answer of zeros.
"""

from dataclasses import dataclass
from math import cos, hypot, inf, radians, sin
from typing import Final

from txt1.cars.vesc.driver import ImuValues, VescHal
from txt1.config import checked
from txt1.errors import ConfigError, HalError
from txt1.sensors.base import Reading, Setup
from txt1.sensors.readings import IMU_MOUNT, STANDARD_GRAVITY, ImuReading, ImuSigma, Mount, imu_topic
from txt1.units import NotNegative

# s between two questions
ANSWER_PERIOD: Final = 0.02
# g: the first acceleration of a car that stands lies within this of 1
GRAVITY_NEAR: Final = 0.2
SIGMA: Final = ImuSigma(rates=0.02, acceleration=1.0, attitude=0.0, heading=0.0)
"""Assumed; it tells no orientation here."""


@dataclass(frozen=True, slots=True)
class VescImuOptions:
    """The mounting of the controller."""

    latency: NotNegative = 0.002
    """Time from measuring to the answer's last byte, s."""
    mount: Mount = IMU_MOUNT
    """x, y, z (m) on the vehicle, and the angle (rad) of the IMU's x axis to the vehicle's."""
    sigma: ImuSigma = SIGMA
    """Standard deviations for its messages: rates (rad/s), accelerations (m/s^2)."""


class VescImu:
    """Asks the VESC that drives the car. Without a robot, as in a check, it opens the line and commands nothing."""

    period = ANSWER_PERIOD

    def __init__(self, name: str, hal: VescHal, options: VescImuOptions) -> None:
        self.topic = imu_topic(name)
        self.simulated = hal.capabilities.simulated
        self._hal, self._options = hal, options
        # whether the line was opened here
        self._own = False
        self._forget()

    def _forget(self) -> None:
        # the last answer, and whether one was near 1 g
        self._seen: tuple[float, ImuValues] | None = None
        self._found = False
        # s of the loop's clock at the start of the run
        self._origin = inf
        self._last = -inf

    async def open(self) -> None:
        """Open the line, unless the robot has."""
        self._forget()
        self._own = not self._hal.line.opened
        if self._own:
            await self._hal.line.open()

    async def close(self) -> None:
        """Close the line if it was opened here."""
        if self._own:
            self._own = False
            await self._hal.line.close()

    def read(self, now: float) -> Reading[ImuReading] | None:
        """Return the answer to the last question, and ask again; raises HalError if there is no IMU."""
        self._origin = min(self._origin, self._hal.line.time() - now)
        self._hal.ask_imu()
        answer = self._hal.imu
        if answer is None or answer is self._seen:
            return None
        self._seen = answer
        taken, values = answer
        size = hypot(*values.acceleration)
        if not any(values.acceleration):
            self._found = False
            raise HalError("the VESC tells an acceleration of 0: it has no IMU, or none is set in VESC Tool, App, IMU")
        if not self._found and abs(size - 1.0) > GRAVITY_NEAR:
            remedy = "let the car stand still, and check its IMU in VESC Tool, App, IMU"
            raise HalError(f"the VESC's IMU tells {size:.2f} g at first, and not 1: {remedy}")
        self._found = True
        time = max(self._last, min(taken - self._origin - self._options.latency, now))
        if time < 0.0:
            return None
        self._last = time
        return Reading(time, self._reading(values))

    def _reading(self, values: ImuValues) -> ImuReading:
        """Return a reading in the vehicle's axes."""
        mount = self._options.mount
        c, s = cos(mount.yaw), sin(mount.yaw)
        (ax, ay, az), (p, q, r) = values.acceleration, values.rates
        force = STANDARD_GRAVITY * (c * ax - s * ay), STANDARD_GRAVITY * (s * ax + c * ay), STANDARD_GRAVITY * az
        rates = radians(c * p - s * q), radians(s * p + c * q), radians(r)
        return ImuReading(force, rates, None, None, mount._replace(yaw=0.0), self._options.sigma)


def create(setup: Setup) -> VescImu:
    """Make the driver ``imu_vesc``; options: those of `VescImuOptions`."""
    given = checked(VescImuOptions, setup.options, f"sensors.{setup.name}.options")
    if setup.config.hal != "vesc":
        raise ConfigError(
            f"sensors.{setup.name}.driver: imu_vesc is the IMU of the VESC that drives, and hal is "
            f"'{setup.config.hal}'; use hal: vesc, or the driver of another IMU"
        )
    return VescImu(setup.name, setup.hal, given)
