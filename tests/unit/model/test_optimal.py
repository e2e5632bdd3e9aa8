"""The least time to the light: the figures of the specification, and proofs by brute force."""

from __future__ import annotations

from math import cos, inf, isclose, nan, pi, sin

import numpy as np
import pytest
from numpy.typing import NDArray

from txt1.model import optimal

R, V, GOAL = 0.56, 0.3, 0.5
Array = NDArray[np.float64]
# of arrays of poses
optimal_time = np.vectorize(optimal.optimal_time, otypes=[float])


def drive(x: Array, y: Array, theta: Array, distance: Array | float, curvature: float) -> tuple[Array, Array, Array]:
    """Poses after an arc of constant curvature."""
    turn = distance * curvature
    chord = distance * np.sinc(turn / (2 * pi))  # numpy's sinc is sin(pi x) / (pi x)
    return x + chord * np.cos(theta + turn / 2), y + chord * np.sin(theta + turn / 2), theta + turn


def first_hit(x: Array, y: Array, theta: Array, curvature: float) -> Array:
    """Distance along an endless arc or straight line to the goal circle, inf if it never comes; in closed form."""
    with np.errstate(invalid="ignore", divide="ignore"):
        if curvature == 0.0:
            along = -(x * np.cos(theta) + y * np.sin(theta))
            across = x * np.sin(theta) - y * np.cos(theta)
            hit = along - np.sqrt(GOAL**2 - across**2)
            hit = np.where(hit >= 0.0, hit, np.nan)
        else:
            cx, cy = x - np.sin(theta) / curvature, y + np.cos(theta) / curvature
            rho = np.hypot(cx, cy)
            half = np.arccos((rho**2 + R**2 - GOAL**2) / (2 * rho * R))
            start = np.arctan2(y - cy, x - cx)
            light = np.arctan2(-cy, -cx)
            side = np.sign(curvature)
            hit = R * np.fmin(side * (light - half - start) % (2 * pi), side * (light + half - start) % (2 * pi))
    return np.where(np.hypot(x, y) <= GOAL, 0.0, np.where(np.isnan(hit), np.inf, hit))


def poses(count: int, reach: float = 2.5, seed: int = 1) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-reach, reach, count), rng.uniform(-reach, reach, count), rng.uniform(-pi, pi, count)


# -- the figures of the specification ------------------------------------------------------------------------------


def test_from_1_25_m_and_any_heading_it_takes_5_09_s_on_average() -> None:
    heading = (np.arange(20_000) + 0.5) / 20_000 * 2 * pi
    times = optimal_time(-1.25, 0.0, heading)
    assert times.mean() == pytest.approx(5.09, abs=0.005)
    assert times.min() == pytest.approx(2.5, abs=1e-6)
    assert times.max() == pytest.approx(9.94, abs=0.005)


def test_facing_the_light_it_takes_2_5_s_and_with_it_behind_9_94() -> None:
    assert float(optimal_time(-1.25, 0.0, 0.0)) == pytest.approx(2.5, abs=1e-9)
    assert float(optimal_time(-1.25, 0.0, pi)) == pytest.approx(9.94, abs=0.005)
    assert float(optimal_time(-100.0, 0.0, 0.0)) == pytest.approx(99.5 / V)


@pytest.mark.parametrize("bearing", np.linspace(-pi, pi, 33))
def test_a_light_straight_ahead_costs_its_distance_from_wherever_it_is(bearing: float) -> None:
    time = optimal_time(-3.0 * cos(bearing), -3.0 * sin(bearing), bearing)
    assert float(time) == pytest.approx(2.5 / V, abs=1e-8)


def test_a_light_abeam_at_the_turning_circles_centre_is_reached_by_swinging_out() -> None:
    # by hand: rho = 2 R from the other turning circle; w, cos psi and the chord by the equations of the module
    rho, k = 2 * R, 7 * R**2
    w = (4 * k - GOAL**2 + GOAL * (GOAL**2 + 24 * R**2) ** 0.5) / 8
    chord = (2 * w - k) / GOAL + GOAL
    out = np.arccos(w / (2 * rho * R))
    length = R * (out + 2 * pi - 2 * np.arcsin(chord / (2 * R)))
    assert float(optimal_time(0.0, -R, 0.0)) == pytest.approx(length / V, abs=1e-12)
    assert length < 0.7 * (R * (2 * pi - np.arccos(0.5)) + 3**0.5 * R - GOAL), "far less than by the other side"


# -- proofs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("radius", "goal"),
    [(0.56, 0.5), *(pytest.param(*each, marks=pytest.mark.long) for each in ((0.56, 0.1), (0.56, 0.8), (1.5, 0.3)))],
)
def test_whatever_the_car_does_for_a_moment_the_least_time_falls_by_no_more(radius: float, goal: float) -> None:
    # Bellman's inequality T(pose) <= h + T(pose after h). Summed along any sequence of turns and straights that ends in
    # the goal it says that none takes less than T.
    x, y, theta = poses(8_000, reach=4 * max(radius, goal))
    outside = np.hypot(x, y) > goal
    x, y, theta = x[outside], y[outside], theta[outside]
    now = optimal_time(x, y, theta, V, radius, goal)
    for h in (0.01, 0.1, 0.5, 2.0):
        for curvature in (-1 / radius, -0.3 / radius, 0.0, 0.6 / radius, 1 / radius):
            later = optimal_time(*drive(x, y, theta, V * h, curvature), V, radius, goal)
            assert np.max(now - (h + later)) < 1e-9


@pytest.mark.long
def test_the_inequality_holds_near_the_centres_of_the_turning_circles_too() -> None:
    # where an arc alone stops being enough: the light at 0 to 0.12 m from the centre of the left circle
    rng = np.random.default_rng(2)
    theta, away, where = rng.uniform(-pi, pi, 50_000), rng.uniform(0.0, 0.12, 50_000), rng.uniform(-pi, pi, 50_000)
    x = away * np.cos(where) + R * np.sin(theta)
    y = away * np.sin(where) - R * np.cos(theta)
    now = optimal_time(x, y, theta)
    for h in (0.01, 0.1, 0.5):
        for curvature in (-1 / R, 0.0, 1 / R):
            later = optimal_time(*drive(x, y, theta, V * h, curvature))
            assert np.max(np.where(np.hypot(x, y) > GOAL, now - (h + later), -1.0)) < 1e-9


@pytest.mark.long
def test_the_best_of_all_three_piece_paths_takes_as_long_and_never_less() -> None:
    # left, straight or right for any length, the same again, and once more until the goal circle: 27 kinds of path,
    # both lengths in steps of 3 cm up to a whole circle
    x, y, theta = poses(40, reach=2.0, seed=3)
    # the light in the middle of the turning circle among them
    x[:4], y[:4], theta[:4] = (0.0, 0.02, 0.0, -0.03), (-R, -R - 0.02, R, R), 0.0
    grid = np.arange(0.0, 2 * pi * R, 0.03)
    best = np.full(x.shape, np.inf)
    for one in (-1 / R, 0.0, 1 / R):
        after = drive(x[:, None], y[:, None], theta[:, None], grid[None, :], one)
        for two in (-1 / R, 0.0, 1 / R):
            if two == one:
                continue
            then = drive(*(value[:, :, None] for value in after), grid[None, None, :], two)
            for three in (-1 / R, 0.0, 1 / R):
                length = grid[:, None] + grid[None, :] + first_hit(*then, three)
                best = np.minimum(best, length.min(axis=(1, 2)))
    best = np.where(np.hypot(x, y) <= GOAL, 0.0, best) / V
    times = optimal_time(x, y, theta)
    assert np.max(times - best) < 1e-9, "nothing is faster"
    assert np.max(best - times) < 0.1, "and the grid comes as near as its steps allow"
    assert np.mean(best - times) < 0.02


# -- shapes and limits ---------------------------------------------------------------------------------------------


def test_poses_broadcast_and_agree_with_one_at_a_time() -> None:
    x, y, theta = poses(20)
    many = optimal_time(x[:, None], y[:, None], theta[None, :])
    assert many.shape == (20, 20)
    assert np.shape(optimal_time(1.0, 2.0, 3.0)) == ()
    for k in (0, 7, 19):
        assert float(optimal_time(x[k], y[k], theta[3])) == many[k, 3]


def test_the_room_turned_or_mirrored_takes_as_long() -> None:
    x, y, theta = poses(5000)
    times = optimal_time(x, y, theta)
    # beyond rounding: at the rim of what an arc reaches, the time itself is steep
    turned = optimal_time(x * cos(1.0) - y * sin(1.0), x * sin(1.0) + y * cos(1.0), theta + 1.0)
    assert np.max(np.abs(turned - times)) < 1e-6
    assert np.max(np.abs(optimal_time(x, -y, -theta) - times)) < 1e-6


def test_inside_the_goal_it_has_arrived_and_twice_the_speed_takes_half_the_time() -> None:
    assert float(optimal_time(0.3, -0.4, 1.0)) == 0.0
    assert float(optimal_time(0.0, 0.0, 0.0)) == 0.0
    assert isclose(float(optimal_time(1.0, 2.0, 3.0, speed=0.6)), float(optimal_time(1.0, 2.0, 3.0)) / 2)


@pytest.mark.parametrize("pose", [(nan, 0.0, 0.0), (0.0, inf, 0.0), (1.0, 1.0, nan)])
def test_a_pose_that_is_not_finite_is_refused(pose: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="a pose is finite"):
        optimal_time(*pose)


@pytest.mark.parametrize("bad", [{"speed": 0.0}, {"speed": nan}, {"goal_radius": 0.0}, {"radius_min": inf}])
def test_speed_and_radii_must_be_positive_and_finite(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="positive"):
        optimal_time(1.0, 1.0, 0.0, **bad)
