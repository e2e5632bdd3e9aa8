"""Places of the light, from one set of readings."""

from math import inf

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from txt1.learning.sensor_map import NUMBERS, PLACES, POWER, SCALE, UNLIKELY, followed, sighted
from txt1.model.light_sensors import MOUNT

SURVEY = np.zeros(NUMBERS)
SURVEY[POWER], SURVEY[PLACES:SCALE], SURVEY[SCALE] = 2.0, np.ravel(MOUNT), 1.0


def read(x: float, y: float, survey: np.ndarray = SURVEY) -> np.ndarray:
    """The log readings of the surveyed sensors with the light at a place, m."""
    apart = survey[PLACES:SCALE].reshape(4, 2) - (x, y)
    return np.asarray(survey[:4] - survey[POWER] * np.log(np.hypot(*apart.T)))


@given(st.floats(0.6, 3.0), st.floats(-3.1, 3.1))
def test_the_light_is_where_the_readings_put_it(distance: float, bearing: float) -> None:
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    (place, cost), *_ = sighted(SURVEY, read(x, y), np.full(4, 1e-4))
    assert np.hypot(place[0] - x, place[1] - y) < 0.02 * distance and cost == 0.0


@given(st.lists(st.floats(-7.0, 7.0), min_size=4, max_size=4), st.integers(0, 3))
def test_the_likeliest_place_comes_first_however_ill_readings_fit(z: list[float], dead: int) -> None:
    noise = np.full(4, 1e-4)
    noise[:dead] = inf
    for lights in (
        first := sighted(SURVEY, np.array(z), noise),
        followed(first, SURVEY, np.array(z), noise, 0.03, 0.0, 0.1)[0],
    ):
        costs = [cost for _, cost in lights]
        assert costs[0] == 0.0 and all(0.0 <= cost <= UNLIKELY for cost in costs[1:])


def test_two_sensors_leave_two_places() -> None:
    z, noise = read(1.0, 0.5), np.array([1e-3, 1e-3, inf, inf])
    places = [(x, y) for (x, y, *_), _ in sighted(SURVEY, z, noise)]
    assert len(places) == 2 and any(np.hypot(x - 1.0, y - 0.5) < 0.05 for x, y in places)
