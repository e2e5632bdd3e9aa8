"""Driving without encoders, by the speed map that a calibration made."""

from math import atan

import pytest

from txt1.control.open_loop import OpenLoop, counts_for
from txt1.control.parameters import SpeedMap
from txt1.control.pid import Gains
from txt1.model.vehicle import Geometry, sides

BOTH_WAYS: SpeedMap = ((-3000.0, -1.0), (-1500.0, -0.5), (1000.0, 0.25), (2000.0, 0.75), (4000.0, 1.25))
CAR = Geometry(steering="front")
ROVER = Geometry(steering="skid")


@pytest.mark.parametrize(
    ("v", "counts"),
    [
        (0.0, 0.0),
        (0.25, 1000.0),
        (0.5, 1500.0),
        (0.75, 2000.0),
        (1.0, 3000.0),
        (1.25, 4000.0),
        (1.5, 5000.0),  # through the last two
        (0.125, 750.0),  # through the first two
        (-0.5, -1500.0),
        (-0.75, -2250.0),
        (-1.0, -3000.0),
        (-0.1, -300.0),
    ],
)
def test_a_speed_has_its_counts_on_the_line_between_two_entries_of_its_direction(v: float, counts: float) -> None:
    assert counts_for(v, BOTH_WAYS) == pytest.approx(counts)


def test_counts_never_go_the_other_way_however_slow_it_is_to_be() -> None:
    stiff = ((1000.0, 0.5), (4000.0, 1.0))
    assert counts_for(0.5, stiff) == 1000.0
    assert counts_for(0.3, stiff) == counts_for(-0.3, stiff) == 0.0


def test_a_direction_without_entries_mirrors_the_opposite_direction() -> None:
    ahead, back = BOTH_WAYS[2:], BOTH_WAYS[:2]
    for v in (0.1, 0.5, 1.0, 2.0):
        assert counts_for(-v, ahead) == -counts_for(v, ahead)
        assert counts_for(v, back) == -counts_for(-v, back)


def test_of_a_single_entry_a_share_and_of_none_nothing() -> None:
    assert counts_for(0.3, ((1000.0, 0.5),)) == pytest.approx(600.0)
    assert counts_for(-0.3, ((1000.0, 0.5),)) == pytest.approx(-600.0)
    assert counts_for(1.0, ((1000.0, 0.5),)) == pytest.approx(2000.0)
    assert counts_for(0.3, ()) == 0.0


def asked(body: Geometry, v: float, omega: float) -> tuple[float, float]:
    """Motor and steering output."""
    loop = OpenLoop(body, BOTH_WAYS)
    loop.clear()
    return loop.step(v, omega, 9.0, 9.0, Gains(9.0), Gains(9.0), 0.02)


def test_a_car_steers_by_the_angle_of_its_curve() -> None:
    angle = atan(CAR.wheelbase / 2.0)  # of a circle of 2 m
    assert asked(CAR, 0.5, 0.25) == pytest.approx((1500.0, 18000.0 * angle / CAR.steering_max))
    assert asked(CAR, -0.5, 0.25) == pytest.approx((-1500.0, -18000.0 * angle / CAR.steering_max))
    assert asked(CAR, 1.0, 0.0) == pytest.approx((3000.0, 0.0))
    assert asked(CAR, 0.0, 0.25) == (0.0, 0.0), "it does not turn on the spot"


@pytest.mark.parametrize(("v", "omega"), [(0.5, 1.0), (0.5, -1.0), (-0.6, 0.3), (0.0, 2.0), (0.7, 0.0)])
def test_each_side_of_a_rover_gets_the_counts_of_its_own_speed(v: float, omega: float) -> None:
    motor, steering = asked(ROVER, v, omega)
    outer = 0.5 * omega * ROVER.track_width
    assert sides(motor, steering) == pytest.approx((counts_for(v + outer, BOTH_WAYS), counts_for(v - outer, BOTH_WAYS)))
