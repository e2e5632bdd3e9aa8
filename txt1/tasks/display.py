"""The display task: buzzer and LEDs. Priority 2, 10 Hz, soft (thesis 3.3.3).

Drawing takes longer than a controller period, so the screens are drawn elsewhere, from snapshots of the bus.
"""

from __future__ import annotations

from typing import Final

from txt1.hal.base import Hal, Indicators
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import BatteryState, State

PRIORITY: Final = 2
PERIOD: Final = 0.1


async def display(ticks: Ticks, state: State, hal: Hal) -> None:
    """Set buzzer and LEDs, once per tick; an LED toggles with every message."""
    async for _ in ticks:
        sounds = buzzer(state.link.alive, state.battery.state)
        hal.indicate(Indicators(sounds, state.received % 2 == 1, state.transmitted % 2 == 1))


def buzzer(link_alive: bool, battery: BatteryState | None) -> bool:
    """Whether the buzzer sounds: the link is lost or a battery is low (thesis 3.6.2)."""
    return not link_alive or battery in (BatteryState.WARNING, BatteryState.BAD)
