"""The walls that stop the vehicle: four, or those of a map."""

from math import cos, inf, sin
from typing import TYPE_CHECKING, NamedTuple

from txt1.model.vehicle import Geometry

if TYPE_CHECKING:
    from txt1.sim.walls import Walls


class Room(NamedTuple):
    """A rectangular room around the origin; infinite by default."""

    # along x, m
    length: float = inf
    # along y, m
    width: float = inf
    walls: "Walls | None" = None  # of a map
    # the walls of a map; a floor that was never seen free is solid
    behind: "Walls | None" = None

    @property
    def blind(self) -> bool:
        """Whether a vehicle backs up over seen floor alone."""
        return self.behind is not None


def clearance(x: float, y: float, theta: float, room: Room, body: Geometry) -> float:
    """Return the distance from the body's nearest corner to the nearest wall, m; negative inside a wall."""
    c, s = cos(theta), sin(theta)
    ahead, beside = x + body.centre * c, y + body.centre * s
    # half extents of the rotated body along the room's axes
    reach_x = 0.5 * (body.length * abs(c) + body.width * abs(s))
    reach_y = 0.5 * (body.length * abs(s) + body.width * abs(c))
    left = min(0.5 * room.length - abs(ahead) - reach_x, 0.5 * room.width - abs(beside) - reach_y)
    return left if room.walls is None else min(left, room.walls.clearance(x, y, theta, body))
