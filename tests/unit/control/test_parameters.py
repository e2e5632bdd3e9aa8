"""The safety gate's limits, and what its guards and the loops take for granted, as the manual tells them."""

from txt1.control.parameters import KnownCar, Limits


def test_the_limits_are_those_that_the_manual_tells() -> None:
    assert Limits() == Limits(
        v_max=1.5,
        omega_max=6.0,
        v_dead_band=0.0,
        motor_max=8000,
        command_timeout=0.25,
        runaway_motor=2000,
        runaway_time=0.3,
        runaway_counts=150,
        runaway_speed=2.0,
        missed_ticks_max=5,
        battery_good=9.5,
        battery_bad=9.0,
        auto_arm="auto",
        radius_min=0.56,
    )


def test_the_car_is_not_known_unless_somebody_says_so() -> None:
    assert KnownCar() == KnownCar(
        known=False, speed_gain=0.00033, dead_band=300.0, time_constant=0.3, scrub=0.06, acceleration=3.0
    )
