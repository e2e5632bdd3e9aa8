"""The hardware layer below the tasks, simulated or real."""

from txt1.hal.base import BoardLink, Button, Capabilities, Hal, Indicators, Inputs, Outputs
from txt1.hal.plain_hal import PlainHal

__all__ = ["BoardLink", "Button", "Capabilities", "Hal", "Indicators", "Inputs", "Outputs", "PlainHal"]
