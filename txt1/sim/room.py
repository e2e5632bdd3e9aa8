"""Four walls that stop the vehicle."""

from math import cos, inf, sin
from typing import NamedTuple

from txt1.model.vehicle import Geometry


class Room(NamedTuple):
    """A rectangular room around the origin; infinite by default."""

    length: float = inf  # along x, m
    width: float = inf  # along y, m


def clearance(x: float, y: float, theta: float, room: Room, body: Geometry) -> float:
    """Metres from the body's nearest corner to the nearest wall; negative when it sticks into the wall."""
    c, s = cos(theta), sin(theta)
    x, y = x + body.centre * c, y + body.centre * s
    # half extents of the rotated body along the room's axes
    reach_x = 0.5 * (body.length * abs(c) + body.width * abs(s))
    reach_y = 0.5 * (body.length * abs(s) + body.width * abs(c))
    return min(0.5 * room.length - abs(x) - reach_x, 0.5 * room.width - abs(y) - reach_y)
