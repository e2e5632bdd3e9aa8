"""Driving with keys that are never reported as released."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.config.schema import TeleopConfig
from txt1.control.hand import DEFAULT_HAND
from txt1.control.holding import HOLD_LASTS
from txt1.errors import CommandRefused
from txt1.ui.teleop import DECAY, KEY_HELD, Teleop


def test_an_untouched_keyboard_says_nothing() -> None:
    teleop = Teleop()
    teleop.key("+", 0.0)
    teleop.key("x", 0.0)
    assert teleop.command(0.0) is None


def test_a_key_holds_then_decays_then_falls_silent() -> None:
    teleop = Teleop(speed=0.5)
    teleop.key("w", 10.0)
    assert teleop.command(10.0) == (0.5, 0.0)
    assert teleop.command(10.0 + KEY_HELD) == pytest.approx((0.5, 0.0))
    v, _ = teleop.command(10.0 + KEY_HELD + DECAY / 2) or (0.0, 0.0)
    assert v == pytest.approx(0.25)
    assert teleop.command(11.01) == (0.0, 0.0)
    assert teleop.command(11.06) is None
    assert teleop.command(12.0) is None


def test_repeats_keep_it_going_for_three_seconds_and_its_decay() -> None:
    teleop, stood = Teleop(), 0.0
    for i in range(200):
        now = 0.05 * i
        teleop.key("w", now)
        try:
            command = teleop.command(now)
        except CommandRefused as refusal:
            assert "let go and press again" in str(refusal)
            stood = now
            continue
        if now < HOLD_LASTS - 0.06:
            assert command == (0.5, 0.0)
        if stood:
            assert command is None, "repeats do not revive it"
    assert stood == pytest.approx(HOLD_LASTS + DECAY, abs=0.11)
    teleop.key("w", 12.0)
    assert teleop.command(12.0) is None, "nobody listened meanwhile: the computer stood still"
    teleop.command(12.1 + KEY_HELD)
    teleop.key("w", 12.2 + KEY_HELD)
    assert teleop.command(12.2 + KEY_HELD) == (0.5, 0.0), "a press after a pause is fresh"


def test_another_key_is_a_fresh_press() -> None:
    teleop = Teleop()
    for i in range(200):
        now = 0.05 * i
        teleop.key("d" if i % 40 == 39 else "w", now)
        assert teleop.command(now) is not None


def test_repeats_do_not_revive_a_hold_that_was_let_go_of() -> None:
    teleop = Teleop()
    teleop.key("w", 0.0)
    teleop.release()
    teleop.key("w", 0.05)
    assert teleop.command(0.05) is None


def test_steering_keeps_driving_alive_because_only_the_last_key_repeats() -> None:
    teleop = Teleop(speed=0.5)
    teleop.key("w", 0.0)
    for i in range(1, 11):
        teleop.key("a", 0.2 * i)
        assert teleop.command(0.2 * i) == pytest.approx((0.5, 0.8 * 0.5 / 0.56))


def test_steering_does_not_wake_a_drive_that_has_run_out() -> None:
    teleop = Teleop()
    teleop.key("w", 0.0)
    teleop.key("a", 0.8)
    assert teleop.command(1.1) == (0.0, 0.0)


def test_steering_alone_turns_nothing() -> None:
    teleop = Teleop()
    teleop.key("d", 0.0)
    assert teleop.command(0.1) == (0.0, 0.0)


@pytest.mark.parametrize(("first", "second", "sign"), [("w", "s", -1.0), ("s", "w", 1.0)])
def test_the_opposite_key_replaces_at_once(first: str, second: str, sign: float) -> None:
    teleop = Teleop()
    teleop.key(first, 0.0)
    teleop.key(second, 0.1)
    assert teleop.command(0.1) == (sign * 0.5, 0.0)


def test_left_is_left_on_the_steering_wheel_in_reverse_too() -> None:
    forward, reverse = Teleop(), Teleop()
    for teleop, drive in ((forward, "w"), (reverse, "s")):
        teleop.key(drive, 0.0)
        teleop.key("a", 0.0)
    v, omega = forward.command(0.0) or (0.0, 0.0)
    assert v > 0.0
    assert omega > 0.0
    assert reverse.command(0.0) == (-v, -omega)


def test_speed_changes_in_steps_within_its_range() -> None:
    teleop = Teleop()
    teleop.key("+", 0.0)
    assert teleop.speed == 0.6
    for _ in range(30):
        teleop.key("+", 0.0)
    assert teleop.speed == 1.5
    for _ in range(30):
        teleop.key("-", 0.0)
    assert teleop.speed == 0.1


def test_release_lets_go_at_once() -> None:
    teleop = Teleop()
    teleop.key("w", 0.0)
    teleop.release()
    assert teleop.command(0.0) is None


@pytest.mark.parametrize(("speed", "turn"), [(0.0, 0.5), (20.0, 0.5), (float("nan"), 0.5), (0.5, 1.1)])
def test_impossible_settings_are_refused(speed: float, turn: float) -> None:
    with pytest.raises(ValueError):
        TeleopConfig(speed=speed, turn=turn)


presses = st.lists(st.tuples(st.sampled_from("wasd+-x"), st.floats(0.0, 1.0)), max_size=40)


@settings(max_examples=examples(60))
@given(presses, st.floats(0.1, 1.5), st.floats(0.0, 1.0))
def test_no_sequence_of_keys_exceeds_the_limits(keys: list[tuple[str, float]], speed: float, turn: float) -> None:
    teleop = Teleop(speed, DEFAULT_HAND._replace(turn=turn))
    now = 0.0
    for key, pause in keys:
        now += pause
        teleop.key(key, now)
        command = teleop.command(now + pause / 2)
        if command is not None:
            v, omega = command
            assert abs(v) <= teleop.speed <= 1.5
            assert abs(omega) <= abs(v) / 0.56 + 1e-12


@settings(max_examples=examples(60))
@given(presses)
def test_every_sequence_ends_with_one_zero_and_then_silence(keys: list[tuple[str, float]]) -> None:
    teleop = Teleop()
    now = 0.0
    for key, pause in keys:
        now += pause
        teleop.key(key, now)
    try:
        first = teleop.command(now + KEY_HELD + DECAY + 0.01)
    except CommandRefused:
        # one key for so long that its presses count as repeats
        first = (0.0, 0.0)
    assert first == ((0.0, 0.0) if any(key in "wasd" for key, _ in keys) else None)
    assert teleop.command(now + KEY_HELD + DECAY + 0.02) is None
