"""Reeds-Shepp paths lead where they should, and none is shorter than geometry allows."""

from math import hypot, inf, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.model.kinematics import wrap_angle
from txt1.model.reeds_shepp import Path, Pose, Segment, length, paths
from txt1.navigation.plan import along

R = 0.56
places = st.floats(-3.0, 3.0, allow_nan=False)
poses = st.tuples(places, places, st.floats(-pi, pi, allow_nan=False))


def shortest(start: Pose, goal: Pose, radius: float) -> Path:
    return paths(start, goal, radius)[0]


@given(poses, poses)
def test_every_path_ends_at_the_goal(start: Pose, goal: Pose) -> None:
    for path in paths(start, goal, R):
        *_, (x, y, theta) = start, *along(start, path, inf)
        assert hypot(x - goal[0], y - goal[1]) < 1e-6
        assert abs(wrap_angle(theta - goal[2])) < 1e-6


@given(poses, poses)
def test_the_shortest_is_no_shorter_than_the_way_and_the_turn(start: Pose, goal: Pose) -> None:
    least = length(shortest(start, goal, R))
    assert least >= hypot(goal[0] - start[0], goal[1] - start[1]) - 1e-9
    assert least >= R * abs(wrap_angle(goal[2] - start[2])) - 1e-9


@given(poses, poses)
def test_the_way_back_is_as_long(start: Pose, goal: Pose) -> None:
    assert length(shortest(start, goal, R)) == pytest.approx(length(shortest(goal, start, R)), abs=1e-6)


@given(poses, poses, poses)
def test_no_detour_is_shorter(start: Pose, goal: Pose, via: Pose) -> None:
    detour = length(shortest(start, via, R)) + length(shortest(via, goal, R))
    assert length(shortest(start, goal, R)) <= detour + 1e-6


@given(poses, poses)
def test_no_segment_turns_more_sharply_than_the_car(start: Pose, goal: Pose) -> None:
    assert all(abs(segment.curvature) <= 1.0 / R + 1e-12 for path in paths(start, goal, R) for segment in path)


def test_straight_ahead_is_a_straight_line_and_behind_is_driven_backward() -> None:
    assert shortest((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), R) == (Segment(0.0, pytest.approx(1.0)),)
    assert shortest((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), R) == (Segment(0.0, pytest.approx(-1.0)),)


def test_a_quarter_turn_is_one_arc() -> None:
    assert shortest((0.0, 0.0, 0.0), (R, R, pi / 2.0), R) == (Segment(1.0 / R, pytest.approx(R * pi / 2.0)),)


def test_turning_round_on_the_spot_takes_three_arcs_of_60_degrees() -> None:
    path = shortest((0.0, 0.0, 0.0), (0.0, 0.0, pi), R)
    assert [abs(segment.distance) for segment in path] == pytest.approx([R * pi / 3.0] * 3)


def test_to_where_one_stands_is_no_way() -> None:
    assert length(shortest((1.0, 2.0, 3.0), (1.0, 2.0, 3.0), R)) == pytest.approx(0.0, abs=1e-9)
