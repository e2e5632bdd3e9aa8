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

from math import acos, asin, atan2, cos, hypot, inf, isfinite, pi, sin, sqrt
from typing import Final

from txt1.model.vehicle import LEARNING_SPEED, Geometry

# goal radius, m: the light is reached at this distance (thesis 5.4)
GOAL_RADIUS: Final = 0.5


def optimal_time(
    x: float,
    y: float,
    theta: float,
    speed: float = LEARNING_SPEED,
    radius_min: float = Geometry().radius_min,
    goal_radius: float = GOAL_RADIUS,
) -> float:
    """Return the least time in s from a pose (x, y, theta) to the goal circle of a light at the origin; 0 inside it.

    Lengths are in m, theta in rad, the speed in m/s. Raises ValueError: the speed or a radius is not positive and
    finite, or the pose is not finite.
    """
    if not all(0.0 < value < inf for value in (speed, radius_min, goal_radius)):
        raise ValueError(
            f"speed and radii are positive, not {speed:g} m/s, {radius_min:g} m (turning) and {goal_radius:g} m (goal)"
        )
    if not (isfinite(x) and isfinite(y) and isfinite(theta)):
        raise ValueError("a pose is finite")
    if hypot(x, y) <= goal_radius:
        return 0.0
    # the light in the car's frame
    ahead, left = -x * cos(theta) - y * sin(theta), x * sin(theta) - y * cos(theta)
    return min(_turning_left_first(ahead, side, radius_min, goal_radius) for side in (left, -left)) / speed


def _turning_left_first(ahead: float, left: float, radius: float, goal: float) -> float:
    """Return the length of the shortest path that begins to the left, m; the light is at (ahead, left)."""
    rho, phi = hypot(ahead, left - radius), atan2(left - radius, ahead)
    across = 2.0 * rho * radius
    lengths = [inf]
    # C
    if abs(cosine := rho**2 + radius**2 - goal**2) <= across:
        lengths.append(radius * _turn(phi - acos(cosine / across)))
    # CS
    if rho >= radius and (tangent := sqrt(rho**2 - radius**2)) >= goal:
        lengths.append(radius * _turn(phi - acos(radius / rho)) + tangent - goal)
    # CC'
    k, root = rho**2 + 3.0 * radius**2, goal**2 + 8.0 * rho**2 - 8.0 * radius**2
    w = (4.0 * k - goal**2 + goal * sqrt(max(root, 0.0))) / 8.0
    chord = (2.0 * w - k) / goal + goal
    if root >= 0.0 and 2.0 * w >= k and w <= across and abs(chord) <= 2.0 * radius:
        psi, second = acos(w / across), 2.0 * pi - 2.0 * asin(chord / (2.0 * radius))
        lengths.append(radius * (min(_turn(phi - psi), _turn(phi + psi)) + second))
    return min(lengths)


def _turn(angle: float) -> float:
    """Return the angle of a left turn to `angle`, rad in [0, 2 pi).

    It begins at -pi/2 from the turning circle's centre.
    """
    turn = (angle + pi / 2.0) % (2.0 * pi)
    # a rounding error below 0 is no whole turn
    return 0.0 if turn > 2.0 * pi - 1e-9 else turn
