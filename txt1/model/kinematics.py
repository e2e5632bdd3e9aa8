"""Kinematics of the dual-steered vehicle (thesis 2.1, 2.2). x forward, y left, theta counter-clockwise."""

from math import cos, pi, sin
from typing import Final

TWO_PI: Final = 2.0 * pi


def wrap_angle(angle: float) -> float:
    """Return the same direction in (-pi, pi], rad."""
    if -pi < angle <= pi:
        return angle
    wrapped = (angle + pi) % TWO_PI - pi
    return pi if wrapped <= -pi else wrapped


def yaw_rate_max(v: float, radius_min: float) -> float:
    """Return the largest reachable yaw rate at speed v, rad/s, (2.16); 0 at standstill."""
    return abs(v) / radius_min


def move_along_arc(
    x: float, y: float, theta: float, distance: float, curvature: float, beta: float
) -> tuple[float, float, float]:
    """Return the pose (x, y, theta) after `distance` m along an arc of constant `curvature` (1/m) and sideslip
    beta (rad).

    Exact for any speed profile along the arc: (2.2) integrated over the distance. The heading is wrapped to (-pi, pi].
    """
    turn = distance * curvature
    # sin(turn / 2) / (turn / 2): the chord's length over the arc's
    half = 0.5 * turn
    ratio = 1.0 - half * half / 6.0 if abs(half) < 1e-4 else sin(half) / half
    direction = theta + beta + half
    chord = distance * ratio
    end = theta + turn
    return x + chord * cos(direction), y + chord * sin(direction), end if -pi < end <= pi else wrap_angle(end)
