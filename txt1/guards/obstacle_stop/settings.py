"""The section ``obstacle_stop`` of the configuration."""

from typing import Literal

from txt1.config.schema import Section
from txt1.units import NotNegative, Positive


class ObstacleStop(Section):
    """The laser's say in the safety gate: the speed from which the vehicle stands before it touches anything."""

    enabled: Literal["auto", "always", "never"] = "auto"
    """"auto" is on where a laser scanner is among the sensors."""
    sensor: str = ""
    """Name of the laser scanner; empty: the only one."""
    margin: NotNegative = 0.08
    """Kept round the body, m: the rear corners swing out by 0.042 in the narrowest curve, and a range has noise."""
    reaction: NotNegative = 0.15
    """From a lower set-point to a lower speed, s."""
    deceleration: Positive = 1.0
    """With which it brakes, m/s^2."""
    reverse: NotNegative = 0.3
    """Largest speed backwards, where it sees nothing, m/s."""
    timeout: Positive = 0.5
    """Age of a scan at which it stands still, s."""
