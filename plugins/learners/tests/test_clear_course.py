"""The quickest course that keeps clear of what the laser has seen. All long, as numba has to compile it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.patience import LIMIT
from txt1_learners.clear_course import (
    MARGIN,
    ActionPlan,
    SeenPoints,
    body_of,
    clear_along,
    clearest,
    distances,
    quickest_clear,
    room,
)
from txt1_learners.planner import Array

RADIUS = 0.56  # of the sharpest turn, m
STEP = 0.03  # m in a decision
K = np.zeros(2)  # an action acts at once
C = np.array([[STEP, STEP, STEP, 0.0], [-1.0 / RADIUS, 0.0, 1.0 / RADIUS, 0.0]])  # right, straight, left, none
RIGHT, STRAIGHT, LEFT = range(3)
BODY = body_of(0.51, 0.385, 0.0)
NONE = np.zeros(0, np.int64)
FRESH = (0, -1, 0, 0, 0)  # no plan before
LIGHT = (2.2, 0.0, 1e-6, 1e-6, 0.0)

pytestmark = pytest.mark.long


def post(x: float, y: float, radius: float = 0.05) -> Array:
    """Points round a post."""
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    return np.column_stack((x + radius * np.cos(angles), y + radius * np.sin(angles)))


def planned(points: Array, before: tuple[int, int, int, int, int] = FRESH) -> ActionPlan:
    """The plan to a light 2.2 m ahead, driving straight ahead with nothing under way."""
    return ActionPlan(*quickest_clear(LIGHT, STEP, 0.0, NONE, K, C, 1.0, 0.5, 0.03, distances(points), BODY, before))


def least_room(plan: ActionPlan, points: Array) -> float:
    """The least room on the way of a plan, m."""
    pose, least, grid = (0.0, 0.0, 0.0, STEP, 0.0), np.inf, distances(points)
    for action, count in ((plan.a, plan.m), (plan.b, plan.n), (plan.e, int(plan.time) - plan.m - plan.n)):
        pose, least = clear_along(pose, action, count, K, C, 1.0, grid, BODY, least)
    return float(least)


def test_the_discs_cover_the_body_and_little_more() -> None:
    grid = distances(np.array([[0.5, 0.0]]))
    assert room(grid, BODY, 0.0, 0.0, 0.0) == pytest.approx(0.5 - 0.17 - BODY.radius, abs=0.02)
    assert room(distances(np.array([[0.255, 0.1925]])), BODY, 0.0, 0.0, 0.0) == pytest.approx(0.0, abs=0.03)


def test_a_post_in_the_way_is_driven_round_and_another_changes_nothing() -> None:
    aside = planned(post(1.0, 0.9))
    assert aside.time == pytest.approx(1.7 / STEP, abs=0.5)
    assert (aside.a, aside.e) == (STRAIGHT, STRAIGHT)
    ahead = post(1.1, 0.0)
    found = planned(ahead)
    assert 1.7 / STEP < found.time < 1.3 * 1.7 / STEP
    assert least_room(found, ahead) > MARGIN - 0.01


def test_it_goes_round_on_the_side_with_the_shorter_way() -> None:
    assert planned(post(1.1, 0.1)).a == RIGHT or planned(post(1.1, 0.1)).b == RIGHT
    assert planned(post(1.1, -0.1)).a == LEFT or planned(post(1.1, -0.1)).b == LEFT


def test_the_rest_of_a_plan_is_as_good_a_decision_later() -> None:
    points = post(1.1, 0.05)
    found = planned(points)
    pose, _ = clear_along((0.0, 0.0, 0.0, STEP, 0.0), found.a, 1, K, C, 1.0, distances(points), BODY, np.inf)
    x, y, heading = pose[:3]
    c, s = np.cos(heading), np.sin(heading)

    def here(places: Array) -> Array:
        east, north = places[:, 0] - x, places[:, 1] - y
        return np.column_stack((c * east + s * north, c * north - s * east))

    ahead, left = here(np.array([LIGHT[:2]]))[0]
    light = (float(ahead), float(left), 1e-6, 1e-6, 0.0)
    later = found.later()
    grid = distances(here(points))
    next_one = ActionPlan(*quickest_clear(light, *pose[3:], NONE, K, C, 1.0, 0.5, 0.03, grid, BODY, later[:5]))
    assert next_one.cost <= found.cost - 0.5


def test_the_rest_of_a_plan_begins_with_the_piece_in_force() -> None:
    plan = ActionPlan(LEFT, 2, RIGHT, 3, STRAIGHT, 40.0, 40.0)
    pieces = []
    for _ in range(6):
        pieces.append(plan.a if plan.m else plan.e)
        plan = plan.later()
    assert pieces == [LEFT, LEFT, RIGHT, RIGHT, RIGHT, STRAIGHT]


def test_without_a_light_an_action_that_leads_into_a_post_is_not_taken() -> None:
    grid = distances(post(0.95, 0.0))
    assert clearest(STRAIGHT, STEP, 0.0, NONE, K, C, 1.0, distances(post(3.0, 3.0)), BODY) == (STRAIGHT, MARGIN)
    taken, room = clearest(LEFT, STEP, 0.0, NONE, K, C, 1.0, grid, BODY)
    _, least = clear_along((0.0, 0.0, 0.0, STEP, 0.0), taken, 100, K, C, 1.0, grid, BODY, np.inf)
    assert least >= room > 0.04


def test_where_every_way_is_narrow_it_takes_the_widest() -> None:
    begin = (0.0, 0.0, 0.0, STEP, 0.0)

    def widest(action: int, grid: Array) -> float:
        """The least room on the best way that begins with an action, m; below 0: it touches."""
        there, low = clear_along(begin, action, 2, K, C, 1.0, grid, BODY, np.inf, 0.0)
        return max(float(clear_along(there, b, 100, K, C, 1.0, grid, BODY, low, 0.0)[1]) for b in range(3))

    narrow = 0
    for x, y in ((x, y) for x in np.arange(0.6, 0.8, 0.02) for y in np.arange(-0.3, 0.3, 0.02)):
        grid = distances(post(x, y))
        ways = [widest(action, grid) for action in range(3)]
        if 0.0 < max(ways) < 0.04:
            narrow += 1
            for wanted in range(3):
                taken, room = clearest(wanted, STEP, 0.0, NONE, K, C, 1.0, grid, BODY)
                assert ways[taken] == max(ways) == pytest.approx(room)
    assert narrow >= 3


def test_what_was_seen_stays_where_it_is_while_the_robot_turns_and_drives() -> None:
    seen = SeenPoints()
    seen.add(np.array([[1.0, 0.5]]), (0.0, 0.0, 0.0), hide=False)
    seen.move(0.2, 0.0)
    assert seen.near() == pytest.approx(np.array([[0.8, 0.5]]))
    seen.move(0.0, np.pi / 2)
    assert seen.near() == pytest.approx(np.array([[0.5, -0.8]]))
    seen.add(np.array([[0.7, 0.0]]), (0.2, 0.0, 0.0), hide=False)  # seen 0.2 m before here
    assert np.any(np.all(np.isclose(seen.near(), [0.5, 0.0]), axis=1))


def test_places_behind_what_the_newest_sweep_saw_are_no_way() -> None:
    seen = SeenPoints()
    seen.add(np.array([[0.0, 1.0]]), (0.0, 0.0, 0.0))
    assert sorted(seen.near()[:, 1]) == pytest.approx([1.0, 1.1, 1.2, 1.3])
    # the robot has driven on, and now sees the side of it
    seen.move(1.0, 0.0)
    seen.add(np.array([[-1.0, 1.02]]), (0.0, 0.0, 0.0))
    behind = seen.near()
    assert not np.any(np.all(np.isclose(behind, [-1.0, 1.3]), axis=1)), "that was hidden from there only"
    assert np.any(np.all(np.isclose(behind, [-1.0, 1.0]), axis=1)), "what was seen stays"


PROGRAM = """
import sys
from txt1.cli import execute
from txt1_learners import clear_course, pilot

def compiled():
    return [len(one.signatures) for one in (clear_course.distances, clear_course.quickest_clear, clear_course.clearest)]

def noted(**given):
    compile(**given)
    before.append(compiled())

before, compile, pilot._compile = [], pilot._compile, noted
words = "learn --agent pilot --trials 1 --episodes 2 --jobs 1 --no-pictures --out".split() + sys.argv[1:]
assert execute(words) == 0
assert before and set(map(tuple, before)) == {tuple(compiled())} == {(1, 1, 1)}, (before, compiled())
"""
POSTS = "[{kind: post, x: 1.0, y: 0.3, radius: 0.05}, {kind: post, x: -1.0, y: 0.3, radius: 0.05}]"


def test_no_decision_waits_for_a_compiler(tmp_path: Path) -> None:
    """It took four seconds when the laser saw the first obstacle, in which a robot in real time is disarmed."""
    settings = ("learning.start_radius=2.2", "learning.boundary=4", "sensors.laser.driver=sim_laser")
    words = [word for one in (*settings, f"sim.obstacles={POSTS}") for word in ("--set", one)]
    subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path / "out"), *words], check=True, timeout=LIMIT)
