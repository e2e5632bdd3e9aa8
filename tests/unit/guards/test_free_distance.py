"""How far a body may go along an arc, against a body that is moved along it step by step."""

from math import cos, inf, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from txt1.guards.obstacle_stop.free_distance import free_distance, stopping_speed

LENGTH, WIDTH = 0.51, 0.385
Floats = NDArray[np.float64]


def touched(points: Floats, curvature: float, margin: float) -> tuple[Floats, float]:
    """The distances at which a body that is moved by small steps first covers each point, inf if never; the step."""
    most = min(3.0, 2.0 * pi / abs(curvature)) if curvature else 3.0
    step = min(0.005, 0.005 / abs(curvature)) if curvature else 0.005
    first = np.full(len(points), inf)
    for s in np.arange(0.0, most, step)[::-1]:
        turned = curvature * s
        at = (sin(turned) / curvature, (1.0 - cos(turned)) / curvature) if curvature else (s, 0.0)
        dx, dy = points[:, 0] - at[0], points[:, 1] - at[1]
        ahead, left = cos(turned) * dx + sin(turned) * dy, cos(turned) * dy - sin(turned) * dx
        first[(np.abs(ahead) < 0.5 * LENGTH + margin) & (np.abs(left) < 0.5 * WIDTH + margin)] = s
    return first, step


@pytest.mark.parametrize(
    ("curvature", "margin"), [(0.0, 0.0), (0.3, 0.0), (-0.3, 0.1), (1.2, 0.2), (-1.7, 0.0), (8.0, 0.0), (-8.0, 0.1)]
)
def test_it_is_the_distance_at_which_a_moving_body_touches_the_point(curvature: float, margin: float) -> None:
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (250, 2))
    if curvature > 2.0:
        points *= 0.5
    if margin:  # what is nearer counts with the bare body
        near = (np.abs(points[:, 0]) < 0.5 * LENGTH + margin) & (np.abs(points[:, 1]) < 0.5 * WIDTH + margin)
        points = points[~near]
    first, step = touched(points, curvature, margin)
    free = np.array([free_distance(points[k : k + 1], curvature, LENGTH, WIDTH, margin) for k in range(len(points))])
    met = np.isfinite(first)
    assert met.sum() > 15
    # a corner may be grazed between two steps, and met a little later
    assert (free[met] <= first[met] + 1e-9).all()
    assert np.quantile(first[met] - free[met], 0.9) <= 1.01 * step
    assert (first[met] - free[met]).max() < 0.1
    assert (free[~met] > 2.99).mean() > 0.98
    assert free_distance(points[free > 0.0], curvature, LENGTH, WIDTH, margin) == free[free > 0.0].min()


def test_what_only_just_misses_the_body_is_free() -> None:
    for x, y, free in (
        (1.0, 0.25, inf),
        (1.0, -0.25, inf),
        (1.0, 0.2499, 0.5),
        (0.5, 0.0, 0.0),
        (-0.5, 0.0, inf),
        (0.0, 0.25, inf),
        (0.0, 0.0, 0.0),
        (-1.0, 0.0, inf),
        (3.0, 0.0, 2.5),
    ):
        assert free_distance(np.array([[x, y]]), 0.0, 1.0, 0.5) == pytest.approx(free)


def beside(x: float, y: float, curvature: float = 0.0) -> float:
    """How far a body of 0.75 x 0.5 m may go past a point with a margin of 0.25 m."""
    return free_distance(np.array([[x, y]]), curvature, 0.75, 0.5, 0.25)


def test_within_the_margin_the_bare_body_counts_and_its_edge_does_not() -> None:
    assert beside(0.625, 0.0) == 0.0
    assert beside(0.624, 0.0) == pytest.approx(0.249)
    assert beside(0.0, 0.5) == inf
    assert beside(-0.4, 0.5, -1.0) < 0.1, "its rear swings out towards it"
    assert beside(-0.4, 0.499, -1.0) > 0.1
    pair = np.array([[0.6, 0.4], [3.0, 0.4]])
    assert free_distance(pair, 0.0, 0.75, 0.5, 0.25) == pytest.approx(2.375), "the near one is passed"


def test_a_wall_ahead_and_a_margin() -> None:
    wall = np.column_stack((np.full(50, 1.0), np.linspace(-1.0, 1.0, 50)))
    assert free_distance(wall, 0.0, LENGTH, WIDTH) == pytest.approx(1.0 - 0.255)
    assert free_distance(wall, 0.0, LENGTH, WIDTH, 0.1) == pytest.approx(1.0 - 0.355)
    assert free_distance(np.empty((0, 2)), 0.3, LENGTH, WIDTH) == inf


@pytest.mark.parametrize("curvature", [0.0, 0.4, -1.2])
def test_a_body_ahead_of_the_pose_touches_what_its_own_front_and_rear_meet(curvature: float) -> None:
    # as on an arc of its own: the body's centre goes round the same point, on another circle
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (300, 2))
    free = [free_distance(each[None], curvature, LENGTH, WIDTH, 0.0, 0.2) for each in points]
    turned = np.linspace(0.0, 3.0, 1201)
    first = []
    for x, y in points:
        theta = curvature * turned
        at = (
            (turned, 0.0 * turned)
            if curvature == 0.0
            else (np.sin(theta) / curvature, (1.0 - np.cos(theta)) / curvature)
        )
        ahead = np.cos(theta) * (x - at[0]) + np.sin(theta) * (y - at[1]) - 0.2
        left = np.cos(theta) * (y - at[1]) - np.sin(theta) * (x - at[0])
        met = turned[(np.abs(ahead) < 0.5 * LENGTH) & (np.abs(left) < 0.5 * WIDTH)]
        first.append(met[0] if len(met) else inf)
    pairs = [(ours, theirs) for ours, theirs in zip(free, first, strict=True) if theirs < inf]
    assert len(pairs) > 20
    assert all(ours <= theirs + 1e-9 for ours, theirs in pairs)
    assert np.quantile([theirs - ours for ours, theirs in pairs], 0.9) < 0.003


def test_a_wall_beside_it_within_the_margin_does_not_hold_it() -> None:
    wall = np.column_stack((np.linspace(-1.0, 3.0, 200), np.full(200, 0.25)))
    assert free_distance(wall, 0.0, LENGTH, WIDTH, 0.08) < 0.02  # what is ahead within the margin does
    beside = wall[np.abs(wall[:, 0]) < 0.3]
    assert free_distance(beside, 0.0, LENGTH, WIDTH, 0.08) == inf


@given(st.floats(0.001, 10.0), st.floats(0.0, 1.0), st.floats(0.1, 5.0))
def test_the_speed_stops_within_the_distance(distance: float, reaction: float, deceleration: float) -> None:
    v = stopping_speed(distance, reaction, deceleration)
    assert v * reaction + v * v / (2.0 * deceleration) == pytest.approx(distance)
    assert stopping_speed(-1.0, reaction, deceleration) == stopping_speed(0.0, reaction, deceleration) == 0.0
    assert stopping_speed(inf, reaction, deceleration) == inf
