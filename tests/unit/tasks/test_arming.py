"""Why a robot may not be armed, with the remedy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from txt1.control.standstill import Stop
from txt1.hal.base import BoardLink, Capabilities, Inputs
from txt1.tasks.arming import reason_after_runaway, reason_not_to_arm
from txt1.tasks.fields import LinkState, Power
from txt1.tasks.state import State

READY = BoardLink(True, 0, "", "the board answers", {}, True, True)


def reason(
    state: State, can: Capabilities, now: float = 5.0, link: BoardLink | None = None, stop: Stop | None = None
) -> str | None:
    hal: Any = SimpleNamespace(capabilities=can, read=lambda now: Inputs(link=link))
    watch: Any = None if stop is None else SimpleNamespace(standstill=SimpleNamespace(stop=stop))
    return reason_not_to_arm(state, hal, hal, watch, False, now)


def ready(power: Power | None = None) -> State:
    state = State()
    state.link, state.power = LinkState(alive=True), power or Power(True, True)
    return state


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("esc", [True, False, None])
def test_an_esc_that_was_switched_off_keeps_a_robot_behind_a_line_disarmed(esc: bool | None, known: bool) -> None:
    # whose switches the host knows, it tells nothing that it cannot see: the controller is neutral without its ESC
    told = reason(ready(Power(True, esc)), Capabilities(power=True, power_known=known))
    off = "switch the ESC on first (e, or Robot.switch_power): it is off"
    assert told == (off if esc is False and not known else None)


@pytest.mark.parametrize("stop", list(Stop))
def test_while_a_stop_is_not_obeyed_nobody_arms(stop: Stop) -> None:
    told = reason(ready(), Capabilities(power=True), stop=stop)
    fails = stop in (Stop.PWM_ZEROS, Stop.ESC_OFF)
    assert told == ("wait until it stands: it has not stopped yet" if fails else None)


@pytest.mark.parametrize("atx", [True, False, None])
def test_without_the_atx_supply_nothing_sees_it_move(atx: bool | None) -> None:
    told = reason(ready(Power(atx, True)), Capabilities(power=True))
    assert (told is not None and "switch the ATX supply on first" in told) is (atx is False)


@pytest.mark.parametrize(("now", "words"), [(0.5, "try again"), (1.0, "try again"), (1.1, "look at the program")])
def test_before_the_first_second_is_over_nobody_is_told_that_the_host_is_silent(now: float, words: str) -> None:
    state = ready()
    state.link = LinkState(alive=False)
    told = reason(state, Capabilities(), now)
    assert told is not None and words in told


def test_a_board_that_is_not_ready_says_why() -> None:
    state = ready()
    state.board = READY
    assert reason(state, Capabilities(), link=READY) is None
    silent = READY._replace(ready=False, text="no odometry")
    assert reason(state, Capabilities(), link=silent) == "no link to the board yet: no odometry"


def test_after_a_runaway_it_waits_until_it_has_rolled_out_and_was_seen_to_stand() -> None:
    assert reason_after_runaway(3.0, False, True, 2.0) == "try again in 1.0 s: it did not obey, and may still roll"
    assert reason_after_runaway(3.0, False, False, 3.0) == "wait until it stands: it did not obey, and still moves"
    assert reason_after_runaway(3.0, False, True, 3.0) is None
    assert reason_after_runaway(3.0, True, False, 3.0) is None, "without encoders nobody can see it stand"
