"""The way from where all sensors have been heard to now."""

from math import cos, sin

import numpy as np
import pytest

from tests.unit.estimation.test_fusion import Drive
from txt1.estimation import fusion
from txt1.estimation.filter import Belief, Drift, Lean, ahead, belief_of, predict, upright
from txt1.estimation.sensors import Kind, Measurement


@pytest.mark.parametrize("late", [0.05, 0.3])
@pytest.mark.parametrize("turning", [True, False])
def test_wheels_and_gyro_tell_the_way_of_a_car_that_speeds_up_into_a_curve(late: float, turning: bool) -> None:
    bias, slip = 0.02, 0.05
    start = belief_of((1.0, 2.0, 0.5, 0.5, 0.1, bias, slip, 0.0), np.diag([1e-6] * 3 + [1e-5, 1e-5, 1e-8, 1e-6, 1e-6]))
    rates = [(0.5 + 3.0 * time, 0.1 + 2.0 * time) for time in np.arange(0.005, late, 0.01)]
    readings, x, y, theta = list[Measurement](), 1.0, 2.0, 0.5
    for place, (rolled, omega) in enumerate(rates):
        time = 0.01 * place + 0.005
        theta += omega * 0.005
        x, y = x + rolled * (1.0 - slip) * 0.01 * cos(theta), y + rolled * (1.0 - slip) * 0.01 * sin(theta)
        theta += omega * 0.005
        wheels = rolled, omega / (1.0 - slip)
        readings.append(Measurement(time, "encoders", Kind.ENCODERS, (0, 1), wheels, (0.004, 0.02)))
        if turning:
            readings.append(Measurement(time, "imu", Kind.GYRO, (0,), (omega + bias,), (0.004,)))
    told = ahead(start, 0.0, late, readings, Drift().density(), (0.0, 0.0), turning=turning)
    assert told.mean[:2] == pytest.approx((x, y), abs=0.002)
    assert told.mean[2] == pytest.approx(theta, abs=0.004)
    assert told.mean[3:5] == pytest.approx(rates[-1], abs=0.05)
    assert np.linalg.eigvalsh(told.covariance).min() > 0.0


def test_on_the_way_to_now_a_belief_leans_with_the_gyros_scale_as_in_the_filter() -> None:
    lean = Lean((0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0)
    start = belief_of((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0), np.diag([1e-6] * 8), lean)
    told = ahead(start, 0.0, 0.2, [], Drift().density(), (0.0, 0.0), turning=True)
    # 1 m/s for 0.2 s with a heading that is 0.3 rad off for a unit of the scale
    assert told.lean is not None and told.lean.by[:3] == pytest.approx((0.0, 0.06, 0.3), abs=0.003)
    assert upright(told, 0.0, 0.02**2).covariance[2, 2] - told.covariance[2, 2] == pytest.approx((0.3 * 0.02) ** 2)


@pytest.mark.skipif(not fusion.__file__.endswith(".py"), reason="compiled functions cannot be counted")
def test_motion_capture_that_is_always_late_has_nothing_computed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, late, calls = Drive(), list[Measurement](), list[float]()

    def behind(each: Measurement) -> Measurement | None:
        if each.sensor != "vicon":
            return each
        late.append(each)
        return late.pop(0) if len(late) > 3 else None

    def counted(belief: Belief, dt: float, *more: object) -> Belief:
        calls.append(dt)
        return predict(belief, dt, *more)  # type: ignore[arg-type]

    drive.go(3.0, behind)
    monkeypatch.setattr(fusion, "predict", counted)
    drive.go(2.0, behind)
    # a prediction from each instant to the next, and with the late readings nothing is predicted twice
    assert len(calls) <= 101
    assert sum(calls) == pytest.approx(2.0, abs=0.021)
    assert drive.error()[0] < 0.004
