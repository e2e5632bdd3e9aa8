"""The least time to the light, for a car that turns and drives optimally.

The car drives forward at a constant speed v and turns by at most v / R. It has arrived when its centre is on the goal
circle, of radius g around the light, whatever its heading. The time is the length of the shortest such path over v.

The shortest path is of one of three kinds, and begins to the left or to the right:

- C: an arc that runs into the goal circle;
- CS: an arc, then a straight line towards the light, which ends g before it;
- CC': an arc, then an arc that turns the other way. The ends of the second arc and the light are on a straight line.

docs/results/least_time.md derives the kinds and their lengths from Pontryagin's maximum principle. The tests show by
Bellman's inequality that no path is shorter.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from txt1.model.vehicle import SPEED, Geometry

# goal radius, m: the light is reached at this distance (thesis 5.4)
GOAL_RADIUS: Final = 0.5

Array = NDArray[np.float64]


def optimal_time(
    x: ArrayLike,
    y: ArrayLike,
    theta: ArrayLike,
    speed: float = SPEED,
    radius_min: float = Geometry().radius_min,
    goal_radius: float = GOAL_RADIUS,
) -> Array:
    """Return the least time in s from poses (x, y, theta) to the goal circle of a light at the origin; 0 inside
    the circle.

    The shape is that of x, y and theta broadcast against each other. Lengths are in m, theta in rad, the speed in m/s.
    Raises ValueError: the speed or a radius is not positive and finite, or a pose is not finite.
    """
    if not all(0.0 < value < np.inf for value in (speed, radius_min, goal_radius)):
        raise ValueError(
            f"speed and radii are positive, not {speed:g} m/s, {radius_min:g} m (turning) and {goal_radius:g} m (goal)"
        )
    x, y, theta = np.broadcast_arrays(*(np.asarray(value, float) for value in (x, y, theta)))
    if not (np.isfinite(x).all() and np.isfinite(y).all() and np.isfinite(theta).all()):
        raise ValueError("a pose is finite")
    # the light in the car's frame
    ahead = -x * np.cos(theta) - y * np.sin(theta)
    left = x * np.sin(theta) - y * np.cos(theta)
    length = np.minimum(
        _length_turning_left_first(ahead, left, radius_min, goal_radius),
        _length_turning_left_first(ahead, -left, radius_min, goal_radius),
    )
    return np.where(np.hypot(x, y) <= goal_radius, 0.0, length) / speed


def _length_turning_left_first(ahead: Array, left: Array, radius: float, goal: float) -> Array:
    """Return the length of the shortest path that begins to the left, m; the light is at (ahead, left)."""
    rho = np.hypot(ahead, left - radius)
    phi = np.arctan2(left - radius, ahead)
    # NaN if there is no path of this kind
    with np.errstate(invalid="ignore", divide="ignore"):
        # C
        delta = np.arccos((rho**2 + radius**2 - goal**2) / (2.0 * rho * radius))
        arc = radius * _turn(phi - delta)
        # CS
        tangent = np.sqrt(rho**2 - radius**2)
        arc_and_line = radius * _turn(phi - np.arccos(radius / rho)) + tangent - goal
        arc_and_line = np.where(tangent >= goal, arc_and_line, np.nan)
        # CC'
        k = rho**2 + 3.0 * radius**2
        w = (4.0 * k - goal**2 + goal * np.sqrt(goal**2 + 8.0 * rho**2 - 8.0 * radius**2)) / 8.0
        psi = np.arccos(w / (2.0 * rho * radius))
        chord = (2.0 * w - k) / goal + goal
        second = 2.0 * np.pi - 2.0 * np.arcsin(chord / (2.0 * radius))
        two_arcs = radius * (np.fmin(_turn(phi - psi), _turn(phi + psi)) + second)
        two_arcs = np.where(2.0 * w >= k, two_arcs, np.nan)
    shortest = np.fmin(arc, np.fmin(arc_and_line, two_arcs))
    return np.where(np.isnan(shortest), np.inf, shortest)


def _turn(angle: Array) -> Array:
    """Return the angle of a left turn to `angle`, rad in [0, 2 pi).

    It begins at -pi/2 from the turning circle's centre.
    """
    turn = (angle + np.pi / 2.0) % (2.0 * np.pi)
    # a rounding error below 0 is no whole turn
    return np.where(turn > 2.0 * np.pi - 1e-9, 0.0, turn)
