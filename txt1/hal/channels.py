"""Adapts the outputs and encoders of the hardware to a vehicle's wiring (`txt1.model.channels`); the only place
for it.
"""

from dataclasses import replace
from typing import Any, cast

from txt1.hal.base import Capabilities, Hal, Inputs, Outputs
from txt1.model.channels import STRAIGHT, Channels


class Rewired:
    """A hardware layer behind the channels of its vehicle; other calls pass unchanged.

    Args:
        hal: the hardware layer.
        channels: the vehicle's channels.
        skids: whether its sides run at two speeds.
        unseen: hide the encoders from the tasks. Calibration uses it while the encoders' signs are unknown, as the
            runaway watch would disarm; `counts` still has them.

    """

    def __init__(self, hal: Hal, channels: Channels, skids: bool, unseen: bool = False) -> None:
        self._hal, self._channels, self._skids, self._unseen = hal, channels, skids, unseen
        can = hal.capabilities
        self.name = hal.name
        self.capabilities: Capabilities = replace(can, ticks=False, odometry=False) if unseen else can
        self.counts: tuple[int, int] | None = None
        """Encoder counts (right, left) of the last reading, also if they are hidden."""

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the hardware layer."""
        return getattr(self._hal, name)

    def read(self, now: float) -> Inputs:
        """Return the sensors' report, with the encoders' signs and sides corrected."""
        inputs = self._hal.read(now)
        if inputs.ticks is None:
            return inputs
        self.counts = self._channels.counted(*inputs.ticks)
        return inputs._replace(ticks=None if self._unseen else self.counts)

    def write(self, outputs: Outputs, now: float) -> None:
        """Hold these outputs from `now` on, converted to the wiring."""
        self._hal.write(self._put_right(outputs), now)

    def halt(self, outputs: Outputs, now: float) -> None:
        """Set neutral outputs directly, converted to the wiring."""
        self._hal.halt(self._put_right(outputs), now)

    def _put_right(self, outputs: Outputs) -> Outputs:
        motor, front, rear = self._channels.wired(outputs.motor, outputs.front, outputs.rear, self._skids)
        return outputs._replace(motor=motor, front=front, rear=rear)


def rewired(hal: Hal, channels: Channels, skids: bool, unseen: bool = False) -> Hal:
    """Return the hardware layer behind its vehicle's channels; the layer itself if nothing has to be converted."""
    if isinstance(hal, Rewired) or not hal.capabilities.pwm or (channels == STRAIGHT and not unseen):
        return hal
    return cast("Hal", Rewired(hal, channels, skids, unseen))
