"""A gamepad's mapping against its specification, which is written down here a second time."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.config import load
from txt1.control.hand import DEAD, DEFAULT_HAND
from txt1.control.holding import HOLD_LASTS
from txt1.errors import ConfigError
from txt1.gamepad.pad import APPEARS, ARMS, AXES, BUTTONS, PadParameters, Pads, PadState, Wish, mapping_of, velocity

R = DEFAULT_HAND.radius
ORIGINAL = PadParameters()


@pytest.mark.parametrize(
    ("setting", "there_is"),
    [
        ("gamepad.dead_man=trigger", "leftshoulder"),
        ("gamepad.stop=lefty", "leftshoulder"),
        ("gamepad.steer=a", "rightx"),
        ("gamepad.forward=R2", "righttrigger"),
    ],
)
def test_a_button_or_an_axis_that_no_pad_has_is_refused_with_what_there_is(setting: str, there_is: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load(overrides=[setting]).config.section(PadParameters)
    name, value = setting.split("=")
    assert str(refused.value).startswith(name) and there_is in str(refused.value) and value in str(refused.value)


def test_a_mapping_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gamepad\.mapping: there is no file .*nothing; `txt1 gamepad --map FILE`"):
        mapping_of(PadParameters(mapping=str(tmp_path / "nothing")))
    (tmp_path / "some").write_text("")
    assert mapping_of(PadParameters(mapping=str(tmp_path / "some"))) == str(tmp_path / "some")
    assert mapping_of(PadParameters()) is None


axis = st.floats(-1.0, 1.0) | st.sampled_from([0.0, 1.0, -1.0, DEAD, -DEAD])
readings = st.builds(
    PadState,
    st.frozensets(st.sampled_from(["a", "b", "start", "y", "back", "x"])),
    st.fixed_dictionaries({name: st.floats(0.0, 1.0) if "trigger" in name else axis for name in AXES}),
)
steps = st.lists(st.tuples(st.floats(0.0, 0.4), readings), min_size=1, max_size=25)


def bent(value: float) -> float:
    """An axis behind its dead middle, as the manual says it."""
    if abs(value) <= DEAD:
        return 0.0
    return (value - DEAD) / (1 - DEAD) if value > 0 else (value + DEAD) / (1 - DEAD)


def by_chance(random: Random) -> PadState:
    """A reading that keeps a button as often as not, and an axis at its ends now and then."""
    down = frozenset(name for name in ("a", "a", "b", "start", "start", "y", "back", "x") if random.random() < 0.4)
    ends = (0.0, 1.0, -1.0, DEAD, -DEAD)
    axes = {name: random.choice(ends) if random.random() < 0.3 else random.uniform(-1.0, 1.0) for name in AXES}
    return PadState(down, {name: abs(value) if "trigger" in name else value for name, value in axes.items()})


@settings(max_examples=examples(30))
@given(steps)
def test_a_pad_does_what_the_manual_says(sequence: list[tuple[float, PadState]]) -> None:
    does_what_the_manual_says(sequence)


def does_what_the_manual_says(sequence: list[tuple[float, PadState]]) -> None:
    """A pad that is there since a while, and reports with each reading."""
    pads, now = pads_at_rest(1), 1.0
    before: frozenset[str] = frozenset()
    since = inf  # when the arm button went down
    for pause, reading in sequence:
        now += pause
        wish = pads.take({1: (reading, now)}, now)
        down = reading.buttons
        if "a" in down:
            pull = bent(reading.axes["righttrigger"]) - bent(reading.axes["lefttrigger"])
            v = 1.5 * (pull if pull else -bent(reading.axes["lefty"]))
            expected = v, abs(v) / R * -bent(reading.axes["leftx"])
            assert wish.velocity is not None
            assert all(abs(a - b) < 1e-9 for a, b in zip(wish.velocity, expected, strict=True))
            assert abs(wish.velocity[0]) <= 1.5 and abs(wish.velocity[1]) <= abs(wish.velocity[0]) / R + 1e-9
        else:
            assert wish.velocity is None
        assert wish.stop == ("b" in down and "b" not in before)
        assert wish.screen == ("y" in down and "y" not in before)
        assert wish.manual == ("back" in down and "back" not in before)
        if "start" not in down:
            since = inf
        elif "start" not in before:
            since = now
        assert wish.arm == (now - since >= ARMS)
        if wish.arm:
            since = inf
        before = down


@settings(max_examples=examples(100))
@given(
    st.lists(st.tuples(st.floats(0.0, 1.5), st.dictionaries(st.integers(0, 2), readings), st.booleans()), max_size=30)
)
def test_of_several_pads_the_one_pressed_last_drives_until_any_is_released(
    sequence: list[tuple[float, dict[int, PadState], bool]],
) -> None:
    """The rule of a hold, written down a second time: pads come, go, freeze, are pressed and released in any order."""
    pads, now = Pads(ORIGINAL, DEFAULT_HAND), 0.0
    down: dict[int, bool] = {}
    since: dict[int, float] = {}
    driver, signed = None, -inf
    for pause, there, reports in sequence:
        now += pause
        wish = pads.take({number: (reading, now if reports else 0.0) for number, reading in there.items()}, now)
        is_down = {number: "a" in reading.buttons for number, reading in there.items()}
        since = {number: since.get(number, now) if number in down else now for number in there}
        if driver is not None and (
            driver not in there or any(down.get(n, False) and not d for n, d in is_down.items())
        ):
            driver = None
        elif driver is not None and reports:
            signed = now
        fresh = [n for n, d in is_down.items() if d and down.get(n) is False and now - since[n] >= APPEARS]
        if fresh:
            driver, signed = fresh[-1], now
        if driver is not None and now - signed > HOLD_LASTS:
            driver = None
        assert pads.driver == driver
        if wish.velocity is not None:
            assert driver is not None
            assert wish.velocity == velocity(there[driver], ORIGINAL, DEFAULT_HAND)
        down = is_down


HELD = PadState(frozenset({"a"}), {"lefty": -1.0})


def test_full_deflection_is_the_original_s_speed_and_left_is_left() -> None:
    assert repr(velocity(HELD, ORIGINAL, DEFAULT_HAND)) == "(1.5, 0.0)"
    assert velocity(PadState(axes={"lefty": -1.01, "leftx": -1.01}), ORIGINAL, DEFAULT_HAND) == (1.5, 1.5 / R), (
        "a pad that is off"
    )
    assert velocity(PadState(axes={"lefty": 1.0, "leftx": -1.0}), ORIGINAL, DEFAULT_HAND) == (-1.5, 1.5 / R)
    assert velocity(PadState(axes={"leftx": -1.0}), ORIGINAL, DEFAULT_HAND) == (0.0, 0.0), (
        "a car does not turn on the spot"
    )
    assert velocity(PadState(axes={"lefty": nan, "leftx": inf}), ORIGINAL, DEFAULT_HAND) == (0.0, 0.0)


def pads_at_rest(*numbers: int, parameters: PadParameters = ORIGINAL) -> Pads:
    """Pads that appeared a second ago, and at which nothing is pressed."""
    pads = Pads(parameters, DEFAULT_HAND)
    for now in (0.0, 1.0):
        pads.take(dict.fromkeys(numbers, (PadState(), now)), now)
    return pads


@pytest.mark.parametrize("first", [HELD, PadState()], ids=["down", "its first report is late"])
def test_a_dead_man_that_was_down_from_the_first_does_not_count(first: PadState) -> None:
    pads = Pads(ORIGINAL, DEFAULT_HAND)
    pads.take({1: (first, 0.0)}, 0.0)
    for now in (0.1, 1.0, 2.0):
        assert pads.take({1: (HELD, now)}, now).velocity is None
    pads.take({1: (PadState(), 2.1)}, 2.1)
    assert pads.take({1: (HELD, 2.2)}, 2.2).velocity == (1.5, 0.0)


@pytest.mark.parametrize("silence", [0.2, HOLD_LASTS])
def test_a_pad_that_reports_nothing_new_lets_go_and_needs_a_fresh_press(silence: float) -> None:
    pads = pads_at_rest(1, parameters=replace(ORIGINAL, silence=silence))
    assert pads.take({1: (HELD, 1.1)}, 1.1).velocity == (1.5, 0.0)
    assert pads.take({1: (HELD, 1.1)}, 1.1 + silence).velocity == (1.5, 0.0)
    assert pads.take({1: (HELD, 1.1)}, 1.101 + silence).velocity is None
    assert pads.expired
    assert pads.take({1: (HELD, 2.0 + silence)}, 2.0 + silence).velocity is None, "a report of the same hold"
    pads.take({1: (PadState(), 2.1 + silence)}, 2.1 + silence)
    assert pads.take({1: (HELD, 2.2 + silence)}, 2.2 + silence).velocity == (1.5, 0.0)


def test_a_stick_that_moves_keeps_its_hold() -> None:
    pads = pads_at_rest(1)
    for step in range(200):
        now = 1.0 + 0.1 * step
        moved = PadState(frozenset({"a"}), {"lefty": -1.0, "leftx": 0.3 * (step % 2)})
        assert pads.take({1: (moved, now)}, now).velocity is not None


@pytest.mark.parametrize("silence", [0.0, -1.0, 3.1, 600.0, "nan"])
def test_no_pad_may_be_silent_for_longer_than_a_hold_lasts(silence: object) -> None:
    with pytest.raises(ConfigError, match=r"gamepad\.silence"):
        load(None, [f"gamepad.silence={silence}"], {}, {}).config.section(PadParameters)


def test_the_arm_button_arms_once_when_it_was_held_for_half_a_second() -> None:
    pads, start = pads_at_rest(1), PadState(frozenset({"start"}))
    times = (1.0, 1.25, 1.484375, 1.5, 1.75, 3.0)
    assert [pads.take({1: (start, now)}, now).arm for now in times] == [*[False] * 3, True, *[False] * 2]
    pads.take({1: (PadState(), 3.0)}, 3.0)
    assert [pads.take({1: (start, now)}, now).arm for now in (4.0, 4.25, 4.5)] == [False, False, True]


def test_a_fresh_press_takes_over_through_zero_and_the_release_of_either_ends_both() -> None:
    pads = pads_at_rest(1, 2)
    assert pads.take({1: (HELD, 1.1), 2: (PadState(), 1.1)}, 1.1).velocity == (1.5, 0.0)
    assert pads.take({1: (HELD, 1.2), 2: (HELD, 1.2)}, 1.2).velocity is None
    assert pads.take({1: (HELD, 1.25), 2: (HELD, 1.25)}, 1.25).velocity is None
    assert pads.take({1: (HELD, 1.31), 2: (HELD, 1.31)}, 1.31).velocity == (1.5, 0.0)
    assert pads.driver == 2
    for now in (1.4, 1.5, 2.0):
        assert pads.take({1: (PadState(), now), 2: (HELD, now)}, now).velocity is None
    pads.take({1: (PadState(), 2.1), 2: (PadState(), 2.1)}, 2.1)
    assert pads.take({1: (PadState(), 2.2), 2: (HELD, 2.2)}, 2.2).velocity == (1.5, 0.0)
    assert pads.take({}, 2.3) == Wish()


def test_after_a_reconnect_the_old_pad_drives_no_more() -> None:
    pads = pads_at_rest(1)
    pads.take({1: (HELD, 1.1)}, 1.1)
    frozen = (HELD, 1.1)
    for now in (1.2, 2.0):
        pads.take({1: frozen, 2: (PadState(), now)}, now)
    pads.take({1: frozen, 2: (HELD, 2.1)}, 2.1)
    assert pads.driver == 2
    for now in (2.2, 2.3, 4.0):
        assert pads.take({1: frozen, 2: (PadState(), now)}, now).velocity is None, "its release ends every hold"


def test_a_stop_counts_from_the_first() -> None:
    pads = Pads(ORIGINAL, DEFAULT_HAND)
    pads.take({1: (PadState(), 0.0)}, 0.0)
    assert pads.take({1: (PadState(frozenset({"b"})), 0.02)}, 0.02).stop


def test_every_name_of_the_defaults_is_one_of_sdl_s() -> None:
    p = ORIGINAL
    assert {p.dead_man, p.stop, p.arm, p.screen, p.manual} <= set(BUTTONS)
    assert {p.ahead, p.steer, p.forward, p.reverse} <= set(AXES)
