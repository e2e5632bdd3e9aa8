"""The odometry task: sends the encoder odometry to the host while there is one. Priority 2, 20 Hz (the original's)."""

from __future__ import annotations

from collections.abc import Callable

from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import BoardMessage, EncoderOdometry
from txt1.tasks.state import State

PRIORITY = 2
PERIOD = 0.05


async def odometry(ticks: Ticks, state: State, send: Callable[[BoardMessage], None]) -> None:
    """Send pose and velocities, once per tick, while the host is heard."""
    async for _ in ticks:
        if not state.link.alive:
            continue
        send(EncoderOdometry(*state.odometry))
        state.transmitted += 1  # for the transmit LED; the few other messages do not show beside these
