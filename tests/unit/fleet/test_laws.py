"""The laws of cooperation, with cars on paper: kinematics, R_min and a lag, no robot."""

from itertools import pairwise
from math import hypot, isfinite, pi
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.cars import Cars, CarShape, shape_of
from benchmarks.cooperation import amplification, convoy, coverage, rendezvous
from benchmarks.fleet import paper
from tests.examples import examples
from txt1.errors import ConfigError
from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.convoy import TRACK_MAX, Follower
from txt1.fleet.guard import CLOSING_RATE, ROBOT_MARGIN, TeamGuard
from txt1.fleet.law import LAWS, make_law
from txt1.fleet.messages import CAR_SIZE_MAX
from txt1.fleet.radio import Radio, Said
from txt1.fleet.rendezvous import agree, slot
from txt1.fleet.steering import toward

PLACES = st.floats(-3.0, 3.0)
SAID = st.builds(Said, PLACES, PLACES, st.floats(-pi, pi))
TEAM = ["txt01", "txt02", "txt03"]
VEHICLES = ("txt1", "f1tenth", "donkeycar", "rover")
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
    assert min(hypot(a[0] - b[0], a[1] - b[1]) for a in places for b in places if a != b) > 2.0 * (
        2.0 * DEFAULT_BODY.reach + ROBOT_MARGIN
    )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_cars_meet_in_slots_whoever_hears_whom(seed: int) -> None:
    _, time, touched = rendezvous(seed)
    assert time is not None and touched == 0


@pytest.mark.long
def test_a_room_is_covered_without_contact() -> None:
    least, touched, nearest = coverage(1, 0.2, 3)
    assert least >= 0.95 and touched == 0 and nearest > 0.64


@pytest.mark.parametrize(("team", "seed"), [("txt1", 11), ("f1tenth", 14), ("f1tenth", 15)])
def test_robots_that_come_to_the_light_from_one_side_stand_behind_one_another(team: str, seed: int) -> None:
    assert paper("search", team, seed) == (0, 0), "no contact, and nobody is stuck"


@given(SAID, st.lists(SAID, max_size=4), st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
def test_the_guard_lets_a_share_through_and_says_who_holds_back(
    me: Said, others: list[Said], v: float, omega: float
) -> None:
    guard = TeamGuard(DEFAULT_BODY, (6.0, 6.0))
    left, turn = guard.step(me, dict(zip("abcd", others, strict=False)), v, omega)
    assert abs(left) <= abs(v) + 1e-12 and left * v >= 0.0
    assert left * omega == pytest.approx(turn * v, abs=1e-9), "the curvature stays"
    assert (guard.by != "") is (left != v or turn != omega)


BODIES = [shape_of(each).body for each in VEHICLES]


@settings(max_examples=examples(40), deadline=None)
@given(st.sampled_from(BODIES), st.sampled_from(BODIES), st.integers(0, 2**32))
def test_two_guarded_cars_whose_law_is_chance_touch_neither_each_other_nor_a_wall(
    one: Body, other: Body, seed: int
) -> None:
    class Chance:
        needs: frozenset[str] = frozenset()
        data: tuple[float, ...] = ()

        def __init__(self, body: Body, seed: int) -> None:
            self._random, self._body, self._left, self._wants = Random(seed), body, 0, (0.0, 0.0)

        def step(self, *_: object) -> tuple[float, float]:
            self._left -= 1
            if self._left < 0:
                v = self._random.uniform(-0.8, 0.8)
                self._left, self._wants = (
                    self._random.randint(1, 40),
                    (v, self._random.uniform(-1, 1) * v / self._body.radius),
                )
            return self._wants

    bodies = {"a": one, "b": other}
    laws = {name: Chance(body, seed + at) for at, (name, body) in enumerate(bodies.items())}
    shapes = {name: CarShape(body, 1.4 * body.reach, 1.4 * body.reach) for name, body in bodies.items()}
    cars = Cars({"a": (-0.7, 0.0, 0.0), "b": (0.7, 0.0, 3.0)}, laws, room=(3.5, 3.5), shapes=shapes)
    for _ in cars.run(30.0):
        assert cars.touching() == []


def test_a_guard_holds_one_that_a_law_drives_at_a_wall_or_at_one_that_stands() -> None:
    for at in (Said(2.0, 0.0, 0.0, 1.0), Said(-2.0, 0.0, 0.0, -1.0)):
        guard = TeamGuard(DEFAULT_BODY, (5.0, 5.0))
        assert guard.step(at, {}, at.v, 0.0) == (0.0, 0.0) and guard.by == "a wall"
    free = Said(0.0, 0.0, 0.0)
    assert TeamGuard(DEFAULT_BODY).step(free, {"b": Said(0.78, 0.0, 0.0)}, 0.5, 0.0)[0] == pytest.approx(
        CLOSING_RATE * 0.02
    )
    assert TeamGuard(DEFAULT_BODY).step(free, {"b": Said(0.78, 0.0, 0.0)}, -0.5, 0.0) == (-0.5, 0.0)
    assert TeamGuard(DEFAULT_BODY._replace(least=0.15)).step(free, {"b": Said(0.78, 0.0, 0.0)}, 0.5, 0.0) == (0.0, 0.0)


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
    assert DEFAULT_BODY == (0.56, 1.5, 0.32, 0.0, 0.0, False)
    assert shape_of("f1tenth").body == (0.742, 3.0, 0.33, 0.165, 0.0, False)
    assert shape_of("rover").body.pivots and shape_of("donkeycar").body.least == 0.15


def test_each_car_s_own_speed_is_a_share_of_its_fastest_and_not_less_than_it_can() -> None:
    assert DEFAULT_BODY.speed(0.2) == pytest.approx(0.3)
    slow = shape_of("donkeycar").body
    assert slow.speed(0.01) == slow.least and slow.speed(0.2, 5.0) == slow.v_max


def test_a_leader_drives_as_the_slowest_and_the_widest_of_its_convoy_can() -> None:
    leader = make_law("txt01", TEAM, (10.0, 8.0), {"law": "convoy", "radius": 0.6})
    wide = Said(-2.0, 0.0, 0.0, body=DEFAULT_BODY._replace(v_max=0.3, radius=1.0))
    v, omega = leader.step(Said(0.0, 0.0, 0.0), {"txt02": wide}, None)
    assert v == pytest.approx(0.1) and omega == pytest.approx(v / 1.1)
    with pytest.raises(ConfigError, match=r"cooperate\.radius: 0\.3 m; the leader's smallest is 0\.56 m"):
        make_law("txt01", TEAM, (10.0, 8.0), {"law": "convoy", "radius": 0.3})


def test_a_leader_s_circle_has_room_for_the_whole_line() -> None:
    team, rover = ["one", "two", "three", "four"], shape_of("rover")
    settings = {"law": "convoy", "radius": 0.47}
    laws = {name: make_law(name, team, (6.0, 6.0), settings, rover.body) for name in team}
    starts = {name: (-0.6 * number, -0.5, 0.0) for number, name in enumerate(team)}
    cars = Cars(starts, laws, room=(6.0, 6.0), shapes=dict.fromkeys(team, rover))
    speeds = [cars.said["one"].v for time in cars.run(60.0) if time > 30.0]
    assert min(speeds) > 0.2, "it does not meet the tail of its own convoy"


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
DATA = st.lists(NUMBER, max_size=6).map(tuple) | st.tuples(*[NUMBER] * 6)
SIZE = st.floats(0.0, CAR_SIZE_MAX, exclude_min=True)
# what a message may tell of a car (`txt1.fleet.messages`)
BODY = st.builds(
    lambda radius, v_max, reach, centre, share, pivots: Body(radius, v_max, reach, centre, share * v_max, pivots),
    *(SIZE, SIZE, SIZE, st.floats(-CAR_SIZE_MAX, CAR_SIZE_MAX), st.floats(0.0, 1.0), st.booleans()),
)
HEARD = st.builds(Said, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, time=NUMBER, data=DATA, body=BODY)


@settings(max_examples=examples(30), deadline=None)
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


def test_a_leader_that_leaps_makes_its_follower_s_track_no_longer_than_fits() -> None:
    follower = make_law("txt02", TEAM, (10.0, 8.0), {"law": "convoy"})
    for step in range(10):
        x = FAR if step % 2 else -FAR
        follower.step(Said(0.0, 0.0, 0.0, time=0.05 * step), {"txt01": Said(x, x, 0.0)}, None)
    assert isinstance(follower, Follower) and 0 < follower.points <= TRACK_MAX


def test_strangers_who_claim_every_slot_leave_the_team_its_own() -> None:
    mine = make_law("txt02", TEAM, (10.0, 8.0), {"law": "rendezvous"})
    strangers = {name: Said(3.0, 3.0, 0.0, data=(0.0, 0.0, float(at), 1.0, -9.0, 0.3)) for at, name in enumerate("abc")}
    for step in range(3):
        assert all(map(isfinite, mine.step(Said(0.5, 0.5, 0.1, time=0.05 * step), strangers, None)))
