"""The state of the viewer, as opposed to the robot's: help on or off, and the path seen so far."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import dist, isfinite, nan
from typing import Final

from txt1.model.odometry import Odometry
from txt1.tasks.encoder import ODOMETRY, POSE
from txt1.tasks.on_map import MAP_POSE
from txt1.telemetry.snapshot import Snapshot

# points kept; when they are used up, every other point is removed, and the spacing doubles
PATH_MAX: Final = 4000
# m between points, to begin with
POINT_SPACING: Final = 0.02
# m between two snapshots that mean that the robot was lifted ...
LIFTED_JUMP: Final = 0.5
# ... unless it could have driven there at this speed, m/s: snapshots of a fast run are far apart
DRIVEN_SPEED_MAX: Final = 2.0
NOWHERE: Final = (nan, nan, nan)
# the keys of a robot
DRIVING: Final = {
    "SPACE": "stop",
    "q": "quit",
    "?": "help",
    "m": "arm",
    "wasd": "drive",
    "←→": "screen",
    "↑↓": "gains",
    "+-": "speed",
    "c": "manual",
    "e": "ESC",
}


def pose_of(snapshot: Snapshot) -> tuple[float, float, float]:
    """Return the pose (x, y, theta) to draw: on the map if there is one, in the room if it is known, else odometry's.

    For a robot that is lost on its map it is nan.
    """
    if (there := snapshot.get(MAP_POSE)) is not None:
        return NOWHERE if there.lost else there[:3]
    x, y, theta, _, _ = snapshot.get(ODOMETRY, Odometry())
    return snapshot.get(POSE) or (x, y, theta)


@dataclass
class Viewer:
    """The viewer's own state."""

    # keys in the last row, the most important first
    keys: Mapping[str, str] = field(default_factory=DRIVING.copy)
    # whether the list of keys covers the screen
    help: bool = False
    # points (x, y) passed, m; at most PATH_MAX
    path: list[tuple[float, float]] = field(default_factory=list)
    # least distance between points, m
    spacing: float = POINT_SPACING
    _last: tuple[float, float] = (0.0, 0.0)
    _time: float = 0.0

    def follow(self, snapshot: Snapshot) -> None:
        """Add the robot's present place; a jump or a new run starts a new path."""
        x, y, _ = pose_of(snapshot)
        if not (isfinite(x) and isfinite(y)):
            return
        here = (x, y)
        elapsed = snapshot.time - self._time
        if elapsed < 0.0 or dist(here, self._last) > max(LIFTED_JUMP, DRIVEN_SPEED_MAX * elapsed):
            self.path, self.spacing = [], POINT_SPACING
        self._last, self._time = here, snapshot.time
        if not self.path or dist(here, self.path[-1]) >= self.spacing:
            self.path.append(here)
        if len(self.path) >= PATH_MAX:
            self.path, self.spacing = self.path[::2], 2.0 * self.spacing
