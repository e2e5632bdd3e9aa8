"""The roll-over guard, the lean it guards against, and the rough ground under it."""

from math import atan, exp, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.guards.roll_guard.guard import Guard, lean, sideways_max, tipping
from txt1.guards.roll_guard.inputs import roll_of, watching
from txt1.guards.roll_guard.settings import RollGuard
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import ImuReading
from txt1.sim.ground import Ground
from txt1.sim.parameters import Roughness
from txt1.tasks.state import State
from txt1.units import GRAVITY

BODY = Geometry()
GIVEN = RollGuard()
EDGE = tipping(BODY.track_width, GIVEN.gravity_height)


def guard(roll: float, sideways: float = 0.0) -> Guard:
    return Guard(GIVEN, BODY.track_width, BODY.radius_min, lambda _: (roll, sideways))


def test_a_car_of_these_dimensions_does_not_tip_on_flat_ground() -> None:
    assert lean(0.0, 1.5, 1.5 / BODY.radius_min) < 0.6 * EDGE
    assert guard(0.0)(1.5, 1.5 / BODY.radius_min, 1.0) == (1.5, 1.5 / BODY.radius_min)


@given(st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))
def test_what_it_allows_keeps_the_curve_and_the_wheels_on_the_ground(v: float, curve: float, roll: float) -> None:
    omega = curve * abs(v) / BODY.radius_min
    slower, turning = guard(roll)(v, omega, 1.0)
    assert 0.0 <= slower * v <= v * v
    assert turning * v == pytest.approx(omega * slower, abs=1e-9)
    allowed = atan(GIVEN.share * tan(EDGE))
    worst = max(abs(lean(abs(roll), abs(slower), abs(turning))), 0.0)
    assert worst <= max(allowed, lean(abs(roll), 0.1, 0.1 / BODY.radius_min)) + 1e-9


def test_a_roll_is_remembered_for_a_while() -> None:
    rolls = [0.4]
    one = Guard(GIVEN, BODY.track_width, BODY.radius_min, lambda _: (rolls[0], 0.0))
    slow = one(1.5, 1.5 / BODY.radius_min, 1.0)[0]
    rolls[0] = 0.0
    assert slow < one(1.5, 1.5 / BODY.radius_min, 2.0)[0] < 1.5
    assert one(1.5, 1.5 / BODY.radius_min, 20.0)[0] == 1.5


@given(st.floats(0.1, 1.5), st.floats(-1.0, 1.0), st.floats(0.0, 0.3), st.floats(0.001, 0.2))
def test_a_body_that_leans_on_soft_springs_is_slowed_before_the_curve(
    v: float, curve: float, ground: float, gradient: float
) -> None:
    soft = RollGuard(roll_gradient=gradient)

    def allowed_on(springs: RollGuard, roll: float, sideways: float) -> tuple[float, float]:
        return Guard(springs, BODY.track_width, BODY.radius_min, lambda _: (roll, sideways))(
            v, curve * v / BODY.radius_min, 1.0
        )

    slower, turning = allowed_on(soft, ground, 0.0)
    leans = abs(lean(ground + gradient * abs(slower * turning), abs(slower), abs(turning)))
    crawls = lean(ground + gradient * 0.1 * 0.1 / BODY.radius_min, 0.1, 0.1 / BODY.radius_min)
    assert leans <= max(atan(GIVEN.share * tan(EDGE)), crawls) + 1e-9
    assert slower <= allowed_on(GIVEN, ground, 0.0)[0] + 1e-9
    # what the body leans in the curve is not taken for the ground's roll
    now = slower * turning
    assert allowed_on(soft, ground + gradient * now, now)[0] == pytest.approx(slower)


ALLOWED = atan(0.75 * 0.5 * BODY.track_width / 0.15)  # of the lean: three quarters of the way to lifting wheels


@given(st.floats(0.05, 0.6), st.floats(0.0, 0.7), st.floats(0.001, 0.1))
def test_a_curve_is_as_fast_as_the_lean_that_is_left_to_it(largest: float, roll: float, gradient: float) -> None:
    stiff, soft = sideways_max(largest, roll), sideways_max(largest, roll, gradient)
    if roll >= largest:
        assert stiff == soft == 0.0
        return
    assert roll + atan(stiff / GRAVITY) == pytest.approx(largest), "rigid: the force leans by atan(a / g)"
    assert roll + soft / GRAVITY + gradient * soft == pytest.approx(largest), "on springs the body leans, too"
    assert soft < stiff


def test_the_force_on_a_car_leans_with_its_roll_and_its_turn() -> None:
    assert lean(0.1, 2.0, 3.0) == pytest.approx(0.1 + atan(6.0 / GRAVITY))
    assert tipping(0.25, 0.15) == pytest.approx(atan(0.25 / 0.3))


def test_a_curve_that_is_too_fast_for_the_ground_is_taken_so_that_it_is_not() -> None:
    one = guard(0.5)
    for v, omega in ((1.5, 2.0), (-1.5, 2.0), (1.5, -2.0)):
        slower, turning = one(v, omega, 1.0)
        assert abs(slower) == pytest.approx(1.5 * (GRAVITY * tan(ALLOWED - 0.5) / 3.0) ** 0.5)
        assert turning / slower == pytest.approx(omega / v)
    assert one(0.1, 0.1, 1.0) == (0.1, 0.1)


def test_on_ground_that_is_steep_enough_by_itself_it_crawls() -> None:
    steep = guard(1.2)
    assert steep(0.5, 0.5, 1.0) == pytest.approx((0.1, 0.1))
    assert steep(-0.5, 0.5, 1.0) == pytest.approx((-0.1, 0.1))
    assert steep(0.05, 0.05, 1.0) == (0.05, 0.05), "and what is slower stays so"
    assert steep(0.0, 0.0, 1.0) == (0.0, 0.0)
    assert steep(0.5, 0.0, 1.0) == (0.5, 0.0), "straight on nothing adds to the roll"


def test_a_turn_that_it_still_makes_counts_as_far_as_the_steering_can_make_it() -> None:
    turning = 1.5 / BODY.radius_min
    expected = guard(0.5)(1.5, turning, 1.0)[0]
    for sideways in (9.0, -9.0):
        assert guard(0.5, sideways)(1.5, 0.0, 1.0) == pytest.approx((expected, 0.0)), "no further than to its stop"
    assert guard(0.5, 3.0)(1.5, 0.0, 1.0)[0] == pytest.approx(guard(0.5)(1.5, 2.0, 1.0)[0])
    assert guard(0.5, 3.0)(1.5, turning, 1.0)[0] == pytest.approx(expected), "what is asked for, where it is more"


def test_a_roll_fades_in_three_seconds() -> None:
    rolls = [0.6]
    one = Guard(GIVEN, BODY.track_width, BODY.radius_min, lambda _: (rolls[0], 0.0))
    one(1.5, 2.0, 10.0)
    rolls[0] = 0.0
    for now in (10.2, 10.4, 10.6):
        slower = one(1.5, 2.0, now)[0]
        assert slower == pytest.approx(guard(0.6 * exp(-(now - 10.0) / 3.0))(1.5, 2.0, 1.0)[0])
    assert slower < 1.5


def test_without_the_imu_curves_are_taken_at_a_crawl_on_whatever_ground() -> None:
    roll: list[float | None] = [None]
    told: list[str] = []
    one = Guard(GIVEN, BODY.track_width, BODY.radius_min, lambda _: (roll[0], 0.0), lambda _, text: told.append(text))
    assert one(1.5, 0.0, 1.0) == (1.5, 0.0), "straight on nothing adds to the roll"
    assert told == []
    assert one(1.5, 1.5 / BODY.radius_min, 1.1) == pytest.approx((0.1, 0.1 / BODY.radius_min))
    assert one(-1.5, 1.5 / BODY.radius_min, 1.2) == pytest.approx((-0.1, 0.1 / BODY.radius_min))
    slower, turning = one(1.5, 0.3, 1.3)  # of 5 m
    assert slower * turning == pytest.approx(0.1 * 0.1 / BODY.radius_min), "as sideways as the narrowest curve at 0.1"
    assert told == ["slowed in curves: the IMU is silent, so the slope of the ground is unknown"]
    roll[0] = 0.0
    assert one(1.5, 2.0, 1.4) == (1.5, 2.0)
    roll[0] = None
    one(1.5, 2.0, 1.5)
    assert len(told) == 2


def test_a_car_without_its_imu_that_turns_is_slowed_though_told_to_go_straight() -> None:
    blind = Guard(GIVEN, BODY.track_width, BODY.radius_min, lambda _: (None, 3.0))
    assert blind(1.5, 0.0, 1.0)[0] == pytest.approx(max(0.1, 1.5 * (0.01 / BODY.radius_min / 3.0) ** 0.5))


def test_the_ground_has_the_height_that_was_asked_for_and_flat_is_flat() -> None:
    ground = Ground(Roughness(height=0.02), BODY, 1)
    heights = [ground.height(0.37 * x, 0.41 * y) for x in range(60) for y in range(60)]
    mean = sum(heights) / len(heights)
    assert (sum((h - mean) ** 2 for h in heights) / len(heights)) ** 0.5 == pytest.approx(0.02, rel=0.2)
    assert Ground(Roughness(), BODY, 1).attitude((1.0, 2.0, 3.0)) == (0.0, 0.0)


def test_the_imu_tells_the_roll_by_its_attitude_or_by_gravity() -> None:
    tilted = ImuReading((0.0, GRAVITY * 0.1, GRAVITY), (0.0, 0.0, 0.0))
    assert roll_of(tilted) == pytest.approx(atan(0.1))
    turned = tilted._replace(orientation=(0.0998334, 0.0, 0.0, 0.9950042))  # 0.2 rad about x
    assert roll_of(turned) == pytest.approx(0.2, abs=1e-5)
    measured = watching(lambda: Reading(1.0, turned), State())
    assert measured(1.1) == pytest.approx((0.2, 0.0), abs=1e-5)
    assert measured(2.0) == (None, 0.0)
