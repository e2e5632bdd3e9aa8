"""How the batteries are judged, and what the joystick's buttons do."""

import pytest

from txt1.hal.base import Button
from txt1.tasks.battery import judge
from txt1.tasks.fields import BatteryState, Panel
from txt1.tasks.panel import press


@pytest.mark.parametrize(
    "one, two, state",
    [
        (0.0, 0.0, BatteryState.EXTERNAL),
        (9.51, 0.0, BatteryState.GOOD),
        (0.0, 9.51, BatteryState.GOOD),
        (8.0, 12.0, BatteryState.GOOD),
        (9.5, 0.0, BatteryState.WARNING),
        (9.01, 0.0, BatteryState.WARNING),
        (9.0, 0.0, BatteryState.BAD),
        (5.0, 8.9, BatteryState.BAD),
        (None, 9.51, BatteryState.GOOD),
        (8.9, None, BatteryState.BAD),
        (0.0, None, None),
        (None, None, None),
    ],
)
def test_the_better_pack_decides_the_state(one: float | None, two: float | None, state: BatteryState | None) -> None:
    assert judge(one, two) is state


def test_the_screens_are_counted_in_both_directions() -> None:
    panel = press(Panel(), Button.RIGHT, rows=14, has_pwm=True)
    assert panel.screen == 1
    for _ in range(3):
        panel = press(panel, Button.LEFT, rows=14, has_pwm=True)
    assert panel.screen == -2


def test_scrolling_stops_at_both_ends() -> None:
    panel = press(Panel(), Button.UP, rows=14, has_pwm=True)
    assert panel.scroll == 0
    for _ in range(30):
        panel = press(panel, Button.DOWN, rows=14, has_pwm=True)
    assert panel.scroll == 13
    assert press(Panel(), Button.DOWN, rows=0, has_pwm=True).scroll == 0


def test_the_centre_toggles_manual_mode_where_there_is_pwm() -> None:
    assert press(Panel(), Button.CENTRE, rows=0, has_pwm=True).manual
    assert not press(Panel(), Button.CENTRE, rows=0, has_pwm=False).manual
