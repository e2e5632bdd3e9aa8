"""The simulated robot as a HAL: one vehicle of a world."""

import asyncio
from dataclasses import replace
from typing import Final

from txt1.hal.base import Button, Capabilities, Indicators, Inputs, Outputs
from txt1.hal.plain import PlainHal
from txt1.kernel.loop import clock_of
from txt1.model.channels import STRAIGHT, Channels
from txt1.protocol.messages import Switch
from txt1.sim.ground import Ground
from txt1.sim.parameters import Box
from txt1.sim.vehicle import Vehicle
from txt1.units import new

# an attribute of an Enum is not found quickly
NO_BUTTON: Final = Button.NONE
NEUTRAL: Final = Outputs()
# room of less than this is none, m
TOUCH: Final = 0.02
# nobody turns the simulated potentiometer
BACKLIGHT: Final = 0.5


class SimHal(PlainHal):
    """A simulated TXT-1; `alone`: no other robot is ever in its world, so all that it does repeats.

    It has no task of its own: whoever reads or writes at a later time moves the vehicle there first, so it costs what
    is used and repeats exactly; `txt1.sim.world` says how several move on together.
    """

    name = "sim"
    capabilities = Capabilities(
        ticks=True,
        pwm=True,
        battery=True,
        power=True,
        power_known=True,
        servos=True,
        place=True,
        pose=True,
        simulated=True,
    )

    def __init__(
        self, vehicle: Vehicle, ground: Ground | None = None, wiring: Channels = STRAIGHT, alone: bool = False
    ) -> None:
        if not vehicle.body.counts_per_rev:
            self.capabilities = replace(self.capabilities, ticks=False)
        if alone:
            self.capabilities = replace(self.capabilities, repeats=True)
        self.vehicle = vehicle
        self._ground = ground
        self._wiring = None if wiring == STRAIGHT else wiring
        self._as_counted = vehicle.body.counts_per_rev > 0 and self._wiring is None
        self.world = vehicle.world
        self.outputs = NEUTRAL
        self.indicators = Indicators()
        self._sensed: object = None
        self._inputs = Inputs()

    async def open(self) -> None:
        """Start with neutral outputs."""
        self.outputs = NEUTRAL
        self._command(NEUTRAL)
        self.world.expect(self.vehicle, clock_of(asyncio.get_running_loop()))

    async def close(self) -> None:
        """Leave the outputs neutral."""
        self.write(NEUTRAL, self.vehicle.time)

    def others(self) -> tuple[tuple[float, float, float], ...]:
        """The poses of the other vehicles in the world, m and rad."""
        return tuple(each.pose for each in self.world.vehicles if each is not self.vehicle)

    def movers(self) -> list[Box]:
        """The boxes that move along paths, where they are now."""
        return self.world.moving(self.vehicle, self.vehicle.time)

    def attitude(self) -> tuple[float, float]:
        """Roll and pitch where it stands, rad, by the ground."""
        return (0.0, 0.0) if self._ground is None else self._ground.attitude(self.vehicle.pose)

    def read(self, now: float) -> Inputs:
        """Encoder counts, voltages and the true pose at `now`."""
        sensed = self.vehicle.sense(now)
        if sensed != self._sensed:
            self._sensed = sensed
            counted, batteries, cut_off, pose = sensed
            counts = counted if self._as_counted else self._sent(counted)
            content = (counts, None, 0.0, batteries, cut_off, NO_BUTTON, BACKLIGHT, pose, None, None)
            self._inputs = new(Inputs, content)
        return self._inputs

    def _sent(self, counts: tuple[int, int]) -> tuple[int, int] | None:
        """Encoder counts as they arrive through the wiring; None where there are no encoders."""
        if not self.vehicle.body.counts_per_rev:
            return None
        return counts if self._wiring is None else self._wiring.sent(*counts)

    def write(self, outputs: Outputs, now: float) -> None:
        """Hold these outputs from `now` on."""
        self.vehicle.advance_to(now)
        self.outputs = outputs
        self._command(outputs)

    def _command(self, outputs: Outputs) -> None:
        motor, front, rear, *_ = outputs
        if self._wiring is None:
            self.vehicle.command(motor, front, rear)
            return
        forward, right, left = self._wiring.meant(motor, front, rear, self.vehicle.skids)
        # the dynamics see a car that steers in front alone as one that steers both axles
        self.vehicle.command(forward, right, -right if self.vehicle.body.steering == "front" else left)

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Turn the ATX supply or the ESC on or off."""
        self.vehicle.advance_to(now)
        if switch is Switch.ATX:
            self.vehicle.atx_on = on
        else:
            self.vehicle.esc_on = on

    def indicate(self, indicators: Indicators) -> None:
        """Remember buzzer and LEDs for the screens."""
        self.indicators = indicators

    def blocked_by(self) -> str | None:
        """The wall, obstacle or vehicle that the robot has run into, in words; None when it has room."""
        return self.world.in_the_way(self.vehicle, *self.vehicle.pose, TOUCH)

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        """Put the robot down at a pose in the room, at rest."""
        self.vehicle.advance_to(now)
        self.vehicle.place(x, y, theta)
