"""A world: obstacles, and vehicles that meet."""

from __future__ import annotations

from math import cos, hypot, inf, nan, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.kernel.clock import VirtualClock
from txt1.model.vehicle import Geometry
from txt1.sim.dynamics import VehicleState
from txt1.sim.obstacles import Obstacle, distance, gap
from txt1.sim.parameters import Batteries, Box, Noise, Post, VehicleParameters
from txt1.sim.room import Room
from txt1.sim.vehicle import Vehicle
from txt1.sim.world import World

BODY = Geometry()
HALF = BODY.length / 2
numbers = st.floats(-3.0, 3.0)
sizes = st.floats(0.1, 2.0)
boxes = st.builds(Box, numbers, numbers, sizes, sizes, st.floats(-pi, pi))


def vehicle(world: World, x: float = 0.0, y: float = 0.0, theta: float = 0.0, seed: int = 1) -> Vehicle:
    one = Vehicle(world, VehicleParameters(), BODY, Batteries(), Noise(), (x, y, theta), seed)
    world.expect(one, VirtualClock())
    one.advance_to(0.001)
    return one


def run(*vehicles: Vehicle, seconds: float = 3.0) -> None:
    for tick in range(1, round(seconds * 50) + 1):
        for each in vehicles:
            each.advance_to(tick / 50)


def corners(box: Box) -> list[tuple[float, float]]:
    c, s = cos(box.theta), sin(box.theta)
    return [
        (box.x + a * c - b * s, box.y + a * s + b * c)
        for a in (-box.length / 2, box.length / 2)
        for b in (-box.width / 2, box.width / 2)
    ]


# -- distances ---------------------------------------------------------------------------------------------------


@given(boxes, boxes)
def test_a_corner_in_another_box_overlaps_and_the_gap_is_at_most_their_distance(one: Box, other: Box) -> None:
    found = gap(one, other)
    nearest = min([distance(one, *at) for at in corners(other)] + [distance(other, *at) for at in corners(one)])
    assert found <= nearest + 1e-9
    assert gap(other, one) == pytest.approx(found, abs=1e-9)


@given(boxes, numbers, numbers, sizes)
def test_a_post_is_as_far_as_its_edge(box: Box, x: float, y: float, radius: float) -> None:
    assert gap(box, Post(x, y, radius)) == pytest.approx(distance(box, x, y) - radius)


def test_distances_of_points() -> None:
    assert distance(Post(1.0, 0.0, 0.25), 0.0, 0.0) == 0.75
    assert distance(Box(2.0, 0.0, 1.0, 1.0), 0.0, 0.0) == 1.5
    assert distance(Box(0.0, 0.0, 2.0, 1.0, pi / 2), 0.0, 0.0) == -0.5
    assert distance(Box(1.0, 1.0, 1.0, 1.0), 0.0, 0.0) == pytest.approx(hypot(0.5, 0.5))


# -- obstacles ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("obstacle", [Box(1.5, 0.0, 0.5, 0.5, 0.4), Post(1.5, 0.0, 0.05), Post(1.5, 0.15, 0.05)])
@pytest.mark.parametrize("motor", [4000, -4000])
def test_an_obstacle_stops_the_vehicle_and_lets_it_back_out(obstacle: Obstacle, motor: int) -> None:
    one = vehicle(World(obstacles=(obstacle,)), theta=0.0 if motor > 0 else pi)
    one.command(motor, 0, 0)
    run(one)
    assert 0.0 <= gap(one.outline(one.pose), obstacle) < 0.05
    assert abs(one.state.v) < 0.1
    one.command(-motor, 0, 0)
    run(one, seconds=4.0)
    assert gap(one.outline(one.pose), obstacle) > 0.3


@pytest.mark.parametrize(
    "obstacle", [Box(nan, 0.0, 1.0, 1.0), Box(0.0, 0.0, 0.0, 1.0), Post(0.0, inf, 0.1), Post(0.0, 0.0, -1.0)]
)
def test_an_impossible_obstacle_is_refused(obstacle: Obstacle) -> None:
    with pytest.raises(ValueError, match=r"obstacle 0, .*: its numbers are finite, and its lengths more than 0"):
        World(obstacles=(obstacle,))


def test_nobody_is_put_down_where_something_stands() -> None:
    world = World(obstacles=(Post(2.0, 0.0, 0.1), Box(0.0, 2.0, 1.0, 0.2)))
    one = vehicle(world)
    with pytest.raises(ValueError, match=r"sticks into obstacle 0, a post at"):
        one.place(2.2, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"sticks into obstacle 1, a box at"):
        one.place(0.0, 2.0, 0.0)
    with pytest.raises(ValueError, match=r"sticks into another vehicle$"):
        vehicle(world, 0.4)
    assert world.vehicles == [one]


# -- vehicles that meet ------------------------------------------------------------------------------------------


def met(first: int) -> tuple[VehicleState, VehicleState]:
    world = World()
    both = vehicle(world, -1.0, 0.05, 0.02), vehicle(world, 1.0, -0.05, pi, seed=2)
    for each in both:
        each.command(4000, 0, 0)
    run(both[first], both[1 - first], seconds=1.5)
    assert 0.0 <= gap(both[0].outline(both[0].pose), both[1].outline(both[1].pose)) < 0.05
    return both[0].state, both[1].state


def test_two_vehicles_stop_one_another_the_same_whichever_is_read_first() -> None:
    one, two = met(first=0)
    assert one.v < 0.1 and two.v < 0.1
    assert (one.x, two.x) == pytest.approx((-0.27, 0.27), abs=0.05)
    assert met(first=1) == (one, two)


def test_a_vehicle_whose_run_has_not_begun_is_in_the_way() -> None:
    world = World()
    one = vehicle(world)
    parked = Vehicle(world, VehicleParameters(), BODY, Batteries(), Noise(), (1.0, 0.0, pi / 2), 2)
    one.command(4000, 0, 0)
    run(one)
    assert one.state.x == pytest.approx(1.0 - BODY.width / 2 - HALF, abs=0.03)
    assert parked.pose == (1.0, 0.0, pi / 2)


def test_vehicles_that_do_not_touch_move_as_if_they_were_alone_to_the_last_bit() -> None:
    def driven(*others: tuple[float, float, float]) -> tuple[float, ...]:
        world = World(Room(20.0, 20.0))
        one = vehicle(world)
        company = [vehicle(world, *start, seed=5) for start in others]
        one.command(3000, -9000, 9000)
        for each in company:
            each.command(3000, -9000, 9000)
        for ms in range(4, 8000, 4):
            for each in reversed(company) if ms % 16 == 0 else ():  # they are read more often
                each.advance_to(ms / 1000)
            if ms % 20 == 0:
                one.advance_to(ms / 1000)
        return (*one.state, *one.encoder_counts(), *one.battery_readings())

    assert driven() == driven((0.0, -0.8, 0.0)) == driven((5.0, 5.0, 1.0), (0.0, 0.8, 0.0), (-1.0, 0.0, 0.0))


@given(
    st.lists(
        st.tuples(st.integers(0, 2), st.sampled_from([-4000, 0, 5000]), st.integers(-18000, 18000)),
        min_size=5,
        max_size=25,
    )
)
@settings(max_examples=examples(60), derandomize=True)
def test_bodies_never_overlap_by_a_centimetre(commands: list[tuple[int, int, int]]) -> None:
    post = Post(0.0, 0.9, 0.1)
    world = World(Room(3.0, 3.0), obstacles=(post,))
    three = [vehicle(world, 0.65 * (k - 1), 0.0, pi / 2 + 0.2 * k, seed=k) for k in range(3)]
    now = 0
    for who, motor, steering in commands:
        three[who].command(motor, -steering, steering)
        for _ in range(15):
            now += 1
            for each in three[now % 3 :] + three[: now % 3]:
                each.advance_to(now / 50)
            outlines = [each.outline(each.pose) for each in three]
            assert min(gap(a, b) for a in outlines for b in outlines if a is not b) > -1e-2
            assert min(gap(a, post) for a in outlines) > -1e-2
