"""The section ``roll_guard`` of the configuration."""

from typing import Annotated

from annotated_types import Gt, Le

from txt1.config.schema import Section
from txt1.units import NotNegative, Positive


class RollGuard(Section):
    """The roll-over guard: a curve is taken no faster than the measured roll of the ground allows.

    While the IMU is silent, curves are taken at a crawl.
    """

    enabled: bool = False
    """Whether it limits speed and yaw rate; it needs an IMU."""
    sensor: str = "imu"
    """Name of the IMU."""
    gravity_height: Positive = 0.15
    """Height of the centre of gravity, m: half of the body's; assumed."""
    roll_gradient: NotNegative = 0.0
    """Roll of the body outwards on its springs in a curve, rad per m/s^2 of lateral acceleration; 0: stiff."""
    share: Annotated[float, Gt(0.0), Le(1.0)] = 0.75
    """Share of the lean at which wheels lift that is used; chosen."""
    memory: Positive = 3.0
    """Time for which a roll is remembered, s; chosen."""
