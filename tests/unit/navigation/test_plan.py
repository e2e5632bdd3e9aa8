"""A plan leads to the goal, and its body keeps clear of the walls."""

from itertools import pairwise
from math import hypot, inf, pi
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.maps.files import Map
from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.model.kinematics import wrap_angle
from txt1.model.reeds_shepp import Path as ReedsSheppPath
from txt1.model.reeds_shepp import Pose, Segment, length
from txt1.model.vehicle import Geometry
from txt1.navigation import search, ways
from txt1.navigation.plan import (
    NoPath,
    along,
    cost,
    plan,
    plan_with_run_up,
    stays_inside,
    stretches,
)
from txt1.navigation.search import heading_at
from txt1.navigation.ways import LEAVING
from txt1.sim.room import Room, clearance
from txt1.sim.walls import PLENTY, Walls, walls_of

ROOM = Room(5.0, 5.0)
BODY = Geometry()
places = st.floats(-1.9, 1.9)  # 0.6 m from the walls
poses = st.tuples(places, places, st.floats(-pi, pi))


@given(poses, poses)
def test_it_leads_to_the_goal_inside_the_room(start: Pose, goal: Pose) -> None:
    for make in (plan, plan_with_run_up):
        path = make(start, goal, ROOM, BODY)
        *_, (x, y, theta) = start, *along(start, path, inf)
        assert hypot(x - goal[0], y - goal[1]) < 1e-6
        assert abs(wrap_angle(theta - goal[2])) < 1e-6
        assert stays_inside(start, path, ROOM, BODY)


@given(poses, poses)
def test_it_leaves_the_steering_a_tenth_to_correct_with(start: Pose, goal: Pose) -> None:
    assert all(abs(segment.curvature) <= 1.0 / (1.1 * BODY.radius_min) + 1e-9 for segment in plan(start, goal, ROOM))


def test_without_walls_anything_goes() -> None:
    assert stays_inside((0.0, 0.0, 0.0), (Segment(0.0, 100.0),), None, BODY)
    assert not stays_inside((0.0, 0.0, 0.0), (Segment(0.0, 100.0),), ROOM, BODY)


def test_a_goal_in_a_wall_has_no_path_and_the_message_says_what_to_do() -> None:
    with pytest.raises(NoPath, match=r"no path leads to \(2\.40 m, 0\.00 m, 0 deg\).*farther from the walls"):
        plan((0.0, 0.0, 0.0), (2.4, 0.0, 0.0), ROOM)


def test_a_path_is_cut_where_the_gear_changes() -> None:
    path = (Segment(1.0, 0.3), Segment(0.0, 0.2), Segment(0.0, -0.4), Segment(1.0, 0.5))
    assert [len(part) for part in stretches(path)] == [2, 1, 1]
    assert cost(path) > 1.4


def test_poses_along_a_path_are_as_close_as_asked() -> None:
    start = (0.0, 0.0, 0.0)
    found = [start, *along(start, (Segment(1.0, 1.0), Segment(0.0, -0.3)), 0.05)]
    assert all(hypot(b[0] - a[0], b[1] - a[1]) <= 0.05 + 1e-9 for a, b in pairwise(found))


def test_a_way_round_the_walls_of_a_map_keeps_clear_of_them() -> None:
    room, start = Room(walls=walls_of("flat")), (-0.42, -0.92, 0.0)
    for place in ((5.39, 3.0), (-0.95, 4.13)):
        goal = (*place, heading_at(start, place, room, BODY))
        path = plan(start, goal, room, BODY)
        *_, (x, y, _) = along(start, path, inf)
        assert hypot(x - goal[0], y - goal[1]) < 1e-6
        assert stays_inside(start, path, room, BODY, 0.03)
    with pytest.raises(NoPath):
        plan(start, (20.0, 3.0, 0.0), room, BODY)


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((-0.44, 3.04, -0.65), (-1.71, -0.52, 1.85)),
        ((1.14, 1.54, -2.68), (1.26, 2.46, 0.58)),
        ((5.04, -1.93, -2.41), (-1.19, 2.48, 1.95)),
    ],
)
def test_a_goal_close_to_a_wall_makes_no_narrow_way(start: Pose, goal: Pose) -> None:
    room = Room(walls=walls_of("flat"))
    assert clearance(*goal, room, BODY) < 0.05
    path = plan(start, goal, room, BODY)
    ways = [pose for pose in along(start, path, 0.05) if hypot(pose[0] - goal[0], pose[1] - goal[1]) > LEAVING]
    assert min(clearance(*pose, room, BODY) for pose in ways) >= PLENTY
    assert min(clearance(*pose, room, BODY) for pose in along(start, path, 0.05)) > -1e-3


def test_a_plan_keeps_what_stops_the_robot_and_refuses_a_goal_that_does_not() -> None:
    room, close = Room(walls=walls_of("flat")), (1.26, 2.46, 0.58)
    assert 0.0 < clearance(*close, room, BODY) < 0.05
    with pytest.raises(NoPath, match=r"would stand 0\.0\d m from a wall, and keeps 0\.08 m; choose a goal farther"):
        plan((1.14, 1.54, -2.68), close, room, BODY, 0.08)
    start, goal = (6.97, 5.43, -2.66), (5.93, -0.07, 2.81)
    assert least(start, plan(start, goal, room, BODY, 0.08), room) >= 0.08


def test_11_m_in_the_flat_are_planned_in_half_a_second_of_processor() -> None:
    pytest.importorskip("numba")
    room, start, goal = Room(walls=walls_of("flat")), (6.97, 5.43, -2.66), (5.93, -0.07, 2.81)
    # compiles
    plan(start, goal, room, BODY)
    begun = process_time()
    path = plan(start, goal, room, BODY)
    assert process_time() - begun < 0.5 and length(path) > 9.0


def test_compiled_loops_and_plain_ones_find_the_same_path(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    room, start, goal = Room(walls=walls_of("flat")), (-0.42, -0.92, 0.0), (-0.95, 4.13, 1.6)
    found = plan(start, goal, room, BODY)
    plain = ways.PlannerLoops(ways.stands, ways.arc_is_free, ways.spread, ways.advance, False)
    monkeypatch.setattr(ways, "loops", lambda: plain)
    monkeypatch.setattr(search, "loops", lambda: plain)
    again = plan(start, goal, room, BODY)
    assert [each.distance for each in again] == pytest.approx([each.distance for each in found])


def least(start: Pose, path: ReedsSheppPath, room: Room) -> float:
    return min(clearance(*pose, room, BODY) for pose in along(start, path, 0.05))


def beside_a_box() -> Room:
    """A room of 5 m with a box of 40 cm at (0.05, 0.7)."""
    cells = np.full((100, 100), FREE, np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = OCCUPIED, OCCUPIED, OCCUPIED, OCCUPIED
    cells[60:68, 47:55] = OCCUPIED
    return Room(walls=Walls(Map("box", Path(), Grid(cells, 0.05, (-2.5, -2.5, 0.0)), "")))


def test_a_way_with_room_comes_before_a_shorter_one_that_brushes_a_box() -> None:
    start, goal, room = (-1.4, 1.65, 1.0), (0.91, 1.6, -0.45), beside_a_box()
    path = plan(start, goal, room, BODY)
    assert min(clearance(*pose, room, BODY) for pose in along(start, path, 0.05)) >= PLENTY


@pytest.mark.parametrize("length", [0.9, 1.0])
def test_a_car_between_two_boxes_gets_out_in_several_moves(length: float) -> None:
    cells, half = np.full((80, 80), OCCUPIED, np.int8), round(10.0 * length)
    cells[2:-2, 2:-2] = FREE
    # a bay at the wall, as deep as the car is wide; the car has 51 cm
    cells[2:12, 2 : 40 - half] = cells[2:12, 40 + half : 78] = OCCUPIED
    room = Room(walls=Walls(Map("bay", Path(), Grid(cells, 0.05, (-2.0, -2.0, 0.0)), "")))
    start, goal = (0.0, -1.65, 0.0), (0.5, 1.0, 1.0)
    path = plan(start, goal, room, BODY)
    assert len(stretches(path)) > 1 and stays_inside(start, path, room, BODY)
    *_, (x, y, _) = along(start, path, inf)
    assert hypot(x - goal[0], y - goal[1]) < 1e-6


def test_where_the_laser_does_not_look_back_a_robot_turns_round_to_drive_there() -> None:
    walls = walls_of("kart")
    start, goal = (0.0, 0.0, 0.0), (-4.0, 0.0, 0.0)
    backward = [
        sum(-min(0.0, segment.distance) for segment in plan(start, goal, room, BODY))
        for room in (Room(walls=walls), Room(walls=walls, behind=walls))
    ]
    assert backward == [4.0, pytest.approx(1.9, abs=0.1)]
