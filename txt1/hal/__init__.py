"""The hardware layer below the tasks, simulated or real."""

from txt1.hal.base import BoardLink, Button, Capabilities, Hal, Indicators, Inputs, Outputs

__all__ = ["BoardLink", "Button", "Capabilities", "Hal", "Indicators", "Inputs", "Outputs"]
