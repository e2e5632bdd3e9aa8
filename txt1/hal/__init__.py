"""The hardware layer below the tasks, simulated or real."""

from txt1.hal.base import BoardLink, Button, Capabilities, Hal, Indicators, Inputs, Outputs
from txt1.hal.plain_hal import PlainHal
from txt1.model.odometry import advance
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, sides

__all__ = [
    "PWM_MAX",
    "STEERING_MAX",
    "BoardLink",
    "Button",
    "Capabilities",
    "Hal",
    "Indicators",
    "Inputs",
    "Outputs",
    "PlainHal",
    "advance",
    "sides",
]
