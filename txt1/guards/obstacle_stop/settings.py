"""The section ``obstacle_stop`` of the configuration."""

from typing import Literal

from txt1.config.schema import Section
from txt1.units import NotNegative, Positive


class ObstacleStop(Section):
    """The obstacle stop: with its speed the vehicle can stop before it touches anything that the laser sees."""

    enabled: Literal["auto", "always", "never"] = "auto"
    """"auto" is on if a laser scanner is among the sensors."""
    sensor: str = ""
    """Name of the laser scanner; empty: the only one."""
    margin: NotNegative = 0.08
    """Distance kept round the body, m: the rear corners swing out by 0.042 in the narrowest curve, and ranges
    have noise.
    """
    reaction: NotNegative = 0.15
    """Time from a lower set-point to a lower speed, s."""
    deceleration: Positive = 1.0
    """Deceleration of braking, m/s^2."""
    people: NotNegative = 0.0
    """Largest speed at which something may come towards the vehicle, m/s; people walk at 1.6 (ISO 13855)."""
    reverse: NotNegative = 0.3
    """Largest speed backwards, where the laser does not see all, m/s."""
    timeout: Positive = 0.5
    """Age of a scan at which the robot has to stand, s."""
