"""What belongs to the viewer and not to the robot: help on or off, and the path seen so far."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import dist, isfinite, nan
from typing import Final

from txt1.model.odometry import Odometry
from txt1.tasks.encoder import ODOMETRY, POSE
from txt1.tasks.on_map import MAP_POSE
from txt1.telemetry.snapshot import Snapshot

# points kept; when they are used up every other one goes, and the spacing doubles
PATH_MAX: Final = 4000
# m between points, to begin with
SPACING: Final = 0.02
# m from one snapshot to the next that tell that the robot was lifted ...
JUMP: Final = 0.5
# ... unless it could drive there at so many m/s: snapshots of a run in fast motion are far apart
REACH: Final = 2.0
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
    """The pose (x, y, theta) to draw: on the map where there is one, in the room where it is known, else odometry's.

    A robot that is lost on its map is nowhere: nan.
    """
    if (there := snapshot.get(MAP_POSE)) is not None:
        return NOWHERE if there.lost else there[:3]
    x, y, theta, _, _ = snapshot.get(ODOMETRY, Odometry())
    return snapshot.get(POSE) or (x, y, theta)


@dataclass
class Viewer:
    """The viewer's own state."""

    # of the last row, the most important first
    keys: Mapping[str, str] = field(default_factory=DRIVING.copy)
    # whether the list of keys covers the screen
    help: bool = False
    # points (x, y) passed, m; at most PATH_MAX
    path: list[tuple[float, float]] = field(default_factory=list)
    # least distance between points, m
    spacing: float = SPACING
    _last: tuple[float, float] = (0.0, 0.0)
    _time: float = 0.0

    def follow(self, snapshot: Snapshot) -> None:
        """Add where the robot is now; a jump or a new run starts a new path."""
        x, y, _ = pose_of(snapshot)
        if not (isfinite(x) and isfinite(y)):
            return
        here = (x, y)
        elapsed = snapshot.time - self._time
        if elapsed < 0.0 or dist(here, self._last) > max(JUMP, REACH * elapsed):
            self.path, self.spacing = [], SPACING
        self._last, self._time = here, snapshot.time
        if not self.path or dist(here, self.path[-1]) >= self.spacing:
            self.path.append(here)
        if len(self.path) >= PATH_MAX:
            self.path, self.spacing = self.path[::2], 2.0 * self.spacing
