"""A speed in doubt makes the pose uncertain by the way, until positions tell it."""

import pytest

from txt1.estimation.fusion import Fusion
from txt1.estimation.judging import Belonging
from txt1.estimation.sensors import Kind, Measurement

PERIOD = 0.02  # s


class Straight:
    """A straight drive at 0.5 m/s, with a receiver of positions."""

    def __init__(self) -> None:
        self.fusion = Fusion({"encoders": Belonging(), "gps": Belonging(tells_pose=True)})
        self.cycle = 0

    def go(self, seconds: float, sigma: float, doubt: float) -> tuple[float, float]:
        """The standard deviations of x and y then, m: positions of that `sigma`, a speed in doubt by so much."""
        for _ in range(round(seconds / PERIOD)):
            self.cycle += 1
            now = self.cycle * PERIOD
            self.fusion.take(Measurement(now, "encoders", Kind.ENCODERS, (0, 1), (0.5, 0.0), (0.006, 0.04)))
            if self.cycle % 10 == 1:
                where, deviations = (0.5 * now, 0.0, 0.0), (sigma, sigma, 0.05)
                self.fusion.take(Measurement(now, "gps", Kind.POSE, (0, 1, 2), where, deviations))
            self.fusion.doubt_speed(doubt, PERIOD)
            found = self.fusion.step(now)
        return found.sigma(0), found.sigma(1)


def test_a_speed_in_doubt_makes_the_pose_doubtful_by_the_way_until_positions_tell_it() -> None:
    sure, unsure = Straight(), Straight()
    for one in (sure, unsure):
        one.go(2.0, 0.05, 0.0)
    usual, doubtful = sure.go(2.0, 5.0, 0.0), unsure.go(2.0, 5.0, 0.2)
    assert doubtful[0] ** 2 == pytest.approx(usual[0] ** 2 + 0.4**2, rel=0.2), "ahead by 2 s of 0.2 m/s"
    assert doubtful[1] == pytest.approx(usual[1], rel=0.02), "not to the side"
    assert unsure.go(5.0, 0.02, 0.0) == pytest.approx(sure.go(5.0, 0.02, 0.0), rel=0.05)
