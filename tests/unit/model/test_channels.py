"""Channels: counts on the wires and those that are meant, encoders either way round."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from txt1.config import load
from txt1.errors import ConfigError
from txt1.model.channels import STRAIGHT, Channel, Channels
from txt1.model.vehicle import PWM_MAX

ways = st.sampled_from((1, -1))
channels = st.builds(Channel, ways, st.floats(-2400.0, 2400.0), st.floats(0.5, 1.1))
wirings = st.builds(Channels, channels, channels, channels, channels, channels, ways, ways, st.booleans())
counts = st.floats(-5000.0, 5000.0)


@given(wirings, counts, counts, st.booleans())
def test_what_goes_onto_the_wires_is_what_was_meant(
    wiring: Channels, motor: float, steering: float, skids: bool
) -> None:
    wired = wiring.wired(motor, -steering, steering, skids)
    assert wiring.meant(*wired, skids) == approx((motor, -steering, steering), abs=5.0)


@given(wirings, st.integers(-(10**9), 10**9), st.integers(-(10**9), 10**9))
def test_encoders_are_read_as_they_turned(wiring: Channels, right: int, left: int) -> None:
    assert wiring.counted(*wiring.sent(right, left)) == (right, left)


@given(channels, st.floats(-1e9, 1e9))
def test_no_pulse_is_longer_or_shorter_than_a_servo_takes(channel: Channel, counts: float) -> None:
    assert abs(channel.wired(counts)) <= PWM_MAX


@given(st.integers(-24000, 24000), st.integers(-18000, 18000), st.integers(-18000, 18000))
def test_a_vehicle_that_is_wired_as_the_tasks_mean_it_gets_their_outputs(motor: int, front: int, rear: int) -> None:
    assert STRAIGHT.wired(motor, front, rear, False) == (motor, front, rear)


def test_a_reversed_steering_that_is_off_centre_and_goes_too_far() -> None:
    servo = Channel(-1, 1500.0, 0.8)
    assert (servo.wired(0.0), servo.wired(18000.0), servo.wired(-18000.0)) == (1500.0, -12900.0, 15900.0)


def test_one_side_of_a_rover_may_be_the_wrong_way_round() -> None:
    wiring = Channels(left=Channel(-1))
    assert wiring.wired(1000.0, 0.0, 0.0, True) == (0, -3000, 3000)  # what a straight rover would turn in place by


def test_a_neutral_that_would_drive_off_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"channels: motor\.trim: 5000; a motor is in neutral within 2400"):
        load(None, ["channels.motor.trim=5000"])
    assert load(None, ["channels.front.trim=5000"]).config.channels.front.trim == 5000.0
