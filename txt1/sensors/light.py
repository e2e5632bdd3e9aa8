"""The four light sensors: simulated sensors, which see from the vehicle's true pose, and Phidgets' (thesis 5.3,
5.5.1).
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from math import atan2, cos, inf, nan, sin
from typing import Any, Final

from txt1.config import Config
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, SAMPLE_PERIOD, SENSOR_X, SENSOR_Y, SENSORS, Readings
from txt1.sensors.base import Pose, Reading, Setup, reading_topic
from txt1.sensors.simulated_sensor import SimulatedSensor, true_pose
from txt1.sim.lamp import LightSensors, PointLight, noise_for_jitter
from txt1.sim.parameters import Box
from txt1.sim.pcg64 import Draws, Pcg64
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

LIGHT: Final = declare(
    Topic(
        "/light",
        Readings,
        "lux",
        define("txt1_msgs/Light", "std_msgs/Header header\nfloat64[4] lux"),
        Rule.EVENT,
        "the four light sensors: FL, FR, RL, RR",
        {"header": {"frame_id": "base_footprint"}},
        tuple(f"lux.{k}" for k in range(len(SENSORS))),
        lambda readings: readings,
    )
)

# distinguishes the random values of simulated light sensors
STREAM: Final = 3
# mean reading of the compass that stands in for the four sensors, lux
MEAN_LIGHT: Final = 100.0
# the readings (lux) of a vehicle at a pose in the room, m and rad
See = Callable[[Pose], Readings]


def topic_of(name: str) -> Topic[Readings]:
    """Return the topic of the light sensors of this name: ``/light``, or ``/sensors/NAME`` for further sensors."""
    if name == "light":
        return LIGHT
    return reading_topic(name, Readings, "lux", LIGHT.about, LIGHT.message, LIGHT.paths, LIGHT.make, LIGHT.constants)


# -- simulated ---------------------------------------------------------------------------------------------------


def eyes(
    config: Config,
    rng: Draws,
    faults: Sequence[str] | None = None,
    movers: Callable[[], Sequence[Box]] = tuple,
) -> See:
    """Return a function that reads the four sensors from a pose: the configured light, unless something hides it.

    `faults`: a `SensorFault` for each of FL FR RL RR. `movers` returns the boxes that move in the room. Raises
    ValueError for an unknown fault or a wrong number of faults.
    """
    light, (x, y) = config.sim.light, config.sim.room.light
    if light.true_bearing:
        return compass((x, y))
    exponent = float(light.exponent)
    height = light.height
    noise = noise_for_jitter(exponent=exponent, height=height) if light.noise is None else light.noise
    source = PointLight(x, y, light.intensity, exponent, height)
    lit, walls = None, config.sim.room.built().walls
    if walls is not None or config.sim.obstacles or config.sim.movers:
        from txt1.sim.shadow import lit_by

        lit = lit_by((x, y), None if walls is None else walls.grid, config.sim.obstacles, movers, light.mount)
    sensors = LightSensors(source, noise, rng, mount=light.mount, gains=light.gains, lit=lit)
    sensors.faults = light.faults if faults is None else faults
    return lambda pose: sensors.read(*pose)


def compass(light: tuple[float, float]) -> See:
    """Return readings whose direction without compression (`txt1.learning.light_direction`) is the light's bearing, as
    in the original simulation.
    """

    def see(pose: Pose) -> Readings:
        x, y, theta = pose
        bearing = wrap_angle(atan2(light[1] - y, light[0] - x) - theta)
        front, left = cos(bearing) / SENSOR_Y, sin(bearing) / SENSOR_X
        return Readings(
            MEAN_LIGHT + front + left, MEAN_LIGHT + front - left, MEAN_LIGHT - front + left, MEAN_LIGHT - front - left
        )

    return see


class SimulatedLight(SimulatedSensor[Readings]):
    """The four sensors of a simulated robot, which see from its true pose (`pose`)."""

    def __init__(self, see: See, pose: Callable[[], Pose | None], name: str = "light") -> None:
        super().__init__(topic_of(name), SAMPLE_PERIOD, pose)
        self._see = see

    def see(self, pose: Pose, now: float, before: float) -> Reading[Readings]:
        """Return the readings at `now`, lux."""
        return Reading(now, self._see(pose))


def simulated(setup: Setup) -> SimulatedLight:
    """Make the driver ``sim_light``; options: ``seed`` (numbers that repeat its noise) and ``faults`` (see `eyes`)."""
    options = _known(setup, "seed", "faults")
    pose = true_pose(setup)
    seed = options.get("seed", [setup.config.own_seed, 1, STREAM])
    try:
        rng, movers = Pcg64(seed), setup.hal.movers
        see = eyes(setup.config, rng, options.get("faults"), movers)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"sensors.{setup.name}.options: {error}") from None
    return SimulatedLight(see, pose, setup.name)


def _known(setup: Setup, *names: str) -> Mapping[str, Any]:
    """Return the options; raises ConfigError for an option that is not among these names."""
    for name in setup.options:
        if name not in names:
            raise ConfigError(f"sensors.{setup.name}.options.{name}: unknown; known here: {', '.join(names)}")
    return setup.options


# -- Phidgets ----------------------------------------------------------------------------------------------------


class PhidgetLight:
    """Four light sensors on a Phidgets Interface Kit, as on the thesis's robot (5.5.1).

    The driver's thread writes the latest voltage ratio of each channel; `read` turns it into lux and never waits. The
    thesis's 1127 precision sensor gives a voltage ratio of 0 to 1 for 0 to 1000 lux. A channel that is not attached, or
    has not reported yet, reads NaN, which stops a learner (see `txt1.learning.light_direction`). The channels are in
    the order FL, FR, RL, RR. The serial number is the kit's; None: the only kit.
    """

    period = SAMPLE_PERIOD
    simulated = False
    PATIENCE_MS: Final = 5000
    INTERVAL_MS: Final = 16

    def __init__(
        self, name: str = "light", channels: Sequence[int] = (0, 1, 2, 3), serial_number: int | None = None
    ) -> None:
        self.topic = topic_of(name)
        self._channels, self._serial_number = channels, serial_number
        self._last = -inf
        self._ratios = [nan] * len(SENSORS)
        self._inputs: list[Any] = []

    async def open(self) -> None:
        """Wait for the kit, in another thread."""
        await asyncio.to_thread(self._attach)

    def _attach(self) -> None:
        try:
            from Phidget22.Devices.VoltageRatioInput import VoltageRatioInput
            from Phidget22.PhidgetException import PhidgetException
        except ImportError:
            raise MissingExtra("reading Phidgets light sensors", "devices") from None
        sensor = ""
        try:
            for k, channel in enumerate(self._channels):
                sensor = f"light sensor {SENSORS[k]} on analog input {channel}"
                one = VoltageRatioInput()
                self._inputs.append(one)
                one.setChannel(channel)
                if self._serial_number is not None:
                    one.setDeviceSerialNumber(self._serial_number)
                one.setOnVoltageRatioChangeHandler(lambda _, ratio, k=k: self._ratios.__setitem__(k, ratio))
                one.setOnDetachHandler(lambda _, k=k: self._ratios.__setitem__(k, nan))
                # the library attaches a kit again that was away, with its own interval
                one.setOnAttachHandler(self._report_often)
                one.openWaitForAttachment(self.PATIENCE_MS)
                self._report_often(one)
        except PhidgetException as error:
            self._detach()
            why = " ".join(f"{error.description}: {error.details}".split()).rstrip(":.")
            raise HalError(
                f"{sensor}: {why}; is the Interface Kit plugged in, may you open it (udev), and are its sensors on "
                "inputs 0 to 3 (FL FR RL RR)?"
            ) from error
        except OSError as error:
            self._inputs.clear()
            raise HalError(f"Phidgets' library cannot be loaded: {error}; Debian has libusb in libusb-1.0-0") from error

    def _report_often(self, one: Any) -> None:
        """Let an attached channel report every sample."""
        one.setDataInterval(max(self.INTERVAL_MS, one.getMinDataInterval()))
        one.setVoltageRatioChangeTrigger(0.0)

    async def close(self) -> None:
        """Release the kit."""
        self._detach()

    def _detach(self) -> None:
        while self._inputs:
            self._inputs.pop().close()
        self._ratios[:] = [nan] * len(SENSORS)

    def read(self, now: float) -> Reading[Readings] | None:
        """Return the present readings, lux."""
        if now <= self._last:
            return None
        self._last = now
        lux = (min(max(LUX_MAX * ratio, LUX_MIN), LUX_MAX) if ratio == ratio else ratio for ratio in self._ratios)
        return Reading(now, Readings(*lux))


def phidgets(setup: Setup) -> PhidgetLight:
    """Make the driver ``phidgets_light``; options: ``channels`` (of FL, FR, RL, RR) and ``serial_number`` (of
    the kit).
    """
    options = _known(setup, "channels", "serial_number")
    channels = options.get("channels", (0, 1, 2, 3))
    if not (isinstance(channels, Sequence) and len(channels) == len(SENSORS)):
        raise ConfigError(f"sensors.{setup.name}.options.channels: takes four inputs, not {channels!r}")
    return PhidgetLight(setup.name, channels, options.get("serial_number"))
