"""Where light readings come from: one small interface, simulated or real sensors behind it."""

from __future__ import annotations

from math import cos, sin
from typing import Any, Final, Protocol

from txt1.errors import HalError, MissingExtra
from txt1.learning.trial import Pose, bearing_to
from txt1.model.light import LUX_MAX, LUX_MIN, SENSOR_X, SENSOR_Y, SENSORS, Readings
from txt1.sim.light import LightSensors

BASE: Final = 100.0
"""Mean reading of the compass that stands in for the four sensors, lux."""


class LightSource(Protocol):
    """The four light sensors, whatever they are."""

    def read(self, pose: Pose | None) -> Readings:
        """The present readings, lux; `pose` is the true one in the room (m, rad), where there is one. Never waits."""

    def close(self) -> None:
        """Let go of the hardware."""


class SimulatedSensors:
    """The four sensors of a simulated robot, which see from its true pose."""

    def __init__(self, sensors: LightSensors) -> None:
        self._sensors = sensors

    def read(self, pose: Pose | None) -> Readings:
        """The present readings, lux."""
        if pose is None:
            raise HalError("simulated light sensors see from the true pose, and this HAL does not know it")
        x, y, theta = pose
        return self._sensors.read(x, y, theta)

    def close(self) -> None:
        """Nothing to let go of."""


class Compass:
    """Readings whose `txt1.learning.light.direction` is the light's true bearing, as O's simulated learner had it."""

    def __init__(self, light: tuple[float, float]) -> None:
        self._light = light

    def read(self, pose: Pose | None) -> Readings:
        """The present readings, lux."""
        if pose is None:
            raise HalError("the true bearing is known in simulation only: set sim.light.true_bearing=false")
        bearing = bearing_to(self._light, pose)
        front, left = cos(bearing) / SENSOR_X, sin(bearing) / SENSOR_Y
        return Readings(BASE + front + left, BASE + front - left, BASE - front + left, BASE - front - left)

    def close(self) -> None:
        """Nothing to let go of."""


class PhidgetSensors:
    """Four light sensors on a Phidgets Interface Kit, as on the thesis's robot (5.5.1).

    The driver's thread writes the latest voltage ratio of each channel; `read` turns it into lux and never waits. The
    thesis's 1127 precision sensor gives a voltage ratio of 0 to 1 for 0 to 1000 lux. A channel that is not attached, or
    has not reported yet, reads NaN, which stops the robot (see `txt1.learning.light`).

    Args:
        channels: of FL, FR, RL and RR.
        serial_number: of the kit; None for the only one there is.

    Raises:
        MissingExtra: Phidget22 is not installed.
        HalError: there is no such kit, or Phidgets' library cannot be loaded.

    """

    PATIENCE_MS: Final = 5000
    INTERVAL_MS: Final = 16

    def __init__(self, channels: tuple[int, int, int, int] = (0, 1, 2, 3), serial_number: int | None = None) -> None:
        try:
            from Phidget22.Devices.VoltageRatioInput import VoltageRatioInput
            from Phidget22.PhidgetException import PhidgetException
        except ImportError:
            raise MissingExtra("reading Phidgets light sensors", "phidgets") from None
        self._ratios = [float("nan")] * len(SENSORS)
        self._inputs: list[Any] = []
        try:
            for k, channel in enumerate(channels):
                sensor = f"light sensor {SENSORS[k]} on analog input {channel}"
                one = VoltageRatioInput()
                self._inputs.append(one)
                one.setChannel(channel)
                if serial_number is not None:
                    one.setDeviceSerialNumber(serial_number)
                one.setOnVoltageRatioChangeHandler(lambda _, ratio, k=k: self._take(k, ratio))
                one.setOnDetachHandler(lambda _, k=k: self._take(k, float("nan")))
                one.openWaitForAttachment(self.PATIENCE_MS)
                one.setDataInterval(max(self.INTERVAL_MS, one.getMinDataInterval()))
                one.setVoltageRatioChangeTrigger(0.0)
        except PhidgetException as error:
            self.close()
            why = " ".join(f"{error.description}: {error.details}".split()).rstrip(":.")
            raise HalError(
                f"{sensor}: {why}; is the Interface Kit plugged in, may you open it (udev), and are its sensors on "
                "inputs 0 to 3 (FL FR RL RR)?"
            ) from error
        except OSError as error:
            raise HalError(f"Phidgets' library cannot be loaded: {error}; Debian has libusb in libusb-1.0-0") from error

    def _take(self, k: int, ratio: float) -> None:
        self._ratios[k] = ratio

    def read(self, pose: Pose | None) -> Readings:
        """The present readings, lux."""
        del pose
        return Readings(
            *(min(max(LUX_MAX * ratio, LUX_MIN), LUX_MAX) if ratio == ratio else ratio for ratio in self._ratios)
        )

    def close(self) -> None:
        """Let go of the kit."""
        for each in self._inputs:
            each.close()
