"""A heading in doubt makes the pose uncertain ahead, as the way may be shorter, until positions tell it."""

import numpy as np
import pytest

from txt1.estimation.fusion import Fusion
from txt1.estimation.judging import Belonging
from txt1.estimation.sensors import Kind, Measurement

PERIOD = 0.02  # s
SPEED = 0.5  # m/s


class Straight:
    """A straight drive, with a receiver of positions, from a place that is known and a heading of that sigma."""

    def __init__(self, heading: float) -> None:
        sensors = {"encoders": Belonging(), "gps": Belonging(tells_pose=True, timeout=0.0)}
        self.fusion = Fusion(sensors, slip_sigma=0.001, start=((0.0, 0.0, 0.0), (0.01, 0.01, heading)))
        self.cycle = 0

    def go(self, seconds: float, *, placed: bool) -> tuple[float, float]:
        """The standard deviations of x and y then, m."""
        for _ in range(round(seconds / PERIOD)):
            self.cycle += 1
            now = self.cycle * PERIOD
            self.fusion.take(Measurement(now, "encoders", Kind.ENCODERS, (0, 1), (SPEED, 0.0), (0.006, 0.04)))
            if placed:
                deviations = (0.02, 0.02, 0.05)
                self.fusion.take(Measurement(now, "gps", Kind.POSE, (0, 1, 2), (SPEED * now, 0.0, 0.0), deviations))
            found = self.fusion.step(now)
        return found.sigma(0), found.sigma(1)


@pytest.mark.parametrize("heading", [0.5, 1.0])
def test_a_heading_in_doubt_makes_the_way_ahead_doubtful_until_positions_tell_it(heading: float) -> None:
    sure, unsure = Straight(0.001), Straight(heading)
    usual, doubtful = sure.go(1.0, placed=False), unsure.go(1.0, placed=False)
    shorter = 1.0 - np.cos(np.random.default_rng(1).normal(0.0, heading, 100_000))
    ahead = SPEED * np.sqrt(np.mean(shorter**2))
    assert doubtful[0] ** 2 == pytest.approx(usual[0] ** 2 + ahead**2, rel=0.1)
    assert unsure.go(4.0, placed=True) == pytest.approx(sure.go(4.0, placed=True), rel=0.05)
