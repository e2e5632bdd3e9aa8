"""The section ``estimation`` of the configuration, and what the filter tells of each sensor.

This module is not compiled: snapshots are read back by the types of the fields of `Trust`, which compiled code forgets.
"""

from typing import Annotated, Final, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from txt1.config.schema import Section, SensorName
from txt1.units import NotNegative, Positive

Quantity = Literal["x", "y", "theta", "v", "omega"]

PRESETS: Final[dict[str, tuple[str, ...]]] = {
    "none": (),
    "encoders": ("encoders",),
    "gyro": ("imu", "encoders"),
    "imu-gps": ("imu", "encoders", "gps"),
    "vicon": ("imu", "encoders", "vicon"),
}
"""The thesis's set-ups (3.3.3, 3.4.3): the sensors that are fused, those first that can be done without best."""


class FusedConfig(Section):
    """How a sensor is fused."""

    fields: tuple[Quantity, ...] | None = None
    """The quantities that are taken from it; null: omega of an IMU, the position of a GPS, the pose of a tracker."""
    sigma: dict[Quantity, Positive] = {}
    """Their standard deviations, m, rad, m/s, rad/s; default: the reading's own, or assumed values."""
    delay: NotNegative = 0.0
    """Its readings were taken so much earlier than they say, s."""
    lever: tuple[float, float] = (0.0, 0.0)
    """It sits so much further ahead and to the left than its driver says, m."""
    scale: Annotated[float, Field(gt=-0.2, lt=0.2)] = 0.0
    """A gyro's rates are too large by this share."""
    lever_sigma: Positive = 0.1
    """Standard deviation of its place on the robot, m; some measure it from another point."""
    delay_sigma: Positive = 0.05
    """Standard deviation of its delay, s."""
    scale_sigma: NotNegative = 0.017
    """Standard deviation of a gyro's scale: a data sheet has +-3 % (MPU-6050). 0: it is exact."""
    timeout: Positive = 1.0
    """Time without a reading that came in time, after which it is left out, s."""
    gate: Positive = 5.0
    """Mahalanobis distance from the estimate beyond which a reading is not believed."""


class EstimationConfig(Section):
    """The filter that makes one odometry of all sensors."""

    preset: Literal["none", "encoders", "gyro", "imu-gps", "vicon"] = "none"
    """The sensors to fuse: none; encoders; with an IMU; with IMU and GPS; with IMU and motion capture."""
    sensors: tuple[SensorName, ...] | None = None
    """The sensors to fuse, by name, with "encoders" for the encoders; null: the preset's sensors."""
    settings: dict[SensorName, FusedConfig] = {}
    """How they are fused, by their names."""
    slip: Annotated[float, Field(gt=0.0, le=0.5)] = 0.05
    """Standard deviation of the wheels' slip, and error of their radius, before anything is known of it."""
    track_sigma: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """Standard deviation of the track width, as a share of it; up to 0.01 it is exact, and turns tell of slip.
    Null: 0.05, and 0.3 for sides at two speeds, whose wheels scrub."""
    start: tuple[float, float, float] | None = None
    """The pose at the start, m, m, rad, of a robot that is put on a mark; null: a sensor of positions tells it."""
    start_sigma: tuple[Positive, Positive, Positive] = (0.02, 0.02, 0.03)
    """Its standard deviations, m, m, rad."""
    loops: bool = False
    """Whether the velocity loops use its speed and yaw rate, as combined odometry, in place of the encoders'."""

    @model_validator(mode="after")
    def _checked(self) -> Self:
        """Refuse settings that contradict one another, or have no effect."""
        if self.preset != "none" and self.sensors is not None:
            raise ValueError(f"preset '{self.preset}' and sensors contradict one another; give one of them")
        twice = [name for name in self.names if self.names.count(name) > 1]
        if twice:
            raise ValueError(f"sensors names '{twice[0]}' twice")
        if self.start is None and self.start_sigma != type(self).model_fields["start_sigma"].default:
            raise ValueError("start_sigma has no effect without start")
        for name, given in self.settings.items():
            if self.names and name not in self.names:
                raise ValueError(f"settings.{name} has no effect: fused are {', '.join(self.names)}")
            if given.fields == ():
                raise ValueError(f"settings.{name}.fields is empty: leave the sensor out instead")
            useless = set(given.sigma) - set(given.fields or given.sigma)
            if useless:
                raise ValueError(f"settings.{name}.sigma.{min(useless)} has no effect: it is not in fields")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """The sensors that are fused; none: there is no filter."""
        return PRESETS[self.preset] if self.sensors is None else self.sensors


class Trust(NamedTuple):
    """How much a sensor is believed, and why."""

    name: str
    believed: bool
    # why not; empty while it is
    reason: str
    # readings that were taken in
    used: int
    # readings that were not
    rejected: int
    # readings that were older than the horizon
    late: int
    # mean of NIS over the number of values: about 1 when its covariance is right
    surprise: float
    # of the last reading, s of the run
    time: float | None
