"""What the calibration learns beside the filter, on a drive whose mounts, clocks and slip are known."""

from collections import deque
from math import cos, sin

import numpy as np
import pytest

from benchmarks import random_drives
from benchmarks.drives import BAND
from rigs.human_drive import drive_as_a_person
from tests.examples import some
from txt1.estimation.calibration import Calibration, Corrections
from txt1.estimation.sensors import Kind, Measurement
from txt1.estimation.settings import EstimationConfig, FusedConfig
from txt1.kernel.loop import run
from txt1.robot import Robot

CYCLE = 0.02  # s


def driven(
    seed: int, lever: tuple[float, float] = (0.0, 0.0), late: float = 0.0, seconds: float = 60.0, vague: float = 0.001
) -> Calibration:
    """A drive of manoeuvres, each with a speed, a curvature and a slip of its own, seen by motion capture.

    The sensor sits at `lever` (m) and its readings are so late (s). It is stated to sit at (0, 0), with a right clock.
    Every second of the positions that are compared is as vague as told (m), the others are to the millimetre.
    """
    rng, found = np.random.default_rng(seed), Calibration()
    gyro: deque[tuple[float, float]] = deque(maxlen=1000)
    x, y, theta, v, omega, left, slip = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    speed, curvature = 0.0, 0.0
    for cycle in range(round(seconds / CYCLE)):
        if left <= 0.0:
            left, speed, curvature = rng.uniform(0.3, 3.0), rng.uniform(0.2, 1.2), rng.uniform(-1.7, 1.7)
            slip = rng.uniform(0.0, 0.2) if rng.random() < 0.5 else 0.0
        left -= CYCLE
        v += np.clip(speed - v, -3.0 * CYCLE, 3.0 * CYCLE)
        omega += np.clip(v * curvature - omega, -10.0 * CYCLE, 10.0 * CYCLE)
        way = theta + 0.5 * omega * CYCLE
        x, y, theta = x + v * CYCLE * cos(way), y + v * CYCLE * sin(way), theta + omega * CYCLE
        now = CYCLE * (cycle + 1)
        gyro.append((now - 0.5 * CYCLE, omega))
        c, s = cos(theta), sin(theta)
        seen = (x + c * lever[0] - s * lever[1], y + s * lever[0] + c * lever[1], theta)
        sigma = 0.001 if cycle // 25 % 2 else vague
        values = tuple(np.array(seen) + rng.normal(size=3) * (sigma, sigma, 2.0 * sigma))
        right = found.corrections
        time, at = now + late - right.delay, (right.x, right.y)
        found.place(Measurement(time, "vicon", Kind.POSE, (0, 1, 2), values, (sigma, sigma, 2.0 * sigma), at), theta)
        found.cycle(now, now, CYCLE, v / (1.0 - slip), omega, gyro)
    return found


def test_a_vague_position_after_a_precise_one_tells_of_no_mount() -> None:
    found = driven(1, seconds=60.0, vague=0.1)
    assert found.corrections == Corrections()
    for name in ("x", "y"):
        value, sigma = found.learned(name)
        assert abs(value) < 3.0 * sigma


def test_a_late_heading_is_not_taken_for_sliding() -> None:
    """A tracker that is late tells a late heading, too: a car that does not slide outwards seemed to."""
    misses = []
    for seed in range(1, 13):
        found = driven(seed, late=0.03, seconds=20.0)
        assert found.corrections.delay == pytest.approx(0.03, abs=0.004)
        value, sigma = found.learned("sideways")
        misses.append(value / sigma)
    # chi-square of 12 at 99 %
    assert sum(miss * miss for miss in misses) < 26.2


def test_a_mount_that_is_wrong_ahead_is_not_moved_to_the_side() -> None:
    """Ahead it shows at once, and to the side it looks like slip: the one is no evidence on the other."""
    for seed in range(1, 6):
        found = driven(seed, lever=(0.05, 0.0))
        assert found.corrections.x == pytest.approx(0.05, abs=0.005)
        assert found.corrections.y == 0.0


@pytest.mark.parametrize("left", some(0.03, rest=[0.0]))
def test_slip_of_its_own_in_each_manoeuvre_is_not_taken_for_a_mount(left: float) -> None:
    """The mount to the left is as uncertain as told, though slip and curvature change together."""
    misses = []
    for seed in range(1, 13):
        value, sigma = driven(seed, lever=(0.0, left), seconds=30.0).learned("y")
        misses.append((value - left) / sigma)
    # chi-square of 12 at 99 %
    assert sum(miss * miss for miss in misses) < 26.2


def test_a_mount_is_told_as_uncertain_as_a_tape_measure_and_a_mistake_leave_it() -> None:
    """Until the drive tells: 3 cm, or 30 cm with a probability of 0.1."""
    along, across = np.sqrt(np.array(Calibration().doubt((0.0,) * 8))[[0, 2]])
    assert along == across == pytest.approx(np.sqrt(0.9 * 0.03**2 + 0.1 * 0.3**2))


def test_a_gyro_that_reads_too_much_is_corrected_in_full() -> None:
    """What was corrected already was left over again: a gyro 3 % off was taken for one 1.5 % off."""
    configs = {"vicon": EstimationConfig(preset="vicon", settings={"imu": FusedConfig(scale=0.03)})}

    async def drive(robot: Robot) -> None:
        await drive_as_a_person(robot, 201, 20.0)

    estimator = run(random_drives.driven("txt1", 201, drive, configs), speed="max")["vicon"].estimator
    value, sigma = estimator.calibrations["vicon"].learned("scale")
    assert estimator.calibrations["vicon"].corrections.scale == value
    # it reads 1 / 1.03 now
    assert value == pytest.approx(1.0 / 1.03 - 1.0, abs=3.0 * sigma)
    assert sigma < 0.003


def test_a_corrected_clock_puts_no_reading_into_the_future() -> None:
    """A delay stated 30 ms too long was taken for 42 ms too long at first: each reading was left out from then on."""
    configs = {"vicon": EstimationConfig(preset="vicon", settings={"vicon": FusedConfig(delay=0.03)})}

    async def drive(robot: Robot) -> None:
        await drive_as_a_person(robot, 31, 20.0)

    watch = run(random_drives.driven("txt1", 31, drive, configs), speed="max")["vicon"]
    assert watch.estimator.calibrations["vicon"].corrections.delay == pytest.approx(-0.03, abs=0.002)
    assert {each.name: each.late for each in watch.estimator.trusts()}["vicon"] == 0
    # 0.1 m and more
    assert watch.result()["largest"] < 0.02


@pytest.mark.long
def test_beside_a_gps_the_heading_says_how_far_a_wrong_gyro_may_have_turned_it() -> None:
    """A gyro 3 % off: NEES was 56 and 10 on these drives, as no scale but 1 was thought of."""
    configs = {"imu-gps": EstimationConfig(preset="imu-gps", settings={"imu": FusedConfig(scale=0.03)})}

    for seed in (1, 2):

        async def drive(robot: Robot, seed: int = seed) -> None:
            await drive_as_a_person(robot, seed, 60.0)

        watch = run(random_drives.driven("txt1", seed, drive, configs), speed="max")["imu-gps"]
        assert watch.result()["nees"] < BAND[1]
