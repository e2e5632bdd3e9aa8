"""What stops a robot that is told to drive: what the obstacle stop sees there, or something that it touches."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from txt1.config import Config
from txt1.control.limits import Gate
from txt1.control.parameters import Limits
from txt1.guards.obstacle_stop.guard import LaserGuard
from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.navigation.goto import halted
from txt1.sensors.base import Reading
from txt1.sensors.readings import Mount, Scan
from txt1.tasks.state import State


@pytest.mark.parametrize("gear", [1.0, -1.0])
@pytest.mark.parametrize("all_round", [True, False])
def test_what_stops_it_is_what_its_laser_sees_in_that_gear(gear: float, all_round: bool) -> None:
    ranges = np.full(360 if all_round else 1, np.inf, np.float32)
    ranges[0] = 0.4
    # a single beam, or the first of a turn, points along the gear
    seen = Reading(0.0, Scan(0.0 if gear > 0.0 else np.pi, np.pi / 180.0, 0.0, ranges, 0.05, 12.0, mount=Mount()))
    geometry = Config().geometry
    guard = LaserGuard(lambda: seen, State(), Gate(Limits(), on_close=lambda reason: None), geometry, ObstacleStop())
    guard(0.0, 0.0, 0.0)
    robot = SimpleNamespace(
        now=0.1, config=SimpleNamespace(geometry=geometry), runtime=SimpleNamespace(part=lambda kind: guard)
    )
    error = halted(robot, gear, (1.0, 2.0, 0.0))  # type: ignore[arg-type]
    if gear > 0.0 or all_round:
        assert error.met == pytest.approx(np.array([(1.0 + gear * 0.4, 2.0)]))
    else:
        # touched
        assert len(error.met) == 9 and (error.met[:, 0] < 1.0 - 0.5 * geometry.length).all()
    assert error.place == pytest.approx(tuple(error.met[len(error.met) // 2]))
