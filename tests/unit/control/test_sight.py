"""A car that is commanded to drive is not lost sight of: what its wheels' readings allow is bounded by a distance."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.sight import FALL, GAIN, SLOWED_SHARE, SLOWEST, UNSEEN_WAY, WheelSight, outer_wheel, time_unseen

PERIOD = 0.05


def read(sight: WheelSight, wheel: float, asked: float, dt: float = PERIOD, brakes: bool = False) -> bool:
    """Take a reading of the outer wheel, m/s; return whether the car is lost."""
    if wheel == 0.0:
        return sight.lost(asked, dt, brakes)
    sight.turns(wheel, dt)
    return False


def after(speeds: Iterable[float], asked: float, dt: float = PERIOD, count: float = 0.0) -> list[str]:
    """How the car is seen after each reading, m/s."""
    sight, seen = WheelSight(count), []
    for wheel in speeds:
        lost = read(sight, wheel, asked, dt)
        seen.append("lost" if lost else "doubted" if sight.doubted else "seen")
    return seen


@pytest.mark.parametrize("v", [FALL + 0.01, 1.0, -1.0])
def test_a_fall_that_no_brakes_make_is_doubted_at_once_and_lost_at_the_next_reading(v: float) -> None:
    assert after([v, v, 0.0, 0.0], v) == ["seen", "seen", "doubted", "lost"]


def test_a_locked_wheel_turns_again_without_the_motor_and_the_car_drives_on() -> None:
    assert after([1.0, 1.0, 0.0, 0.8, 1.0], 1.0) == ["seen", "seen", "doubted", "seen", "seen"]


@pytest.mark.parametrize("v", [1.0, -1.0])
def test_a_reading_in_the_middle_of_which_the_encoders_died_hides_nothing(v: float) -> None:
    assert after([v, v, 0.3 * v, 0.0, 0.0], v)[2:] == ["seen", "doubted", "lost"]


@given(v=st.floats(0.1, FALL), sign=st.sampled_from((-1.0, 1.0)))
def test_a_slow_car_is_lost_when_it_may_have_gone_ten_centimetres_unseen(v: float, sign: float) -> None:
    v *= sign
    seen = after([v, v, *[0.0] * 20], v)
    assert "doubted" not in seen
    unseen = PERIOD * (seen.index("lost") - 1)
    ways = [abs(v) * (t + t * (t + PERIOD) / (2.0 * GAIN)) for t in (unseen - PERIOD, unseen)]
    assert ways[0] < UNSEEN_WAY + 1e-9 and ways[1] > UNSEEN_WAY - 1e-9, "not earlier, and not a reading later"


def test_a_car_that_had_slowed_down_already_may_have_come_to_rest() -> None:
    falling = [0.5, 0.4, 0.3, 0.2, 0.1, *[0.0] * 20]
    assert set(after(falling, 0.5)) == {"seen"}
    assert "lost" in after([0.5, 0.4, SLOWED_SHARE * 0.5 + 0.01, *[0.0] * 20], 0.5)


def test_a_car_at_rest_and_one_that_turns_round_are_not_judged() -> None:
    assert set(after([0.0] * 40, 1.0)) == {"seen"}
    assert set(after([1.0, 1.0, 0.0, 0.0, 0.0], -1.0)) == {"seen"}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_car_that_rolled_the_other_way_last_comes_to_rest_before_it_follows(sign: float) -> None:
    """On ice a car swings about a small set-point, and an original board's loops take long to push it on."""
    assert set(after([sign * -0.1, sign * 0.04, *[0.0] * 20], sign * -0.1)) == {"seen"}
    assert "lost" in after([sign * 0.04, sign * -0.1, *[0.0] * 20], sign * -0.1)


def test_a_car_that_is_not_commanded_is_not_judged_and_begins_anew() -> None:
    sight = WheelSight(0.0)
    for wheel, asked in ((1.0, 1.0), (1.0, 1.0), (0.0, SLOWEST / 2), *[(0.0, 1.0)] * 9):
        assert not read(sight, wheel, asked) and not sight.doubted


def test_what_happened_while_a_line_stalled_is_not_counted() -> None:
    sight = WheelSight(0.0)
    sight.turns(0.4, PERIOD)
    assert not sight.lost(0.4, 1.0)


def test_few_counts_in_a_turn_make_no_loss() -> None:
    """20 counts in a turn of 0.3 m: at 0.3 m/s a count comes every 50 ms, and most readings of 20 ms are 0."""
    coarse = [0.75, *[0.0] * 2] * 50
    assert set(after(coarse, 0.3, 0.02, 0.015)) == {"seen"}
    assert "lost" in after([*coarse, *[0.0] * 20], 0.3, 0.02, 0.015)


def test_the_time_of_a_car_that_stood_is_by_its_way() -> None:
    assert time_unseen(0.3, 1.0) ** 2 / (2.0 * GAIN) == pytest.approx(0.3)
    assert time_unseen(0.3, -0.25) == pytest.approx(2.0 * time_unseen(0.3, 1.0))


def test_a_spinning_wheel_s_speed_is_not_the_car_s() -> None:
    assert set(after([0.0, 2.2, 0.0, 0.3], 0.9)) == {"seen"}, "on ice, and the wheel grips"
    assert after([0.5, 0.9, 0.9, 0.0, 0.0], 0.9)[3:] == ["doubted", "lost"]


def test_a_motor_that_brakes_may_have_brought_the_wheels_to_rest() -> None:
    sight = WheelSight(0.0)
    for wheel in (1.0, 1.0, 0.0, 0.0):
        assert not read(sight, wheel, 1.0, 0.02, brakes=wheel == 0.0)


@pytest.mark.parametrize(("v", "readings"), [(0.1, 7), (0.3, 4), (-0.3, 4)])
def test_a_slow_car_is_lost_after_so_many_readings(v: float, readings: int) -> None:
    assert after([v, v, *[0.0] * 20], v).index("lost") == 1 + readings


def test_tyres_give_a_car_half_a_metre_a_second_between_two_readings() -> None:
    assert "doubted" not in after([0.0, 2.2, 0.0, 0.3], 0.7), "it may roll at 0.5 m/s, and brakes can stop that"


def test_of_coarse_encoders_a_larger_fall_is_doubted() -> None:
    """1.5 cm in a count, of which five may be missing in 50 ms: 1.5 m/s."""
    rises = [0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4]
    assert after([*rises, 1.4, 0.0], 1.4, 0.02, 0.015)[-1] == "seen"
    assert after([*rises, 1.6, 1.6, 0.0], 1.6, 0.02, 0.015)[-1] == "doubted"


def test_it_is_unseen_from_the_first_reading_of_0_until_a_wheel_turns() -> None:
    sight = WheelSight(0.0)
    assert not sight.unseen
    sight.turns(0.3, PERIOD)
    assert not sight.lost(0.3, PERIOD) and sight.unseen
    sight.turns(0.3, PERIOD)
    assert not sight.unseen


@pytest.mark.parametrize(("v", "turning"), [(0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3), (0.0, 0.7)])
def test_in_a_turn_the_outer_wheel_counts(v: float, turning: float) -> None:
    sight, asked = WheelSight(0.0), 0.7 if v >= 0.0 else -0.7
    for _ in range(3):
        sight.turns(outer_wheel(v, turning), PERIOD)
    assert not sight.lost(asked, PERIOD) and sight.doubted, "0.7 m/s, and not 0.4 or 0.1"
