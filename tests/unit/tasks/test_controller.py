"""The controller task alone, tick by tick: a hardware layer that only notes what it is told."""

from __future__ import annotations

from math import inf, nan
from types import SimpleNamespace
from typing import Any

import pytest

from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.control.pid import Gains, VelocityLoops
from txt1.control.schedule import GainSet, Schedule
from txt1.hal.base import BoardLink, Capabilities, Outputs
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.tasks.controller import GAINS, PWM, SETPOINT, controller
from txt1.tasks.fields import (
    CombinedSample,
    Command,
    Control,
    Encoders,
    GainTable,
    LinkState,
    ManualPwm,
    Panel,
    Power,
    Source,
)
from txt1.tasks.state import State

TICK = 0.02


class Desk:
    """The task with a state that a test fills in."""

    def __init__(self, **capabilities: bool) -> None:
        self.written: list[Outputs] = []
        can = Capabilities(**({"pwm": True, "ticks": True, "odometry": True} | capabilities))
        hal: Any = SimpleNamespace(capabilities=can, write=lambda outputs, now: self.written.append(outputs))
        self.state = State()
        self.state.link = LinkState(alive=True)
        self.state.power = Power(True, True)
        self.state.panel = Panel(manual=False)
        self.state.gains = GainTable(
            Gains(10.0, 0.0, 0.0), Schedule((GainSet(9.0, Gains(1.0, 0.0, 0.0)),)), loaded=True
        )
        self.gate = Gate(Limits(), on_close=lambda reason: None)
        self.gate.arm(0.0)
        self.ticks = Ticks(TICK)
        self._task = controller(self.ticks, self.state, hal, self.gate, Geometry(), VelocityLoops(steers=True))
        self._task.send(None)
        self.now = 0.0

    def step(self, v: float | None = 0.5, omega: float = 0.0, odometry: Odometry | None = None) -> Outputs:
        """One tick with a fresh command and fresh odometry."""
        self.now += TICK
        state = self.state
        if v is not None:
            state.command = Command(v, omega, self.now, self.gate.epoch)
        if odometry is not None:
            state.odometry, state.odometry_time = odometry, self.now
        self._task.send(self.now)
        return self.written[-1]


AT_REST = Odometry()
ROLLING = Odometry(v=0.1)


def test_the_outputs_of_the_loops_go_through_the_gate() -> None:
    desk = Desk()
    assert desk.step(0.5, 0.2, ROLLING)[:3] == (4000, -200, 200)
    assert desk.state.control == Control(desk.written[-1], 0.5, 0.2, Source.ENCODER, Gains(1.0, 0.0, 0.0))
    assert desk.step(0.5, 0.2, Odometry(v=0.2)).motor == 3000
    assert desk.state.control.outputs == desk.written[-1], "what it tells is what it sent"


@pytest.mark.parametrize(
    "field, value",
    [
        ("link", LinkState(alive=False)),
        ("power", Power(True, False)),
        ("command", None),
    ],
)
def test_without_link_esc_or_command_it_is_neutral_and_the_loops_forget(field: str, value: object) -> None:
    desk = Desk()
    desk.state.gains = desk.state.gains._replace(linear=Gains(0.0, 10.0, 0.0))
    first = desk.step(0.5, 0.0, ROLLING).motor
    assert first == 80
    assert desk.step(0.5, 0.0, ROLLING).motor == 160
    right = getattr(desk.state, field)
    setattr(desk.state, field, value)
    assert desk.step(None if field == "command" else 0.5, 0.0, ROLLING)[:3] == (0, 0, 0)
    setattr(desk.state, field, right)
    assert desk.step(0.5, 0.0, ROLLING).motor == first


def test_a_set_point_of_zero_at_rest_hums_nothing_and_one_while_it_rolls_brakes() -> None:
    desk = Desk()
    assert desk.step(0.0, 0.0, AT_REST).motor == 0
    assert desk.step(0.0, 0.0, ROLLING).motor == -1000
    assert desk.step(0.5, 0.0, AT_REST).motor > 0


def test_at_rest_a_set_point_of_zero_clears_the_integral_and_a_turn_does_not() -> None:
    desk = Desk()
    desk.state.gains = desk.state.gains._replace(linear=Gains(0.0, 10.0, 0.0))
    assert desk.step(0.5, 0.0, ROLLING).motor == 80
    assert desk.step(0.0, 0.4, AT_REST)[:3] == (80, -400, 400)
    assert desk.step(0.0, 0.0, AT_REST)[:3] == (0, 0, 0)


def test_a_guard_of_the_gate_has_its_say_before_the_loops() -> None:
    desk = Desk()
    desk.gate.guards.append(lambda v, omega, now: (0.5 * v, 0.5 * omega))
    assert desk.step(0.5, 0.2, ROLLING)[:3] == (1500, -100, 100)
    assert (desk.state.control.v, desk.state.control.omega) == (0.25, 0.1)


def test_in_the_tick_in_which_the_mode_changes_it_is_neutral() -> None:
    desk = Desk()
    assert desk.step(0.5, 0.0, ROLLING).motor == 4000, "the first tick is no change"
    desk.state.panel = Panel(manual=True)
    desk.state.manual_pwm = ManualPwm(5000, 100, -100, desk.now + TICK, desk.gate.epoch)
    assert desk.step(0.5, 0.0, ROLLING)[:3] == (0, 0, 0)
    out = desk.step(0.5, 0.0, ROLLING)
    assert out[:3] == (5000, 100, -100)
    assert out[-2:] == (0.0, 0.0), "hardware with loops of its own gets no set-point beside"
    desk.state.panel = Panel(manual=False)
    assert desk.step(0.5, 0.0, ROLLING)[:3] == (0, 0, 0)
    assert desk.step(0.5, 0.0, ROLLING)[:3] == (4000, 0, 0)


@pytest.mark.parametrize("odometry", [Odometry(v=nan), Odometry(v=inf), Odometry(v=-inf), Odometry(omega=inf)])
def test_a_speed_that_is_not_finite_is_neutral_and_counted(odometry: Odometry) -> None:
    for can in ({}, {"ticks": False}, {"ticks": False, "pwm": False}):
        desk = Desk(**can)
        assert desk.step(0.5, 0.0, odometry) == Outputs()
        assert desk.gate.counts[Fault.MEASURED] == 1


def test_odometry_of_half_a_second_ago_is_lost_and_a_little_younger_is_not() -> None:
    desk = Desk()
    desk.step(0.5, 0.0, ROLLING)
    for _ in range(24):
        desk.step()
    assert desk.gate.armed
    desk.step()
    desk.step()
    assert desk.gate.reason == "odometry lost"
    assert desk.written[-1].motor == 0


def test_combined_odometry_counts_while_selected_and_at_most_0_1_s_old() -> None:
    desk = Desk()
    desk.state.combined = CombinedSample(0.3, 0.0, TICK)
    assert desk.step(0.5, 0.0, ROLLING).motor == 4000, "not selected"
    desk.state.link = LinkState(alive=True, combined=True)
    for _ in range(5):
        assert desk.step(0.5, 0.0, ROLLING).motor == 2000
    assert desk.state.control.source is Source.COMBINED
    assert desk.step(0.5, 0.0, ROLLING).motor == 4000
    assert desk.state.control.source is Source.ENCODER


def test_combined_odometry_against_the_encoders_disarms_only_while_it_counts() -> None:
    for selected in (False, True):
        desk = Desk()
        desk.state.encoders = Encoders(40, 40)
        desk.state.link = LinkState(alive=True, combined=selected)
        for _ in range(20):
            desk.state.combined = CombinedSample(0.0, 0.0, desk.now)
            desk.step(0.5, 0.0, Odometry(v=0.7))
        assert desk.gate.armed is not selected
        assert desk.gate.armed or "combined odometry says 0.0 m/s" in desk.gate.reason


def link(losses: int, reason: str = "") -> BoardLink:
    return BoardLink(ready=True, losses=losses, reason=reason, text="", faults={})


def test_every_loss_of_the_board_disarms_once_and_the_first_sight_of_it_does_not() -> None:
    desk = Desk()
    desk.state.board = link(3)
    desk.step(0.5, 0.0, ROLLING)
    desk.state.board = link(3, "told anew")
    desk.step(0.5, 0.0, ROLLING)
    assert desk.gate.armed
    desk.state.board = link(4, "the board restarted")
    desk.step(0.5, 0.0, ROLLING)
    assert (desk.gate.armed, desk.gate.reason, desk.gate.closed_by) == (False, "the board restarted", Fault.LINK)
    desk.gate.arm(desk.now)
    desk.step(0.5, 0.0, ROLLING)
    assert desk.gate.armed


def test_missed_ticks_disarm() -> None:
    desk = Desk()
    desk.ticks.missed = 5
    desk.step(0.5, 0.0, ROLLING)
    assert desk.gate.counts[Fault.MISSED] == 1


def test_without_encoders_loops_step_with_odometry_over_at_most_0_1_s() -> None:
    desk = Desk(ticks=False)
    desk.state.gains = desk.state.gains._replace(linear=Gains(0.0, 10.0, 0.0))
    desk.step(0.5, 0.0, ROLLING)
    assert desk.written[-1].motor == 80, "10 x 0.02 s x 400 mm/s"
    desk.step()
    assert desk.written[-1].motor == 80, "no new reading, no step"
    desk.step(0.5, 0.0, ROLLING)
    assert desk.written[-1].motor == pytest.approx(240, abs=1), "over two periods"
    for _ in range(8):
        desk.step()
    desk.step(0.5, 0.0, ROLLING)
    assert desk.written[-1].motor == pytest.approx(640, abs=2), "over 0.1 s of the 0.18"


def test_where_there_are_no_encoders_the_odometry_s_speeds_are_watched_as_ticks() -> None:
    desk = Desk(ticks=False)
    for _ in range(20):
        desk.step(0.5, 0.0, AT_REST)
    assert desk.gate.counts[Fault.RUNAWAY] == 1


def test_wheels_against_each_other_are_noticed_by_odometry_of_every_other_tick() -> None:
    desk = Desk(ticks=False)
    for _ in range(10):
        desk.step(0.5, 0.0, Odometry(omega=5.0))
        desk.step()
    assert "against each other" in desk.gate.reason


def test_a_layer_with_its_own_loops_gets_set_points_and_no_watch_by_ticks() -> None:
    desk = Desk(ticks=False, pwm=False)
    for _ in range(30):
        out = desk.step(0.5, 0.2, AT_REST)
    assert desk.gate.armed
    assert out == (0, 0, 0, 0, 0, 0.5, 0.2)
    assert desk.state.control.gains == Gains()


@pytest.mark.parametrize("v, omega", [(0.05, 0.4), (-0.05, 0.4), (0.05, -0.4)])
def test_a_board_s_wheels_are_watched_from_0_1_m_s_of_the_faster_one(v: float, omega: float) -> None:
    for share, armed in ((0.999, True), (1.0, False)):
        desk = Desk(ticks=False, pwm=False)
        for _ in range(60):
            desk.step(0.5, 0.2, Odometry(v=share * v, omega=share * omega))
        assert desk.gate.armed is armed
        assert armed or "encoder is silent" in desk.gate.reason


def test_where_there_are_encoders_their_counts_are_watched_and_not_the_odometry() -> None:
    desk = Desk()
    for _ in range(10):
        desk.state.encoders = Encoders(30, -30)
        desk.step(0.5, 0.0, ROLLING)
    assert "against each other" in desk.gate.reason


def test_one_encoder_alone_is_not_watched() -> None:
    desk = Desk()
    desk.state.encoders = Encoders(3, None)
    desk.step(0.5, 0.0, ROLLING)
    assert desk.gate.armed


def test_a_set_point_that_changes_without_an_output_is_told() -> None:
    desk = Desk(ticks=False, pwm=False)
    for v, omega in ((0.5, 0.0), (0.5, 0.1), (0.4, 0.1)):
        desk.step(v, omega, ROLLING)
        assert (desk.state.control.v, desk.state.control.omega) == (v, omega)


def test_where_nothing_is_measured_the_velocities_are_said_to_be_reckoned() -> None:
    desk = Desk(ticks=False, odometry=False)
    desk.step(0.5, 0.0, AT_REST)
    assert desk.state.control.source is Source.RECKONED
    assert desk.state.control.v == 0.5


def test_what_the_controller_tells_is_not_said_again_in_snapshots() -> None:
    control = Control(Outputs(1, 2, 3, 4, 5, 0.5, 0.25), 0.5, 0.25, Source.ENCODER, Gains())
    assert (SETPOINT.make(control), PWM.make(control)) == ((0.5, 0.25), (1, 2, 3, 4, 5))
    assert GAINS.make((Gains(1.0, 2.0, 3.0), Gains(4.0, 5.0, 6.0))) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert len(GAINS.paths) == 6
    assert [topic.in_snapshots for topic in (SETPOINT, PWM, GAINS)] == [True, False, False]


def test_at_rest_nothing_changes_but_where_the_velocities_come_from() -> None:
    desk = Desk()
    desk.step(None, 0.0, AT_REST)
    first = desk.state.control
    assert first == Control(Outputs(), 0.0, 0.0, Source.ENCODER, Gains())
    desk.step(None, 0.0, AT_REST)
    assert desk.state.control == first
    desk.state.link = LinkState(alive=True, combined=True)
    desk.state.combined = CombinedSample(0.0, 0.0, desk.now)
    desk.step(None, 0.0, AT_REST)
    assert desk.state.control == first._replace(source=Source.COMBINED)


def told(desk: Desk) -> list[str]:
    """The first words of what it has told."""
    return [event.text.partition(",")[0] for event in desk.state.events]


def without_gains() -> Desk:
    desk = Desk(gains=True)
    desk.state.gains = GainTable()
    return desk


def test_commands_that_move_nothing_are_explained_once_an_attempt() -> None:
    desk = without_gains()
    for _ in range(25):
        desk.step(0.5, 0.0, AT_REST)
    assert told(desk) == []
    desk.step(0.5, 0.0, AT_REST)
    assert told(desk) == ["no gains are loaded"]
    for _ in range(100):
        desk.step(0.5, 0.0, AT_REST)
    assert told(desk) == ["no gains are loaded"], "once is enough"
    desk.step(0.0, 0.0, AT_REST)
    for _ in range(27):
        desk.step(0.5, 0.0, AT_REST)
    assert told(desk) == ["no gains are loaded"] and desk.state.events[-1].text.endswith(" (2 times)"), (
        "the next attempt is told, too"
    )


@pytest.mark.parametrize("v", [0.0, None])
def test_nobody_who_commands_nothing_is_told_why_it_does_not_move(v: float | None) -> None:
    desk = without_gains()
    desk.step(0.5, 0.0, AT_REST)
    for _ in range(100):
        desk.step(v, 0.0, AT_REST)
    assert told(desk) == []


@pytest.mark.parametrize("esc", [True, False, None])
def test_an_esc_that_is_off_is_told_and_one_that_is_on_or_unknown_is_not(esc: bool | None) -> None:
    desk = Desk()
    desk.state.power = Power(True, esc)
    for _ in range(50):
        desk.step(0.5, 0.0, AT_REST)
    assert told(desk) == (["the ESC is off"] if esc is False else [])
