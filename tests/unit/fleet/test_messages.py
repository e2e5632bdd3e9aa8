"""Messages of other peers: arbitrary ones are refused by a ValueError at most, proper ones come through unchanged."""

from __future__ import annotations

import json
from math import isfinite
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.any_json import JSON
from tests.examples import examples
from txt1.control.hand import DEFAULT_HAND, Hand
from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.bridge import fitting
from txt1.fleet.messages import (
    CAR_SIZE_MAX,
    DATA_MAX,
    MESSAGE_SIZE,
    NUMBER_MAX,
    TEXT_MAX,
    TIME_MAX,
    StopAnswer,
    answer_of,
    drive_of,
    message_of,
    state_of,
    stop_of,
    time_of,
)
from txt1.sidecar import LINE_MAX

PROPER = {"from": "txt01", "sent": 7, "x": 1.0, "y": 2, "theta": 0.5, "v": 0.3, "omega": -0.1}
FIELDS = (
    "from", "sent", "began", "x", "y", "theta", "v", "omega", "data", "armed", "reason", "driver", "battery", "silent",
    "stop", "number", "closed", "why", "body", "hand", "stuck",
)  # fmt: skip
MESSAGES = st.dictionaries(st.sampled_from(FIELDS), JSON).map(lambda given: {**PROPER, **given}) | JSON


@settings(max_examples=examples(150), deadline=None)
@given(st.binary(max_size=40) | MESSAGES.map(lambda value: json.dumps(value).encode()))
@example(b"[" * 5000)
@example(b'{"from": "txt01", "x": ' + b"9" * 5000 + b"}")
def test_nothing_but_a_value_error_comes_of_a_message(payload: bytes) -> None:
    assert isinstance(stop_of(payload), str)
    message = message_of(payload)
    if message is None:
        return
    for read in (state_of, drive_of, answer_of, lambda m: time_of(m, "sent"), lambda m: time_of(m, "began")):
        try:
            read(message)  # type: ignore[operator]
        except ValueError as error:
            assert "\n" not in str(error) and len(str(error)) < TEXT_MAX


@settings(max_examples=examples(150), deadline=None)
@given(MESSAGES.map(lambda value: json.dumps(value).encode()))
def test_a_state_that_is_accepted_is_finite_and_small(payload: bytes) -> None:
    message = message_of(payload)
    try:
        state = state_of(message or {})
    except ValueError:
        return
    assert all(isfinite(value) and abs(value) <= NUMBER_MAX for value in (*state[:5], *state.data))
    assert all(len(each) <= TEXT_MAX and each.isprintable() for each in (state.reason, state.driver, state.silent))


def test_a_proper_state_comes_through() -> None:
    told = {**PROPER, "data": [1, 2.5], "armed": True, "reason": "", "driver": "team", "battery": 12.1, "silent": None}
    message = message_of(json.dumps(told).encode())
    assert message is not None
    known = (1.0, 2.0, 0.5, 0.3, -0.1, (1.0, 2.5), True, "", "team", 12.1, "")
    assert state_of(message) == (*known, DEFAULT_BODY, "", DEFAULT_HAND)
    body, hand = Body(0.7, 3.0, 0.33, 0.165), Hand(3.0, 6.0, 0.7)
    assert state_of({**message, "body": body._asdict(), "hand": hand._asdict()})[11:] == (body, "", hand)


@pytest.mark.parametrize(
    "wrong",
    [
        {"reach": -1.0},
        {"reach": 0.0},
        {"v_max": 1e9},
        {"centre": 200.0},
        {"least": 4.0},
        {"least": -0.1},
        {"radius": None},
    ],
)
def test_a_body_that_no_car_has_is_refused(wrong: dict[str, object]) -> None:
    body = {**Body(0.7, 3.0, 0.33)._asdict(), **wrong}
    with pytest.raises(ValueError, match=r"it is no|between 0|out of range"):
        state_of({**PROPER, "body": body})


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"x": "boom"}, "x: it is no number"),
        ({"v": float("nan")}, "v: it is not finite, or beyond 1e+06"),
        ({"theta": 10**400}, "theta: it is not finite, or beyond 1e+06"),
        ({"omega": True}, "omega: it is no number"),
        ({"x": 1.1 * NUMBER_MAX}, "x: it is not finite, or beyond 1e+06"),
        ({"data": "7"}, "data: give at most 16 numbers"),
        ({"data": [0.0] * 17}, "data: give at most 16 numbers"),
        ({"reason": ["x"]}, "reason: it is no text"),
    ],
)
def test_a_wrong_state_is_refused_by_its_field(wrong: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError) as refused:
        state_of({**PROPER, **wrong})
    assert str(refused.value) == why


@pytest.mark.parametrize(
    "body",
    [
        Body(0.1, 0.4, 0.2, CAR_SIZE_MAX, 0.4, True),
        Body(CAR_SIZE_MAX, CAR_SIZE_MAX, CAR_SIZE_MAX, -CAR_SIZE_MAX),
        Body(1.0, 3.0, 1.0),
    ],
)
def test_a_body_and_a_hand_rule_at_their_limits_come_through(body: Body) -> None:
    hand = Hand(CAR_SIZE_MAX, 0.5, 0.1, True, 0.5)
    state = state_of({**PROPER, "body": body._asdict(), "hand": hand._asdict()})
    assert (state.body, state.hand) == (body, hand)
    more = {**PROPER, "body": {**body._asdict(), "pivots": 1}, "hand": {**hand._asdict(), "pivots": 1, "turn": 5.0}}
    state = state_of(more)
    assert (state.body.pivots, state.hand.pivots, state.hand.turn) == (False, False, 1.0), "only true is true"


def test_what_is_as_long_or_large_as_may_be_comes_through_and_a_reason_is_cut() -> None:
    told = {
        **PROPER,
        "x": NUMBER_MAX,
        "y": -NUMBER_MAX,
        "data": [1] * DATA_MAX,
        "armed": 1,
        "reason": "a\n\x1b[2J" + "b" * 200,
    }
    state = state_of(told)
    assert (state.x, state.y, state.data, state.armed) == (NUMBER_MAX, -NUMBER_MAX, (1.0,) * DATA_MAX, False)
    assert len(state.reason) == TEXT_MAX and state.reason.startswith("a  [2Jbbb")
    payload = json.dumps(PROPER).encode()
    assert message_of(payload.ljust(MESSAGE_SIZE)) == PROPER and message_of(payload.ljust(MESSAGE_SIZE + 1)) is None
    for time in (0, 1, TIME_MAX - 1):
        assert time_of({"sent": time}, "sent") == time
    for wrong in (-1, TIME_MAX, True, 1.5, "1", None):
        with pytest.raises(ValueError, match="sent: it is no time in ns"):
            time_of({"sent": wrong}, "sent")


@pytest.mark.parametrize("name", ["", "TXT", "a/b", "*", "a b", "1st", "x" * 65, 7, None, ["txt01"]])
def test_a_message_of_a_name_that_is_none_is_no_message(name: object) -> None:
    assert message_of(json.dumps({**PROPER, "from": name}).encode()) is None


def test_a_message_too_long_is_none() -> None:
    assert message_of(json.dumps({**PROPER, "more": "x" * MESSAGE_SIZE}).encode()) is None


def test_only_true_is_closed() -> None:
    assert answer_of({"closed": True}) == StopAnswer(True)
    assert answer_of({"closed": True, "stands": True}) == StopAnswer(True, stands=True)
    for other in (1, "yes", [1], None):
        assert answer_of({"closed": other, "stands": True, "why": "armed"}) == StopAnswer(False, why="armed")
        assert not answer_of({"closed": True, "stands": other}).stands


def test_the_list_of_the_others_has_room_in_a_message_to_the_robot() -> None:
    others = [["x" * 64, "é" * TEXT_MAX] for _ in range(200)]
    kept = list(fitting(others))
    assert 10 < len(kept) < 200 and 2 * len(json.dumps(kept)) < LINE_MAX
    assert list(fitting(others[:3])) == others[:3]
