"""The hardware layer: what is underneath the tasks, simulated or real."""

from txt1.hal.base import Button, Capabilities, Hal, Indicators, Inputs, Outputs

__all__ = ["Button", "Capabilities", "Hal", "Indicators", "Inputs", "Outputs"]
