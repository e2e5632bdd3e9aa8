"""A car with a sensor that fails: who is believed meanwhile, and how far off the estimate is of what it says."""

from collections.abc import Callable, Iterable
from functools import cache
from math import cos, inf, sin
from typing import Any

import numpy as np
import pytest

from benchmarks import mistakes
from benchmarks.sensor_failure import added
from tests.examples import some
from txt1.estimation.sensors import Measurement
from txt1.estimation.settings import PRESETS, EstimationConfig
from txt1.estimation.task import Estimator, Wheels
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import FixReading, ImuReading, TrackerReading

CYCLE = 0.02  # s
CAR = Geometry(steering="front")
KINDS: dict[str, type] = {"imu": ImuReading, "gps": FixReading, "vicon": TrackerReading}
Way = Callable[[float], tuple[float, float]]
"""Speed (m/s) and curvature (1/m) over time."""


class Car:
    """A car whose sensors tell the truth but for noise and what `fails` makes of it, and a filter that hears them."""

    def __init__(self, preset: str, way: Way, slip: float = 0.0, seed: int = 1, *, exact: bool = False) -> None:
        names = PRESETS[preset]  # type: ignore[index]
        self.kinds = {each: KINDS[each] for each in names if each in KINDS}
        config = mistakes.told(names, None) if exact else EstimationConfig(sensors=names)
        self.estimator = Estimator(config, self.kinds, CAR)
        self.estimator.through = lambda measurement: self.fails(measurement)
        self.fails: Callable[[Measurement], Iterable[Measurement]] = sound
        self.way, self.slip, self.rng = way, slip, np.random.default_rng(seed)
        self.now, self.pose = 0.0, (0.0, 0.0, 0.0)
        # by which the gyro reads too much
        self.scale = 0.0
        self.estimate: Estimate
        # of each cycle: m, rad, and the largest of x, y and theta of three of its sigma
        self.errors: list[tuple[float, float, float]] = []

    def noise(self, sigma: float) -> float:
        return sigma * float(self.rng.normal())

    def reading(self, name: str) -> Reading[Any]:
        x, y, theta = self.pose
        if name == "gps":
            return Reading(self.now, FixReading(0, 0, x + self.noise(1), y + self.noise(1), sigma_x=1.0, sigma_y=1.0))
        half = 0.5 * (theta + self.noise(0.001))
        seen = (0.0, 0.0, sin(half), cos(half))
        return Reading(self.now, TrackerReading(x + self.noise(0.001), y + self.noise(0.001), 0.0, seen))

    def go(self, until: float) -> None:
        self.errors.clear()
        while self.now < until - 1e-9:
            self.now += CYCLE
            v, curvature = self.way(self.now)
            x, y, theta = self.pose
            way, turn = v * CYCLE, v * curvature * CYCLE
            middle = theta + 0.5 * turn
            self.pose = x + way * cos(middle), y + way * sin(middle), theta + turn
            for name in self.kinds:
                if name == "imu":
                    for time in (self.now - 0.5 * CYCLE, self.now):
                        told = (1.0 + self.scale) * v * curvature + 0.01 + self.noise(0.006)
                        self.estimator.take(name, Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, told))))
                elif name == "vicon" or round(self.now / CYCLE) % 10 == 0:
                    self.estimator.take(name, self.reading(name))
            rolled = v / (1.0 - self.slip)
            shaken = (self.noise(0.005), self.noise(0.03)) if v else (0.0, 0.0)
            told = Odometry(0.0, 0.0, 0.0, rolled + shaken[0], rolled * curvature + shaken[1])
            counts = STEERING_MAX * np.arctan(curvature * CAR.lever) / CAR.steering_max
            self.estimate = found = self.estimator.step(self.now, Wheels(told, self.now, counts, v))
            x, y, theta = self.pose
            apart = abs(found.x - x), abs(found.y - y), abs(wrap_angle(found.theta - theta))
            share = max(each / found.sigma(place) for place, each in enumerate(apart)) / 3.0
            self.errors.append((float(np.hypot(*apart[:2])), apart[2], share))

    def worst(self) -> tuple[float, float, float]:
        """The largest errors since the last `go` began, m and rad, and the largest share of three sigma."""
        error, heading, share = np.max(self.errors, axis=0).tolist()
        return error, heading, share

    def believed(self, name: str) -> bool:
        return {each.name: each.believed for each in self.estimator.trusts()}[name]


def busy(time: float) -> tuple[float, float]:
    """As a person drives: another speed and another curve every 1.5 s."""
    return stretch(int(time / 1.5))


@cache
def stretch(number: int) -> tuple[float, float]:
    rng = np.random.default_rng(number)
    return float(rng.uniform(0.3, 1.2)), float(rng.uniform(-1.5, 1.5))


def sound(measurement: Measurement) -> Iterable[Measurement]:
    """Every sensor as it is."""
    return (measurement,)


def silent(sensor: str) -> Callable[[Measurement], Iterable[Measurement]]:
    """A sensor that tells nothing."""
    return lambda measurement: () if measurement.sensor == sensor else (measurement,)


def held(sensor: str) -> Callable[[Measurement], Iterable[Measurement]]:
    """A sensor that tells its first values again and again."""
    kept: list[tuple[float, ...]] = []

    def fail(measurement: Measurement) -> Iterable[Measurement]:
        if measurement.sensor != sensor:
            return (measurement,)
        kept.append(measurement.values)
        return (measurement._replace(values=kept[0]),)

    return fail


def late(sensor: str, by: float) -> Callable[[Measurement], Iterable[Measurement]]:
    """A sensor whose readings come later, s."""
    under_way: list[Measurement] = []

    def fail(measurement: Measurement) -> Iterable[Measurement]:
        if measurement.sensor != sensor:
            return (measurement,)
        under_way.append(measurement)
        came = [each for each in under_way if each.time + by <= measurement.time]
        del under_way[: len(came)]
        return came

    return fail


def off(sensor: str, more: Callable[[float], tuple[float, ...]]) -> Callable[[Measurement], Iterable[Measurement]]:
    """A sensor whose values have something added, over time."""

    def fail(measurement: Measurement) -> Iterable[Measurement]:
        if measurement.sensor != sensor:
            return (measurement,)
        return (measurement._replace(values=added(measurement.values, more(measurement.time), 1.0)),)

    return fail


def test_a_tracker_that_froze_while_the_car_stood_holds_nothing_back_at_its_start() -> None:
    car = Car("vicon", lambda time: (0.5, 0.3) if not 5.0 < time < 7.0 else (0.0, 0.3))
    car.go(6.0)
    car.fails = held("vicon")
    car.go(7.5)
    assert not car.believed("vicon")
    assert car.worst()[0] < 0.01
    assert car.worst()[2] < 1.0


def test_encoders_that_freeze_while_the_car_stands_outvote_no_gyro() -> None:
    car = Car("imu-gps", lambda time: busy(time) if not 25.0 < time < 27.0 else (0.0, 0.3))
    car.go(26.0)
    car.fails = held("encoders")
    for until in np.arange(26.5, 40.0, 0.5):
        car.go(float(until))
        assert car.believed("imu")
    assert not car.believed("encoders")
    assert car.worst()[1] < 0.2


def test_without_wheels_a_position_is_as_uncertain_as_the_speed_may_have_changed() -> None:
    shares = []
    for seed in (2, 4):
        car = Car("imu-gps", lambda time: (0.4 if int(time / 4.0) % 2 else 1.0, 0.2), seed=seed)
        car.go(20.0)
        car.fails = silent("encoders")
        car.go(40.0)
        shares += [share for _, _, share in car.errors]
    assert sum(share > 1.0 for share in shares) < 0.01 * len(shares)


def test_a_gyro_that_was_outvoted_is_not_believed_again_for_what_slip_may_explain() -> None:
    car = Car("imu-gps", lambda time: busy(time) if time < 20.0 else (1.2, 2.0))
    car.go(20.0)
    car.fails = off("imu", lambda time: (-1.1 if time < 22.0 else -0.5,))
    car.go(22.0)
    assert not car.believed("imu"), "1.1 rad/s of 2.4 is more than slip does"
    car.go(30.0)
    assert not car.believed("imu"), "0.5 rad/s may be slip, but it is a gyro's that has failed"
    car.fails = sound
    car.go(32.0)
    assert car.believed("imu")


@pytest.mark.parametrize("sensor", some("imu", rest=["encoders"]))
def test_readings_that_are_late_contradict_nobody(sensor: str) -> None:
    car = Car("imu-gps", busy)
    car.go(20.0)
    before = car.worst()[1]
    car.fails = late(sensor, 0.3)
    for until in range(21, 31):
        car.go(float(until))
        assert car.believed("imu")
        assert car.believed("encoders")
        # of a gyro that is late, the wheels tell the last turn, with their slip
        assert car.worst()[1] < before + (0.15 if sensor == "imu" else 0.05)


def test_a_gyro_is_believed_again_once_the_wheels_that_outvoted_it_have_failed() -> None:
    def way(time: float) -> tuple[float, float]:
        return busy(time) if time < 18.0 else (0.02, 0.0) if time < 20.1 else (1.2, 1.5)

    car = Car("imu-gps", way)
    car.go(20.0)
    car.fails = held("encoders")
    seen = []
    for until in np.arange(20.1, 22.0, 0.1):
        car.go(float(until))
        seen.append((car.believed("imu"), car.believed("encoders")))
    assert (False, True) in seen, "a car that creeps turns no faster than its wheels"
    assert (False, False) not in seen
    assert seen[-1] == (True, False)


def test_a_silent_tracker_leaves_the_doubt_of_its_mount_behind() -> None:
    car = Car("vicon", busy)
    car.go(10.0)
    car.fails = silent("vicon")
    before = inf
    while car.believed("vicon"):
        before = car.estimate.sigma(0)
        car.go(car.now + CYCLE)
    assert car.estimate.sigma(0) > 0.95 * before, "nothing has told better since"


def test_slip_that_changes_as_a_tracker_falls_silent_is_soon_in_what_is_told() -> None:
    car = Car("vicon", lambda _: (1.2, 0.3))
    car.go(10.0)
    car.fails = silent("vicon")
    car.slip = 0.12
    car.go(13.0)
    assert car.worst()[0] > 0.15
    assert car.worst()[2] < 1.0


def test_a_fix_far_away_right_after_the_pose_was_found_is_not_followed() -> None:
    car = Car("imu-gps", busy)
    while not (car.now and car.estimate.located):
        car.go(car.now + CYCLE)
    begun = car.now
    car.fails = off("gps", lambda time: (20.0, 0.0) if time < begun + 1.0 else (0.0, 0.0))
    car.go(begun + 3.0)
    assert car.worst()[0] < 2.0


def test_a_tracker_whose_frame_was_moved_is_believed_again_but_not_to_the_millimetre() -> None:
    # on a circle a mount to the side looks like slip, so it has to be known
    car = Car("vicon", lambda _: (0.5, 0.5), seed=2, exact=True)
    car.go(10.0)
    car.fails = off("vicon", lambda time: (0.0, 0.3 * min(time - 10.0, 3.0), 0.0))
    seen = []
    while car.now < 30.0:
        car.go(car.now + CYCLE)
        seen.append(car.believed("vicon"))
        assert car.worst()[2] < 1.0 or all(seen)
    assert not all(seen) and seen[-1]
    assert car.worst()[0] == pytest.approx(0.9, abs=0.02)


def test_a_gps_that_drifts_is_not_believed_again_for_a_fix_that_fits_by_chance() -> None:
    car = Car("imu-gps", busy, exact=True)
    car.go(20.0)

    def drifting(measurement: Measurement) -> Iterable[Measurement]:
        if measurement.sensor != "gps":
            return (measurement,)
        x, y = measurement.values
        return (measurement._replace(values=(x + 2.0 * (car.now - 20.0), y)),)

    car.fails = drifting
    car.go(35.0)
    assert car.worst()[0] < 8.0, "of 30 m"
    car.fails = sound
    car.go(37.0)
    assert car.believed("gps")


def test_a_gps_whose_frame_moved_fits_in_a_row_before_it_is_believed_again() -> None:
    car = Car("imu-gps", busy, exact=True)
    car.go(20.0)
    begun = car.now
    car.fails = off("gps", lambda now: (2.0 * (now - begun), 0.0))
    car.go(24.0)
    assert not car.believed("gps")
    # m to the side of where it is: the fourth is beyond the gate, and no leap
    aside = [0.0, 0.0, 6.0, 11.0, 6.0, 3.0, 0.0, 0.0]

    def near(measurement: Measurement) -> Iterable[Measurement]:
        if measurement.sensor != "gps":
            return (measurement,)
        x, y, _ = car.pose
        return (measurement._replace(values=(x, y + aside.pop(0))),)

    car.fails = near
    for time in (24.6, 24.8, 25.0, 25.2, 25.4):
        car.go(time)
        assert not car.believed("gps")
    car.go(25.6)
    assert car.believed("gps")
    assert car.worst()[0] < 2.0


def test_a_frame_that_moves_while_the_mount_is_learned_is_found_out() -> None:
    car = Car("vicon", busy, slip=0.1)
    car.go(10.0)
    car.fails = off("vicon", lambda time: (0.05 * (time - 10.0), 0.0, 0.0))
    car.go(12.0)
    while car.now < 40.0:
        car.go(car.now + CYCLE)
        assert car.worst()[0] < 3.0 * np.hypot(car.estimate.sigma(0), car.estimate.sigma(1))
    assert not car.believed("vicon")


def test_a_frame_that_moves_is_found_out_beside_a_gyro_whose_scale_was_learned() -> None:
    def way(time: float) -> tuple[float, float]:
        curvature = 1.0 + 0.5 * sin(0.37 * time)
        return 0.7 + 0.2 * sin(0.9 * time), -curvature if int(time / 15.0) % 2 else curvature

    car = Car("vicon", way)
    car.scale = 0.03
    car.go(47.0)
    car.fails = off("vicon", lambda time: (0.05 * (time - 47.0), 0.0, 0.0))
    car.go(51.0)
    assert not car.believed("vicon")


def test_encoders_that_failed_are_believed_again_by_a_car_that_stands() -> None:
    car = Car("imu-gps", lambda time: busy(time) if time < 20.0 else (0.0, 0.3))
    car.go(20.0)
    car.fails = silent("encoders")
    car.go(22.0)
    assert not car.believed("encoders")
    car.fails = sound
    car.go(24.0)
    assert car.believed("encoders")


def test_a_gyro_returns_in_a_curve_too_where_the_wheels_slip_as_is_known() -> None:
    car = Car("imu-gps", lambda time: busy(time) if time < 30.0 else (1.0, 1.5), slip=0.15)
    car.go(30.0)
    car.fails = off("imu", lambda _: (-1.2,))
    car.go(32.0)
    assert not car.believed("imu")
    car.fails = sound
    car.go(42.0)
    assert car.believed("imu")


def test_a_gps_that_holds_its_fix_while_the_car_stands_leaves_the_slip_as_known() -> None:
    car = Car("imu-gps", lambda time: (1.0, 0.4) if time < 40.0 else (0.0, 0.4), slip=0.1)
    car.go(41.0)
    slip = car.estimate.slip
    car.fails = held("gps")
    car.go(100.0)
    assert car.believed("gps"), "of a car that stands the place stays the same"
    assert car.estimate.slip == pytest.approx(slip, abs=0.01)
    car.way = lambda _: (1.0, 0.4)
    car.go(100.06)
    assert car.estimate.sigma(3) < 0.2, "m/s of a speed of 1"


@pytest.mark.parametrize("asks", [False, True])
def test_wheels_that_tell_the_same_are_frozen_only_if_something_else_was_asked(asks: bool) -> None:
    estimator = Estimator(EstimationConfig(sensors=("encoders",)), {}, CAR)
    for cycle in range(1, 200):
        asked = 0.3 + 0.1 * (asks and cycle > 100)
        estimator.step(CYCLE * cycle, Wheels(Odometry(0.0, 0.0, 0.0, 0.3, 0.1), CYCLE * cycle, None, asked))
    (trust,) = estimator.trusts()
    assert (trust.believed, trust.reason) == ((False, "stands still") if asks else (True, ""))


def test_slow_wheels_beside_a_gps_do_not_know_less_of_their_slip_than_at_first() -> None:
    rng, sigmas = np.random.default_rng(1), []
    estimator = Estimator(EstimationConfig(sensors=("encoders", "gps")), {"gps": FixReading}, CAR)
    for cycle in range(1, 5001):
        now, v = CYCLE * cycle, 0.1
        if cycle % 10 == 0:
            x, y = v * now + float(rng.normal()), float(rng.normal())
            estimator.take("gps", Reading(now, FixReading(0, 0, x, y, sigma_x=1.0, sigma_y=1.0)))
        told = Odometry(0.0, 0.0, 0.0, v + 1e-9 * (cycle % 2), 0.0)
        sigmas.append(estimator.step(now, Wheels(told, now, None, v)).sigma(3))
    assert sigmas[-1] < 1.1 * sigmas[500]
