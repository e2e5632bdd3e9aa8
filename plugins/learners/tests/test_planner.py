"""The quickest course to the light: on average over what is not known. All long, as numba has to compile it."""

import numpy as np
import pytest

from txt1_learners.planner import Array, quickest

RADIUS = 0.56  # of the sharpest turn, m
STEP = 0.03  # m in a decision
K = np.zeros(2)  # an action acts at once
C = np.array([[STEP, STEP, STEP, 0.0], [-1.0 / RADIUS, 0.0, 1.0 / RADIUS, 0.0]])  # right, straight, left, none
RIGHT, STRAIGHT, LEFT = range(3)
CIRCLE = 2.0 * np.pi * RADIUS / STEP  # decisions of a full turn

pytestmark = pytest.mark.long


def times(ahead: float, left: float, goal: float = 0.5, doubt: float = 0.01, c: Array = C) -> Array:
    """Decisions to the goal by each first action, driving straight ahead with nothing under way."""
    light, none = (ahead, left, 0.0, 0.0, 0.0), np.zeros(0, np.int64)
    found: Array = quickest(light, STEP, 0.0, none, K, c, 1.0, goal, doubt)
    return found


def test_a_light_ahead_is_driven_to_straight_on_and_one_beside_by_a_turn() -> None:
    assert times(1.25, 0.0).argmin() == STRAIGHT
    assert times(1.25, 0.0).min() == pytest.approx((1.25 - 0.5) / STEP, abs=0.1)
    assert times(0.3, 1.5).argmin() == LEFT
    assert times(0.3, -1.5) == pytest.approx(times(0.3, 1.5)[::-1])


@pytest.mark.parametrize("distance", [3.0, 6.0, 20.0])
def test_a_light_far_to_the_left_is_turned_to_and_takes_as_long_as_its_distance(distance: float) -> None:
    found = times(0.0, distance)
    assert found.argmin() == LEFT
    assert (distance - 0.5 - 2.0 * RADIUS) / STEP < found.min() < (distance - 0.5 + 2.0 * RADIUS) / STEP


def test_a_light_behind_is_backed_to_where_an_action_does_that() -> None:
    back = C.copy()
    back[0, STRAIGHT] = -STEP
    assert times(-1.25, 0.0, c=back).min() == pytest.approx((1.25 - 0.5) / STEP, abs=0.5)
    back[0, LEFT] = -STEP  # which brings the tail round to the left
    to_left, to_right = (times(-0.9, left, c=back)[LEFT] for left in (0.9, -0.9))
    assert to_left < to_right


def test_with_a_light_ahead_or_behind_a_turn_costs_least_until_it_is_known() -> None:
    ahead, behind = times(1.25, 0.0), times(-1.25, 0.0)
    assert ahead.argmin() == STRAIGHT
    assert (0.5 * (ahead + behind)).argmin() != STRAIGHT


def grazed(deep: float, decisions: float, goal: float = 0.35) -> tuple[float, float]:
    """A light whose goal the left circle enters by so much, in so many decisions from here."""
    rho = RADIUS - goal + deep  # from the circle's centre
    enters = np.arccos((RADIUS**2 + rho**2 - goal**2) / (2.0 * RADIUS * rho))
    angle = enters + decisions * STEP / RADIUS
    return float(rho * np.sin(angle)), float(RADIUS - rho * np.cos(angle))


@pytest.mark.parametrize("decisions", [4.0, 12.0])
def test_a_course_that_grazes_the_goal_is_taken_to_miss_it_near_by_as_from_afar(decisions: float) -> None:
    surely = times(*grazed(0.05, decisions), goal=0.35)[LEFT]
    hardly = times(*grazed(0.002, decisions), goal=0.35)[LEFT]
    assert surely == pytest.approx(decisions, abs=0.5)
    assert hardly - surely > 0.2 * CIRCLE
