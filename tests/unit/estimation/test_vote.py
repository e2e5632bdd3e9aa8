"""The vote on gyro and wheels."""

import pytest

from txt1.estimation.judging import Vote, WitnessValues
from txt1.estimation.sensors import Kind, Measurement


def tracked(time: float, x: float) -> Measurement:
    return Measurement(time, "vicon", Kind.POSE, (0, 1, 2), (x, 0.0, 0.0), (0.002, 0.002, 0.003))


def fixed(time: float, x: float, y: float, sigma: float) -> Measurement:
    return Measurement(time, "gps", Kind.POSE, (0, 1), (x, y), (sigma, sigma))


@pytest.mark.parametrize(("by_wheels", "sliding"), [(0.5, False), (1.2, True)])
def test_a_gps_beside_motion_capture_says_nothing_of_the_wheels(by_wheels: float, sliding: bool) -> None:
    vote = Vote()
    for cycle in range(50):
        time = 0.02 * cycle
        vote.cycle(WitnessValues(time, by_wheels, 0.0, 0.0, 0.0))
        vote.place(tracked(time, 0.5 * time))
        if cycle % 10 == 0:
            vote.place(fixed(time, 0.5 * time + 0.8 * (-1.0) ** (cycle // 10), 0.9, 1.0))
            # of the two, it is the newest
            assert vote.outvoted() == (False, sliding and time > 0.15)


def test_once_motion_capture_is_silent_the_gps_measures_the_way() -> None:
    vote = Vote()
    for cycle in range(100):
        time = 0.02 * cycle
        vote.cycle(WitnessValues(time, 1.2, 0.0, 0.0, 0.0))
        if time <= 1.0:
            vote.place(tracked(time, 1.2 * time))
        if cycle % 5 == 0:
            vote.place(fixed(time, 0.1 * time, 0.0, 0.01))
        if time == 1.0:
            assert vote.outvoted() == (False, False)
    assert vote.outvoted() == (False, True)
