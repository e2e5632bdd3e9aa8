"""The map: the room, the robot in it, and true proportions."""

from __future__ import annotations

from math import inf, nan

import pytest
from ui_snapshots import blind, full

from txt1.sim.obstacles import outline
from txt1.sim.parameters import Post
from txt1.tasks.encoder import ODOMETRY, POSE
from txt1.tasks.fields import SURROUNDINGS, VEHICLES, WALLS, Surroundings
from txt1.tasks.on_map import MAP_POSE, PARTICLES, SCAN_ON_MAP, WALLS_ON_MAP, MapPose
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.map import Canvas, draw_map, fitting_scale, round_up, scale_bar, screen
from txt1.ui.viewer import Viewer


def dots(lines: list[str]) -> set[tuple[int, int]]:
    """The set dots as (column, row), counted in dots."""
    bits = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
    return {
        (2 * x + i, 4 * y + j)
        for y, line in enumerate(lines)
        for x, character in enumerate(line)
        if "\u2800" < character <= "\u28ff"
        for i in range(2)
        for j in range(4)
        if (ord(character) - 0x2800) & bits[i][j]
    }


def at(
    pose: tuple[float, float, float] | None = (0.0, 0.0, 0.0), time: float = 83.4, light: bool = False, **about: object
) -> Snapshot:
    """The full snapshot of a robot elsewhere."""
    shown = full(time)[SURROUNDINGS]._replace(**about)
    return full(time).replaced({POSE: pose, SURROUNDINGS: shown if light else shown._replace(light=None)})


def odometry(**changes: float) -> Snapshot:
    """The snapshot of a robot that knows nothing but its odometry."""
    return blind().replaced({ODOMETRY: blind()[ODOMETRY]._replace(**changes)})


def drawn(snapshot: Snapshot, columns: int = 78, rows: int = 19, viewer: Viewer | None = None) -> list[str]:
    return [line.plain for line in draw_map(snapshot, viewer or Viewer(), columns, rows)]


@pytest.mark.parametrize("size", [(78, 19), (198, 45), (40, 40)])
def test_a_square_room_is_square(size: tuple[int, int]) -> None:
    snapshot = at()
    points = dots(drawn(snapshot, *size)[:-1])
    xs, ys = [x for x, _ in points], [y for _, y in points]
    assert abs((max(xs) - min(xs)) - (max(ys) - min(ys))) <= 1


def test_the_walls_are_straight_and_closed() -> None:
    lines = drawn(at())[:-1]
    points = dots(lines)
    left, right = min(x for x, _ in points), max(x for x, _ in points)
    top, bottom = min(y for _, y in points), max(y for _, y in points)
    assert all((x, top) in points and (x, bottom) in points for x in range(left, right + 1))
    assert all((left, y) in points and (right, y) in points for y in range(top, bottom + 1))
    assert not [y for x, y in points if left + 8 < x < left + 16 and top < y < bottom]


def test_x_is_to_the_right_and_y_up() -> None:
    canvas = Canvas((-1.0, -1.0, 1.0, 1.0), 20, 10)
    canvas.line((0.9, 0.9), (0.9, 0.9), 1)
    ((x, y),) = dots([line.plain for line in canvas.lines()])
    assert x > 20
    assert y < 20


def test_the_robot_points_where_it_heads() -> None:
    def mean_x(theta: float) -> float:
        nothing = at((1.0, 0.0, theta), room=None)
        points = [(x, y) for x, y in dots(drawn(nothing)[:-1])]
        return sum(x for x, _ in points) / len(points)

    assert mean_x(0.0) > mean_x(3.14159)


def test_the_light_stands_where_it_is() -> None:
    lines = drawn(full().replaced({SURROUNDINGS: Surroundings((5.0, 5.0), (2.0, 2.0))}))
    assert any("✶" in line[39:] for line in lines[:9])


def test_without_a_room_the_view_holds_the_whole_path() -> None:
    viewer = Viewer()
    for i in range(200):
        snapshot = odometry(x=0.05 * i, y=0.0, theta=0.0).replaced({}, time=0.1 * i)
        viewer.follow(snapshot)
    lines = drawn(snapshot, viewer=viewer)
    xs = [x for x, _ in dots(lines[:-1])]
    assert max(xs) - min(xs) > 60
    assert "odometry x 9.95" in lines[-1]


def test_the_pose_in_the_room_is_preferred() -> None:
    assert "room x" in drawn(full())[-1]
    assert "odometry x" in drawn(at(None))[-1]


def test_the_robot_is_drawn_as_long_as_it_is() -> None:
    def size(length: float) -> int:
        robot = dots(drawn(at(room=(5.0, 5.0), body=(length, 0.4, 0.0)), 200, 60)[:-1])
        return len({x for x, y in robot if 60 < y < 180 and 100 < x < 300})

    assert size(2.0) > 1.4 * size(1.0)


def test_a_pose_that_is_no_number_does_not_stop_the_drawing() -> None:
    assert len(drawn(at((nan, inf, 0.0)))) == 19
    assert len(drawn(odometry(x=inf, theta=nan))) == 19


@pytest.mark.parametrize("scale", [0.001, 0.0131, 0.07, 0.5, 3.0, 40.0])
def test_the_scale_bar_is_true(scale: float) -> None:
    length, cells = scale_bar(scale)
    assert abs(cells * 2 * scale - length) <= scale
    assert 2 <= cells <= 11
    assert round_up(scale) >= scale


def test_the_scale_lets_everything_fit() -> None:
    assert fitting_scale((0.0, 0.0, 5.0, 5.0), 78, 18) == pytest.approx(5.0 / 70)


def test_the_path_is_bounded_and_survives_decimation() -> None:
    viewer = Viewer()
    for i in range(6_000):
        viewer.follow(at((0.03 * i, 0.0, 0.0), i * 0.1))
        assert len(viewer.path) <= 4000
    assert viewer.path[0] == (0.0, 0.0)
    assert viewer.path[-1][0] == pytest.approx(0.03 * 5_999, abs=2 * viewer.spacing)


def test_placing_the_robot_starts_a_new_path() -> None:
    viewer = Viewer()
    for i in range(50):
        viewer.follow(at((0.1 * i, 0.0, 0.0), i * 0.1))
    assert len(viewer.path) == 50
    viewer.follow(at((4.9, 0.6, 0.0), 5.0))
    assert viewer.path == [(4.9, 0.6)]


def test_fast_motion_is_no_placing_and_a_new_run_is() -> None:
    viewer = Viewer()
    viewer.follow(at((0.0, 0.0, 0.0), 0.0))
    viewer.follow(at((1.5, 0.0, 0.0), 2.0))
    assert len(viewer.path) == 2
    viewer.follow(at((1.5, 0.1, 0.0), 0.5))
    assert viewer.path == [(1.5, 0.1)]


def test_a_robot_that_stands_adds_no_points() -> None:
    viewer = Viewer()
    for i in range(50):
        viewer.follow(at((1.0, 1.0, 0.0), i * 0.1))
    assert viewer.path == [(1.0, 1.0)]


def test_obstacles_and_other_robots_are_drawn_and_come_through_snapshots() -> None:
    bare = full().replaced({SURROUNDINGS: Surroundings((5.0, 5.0))})
    post = outline(Post(-1.5, 1.5, 0.3))
    told = bare.replaced({SURROUNDINGS: Surroundings((5.0, 5.0), obstacles=(post,)), VEHICLES: ((1.5, -1.5, 0.0),)})
    told = Snapshot.decode(told.encode())
    changed = dots(drawn(told)[:-1]) ^ dots(drawn(bare)[:-1])  # the picture is 156 x 72 dots
    assert any(x < 78 and y < 36 for x, y in changed), "the post, on the upper left"
    assert any(x > 78 and y > 36 for x, y in changed), "the robot, on the lower right"
    assert all((x < 78) == (y < 36) for x, y in changed)


def test_the_walls_of_a_map_are_drawn_and_all_of_them_are_in_view() -> None:
    ring = ((-3.0, -8.0), (9.0, -8.0), (9.0, 4.0), (-3.0, 4.0))
    table = ((2.0, -2.0), (3.0, -2.0), (3.0, -3.0), (2.0, -3.0))
    told = full().replaced({SURROUNDINGS: Surroundings(None), WALLS: (ring, table)})
    told = Snapshot.decode(told.encode())
    without = told.replaced({WALLS: (ring,)})
    seen = dots(drawn(told)[:-1])
    assert max(y for _, y in seen) - min(y for _, y in seen) >= 68, "from the lowest wall to the highest"
    assert seen - dots(drawn(without)[:-1]), "the table"


def test_a_map_that_is_as_before_is_not_drawn_again() -> None:
    viewer, first = Viewer(), full()
    viewer.follow(first)
    picture = screen(first, viewer, 80, 20)
    assert screen(first.replaced({}, time=first.time + 0.1), viewer, 80, 20) is picture
    pose = first[POSE]
    for other in (
        first.replaced({POSE: (pose[0] + 0.3, pose[1], pose[2])}),
        first.replaced({VEHICLES: ((1.0, 1.0, 0.0),)}),
        first.replaced({SURROUNDINGS: first[SURROUNDINGS]._replace(light=None)}),
    ):
        assert screen(other, viewer, 80, 20) is not picture
        picture = screen(other, viewer, 80, 20)
    viewer.path.append((0.5, 0.5))
    assert screen(other, viewer, 80, 20) is not picture
    assert screen(other, viewer, 90, 20) is not screen(other, viewer, 80, 20)


def test_a_narrow_screen_drops_the_sign_of_the_path_and_keeps_the_way_to_the_light() -> None:
    state = full().replaced({POSE: (-1.98, -1.14, -2.5)})
    legend = drawn(state, columns=58)[-1]
    assert len(legend) <= 58
    assert "x -1.98 y -1.14 m θ -143°" in legend and "✶ light " in legend and legend.rstrip().endswith(" m")
    assert "⣀ path" not in legend and "⣀ path" in drawn(state, columns=78)[-1]


def test_a_robot_with_a_map_of_its_own_is_drawn_on_it_and_nothing_of_the_room_is() -> None:
    ring = ((-1.0, -1.0), (5.0, -1.0), (5.0, 3.0), (-1.0, 3.0))
    there = MapPose(4.0, 2.0, 0.0, 0.02, 0.01, 0.9, lost=False)
    told = Snapshot.decode(full().replaced({WALLS_ON_MAP: (ring,), MAP_POSE: there}).encode())
    legend = drawn(told)[-1]
    assert "map x 4.00 y 2.00 m" in legend and "light" not in legend
    other = told.replaced({SURROUNDINGS: Surroundings((9.0, 9.0)), VEHICLES: ((1.0, 1.0, 0.0),), POSE: None})
    assert drawn(other)[:-1] == drawn(told)[:-1]
    grown = told.replaced({WALLS_ON_MAP: (ring, ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)))})
    assert dots(drawn(grown)[:-1]) - dots(drawn(told)[:-1])
    cloud = told.replaced({PARTICLES: ((0.5, 0.5, 0.0), (0.6, -0.5, 1.0)), SCAN_ON_MAP: ((-0.7, 0.4), (nan, 0.0))})
    assert len(dots(drawn(Snapshot.decode(cloud.encode()))[:-1]) - dots(drawn(told)[:-1])) == 3
    lost = told.replaced({MAP_POSE: there._replace(lost=True)})
    assert "lost on the map" in drawn(lost)[-1] and drawn(lost)[:-1] != drawn(told)[:-1]
    assert screen(told, Viewer(), 80, 20) is not screen(grown, Viewer(), 80, 20)
