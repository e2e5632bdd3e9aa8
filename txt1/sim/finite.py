"""Checks a physics: numbers that are not finite, or too few, end the run, and the vehicle stays where it was."""

from collections.abc import Callable
from math import isfinite
from typing import Any

from txt1.errors import HalError
from txt1.sim.dynamics import Motion


class Finite:
    """A physics with every motion checked; everything else is passed on."""

    def __init__(self, name: str, physics: Callable[[Motion, float, float, float, float, float], Motion]) -> None:
        self._name, self._physics = name, physics
        self._failed = False

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the physics."""
        return getattr(self._physics, name)

    def __call__(self, motion: Motion, motor: float, front: float, rear: float, dt: float, drag: float) -> Motion:
        """Return the motion `dt` seconds later; raises HalError if a number is missing or not finite."""
        if not self._failed:
            after = self._physics(motion, motor, front, rear, dt, drag)
            count = len(after)
            if count == len(motion) and isfinite(sum(after)):
                return after
            self._failed = True
            if count != len(motion):
                raise HalError(
                    f"sim.physics: {self._name} returns {count} numbers, and a motion has {len(motion)}; add the others"
                )
            raise HalError(
                f"sim.physics: {self._name} returns a number that is not finite at {motion[3]:.2f} m/s; "
                "drive slower, or set sim.physics=plain"
            )
        # so that neutral outputs still pass when the robot is stopped
        return (*motion[:3], 0.0, *motion[4:])
