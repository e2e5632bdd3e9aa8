"""The mode task says why the link is lost."""

import pytest

from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.hal.base import BoardLink
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import LinkState, Panel, Power
from txt1.tasks.mode import MODE, Mode, mode
from txt1.tasks.state import State

RESTARTED = "the board restarted: its odometry jumped"


@pytest.mark.parametrize(
    ("ready", "reason", "told"),
    [(False, RESTARTED, RESTARTED), (False, "", "link lost"), (True, "", "link lost"), (True, RESTARTED, "link lost")],
)
def test_a_board_that_is_lost_in_the_instant_of_the_mode_task_is_named_as_the_cause(
    ready: bool, reason: str, told: str
) -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    task = mode(Ticks(1.0), state, gate)
    task.send(None)
    state.board, state.velocity_count = BoardLink(True, 0, "", "", {}), 20
    task.send(1.0)
    gate.arm(1.0)
    state.board = BoardLink(ready, 1, reason, "", {})
    task.send(2.0)
    task.close()
    assert (gate.armed, gate.reason, gate.closed_by) == (False, told, Fault.LINK)
    assert [(event.time, event.text) for event in state.events] == [(2.0, "link lost")]


@pytest.mark.parametrize("velocities, combined", [(1, 2), (2, 3)])
def test_the_link_lives_by_1_velocity_and_combined_odometry_by_2_a_second(velocities: int, combined: int) -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    task = mode(Ticks(1.0), state, gate)
    task.send(None)
    for second in (1.0, 2.0):
        state.velocity_count += velocities
        state.combined_count += combined
        task.send(second)
        assert state.link == (velocities == 2, combined == 3)
    task.close()


@pytest.mark.parametrize("velocities", [0, 20])
def test_a_link_that_was_never_there_or_still_is_disarms_nothing(velocities: int) -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    gate.arm(0.0)
    task = mode(Ticks(1.0), state, gate)
    task.send(None)
    for second in (1.0, 2.0, 3.0):
        state.velocity_count += velocities
        task.send(second)
    task.close()
    assert gate.armed
    assert not state.events


def test_the_modes_message_says_what_is_known() -> None:
    assert Mode() == (False, False, "", LinkState(), Power(), Panel())
    assert MODE.make is not None
    told = MODE.make(Mode(True, False, "x", LinkState(True, True), Power(True, False, True), Panel(3, 0, True)))
    assert told == {
        "armed": True,
        "stopped": False,
        "mode": "manual",
        "link_alive": True,
        "combined": True,
        "atx": "on",
        "esc": "off",
        "screen": 3,
        "reason": "x",
    }
    assert MODE.make(Mode(panel=Panel(manual=False)))["mode"] == "controller"
    told = MODE.make(Mode(power=Power(None, True, False), panel=Panel(manual=None)))
    assert (told["atx"], told["esc"], told["mode"]) == ("", "on (asked)", "")
