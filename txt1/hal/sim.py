"""The simulated robot as a HAL: one vehicle of a world."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from txt1.hal.base import Button, Capabilities, Indicators, Inputs, Outputs
from txt1.hal.plain_hal import PlainHal
from txt1.kernel.loop import clock_of
from txt1.model.channels import STRAIGHT, Channels
from txt1.protocol.messages import Switch
from txt1.sim.vehicle import Vehicle
from txt1.units import new

if TYPE_CHECKING:
    from txt1.sim.ground import Ground
    from txt1.sim.parameters import Box

# Python finds an attribute of an Enum slowly
NO_BUTTON: Final = Button.NONE
NEUTRAL: Final = Outputs()
# m; less room than this counts as none
NO_ROOM: Final = 0.02
# the simulated potentiometer stays where it is
BACKLIGHT: Final = 0.5


class SimHal(PlainHal):
    """A simulated TXT-1; `alone`: no other robot is ever in its world, so its whole run repeats.

    It has no task of its own. A read or write at a later time first moves the vehicle on to this time. So it costs only
    the calls that are made, and repeats exactly. `txt1.sim.world` describes how several vehicles move on together.
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
    waits = True

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

    async def open(self) -> None:
        """Start with neutral outputs."""
        # not the write of a class made from this one, which may need an open device
        SimHal.write(self, NEUTRAL, self.vehicle.time)
        self.world.expect(self.vehicle, clock_of(asyncio.get_running_loop()))

    async def close(self) -> None:
        """Leave the outputs neutral."""
        self.write(NEUTRAL, self.vehicle.time)

    def others(self) -> tuple[tuple[float, float, float], ...]:
        """The poses of the other vehicles in the world, m and rad."""
        return tuple(each.pose for each in self.world.vehicles if each is not self.vehicle)

    def movers(self) -> list[Box]:
        """The moving boxes, at their present places."""
        return self.world.moving(self.vehicle, self.vehicle.time)

    def attitude(self) -> tuple[float, float]:
        """Roll and pitch of the ground below the robot, rad."""
        return (0.0, 0.0) if self._ground is None else self._ground.attitude(self.vehicle.pose)

    def read(self, now: float) -> Inputs:
        """Return encoder counts, voltages and the true pose at `now`."""
        counted, batteries, cut_off, pose = self.vehicle.sense(now)
        counts = counted if self._as_counted else self._sent(counted)
        return new(Inputs, (counts, None, 0.0, batteries, cut_off, NO_BUTTON, BACKLIGHT, pose, None, None, False))

    def _sent(self, counts: tuple[int, int]) -> tuple[int, int] | None:
        """Return encoder counts as the wiring delivers them; None without encoders."""
        if not self.vehicle.body.counts_per_rev:
            return None
        return counts if self._wiring is None else self._wiring.sent(*counts)

    def write(self, outputs: Outputs, now: float) -> None:
        """Hold these outputs from `now` on."""
        self.vehicle.advance_to(now)
        self.outputs = outputs
        motor, front, rear = outputs[:3]
        if self._wiring is None:
            self.vehicle.command(motor, front, rear)
            return
        forward, right, left = self._wiring.meant(motor, front, rear, self.vehicle.skids)
        # the dynamics treat a car that steers in front as a car that steers both axles
        self.vehicle.command(forward, right, -right if self.vehicle.body.steering == "front" else left)

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Turn the ATX supply or the ESC on or off."""
        self.vehicle.advance_to(now)
        if switch is Switch.ATX:
            self.vehicle.atx_on = on
        else:
            self.vehicle.esc_on = on

    def indicate(self, indicators: Indicators) -> None:
        """Store buzzer and LEDs for the screens."""
        self.indicators = indicators

    def blocked_by(self) -> str | None:
        """The wall, obstacle or vehicle that the robot has run into, in words; None if it has room."""
        return self.world.in_the_way(self.vehicle, *self.vehicle.pose, NO_ROOM)

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        """Put the robot down at a pose in the room, at rest."""
        self.vehicle.advance_to(now)
        self.vehicle.place(x, y, theta)
