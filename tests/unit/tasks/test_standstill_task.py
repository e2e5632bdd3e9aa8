"""The standstill task judges the faster wheel, and says that a robot stands only when it was seen to."""

from __future__ import annotations

import pytest

from txt1.config import Config
from txt1.control.limits import Gate
from txt1.control.parameters import Limits
from txt1.control.standstill import Stop
from txt1.hal.base import Outputs
from txt1.hal.registry import create
from txt1.model.odometry import Odometry
from txt1.tasks.standstill import Watch
from txt1.tasks.state import State

STOPPED = Outputs()


@pytest.mark.parametrize(
    ("v", "omega", "seen"),
    [(0.0, 0.0, Stop.STANDING), (0.0, 1.0, Stop.UNASKED), (0.0, -1.0, Stop.UNASKED), (0.2, 0.0, Stop.UNASKED)],
)
def test_a_car_of_which_one_wheel_turns_does_not_stand(v: float, omega: float, seen: Stop) -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    watch = Watch(state, create(Config()), gate, 0.25, lambda switch, on, now: None)
    watch.hal.halt = lambda outputs, now: None  # type: ignore[method-assign]
    for k in range(1, 30):
        now = 0.05 * k
        state.odometry, state.odometry_time = Odometry(v=v, omega=omega), now
        stop = watch.step(now, STOPPED)
    assert stop is seen
    assert watch.standstill.stands(now) == (seen is Stop.STANDING)


def test_a_car_whose_odometry_is_old_is_not_standing_any_more() -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    watch = Watch(state, create(Config()), gate, 0.25, lambda switch, on, now: None)
    for k in range(1, 30):
        state.odometry, state.odometry_time = Odometry(), 0.05 * k
        assert watch.step(0.05 * k, STOPPED) in (Stop.NONE, Stop.STANDING)
    assert watch.step(1.6, STOPPED) is Stop.STANDING
    assert watch.step(1.8, STOPPED) is Stop.UNSEEN
    assert not watch.standstill.stands(1.8)
