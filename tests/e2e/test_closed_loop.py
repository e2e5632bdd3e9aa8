"""With the thesis's gains the simulated vehicle behaves as the thesis reports (4.2, 4.4), driven through the API."""

import math

import numpy as np
import pytest

from tests.e2e.conftest import ENDLESS, Sample, recorder
from txt1.robot import Robot

SEEDS = (1, 2, 3)
LOCK = 0.5 / 0.56  # rad/s, the yaw rate of full lock at 0.5 m/s


def smooth(values: list[float], window: int = 10) -> np.ndarray:
    """0.2 s means: one encoder tick is 1.6 % of 0.5 m/s."""
    return np.convolve(values, np.ones(window) / window, mode="valid")


async def drive(seed: int, *legs: tuple[float, float, float]) -> list[list[Sample]]:
    """The samples of each leg (v, omega, seconds), driven one after the other."""
    async with Robot.open("sim", seed=seed, settings=ENDLESS) as robot:
        assert await robot.load_gains()
        samples = recorder(robot)
        parts = []
        for v, omega, seconds in legs:
            start = len(samples)
            await robot.drive(v, omega, seconds)
            parts.append(samples[start:])
        return parts


@pytest.mark.parametrize("seed", SEEDS)
async def test_a_step_to_half_a_metre_a_second_is_fast_with_little_overshoot(seed: int) -> None:
    [step] = await drive(seed, (0.5, 0.0, 5.0))
    start = step[0].time
    rise = next(s.time for s in step if s.v >= 0.45) - next(s.time for s in step if s.v >= 0.05)
    assert rise < 0.6
    assert max(s.v for s in step) <= 0.55
    settled = smooth([s.v for s in step if s.time - start >= 1.5])
    assert np.all(np.abs(settled - 0.5) <= 0.025)


@pytest.mark.parametrize("seed", SEEDS)
async def test_full_lock_disturbs_the_speed_by_2_to_10_per_cent_and_it_recovers_within_5(seed: int) -> None:
    _, bend = await drive(seed, (0.5, 0.0, 4.0), (0.5, LOCK, 4.0))
    start = bend[0].time
    speed = smooth([s.v for s in bend])
    assert 0.02 <= (0.5 - speed.min()) / 0.5 <= 0.10
    recovered = smooth([s.v for s in bend if s.time - start >= 1.0])
    assert np.all(np.abs(recovered - 0.5) <= 0.025)
    assert bend[-1].rear == 18000, "the steering is at its lock"


@pytest.mark.parametrize("seed", SEEDS)
async def test_a_circle_has_its_radius_and_its_laps_overlap(seed: int) -> None:
    lap = 2.0 * math.pi / 0.5
    _, laps = await drive(seed, (0.5, 0.5, 5.0), (0.5, 0.5, 3.0 * lap))
    path = np.array([(s.x, s.y) for s in laps])
    # least-squares circle: x^2 + y^2 = 2 a x + 2 b y + c
    a, b, c = np.linalg.lstsq(np.c_[2.0 * path, np.ones(len(path))], (path**2).sum(axis=1), rcond=None)[0]
    assert math.sqrt(c + a * a + b * b) == pytest.approx(1.0, rel=0.03)
    # every point of the third lap is near the path of the first one
    first, third = path[: len(path) // 3], path[-len(path) // 3 :]
    gaps = np.sqrt(((third[:, None, :] - first[None, :, :]) ** 2).sum(axis=2)).min(axis=1)
    assert gaps.max() <= 0.05


async def test_in_reverse_the_yaw_rate_is_followed_too() -> None:
    [back] = await drive(1, (-0.5, 0.3, 6.0))
    last = back[-100:]
    assert np.mean([s.v for s in last]) == pytest.approx(-0.5, rel=0.05)
    assert (last[-1].theta - last[0].theta) / (last[-1].time - last[0].time) == pytest.approx(0.3, rel=0.1)


async def test_the_two_halves_of_the_yaw_rate_mirror_each_other() -> None:
    [left] = await drive(1, (0.5, 0.4, 8.0))
    [right] = await drive(1, (0.5, -0.4, 8.0))
    assert np.mean([s.measured_omega for s in left[-200:]]) == pytest.approx(0.4, rel=0.05)
    assert np.mean([s.measured_omega for s in right[-200:]]) == pytest.approx(-0.4, rel=0.05)
