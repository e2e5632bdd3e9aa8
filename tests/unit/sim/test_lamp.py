"""The simulated light and its four sensors."""

from __future__ import annotations

from math import cos, degrees, hypot, isnan, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.learning.light_direction import LightFilter, corrected_direction, direction
from txt1.model.light_sensors import SENSOR_X, SENSOR_Y, Readings
from txt1.sim.lamp import SENSOR_LIMITS, LightSensors, PointLight, Range, SensorFault, illuminances, noise_for_jitter

LIGHT = PointLight()
POSITIONS = ((0.2286, 0.127), (0.2286, -0.127), (-0.2286, 0.127), (-0.2286, -0.127))
"""FL, FR, RL and RR in the vehicle's frame, m: at the corners of a rectangle."""
COORDINATE = st.floats(-8.0, 8.0)
HEADING = st.floats(-pi, pi)


def sensors(
    noise: float = 0.0, seed: int = 1, light: PointLight = LIGHT, limits: Range = SENSOR_LIMITS
) -> LightSensors:
    return LightSensors(light, noise, np.random.default_rng(seed), limits)


# -- the light ---------------------------------------------------------------------------------------------------


@given(COORDINATE, COORDINATE, HEADING, st.sampled_from([2.0, 4.0]))
def test_each_sensor_reads_what_its_own_distance_gives(x: float, y: float, theta: float, exponent: float) -> None:
    light = PointLight(0.5, -1.0, intensity=90.0, exponent=exponent)
    for (ahead, left), lux in zip(POSITIONS, illuminances(x, y, theta, light), strict=True):
        sensor_x = x + ahead * cos(theta) - left * sin(theta)
        sensor_y = y + ahead * sin(theta) + left * cos(theta)
        distance = max(hypot(sensor_x - 0.5, sensor_y + 1.0), 0.03)
        assert lux == pytest.approx(90.0 / distance**exponent, rel=1e-9)


def test_the_nearer_sensors_see_more() -> None:
    fl, fr, rl, rr = illuminances(-1.25, 0.0, 0.0, LIGHT)  # the light straight ahead
    assert fl == fr > rl == rr
    fl, fr, rl, rr = illuminances(0.0, -1.25, 0.0, LIGHT)  # ... and to the left
    assert fl == rl > fr == rr
    # front sensors 1.0294 m away: 135 / 1.0294^2
    assert illuminances(-1.25, 0.0, 0.0, LIGHT)[0] == pytest.approx(135 / ((1.25 - 0.2286) ** 2 + 0.127**2))


def test_a_sensor_at_the_lamp_itself_is_dazzled_and_no_number_is_lost() -> None:
    readings = sensors(noise=0.3).read(-SENSOR_X, -SENSOR_Y, 0.0)
    assert readings.front_left == 1000.0
    assert all(1.0 <= lux <= 1000.0 for lux in readings)


@given(COORDINATE, COORDINATE, HEADING, st.integers(0, 1000))
def test_readings_stay_within_the_sensors_range(x: float, y: float, theta: float, seed: int) -> None:
    assert all(1.0 <= lux <= 1000.0 for lux in sensors(0.6, seed).read(x, y, theta))


def test_between_walls_at_8_m_no_sensor_is_silent_or_saturates_too_soon() -> None:
    assert min(illuminances(8.0, 8.0, pi / 4, LIGHT)) > 1.0
    assert max(illuminances(-0.63, 0.0, np.arctan2(SENSOR_Y, SENSOR_X), LIGHT)) < 1000.0
    assert sensors(light=PointLight(exponent=4.0)).read(5.0, 0.0, 0.0) == (1.0, 1.0, 1.0, 1.0), "dark for 1 / d^4"
    free = sensors(light=PointLight(exponent=4.0), limits=Range(0.0, 1e9)).read(5.0, 0.0, 0.0)
    assert free == illuminances(5.0, 0.0, 0.0, PointLight(exponent=4.0))


# -- noise -------------------------------------------------------------------------------------------------------


def test_the_derived_noise_makes_the_direction_jitter_by_45_degrees() -> None:
    assert noise_for_jitter() == pytest.approx(0.3024, abs=1e-4)
    seen = sensors(noise_for_jitter(), seed=7, limits=Range(1e-9, 1e9))
    errors = [abs(direction(seen.read(-1.25, 0.0, 0.0))) for _ in range(40_000)]
    # 95 % within +-45 degrees; the share of 40 000 samples has a standard deviation of 0.11 %
    assert np.mean(np.array(errors) <= pi / 4) == pytest.approx(0.95, abs=0.004)


@pytest.mark.parametrize("exponent", [2.0, 4.0])
def test_without_limits_it_is_exactly_that_share_whatever_the_exponent(exponent: float) -> None:
    facing = np.array(illuminances(-1.25, 0.0, 0.0, PointLight(exponent=exponent)))
    z = np.random.default_rng(1).standard_normal((400_000, 4))
    x, y = (facing * (1.0 + noise_for_jitter(exponent=exponent) * z) @ np.array(POSITIONS)).T
    assert np.mean(np.abs(np.arctan2(y, x)) <= pi / 4) == pytest.approx(0.95, abs=0.0015)


def test_with_the_sensors_limits_it_is_the_same_jitter() -> None:
    seen = sensors(noise_for_jitter(), seed=8)
    errors = [abs(direction(seen.read(-1.25, 0.0, 0.0))) for _ in range(40_000)]
    assert np.mean(np.array(errors) <= pi / 4) == pytest.approx(0.95, abs=0.004)


def test_the_filter_makes_7_degrees_of_45() -> None:
    seen, sense = sensors(noise_for_jitter(), seed=9), LightFilter()
    directions = []
    for _ in range(20_000):
        sense.step(seen.read(-1.25, 0.0, 0.0))
        assert sense.readings is not None
        directions.append(direction(sense.readings))
    assert 6.0 < degrees(np.quantile(np.abs(directions[200:]), 0.95)) < 8.0


def test_noise_is_a_share_of_the_reading_and_independent_by_sensor_and_sample() -> None:
    seen = sensors(0.1, seed=2)
    truth = np.array(illuminances(-1.0, 0.4, 0.3, LIGHT))
    z = np.array([seen.read(-1.0, 0.4, 0.3) for _ in range(20_000)]) / truth - 1.0
    assert np.std(z, axis=0) == pytest.approx(0.1, rel=0.03)
    assert np.abs(np.mean(z, axis=0)).max() < 0.003
    assert np.abs(np.corrcoef(z.T) - np.eye(4)).max() < 0.03
    assert abs(np.corrcoef(z[:-1, 0], z[1:, 0])[0, 1]) < 0.03


def test_more_jitter_takes_more_noise_and_what_cannot_be_is_refused() -> None:
    assert noise_for_jitter(radians(20)) < noise_for_jitter(radians(45)) < noise_for_jitter(radians(60))
    assert noise_for_jitter(share=0.99) < noise_for_jitter(share=0.95)
    with pytest.raises(ValueError, match="jitter"):
        noise_for_jitter(pi / 2)
    with pytest.raises(ValueError, match="no noise"):
        noise_for_jitter(share=0.1)


def test_the_same_seed_repeats_every_reading_and_another_differs() -> None:
    def record(seed: int) -> list[Readings]:
        seen = sensors(0.3, seed)
        return [seen.read(-1.25 + 0.001 * k, 0.3, 0.01 * k) for k in range(300)]

    assert record(4) == record(4)
    assert all(a != b for a, b in zip(record(4), record(5), strict=True))
    assert sensors(0.0, 4).read(1.0, 2.0, 3.0) == sensors(0.0, 5).read(1.0, 2.0, 3.0)


# -- directions from the readings ----------------------------------------------------------------------------------


def test_a_light_at_53_degrees_reads_23_at_1_25_m() -> None:
    bearing = radians(53)
    seen = illuminances(-1.25 * cos(bearing), -1.25 * sin(bearing), 0.0, LIGHT)
    assert degrees(direction(seen)) == pytest.approx(23, abs=0.6)


@pytest.mark.parametrize("exponent", [2.0, 4.0])
@given(bearing=HEADING, theta=HEADING)
def test_far_away_the_direction_has_0_31_of_the_bearing_s_tangent(
    exponent: float, bearing: float, theta: float
) -> None:
    x, y = -50.0 * cos(theta + bearing), -50.0 * sin(theta + bearing)
    seen = illuminances(x, y, theta, PointLight(exponent=exponent, intensity=1e6))
    squeezed = direction(seen)
    assert sin(squeezed) * cos(bearing) == pytest.approx(0.3086 * sin(bearing) * cos(squeezed), abs=1e-3)
    assert cos(corrected_direction(seen) - bearing) > 1 - 1e-6
    assert cos(squeezed) * cos(bearing) >= -1e-9, "front stays front"
    assert sin(squeezed) * sin(bearing) >= -1e-9, "left stays left"


@pytest.mark.parametrize(("distance", "error"), [(0.5, 23.0), (1.25, 4.4), (2.5, 1.13)])
def test_the_corrected_direction_is_off_by_a_few_degrees_nearby(distance: float, error: float) -> None:
    worst = max(
        abs(
            (corrected_direction(illuminances(-distance * cos(b), -distance * sin(b), 0.0, LIGHT)) - b + pi) % (2 * pi)
            - pi
        )
        for b in np.linspace(-pi, pi, 721)
    )
    assert degrees(worst) == pytest.approx(error, rel=0.02)


# -- faults ------------------------------------------------------------------------------------------------------


def test_a_broken_sensor_reads_what_its_fault_says_and_the_others_go_on() -> None:
    seen = sensors()
    before = seen.read(-1.25, 0.0, 0.0)
    seen.faults = (SensorFault.DEAD, SensorFault.NAN, SensorFault.FROZEN, SensorFault.NONE)
    for _ in range(3):
        after = seen.read(-1.0, 0.2, 0.1)
        assert after.front_left == 0.0
        assert isnan(after.front_right)
        assert after.rear_left == before.rear_left
        assert after.rear_right == sensors().read(-1.0, 0.2, 0.1).rear_right
    seen.faults = (SensorFault.NONE,) * 4
    assert seen.read(-1.25, 0.0, 0.0) == before


def test_faults_come_in_fours_and_by_name() -> None:
    seen = sensors()
    seen.faults = ("none", "dead", "none", "none")  # type: ignore[assignment]
    assert seen.faults[1] is SensorFault.DEAD
    with pytest.raises(ValueError, match="FL, FR, RL, RR"):
        seen.faults = (SensorFault.DEAD,)
    with pytest.raises(ValueError, match="'broken'"):
        seen.faults = ("broken", "none", "none", "none")  # type: ignore[assignment]


def test_a_sensor_breaking_leaves_the_noise_of_the_others_as_it_was() -> None:
    sound, broken = sensors(0.3, 6), sensors(0.3, 6)
    broken.faults = (SensorFault.NONE, SensorFault.DEAD, SensorFault.NONE, SensorFault.NONE)
    for _ in range(100):
        one, other = sound.read(-1.25, 0.0, 0.0), broken.read(-1.25, 0.0, 0.0)
        assert (one[0], one[2], one[3]) == (other[0], other[2], other[3])
