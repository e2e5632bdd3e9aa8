"""Places of the light, from one set of readings, and surveys."""

from math import inf

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from txt1.model.light_sensors import MOUNT
from txt1_learners.sensor_map import (
    DRIFT,
    HEIGHT,
    NUMBERS,
    PLACES,
    POWER,
    SCALE,
    UNLIKELY,
    Prior,
    Stations,
    by_part,
    corrected,
    followed,
    sighted,
    surveyed,
    told,
    way,
)

SURVEY = np.zeros(NUMBERS)
SURVEY[POWER], SURVEY[PLACES:SCALE], SURVEY[SCALE] = 2.0, np.ravel(MOUNT), 1.0


def read(x: float, y: float, survey: np.ndarray = SURVEY) -> np.ndarray:
    """The log readings of the surveyed sensors with the light at a place, m."""
    apart = survey[PLACES:SCALE].reshape(4, 2) - (x, y)
    return np.asarray(survey[:4] - 0.5 * survey[POWER] * np.log((apart**2).sum(axis=1) + survey[HEIGHT]))


@given(st.floats(0.6, 3.0), st.floats(-3.1, 3.1))
def test_the_light_is_where_the_readings_put_it(distance: float, bearing: float) -> None:
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    (place, cost), *_ = sighted(SURVEY, read(x, y), np.full(4, 1e-4), 0.0)
    assert np.hypot(place[0] - x, place[1] - y) < 0.02 * distance and cost == 0.0


@given(st.lists(st.floats(-7.0, 7.0), min_size=4, max_size=4), st.integers(0, 3))
def test_the_likeliest_place_comes_first_however_ill_readings_fit(z: list[float], dead: int) -> None:
    noise = np.full(4, 1e-4)
    noise[:dead] = inf
    for lights in (
        first := sighted(SURVEY, np.array(z), noise, 0.0),
        followed(first, SURVEY, np.array(z), noise, 0.03, 0.0, 0.1, 0.0, 0.0)[0],
    ):
        costs = [cost for _, cost in lights]
        assert costs[0] == 0.0 and all(0.0 <= cost <= UNLIKELY for cost in costs[1:])


@given(st.floats(0.6, 2.0), st.floats(-3.1, 3.1), st.floats(-1.0, 1.0))
def test_a_light_that_flickers_is_found_by_what_its_readings_do_not_have_in_common(
    distance: float, bearing: float, brighter: float
) -> None:
    x, y, noise = distance * np.cos(bearing), distance * np.sin(bearing), np.full(4, 1e-4)
    z = read(x, y) + brighter
    places = [place for place, _ in sighted(SURVEY, z, noise, 100.0)]
    assert min(np.hypot(place[0] - x, place[1] - y) for place in places) < 0.1 * distance
    near = (x, y, 0.01, 0.01, 0.0)
    (steady_x, steady_y, *_), _, _ = corrected(near, SURVEY, z, noise, 0.0)
    (ahead, left, *_), square, count = corrected(near, SURVEY, z, noise, 100.0)
    assert count == 4 and square < 0.1
    assert np.hypot(ahead - x, left - y) < 0.03 * distance
    # who takes the light for steady takes it for nearer or farther
    assert abs(brighter) < 0.3 or np.hypot(steady_x - x, steady_y - y) > 0.05 * distance


def test_two_sensors_leave_two_places() -> None:
    z, noise = read(1.0, 0.5), np.array([1e-3, 1e-3, inf, inf])
    places = [(x, y) for (x, y, *_), _ in sighted(SURVEY, z, noise, 0.0)]
    assert len(places) == 2 and any(np.hypot(x - 1.0, y - 0.5) < 0.05 for x, y in places)


def standing(rows: np.ndarray) -> Stations:
    """Where a light is that stands still, in one episode."""
    one = np.zeros(len(rows), np.int64)
    return Stations(one, one, np.zeros(len(rows)), 0.0)


def prior(mean: np.ndarray, square: np.ndarray) -> Prior:
    """What is expected where no earlier episode told anything."""
    return Prior(mean, square, mean, np.zeros((2, len(mean), len(mean))))


def driven_past(
    true: np.ndarray, ahead: float, left: float, brighter: np.ndarray, velocity: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """The rows of a drive past a lamp that is so much brighter at each decision, as a logarithm.

    `velocity`: its way in a decision.
    """
    count = len(brighter)
    distance, turn = np.full(count, 0.02), 0.02 * np.sin(np.arange(count) / 15.0)
    x, y, heading = way(distance, turn)
    # the readings belong to the middle of the way
    x, y, heading = x - 0.5 * distance * np.cos(heading), y - 0.5 * distance * np.sin(heading), heading - 0.5 * turn
    c, s = np.cos(heading), np.sin(heading)
    east, north = (np.array([ahead, left]) + np.arange(count)[:, None] * np.array(velocity)).T - (x, y)
    places = np.column_stack([c * east + s * north, c * north - s * east])
    z = np.array([read(*place, true) for place in places]) + brighter[:, None]
    return np.column_stack([distance, turn, z, np.full((count, 4), 1e-4)])


@given(st.floats(0.0, 2.0), st.floats(0.3, 1.0), st.floats(-1.0, 1.0))
def test_a_drive_past_a_lamp_tells_how_high_it_hangs(height: float, ahead: float, left: float) -> None:
    true = SURVEY.copy()
    true[:4], true[HEIGHT] = 5.0, height**2
    rows, mean = driven_past(true, ahead, left, np.zeros(150)), SURVEY.copy()
    square = np.array([0.2] * 4 + [0.1] + [1e-3] * 8 + [1e-3, 1e-3, 1.0]) ** 2
    guess = np.array([[0.5, 0.2]])
    survey, lights, _, _ = surveyed(rows, standing(rows), mean, guess, prior(mean, square), 0.0, 60)
    assert abs(np.sqrt(survey[HEIGHT]) - height) < 0.15
    assert np.hypot(*(lights[0] - (ahead, left))) < 0.05


@given(st.floats(0.3, 1.0), st.floats(-1.0, 1.0), st.integers(0, 99))
def test_a_lamp_that_flickers_does_not_mislead_a_survey_that_knows_of_it(ahead: float, left: float, seed: int) -> None:
    true, noise = SURVEY.copy(), np.random.default_rng(seed).normal(0.0, 0.5, 150)
    true[:4] = 5.0, 5.2, 4.9, 5.1
    rows, mean = driven_past(true, ahead, left, noise), SURVEY.copy()
    square = np.array([0.2] * 4 + [0.1] + [1e-3] * 11) ** 2
    mean[:4] = 4.5
    stations, guess = standing(rows), np.array([[ahead + 0.1, left - 0.1]])
    survey, lights, cost, _ = surveyed(rows, stations, mean, guess, prior(mean, square), 0.25, 60)
    assert np.hypot(*(lights[0] - (ahead, left))) < 0.02
    assert np.ptp(survey[:4] - true[:4]) < 0.02
    assert cost < 0.1 * surveyed(rows, stations, mean, guess, prior(mean, square), 0.0, 60)[2]


def test_a_survey_finds_how_a_light_moves_on() -> None:
    true = SURVEY.copy()
    rows, count = driven_past(true, 1.0, 0.5, np.zeros(101), (0.004, -0.003)), 101
    since = np.arange(count)
    stations = Stations(np.zeros(count, np.int64), since // 50, since % 50 / 50, 1.0)
    square = np.array([0.2] * 4 + [0.1] + [1e-3] * 8 + [1e-3] * 3) ** 2
    _, lights, _, _ = surveyed(rows, stations, true, np.full((4, 2), (1.1, 0.4)), prior(true, square), 0.0, 60)
    # the last station is beyond the last row
    assert np.allclose(lights[:3], [(1.0, 0.5), (1.2, 0.35), (1.4, 0.2)], atol=0.03)


def known_after(true: np.ndarray, square: np.ndarray) -> Prior:
    """What a drive past a lamp told of a robot."""
    rows = driven_past(true, 1.0, 0.5, np.zeros(150))
    light = np.array([[1.0, 0.5]])
    survey, lights, _, _ = surveyed(rows, standing(rows), true, light, prior(true, square), 0.0, 20)
    information, product = told(rows, standing(rows), survey, lights, 0.0)
    known = np.linalg.solve(information + np.diag(1.0 / square), product + true / square)
    return Prior(SURVEY, square, known, by_part(information))


WEAK = np.array([0.2] * 4 + [0.7] + [0.3] * 8 + [0.1, 0.01, 0.1]) ** 2


def test_what_an_episode_told_makes_up_for_a_short_one() -> None:
    true = SURVEY.copy()
    true[:5] = 5.0, 5.2, 4.9, 5.1, 2.2
    rng, errors = np.random.default_rng(3), []
    rows = driven_past(true, 0.8, -0.6, np.zeros(20))
    rows[:, 2:6] += rng.normal(0.0, 0.01, (20, 4))
    for before in (prior(SURVEY, WEAK), known_after(true, WEAK)):
        survey = surveyed(rows, standing(rows), before.known, np.array([[0.7, -0.5]]), before, 0.0, 60)[0]
        errors.append(np.abs(survey - true)[PLACES:SCALE].max())
    assert errors[1] < 0.05 < errors[0]


def test_what_an_episode_told_gives_way_where_the_sensors_have_changed_places() -> None:
    before = known_after(SURVEY, WEAK)
    true = SURVEY.copy()
    true[PLACES:SCALE] = -SURVEY[PLACES:SCALE]
    rows = driven_past(true, 0.8, -0.6, np.zeros(150))
    survey = surveyed(rows, standing(rows), true, np.array([[0.8, -0.6]]), before, 0.0, 60)[0]
    assert np.allclose(survey[PLACES:SCALE], true[PLACES:SCALE], atol=0.03)


def test_odometry_that_changes_does_not_make_one_doubt_the_sensors() -> None:
    sensors, odometry = known_after(SURVEY, WEAK).information
    off = np.zeros(len(SURVEY))
    off[[SCALE, DRIFT]] = 0.2, 0.02
    assert off @ sensors @ off == 0.0 < off @ odometry @ off


def test_the_bearing_of_a_light_far_away_is_mostly_within_two_of_its_sigmas() -> None:
    rng, errors = np.random.default_rng(1), []
    for bearing in rng.uniform(-np.pi, np.pi, 100):
        z, noise = read(6.0 * np.cos(bearing), 6.0 * np.sin(bearing)), np.full(4, 0.01)
        lights = sighted(SURVEY, z + rng.normal(0.0, 0.1, 4), noise, 0.0)
        for _ in range(20):
            lights, _, _ = followed(lights, SURVEY, z + rng.normal(0.0, 0.1, 4), noise, 0.0, 0.0, 0.0, 0.0, 0.0)
        (x, y, xx, yy, xy), _ = lights[0]
        error = np.angle(np.exp(1j * (np.arctan2(y, x) - bearing)))
        errors.append(error / np.sqrt(y * y * xx + x * x * yy - 2.0 * x * y * xy) * (x * x + y * y))
    assert np.mean(np.abs(errors) < 2.0) > 0.7
