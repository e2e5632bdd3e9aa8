"""The motor's output as a witness of the speed, which nobody has to calibrate."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.estimation.fusion import Fusion
from txt1.estimation.judging import Belonging, MotorWitness
from txt1.estimation.sensors import Kind, Measurement

PERIOD = 0.02  # s


def after(witness: MotorWitness, seconds: float, setpoint: float, motor: float) -> float:
    """The doubt after so long, m/s."""
    found = 0.0
    for _ in range(round(seconds / PERIOD)):
        found = witness.doubt(setpoint, motor, PERIOD)
    return found


@given(st.floats(0.1, 1.5), st.floats(500.0, 20_000.0), st.sampled_from([1.0, -1.0]))
def test_a_motor_that_needs_less_for_the_same_speed_puts_the_speed_in_doubt(v: float, motor: float, way: float) -> None:
    witness = MotorWitness()
    assert after(witness, 10.0, way * v, way * motor) == 0.0
    assert after(witness, 2.0, way * v, way * 0.6 * motor) == pytest.approx(-0.4 * way * v, rel=0.15)
    assert after(witness, 60.0, way * v, way * 0.6 * motor) == 0.0, "that is what it usually needs by now"


def test_what_curves_and_floors_make_of_it_is_no_doubt() -> None:
    witness = MotorWitness()
    after(witness, 10.0, 0.5, 5000.0)
    assert after(witness, 3.0, 0.5, 5600.0) == 0.0


def test_another_setpoint_needs_another_output() -> None:
    witness = MotorWitness()
    after(witness, 10.0, 0.5, 5000.0)
    assert after(witness, 5.0, 1.0, 9000.0) == 0.0
    assert after(witness, 5.0, 0.0, 0.0) == 0.0, "at rest"
    assert after(witness, 5.0, -0.5, -5000.0) == 0.0, "backwards"


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
