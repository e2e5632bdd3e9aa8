"""The obstacle stop as a guard: an old scan is none, and the arc that the car drives is looked at, too."""

from __future__ import annotations

import numpy as np

from txt1.config import Config
from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.guards.obstacle_stop.guard import LaserGuard
from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.model.odometry import Odometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import Scan
from txt1.tasks.state import State

BEAMS = 361


def scan(*posts: tuple[float, float]) -> Scan:
    """A sweep of 360 degrees in which only posts are seen, each at x, y (m) from the laser."""
    ranges = np.full(BEAMS, np.inf, np.float32)
    for x, y in posts:
        ranges[round(np.degrees(np.arctan2(y, x))) + 180] = np.hypot(x, y)
    return Scan(-np.pi, np.pi / 180.0, 0.0, ranges, 0.05, 30.0)


class Desk:
    def __init__(self, seen: Scan) -> None:
        self.state, self.gate = State(), Gate(Limits(), on_close=lambda reason: None)
        self.reading: Reading[Scan] | None = Reading(0.0, seen)
        self.guard = LaserGuard(lambda: self.reading, self.state, self.gate, Config().geometry, ObstacleStop())

    def events(self) -> list[str]:
        return [event.text for event in self.state.events]


def test_a_scan_is_used_up_to_its_time_out_and_not_beyond() -> None:
    desk, timeout = Desk(scan()), ObstacleStop().timeout
    assert desk.guard(1.0, 0.0, timeout) == (1.0, 0.0)
    assert desk.guard(1.0, 0.0, timeout + 0.001) == (0.0, 0.0)
    assert desk.gate.counts[Fault.OBSTACLE] == 1
    assert desk.events() == ["slowed to 0.00 m/s: the laser is silent"]
    desk.reading = Reading(10.0, scan())
    assert desk.guard(1.0, 0.0, 10.0) == (1.0, 0.0), "the next reading opens it again"


def test_without_any_scan_it_stands() -> None:
    desk = Desk(scan())
    desk.reading = None
    assert desk.guard(0.5, 0.2, 0.1) == (0.0, 0.0)


def test_the_arc_that_the_car_drives_is_looked_at_beside_the_commanded_arc() -> None:
    # a post ahead on the left: straight on misses it, a curve to the left does not
    post = (0.7, 0.35)
    desk = Desk(scan(post))
    desk.state.odometry = Odometry(v=1.0, omega=0.0)
    assert desk.guard(1.0, 0.0, 0.1) == (1.0, 0.0)
    desk.state.odometry = Odometry(v=1.0, omega=1.2)
    v, _ = desk.guard(1.0, 0.0, 0.2)
    assert v < 1.0, "its wheels still point at the post"
    assert desk.events()[-1].endswith("something is ahead")
