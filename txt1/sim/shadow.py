"""Shadows of walls and of things that stand or move on the floor: a light sensor in a shadow does not see the lamp.

The thing on which the lamp hangs or stands throws no shadow. Other vehicles throw no shadow, either.
"""

from collections.abc import Callable, Sequence
from math import cos, hypot, sin

import numpy as np

from txt1.maps.grid import Grid
from txt1.maps.rays import cast, prepare
from txt1.model.light_sensors import MOUNT, Mount
from txt1.sim.lamp import Lit
from txt1.sim.obstacles import Obstacle, distance
from txt1.sim.parameters import Box, Post

Point = tuple[float, float]


def lit_by(
    light: Point,
    grid: Grid | None = None,
    obstacles: Sequence[Obstacle] = (),
    movers: Callable[[], Sequence[Box]] = tuple,
    mount: Mount = MOUNT,
) -> Lit:
    """Return the function that tells whether sensors at `mount` see a light at (x, y), m, from a pose.

    Args:
        light: its place, m.
        grid: the walls. The cell of the light counts as free, so that a lamp may hang on a wall.
        obstacles: standing obstacles.
        movers: returns the present places of moving boxes.
        mount: the sensors' places on the vehicle, m.

    """
    standing = tuple(each for each in obstacles if distance(each, *light) > 0.0)
    ahead, left = np.array(mount, float).T
    slack = 0.0
    if grid is not None:
        prepare()
        slack = 1.5 * grid.resolution

    def lit(x: float, y: float, theta: float) -> list[bool]:
        c, s = cos(theta), sin(theta)
        px, py = x + c * ahead - s * left, y + s * ahead + c * left
        seen = [True] * len(px)
        if grid is not None:
            dx, dy = light[0] - px, light[1] - py
            seen = (cast(grid, px, py, np.arctan2(dy, dx)) >= np.hypot(dx, dy) - slack).tolist()
        things = (*standing, *(each for each in movers() if distance(each, *light) > 0.0))
        places = list(zip(px.tolist(), py.tolist(), strict=True))
        return [
            free and not any(between(each, place, light) for each in things)
            for free, place in zip(seen, places, strict=True)
        ]

    return lit


def between(obstacle: Obstacle, one: Point, other: Point) -> bool:
    """Return whether the straight line between two points (m) passes through an obstacle."""
    x, y = one[0] - obstacle.x, one[1] - obstacle.y
    dx, dy = other[0] - one[0], other[1] - one[1]
    if isinstance(obstacle, Post):
        length = dx * dx + dy * dy
        nearest = min(max(-(x * dx + y * dy) / length, 0.0), 1.0) if length else 0.0
        return hypot(x + nearest * dx, y + nearest * dy) < obstacle.radius
    # in the box's own frame: the part of the line between the box's sides, along each axis
    c, s = cos(obstacle.theta), sin(obstacle.theta)
    first, last = 0.0, 1.0
    for at, step, half in (
        (x * c + y * s, dx * c + dy * s, 0.5 * obstacle.length),
        (y * c - x * s, dy * c - dx * s, 0.5 * obstacle.width),
    ):
        if step == 0.0:
            if abs(at) >= half:
                return False
            continue
        near, far = sorted(((-half - at) / step, (half - at) / step))
        first, last = max(first, near), min(last, far)
    return first < last
