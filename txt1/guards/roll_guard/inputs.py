"""The inputs of the roll-over guard: roll from the IMU, lateral acceleration from the odometry."""

from collections.abc import Callable
from math import asin, atan2
from typing import Final

from txt1.errors import ConfigError
from txt1.guards.roll_guard.guard import Guard
from txt1.guards.roll_guard.settings import RollGuard
from txt1.runtime import Runtime
from txt1.sensors.base import Reading
from txt1.sensors.readings import ImuReading
from txt1.tasks.state import State

# s, the age up to which a reading is used
INPUT_AGE_MAX: Final = 0.2
# weight of a new reading from a device without attitude, as its accelerometer shakes
SMOOTH: Final = 0.1


def roll_of(reading: ImuReading) -> float:
    """Return the roll of a reading, rad, left side up: by its orientation, else by gravity, which turning distorts."""
    if reading.orientation is not None:
        x, y, z, w = reading.orientation
        # elevation of the left side over the horizon
        return asin(max(-1.0, min(1.0, 2.0 * (y * z + w * x))))
    _, left, up = reading.acceleration
    return atan2(left, up)


def watching(
    last: Callable[[], Reading[ImuReading] | None], state: State
) -> Callable[[float], tuple[float | None, float]]:
    """Return a function that returns roll (rad) and lateral acceleration (m/s^2) at a time.

    Without a fresh reading the roll is None.
    """
    roll = 0.0

    def measured(now: float) -> tuple[float | None, float]:
        nonlocal roll
        reading = last()
        sideways = state.odometry.v * state.odometry.omega
        if reading is None or now - reading.time > INPUT_AGE_MAX:
            return None, sideways
        told = roll_of(reading.value)
        roll = told if reading.value.orientation is not None else roll + SMOOTH * (told - roll)
        return roll, sideways

    return measured


async def prepare(runtime: Runtime, given: RollGuard) -> None:
    """Let the IMU's roll lower the speed in curves in the safety gate, as configured; raises ConfigError: no IMU."""
    if not given.enabled:
        return
    polled, body = runtime.sensors.get(given.sensor), runtime.config.geometry
    if polled is None or not issubclass(polled.sensor.topic.type, ImuReading):
        raise ConfigError(f"roll_guard.sensor: there is no IMU '{given.sensor}'; configure sensors.{given.sensor}")
    measured = watching(lambda: polled.last, runtime.state)
    tell = runtime.state.tell
    runtime.guard("roll_guard", Guard(given, body.track_width, body.radius_min, measured, tell))
