"""Refuses unsolvable learning tasks before a trial begins, in a line with the key, the value and the remedy."""

from dataclasses import replace
from math import cos, pi, sin
from typing import Final

from txt1.config import Config
from txt1.errors import ConfigError
from txt1.learning.settings import LearningConfig
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Box

# s between two looks for the goal by default: the quickest learner's decisions
GOAL_CHECK_PERIOD: Final = 0.1
# number of starts that are tried around the light
TRIED_BEARINGS: Final = 72


def refuse_unsolvable(config: Config) -> None:
    """Refuse a world that cannot be solved; ConfigError names the setting, and a value to set.

    Starts are tried on the circle around the light, with the robot's middle there, against walls, posts and boxes. The
    goal must have a place at which no post or box keeps the robot out.
    """
    one, (x, y) = config.section(LearningConfig), config.sim.room.light
    if not any(omega for _, omega in one.actions):
        told = [list(each) for each in one.actions]
        raise ConfigError(f"learning.actions: {told}: none of them turns; give one a yaw rate, rad/s")
    speed = max(abs(v) for v, _ in one.actions)
    if not speed:
        raise ConfigError("learning.actions: none of them drives; give one a speed, m/s")
    outermost = max(abs(x), abs(y))
    if outermost > one.boundary:
        raise ConfigError(
            f"sim.room.light: {x:g}, {y:g} is outside learning.boundary, {one.boundary:g} m; "
            f"set a boundary of more than {outermost + one.start_radius:g}"
        )
    bearings = [2.0 * pi * k / TRIED_BEARINGS for k in range(TRIED_BEARINGS)]
    begins = [(x + one.start_radius * cos(each), y + one.start_radius * sin(each)) for each in bearings]
    if all(max(abs(east), abs(north)) > one.boundary for east, north in begins):
        raise ConfigError(
            f"learning.start_radius: {one.start_radius:g}: every start is outside learning.boundary, "
            f"{one.boundary:g} m; set at most {one.boundary - outermost:g}"
        )
    if one.goal_radius >= one.start_radius:
        raise ConfigError(
            f"learning.goal_radius: {one.goal_radius:g}: every start, {one.start_radius:g} m away by "
            "learning.start_radius, is in the goal already; set less"
        )
    way = speed * (one.goal_period or GOAL_CHECK_PERIOD)
    if 2.0 * one.goal_radius < way:
        raise ConfigError(
            f"learning.goal_radius: {one.goal_radius:g}: the robot goes {way:g} m between two looks for the goal and "
            f"may drive across it unseen; set at least {0.5 * way:g}, or a shorter learning.goal_period"
        )
    body = config.geometry
    walls = config.sim.room.built().walls
    middle = replace(body, length=body.width, centre=0.0)
    if walls is not None:
        if walls.distance(x, y) < 0.0:
            raise ConfigError(f"sim.room.light: {x:g}, {y:g} is in {walls.told}; set a place that is free")
        if any(walls.clearance(*start, 0.0, middle) < 0.0 for start in begins):
            raise ConfigError(
                f"learning.start_radius: {one.start_radius:g}: episodes begin so far from the light, and there is "
                f"{walls.told}; set less, or move sim.room.light"
            )
    around = [(x, y), *((x + one.goal_radius * cos(each), y + one.goal_radius * sin(each)) for each in bearings)]
    for number, obstacle in enumerate(config.sim.obstacles):
        which = f"sim.obstacles: number {number}, at {obstacle.x:g}, {obstacle.y:g},"
        if any(gap(Box(*start, body.width, body.width), obstacle) <= 0.0 for start in begins):
            raise ConfigError(
                f"{which} stands where episodes begin, {one.start_radius:g} m from the light; move it, or set another "
                "learning.start_radius"
            )
        if all(gap(Box(*place, body.width, body.width), obstacle) <= 0.0 for place in around):
            raise ConfigError(
                f"{which} keeps the robot from the goal, {one.goal_radius:g} m around the light; move it, or set "
                "another learning.goal_radius"
            )
