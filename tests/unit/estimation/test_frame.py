"""What a frame that may have moved has pulled the pose by."""

from math import hypot

import numpy as np
import pytest

from txt1.estimation.filter import SIZE, belief_of
from txt1.estimation.fusion import Fusion
from txt1.estimation.hypotheses import Frame, Reckoning
from txt1.estimation.judging import Belonging, WitnessValues
from txt1.estimation.sensors import Kind, Measurement

V, MOVING = 0.5, 0.1  # m/s, of the car and of the frame, along the car's way
CERTAIN = np.eye(SIZE) * 1e-6


def drive(frame: Frame, reckoning: Reckoning, cycles: range, at: tuple[float, float] = (0.0, 0.0)) -> float:
    """Drive straight on; after 2 s the frame moves. Return where the sensor has the car, m."""
    x = 0.0
    for cycle in cycles:
        time = 0.02 * cycle
        x = V * time + MOVING * max(0.0, min(time, 4.0) - 2.0)
        reckoning.go(time, 0.02, V, 0.0, 0.0, 0.0)
        told = Measurement(time, "vicon", Kind.POSE, (0, 1, 2), (x + at[0], 0.0, 0.0), (0.002, 0.002, 0.003), at)
        frame.take(told, belief_of([x, 0.0, 0.0, V, 0.0, 0.0, 0.0, 0.0], CERTAIN))
        frame.compare(reckoning)
    return x


@pytest.mark.parametrize("at", [(0.0, 0.0), (0.01, 0.0)])
def test_what_a_frame_pulled_the_pose_by_is_not_forgotten_at_once(at: tuple[float, float]) -> None:
    frame, reckoning = Frame(), Reckoning()
    drive(frame, reckoning, range(1, 200))
    pulled = hypot(*frame.pulled[:2])
    assert pulled > 0.1
    # it stands from now on; a mount that was corrected does not look like a frame that moves
    x = drive(frame, reckoning, range(200, 400), at)
    assert frame.pulled == (0.0, 0.0, 0.0)
    assert 0.5 * pulled < hypot(*frame.past) < 1.2 * pulled
    # and fades without wheels, too
    for cycle in range(400, 2400):
        told = Measurement(0.02 * cycle, "vicon", Kind.POSE, (0, 1, 2), (x, 0.0, 0.0), (0.002, 0.002, 0.003), at)
        frame.take(told, belief_of([x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], CERTAIN))
    assert hypot(*frame.past) < 0.05


def test_rtk_whose_frame_moves_across_a_straight_way_is_found_out_beside_a_heading() -> None:
    """By positions alone its mount may explain it: a heading that they have told is off by that."""
    rng = np.random.default_rng(1)
    sensors = {each: Belonging(tells_pose=each == "rtk") for each in ("imu", "encoders", "rtk", "compass")}
    fusion = Fusion(sensors, track_sigma=0.05, mounts={"rtk": (0.1, 0.05)})
    for cycle in range(1, 1000):
        time = 0.02 * cycle
        true = V, 0.0, 0.0, V * time, 0.15 * max(0.0, time - 10.0), 0.0
        told = true + rng.normal(size=6) * (0.005, 0.03, 0.006, 0.02, 0.02, 0.02)
        v, turning, gyro, x, y, theta = told.tolist()
        fusion.take(Measurement(time, "encoders", Kind.ENCODERS, (0, 1), (v, turning), (0.006, 0.04)))
        fusion.take(Measurement(time, "imu", Kind.GYRO, (0,), (gyro,), (0.006,)))
        if cycle % 5 == 0:
            fusion.take(Measurement(time, "rtk", Kind.POSE, (0, 1), (x, y), (0.03, 0.03)))
            fusion.take(Measurement(time, "compass", Kind.POSE, (2,), (theta,), (0.02,)))
        estimate = fusion.step(time)
        fusion.cycle(WitnessValues(time, v, turning, gyro, None), 0.02)
    assert not fusion.believes("rtk")
    assert abs(estimate.y) < 0.2
