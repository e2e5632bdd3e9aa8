"""Readings as the filter takes them."""

from enum import Enum
from typing import NamedTuple


class Kind(Enum):
    """The quantities that a measurement is of."""

    STEERING = "the steering's curvature: its change since the last one, and itself, 1/m"
    ENCODERS = "v and omega, by the encoders"
    GYRO = "omega and the gyro's bias"
    POSE = "x, y and theta"
    VELOCITY = "v and omega"
    TURN = "how far it has turned by wheels and by gyro, rad, in how long, s, and to both sides together, rad"


# the same by names of their own: in Python 3.11 an enum's attribute takes 70 to 100 ns, and a step asks for some fifty
KIND_STEERING, KIND_ENCODERS, KIND_GYRO, KIND_POSE, KIND_VELOCITY, KIND_TURN = Kind


class Measurement(NamedTuple):
    """A reading as the filter takes it."""

    # when it was taken, s of the run
    time: float
    sensor: str
    kind: Kind
    # those of the kind's quantities that it has
    rows: tuple[int, ...]
    # m, rad, m/s, rad/s
    values: tuple[float, ...]
    # their standard deviations
    sigmas: tuple[float, ...]
    # where on the robot a pose is measured, x forward, y left, m
    at: tuple[float, float] = (0.0, 0.0)
