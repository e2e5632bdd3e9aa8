"""Who drives: priorities, hand-over, time-outs."""

from __future__ import annotations

import itertools
from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from tests.examples import examples
from txt1.additions import ours
from txt1.control.commander import PRIORITIES, SKEW, Commander, Driver, SetPoint
from txt1.control.holding import HANDOVER, PAUSE
from txt1.errors import A_STOP

TIMEOUT = 0.25
TICK = 0.02
FAST, SLOW = (1.0, 0.5), (0.3, -0.2)


def commander(**priorities: int) -> Commander:
    """A commander with these sources."""
    made = Commander(TIMEOUT)
    for name, priority in priorities.items():
        made.add(name, priority)
    return made


def drives(one: Commander, name: str, now: float) -> bool:
    return one.driver(now).name == name


def moving(one: Commander, now: float) -> tuple[float, float]:
    return one.setpoint(now)[:2]


@pytest.mark.parametrize(("name", "rank"), [("keys", 50), ("program", 10), ("unheard of", 10)])
def test_the_keys_have_50_and_a_program_10(name: str, rank: int) -> None:
    made = commander(equal=rank, above=rank + 1)
    made.add(name)
    assert made.command(name, *FAST, 0.0, 0.0)
    assert not made.command("equal", *SLOW, 0.0, 0.0)
    assert made.command("above", *SLOW, 0.0, 0.0)


# -- every pair of priorities ----------------------------------------------------------------------------------

RANKS = {**PRIORITIES, **{name: rank for each in ours().values() for name, rank in each.sources.items()}}
PAIRS = list(itertools.product(RANKS, RANKS))


@pytest.mark.parametrize("asks", [False, True], ids=["by a command", "by asking"])
@pytest.mark.parametrize("has, wants", PAIRS)
def test_the_wheel_passes_from_one_source_to_another_by_their_priorities(has: str, wants: str, asks: bool) -> None:
    one = commander(a=RANKS[has], b=RANKS[wants])
    assert one.command("a", *FAST, 1.0, 1.0)
    takes_over = RANKS[wants] > RANKS[has]

    now = 1.0 + TICK
    assert (one.request("b", now) if asks else one.command("b", *SLOW, now, now)) is takes_over
    assert drives(one, "b" if takes_over else "a", now), "in the next cycle"
    if not takes_over:
        assert moving(one, now) == FAST
        assert one.driver(now).refused == {"b": 1}
        return
    assert moving(one, now) == (0.0, 0.0), "a change of hands passes through zero"
    assert one.driver(now).since == now
    assert one.command("b", *SLOW, now + HANDOVER - 0.01, now + HANDOVER - 0.01)
    assert moving(one, now + HANDOVER - 0.01) == (0.0, 0.0)
    now += HANDOVER
    assert one.command("b", *SLOW, now, now)
    assert moving(one, now) == SLOW

    # the first one goes on and on, and is refused and counted
    assert not one.command("a", *FAST, now, now)
    assert one.driver(now).refused == {"a": 1}
    assert one.overruled("a") == "b"


@pytest.mark.parametrize("neutral", ["zero", "request", "release"])
@pytest.mark.parametrize("goes", ["release", "stale"])
@pytest.mark.parametrize("has, wants", [(a, b) for a, b in PAIRS if RANKS[b] > RANKS[a]])
def test_the_wheel_goes_back_after_a_zero_or_a_request_and_never_by_itself(
    has: str, wants: str, goes: str, neutral: str
) -> None:
    one = commander(a=RANKS[has], b=RANKS[wants])
    one.command("a", *FAST, 1.0, 1.0)
    one.command("b", *SLOW, 1.02, 1.02)
    one.command("a", 0.0, 0.0, 1.04, 1.04)  # while the other drives this is too early
    one.command("b", *SLOW, 1.16, 1.16)
    now = 1.2
    if goes == "release":
        one.release("b", now)
    else:
        assert moving(one, 1.16 + TIMEOUT) == SLOW
        now = 1.16 + TIMEOUT + TICK
    assert moving(one, now) == (0.0, 0.0)
    assert drives(one, "", now)

    for _ in range(50):
        assert not one.command("a", *FAST, now, now), "nobody is set off by another's letting go"
        assert moving(one, now) == (0.0, 0.0)
        now += 0.05

    match neutral:
        case "zero":
            assert one.command("a", 0.0, 0.0, now, now)
        case "request":
            assert one.request("a", now)
        case _:
            one.release("a", now)
    assert one.command("a", *FAST, now + 0.05, now + 0.05)
    assert moving(one, now + 0.05) == FAST


def test_of_equal_priorities_the_driver_goes_on_and_the_other_is_refused_and_counted() -> None:
    one = commander(a=10, b=10)
    for step in range(100):
        now = step * 0.05
        assert one.command("a", *FAST, now, now)
        assert not one.command("b", *SLOW, now, now)
        assert moving(one, now) == FAST
    assert one.driver(now) == ("a", 0.0, {"b": 100})


# -- zeros, freshness, order -----------------------------------------------------------------------------------


def test_zeros_of_an_idle_source_hold_nothing_and_its_first_command_takes_over() -> None:
    one = commander(gamepad=40, program=10)
    for step in range(20):
        now = step * 0.05
        one.command("gamepad", 0.0, 0.0, now, now)
        assert one.command("program", *FAST, now, now)
        assert moving(one, now) == FAST
    assert one.driver(now).refused == {}
    assert one.command("gamepad", *SLOW, now, now)


def test_zeros_stop_at_once_and_hold_the_wheel_no_longer_than_their_time_out() -> None:
    one = commander(a=10, b=10)
    one.command("a", *FAST, 0.0, 0.0)
    now = 0.0
    while now < TIMEOUT - 0.05:
        now += 0.05
        assert one.command("a", 0.0, 0.0, now, now)
        assert moving(one, now) == (0.0, 0.0)
        assert drives(one, "a", now)
    assert one.command("b", *SLOW, 0.3, 0.3)


def test_a_source_that_keeps_asking_holds_the_robot_where_it_stands() -> None:
    one = commander(gamepad=40, program=10)
    for step in range(40):
        now = step * 0.05
        assert one.request("gamepad", now)
        one.command("gamepad", 0.0, 0.0, now, now)
        assert not one.command("program", *FAST, now, now)
        assert moving(one, now) == (0.0, 0.0)


def test_a_source_that_drives_alone_goes_on_after_a_pause_as_ever() -> None:
    one = commander(program=10)
    one.command("program", *FAST, 0.0, 0.0)
    assert moving(one, 1.0) == (0.0, 0.0)
    assert one.setpoint(1.0).time == 0.0, "what is sent on is as stale as it was"
    assert one.command("program", *FAST, 1.0, 1.0)


def test_freshness_is_the_age_of_the_message_and_not_of_its_arrival() -> None:
    one = commander(web=30)
    assert not one.command("web", *FAST, 0.0, 0.26)
    assert one.command("web", *FAST, 0.2, 0.4)
    assert moving(one, 0.45) == FAST
    assert moving(one, 0.46) == (0.0, 0.0)
    assert drives(one, "", 0.46)
    assert one.driver(0.46).since == pytest.approx(0.45)


def test_a_late_command_does_not_undo_the_stop_that_overtook_it() -> None:
    one = commander(web=30)
    one.command("web", *FAST, 1.0, 1.0)
    one.command("web", 0.0, 0.0, 1.1, 1.1)
    assert not one.command("web", *FAST, 1.05, 1.15)
    assert moving(one, 1.15) == (0.0, 0.0)


def test_a_zero_from_before_the_other_let_go_does_not_count_as_neutral() -> None:
    one = commander(keys=50, program=10)
    one.command("program", *FAST, 1.0, 1.0)
    one.command("keys", *SLOW, 1.1, 1.1)
    one.release("keys", 1.2)
    one.command("program", 0.0, 0.0, 1.15, 1.25)
    assert not one.command("program", *FAST, 1.3, 1.3)
    one.command("program", 0.0, 0.0, 1.35, 1.4)
    assert one.command("program", *FAST, 1.4, 1.4)


def test_a_source_may_be_stale_sooner_than_the_gate_but_never_later() -> None:
    one = Commander(TIMEOUT)
    one.add("gamepad", timeout=0.1)
    one.command("gamepad", *FAST, 0.0, 0.0)
    assert moving(one, 0.1) == FAST
    assert moving(one, 0.12) == (0.0, 0.0)
    for timeout in (0.26, inf, nan, 0.0, -1.0):
        with pytest.raises(ValueError, match="time-out"):
            one.add("web", timeout=timeout)
    with pytest.raises(ValueError, match="this name is taken"):
        one.add("gamepad")


@pytest.mark.parametrize("v, omega, time", [(nan, 0.0, 1.0), (0.5, inf, 1.0), (0.5, 0.0, nan), (0.5, 0.0, 1.5)])
def test_what_is_not_finite_or_comes_from_the_future_is_refused_whole(v: float, omega: float, time: float) -> None:
    one = commander(program=10)
    one.command("program", *FAST, 0.9, 0.9)
    with pytest.raises(ValueError, match="finite"):
        one.command("program", v, omega, time, 1.0)
    assert moving(one, 1.0) == FAST
    assert moving(one, 1.16) == (0.0, 0.0), "and refreshes nothing"


def test_after_arming_nothing_from_before_counts() -> None:
    one = commander(keys=50, program=10)
    one.command("program", *FAST, 1.0, 1.0)
    one.clear(1.0)
    assert one.setpoint(1.0) == SetPoint()
    assert drives(one, "", 1.0)


# -- hands -----------------------------------------------------------------------------------------------------


def held(one: Commander, name: str, begins: float, ends: float, velocity: tuple[float, float] = FAST) -> bool:
    """A hand holds from then to then, and commands every 0.05 s; whether its last command was obeyed."""
    now, obeyed = begins, False
    while now < ends:
        obeyed = one.hold(name, *velocity, now, now)
        now += 0.05
    return obeyed


@pytest.mark.parametrize("zero", [False, True], ids=["pushed", "at rest"])
@pytest.mark.parametrize("why", ["overruled", "armed", "a pause"])
def test_a_hold_that_is_over_needs_a_release_and_a_fresh_press(why: str, zero: bool) -> None:
    one = commander(keys=50, gamepad=40)
    assert held(one, "gamepad", 1.0, 2.0)
    match why:
        case "overruled":
            assert held(one, "keys", 2.0, 2.5, SLOW)
            one.release("keys", 2.5)
        case "armed":
            one.clear(2.5)
    begins = 2.6 if why != "a pause" else 2.0 + PAUSE
    assert not held(one, "gamepad", begins, 4.0, (0.0, 0.0) if zero else FAST)
    assert not one.request("gamepad", 4.0)
    assert not held(one, "gamepad", 4.0, 5.0), "the same hold does not drive on"
    assert drives(one, "", 5.0)
    one.release("gamepad", 5.0)
    assert held(one, "gamepad", 5.2, 5.5)
    assert moving(one, 5.5) == FAST


def test_a_hand_that_lets_go_while_another_drives_drives_by_its_next_press() -> None:
    one = commander(keys=50, gamepad=40)
    held(one, "gamepad", 1.0, 2.0)
    held(one, "keys", 2.0, 3.0, SLOW)
    one.release("gamepad", 3.0)
    one.release("keys", 3.0)
    assert held(one, "gamepad", 3.2, 3.5)


def test_a_hand_at_rest_holds_the_wheel() -> None:
    one = commander(gamepad=40, program=10)
    assert held(one, "gamepad", 1.0, 3.0, (0.0, 0.0))
    assert not one.command("program", *FAST, 3.0, 3.0)
    assert moving(one, 3.0) == (0.0, 0.0)


def test_a_short_pause_does_not_end_a_hold() -> None:
    one = commander(gamepad=40)
    held(one, "gamepad", 1.0, 2.0)
    assert held(one, "gamepad", 1.9 + PAUSE, 3.0)


def test_a_source_that_follows_another_at_once_begins_with_zero() -> None:
    one = commander(a=10, b=10)
    one.command("a", *FAST, 1.0, 1.0)
    one.release("a", 1.01)
    assert one.command("b", *SLOW, 1.02, 1.02)
    assert moving(one, 1.02) == (0.0, 0.0)
    assert one.command("b", *SLOW, 1.01 + HANDOVER, 1.01 + HANDOVER)
    assert moving(one, 1.01 + HANDOVER) == SLOW
    one.release("b", 1.2)
    one.command("b", *SLOW, 1.21, 1.21)
    assert moving(one, 1.21) == SLOW, "a source that follows itself changes no hands"


# -- any traffic at all ----------------------------------------------------------------------------------------

NAMES = ("keys", "gamepad", "web", "program", "script")
VELOCITIES = st.sampled_from([(0.0, 0.0), (0.5, 0.0), (-0.3, 0.2), (0.0, 0.4), (1.5, -1.0)])


class Traffic(RuleBasedStateMachine):
    """Sources that do anything in any order, beside a plain account of whom the rules allow to drive."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 1.0
        self.one = Commander(TIMEOUT)
        self.before = ""
        self.said: tuple[str, tuple[float, float]] | None = None  # the last source to speak, and its command

    @initialize(timeouts=st.tuples(*[st.sampled_from([0.05, 0.1, TIMEOUT]) for _ in NAMES]))
    def begin(self, timeouts: tuple[float, ...]) -> None:
        for name, timeout in zip(NAMES, timeouts, strict=True):
            self.one.add(name, timeout=timeout)

    @rule(name=st.sampled_from(NAMES), velocity=VELOCITIES, age=st.sampled_from([0.0, 0.0, 0.02, 0.08, 0.3]))
    def command(self, name: str, velocity: tuple[float, float], age: float) -> None:
        taken = self.one.command(name, *velocity, self.now - age, self.now)
        self.said = (name, velocity)
        if taken:
            assert moving(self.one, self.now) in (velocity, (0.0, 0.0))
        if any(velocity):
            assert taken is drives(self.one, name, self.now) or not taken

    @rule(name=st.sampled_from(NAMES))
    def request(self, name: str) -> None:
        assert self.one.request(name, self.now) is drives(self.one, name, self.now)
        self.said = (name, (0.0, 0.0))

    @rule(name=st.sampled_from(NAMES))
    def release(self, name: str) -> None:
        self.one.release(name, self.now)
        assert not drives(self.one, name, self.now)
        self.said = None

    @rule(cycles=st.integers(1, 20))
    def wait(self, cycles: int) -> None:
        self.now = round(self.now + cycles * TICK, 9)
        self.said = None

    @precondition(lambda self: self.now > 1.0)
    @rule()
    def arm(self) -> None:
        self.one.clear(self.now)
        self.said = None

    @invariant()
    def one_source_drives_and_a_hand_over_begins_with_its_command_or_zero(self) -> None:
        name = self.one.driver(self.now).name
        assert name in ("", *NAMES)
        v, omega = moving(self.one, self.now)
        if not name:
            assert (v, omega) == (0.0, 0.0)
        if name != self.before:
            wanted = self.said[1] if self.said is not None and self.said[0] == name else (0.0, 0.0)
            assert (v, omega) in (wanted, (0.0, 0.0))
        self.before = name


Traffic.TestCase.settings = settings(max_examples=examples(80), stateful_step_count=40)
TestTraffic = Traffic.TestCase


@given(st.lists(st.tuples(st.sampled_from(["keys", "program"]), VELOCITIES, st.integers(1, 20)), max_size=60))
def test_a_program_that_was_overruled_and_never_commands_zero_never_drives_again(
    script: list[tuple[str, tuple[float, float], int]],
) -> None:
    one = commander(keys=50, program=10)
    overruled, now = False, 0.0
    for name, velocity, cycles in script:
        now = round(now + cycles * TICK, 9)
        had = drives(one, "program", now)
        taken = one.command(name, *(velocity if name == "keys" or any(velocity) else FAST), now, now)
        if name == "program":
            assert not (taken and overruled)
            overruled = overruled or not taken
        else:
            overruled = overruled or (had and taken)


# -- boundaries --------------------------------------------------------------------------------------------------------


def test_the_priorities_are_those_that_the_manual_tells() -> None:
    assert RANKS == {
        "rc": 60,
        "keys": 50,
        "gamepad": 40,
        "web": 30,
        "view": 30,
        "fleet": 30,
        "ros": 20,
        "program": 10,
        "policy": 5,
    }


def test_at_first_no_source_drives_and_no_command_is_known() -> None:
    one = commander(a=1)
    assert one.driver(3.0) == ("", 0.0, {})
    assert Driver() == ("", 0.0, {})
    assert one.setpoint(0.0) == SetPoint() == (0.0, 0.0, -inf)


@pytest.mark.parametrize("v, omega", [(inf, 0.0), (-inf, 0.0), (0.5, inf), (0.5, -inf), (inf, -inf), (nan, 0.0)])
def test_who_drives_on_may_not_be_infinite_either(v: float, omega: float) -> None:
    one = commander(a=1)
    one.command("a", *FAST, 0.0, 0.0)
    with pytest.raises(ValueError, match="finite"):
        one.command("a", v, omega, 0.1, 0.1)
    assert moving(one, 0.1) == FAST


def test_a_command_may_be_ahead_by_the_rounding_of_clocks_and_as_old_as_the_time_out() -> None:
    one = commander(a=1)
    assert one.command("a", *FAST, SKEW, 0.0)
    assert one.setpoint(0.0).time == 0.0
    assert one.command("a", *FAST, 1.0 - TIMEOUT, 1.0)
    assert not one.command("a", *FAST, 1.0 - TIMEOUT, 1.01)
    assert one.driver(1.01).refused == {"a": 1}


def test_who_drives_again_after_its_time_out_drives_since_then() -> None:
    one = commander(a=1)
    one.command("a", *FAST, 0.0, 0.0)
    one.command("a", *FAST, 1.0, 1.0)
    assert one.driver(1.0).since == 1.0


def test_a_zero_in_the_instant_of_the_release_counts() -> None:
    one = commander(a=1, b=2)
    one.command("a", *FAST, 0.0, 0.0)
    one.command("b", *SLOW, 0.1, 0.1)
    one.release("b", 0.2)
    one.command("a", 0.0, 0.0, 0.2, 0.2)
    assert one.command("a", *FAST, 0.2, 0.2)


def test_to_ask_is_no_command() -> None:
    one = commander(a=1)
    assert one.request("a", 1.0)
    assert one.setpoint(1.0) == (0.0, 0.0, -inf)


def test_who_holds_the_wheel_by_asking_does_not_hold_the_command_before() -> None:
    one = commander(a=1)
    one.command("a", *FAST, 0.0, 0.0)
    one.request("a", 0.2)
    assert moving(one, 0.2) == FAST
    assert drives(one, "a", 0.3)
    assert one.setpoint(0.3) == (0.0, 0.0, 0.0)


def test_before_anybody_has_commanded_nobody_drives_and_no_set_point_is_fresh() -> None:
    assert SetPoint() == (0.0, 0.0, -inf)
    assert Driver() == ("", 0.0, {})


# -- a stop that the holder did not ask for ----------------------------------------------------------------------


def test_an_interrupted_hold_does_not_drive_on_before_a_zero_or_a_request() -> None:
    for let_go in ("zero", "request", "release"):
        one = commander(a=10)
        assert one.command("a", *FAST, 1.0, 1.0)
        one.interrupt(1.1)
        assert moving(one, 1.1) == (0.0, 0.0)
        assert not one.command("a", *FAST, 1.2, 1.2)
        assert one.overruled("a") == A_STOP
        match let_go:
            case "zero":
                one.command("a", 0.0, 0.0, 1.3, 1.3)
            case "request":
                one.request("a", 1.3)
            case _:
                one.release("a", 1.3)
        assert one.command("a", *FAST, 1.4, 1.4) and moving(one, 1.4) == FAST


def test_an_interruption_keeps_no_other_source_from_the_wheel() -> None:
    one = commander(a=10, b=10)
    one.command("a", *FAST, 1.0, 1.0)
    one.interrupt(1.1)
    assert one.command("b", *SLOW, 1.2, 1.2)
    one.interrupt(1.3)
    one.interrupt(1.4)
    assert (one.overruled("a"), one.overruled("b")) == (A_STOP, A_STOP)


def test_arming_asks_again_for_programs_and_never_for_hands() -> None:
    one = commander(program=10, hand=50)
    one.command("program", *FAST, 1.0, 1.0)
    one.interrupt(1.1)
    one.hold("hand", *FAST, 1.2, 1.2)
    one.interrupt(1.3)
    one.clear(2.0)
    assert not one.hold("hand", *FAST, 2.1, 2.1)
    assert one.command("program", *FAST, 2.2, 2.2)
    one.release("hand", 2.3)
    assert one.hold("hand", *FAST, 2.4, 2.4)


@pytest.mark.parametrize(("late", "ended"), [(PAUSE - 0.1, False), (PAUSE + 0.1, True)])
def test_commands_that_a_line_held_back_end_the_hold_when_the_stop_was_long(late: float, ended: bool) -> None:
    one = commander(a=30)
    one.command("a", *FAST, 1.0, 1.0)
    now = 1.0 + TIMEOUT + late
    assert not one.command("a", *FAST, 1.05, now), "it is stale"
    assert one.command("a", *FAST, now, now) is not ended
    one.command("a", 0.0, 0.0, now + 0.1, now + 0.1)
    assert one.command("a", *FAST, now + 0.2, now + 0.2)


def test_who_fell_silent_has_let_go() -> None:
    one = commander(a=10)
    one.command("a", *FAST, 1.0, 1.0)
    assert one.command("a", *FAST, 3.0, 3.0)


def test_arming_ends_the_hold_of_a_hand_until_it_lets_go_and_presses_anew() -> None:
    one = commander(keys=50)
    assert one.hold("keys", *FAST, 1.0, 1.0)
    one.clear(1.0)
    assert not one.hold("keys", *FAST, 1.05, 1.05) and moving(one, 1.05) == (0.0, 0.0)
    one.release("keys", 1.1)
    assert one.hold("keys", *FAST, 1.15, 1.15) and moving(one, 1.15) == FAST


@pytest.mark.parametrize("moves", [(0.5, 0.0), (0.0, 0.5)])
def test_who_only_drives_straight_or_only_turns_has_moved_the_robot(moves: tuple[float, float]) -> None:
    one = commander(a=10, b=20)
    one.command("a", *moves, 1.0, 1.0)
    assert one.command("b", *SLOW, 1.0, 1.0) and moving(one, 1.0) == (0.0, 0.0)
    assert one.command("b", *SLOW, 1.0 + HANDOVER, 1.0 + HANDOVER) and moving(one, 1.0 + HANDOVER) == SLOW
