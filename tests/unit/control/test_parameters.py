"""The safety gate's limits as the manual tells them."""

from txt1.control.parameters import Limits


def test_the_limits_are_those_that_the_manual_tells() -> None:
    assert Limits() == Limits(
        v_max=1.5, v_dead_band=0.0, motor_max=8000, command_timeout=0.25, runaway_motor=2000, runaway_time=0.3,
        runaway_counts=150, runaway_speed=2.0, missed_ticks_max=5, auto_arm="auto", radius_min=0.56,
    )  # fmt: skip
