"""The display task: buzzer and LEDs."""

from __future__ import annotations

import pytest

from txt1.tasks.fields import BatteryState
from txt1.tasks.panel import buzzer


@pytest.mark.parametrize("state", [None, *BatteryState])
def test_the_buzzer_sounds_when_the_link_is_lost_or_a_battery_is_low(state: BatteryState | None) -> None:
    assert buzzer(False, state)
    assert buzzer(True, state) == (state in (BatteryState.WARNING, BatteryState.BAD))
