"""The distance that a vehicle may drive along an arc before its body touches something, and the speed for it."""

from math import copysign, hypot, inf, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

# curvature that counts as none, 1/m
NO_CURVATURE: Final = 1e-4
TURN: Final = 2.0 * pi

Floats = NDArray[np.float64]


def free_distance(
    points: Floats, curvature: float, length: float, width: float, margin: float = 0.0, centre: float = 0.0
) -> float:
    """Return the distance in m that a vehicle may go forward along an arc before its body touches a point; inf if none.

    In the vehicle's frame a point goes backwards on the circle around the arc's centre (0, 1 / curvature); it is
    touched where that circle first meets an edge of the rectangle.

    Args:
        points: (n, 2), m in the vehicle's frame: x forward, y left.
        curvature: of the arc, 1/m, left positive.
        length: of the body along x, m.
        width: of the body, m.
        margin: distance kept on all sides, m; a point that is already nearer counts for the body without margin.
        centre: of the body, m ahead of the frame's origin, which is on the rear axle if only the front wheels steer.

    """
    x, y = points[:, 0], points[:, 1]
    back, front, side = centre - 0.5 * length, centre + 0.5 * length, 0.5 * width
    near = (x > back - margin) & (x < front + margin) & (np.abs(y) < side + margin)
    bare = _along(points[near], curvature, back, front, side) if near.any() else inf
    return min(bare, _along(points[~near], curvature, back - margin, front + margin, side + margin))


def _along(points: Floats, curvature: float, back: float, front: float, side: float) -> float:
    """Return the same for a rectangle from x = `back` to `front`, and `side` to the left and right; 0 for a point
    inside it.
    """
    x, y = points[:, 0], points[:, 1]
    if not len(x):
        return inf
    if bool(((x > back) & (x < front) & (np.abs(y) < side)).any()):
        return 0.0
    if abs(curvature) < NO_CURVATURE:
        ahead = x[(np.abs(y) < side) & (x >= front)]
        return float(ahead.min()) - front if len(ahead) else inf
    radius = 1.0 / curvature
    rho2 = x * x + (y - radius) ** 2
    turn = np.arctan2(y - radius, x)
    least = inf
    with np.errstate(invalid="ignore"):
        meets = []
        for edge in (front, back):
            reach = np.sqrt(rho2 - edge * edge)
            meets += [(np.full_like(x, edge), radius + reach), (np.full_like(x, edge), radius - reach)]
        for edge in (side, -side):
            reach = np.sqrt(rho2 - (edge - radius) ** 2)
            meets += [(reach, np.full_like(x, edge)), (-reach, np.full_like(x, edge))]
        for at_x, at_y in meets:
            # NaN if the circle does not meet the edge
            on = (at_x >= back - 1e-9) & (at_x <= front + 1e-9) & (np.abs(at_y) <= side + 1e-9)
            if on.any():
                angle = np.arctan2(at_y[on] - radius, at_x[on])
                gone = (copysign(1.0, radius) * (turn[on] - angle)) % TURN
                least = min(least, float(gone.min()) * abs(radius))
    return least


def stopping_speed(distance: float, reaction: float, deceleration: float) -> float:
    """Return the speed (m/s) that allows a stop within a distance (m): v reaction + v^2 / (2 deceleration) =
    distance.
    """
    t = deceleration * reaction
    return hypot(t, sqrt(2.0 * deceleration * max(distance, 0.0))) - t
