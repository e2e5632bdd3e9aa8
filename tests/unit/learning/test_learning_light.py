"""What a learner makes of four readings: direction, sectors, reward, filter, and what it refuses to believe."""

from __future__ import annotations

from math import cos, inf, nan, nextafter, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.errors import LightFault, NoDirection
from txt1.learning.light_direction import (
    FROZEN_SAMPLES,
    SECTORS,
    SETTLING_SAMPLES,
    LightFilter,
    corrected_direction,
    direction,
    reward,
    sector,
    spread_limit,
)
from txt1.model.light_sensors import SENSORS, Readings
from txt1.sim.lamp import LightSensors, PointLight, SensorFault, illuminances, noise_for_jitter

LUX = st.floats(1.0, 1000.0)


# -- direction ---------------------------------------------------------------------------------------------------


def test_the_direction_is_that_of_the_sum_of_the_sensors_vectors() -> None:
    # by hand: x = 0.2286 (40 + 30 - 20 - 10), y = 0.127 (40 + 20 - 30 - 10)
    assert direction(Readings(40.0, 30.0, 20.0, 10.0)) == pytest.approx(np.arctan2(0.127 * 20, 0.2286 * 40))
    assert corrected_direction(Readings(40.0, 30.0, 20.0, 10.0)) == pytest.approx(np.arctan2(20 / 0.127, 40 / 0.2286))


@pytest.mark.parametrize(
    ("readings", "angle"),
    [
        ((2.0, 2.0, 1.0, 1.0), 0.0),
        ((2.0, 1.0, 2.0, 1.0), pi / 2),
        ((1.0, 1.0, 2.0, 2.0), pi),
        ((1.0, 2.0, 1.0, 2.0), -pi / 2),
    ],
)
def test_front_left_rear_and_right(readings: tuple[float, float, float, float], angle: float) -> None:
    assert direction(Readings(*readings)) == pytest.approx(angle)
    assert corrected_direction(Readings(*readings)) == pytest.approx(angle)


@given(LUX, LUX, LUX, LUX)
def test_swapping_left_and_right_mirrors_the_direction(fl: float, fr: float, rl: float, rr: float) -> None:
    for estimate in (direction, corrected_direction):
        try:
            one, other = estimate(Readings(fl, fr, rl, rr)), estimate(Readings(fr, fl, rr, rl))
        except NoDirection:
            assert fl == rr
            assert fr == rl
            return
        assert (cos(one), sin(one)) == pytest.approx((cos(other), -sin(other)), abs=1e-9)


@pytest.mark.parametrize("estimate", [direction, corrected_direction])
@pytest.mark.parametrize("bad", [nan, inf, -inf, -1.0, 0.0])
@pytest.mark.parametrize("which", range(4))
def test_no_direction_is_made_of_a_reading_that_is_none(estimate, bad: float, which: int) -> None:  # type: ignore[no-untyped-def]
    readings = [40.0, 30.0, 20.0, 10.0]
    readings[which] = bad
    with pytest.raises(LightFault, match=f"light sensor {SENSORS[which]} "):
        estimate(Readings(*readings))


def test_a_dead_sensor_is_called_dead_with_the_other_readings_beside_it() -> None:
    with pytest.raises(LightFault, match=r"FR is dead or covered: .*\(FL 128, FR 0, RL 60, RR 61 lux\)"):
        direction(Readings(128.0, 0.0, 60.0, 61.0))


@pytest.mark.parametrize("lux", [0.0, 0.1, 1.0, 37.3, 1000.0])
def test_four_readings_alike_tell_no_direction(lux: float) -> None:
    with pytest.raises(NoDirection, match=f"all read {lux:g} lux"):
        direction(Readings(lux, lux, lux, lux))


# -- sectors -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("degrees", "name"),
    [
        (0, "front centre"),
        (22.4, "front centre"),
        (-22.4, "front centre"),
        (22.6, "front left"),
        (45, "front left"),
        (90, "centre left"),
        (135, "rear left"),
        (157.4, "rear left"),
        (157.6, "rear centre"),
        (180, "rear centre"),
        (-180, "rear centre"),
        (-157.6, "rear centre"),
        (-157.4, "rear right"),
        (-135, "rear right"),
        (-90, "centre right"),
        (-45, "front right"),
        (-22.6, "front right"),
        (405, "front left"),
    ],
)
def test_sectors_by_name(degrees: float, name: str) -> None:
    assert SECTORS[sector(radians(degrees))] == name


def test_the_sectors_are_numbered_as_in_the_specification() -> None:
    assert SECTORS == (
        "rear centre",
        "rear right",
        "centre right",
        "front right",
        "front centre",
        "front left",
        "centre left",
        "rear left",
    )
    assert [sector(k * pi / 4) for k in range(-4, 4)] == list(range(8))


def test_a_boundary_belongs_to_the_sector_counter_clockwise_of_it() -> None:
    for k in range(-4, 4):
        boundary = (k + 0.5) * pi / 4
        assert sector(boundary + 1e-9) == sector(boundary)
        assert sector(boundary - 1e-9) == (sector(boundary) - 1) % 8


@given(st.floats(-pi, pi))
def test_every_direction_is_in_the_sector_whose_centre_is_nearest(angle: float) -> None:
    index = sector(angle)
    assert 0 <= index < 8
    assert cos(angle - (index - 4) * pi / 4) >= cos(pi / 8) - 1e-9


# -- reward ------------------------------------------------------------------------------------------------------

REWARDS = (
    # to: 0   1   2   3   4   5   6   7       from
    (-1, +1, +1, +1, +1, +1, +1, +1),  # 0 rear centre: to stay is bad, anywhere else is nearer to the front
    (-1, +0, +1, +1, +1, +1, +1, -1),  # 1 rear right: its mirror image, 7, is as far
    (-1, -1, +0, +1, +1, +1, -1, -1),  # 2 centre right
    (-1, -1, -1, +0, +1, -1, -1, -1),  # 3 front right: only the front centre is nearer
    (-1, -1, -1, -1, +1, -1, -1, -1),  # 4 front centre: to stay is good, all else is worse
    (-1, -1, -1, -1, +1, +0, -1, -1),  # 5 front left
    (-1, -1, -1, +1, +1, +1, +0, -1),  # 6 centre left
    (-1, -1, +1, +1, +1, +1, +1, +0),  # 7 rear left
)


@pytest.mark.parametrize("before", range(8))
@pytest.mark.parametrize("after", range(8))
def test_the_reward_of_all_64_pairs_is_that_worked_out_by_hand(before: int, after: int) -> None:
    expected = REWARDS[before][after]
    if (before, after) in {(3, 5), (5, 3), (2, 6), (6, 2), (1, 7), (7, 1)}:
        expected = -1  # from one side to the same distance on the other: neither nearer nor the same
    assert reward(before, after) == expected


# -- filter ------------------------------------------------------------------------------------------------------


def filtered(sense: LightFilter, sample: Readings) -> Readings:
    """What the filter makes of one more sample."""
    sense.step(sample)
    assert sense.readings is not None
    return sense.readings


def test_the_filter_is_nine_tenths_of_the_past() -> None:
    sense = LightFilter()
    assert sense.readings is None
    assert filtered(sense, Readings(10.0, 20.0, 30.0, 40.0)) == (10.0, 20.0, 30.0, 40.0), "the first sample as it is"
    assert filtered(sense, Readings(20.0, 20.0, 20.0, 140.0)) == pytest.approx((11.0, 20.0, 29.0, 50.0))
    assert filtered(sense, Readings(11.0, 20.0, 29.0, 50.0)) == pytest.approx((11.0, 20.0, 29.0, 50.0))
    sense.clear()
    assert filtered(sense, Readings(1.0, 2.0, 3.0, 4.0)) == (1.0, 2.0, 3.0, 4.0)


def test_a_step_of_light_has_arrived_by_nine_tenths_when_the_filter_has_settled() -> None:
    sense = LightFilter()
    sense.step(Readings(10.0, 10.0, 10.0, 10.0))
    for _ in range(SETTLING_SAMPLES - 1):
        assert not sense.settled
        sense.step(Readings(20.0, 20.0, 20.0, 20.0))
    assert sense.settled
    assert sense.readings is not None
    assert sense.readings[0] == pytest.approx(19.0, abs=0.15)


@pytest.mark.parametrize("bad", [nan, inf, -inf, -0.5])
@pytest.mark.parametrize("which", range(4))
def test_a_bad_sample_is_refused_and_leaves_the_filter_as_it_was(bad: float, which: int) -> None:
    sense = LightFilter()
    sense.step(Readings(40.0, 30.0, 20.0, 10.0))
    sample = [40.0, 30.0, 20.0, 10.0]
    sample[which] = bad
    with pytest.raises(LightFault, match=f"light sensor {SENSORS[which]} reads"):
        sense.step(Readings(*sample))
    assert sense.readings == (40.0, 30.0, 20.0, 10.0)
    assert filtered(sense, Readings(40.0, 30.0, 20.0, 10.0)) == pytest.approx((40.0, 30.0, 20.0, 10.0))


# -- sensors that cannot be believed -------------------------------------------------------------------------------


def watched(fault: SensorFault, which: int, seconds: float = 4.0, seed: int = 1, noise: float | None = None) -> float:
    """Seconds from the break of a sensor until the filter refuses it, driving a lap around near the start."""
    seen = LightSensors(PointLight(), noise_for_jitter() if noise is None else noise, np.random.default_rng(seed))
    sense, broken_at = LightFilter(), 1.0
    for k in range(round((broken_at + seconds) / 0.016)):
        turn = 0.3 / 0.56 * k * 0.016
        if k * 0.016 >= broken_at:
            seen.faults = tuple(fault if n == which else SensorFault.NONE for n in range(4))
        try:
            sense.step(seen.read(-1.25 + 0.56 * sin(turn), 0.56 * (1 - cos(turn)), turn))
        except LightFault as refused:
            assert str(refused).startswith(f"light sensor {SENSORS[which]} ")
            return k * 0.016 - broken_at
    return inf


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("seed", range(5))
def test_a_sensor_that_dies_while_driving_is_refused_within_six_tenths_of_a_second(which: int, seed: int) -> None:
    assert 0.0 < watched(SensorFault.DEAD, which, seed=seed) < 0.6


@pytest.mark.parametrize("which", range(4))
def test_a_sensor_without_a_number_is_refused_at_once(which: int) -> None:
    assert watched(SensorFault.NAN, which) < 0.016


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("noise", [None, 0.0])
def test_a_frozen_sensor_is_refused_within_two_seconds(which: int, noise: float | None) -> None:
    assert watched(SensorFault.FROZEN, which, noise=noise) <= 2 * FROZEN_SAMPLES * 0.016


def test_a_sensor_dead_from_the_start_is_refused_when_the_filter_has_settled() -> None:
    seen = LightSensors(PointLight(), noise_for_jitter(), np.random.default_rng(3))
    seen.faults = (SensorFault.NONE, SensorFault.NONE, SensorFault.DEAD, SensorFault.NONE)
    sense = LightFilter()
    for _ in range(SETTLING_SAMPLES):
        readings = filtered(sense, seen.read(-1.25, 0.0, 0.0))
        with pytest.raises(LightFault, match="RL is dead"):
            direction(readings)
    with pytest.raises(LightFault, match="RL is dead"):
        sense.step(seen.read(-1.25, 0.0, 0.0))


def test_a_sensor_stuck_at_its_upper_limit_is_refused_in_moderate_light() -> None:
    sense, sample = LightFilter(), Readings(60.0, 61.0, 1000.0, 40.0)
    with pytest.raises(LightFault, match=r"RL is stuck or dazzled"):
        for _ in range(SETTLING_SAMPLES + 1):
            sense.step(sample)


@pytest.mark.parametrize("exponent", [2.0, 4.0])
def test_no_light_outside_the_goal_circle_exceeds_the_spread_limit(exponent: float) -> None:
    limit = spread_limit(exponent, noise=0.0)
    light, most = PointLight(exponent=exponent), 0.0
    for distance in (0.5, 0.6, 1.0, 3.0):
        for bearing in np.linspace(-pi, pi, 721):
            seen = illuminances(-distance * cos(bearing), -distance * sin(bearing), 0.0, light)
            most = max(most, max(seen) / min(seen))
    assert 0.99 * limit < most <= limit
    assert spread_limit(exponent) > 1.4 * limit, "and there is room for noise"


@pytest.mark.parametrize("place", [(-1.25, 0.0, 0.0), (-0.5, 0.0, 0.5), (0.1, -0.2, 2.0), (7.9, 7.9, 1.0)])
def test_healthy_sensors_are_believed_everywhere(place: tuple[float, float, float]) -> None:
    # five minutes of noise in every place, also where some saturate; standing still without noise, too
    noisy, sense = LightSensors(PointLight(), noise_for_jitter(), np.random.default_rng(11)), LightFilter()
    for _ in range(20_000):
        sense.step(noisy.read(*place))
    quiet, sense = LightSensors(PointLight(), 0.0, np.random.default_rng(11)), LightFilter()
    for _ in range(500):
        sense.step(quiet.read(*place))


def test_a_sensor_resting_at_a_limit_is_not_taken_for_frozen() -> None:
    sense = LightFilter()
    for k in range(1000):
        sense.step(Readings(1000.0, 500.0 + k % 7, 300.0 + k % 5, 200.0 + k % 3))


def test_sectors_do_not_flicker_for_the_last_bit_of_pi() -> None:
    assert sector(pi) == sector(-pi) == sector(nextafter(pi, 0.0)) == 0
