"""A picture of the light-seeking task from above, for environments: numbers in, an array of colours out."""

from collections.abc import Sequence
from math import cos, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config
from txt1.learning.settings import LearningConfig
from txt1.sim.obstacles import outline
from txt1.sim.parameters import Box, Post

PICTURE_SIDE: Final = 400  # pixels
# m around the starts that is shown
STARTS_MARGIN: Final = 0.5
FLOOR, WALL, GOAL, LIGHT = (250, 250, 248), (90, 90, 90), (255, 240, 190), (240, 170, 0)
# in turn
CARS: Final = ((30, 90, 200), (200, 60, 40), (40, 150, 80), (140, 60, 170))
Point = tuple[float, float]
Colour = tuple[int, int, int]


class Overview(NamedTuple):
    """The contents of a picture, m and rad."""

    config: Config
    light: Point
    # of the robots
    poses: Sequence[tuple[float, float, float]]
    # that they came
    ways: Sequence[Sequence[Point]]


def picture(scene: Overview) -> NDArray[np.uint8]:
    """The colours, shape (400, 400, 3): floor, goal, light, obstacles, walls of a map, and the robots on their ways."""
    one, sim = scene.config.section(LearningConfig), scene.config.sim
    middle = sim.room.light
    places = [scene.light, *(pose[:2] for pose in scene.poses), *(place for way in scene.ways for place in way)]
    reach = max(one.start_radius, *(max(abs(x - middle[0]), abs(y - middle[1])) for x, y in places)) + STARTS_MARGIN
    scale = PICTURE_SIDE / (2.0 * reach)
    steps = (np.arange(PICTURE_SIDE) + 0.5) / scale - reach
    east, north = np.meshgrid(middle[0] + steps, middle[1] - steps)
    drawn = np.full((PICTURE_SIDE, PICTURE_SIDE, 3), FLOOR, np.uint8)
    away = np.hypot(east - scene.light[0], north - scene.light[1])
    drawn[away <= one.goal_radius] = GOAL
    drawn[away <= 0.06] = LIGHT
    walls = sim.room.built().walls
    if walls is not None:
        drawn[~walls.grid.is_free(east, north)] = WALL
    for obstacle in sim.obstacles:
        if isinstance(obstacle, Post):
            drawn[np.hypot(east - obstacle.x, north - obstacle.y) <= obstacle.radius] = WALL
        else:
            _fill(drawn, east, north, outline(obstacle), WALL)
    body = scene.config.geometry
    for k, (pose, way) in enumerate(zip(scene.poses, scene.ways, strict=True)):
        x, y, theta = pose
        colour = CARS[k % len(CARS)]
        came = scale * (np.reshape(way, (-1, 2)) - (middle[0] - reach, middle[1] + reach))
        drawn[(-came[:, 1]).astype(int), came[:, 0].astype(int)] = colour
        box = Box(x + body.centre * cos(theta), y + body.centre * sin(theta), body.length, body.width, theta)
        _fill(drawn, east, north, outline(box), colour)
        nose = [(x + 0.5 * body.length * cos(theta + a), y + 0.5 * body.length * sin(theta + a)) for a in (-0.3, 0.3)]
        _fill(drawn, east, north, (*nose, (x, y)), FLOOR)
    return drawn


def _fill(
    drawn: NDArray[np.uint8],
    east: NDArray[np.float64],
    north: NDArray[np.float64],
    corners: Sequence[Point],
    colour: Colour,
) -> None:
    """Colour a convex shape whose corners go counter-clockwise."""
    inside = np.ones(east.shape, bool)
    for (ax, ay), (bx, by) in zip(corners, (*corners[1:], corners[0]), strict=True):
        inside &= (bx - ax) * (north - ay) - (by - ay) * (east - ax) >= 0.0
    drawn[inside] = colour
