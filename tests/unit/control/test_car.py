"""Loops that know the car hold the speed and the curve that were asked for; the thesis's trust the encoders."""

from math import atan, copysign, cos, hypot, sqrt, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import load
from txt1.control.car import InformedLoops, car_of, true_velocity
from txt1.control.loops import loops_for
from txt1.control.parameters import KnownCar
from txt1.control.pid import Gains, VelocityLoops
from txt1.errors import ConfigError
from txt1.hal.registry import create_sim
from txt1.learning.env import EpisodeCar
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import Geometry

BODY = Geometry()


@given(v=st.floats(-1.5, 1.5).filter(lambda v: abs(v) > 1e-3), curvature=st.floats(-1.7, 1.7))
def test_the_cars_velocities_follow_from_what_its_steered_front_wheels_tell(v: float, curvature: float) -> None:
    phi = atan(0.5 * curvature * BODY.wheelbase)
    told_v = v * (cos(phi) + 0.5 * curvature * BODY.wheelbase * tan(phi) * cos(phi))
    told_omega = v * curvature * cos(phi)
    assert true_velocity(told_v, told_omega, BODY.wheelbase) == pytest.approx((v, v * curvature), rel=1e-9, abs=1e-12)


def driven(known: bool, omega: float, seconds: float, *settings: str) -> tuple[float, float, float]:
    """After so many seconds at 0.3 m/s from rest: distance along the path, m, true speed, m/s, angle turned, rad."""
    words = [f"car.known={str(known).lower()}", "sim.noise.drag=0", "sim.room.length=.inf", "sim.room.width=.inf"]
    config = load(None, [*words, *settings]).config
    car = EpisodeCar(create_sim(config), config)
    path, last, speed, turned = 0.0, car.pose(0.0), 0.0, 0.0
    for tick in range(round(seconds * 50)):
        now = tick / 50
        car.control(now, 0.3, omega)
        pose = car.pose(now)
        step = hypot(pose[0] - last[0], pose[1] - last[1])
        turned += wrap_angle(pose[2] - last[2])
        path, last, speed = path + step, pose, 50.0 * step
    return path, speed, turned


def test_a_car_that_its_loops_know_runs_up_sooner() -> None:
    assert driven(True, 0.0, 1.0)[0] > driven(False, 0.0, 1.0)[0] + 0.02


def test_and_keeps_its_true_speed_in_the_sharpest_turn() -> None:
    sharpest = 0.3 / BODY.radius_min
    assert driven(True, sharpest, 4.0)[1] == pytest.approx(0.3, abs=0.002)
    assert driven(False, sharpest, 4.0)[1] == pytest.approx(0.287, abs=0.003), "as the thesis's loops do"


def test_a_car_whose_front_wheels_steer_takes_its_curve_at_once_and_keeps_to_it() -> None:
    """It steers by its whole wheelbase, and its encoders, at wheels that do not steer, are believed."""
    front = ("vehicle=f1tenth", "car.speed_gain=0.0005")
    curvature = 0.9 / load(None, front).config.geometry.radius_min

    def bend(known: bool, seconds: float) -> float:
        path, _, turned = driven(known, 0.3 * curvature, seconds, *front)
        return turned / path

    assert bend(True, 0.5) == pytest.approx(curvature, rel=0.01)
    assert bend(False, 0.5) < 0.85 * curvature, "as loops do that do not know it"
    path, speed, turned = driven(True, 0.3 * curvature, 5.0, *front)
    assert (speed, turned / path) == (pytest.approx(0.3, abs=0.004), pytest.approx(curvature, rel=0.01))


def test_sides_that_run_at_two_speeds_are_refused_with_what_to_do() -> None:
    with pytest.raises(ConfigError, match=r"car.*not sides that run at two speeds; use false"):
        load(None, ["vehicle=rover", "car.known=true"])


# -- on paper ----------------------------------------------------------------------------------------------------------

KNOWN = KnownCar(True, speed_gain=0.0005, dead_band=300.0, time_constant=0.3, scrub=0.1, acceleration=2.0)
DT = 0.02
NONE = Gains(), Gains()
FULL_LOCK = 2.0 * BODY.tan_steering_max / BODY.wheelbase  # curvature, 1/m


def informed() -> InformedLoops:
    car = car_of(KNOWN, BODY)
    assert car is not None
    return InformedLoops(car)


def led_to(loops: InformedLoops, v: float, omega: float, told: tuple[float, float]) -> tuple[float, float]:
    """The outputs once the reference has come to the set-point, without gains; the encoders tell the same each time."""
    for _ in range(100):
        outputs = loops.step(v, omega, *told, *NONE, DT)
    return outputs


def test_noise_that_no_steering_makes_counts_as_wheels_at_45_degrees() -> None:
    for v, omega in ((1.0, 100.0), (1.0, -100.0), (-1.0, 100.0), (1.0, 1.0 / BODY.wheelbase)):
        assert true_velocity(v, omega, BODY.wheelbase) == pytest.approx((v * sqrt(0.5), omega / sqrt(0.5)))
    assert true_velocity(0.0, 0.3, BODY.wheelbase) == (0.0, 0.3)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_car_that_is_as_it_is_known_runs_up_at_its_acceleration_without_any_gains(way: float) -> None:
    loops, v = informed(), 0.0
    for tick in range(1, 40):
        motor, steering = loops.step(way, 0.0, v, 0.0, *NONE, DT)
        assert steering == 0.0
        drive = KNOWN.speed_gain * (motor - copysign(KNOWN.dead_band, motor))  # the speed it would come to
        v += (drive - v) * DT / KNOWN.time_constant
        # the speed of the reference is what it has to overcome for the whole of the cycle: half of it too much
        assert v == pytest.approx(way * min(1.0, KNOWN.acceleration * tick * DT), abs=0.07)
    assert motor == pytest.approx(way * (KNOWN.dead_band + 1.0 / KNOWN.speed_gain))


def test_the_first_counts_overcome_the_dead_band_and_the_car_s_inertia() -> None:
    # the reference goes by 0.04 m/s: 0.04 + 0.3 * 0.04 / 0.02 = 0.64 m/s of drive
    assert informed().step(1.0, 0.0, 0.0, 0.0, *NONE, DT) == pytest.approx((300.0 + 0.64 / 0.0005, 0.0))
    assert informed().step(0.01, 0.0, 0.0, 0.0, *NONE, DT) == pytest.approx((300.0 + 0.16 / 0.0005, 0.0)), "no further"
    assert informed().step(0.0, 0.0, 0.0, 0.0, *NONE, DT) == (0.0, 0.0)
    assert informed().step(0.0, 1.0, 0.0, 0.0, *NONE, DT) == (0.0, 0.0), "a car does not turn on the spot"


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0, -0.5, -1.0, -2.0])
def test_the_steering_goes_to_the_curve_s_angle_and_the_motor_pays_for_the_scrubbing(share: float) -> None:
    motor, steering = led_to(informed(), 0.5, 0.5 * share * FULL_LOCK, (0.0, 0.0))
    there = max(-1.0, min(1.0, share))  # of full lock, and no further
    assert steering == pytest.approx(18000.0 * atan(there * BODY.tan_steering_max) / BODY.steering_max)
    assert motor == pytest.approx(300.0 + 0.5 * (1.0 + 0.1 * there**2) / 0.0005)


def test_the_controllers_get_the_error_to_the_reference_of_the_cycle_before() -> None:
    loops, v, omega = informed(), 0.5, 0.4
    cos_phi = cos(atan(0.5 * omega / v * BODY.wheelbase))
    fed = led_to(loops, v, omega, (v / cos_phi, omega * cos_phi))
    told = (v - 0.1) / cos_phi, (omega - 0.08) * cos_phi  # the same curve, and slower
    motor, steering = loops.step(v, omega, *told, Gains(2.0, 0.0, 0.0), Gains(3.0, 0.0, 0.0), DT)
    assert (motor - fed[0], steering - fed[1]) == pytest.approx((200.0, 240.0))
    motor, steering = loops.step(v, omega, *told, Gains(2.0, 50.0, 0.0), Gains(3.0, 50.0, 0.0), DT)
    assert (motor - fed[0], steering - fed[1]) == pytest.approx((300.0, 320.0)), "they remember"
    loops = informed()
    first = loops.step(1.0, 0.0, 0.0, 0.0, Gains(1.0, 0.0, 0.0), Gains(), DT)
    assert first == informed().step(1.0, 0.0, 0.0, 0.0, *NONE, DT), "a cycle before it was at rest"


def test_cleared_they_are_as_new_and_between_two_readings_they_hold() -> None:
    gains = Gains(2.0, 50.0, 0.1), Gains(3.0, 50.0, 0.1)
    loops = informed()
    assert loops.step(1.0, 0.5, 0.1, 0.0, *gains, 0.0) == (0.0, 0.0)
    first = loops.step(1.0, 0.5, 0.1, 0.0, *gains, DT)
    assert loops.step(0.5, -0.5, 0.2, 0.1, *gains, 0.0) == first
    assert loops.step(1.0, 0.5, 0.1, 0.0, *gains, DT) != first
    loops.clear()
    assert loops.step(1.0, 0.5, 0.1, 0.0, *gains, 0.0) == (0.0, 0.0)
    assert loops.step(1.0, 0.5, 0.1, 0.0, *gains, DT) == first


def test_loops_know_a_car_that_is_known_and_steers() -> None:
    rover, front = Geometry(steering="skid"), Geometry(steering="front")
    for body in (BODY, front):
        assert isinstance(loops_for(KNOWN, body), InformedLoops)
    for known, body in ((KnownCar(), BODY), (KnownCar(), front), (KNOWN, rover)):
        assert isinstance(loops_for(known, body), VelocityLoops)


def test_backwards_a_car_steers_the_other_way_and_a_rover_does_not() -> None:
    gains = Gains(), Gains(1.0, 0.0, 0.0)
    for body, backwards in ((BODY, -300.0), (Geometry(steering="skid"), 300.0)):
        for v, steering in ((0.5, 300.0), (0.0, 300.0), (-0.5, backwards)):
            assert loops_for(KnownCar(), body).step(v, 0.3, v, 0.0, *gains, DT)[1] == pytest.approx(steering)
