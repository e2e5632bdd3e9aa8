"""How far a body may go along an arc, against a body that is moved along it step by step."""

from math import cos, inf, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.obstacles import free_distance, stopping_speed

LENGTH, WIDTH = 0.51, 0.385
coordinate = st.floats(-2.0, 2.0)
curvature = st.one_of(st.just(0.0), st.floats(-1.0 / 0.56, 1.0 / 0.56))


def stepped(x: float, y: float, curvature: float, step: float = 0.002, most: float = 3.0) -> float:
    """The distance at which a body that is moved by small steps first covers the point."""
    for k in range(round(most / step)):
        s = k * step
        turned = curvature * s
        at = (sin(turned) / curvature, (1.0 - cos(turned)) / curvature) if abs(curvature) > 1e-4 else (s, 0.0)
        dx, dy = x - at[0], y - at[1]
        ahead, left = cos(turned) * dx + sin(turned) * dy, cos(turned) * dy - sin(turned) * dx
        if abs(ahead) < 0.5 * LENGTH and abs(left) < 0.5 * WIDTH:
            return s
    return inf


@given(coordinate, coordinate, curvature)
def test_it_is_the_distance_at_which_a_moving_body_touches_the_point(x: float, y: float, curvature: float) -> None:
    free = free_distance(np.array([[x, y]]), curvature, LENGTH, WIDTH)
    touched = stepped(x, y, curvature)
    if touched < inf:
        assert free <= touched + 1e-6  # never longer
    if free < 2.9 and touched == inf:  # a corner may be grazed between two steps
        grown = min(stepped(x + dx, y + dy, curvature) for dx in (-0.005, 0.0, 0.005) for dy in (-0.005, 0.0, 0.005))
        assert free >= grown - 0.05
    if touched < inf and touched > 0.0:
        assert free >= touched - 0.05


def test_a_wall_ahead_and_a_margin() -> None:
    wall = np.column_stack((np.full(50, 1.0), np.linspace(-1.0, 1.0, 50)))
    assert free_distance(wall, 0.0, LENGTH, WIDTH) == pytest.approx(1.0 - 0.255)
    assert free_distance(wall, 0.0, LENGTH, WIDTH, 0.1) == pytest.approx(1.0 - 0.355)
    assert free_distance(np.empty((0, 2)), 0.3, LENGTH, WIDTH) == inf


def test_a_wall_beside_it_within_the_margin_does_not_hold_it() -> None:
    wall = np.column_stack((np.linspace(-1.0, 3.0, 200), np.full(200, 0.25)))
    assert free_distance(wall, 0.0, LENGTH, WIDTH, 0.08) < 0.02  # what is ahead within the margin does
    beside = wall[np.abs(wall[:, 0]) < 0.3]
    assert free_distance(beside, 0.0, LENGTH, WIDTH, 0.08) == inf


@given(st.floats(0.001, 10.0), st.floats(0.0, 1.0), st.floats(0.1, 5.0))
def test_the_speed_stops_within_the_distance(distance: float, reaction: float, deceleration: float) -> None:
    v = stopping_speed(distance, reaction, deceleration)
    assert v * reaction + v * v / (2.0 * deceleration) == pytest.approx(distance)
    assert stopping_speed(-1.0, reaction, deceleration) == 0.0
