"""The standstill task judges the faster wheel, and says that a robot stands only when it was seen to."""

from __future__ import annotations

from dataclasses import replace

import pytest

from txt1.config import Config
from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.control.standstill import Stop
from txt1.hal.base import Outputs
from txt1.hal.registry import create
from txt1.model.odometry import Odometry
from txt1.protocol.messages import Switch
from txt1.tasks.standstill import Watch, reason_not_to_switch
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


def test_a_stop_that_is_not_obeyed_disarms_and_keeps_the_esc_off_until_it_stands() -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    gate.arm(0.0)
    switched: list[tuple[Switch, bool]] = []
    hal = create(Config())
    hal.halt = lambda outputs, now: None  # type: ignore[method-assign]
    hal.capabilities = replace(hal.capabilities, power=True, power_known=False)
    watch = Watch(state, hal, gate, 0.25, lambda switch, on, now: switched.append((switch, on)))

    def esc_stays_off(now: float) -> str | None:
        # disarmed, with power for the encoders: nothing else speaks against it
        return reason_not_to_switch(Switch.ESC, True, state, hal.capabilities, gate, watch, False)

    outputs = Outputs(v=0.5)
    for k in range(1, 60):
        now, v = 0.05 * k, 0.5
        state.odometry, state.odometry_time = Odometry(v=v), now
        stop = watch.step(now, outputs)
        if k == 10:
            outputs = STOPPED
        if stop is Stop.PWM_ZEROS:
            assert not gate.armed
            assert gate.counts[Fault.STOP_UNOBEYED] == 1
            told = esc_stays_off(now)
            assert told is not None and "the robot did not stop when told to" in told
    assert stop is Stop.ESC_OFF
    assert switched == [(Switch.ESC, False)]
    assert esc_stays_off(now) is not None
    for k in range(60, 80):
        now = 0.05 * k
        state.odometry, state.odometry_time = Odometry(), now
        watch.step(now, STOPPED)
    assert watch.standstill.stop is Stop.STANDING
    assert esc_stays_off(now) is None


def test_a_car_whose_odometry_is_old_is_not_standing_any_more() -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    watch = Watch(state, create(Config()), gate, 0.25, lambda switch, on, now: None)
    for k in range(1, 30):
        state.odometry, state.odometry_time = Odometry(), 0.05 * k
        assert watch.step(0.05 * k, STOPPED) in (Stop.NONE, Stop.STANDING)
    assert watch.step(1.6, STOPPED) is Stop.STANDING
    assert watch.step(1.8, STOPPED) is Stop.UNSEEN
    assert not watch.standstill.stands(1.8)
