"""The obstacle stop as a guard: an old scan is none, and the arc that the car drives is looked at, too."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, hypot, inf, nan, sin
from types import SimpleNamespace
from typing import Any
from weakref import ref

import numpy as np
import pytest

from txt1.config import Config
from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.errors import ConfigError
from txt1.guards.obstacle_stop.free_distance import free_distance, stopping_speed
from txt1.guards.obstacle_stop.guard import CURVATURE_SPEED_MIN, LaserGuard, prepare
from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.model.odometry import Odometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import Mount, Scan
from txt1.tasks.state import State

BEAMS = 361


def scan(*posts: tuple[float, float]) -> Scan:
    """A sweep of 360 degrees in which only posts are seen, each at x, y (m) from the laser."""
    ranges = np.full(BEAMS, np.inf, np.float32)
    for x, y in posts:
        ranges[round(np.degrees(np.arctan2(y, x))) + 180] = np.hypot(x, y)
    return Scan(-np.pi, np.pi / 180.0, 0.0, ranges, 0.05, 30.0)


def post(x: float, y: float = 0.0) -> Scan:
    """A sweep of a laser at the vehicle's origin, in which one post is seen, at exactly x, y (m)."""
    return Scan(atan2(y, x), 0.01, 0.0, np.array([hypot(x, y)], np.float32), 0.05, 30.0, mount=Mount())


def post_all_round(x: float, y: float = 0.0) -> Scan:
    """A sweep of 360 degrees of a laser at the vehicle's origin, in which one post is seen, at exactly x, y (m)."""
    ranges = np.full(360, np.inf, np.float32)
    ranges[0] = hypot(x, y)
    return Scan(atan2(y, x), np.pi / 180.0, 0.0, ranges, 0.05, 30.0, mount=Mount())


def lacking(seen: Scan, first: int, last: int) -> Scan:
    """A sweep of 360 degrees without the beams from one angle to another, degrees from the laser's straight ahead."""
    ranges = seen.ranges.copy()
    ranges[180 + first : 181 + last] = nan
    return replace(seen, ranges=ranges)


def looking_ahead() -> Scan:
    """A sweep of 240 degrees in which nothing is seen."""
    return Scan(-2.0 * np.pi / 3.0, np.pi / 180.0, 0.0, np.full(241, np.inf, np.float32), 0.05, 30.0)


class Desk:
    def __init__(self, seen: Scan, settings: ObstacleStop | None = None, **body: Any) -> None:
        self.state, self.gate = State(), Gate(Limits(), on_close=lambda reason: None)
        self.reading: Reading[Scan] | None = Reading(0.0, seen)
        self.settings, self.body = settings or ObstacleStop(), replace(Config().geometry, **body)
        self.guard = LaserGuard(lambda: self.reading, self.state, self.gate, self.body, self.settings)

    def limited(self) -> bool:
        """Whether a source that is held back by the guard holds the wheel all the same."""
        return self.gate.limited

    def limit(self, x: float, y: float = 0.0, curvature: float = 0.0) -> float:
        """The speed that one post allows, m/s: it stops at the margin before the post."""
        body, margin = self.body, self.settings.margin
        free = free_distance(np.array([[x, y]]), curvature, body.length, body.width, margin, body.centre)
        return stopping_speed(free, self.settings.reaction, self.settings.deceleration) if free < inf else inf

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


@pytest.mark.parametrize(
    "settings", [ObstacleStop(reaction=2.0, deceleration=0.5), ObstacleStop(reaction=0.05, deceleration=4.0)]
)
@pytest.mark.parametrize("v", [0.3, 1.0, 1.7])
def test_it_is_slowed_by_a_post_that_it_could_not_stop_before(settings: ObstacleStop, v: float) -> None:
    needed = v * settings.reaction + v * v / (2.0 * settings.deceleration)
    front = 0.5 * Config().geometry.length + settings.margin
    slow, _ = Desk(post(front + 0.98 * needed), settings).guard(v, 0.0, 0.1)
    assert slow < v
    assert slow == pytest.approx(Desk(post(1.0), settings).limit(front + 0.98 * needed), rel=1e-4)
    assert Desk(post(front + 1.02 * needed), settings).guard(v, 0.0, 0.1) == (v, 0.0)


def test_it_stays_on_the_commanded_arc_when_it_is_slowed() -> None:
    desk = Desk(post(1.1, 0.3))
    v, omega = desk.guard(1.2, 0.6, 0.1)
    assert 0.0 < v < 1.2
    assert v == pytest.approx(desk.limit(1.1, 0.3, 0.5), rel=1e-4)
    assert omega / v == pytest.approx(0.5)


def test_a_post_in_the_corner_of_the_way_is_seen_by_a_wide_car_with_a_body_far_ahead() -> None:
    # farther from the origin than the way to a stop: the car's own size counts
    desk = Desk(post(1.875, 0.825), ObstacleStop(reaction=0.0), width=1.5, length=1.2, centre=0.7)
    assert desk.limit(1.875, 0.825) < 1.0
    v, _ = desk.guard(1.0, 0.0, 0.1)
    assert v == pytest.approx(desk.limit(1.875, 0.825), rel=1e-4)


@pytest.mark.parametrize(
    ("then", "now"),
    [
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((1.0, 2.0, 0.7), (1.4, 2.6, 0.7)),
        ((1.0, 2.0, 0.7), (1.0, 2.0, 2.2)),
        ((-3.0, 1.0, -1.2), (-2.5, 0.2, -2.0)),
        ((0.5, -1.0, 2.0), (0.1, -0.8, 1.1)),
    ],
)
@pytest.mark.parametrize("curvature", [0.0, 0.6])
def test_what_was_seen_is_where_the_odometry_has_brought_the_car(
    then: tuple[float, float, float], now: tuple[float, float, float], curvature: float
) -> None:
    ahead, left = 0.9, 0.5 * curvature * 0.9**2
    x = now[0] + cos(now[2]) * ahead - sin(now[2]) * left
    y = now[1] + sin(now[2]) * ahead + cos(now[2]) * left
    dx, dy = x - then[0], y - then[1]
    seen = post(cos(then[2]) * dx + sin(then[2]) * dy, cos(then[2]) * dy - sin(then[2]) * dx)
    desk = Desk(seen)
    # earlier poses, which the scan is not of
    for time, pose in ((0.0, (9.0, 9.0, 1.0)), (0.1, then), (0.2, (-9.0, 9.0, -1.0))):
        desk.state.odometry = Odometry(*pose)
        desk.guard(0.0, 0.0, time)
    desk.reading = Reading(0.1, seen)
    desk.state.odometry = Odometry(*now)
    v, _ = desk.guard(1.0, curvature, 0.3)
    assert v == pytest.approx(desk.limit(ahead, left, curvature), rel=1e-3)
    assert v < 1.0


def test_a_scan_from_before_all_known_poses_counts_from_the_first_of_them() -> None:
    desk = Desk(post(1.5))
    desk.reading = Reading(-0.2, post(1.5))
    desk.state.odometry = Odometry(2.0, 0.0, 0.0)
    desk.guard(0.0, 0.0, 0.0)
    desk.state.odometry = Odometry(2.5, 0.0, 0.0)
    assert desk.guard(1.5, 0.0, 0.1)[0] == pytest.approx(desk.limit(1.0), rel=1e-4)


def test_a_measured_curvature_counts_up_to_the_tightest_and_above_a_crawl() -> None:
    tightest = 1.0 / Config().geometry.radius_min
    x, y = 0.1, 1.1
    desk = Desk(post(x, y))
    on_the_arc = desk.limit(x, y, tightest)
    assert on_the_arc < 2.0 < min(desk.limit(x, y), desk.limit(x, y, 2.0 * tightest))
    for v, omega, expected in (
        (0.1, 0.1 * tightest, on_the_arc),
        # sliding, the odometry says more than the steering can
        (0.1, 5.0, on_the_arc),
        (0.1, -5.0, 2.0),
        (CURVATURE_SPEED_MIN, 5.0 * CURVATURE_SPEED_MIN, 2.0),
        (0.01, 0.01 * tightest, 2.0),
        (0.1, nan, 2.0),
    ):
        desk.state.odometry = Odometry(v=v, omega=omega)
        assert desk.guard(2.0, 0.0, 0.1)[0] == pytest.approx(expected, rel=1e-3)


def test_backwards_it_is_slow_where_the_laser_does_not_look_and_says_why() -> None:
    desk = Desk(looking_ahead(), ObstacleStop(reverse=0.25))
    assert desk.guard(-0.25, 0.1, 0.1) == (-0.25, 0.1)
    assert not desk.limited()
    assert desk.events() == []
    v, omega = desk.guard(-0.5, 0.2, 0.2)
    assert (v, omega) == pytest.approx((-0.25, 0.1))
    assert desk.events() == ["slowed to 0.25 m/s: the laser does not see backwards"]
    desk.reading = None
    assert desk.guard(-0.5, 0.2, 0.3) == pytest.approx((-0.25, 0.1))
    assert desk.limited(), "no laser is needed to know that"
    assert desk.guard(0.5, 0.0, 0.4) == (0.0, 0.0)


@pytest.mark.parametrize("centre", [0.0, 0.15])
@pytest.mark.parametrize("curvature", [0.0, 0.6, -0.6])
@pytest.mark.parametrize(("x", "y"), [(0.9, 0.0), (0.9, 0.3), (0.7, -0.25), (1.4, 0.9), (3.0, 0.0), (0.35, 0.0)])
def test_backwards_a_laser_that_sees_all_round_counts_as_in_a_mirror(
    x: float, y: float, curvature: float, centre: float
) -> None:
    desk = Desk(post_all_round(x, y), centre=centre)
    mirrored = Desk(post_all_round(-x, y), centre=-centre)
    ahead = desk.guard(1.2, 1.2 * curvature, 0.1)
    assert mirrored.guard(-1.2, -1.2 * curvature, 0.1) == pytest.approx((-ahead[0], -ahead[1]), rel=1e-4)
    # on the arc that it drives, too
    for each, gear in ((desk, 1.0), (mirrored, -1.0)):
        each.state.odometry = Odometry(v=gear * 0.5, omega=gear * 0.5 * curvature)
    assert mirrored.guard(-1.2, 0.0, 0.2) == pytest.approx((-desk.guard(1.2, 0.0, 0.2)[0], 0.0), rel=1e-4)
    assert mirrored.limited() == desk.limited()


def test_backwards_it_stops_before_what_it_sees_there_and_says_so() -> None:
    desk = Desk(scan((-1.0, 0.0)))
    assert desk.guard(-1.7, 0.0, 0.1)[0] == pytest.approx(-desk.limit(0.8095), rel=1e-4)
    assert desk.events()[-1].endswith("something is behind")
    assert desk.guard(1.7, 0.0, 0.2) == (1.7, 0.0)


@pytest.mark.parametrize("lost", [(100, 160), (-180, -170), (-60, 60)])
def test_backwards_it_stops_before_what_it_sees_whatever_it_has_lost(lost: tuple[int, int]) -> None:
    seen = scan((-0.58, 0.0))
    allowed, _ = Desk(seen).guard(-1.0, 0.0, 0.1)
    desk = Desk(lacking(seen, *lost))
    assert -desk.settings.reverse < allowed <= 0.0
    assert desk.guard(-1.0, 0.0, 0.1) == (allowed, 0.0)
    assert desk.events()[-1].endswith("something is behind")


@pytest.mark.parametrize(("yaw", "slow"), [(0.0, [(170, 171), (91, 92), (-92, -91)]), (np.pi, [(-1, 0), (0, 50)])])
def test_backwards_it_is_slow_where_a_part_of_what_is_behind_is_unknown(
    yaw: float, slow: list[tuple[int, int]]
) -> None:
    turned = replace(scan(), mount=Mount(0.1905, yaw=yaw))
    for lost in [(170, 171), (91, 92), (-92, -91), (-1, 0), (0, 50), (170, 170), (0, 0), (90, 91), (-91, -90)]:
        desk = Desk(lacking(turned, *lost))
        v = -desk.settings.reverse if lost in slow else -1.0
        assert desk.guard(-1.0, 0.5, 0.1) == pytest.approx((v, -0.5 * v))
        assert desk.limited() == (v != -1.0)
        assert desk.events() == (["slowed to 0.30 m/s: the laser has not seen all behind"] if lost in slow else [])
        assert desk.guard(1.0, 0.5, 0.2) == (1.0, 0.5)


def test_a_silent_laser_that_turns_all_round_stops_it_backwards_too() -> None:
    desk, timeout = Desk(scan()), ObstacleStop().timeout
    assert desk.guard(-1.0, 0.2, timeout) == (-1.0, 0.2)
    assert desk.guard(-1.0, 0.2, timeout + 0.001) == (0.0, 0.0)
    assert desk.events() == ["slowed to 0.00 m/s: the laser is silent"]
    assert not desk.limited()


class Street(Desk):
    """Somebody is ahead of the car, x m from its origin at each scan's time, and people count."""

    def __init__(self, *seen: tuple[float, float | None], people: float = 1.6, **given: Any) -> None:
        super().__init__(scan(), ObstacleStop(people=people, **given))
        for time, x in seen:
            self.guard(0.0, 0.0, time)
            self.reading = Reading(time, post_all_round(9.0 if x is None else x))
            self.guard(0.8, 0.0, time)

    def comes(self, x: float, v: float, now: float = 1.0) -> float:
        """The speed at which the guard takes somebody at x to come, m/s, by what it makes of a set-point."""
        allowed = self.guard(v, 0.0, now)[0]
        p = self.settings
        free = x - 0.5 * self.body.length - p.margin
        # they meet when the car stands, as the scan is of 1 s: h (now - 1 + t + v / a) + v t + v^2 / 2 a = free
        stop = allowed * p.reaction + allowed**2 / (2.0 * p.deceleration)
        return (free - stop) / (now - 1.0 + p.reaction + allowed / p.deceleration)


@pytest.mark.parametrize(
    ("seen", "comes"),
    [
        (((0.9, 1.0), (1.0, 0.9)), 1.0),
        (((0.9, 0.95), (1.0, 0.9)), 0.5),
        (((0.9, 0.9), (1.0, 0.9)), 0.0),
        (((0.9, 0.8), (1.0, 0.9)), 0.0),
        (((0.9, 1.3), (1.0, 0.9)), 1.6),
        # out of a door
        (((0.9, None), (1.0, 0.9)), 1.6),
        # the newest that is far enough apart counts
        (((0.7, 2.5), (0.9, 1.0), (0.95, 0.93), (1.0, 0.9)), 1.0),
        (((0.925, 0.9), (1.0, 0.9)), 1.6),
        (((0.915, 1.0), (1.0, 0.9)), 0.1 / 0.085),
        # too old to tell, too near, or none: it may come
        (((0.51, 1.0), (1.0, 0.9)), 0.1 / 0.49),
        (((0.49, 1.0), (1.0, 0.9)), 1.6),
        (((1.0, 0.9),), 1.6),
    ],
)
def test_who_comes_towards_it_meets_it_when_it_stands(
    seen: tuple[tuple[float, float | None], ...], comes: float
) -> None:
    street = Street(*seen)
    assert street.comes(0.9, 2.0) == pytest.approx(comes, abs=0.002)
    # they went on since
    assert street.comes(0.9, 2.0, 1.1) == pytest.approx(comes, abs=0.002)


@pytest.mark.parametrize("reaction", [0.2, 2.0])
def test_who_comes_counts_from_as_far_as_it_takes_to_stop_before_them(reaction: float) -> None:
    p = ObstacleStop(people=1.6, reaction=reaction, deceleration=0.5)
    v, front = 0.8, 0.5 * Config().geometry.length + p.margin
    for age in (0.0, 0.3):
        needed = v * p.reaction + 1.6 * (p.reaction + age) + v * (0.5 * v + 1.6) / p.deceleration
        for share, slower in ((0.98, True), (1.02, False)):
            x = front + share * needed
            street = Street((0.9, x + 0.2), (1.0, x), people=1.6, reaction=reaction, deceleration=0.5)
            assert (street.guard(v, 0.0, 1.0 + age)[0] < v) == slower


@pytest.mark.parametrize(
    ("people", "kept"),
    [(0.0, [False, False, False, False, True]), (1.6, [False, True, True, True, True])],
)
def test_only_scans_that_may_be_compared_are_kept(people: float, kept: list[bool]) -> None:
    # the second is the newest that is far enough from the last
    street, seen = Street((0.7, 0.9), people=people), []
    for time in (0.89, 0.9, 0.93, 0.96, 0.99):
        street.reading = Reading(time, post_all_round(0.9))
        seen.append(ref(street.reading.value))
        street.guard(0.8, 0.0, time)
    assert [each() is not None for each in seen] == kept


def test_it_starts_in_a_narrow_room_as_soon_as_what_is_near_is_seen_to_stand() -> None:
    street = Street((0.9, 0.6), (1.0, 0.6))
    assert Street((1.0, 0.6)).guard(0.1, 0.0, 1.0)[0] < 0.02
    assert street.guard(0.1, 0.0, 1.0) == (0.1, 0.0)


def test_the_car_s_own_motion_is_nobody_s() -> None:
    street = Street((0.9, 1.0))
    street.state.odometry = Odometry(0.1, 0.0, 0.0)
    street.guard(0.0, 0.0, 1.0)
    street.reading = Reading(1.0, post_all_round(0.9))
    assert street.comes(0.9, 2.0) == pytest.approx(0.0, abs=0.002)


def test_unless_people_are_told_of_all_stands() -> None:
    assert ObstacleStop().people == 0.0
    assert Street((0.9, 1.0), (1.0, 0.9), people=0.0).comes(0.9, 2.0) == pytest.approx(0.0, abs=0.002)


def test_it_is_told_once_as_long_as_it_lasts_from_the_first_time_on() -> None:
    desk = Desk(post(0.6))
    for time in (0.1, 0.12, 0.14):
        desk.guard(1.0, 0.0, time)
    assert desk.gate.counts[Fault.OBSTACLE] == 1
    assert len(desk.events()) == 1
    desk.reading = Reading(0.2, scan())
    desk.guard(1.0, 0.0, 0.2)
    desk.reading = Reading(0.3, post(0.6))
    desk.guard(1.0, 0.0, 0.3)
    assert desk.gate.counts[Fault.OBSTACLE] == 2


def test_a_hold_goes_on_behind_an_obstacle_and_not_behind_a_silent_laser() -> None:
    desk = Desk(post(0.4))
    desk.guard(0.5, 0.0, 0.1)
    assert desk.limited()
    assert desk.events()[-1].endswith("something is ahead")
    desk.guard(0.0, 0.0, 0.12)
    assert not desk.limited(), "nothing is asked for"
    desk.guard(0.5, 0.0, 0.14)
    assert desk.limited()
    desk.guard(0.5, 0.0, 2.0)
    assert not desk.limited(), "the laser is silent"
    desk.reading = Reading(2.1, scan())
    desk.guard(0.5, 0.0, 2.1)
    assert not desk.limited(), "the way is free"


def of_type(kind: type) -> SimpleNamespace:
    """A sensor whose readings have this type."""
    return SimpleNamespace(sensor=SimpleNamespace(topic=SimpleNamespace(type=kind)))


@pytest.mark.parametrize(
    ("enabled", "sensors", "guards"),
    [("never", {"laser": Scan}, 0), ("auto", {"laser": Scan, "light": float}, 1), ("auto", {"light": float}, 0)],
)
async def test_it_is_on_where_it_is_asked_for(enabled: str, sensors: dict[str, type], guards: int) -> None:
    made: list[Any] = []
    polled = {name: of_type(each) for name, each in sensors.items()}
    desk = Desk(scan())
    runtime = SimpleNamespace(
        sensors=polled,
        state=desk.state,
        gate=desk.gate,
        config=Config(),
        guard=lambda name, guard: made.append((name, guard)),
    )
    await prepare(runtime, ObstacleStop(enabled=enabled))  # type: ignore[arg-type]
    assert len(made) == guards


def runtime_with(**sensors: Scan) -> SimpleNamespace:
    """A robot's runtime with laser scanners that have seen something at 0 s."""
    topic = SimpleNamespace(type=Scan)
    there = {
        name: SimpleNamespace(sensor=SimpleNamespace(topic=topic), last=Reading(0.0, seen))
        for name, seen in sensors.items()
    }
    gate = Gate(Limits(), on_close=lambda reason: None)
    return SimpleNamespace(sensors=there, state=State(), gate=gate, config=Config(), guard=lambda name, guard: None)


async def test_it_looks_through_the_scanner_that_is_named_and_through_a_single_one_unnamed() -> None:
    free, blocked = scan(), post(0.5)
    for sensors, named, stops in (
        ({"left": free, "right": blocked}, "left", False),
        ({"left": free, "right": blocked}, "right", True),
        ({"right": blocked}, "", True),
        ({"left": free}, "", False),
    ):
        guard = await prepare(runtime_with(**sensors), ObstacleStop(sensor=named))  # type: ignore[arg-type]
        assert guard is not None
        assert (guard(1.0, 0.0, 0.1)[0] < 1.0) == stops


@pytest.mark.parametrize(
    ("sensors", "named", "there"),
    [((), "laser", "none"), (("left", "right"), "laser", "left, right"), (("left", "right"), "", "left, right")],
)
async def test_a_scanner_that_is_not_there_or_not_named_is_a_mistake(
    sensors: tuple[str, ...], named: str, there: str
) -> None:
    runtime = runtime_with(**{name: scan() for name in sensors})
    given = ObstacleStop(sensor=named, enabled="always")
    with pytest.raises(ConfigError) as error:
        await prepare(runtime, given)  # type: ignore[arg-type]
    assert str(error.value) == f"obstacle_stop.sensor: {named!r} is no laser scanner; name one of: {there}"


# -- what it may have stopped for --------------------------------------------------------------------------------------


@pytest.mark.parametrize("centre", [0.2, -0.2])
@pytest.mark.parametrize(
    ("x", "y", "told"),
    [
        (0.399, 0.0, True),
        (0.401, 0.0, False),
        (0.001, 0.1, True),
        (-0.001, 0.1, False),
        (0.2, 0.249, True),
        (0.2, -0.249, True),
        (0.2, 0.251, False),
        (0.2, -0.251, False),
        (0.399, 0.249, True),
        (0.399, -0.249, True),
    ],
)
def test_it_tells_the_points_ahead_of_the_middle_up_to_two_margins_from_the_body(
    x: float, y: float, told: bool, centre: float
) -> None:
    """x and y are from the middle of a body of 0.6 by 0.3 m, with a margin of 5 cm."""
    desk = Desk(post(centre + x, y), ObstacleStop(margin=0.05), length=0.6, width=0.3, centre=centre)
    desk.guard(0.0, 0.0, 0.0)
    points = desk.guard.ahead(0.1, 1.0)
    assert points.shape == (int(told), 2)
    assert not told or points[0] == pytest.approx((centre + x, y), abs=1e-6)
    # backwards as in a mirror, where the laser turns all round
    desk.reading = Reading(0.0, post_all_round(centre - x, y))
    points = desk.guard.ahead(0.1, -1.0)
    assert points.shape == (int(told), 2)
    assert not told or points[0] == pytest.approx((centre - x, y), abs=1e-6)
    desk.reading = Reading(0.0, post(centre - x, y))
    assert desk.guard.ahead(0.1, -1.0).shape == (0, 2)


@pytest.mark.parametrize("lacks", ["a scan", "a young scan", "a pose", "anything near"])
def test_it_tells_no_points_where_there_are_none(lacks: str) -> None:
    desk = Desk(post(30.0 if lacks == "anything near" else 0.3))
    if lacks == "a scan":
        desk.reading = None
    if lacks != "a pose":
        desk.guard(0.0, 0.0, 0.0)
    at = 0.1 + (desk.settings.timeout if lacks == "a young scan" else 0.0)
    assert desk.guard.ahead(at, 1.0).shape == (0, 2)
