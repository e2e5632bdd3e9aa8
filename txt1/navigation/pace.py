"""The speed of a drive: a number, or the speed that saves time or energy."""

from typing import Final

from txt1.config import Config
from txt1.errors import CommandRefused
from txt1.sim.battery import economical_speed

# m/s up to which `follow` and `go_to` were tested to stay on their way
TESTED_SPEED: Final = 1.0


def pace(speed: float | str, config: Config) -> float:
    """Return the speed in m/s: the number itself, or the quickest or the most economical speed (`sim.battery`).

    Both stay within `safety.v_max` and within the tested speeds.
    """
    if not isinstance(speed, str):
        return speed
    most = min(config.safety.v_max, TESTED_SPEED)
    if speed not in ("time", "energy"):
        raise CommandRefused(f"speed {speed!r}: give m/s, or one of time, energy")
    return most if speed == "time" else economical_speed(config.sim.battery, most)
