"""The fusion: readings at their own times in any order, and sensors that are believed no longer, and again."""

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from math import cos, hypot, inf, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.estimation.fusion import HORIZON, Fusion
from txt1.estimation.judging import KEEPS_FOR, Belonging, WitnessValues
from txt1.estimation.sensors import Kind, Measurement
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle

V, OMEGA, RADIUS = 0.5, 0.25, 2.0  # the car goes round in a circle
START = (1.0, 2.0, 0.7)
SENSORS = {
    "imu": Belonging(), "encoders": Belonging(), "vicon": Belonging(tells_pose=True), "compass": Belonging(),
}  # fmt: skip


def truth(time: float) -> tuple[float, float, float]:
    x, y, theta = START
    now = theta + OMEGA * time
    return x + RADIUS * (sin(now) - sin(theta)), y - RADIUS * (cos(now) - cos(theta)), now


class Drive:
    """The circle with sensors whose readings are told exactly but for noise, and a fusion that hears them."""

    def __init__(
        self,
        names: tuple[str, ...] = ("imu", "encoders", "vicon"),
        seed: int = 1,
        *,
        start: bool = False,
        mounts: dict[str, tuple[float, float]] | None = None,
    ) -> None:
        known = (START, (0.02, 0.02, 0.03)) if start else None
        sensors = {name: SENSORS.get(name, Belonging(tells_pose=True)) for name in names}
        self.fusion = Fusion(sensors, start=known, mounts=mounts)
        self.rng = np.random.default_rng(seed)
        self.names = names
        self.cycle = 0
        # the steering tells the same as the wheels
        self.steers = False
        self.estimate: Estimate

    def readings(self, time: float) -> list[Measurement]:
        noise = self.rng.normal(size=8)
        x, y, theta = truth(time)
        made = {
            "encoders": (Kind.ENCODERS, (V, OMEGA), (0.006, 0.04)),
            "imu": (Kind.GYRO, (OMEGA + 0.01,), (0.006,)),
            "vicon": (Kind.POSE, (x, y, wrap_angle(theta)), (0.002, 0.002, 0.003)),
            "gps": (Kind.POSE, (x, y), (0.3, 0.3)),
            "compass": (Kind.POSE, (wrap_angle(theta),), (0.003,)),
        }
        found = []
        for name in self.names:
            kind, values, sigmas = made[name]
            if name == "gps" and self.cycle % 10:
                continue
            told = tuple(float(v + s * n) for v, s, n in zip(values, sigmas, noise, strict=False))
            rows = (2,) if name == "compass" else tuple(range(len(values)))
            found.append(Measurement(time, name, kind, rows, told, sigmas))
            noise = np.roll(noise, 3)
        return found

    def go(
        self,
        seconds: float,
        change: Callable[[Measurement], Measurement | None] = lambda each: each,
    ) -> None:
        for _ in range(round(seconds / 0.02)):
            self.cycle += 1
            heard = []
            for each in self.readings(self.cycle * 0.02):
                changed = change(each)
                if changed is not None:
                    self.fusion.take(changed)
                    heard.append(changed)
            self.estimate = self.fusion.step(self.cycle * 0.02)
            told = {each.sensor: each.values for each in heard}
            if "encoders" in told:
                gyro = told["imu"][0] - self.estimate.bias if "imu" in told else None
                v, omega = told["encoders"]
                steering = omega if self.steers else None
                self.fusion.cycle(WitnessValues(self.cycle * 0.02, v, omega, gyro, steering), 0.02)

    def error(self) -> tuple[float, float]:
        x, y, theta = truth(self.cycle * 0.02)
        found = self.estimate
        return float(np.hypot(found.x - x, found.y - y)), abs(wrap_angle(found.theta - theta))

    def trust(self, name: str) -> tuple[bool, str]:
        (found,) = (each for each in self.fusion.trusts() if each.name == name)
        return found.believed, found.reason


@cache
def known(mounted: bool) -> Drive:
    drive = Drive(mounts={"vicon": (0.001, 0.001)} if mounted else None)
    drive.go(10.0)
    return drive


def after_10_s(mounted: bool = False) -> Drive:
    """A copy of a drive in which nothing has failed yet; `mounted`: the mount of its motion capture is learned."""
    try:
        return deepcopy(known(mounted))
    except TypeError:
        # what mypyc has compiled cannot be copied
        return known.__wrapped__(mounted)


def test_it_finds_pose_velocities_and_the_gyros_bias() -> None:
    drive = after_10_s()
    assert drive.estimate.located
    assert drive.error()[0] < 0.003
    assert drive.estimate.v == pytest.approx(V, abs=0.02)
    assert drive.estimate.omega == pytest.approx(OMEGA, abs=0.02)
    assert drive.estimate.bias == pytest.approx(0.01, abs=0.002)
    assert all(each.believed for each in drive.fusion.trusts())


def test_positions_alone_tell_the_heading_when_it_has_driven_some_way() -> None:
    drive = Drive(("imu", "encoders", "gps"))
    drive.go(1.0)
    assert not drive.estimate.located
    drive.go(29.0)
    assert drive.estimate.located
    assert drive.error()[0] < 0.3
    assert drive.error()[1] < 0.1


@settings(max_examples=examples(5))
@given(st.randoms(use_true_random=False))
def test_the_order_in_which_readings_arrive_makes_no_difference(random: object) -> None:
    one, two = Drive(), Drive()
    one.go(3.0)
    two.go(3.0)
    waiting: list[Measurement] = []
    for _ in range(20):
        one.cycle += 1
        two.cycle += 1
        for each, same in zip(one.readings(one.cycle * 0.02), two.readings(two.cycle * 0.02), strict=True):
            one.fusion.take(each)
            waiting.append(same)
        one.estimate = one.fusion.step(one.cycle * 0.02)
        random.shuffle(waiting)  # type: ignore[attr-defined]
        for _ in range(random.randrange(len(waiting) + 1)):  # type: ignore[attr-defined]
            two.fusion.take(waiting.pop())
        two.estimate = two.fusion.step(two.cycle * 0.02)
    for each in waiting:
        two.fusion.take(each)
    two.estimate = two.fusion.step(two.cycle * 0.02)
    assert two.estimate[:5] == pytest.approx(one.estimate[:5], abs=1e-6)
    assert two.estimate.covariance == pytest.approx(one.estimate.covariance, abs=1e-8)


def test_a_reading_older_than_the_horizon_is_counted_and_left_out() -> None:
    drive = Drive()
    drive.go(2.0)
    before = drive.estimate
    drive.fusion.take(Measurement(2.0 - HORIZON - 0.1, "vicon", Kind.POSE, (0, 1, 2), (9.0, 9.0, 0.0), (1.0, 1.0, 1.0)))
    assert drive.fusion.step(2.0)[:5] == pytest.approx(before[:5], abs=1e-12)
    assert {each.name: each.late for each in drive.fusion.trusts()}["vicon"] == 1


def test_late_by_0_3_s_it_is_as_good_as_in_time() -> None:
    drive, late = Drive(), list[Measurement]()
    drive.go(2.0)

    def behind(each: Measurement) -> Measurement | None:
        if each.sensor != "vicon":
            return each
        late.append(each)
        return late.pop(0) if len(late) > 15 else None

    drive.go(8.0, behind)
    assert drive.error()[0] < 0.006
    assert drive.trust("vicon") == (True, "")


def test_each_reading_keeps_by_how_much_it_was_put_back() -> None:
    drive = Drive(mounts={"vicon": (0.1, 0.05)})
    drive.go(1.0)
    # its clock, 30 ms behind what is stated: neither was taken after it had come
    lean = drive.fusion._newest()[0].lean  # noqa: SLF001 - what was learned
    assert lean is not None
    lean.value[5] = -0.03
    stamps = 1.001, 1.015
    for time in stamps:
        drive.fusion.take(Measurement(time, "vicon", Kind.POSE, (0, 1, 2), truth(time), (0.002, 0.002, 0.003)))
    drive.fusion.step(1.02)
    entries = [each for each in drive.fusion._entries if each.measurement.time > 1.01]  # noqa: SLF001
    assert [each.measurement.time + each.late for each in entries] == pytest.approx(stamps)


FAILURES: dict[str, tuple[Callable[[Measurement], Measurement | None], str]] = {
    "is no number": (lambda m: m._replace(values=(float("nan"), *m.values[1:])), "no number"),
    "has a sigma that is no number": (lambda m: m._replace(sigmas=(*m.sigmas[:-1], float("nan"))), "no number"),
    "is silent": (lambda m: None, "silent"),
    "is 2 s late": (lambda m: m._replace(time=m.time - 2.0), "not in time"),
    "is of the future": (lambda m: m._replace(time=m.time + 2.0), "not in time"),
    "is 0.3 s ahead": (lambda m: m._replace(time=m.time + 0.3), "not in time"),
    "stands still": (lambda m: m._replace(values=(*truth(10.0)[:2], 0.5)[: len(m.values)]), "stands still"),
}


@pytest.mark.parametrize("sensor", ["encoders", "imu", "vicon"])
@pytest.mark.parametrize("failure", FAILURES)
def test_a_sensor_whose_readings_are_invalid_is_left_out_and_believed_again(sensor: str, failure: str) -> None:
    drive = after_10_s(mounted=True)
    change, reason = FAILURES[failure]
    drive.go(4.0, lambda m: change(m) if m.sensor == sensor else m)
    believed, why = drive.trust(sensor)
    assert not believed
    assert reason in why
    assert drive.error()[0] < (0.1 if sensor == "vicon" else 0.006)
    drive.go(4.0)
    assert drive.trust(sensor) == (True, "")
    assert drive.error()[0] < 0.006
    told = " ".join(drive.fusion.changes)
    assert f"'{sensor}' is not believed any more" in told
    assert f"'{sensor}' is believed again" in told


def test_poses_of_a_fast_tracker_are_averaged_with_velocities_between_them() -> None:
    def used(drive: Drive) -> int:
        return {each.name: each.used for each in drive.fusion.trusts()}["vicon"]

    alone, between = Drive(), Drive()
    alone.go(2.0)
    between.go(2.0)
    before = used(alone)
    for time in (2.0025, 2.005, 2.0075, 2.01):
        pose = Measurement(time, "vicon", Kind.POSE, (0, 1, 2), truth(time), (0.002, 0.002, 0.003))
        alone.fusion.take(pose)
        between.fusion.take(pose)
        between.fusion.take(Measurement(time, "vicon", Kind.VELOCITY, (0, 1), (V, OMEGA), (0.05, 0.1)))
    alone.fusion.step(2.02)
    between.fusion.step(2.02)
    assert used(alone) == before + 2
    assert used(between) == before + 2 + 4


def test_a_robot_on_a_mark_knows_its_pose_before_a_gps_has_told_it() -> None:
    told, found = Drive(("imu", "encoders", "gps"), start=True), Drive(("imu", "encoders", "gps"))
    told.go(0.2)
    found.go(0.2)
    assert told.estimate.located and not found.estimate.located
    told.go(5.0)
    assert told.error()[0] < 0.1
    assert told.error()[1] < 0.1


def test_a_single_outlier_moves_nothing() -> None:
    drive = after_10_s()
    drive.go(0.02, lambda m: m._replace(values=(m.values[0] + 0.08, *m.values[1:])) if m.sensor == "vicon" else m)
    assert drive.error()[0] < 0.006
    assert drive.trust("vicon") == (True, "")


def test_a_position_that_jumps_is_left_out_and_the_estimate_tells_both_hypotheses() -> None:
    drive = after_10_s()
    sure = drive.estimate.sigma(0)
    jump = lambda m: m._replace(values=(m.values[0] + 1.0, *m.values[1:])) if m.sensor == "vicon" else m  # noqa: E731
    drive.go(KEEPS_FOR - 1.0, jump)
    assert drive.trust("vicon") == (False, "has jumped")
    assert drive.error()[0] < 0.1
    assert drive.estimate.sigma(0) > 1.0 / 3.0 > sure
    drive.go(2.0)
    assert drive.trust("vicon") == (True, "")
    assert drive.error()[0] < 0.006


def test_a_heading_alone_that_jumps_may_be_the_robots_that_was_turned() -> None:
    drive = Drive(("imu", "encoders", "compass"), start=True)
    drive.go(5.0)
    sure = drive.estimate.sigma(2)
    turn = lambda m: m._replace(values=(wrap_angle(m.values[0] + 1.0),)) if m.sensor == "compass" else m  # noqa: E731
    drive.go(1.0, turn)
    assert drive.trust("compass") == (False, "has jumped")
    assert drive.error()[1] < 0.1
    assert drive.estimate.sigma(2) > 1.0 / 3.0 > sure
    # of the place it says nothing
    assert drive.estimate.sigma(0) < 0.1
    drive.go(KEEPS_FOR, turn)
    assert drive.trust("compass") == (True, "")
    assert drive.error()[1] == pytest.approx(1.0, abs=0.05)
    assert "'compass' stays elsewhere: the robot was carried there" in drive.fusion.changes


def test_a_robot_carried_unseen_is_found_where_the_only_sensor_has_it() -> None:
    drive = after_10_s()
    carried = lambda m: m._replace(values=(m.values[0] + 1.0, *m.values[1:])) if m.sensor == "vicon" else m  # noqa: E731
    drive.go(KEEPS_FOR + 0.5, carried)
    assert drive.trust("vicon") == (True, "")
    assert drive.error()[0] == pytest.approx(1.0, abs=0.01)
    assert any("was carried there" in each for each in drive.fusion.changes)


@pytest.mark.parametrize("share", [0.8, 1.2, 1.5])
def test_a_sensor_of_the_place_is_not_dropped_for_contradicting_the_wheels(share: float) -> None:
    drive = after_10_s()
    slip = lambda m: m._replace(values=(share * m.values[0], share * m.values[1])) if m.sensor == "encoders" else m  # noqa: E731
    for _ in range(100):
        drive.go(0.02, slip)
        assert drive.trust("vicon") == (True, "")
        assert drive.error()[0] < 0.03
    assert drive.error()[0] < 0.006
    assert drive.estimate.v == pytest.approx(V, abs=0.05)


def test_a_drifting_sensor_of_the_place_is_followed_like_a_car_that_slides() -> None:
    drive = after_10_s()
    begun = drive.cycle * 0.02

    def drift(m: Measurement) -> Measurement:
        further = 0.02 * (m.time - begun) if m.sensor == "vicon" else 0.0
        return m._replace(values=(m.values[0] + further, *m.values[1:]))

    drive.go(5.0, drift)
    assert drive.trust("vicon") == (True, "")
    assert drive.error()[0] == pytest.approx(0.1, abs=0.02)


def test_a_frame_that_moves_as_no_car_slips_is_found_out_and_the_pose_put_back() -> None:
    drive = after_10_s()
    begun = drive.cycle * 0.02

    def drift(m: Measurement) -> Measurement:
        further = 0.3 * (m.time - begun) if m.sensor == "vicon" else 0.0
        return m._replace(values=(m.values[0] + further, *m.values[1:]))

    for _ in range(250):
        drive.go(0.02, drift)
        if drive.trust("vicon")[0]:
            # the more likely a frame moves, the more uncertain is a pose that follows it
            assert drive.error()[0] < 9.0 * hypot(drive.estimate.sigma(0), drive.estimate.sigma(1))
    assert not drive.trust("vicon")[0]
    assert "its frame moves" in drive.trust("vicon")[1]
    assert drive.error()[0] < 0.1 * 0.3 * 5.0, "a tenth of the frame's way"
    assert 3.0 * drive.estimate.sigma(0) > drive.error()[0]
    drive.go(KEEPS_FOR + 1.0)
    assert drive.trust("vicon") == (True, "")
    assert drive.error()[0] < 0.01


def aside(m: Measurement, most: float = inf) -> Measurement:
    """The reading in a frame that moves by 0.05 m/s from 10 s on, for `most` seconds."""
    if m.sensor != "vicon":
        return m
    x, y, theta = m.values
    return m._replace(values=(x, y + 0.05 * min(m.time - 10.0, most), theta))


def test_a_frame_that_was_found_to_move_is_not_believed_while_it_is_likely_to() -> None:
    drive = after_10_s()
    found = False
    for _ in range(500):
        drive.go(0.02, aside)
        assert not (found and drive.trust("vicon")[0])
        found = found or not drive.trust("vicon")[0]
        if found:
            assert drive.error()[0] < 3.0 * hypot(drive.estimate.sigma(0), drive.estimate.sigma(1))
    assert found


@pytest.mark.parametrize("wheels", [None, (float("nan"), 0.0)])
def test_a_frame_that_stands_is_believed_again_without_wheels_too(wheels: tuple[float, float] | None) -> None:
    drive = after_10_s()
    drive.go(3.0, aside)
    assert not drive.trust("vicon")[0]
    failing = lambda m: (wheels and m._replace(values=wheels)) if m.sensor == "encoders" else aside(m, 3.0)  # noqa: E731
    drive.go(KEEPS_FOR + 2.0, failing)
    assert drive.trust("vicon") == (True, "")


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_wheels_that_slip_are_no_frame_that_moves(share: float) -> None:
    drive = after_10_s()
    slip = lambda m: m._replace(values=(share * m.values[0], share * m.values[1])) if m.sensor == "encoders" else m  # noqa: E731
    drive.go(6.0, slip)
    assert drive.trust("vicon") == (True, "")
    assert not any("frame moves" in each for each in drive.fusion.changes)


def test_a_filter_that_begins_late_waits_for_its_sensors_just_as_long() -> None:
    drive = Drive(("imu", "encoders"))
    drive.cycle = 100
    drive.go(0.04, lambda m: None if m.sensor == "encoders" else m)
    assert drive.trust("encoders") == (True, "")
    drive.go(1.1, lambda m: None if m.sensor == "encoders" else m)
    assert drive.trust("encoders") == (False, "silent")


def test_wheels_that_lock_for_a_moment_do_not_stop_the_car() -> None:
    drive = Drive(("imu", "encoders"))
    drive.go(2.0)
    locked = lambda m: m._replace(values=(0.0, 0.0)) if m.sensor == "encoders" else m  # noqa: E731
    drive.go(0.02, locked)
    assert V - 0.3 <= drive.estimate.v <= V, "no tyre stops it at once"
    drive.go(0.1, locked)
    assert drive.estimate.v == pytest.approx(0.0, abs=0.05), "it stands, as wheels do not lock for so long"


def test_a_gyro_that_errs_is_no_frame_that_moves() -> None:
    drive = after_10_s()
    begun = drive.cycle * 0.02
    wrong = lambda m: m._replace(values=(m.values[0] + 0.05 * (m.time - begun),)) if m.sensor == "imu" else m  # noqa: E731
    drive.go(5.0, wrong)
    assert drive.trust("vicon") == (True, "")


def test_a_heading_against_the_gyro_is_taken_in_whatever_the_noise_of_the_place() -> None:
    drive = after_10_s()
    jump = lambda m: m._replace(values=(m.values[0] + 1.0,)) if m.sensor == "imu" else m  # noqa: E731
    for _ in range(20):
        drive.go(0.02, jump)
        assert drive.error()[1] < 3.0 * max(0.01, drive.estimate.sigma(2))
    assert drive.error()[1] < 0.01


def test_a_second_sensor_in_a_frame_of_its_own_is_left_out_and_told_once() -> None:
    drive = Drive(("imu", "encoders", "vicon", "gps"))
    drive.go(10.0, lambda m: m._replace(values=(m.values[0] + 7.0, m.values[1])) if m.sensor == "gps" else m)
    assert drive.error()[0] < 0.006
    assert drive.trust("gps") == (False, "measures in another frame than 'vicon'")
    assert sum("another frame" in each for each in drive.fusion.changes) == 1


def test_a_compass_is_no_witness_against_positions() -> None:
    drive = Drive(("imu", "encoders", "gps", "compass"), start=True)

    def spinning(m: Measurement) -> Measurement:
        if m.sensor == "gps":
            return m._replace(values=truth(m.time)[:2], sigmas=(0.02, 0.02))
        return m._replace(values=(1.5 * V, m.values[1])) if m.sensor == "encoders" and m.time > 5.0 else m

    drive.go(7.0, spinning)
    assert not any("another frame" in each for each in drive.fusion.changes)
    assert drive.error()[0] < 0.05


def test_a_compass_that_is_off_beside_motion_capture_is_left_out() -> None:
    drive = Drive(("imu", "encoders", "vicon", "compass"))
    drive.go(5.0, lambda m: m._replace(values=(m.values[0] + 0.3,)) if m.sensor == "compass" else m)
    assert drive.trust("compass") == (False, "measures in another frame than 'vicon'")
    assert drive.error()[1] < 0.01


def test_when_a_gyro_is_outvoted_the_wheels_turned_the_car_in_the_last_0_5_s() -> None:
    drive = Drive(("imu", "encoders"))
    drive.steers = True
    drive.go(5.0)
    before = drive.estimate.theta
    # a gyro that tells the old curve, while the car has steered to the other side
    drive.go(0.4, lambda m: m._replace(values=(V, -1.0)) if m.sensor == "encoders" else m)
    assert wrap_angle(drive.estimate.theta - before) > 0.0
    drive.fusion.judge_by_vote()
    assert drive.trust("imu") == (False, "is contradicted by two others")
    drive.estimate = drive.fusion.step(drive.cycle * 0.02)
    assert wrap_angle(drive.estimate.theta - before) == pytest.approx(-0.4, abs=0.05)


def test_the_heading_is_as_uncertain_as_an_outvoted_gyro_may_have_turned_it() -> None:
    drive = Drive(("imu", "encoders", "gps"), start=True)
    drive.go(5.0)
    for _ in range(30):
        drive.go(0.1, lambda m: m._replace(values=(m.values[0] + 0.3,)) if m.sensor == "imu" else m)
        drive.fusion.judge_by_vote()
    drive.steers = True
    drive.go(0.4, lambda m: m._replace(values=(m.values[0] + 0.5,)) if m.sensor == "imu" else m)
    drive.fusion.judge_by_vote()
    assert drive.trust("imu") == (False, "is contradicted by two others")
    drive.estimate = drive.fusion.step(drive.cycle * 0.02)
    assert 0.2 < drive.error()[1] < 3.0 * drive.estimate.sigma(2)


@pytest.mark.parametrize("besides", [(), ("compass",)])
def test_once_no_sensor_tells_the_place_the_wheels_may_slip_otherwise_than_before(besides: tuple[str, ...]) -> None:
    drive = Drive(("imu", "encoders", "vicon", *besides))
    drive.go(10.0)

    def blind(m: Measurement) -> Measurement | None:
        if m.sensor == "vicon":
            return None
        return m._replace(values=(m.values[0] / 0.85, m.values[1] / 0.85)) if m.sensor == "encoders" else m

    drive.go(2.5, blind)
    # a heading tells no place
    assert 0.1 < drive.error()[0] < 3.0 * hypot(drive.estimate.sigma(0), drive.estimate.sigma(1))


def test_the_pose_is_as_uncertain_as_a_gps_misses_it_for_long() -> None:
    drive = Drive(("imu", "encoders", "gps"), start=True)

    def poor(m: Measurement) -> Measurement:
        if m.sensor != "gps":
            return m
        x, y, _ = truth(m.time)
        told = x + 3.0 * (m.values[0] - x), y + 3.0 * (m.values[1] - y)
        return m._replace(values=told, sigmas=(0.9, 0.9))

    def faster(m: Measurement) -> Measurement:
        further = 0.06 * (m.time - 20.0)
        return m._replace(values=(m.values[0] + further, m.values[1])) if m.sensor == "encoders" else poor(m)

    drive.go(20.0, poor)
    worst, apart = 0.0, []
    for _ in range(750):
        drive.go(0.02, faster)
        worst = max(worst, drive.error()[0])
        apart.append(drive.error()[0] / hypot(drive.estimate.sigma(0), drive.estimate.sigma(1)))
    assert worst > 0.8, "wheels that err hide in a GPS's noise"
    assert max(apart) < 2.6
    assert np.mean(np.square(apart)) < 2.0


def test_wheels_beside_a_gps_tell_nothing_of_their_slip_without_a_gyro() -> None:
    rng = np.random.default_rng(1)
    fusion = Fusion(
        {"encoders": Belonging(), "gps": Belonging(tells_pose=True)}, start=((0.0, 0.0, 0.0), (0.02, 0.02, 0.03))
    )
    x = y = theta = curvature = 0.0
    for cycle in range(1, 2001):
        time = 0.02 * cycle
        if cycle % 50 == 1:
            curvature = float(rng.uniform(-1.2, 1.2))
        way, turn = 0.8 * 0.02, 0.8 * curvature * 0.02
        x, y, theta = x + way * cos(theta + 0.5 * turn), y + way * sin(theta + 0.5 * turn), theta + turn
        wheels = (0.8 + 0.006 * float(rng.normal()), 0.8 * curvature + 0.04 * float(rng.normal()))
        fusion.take(Measurement(time - 0.01, "encoders", Kind.ENCODERS, (0, 1), wheels, (0.006, 0.04)))
        if cycle % 10 == 0:
            told = (x + float(rng.normal()), y + float(rng.normal()))
            fusion.take(Measurement(time, "gps", Kind.POSE, (0, 1), told, (1.0, 1.0)))
        estimate = fusion.step(time)
        assert abs(estimate.slip) < 0.15, "there is none"
    assert abs(wrap_angle(estimate.theta - theta)) < 3.0 * estimate.sigma(2)


def test_the_heading_goes_round_and_round() -> None:
    drive = Drive()
    drive.go(2.5 * 2.0 * pi / OMEGA)
    assert -pi < drive.estimate.theta <= pi
    assert drive.error()[1] < 0.01


def test_a_robot_that_was_carried_elsewhere_finds_its_pose_anew() -> None:
    drive = Drive()
    drive.go(5.0)
    drive.fusion.lifted()
    moved = lambda m: m._replace(values=(m.values[0] + 3.0, *m.values[1:])) if m.sensor == "vicon" else m  # noqa: E731
    drive.go(0.1, moved)
    assert drive.estimate.located
    assert drive.error()[0] == pytest.approx(3.0, abs=0.01)
    assert drive.trust("vicon") == (True, "")
