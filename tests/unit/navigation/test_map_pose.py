"""The pose on a map as a pose source."""

from types import SimpleNamespace

import pytest

from txt1.errors import CommandRefused, NotCapable
from txt1.mapping.map_sensors import OnMap
from txt1.mapping.topics import MapNews
from txt1.model.odometry import Odometry
from txt1.navigation import map_pose
from txt1.telemetry.bus import Bus


def robot(news: MapNews | None) -> SimpleNamespace:
    """A robot that stands 1 m ahead of where its odometry began."""
    runtime = SimpleNamespace(bus=Bus(), state=SimpleNamespace(odometry=Odometry(1.0, 0.0, 0.0)))
    there = OnMap(runtime, False, None)
    there.news = news
    runtime.part = lambda kind: there
    return SimpleNamespace(runtime=runtime)


def news(lost: bool) -> MapNews:
    return MapNews(1.0, (2.0, 3.0, 0.5), (0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01), (2.0, 3.0, 0.5), 0.9, lost)


def test_odometry_since_the_last_scan_counts():
    assert map_pose(robot(news(False))).pose() == pytest.approx((2.0 + 0.87758, 3.0 + 0.47943, 0.5), abs=1e-4)


@pytest.mark.parametrize("told", [None, news(True)])
def test_a_lost_robot_has_no_pose(told):
    with pytest.raises(CommandRefused):
        map_pose(robot(told)).pose()


def test_without_a_map_it_says_so():
    without = SimpleNamespace(runtime=SimpleNamespace(part=lambda kind: None))
    with pytest.raises(NotCapable, match="no map"):
        map_pose(without)
