"""The encoder task: ticks, wheel speeds, velocities, pose. Priority 3, 50 Hz (thesis 2.3, 3.3.3, 3.7.1)."""

from __future__ import annotations

from typing import Final

from txt1.errors import HalError
from txt1.hal.base import Hal
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import WheelOdometry
from txt1.model.vehicle import Geometry
from txt1.tasks.fields import Encoders
from txt1.tasks.state import State

PRIORITY: Final = 3
PERIOD: Final = 0.02

STILL: Final = Encoders(0, 0)


async def encoder(ticks: Ticks, state: State, hal: Hal, geometry: Geometry) -> None:
    """Keep the odometry up to date, from encoder ticks or from a HAL that computes odometry itself."""
    wheels = WheelOdometry(geometry)
    async for now in ticks:
        inputs = hal.read(now)
        state.pose = inputs.pose
        if inputs.link is not state.board:
            if inputs.link is not None and (state.board is None or inputs.link.text != state.board.text):
                state.tell(now, inputs.link.text)
            state.board = inputs.link
        if inputs.ticks is None:
            if hal.capabilities.ticks:
                raise HalError(f"the HAL '{hal.name}' reports no encoder ticks any more")
            if inputs.odometry is not None:
                state.odometry, state.odometry_time = inputs.odometry, inputs.odometry_time
            continue
        counts = wheels.step(inputs.ticks, now)
        if counts is not None:
            state.encoders = Encoders(*counts) if any(counts) else STILL
            state.odometry, state.odometry_time = wheels.odometry, now
