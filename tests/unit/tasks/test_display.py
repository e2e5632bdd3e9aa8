"""The display task: buzzer and LEDs."""

from __future__ import annotations

from itertools import groupby

import pytest

from txt1.tasks.fields import BatteryState
from txt1.tasks.panel import buzzer


@pytest.mark.parametrize("state", [None, *BatteryState])
def test_the_buzzer_sounds_when_the_link_is_lost_or_a_battery_is_low(state: BatteryState | None) -> None:
    assert all(buzzer(False, state, 0.1 * k) for k in range(80)), "without a pause"
    assert any(buzzer(True, state, 0.1 * k) for k in range(80)) == (state in (BatteryState.WARNING, BatteryState.BAD))


@pytest.mark.parametrize(("state", "period"), [(BatteryState.WARNING, 2.0), (BatteryState.BAD, 1.0)])
def test_a_low_and_an_empty_battery_have_patterns_of_their_own(state: BatteryState, period: float) -> None:
    heard = [buzzer(True, state, 0.1 * k + 0.05) for k in range(80)]
    lengths = [len(list(group)) * 0.1 for _, group in groupby(heard)]
    assert lengths == pytest.approx([period] * round(8.0 / period)), "as long on as off"
