"""A gamepad's mapping against its specification, which is written down here a second time."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.control.hand import DEAD, DEFAULT_HAND
from txt1.gamepad.pad import AXES, BUTTONS, HOLD, Pad, PadParameters, Pads, PadState, Wish, velocity

R = DEFAULT_HAND.radius
ORIGINAL = PadParameters()

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
    pad, now = Pad(ORIGINAL, DEFAULT_HAND), 0.0
    before: frozenset[str] = frozenset()
    up = False  # the dead-man has been up since the pad came
    since = inf  # when the arm button went down
    for pause, reading in sequence:
        now += pause
        wish = pad.take(reading, now, now)
        down = reading.buttons
        up = up or "a" not in down
        if "a" in down and up:
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
        assert wish.arm == (now - since >= HOLD)
        if wish.arm:
            since = inf
        before = down


@settings(max_examples=examples(30))
@given(st.lists(st.tuples(st.floats(0.0, 0.3), st.dictionaries(st.integers(0, 2), readings)), max_size=25))
def test_of_several_pads_one_drives_until_it_lets_go(sequence: list[tuple[float, dict[int, PadState]]]) -> None:
    pads, now, driver = Pads(ORIGINAL, DEFAULT_HAND), 0.0, None
    stops: dict[int, bool] = {}
    for pause, there in sequence:
        now += pause
        wish = pads.take({number: (reading, now) for number, reading in there.items()}, now)
        if driver is not None and driver in there and "a" in there[driver].buttons:
            assert pads.driver == driver, "who drives goes on"
        elif pads.driver is not None:
            assert "a" in there[pads.driver].buttons
        assert (wish.velocity is None) == (pads.driver is None)
        if pads.driver is not None:
            assert wish.velocity == velocity(there[pads.driver], ORIGINAL, DEFAULT_HAND)
        pressed = {number: "b" in reading.buttons for number, reading in there.items()}
        assert wish.stop == any(down and not stops.get(number, False) for number, down in pressed.items())
        stops, driver = pressed, pads.driver


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


def test_a_dead_man_that_was_down_from_the_first_does_not_count() -> None:
    pad = Pad(ORIGINAL, DEFAULT_HAND)
    assert pad.take(HELD, 0.0, 0.0) == Wish()
    assert pad.take(HELD, 1.0, 1.0) == Wish()
    pad.take(PadState(), 1.1, 1.1)
    assert pad.take(HELD, 1.2, 1.2).velocity == (1.5, 0.0)


def test_a_pad_that_reports_all_the_time_is_gone_when_it_is_silent() -> None:
    pad = Pad(replace(ORIGINAL, silence=0.2), DEFAULT_HAND)
    pad.take(PadState(), 0.0, 0.0)
    assert pad.take(HELD, 0.1, 0.1).velocity is not None
    assert pad.take(HELD, 0.25, 0.1).velocity is not None
    assert pad.take(HELD, 0.35, 0.1).velocity is None
    assert pad.take(HELD, 0.40, 0.4).velocity is None, "not before the dead-man was up"
    pad.take(PadState(), 0.45, 0.45)
    assert pad.take(HELD, 0.50, 0.5).velocity is not None


def test_a_pad_is_silent_only_after_its_time() -> None:
    pad = Pad(replace(ORIGINAL, silence=0.25), DEFAULT_HAND)
    pad.take(PadState(), 0.0, 0.0)
    assert pad.take(HELD, 0.25, 0.0).velocity is not None


def test_the_arm_button_arms_once_when_it_was_held_for_half_a_second() -> None:
    pad, start = Pad(ORIGINAL, DEFAULT_HAND), PadState(frozenset({"start"}))
    assert [pad.take(start, now, now).arm for now in (1.0, 1.25, 1.484375, 1.5, 1.75, 3.0)] == [
        *[False] * 3,
        True,
        *[False] * 2,
    ]
    pad.take(PadState(), 3.0, 3.0)
    assert [pad.take(start, now, now).arm for now in (4.0, 4.25, 4.5)] == [False, False, True]


def test_a_pad_that_waits_takes_over_only_when_it_is_pressed_anew() -> None:
    pads = Pads(ORIGINAL, DEFAULT_HAND)
    pads.take({1: (PadState(), 0.0), 2: (PadState(), 0.0)}, 0.0)
    pads.take({1: (HELD, 0.1), 2: (PadState(), 0.1)}, 0.1)
    pads.take({1: (HELD, 0.2), 2: (HELD, 0.2)}, 0.2)
    assert pads.take({1: (PadState(), 0.3), 2: (HELD, 0.3)}, 0.3).velocity is None
    assert pads.take({2: (HELD, 0.4)}, 0.4).velocity is None
    pads.take({2: (PadState(), 0.5)}, 0.5)
    assert pads.take({2: (HELD, 0.6)}, 0.6).velocity == (1.5, 0.0)
    assert pads.take({}, 0.7) == Wish()


def test_every_name_of_the_defaults_is_one_of_sdl_s() -> None:
    p = ORIGINAL
    assert {p.dead_man, p.stop, p.arm, p.screen, p.manual} <= set(BUTTONS)
    assert {p.ahead, p.steer, p.forward, p.reverse} <= set(AXES)
