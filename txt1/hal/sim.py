"""The simulated robot as a HAL."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from txt1.errors import NotCapable
from txt1.hal.base import Button, Capabilities, Indicators, Inputs, Outputs
from txt1.protocol.messages import CombinedOdometry, PidSet, Switch
from txt1.sim.simulator import Simulator

NEUTRAL: Final = Outputs()
NO_BUTTON: Final = Button.NONE  # an attribute of an Enum is not found quickly
BACKLIGHT: Final = 0.5
"""Nobody turns the simulated potentiometer."""


class SimHal:
    """A simulated TXT-1.

    It has no task of its own: whoever reads or writes at a later time moves the simulation there first, so it costs
    what is used and repeats exactly.
    """

    name = "sim"
    capabilities = Capabilities(
        ticks=True,
        pwm=True,
        battery=True,
        power=True,
        servos=True,
        buttons=False,
        place=True,
        pose=True,
        simulated=True,
    )

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator
        self.outputs = NEUTRAL
        self.indicators = Indicators()

    async def open(self) -> None:
        """Start with neutral outputs."""
        self.outputs = NEUTRAL
        self.simulator.command(0, 0, 0)

    async def close(self) -> None:
        """Leave the outputs neutral."""
        self.write(NEUTRAL, self.simulator.time)

    def read(self, now: float) -> Inputs:
        """Encoder counts, voltages and the true pose at `now`."""
        counts, batteries, cut_off, pose = self.simulator.sense(now)
        return Inputs(counts, None, now, batteries, cut_off, NO_BUTTON, BACKLIGHT, pose, None, None)

    def write(self, outputs: Outputs, now: float) -> None:
        """Hold these outputs from `now` on."""
        self.simulator.advance_to(now)
        self.outputs = outputs
        self.simulator.command(outputs.motor, outputs.front, outputs.rear)

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Turn the ATX supply or the ESC on or off."""
        self.simulator.advance_to(now)
        if switch is Switch.ATX:
            self.simulator.atx_on = on
        else:
            self.simulator.esc_on = on

    def load_gains(self, gains: PidSet, answered: Callable[[bool], None]) -> None:
        """The loops run in the controller task."""
        raise NotCapable(self.name, "gains")

    def offer_odometry(self, combined: CombinedOdometry, now: float) -> None:
        """The loops run in the controller task."""
        raise NotCapable(self.name, "combined")

    def indicate(self, indicators: Indicators) -> None:
        """Remember buzzer and LEDs for the screens."""
        self.indicators = indicators

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        """Put the robot down at a pose in the room, at rest."""
        self.simulator.advance_to(now)
        self.simulator.place(x, y, theta)
