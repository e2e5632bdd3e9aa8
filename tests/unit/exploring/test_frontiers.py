"""Frontiers on grids: the borders of the unknown, and the poses from which a car looks at them."""

from math import atan2, hypot
from pathlib import Path

import numpy as np
import pytest

from txt1.exploring.frontiers import best_view, frontiers
from txt1.mapping.seen_floor import QuickGrid
from txt1.maps.files import Map
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from txt1.maps.rays import cast
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import Geometry
from txt1.sim.room import Room
from txt1.sim.walls import Walls

BODY = Geometry()
KEEP = 0.08
START = (1.0, 1.5, 0.0)


def seen(door: float, aside: bool = False) -> Grid:
    """Return a room of 4 m x 3 m with a door in the middle of its right wall, at x = 4 m; behind it is the unknown, or
    `aside`, behind a wall at x = 5 m, floor that leads to the unknown round the corner.
    """
    cells = np.full((80, 140), UNKNOWN, np.int8)
    cells[9:71, 9:91] = OCCUPIED
    cells[10:70, 10:90] = FREE
    half = round(10 * door)
    cells[40 - half : 40 + half, 90] = FREE
    if aside:
        cells[2:78, 91:111] = FREE
        cells[2:78, 111] = OCCUPIED
    return QuickGrid(cells, 0.05, (-0.5, -0.5, 0.0))


def room(grid: Grid) -> Room:
    return Room(walls=Walls(Map("seen", Path(), grid, "")))


def test_an_open_door_is_the_frontier_of_a_room_and_the_car_looks_at_it():
    grid = seen(door=1.0)
    (door,) = frontiers(grid)
    assert hypot(door.middle[0] - 4.0, door.middle[1] - 1.5) < 0.15
    # as much of the door as is away from its posts
    assert 0.5 < door.length < 1.0
    view = best_view([door], START, room(grid), BODY, KEEP)
    assert view is not None and view.frontier is door
    x, y, theta = view.pose
    assert room(grid).walls.clearance(x, y, theta, BODY) >= KEEP  # type: ignore[union-attr]
    assert abs(wrap_angle(atan2(door.middle[1] - y, door.middle[0] - x) - theta)) < 1.1


def test_a_closed_room_has_no_frontier_though_its_walls_have_gaps():
    grid = seen(door=1.0)
    grid.cells[30:50, 90] = OCCUPIED
    assert frontiers(grid) == []
    # the laser's noise leaves gaps in a wall
    grid.cells[12:68:3, 90] = FREE
    assert frontiers(grid) == []


def test_a_frontier_behind_a_gap_too_narrow_for_the_car_is_out_of_reach():
    for door, reached in ((1.0, True), (0.4, False)):
        grid = seen(door, aside=True)
        there = [each for each in frontiers(grid) if each.middle[0] > 4.0]
        assert len(there) == 2
        assert (best_view(there, START, room(grid), BODY, KEEP) is not None) is reached


def test_a_frontier_is_known_when_the_floor_behind_was_seen_and_gone_when_it_moved():
    grid = seen(door=1.0)
    (door,) = frontiers(grid)
    assert not door.known(grid) and not door.gone(grid)
    cells = grid.cells.copy()
    cells[25:55, 91:95] = FREE
    grid = QuickGrid(cells, grid.resolution, grid.origin)
    assert door.known(grid) and not door.gone(grid)
    cells[25:55, 91:110] = FREE
    assert door.gone(QuickGrid(cells, grid.resolution, grid.origin))


def test_of_two_frontiers_the_car_takes_the_one_ahead():
    grid = seen(door=1.0)
    grid.cells[30:50, 9] = FREE
    both = frontiers(grid)
    assert len(both) == 2
    for start, x in (((2.0, 1.5, 0.0), 4.0), ((2.0, 1.5, 3.14), 0.0)):
        view = best_view(both, start, room(grid), BODY, KEEP)
        assert view is not None and abs(view.frontier.middle[0] - x) < 0.2


def test_a_car_closer_to_a_wall_than_the_obstacle_stop_keeps_drives_away_from_it():
    grid, start = seen(door=1.0), (1.0, 0.28, 0.05)
    assert 0.06 < room(grid).walls.clearance(*start, BODY) < KEEP  # type: ignore[union-attr]
    assert best_view(frontiers(grid), start, room(grid), BODY, KEEP) is not None


def looked(truth: Grid, known: Grid, pose: tuple[float, float, float]) -> Grid:
    """Return what is known after a look of 240 degrees from a pose, and the walls that it meets."""
    cells = known.cells.copy()
    angles = pose[2] + np.linspace(-2.09, 2.09, 1000)
    for angle, end in zip(angles, cast(truth, *pose[:2], angles, 4.0), strict=True):
        along = np.arange(0.0, min(end + 0.05, 4.0), 0.025)
        u, v = truth.to_cells(pose[0] + along * np.cos(angle), pose[1] + along * np.sin(angle))
        row, column = np.floor(v).astype(int) - 1, np.floor(u).astype(int) - 1
        cells[row, column] = truth.cells[row, column]
    return QuickGrid(cells, known.resolution, known.origin)


def test_the_car_goes_where_it_sees_what_a_corner_hides():
    truth = seen(door=1.0)
    truth.cells[30:50, 90] = OCCUPIED
    # a cupboard ahead hides half of the room
    truth.cells[10:48, 52:58] = OCCUPIED
    truth = QuickGrid(truth.cells, truth.resolution, truth.origin)
    known = looked(truth, QuickGrid(np.full_like(truth.cells, UNKNOWN), truth.resolution, truth.origin), START)
    known.cells[:, :40] = truth.cells[:, :40]
    hidden = [each for each in frontiers(known) if each.length > 1.0]
    view = best_view(hidden, START, room(known), BODY, KEEP)
    assert len(hidden) == 1 and view is not None
    assert not hidden[0].known(known) and hidden[0].known(looked(truth, known, view.pose))


@pytest.mark.parametrize(("first", "last", "known_to"), [(45, 65, 64), (50, 64, 62), (50, 70, 64)])
def test_the_car_looks_into_a_niche_where_it_sees_most_of_it(first, last, known_to):
    # the room ends at y = 2.3 m, and a third of a niche's depth of 1.15 m is known
    truth = seen(door=1.0).cells
    truth[30:50, 90] = truth[56:] = OCCUPIED
    truth[56:79, first:last] = FREE
    known = truth.copy()
    known[known_to:79, first:last] = UNKNOWN
    grid, start = QuickGrid(known, 0.05, (-0.5, -0.5, 0.0)), (1.0, 1.9, 0.0)
    (niche,) = frontiers(grid)
    view = best_view([niche], start, room(grid), BODY, KEEP)
    assert view is not None and niche.known(looked(QuickGrid(truth, 0.05, grid.origin), grid, view.pose))


def test_a_good_view_of_a_far_frontier_does_not_lure_the_car_away_from_a_near_one():
    grid = seen(door=1.0)
    # ahead a gap of 0.3 m, through which no place shows most of what is behind it; far behind the car an open door
    grid.cells[:, 90] = OCCUPIED
    grid.cells[30:36, 90] = grid.cells[30:75, 91:96] = grid.cells[30:50, 9] = FREE
    view = best_view(frontiers(grid), (3.2, 1.0, 0.0), room(grid), BODY, KEEP)
    assert view is not None and view.frontier.middle[0] > 4.0


def test_the_car_looks_from_another_place_after_it_has_looked_in_vain():
    grid = seen(door=1.0)
    (door,) = frontiers(grid)
    vain: list[tuple[float, float]] = []
    for _ in range(3):
        view = best_view([door._replace(vain=tuple(vain))], START, room(grid), BODY, KEEP)
        assert view is not None and view.frontier.middle == door.middle
        assert all(hypot(view.pose[0] - x, view.pose[1] - y) >= 0.5 for x, y in vain)
        vain.append(view.pose[:2])


def test_a_frontier_of_large_cells_is_looked_at_though_none_is_close_to_its_middle():
    cells = np.full((14, 24), UNKNOWN, np.int8)
    cells[2:12, 1:18] = OCCUPIED
    cells[3:11, 2:17] = cells[4:10, 17] = FREE
    grid = QuickGrid(cells, 0.6, (0.0, 0.0, 0.0))
    (door,) = frontiers(grid)
    assert (np.hypot(*(door.beyond - door.middle).T) > 0.5).all()
    view = best_view([door], (3.6, 3.6, 0.0), room(grid), BODY, KEEP)
    assert view is not None and hypot(view.pose[0] - door.middle[0], view.pose[1] - door.middle[1]) < 2.0


def test_a_car_without_room_to_turn_looks_aside():
    # 0.8 m x 0.7 m round the car, with a gap in the wall to its left
    cells = np.full((40, 40), UNKNOWN, np.int8)
    cells[12:28, 11:29] = OCCUPIED
    cells[13:27, 12:28] = FREE
    cells[27, 13:27] = FREE
    grid = QuickGrid(cells, 0.05, (-1.0, -1.0, 0.0))
    (gap,) = frontiers(grid)
    view = best_view([gap], (0.0, 0.0, 0.0), room(grid), BODY, KEEP)
    assert view is not None and abs(view.pose[2]) < 0.3
