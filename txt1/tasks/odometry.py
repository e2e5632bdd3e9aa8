"""The odometry task: sends the encoder odometry to the host while there is one. Priority 2, 20 Hz (the original's)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import BoardMessage, EncoderOdometry
from txt1.tasks.fields import State

PRIORITY: Final = 2
PERIOD: Final = 0.05


async def odometry(ticks: Ticks, state: State, send: Callable[[BoardMessage], None]) -> None:
    """Send pose and velocities, once per tick, while the host is heard."""
    async for _ in ticks:
        if not state.link.alive:
            continue
        x, y, theta, v, omega = state.odometry
        send(EncoderOdometry(x, y, theta, v, omega))
        state.transmitted += 1  # for the transmit LED; the few other messages do not show beside these
