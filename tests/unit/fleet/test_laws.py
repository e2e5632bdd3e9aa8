"""The laws of cooperation, with cars on paper: kinematics, R_min and a lag, no robot."""

from itertools import pairwise
from math import cos, hypot, isfinite, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.cars import Cars
from benchmarks.cooperation import amplification, convoy, coverage, rendezvous
from tests.examples import examples
from txt1.config import load
from txt1.errors import ConfigError
from txt1.fleet.convoy import TRACK_MAX, Follower
from txt1.fleet.law import LAWS, make_law
from txt1.fleet.radio import Radio, Said
from txt1.fleet.rendezvous import agree, slot
from txt1.fleet.steering import DEFAULT_BODY, Body, allowed, toward

PLACES = st.floats(-3.0, 3.0)
SAID = st.builds(Said, PLACES, PLACES, st.floats(-pi, pi))
TEAM = ["txt01", "txt02", "txt03"]
FREQUENCIES = st.floats(0.001, 100.0)


@given(FREQUENCIES)
def test_no_spacing_error_grows_from_one_robot_to_the_next(frequency: float) -> None:
    assert amplification(frequency) <= 1.0 + 1e-12


def test_without_a_headway_it_would() -> None:
    assert amplification(1.0, headway=0.0) > 1.05


@pytest.mark.parametrize("seed", range(3))
def test_a_convoy_of_ten_does_not_touch_and_its_errors_shrink_along_the_line(seed: int) -> None:
    spreads, touched, _ = convoy(seed)
    assert touched == 0
    assert all(after <= 1.02 * before + 0.001 for before, after in pairwise(spreads))


def test_a_convoy_whose_leader_is_lost_stands() -> None:
    _, touched, fastest = convoy(1, leader_lost=True)
    assert touched == 0 and fastest < 0.01


@given(st.lists(st.tuples(PLACES, PLACES), min_size=1, max_size=8))
def test_an_estimate_of_the_middle_stays_among_those_it_was_made_of(places: list[tuple[float, float]]) -> None:
    x, y = agree(places[0], places[1:], len(places))
    assert min(p[0] for p in places) - 1e-9 <= x <= max(p[0] for p in places) + 1e-9
    assert min(p[1] for p in places) - 1e-9 <= y <= max(p[1] for p in places) + 1e-9


@given(st.integers(2, 12))
def test_slots_are_far_enough_apart_for_cars(count: int) -> None:
    places = [slot((0.0, 0.0), number, count) for number in range(count)]
    assert min(hypot(a[0] - b[0], a[1] - b[1]) for a in places for b in places if a != b) > 2.0 * DEFAULT_BODY.apart


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_cars_meet_in_slots_whoever_hears_whom(seed: int) -> None:
    _, time, touched = rendezvous(seed)
    assert time is not None and touched == 0


@pytest.mark.long
def test_a_room_is_covered_without_contact() -> None:
    least, touched, nearest = coverage(1, 0.2, 3)
    assert least >= 0.95 and touched == 0 and nearest > 0.64


@given(SAID, st.lists(SAID, max_size=4), st.floats(-0.5, 0.5))
def test_the_allowed_speed_is_no_more_than_was_asked_and_never_turns_round(
    me: Said, others: list[Said], v: float
) -> None:
    limited = allowed(me, v, others, DEFAULT_BODY, (6.0, 6.0))
    assert abs(limited) <= abs(v) + 1e-12 and limited * v >= 0.0


@settings(max_examples=examples(50))
@given(SAID, SAID, st.floats(0.1, 0.5), st.floats(0.1, 0.5))
def test_two_that_drive_at_one_another_each_take_half_of_the_room(one: Said, other: Said, v: float, w: float) -> None:
    for _ in range(100):
        before = hypot(one.x - other.x, one.y - other.y)
        if before < DEFAULT_BODY.apart:
            return
        a, b = allowed(one, v, [other], DEFAULT_BODY), allowed(other, w, [one], DEFAULT_BODY)
        one, other = _moved(one, a), _moved(other, b)
        assert hypot(one.x - other.x, one.y - other.y) >= min(before, DEFAULT_BODY.apart) - 1e-3


def _moved(said: Said, v: float) -> Said:
    return said._replace(x=said.x + 0.02 * v * cos(said.theta), y=said.y + 0.02 * v * sin(said.theta))


@given(SAID, PLACES, PLACES, st.floats(0.1, 2.0))
def test_a_car_is_never_told_to_turn_more_sharply_than_it_can(me: Said, x: float, y: float, radius: float) -> None:
    v, omega = toward(me, x, y, 0.4, DEFAULT_BODY._replace(radius=radius))
    assert abs(omega) <= abs(v) / radius + 1e-9 and isfinite(omega)


DRIVING = st.builds(Said, PLACES, PLACES, st.floats(-pi, pi), st.floats(-2.0, 2.0), st.just(0.0), data=st.just(()))


@settings(max_examples=examples(30), deadline=None)
@pytest.mark.parametrize("law", LAWS)
@given(st.floats(0.3, 1.0), st.floats(0.05, 0.5), DRIVING, st.lists(DRIVING, min_size=2, max_size=2))
def test_each_law_drives_within_the_robot_s_own_circle_and_speed(
    law: str, radius: float, v_max: float, me: Said, others: list[Said]
) -> None:
    mine = make_law("txt02", TEAM, (10.0, 8.0), {"law": law}, Body(radius, v_max, 0.3))
    for _ in range(3):
        v, omega = mine.step(me, dict(zip(("txt01", "txt03"), others, strict=True)), (100.0, 1.0))
        assert abs(v) <= v_max + 1e-12
        assert abs(omega) <= abs(v) / radius + 1e-9


def test_a_body_reaches_to_its_farthest_corner() -> None:
    assert DEFAULT_BODY == (0.56, 1.5, 0.32)
    assert Body.of(load(None, ["vehicle=f1tenth"], {}, {}).config.geometry, 3.0) == (0.742, 3.0, 0.49)


def test_who_is_silent_for_one_law_is_waited_for() -> None:
    law = make_law("txt02", ["txt01", "txt02"], (6.0, 6.0), {"law": "convoy"})
    leader = make_law("txt01", ["txt01", "txt02"], (6.0, 6.0), {"law": "convoy"})
    cars = Cars({"txt01": (1.0, 0.0, 0.0), "txt02": (0.0, 0.0, 0.0)}, {"txt01": leader, "txt02": law})
    cars.lost.add("txt01")
    cars.step()
    assert law.needs == {"txt01"} and cars.said["txt02"].v == 0.0


def test_the_air_has_a_reach() -> None:
    air = Radio(reach=2.0)
    voices = {name: air.voice(name) for name in "abc"}
    for _ in range(2):
        for at, voice in enumerate(voices.values()):
            voice.say(Said(1.5 * at, 0.0, 0.0))
    assert [sorted(voice.heard()) for voice in voices.values()] == [["b"], ["a", "c"], ["b"]]


def test_a_law_that_is_wrong_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"cooperate.law: there is no law 'dance'; choose one of: convoy"):
        make_law("a", ["a"], (5.0, 5.0), {"law": "dance"})
    with pytest.raises(ConfigError, match=r"cooperate: convoy: .*'colour'"):
        make_law("a", ["a"], (5.0, 5.0), {"law": "convoy", "colour": "red"})
    assert set(LAWS) == {"convoy", "rendezvous", "coverage", "search"}


FAR = 1e6  # m: the largest number that is heard
NUMBER = st.floats(-FAR, FAR) | st.floats(-20.0, 20.0)
DATA = st.lists(NUMBER, max_size=6).map(tuple) | st.tuples(*[NUMBER] * 5)
HEARD = st.builds(Said, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, data=DATA)


@settings(max_examples=examples(60), deadline=None)
@pytest.mark.parametrize("law", LAWS)
@given(st.lists(st.dictionaries(st.sampled_from([*TEAM, *"abcdefgh"]), HEARD, max_size=9), min_size=1, max_size=5))
def test_no_law_fails_or_commands_what_is_no_number_whatever_the_others_tell(
    law: str, told: list[dict[str, Said]]
) -> None:
    mine = make_law("txt02", TEAM, (10.0, 8.0), {"law": law})
    me = Said(0.5, 0.5, 0.1)
    heard = {name: Said(1.0, 1.0, 0.0) for name in mine.needs}
    for step, more in enumerate(told):
        heard |= {name: one for name, one in more.items() if name != "txt02"}
        v, omega = mine.step(me._replace(time=0.05 * step), heard, None)
        assert isfinite(v) and isfinite(omega)
        assert all(isfinite(each) for each in mine.data)


def test_a_leader_that_leaps_makes_its_follower_s_track_no_longer_than_memory_has_room() -> None:
    follower = make_law("txt02", TEAM, (10.0, 8.0), {"law": "convoy"})
    for step in range(10):
        x = FAR if step % 2 else -FAR
        follower.step(Said(0.0, 0.0, 0.0, time=0.05 * step), {"txt01": Said(x, x, 0.0)}, None)
    assert isinstance(follower, Follower) and 0 < follower.points <= TRACK_MAX


def test_strangers_who_claim_every_slot_leave_the_team_its_own() -> None:
    mine = make_law("txt02", TEAM, (10.0, 8.0), {"law": "rendezvous"})
    strangers = {name: Said(3.0, 3.0, 0.0, data=(0.0, 0.0, float(at), 1.0, -9.0)) for at, name in enumerate("abc")}
    for step in range(3):
        assert all(map(isfinite, mine.step(Said(0.5, 0.5, 0.1, time=0.05 * step), strangers, None)))
