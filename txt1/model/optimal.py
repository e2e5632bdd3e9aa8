"""The least time to the light: what a car that turns and drives optimally needs (spec 9).

The car drives forward at a constant speed v and turns by at most v / R. It has arrived when its centre is on the goal
circle, of radius g around the light, whatever its heading. The time is the length of the shortest such path over v.

**Which paths can be shortest.** Pontryagin's maximum principle for x' = cos(theta), y' = sin(theta), theta' = u,
abs(u) <= 1 / R: there is a vector p, the same all along the path, and the path turns as sharply as it can, left or
right, or goes straight along p. It changes from one to another only on one certain line in the direction of p. The end
lies on that line too, because the final heading is free; and because the end may slide along the goal circle, p is the
circle's normal there, so the line goes through the light. Three kinds remain, as for a path to a point with free
heading (Boissonnat and Bui, Accessibility region for a car that only moves forwards along optimal paths, 1994):

- C: an arc that runs into the goal circle by itself.
- CS: an arc, and a straight line from its end towards the light, g short of it.
- CC': an arc, and one turning the other way, whose two ends and the light are on one line. It is needed where the
  light is near the centre of a turning circle: turning to that side the car would go round it for ever, and by the
  other side it is far. So it swings out a little first and comes round.

Each may begin to the left or to the right, and the shortest of the six is the answer. All six can be driven and end on
the goal circle, so none is too short; that none is too long, the tests show by Bellman's inequality: whatever the car
does for a moment, the least time falls by no more than that moment.

**Their lengths.** Put the light at the origin of a frame in which the car is at (x, y), heading along +x; a right
turn is a left turn with y mirrored. A left turn's centre is then c = (x, y + R); from there the light is at distance
rho, at the angle phi, and the car starts at the angle -pi/2. Angles of arcs are taken modulo 2 pi, from 0 up.

- C: the circles meet at the angles phi -+ delta from c, where cos(delta) = (rho^2 + R^2 - g^2) / (2 rho R), if at all.
  The first is met first, as the car begins outside of the goal circle. Length R (phi - delta + pi/2).
- CS: from the light the tangent to the turning circle is sqrt(rho^2 - R^2) long and touches it at the angle
  phi - arccos(R / rho). Length R (phi - arccos(R / rho) + pi/2) + sqrt(rho^2 - R^2) - g. When the tangent is shorter
  than g, the arc has met the goal circle before.
- CC': the second circle touches the first at S, its centre c' is at 2 R from c in the direction of S. By the power of
  the light (the product of the two parts into which it cuts a chord), if S and the end E are on either side of it,
  abs(S) abs(E) = R^2 - abs(c')^2, and abs(E) = g. With psi the angle at c from the light to S, w = 2 rho R cos(psi),

      abs(S)^2 = rho^2 + R^2 - w,    abs(c')^2 = rho^2 + 4 R^2 - 2 w,    so    g abs(S) = 2 w - K,  K = rho^2 + 3 R^2

  and the square of the last is 4 w^2 - (4 K - g^2) w + K^2 - g^2 (rho^2 + R^2) = 0, of which 2 w >= K takes the larger
  root: w = (4 K - g^2 + g sqrt(g^2 + 8 rho^2 - 8 R^2)) / 8. S is at phi - psi or phi + psi. The chord is
  d = abs(S) + g long, and the second arc the longer one over it, 2 pi - 2 arcsin(d / 2 R).
  Length R (phi -+ psi + pi/2) + R (2 pi - 2 arcsin(d / 2 R)).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from txt1.model.vehicle import Geometry

SPEED: Final = 0.3  # the learning robot's speed, m/s (table 5.2)
GOAL_RADIUS: Final = 0.5  # the light is reached so many metres from it (thesis 5.4)

Array = NDArray[np.float64]


def optimal_time(
    x: ArrayLike,
    y: ArrayLike,
    theta: ArrayLike,
    speed: float = SPEED,
    radius_min: float = Geometry().radius_min,
    goal_radius: float = GOAL_RADIUS,
) -> Array:
    """Least time in s from poses (x, y, theta) to the goal circle around a light at the origin.

    Shape: that of x, y and theta broadcast against each other; () for three numbers. 0 inside the goal circle.

    x, y, the turning radius and the goal's are in m, theta is in rad, the speed in m/s.

    Raises ValueError: speed or a radius is not positive and finite, or a pose is not finite.
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
    """Length of the shortest of the three kinds of path that begin to the left, m; the light is at (ahead, left)."""
    rho = np.hypot(ahead, left - radius)
    phi = np.arctan2(left - radius, ahead)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN where there is no path of the kind
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
    """Angle of a left turn from the start, at -pi/2 from the turning circle's centre, to `angle`; rad in [0, 2 pi)."""
    turn = (angle + np.pi / 2.0) % (2.0 * np.pi)
    # a rounding error below nothing is no whole turn
    return np.where(turn > 2.0 * np.pi - 1e-9, 0.0, turn)
