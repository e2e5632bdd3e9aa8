"""Boxes and round posts on the floor, and their distances to the vehicles' bodies."""

from math import cos, hypot, pi, sin

from txt1.sim.parameters import Box, Post

Obstacle = Box | Post
# corners (x, y) in m; the last is joined to the first
Outline = tuple[tuple[float, float], ...]


def outline(obstacle: Obstacle) -> Outline:
    """Return the edge of an obstacle on the floor; a post becomes a polygon."""
    if isinstance(obstacle, Post):
        angles = [k * pi / 8.0 for k in range(16)]
        return tuple((obstacle.x + obstacle.radius * cos(a), obstacle.y + obstacle.radius * sin(a)) for a in angles)
    c, s = 0.5 * cos(obstacle.theta), 0.5 * sin(obstacle.theta)
    sides = [(obstacle.length * a, obstacle.width * b) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return tuple((obstacle.x + a * c - b * s, obstacle.y + a * s + b * c) for a, b in sides)


def distance(obstacle: Obstacle, x: float, y: float) -> float:
    """Return the distance from the point (x, y) to an obstacle's edge, m; negative inside it."""
    dx, dy = x - obstacle.x, y - obstacle.y
    if isinstance(obstacle, Post):
        return hypot(dx, dy) - obstacle.radius
    c, s = cos(obstacle.theta), sin(obstacle.theta)
    beside_x = abs(dx * c + dy * s) - 0.5 * obstacle.length
    beside_y = abs(dy * c - dx * s) - 0.5 * obstacle.width
    return hypot(max(beside_x, 0.0), max(beside_y, 0.0)) + min(max(beside_x, beside_y), 0.0)


def gap(body: Box, other: Obstacle) -> float:
    """Return the distance between a body and an obstacle, m; if they overlap, the least way out, negative.

    For separate rectangles it is the largest gap along an axis of either (separating axis theorem). This may be less
    than the distance between their corners.
    """
    if isinstance(other, Post):
        return distance(body, other.x, other.y) - other.radius
    dx, dy = other.x - body.x, other.y - body.y
    c, s = cos(body.theta), sin(body.theta)
    c_other, s_other = cos(other.theta), sin(other.theta)
    along, across = abs(c * c_other + s * s_other), abs(c * s_other - s * c_other)
    front, side, front_other, side_other = 0.5 * body.length, 0.5 * body.width, 0.5 * other.length, 0.5 * other.width
    return max(
        abs(dx * c + dy * s) - front - front_other * along - side_other * across,
        abs(dy * c - dx * s) - side - front_other * across - side_other * along,
        abs(dx * c_other + dy * s_other) - front_other - front * along - side * across,
        abs(dy * c_other - dx * s_other) - side_other - front * across - side * along,
    )
