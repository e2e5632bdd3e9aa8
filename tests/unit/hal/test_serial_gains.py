"""The gains of the loops that a board closes: sent by the serial HAL until the board has them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from serial_desk import DRIVE, GAINS, HALF, OTHERS, STANDING, ZERO, Desk

from txt1.protocol.messages import (
    PidResponse,
    PidSet,
    Velocity,
)


def test_gains_go_out_at_once_and_then_once_a_second_until_the_board_has_them(desk: Desk) -> None:
    answers = desk.loads()
    desk.runs(3.5)
    assert desk.heard(PidSet) == [(time, GAINS) for time in (2.0, 3.0, 4.0, 5.0)]
    assert desk.link.gains, "of a board that was not found again, it is not said"
    desk.tells(PidResponse(True))
    assert answers == [True]
    desk.runs(3.0)
    desk.tells(PidResponse(True))
    assert (answers, len(desk.heard(PidSet))) == ([True], 4), "a late answer says nothing"


def test_an_answer_without_a_pid_set_is_ignored(desk: Desk) -> None:
    answers = desk.loads()
    desk.tells(PidResponse(True))
    assert (answers, desk.runs(0.1).times(PidSet)) == ([], [2.0])


def test_an_answer_before_anything_was_ever_asked_says_nothing(desk: Desk) -> None:
    desk.tells(PidResponse(True))
    assert desk.runs(11.0).times(PidSet) == []


def test_a_board_found_for_the_first_time_gets_its_gains_before_any_set_point(
    make: Callable[..., Desk],
) -> None:
    desk = make()
    desk.loads()
    desk.runs(2.1, DRIVE)
    assert not desk.link.gains
    assert {message for _, message in desk.heard(Velocity)} == {ZERO}
    desk.tells(PidResponse(True))
    assert desk.runs(0.1, DRIVE).sent[-1][1] == HALF


def test_gains_that_are_rejected_three_times_are_sent_no_more(desk: Desk) -> None:
    answers = desk.loads()
    for rejections in (1, 2, 3):
        desk.runs(1.0)
        desk.tells(PidResponse(False))
        assert answers == ([False] if rejections == 3 else [])
    desk.runs(11.0)
    assert len(desk.heard(PidSet)) == 3
    assert desk.loads() == []
    desk.runs(0.1)
    assert len(desk.heard(PidSet)) == 4, "unless somebody asks again"


def test_rejections_of_other_gains_do_not_count(desk: Desk) -> None:
    desk.loads()
    for _ in range(2):
        desk.runs(1.0)
        desk.tells(PidResponse(False))
    answers = desk.loads(OTHERS)
    for _ in range(2):
        desk.runs(1.0)
        desk.tells(PidResponse(False))
    assert answers == []
    desk.runs(1.0)
    desk.tells(PidResponse(False))
    assert answers == [False]
    answers = desk.loads()
    desk.runs(1.0)
    desk.tells(PidResponse(False))
    assert answers == [], "they begin at none each time"


def test_gains_that_are_under_way_are_not_sent_sooner_when_they_are_asked_for_again(desk: Desk) -> None:
    desk.loads()
    desk.runs(0.1)
    answers = desk.loads()
    assert desk.runs(1.5).times(PidSet) == [2.0, 3.0]
    desk.tells(PidResponse(True))
    assert answers == [True]


def test_new_gains_wait_until_the_gains_under_way_are_answered(desk: Desk) -> None:
    first = desk.loads()
    desk.runs(0.1)
    second = desk.loads(OTHERS)
    desk.tells(PidResponse(True))
    desk.runs(1.0)
    assert desk.heard(PidSet) == [(2.0, GAINS), (3.0, OTHERS)]
    desk.tells(PidResponse(True))
    assert (first, second) == ([], [True])
    desk.runs(0.1)
    third = desk.loads()
    assert desk.runs(0.1).heard(PidSet)[-1] == (3.2, GAINS), "at once where nothing is under way"
    desk.loads(OTHERS)
    desk.loads()
    desk.runs(0.8)
    assert len(desk.heard(PidSet)) == 3, "however often they change"
    desk.tells(PidResponse(True))
    assert third == []


def test_acknowledged_gains_are_sent_again_after_10_s_while_the_robot_is_not_to_move(desk: Desk) -> None:
    desk.loads()
    desk.runs(0.02)
    desk.tells(PidResponse(True))
    desk.runs(9.98)
    assert desk.times(PidSet) == [2.0]
    desk.runs(1.0, DRIVE)
    assert desk.times(PidSet) == [2.0]
    desk.runs(0.02)
    desk.tells(PidResponse(False))
    desk.tells(PidResponse(False))
    desk.runs(9.96)
    assert desk.times(PidSet) == [2.0, 13.0]
    desk.runs(0.1)
    assert desk.times(PidSet) == [2.0, 13.0, 23.0]
    desk.tells(PidResponse(False))
    assert desk.runs(11.0).times(PidSet) == [2.0, 13.0, 23.0], "a board that now rejects them is left alone"


@pytest.mark.parametrize("answered", [False, True])
def test_a_board_found_again_gets_its_gains_first_and_stands_until_it_has_them(desk: Desk, answered: bool) -> None:
    answers = desk.loads()
    desk.runs(0.1)
    desk.tells(PidResponse(False))
    desk.tells(PidResponse(False))
    if answered:
        desk.tells(PidResponse(True))
    desk.says = None
    desk.runs(12.02)
    desk.says = STANDING
    assert not desk.link.gains
    found = desk.now
    desk.runs(2.5, DRIVE)
    times = desk.times(PidSet, since=found)
    assert len(times) == 3 and 0.0 <= times[0] - found <= 0.06
    assert [later - earlier for earlier, later in pairwise(times)] == pytest.approx([1.0, 1.0])
    assert desk.link.ready and not desk.link.gains
    assert {message for _, message in desk.heard(Velocity, since=found)} == {ZERO}
    desk.tells(PidResponse(False))
    desk.tells(PidResponse(False))
    assert not desk.link.gains
    desk.tells(PidResponse(True))
    assert desk.link.gains
    assert answers == [True] * (1 + answered)
    assert desk.runs(0.1, DRIVE).sent[-1][1] == HALF


def test_without_gains_to_send_a_board_that_was_found_again_lacks_none(desk: Desk) -> None:
    desk.says = None
    desk.runs(1.0)
    desk.says = STANDING
    assert desk.runs(1.5, DRIVE).link.gains
    assert desk.sent[-1][1] == HALF
