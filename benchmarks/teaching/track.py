"""A track and who drives on it: centre lines, a simulated human, laps."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from math import atan2, cos, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from txt1.config import Config, load
from txt1.kernel.ticks import Ticks
from txt1.resources import resource
from txt1.robot import Robot
from txt1.runtime import Runtime

V_MAX: Final = 3.0  # m/s
A_MAX: Final = 4.0  # m/s2, to the side
BEAMS: Final = 1081  # over 270 degrees, as the policy of others wants them
LASER: Final = f"{{steps: 1440, beams: {BEAMS}, turn_time: 0.025, range_max: 10.0, noise: 0.01, noise_share: 0.0}}"


class Track(NamedTuple):
    """A map and its centre line, evenly spaced points (n, 2) in m, closed."""

    name: str
    map: str
    line: NDArray[np.float64]

    @property
    def length(self) -> float:
        """Of a lap, m."""
        return float(np.hypot(*np.diff(np.vstack((self.line, self.line[:1])), axis=0).T).sum())


def track_of(word: str) -> Track:
    """The track of one of our maps, or of a map's .yaml with NAME_centerline.csv beside it."""
    file = Path(word) if word.endswith(".yaml") else resource("config/maps") / f"{word}.yaml"
    rows = np.loadtxt(file.with_name(f"{file.stem}_centerline.csv"), delimiter=",", comments="#")
    points = rows[:, :2]
    if np.hypot(*(points[0] - points[-1])) < 1e-6:
        points = points[:-1]
    closed = np.vstack((points, points[:1]))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))))
    even = np.linspace(0.0, along[-1], max(int(along[-1] / 0.1), 20), endpoint=False)
    return Track(file.stem, str(file), np.column_stack([np.interp(even, along, closed[:, axis]) for axis in (0, 1)]))


def config_of(track: Track, seed: int, *more: str) -> Config:
    """The F1TENTH car at the start of a track."""
    (x, y), (x2, y2) = track.line[0], track.line[3]
    theta = atan2(y2 - y, x2 - x)
    settings = (
        "vehicle=f1tenth",
        f"safety.v_max={V_MAX}",
        f"sim.room.map={track.map}",
        f"sim.start=[{x:.4f}, {y:.4f}, {theta:.4f}]",
        "sensors.laser.driver=sim_laser",
        f"sensors.laser.options={LASER}",
        "sim.battery.used_1=null",
        f"seed={seed}",
        *more,
    )
    return load(None, settings, {}).config


class Place:
    """Where on a track a car is."""

    def __init__(self, track: Track) -> None:
        self.line = track.line
        self.spacing = track.length / len(track.line)
        self.index = 0

    def update(self, x: float, y: float) -> float:
        """Find the nearest point near the last one; return how far the car is from the line, m."""
        count = len(self.line)
        near = (self.index + np.arange(-20, 60)) % count
        gaps = np.hypot(*(self.line[near] - (x, y)).T)
        best = int(gaps.argmin())
        self.index = int(near[best])
        return float(gaps[best])

    def ahead(self, distance: float) -> NDArray[np.float64]:
        """The point this far ahead along the line."""
        found: NDArray[np.float64] = self.line[(self.index + round(distance / self.spacing)) % len(self.line)]
        return found

    def curvature(self, start: float, end: float) -> float:
        """The largest curvature between two distances ahead, 1/m."""
        steps = np.arange(round(start / self.spacing), round(end / self.spacing) + 1)
        points = self.line[(self.index + np.add.outer(np.array([-5, 0, 5]), steps)) % len(self.line)]
        one, two = points[1] - points[0], points[2] - points[1]
        turn = np.arctan2(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0], (one * two).sum(1))
        return float(np.abs(turn / np.maximum(np.hypot(*one.T), 1e-6)).max())


@dataclass
class Human:
    """Pure pursuit of the centre line with a human's delay, a wandering hand and a wandering aim.

    The hand is off by a share of full lock and the aim by metres to the side, each an Ornstein-Uhlenbeck process.
    """

    track: Track
    rng: Generator
    delay: float = 0.15  # s
    hand: float = 0.08  # share of full lock, deviation
    aim: float = 0.2  # m, deviation
    period: float = 0.05  # s
    v_max: float = V_MAX
    look: float = 1.0  # m ahead at standstill
    foresight: float = 0.4  # s within which a bend makes it slower
    _hand: float = 0.0
    _aim: float = 0.0
    _seen: deque[tuple[float, float, float, float]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.place = Place(self.track)

    def forget(self) -> None:
        """Look anew: the car was put elsewhere."""
        self._seen.clear()

    def command(self, pose: tuple[float, float, float], v: float, radius_min: float) -> tuple[float, float]:
        """What the human commands, m/s and rad/s."""
        for name, deviation, time in (("_hand", self.hand, 0.3), ("_aim", self.aim, 2.0)):
            share = self.period / time
            noise = deviation * np.sqrt(2.0 * share) * float(self.rng.standard_normal())
            setattr(self, name, getattr(self, name) * (1.0 - share) + noise)
        self._seen.append((*pose, v))
        while len(self._seen) > 1 + round(self.delay / self.period):
            self._seen.popleft()
        x, y, theta, v = self._seen[0]
        self.place.update(x, y)
        distance = self.look + 0.3 * max(v, 0.0)
        goal, beyond = self.place.ahead(distance), self.place.ahead(distance + 0.2)
        way = atan2(beyond[1] - goal[1], beyond[0] - goal[0])
        gx, gy = goal[0] - self._aim * sin(way) - x, goal[1] + self._aim * cos(way) - y
        left = -sin(theta) * gx + cos(theta) * gy
        curvature = 2.0 * left / max(gx * gx + gy * gy, 1e-6)
        bend = self.place.curvature(0.0, 0.3 + self.foresight * max(v, 1.0))
        speed = min(self.v_max, float(np.sqrt(A_MAX / max(bend, 1e-6))))
        curvature += self._hand / radius_min
        curvature = min(max(curvature, -1.0 / radius_min), 1.0 / radius_min)
        return speed, speed * curvature


@dataclass
class Laps:
    """What came of a drive."""

    times: list[float] = field(default_factory=list)  # of complete laps, s
    contacts: int = 0
    takeovers: int = 0
    misses: int = 0
    ended: str = ""


Steer = Callable[[Robot], Awaitable[None]]


def sideways(v: float, omega: float, now: float) -> tuple[float, float]:
    """The set-point on the same path at `A_MAX` to the side at most: a guard, the same for all who drive."""
    share = min(1.0, (A_MAX / max(abs(v * omega), 1e-9)) ** 0.5)
    return share * v, share * omega


async def driven(config: Config, track: Track, laps: int, limit: float, steer: Steer, additions: Any = None) -> Laps:
    """Drive until so many laps are complete, the car touches a wall, or it takes longer than `limit` s of the run."""
    found = Laps()

    def limited(runtime: Runtime) -> None:
        runtime.guard("sideways", sideways)

    async with Robot.open(config=config, additions=additions, attach=limited) as robot:
        await robot.load_gains()
        place, over = Place(track), asyncio.Event()
        count, passed, began, moved = len(track.line), 0, robot.now, robot.now
        await steer(robot)

        async def watch(ticks: Ticks) -> None:
            nonlocal passed, began, moved
            async for now in ticks:
                assert robot.pose is not None
                before = place.index
                place.update(*robot.pose[:2])
                passed += (place.index - before + count // 2) % count - count // 2
                if abs(robot.odometry.v) > 0.1:
                    moved = now
                if passed >= count:
                    passed -= count
                    found.times.append(now - began)
                    began = now
                if len(found.times) >= laps:
                    over.set()
                elif touches(robot):
                    found.contacts, found.ended = 1, "contact"
                    over.set()
                elif now - moved > 5.0:
                    found.ended = "stands"
                    over.set()

        robot.add_task("watch", 0.02, watch)
        robot.runtime.scheduler.end_at(robot.now + limit)
        waits = asyncio.ensure_future(over.wait())
        await asyncio.wait([waits, robot.runtime.scheduler.ended], return_when=asyncio.FIRST_COMPLETED)
        waits.cancel()
        found.ended = found.ended or ("complete" if len(found.times) >= laps else "time is over")
        found.misses = sum(task.misses for task in robot.runtime.statistics().values())
    return found


async def human_drives(robot: Robot, human: Human, name: str = "gamepad", rank: int = 40) -> None:
    """Let the simulated human drive, as a source of commands of this name."""
    source = robot.source(name, rank)

    async def hand(ticks: Ticks) -> None:
        async for _ in ticks:
            assert robot.pose is not None
            source.command(*human.command(robot.pose, robot.odometry.v, robot.config.geometry.radius_min))

    robot.add_task("human", human.period, hand)


def touches(robot: Robot, margin: float = 0.01) -> bool:
    """Whether the simulated car is as near to a wall."""
    vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
    return vehicle.world.in_the_way(vehicle, *vehicle.pose, margin) is not None
