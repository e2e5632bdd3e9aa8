"""What the laser has seen of the floor: where a robot may back up, and boxes that the map lacks."""

import numpy as np
import pytest

from txt1.mapping.map_sensors import may_stand
from txt1.mapping.seen_floor import SeenFloor
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from txt1.model.vehicle import Geometry

POSE = (0.0, 0.0, 0.0)
LASER = np.array([0.2, 0.0, 0.0])
NOTHING = np.empty((0, 2))


@pytest.fixture
def grid() -> Grid:
    """6 m x 6 m, its middle unknown, round (0, 0)."""
    cells = np.full((120, 120), FREE, np.int8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = OCCUPIED
    cells[56:64, 54:66] = UNKNOWN
    return Grid(cells, 0.05, (-3.0, -3.0, 0.0))


def fan(far: float) -> np.ndarray:
    """What a laser of 240 degrees sees with nothing nearer than so many m."""
    angles = np.radians(np.arange(-120.0, 120.0, 0.35))
    return far * np.column_stack((np.cos(angles), np.sin(angles)))


def test_floor_under_the_robot_and_before_it_is_free_and_behind_it_is_not(grid):
    seen = SeenFloor(grid)
    seen.stand(POSE, Geometry(), 1.0)
    seen.see(LASER, fan(2.4), 1.0)
    room = seen.floor(NOTHING)
    assert room.walls is not None and room.behind is not None
    assert room.walls.distance(0.0, 0.0) > 0.05, "the map knows nothing there, the robot stands there"
    assert room.behind.distance(1.2, 0.0) > 0.2
    assert room.walls.distance(-1.0, 0.0) > 0.2 and room.behind.distance(-1.0, 0.0) < 0.0


def test_floor_seen_long_ago_is_none_for_backing_up_and_what_stood_there_stays(grid):
    seen, box = SeenFloor(grid), np.array([(1.0, 0.02 * k - 0.2) for k in range(21)])
    seen.stand(POSE, Geometry(), 1.0)
    seen.see(LASER, fan(2.4), 1.0)
    seen.see(LASER, box, 1.0)
    seen.stand(POSE, Geometry(), 9.0)
    lately, ever = seen.floor(NOTHING, since=5.0), seen.floor(NOTHING)
    assert ever.behind is not None and lately.behind is not None and lately.walls is not None
    assert ever.behind.distance(0.7, 0.6) > 0.2 and lately.behind.distance(0.7, 0.6) < 0.0
    assert lately.behind.distance(0.0, 0.0) > 0.1, "the robot stands there"
    assert lately.walls.distance(0.7, 0.6) > 0.2, "driving ahead it would see"
    assert lately.walls.distance(1.21, 0.0) < 0.03


def test_a_box_stays_when_it_is_behind_and_goes_when_it_is_seen_through(grid):
    seen, box = SeenFloor(grid), np.array([(1.0, 0.02 * k - 0.2) for k in range(21)])
    seen.see(LASER, box, 1.0)
    walls = seen.floor(NOTHING).walls
    assert walls is not None and walls.distance(1.21, 0.0) < 0.03
    # the laser looks away
    seen.see(np.array([0.2, 0.0, np.pi]), fan(2.4), 1.0)
    walls = seen.floor(NOTHING).walls
    assert walls is not None and walls.distance(1.21, 0.0) < 0.03
    seen.see(LASER, fan(2.4), 1.0)
    walls = seen.floor(NOTHING).walls
    assert walls is not None and walls.distance(1.21, 0.0) < 0.03, "one scan may err"
    for _ in range(3):
        seen.see(LASER, fan(2.4), 1.0)
    walls = seen.floor(NOTHING).walls
    assert walls is not None and walls.distance(1.21, 0.0) > 0.2


def test_a_box_that_is_not_seen_now_may_have_gone(grid):
    seen, box = SeenFloor(grid), np.array([(1.0, 0.02 * k - 0.2) for k in range(21)])
    seen.see(LASER, fan(2.4), 1.0)
    seen.see(LASER, box, 1.0)
    room, now = seen.floor(NOTHING, remembered=False), seen.floor(box + LASER[:2], remembered=False)
    assert room.walls is not None and room.walls.distance(1.21, 0.0) > 0.2
    assert now.walls is not None and now.walls.distance(1.21, 0.0) < 0.03
    assert room.behind is not None and room.behind.distance(1.21, 0.0) < 0.03, "nothing is known of its place"


def test_the_walls_of_the_map_are_no_boxes(grid):
    seen = SeenFloor(grid)
    seen.see(np.array([1.5, 0.0, 0.0]), np.array([(1.32, 0.02 * k) for k in range(-20, 20)]), 1.0)
    walls = seen.floor(NOTHING).walls
    assert walls is not None and walls.distance(2.8, 0.0) == pytest.approx(0.1, abs=0.03)


def test_a_robot_may_stand_where_the_drive_began_that_made_the_map(grid):
    assert not grid.is_free(0.0, 0.0) and may_stand(grid, 0.0, 0.0)
    assert not may_stand(grid, 2.95, 0.0) and not may_stand(grid, 20.0, 0.0)
    cells = grid.cells.copy()
    cells[40:80, 40:80] = UNKNOWN
    assert not may_stand(Grid(cells, 0.05, grid.origin), 0.0, 0.0), "far in the unknown"
