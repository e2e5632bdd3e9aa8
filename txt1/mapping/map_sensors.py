"""The sensors ``mapping`` and ``map``: a map from a laser's scans and odometry, and the robot's place on it.

How it works
------------

The laser's readings and odometry go to a `Sweeper`, which combines them into scans. A process beside the robot
(`worker`) works on the scans: a filter finds the robot on a map, or a mapper makes a map. The result of a scan is
`MapNews`, a reading of the sensor ``mapping``. In virtual time it comes a fixed time after the scan; on the real clock
it comes when it is ready. The sensor ``map`` has the pose alone, like other sensors of poses. While the robot is lost,
it has no reading, so the robot does not drive by it.

News are readings of a sensor. So a recording holds each of them with its time, and a replay repeats them without
computing them. The rest follows from them in the same step (`OnMap`): the map, the transform, the topics.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from importlib import import_module
from math import cos, inf, nan, pi, sin, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.commands import say
from txt1.config.schema import SensorConfig
from txt1.errors import CommandRefused, ConfigError, HalError, MissingExtra
from txt1.kernel.loop import VirtualTimeLoop
from txt1.mapping.poses import Array, composed, difference, placed
from txt1.mapping.scan_work import Mapping, ScanTask, Work, locating, map_of
from txt1.mapping.seen_floor import LATELY, OFF_WALLS, SeenFloor
from txt1.mapping.settings import MappingConfig
from txt1.mapping.sweeps import Sweep, Sweeper
from txt1.mapping.topics import (
    MAP,
    MAP_TRANSFORM,
    ROOM_BELOW,
    MapNews,
    MapSheet,
    news_topic,
)
from txt1.mapping.worker import Far, Near
from txt1.maps.files import Map
from txt1.maps.grid import OCCUPIED_FROM, Grid
from txt1.model.odometry import Odometry
from txt1.runtime import Runtime
from txt1.sensors.base import Reading, Setup
from txt1.sensors.readings import ImuReading, Mount, Scan, TrackerReading, tracker_topic
from txt1.sim.room import Room
from txt1.sim.walls import Walls
from txt1.tasks.encoder import ROOM, origin
from txt1.tasks.on_map import MAP_POSE, PARTICLES, SCAN_ON_MAP, WALLS_ON_MAP, Line, MapInUse, MapPose, Pose

POSE: Final = "map"
NEWS: Final = "mapping"
"""Name of the sensor of results."""
SCAN_AGE_MAX: Final = 0.5
"""s for which a scan is used."""
SCAN_RANGE_MAX: Final = 1.5
"""m from the laser within which it is used: farther away, an error of the heading would put walls on free floor."""
UNKNOWN_NEAR: Final = 0.35
"""m from free floor at which a robot may stand on unknown cells."""
SHOWN_RAYS: Final = 90
"""Number of a scan's rays on screens."""
SOON: Final = 1.0
"""s after the run until the user is told that the map takes longer."""
JUMP: Final = 0.3
"""m; a larger correction of the pose means another place, so the floor seen from the old place is discarded."""


def may_stand(grid: Grid, x: float, y: float) -> bool:
    """Return whether a robot may stand at a place on a map, m.

    At the start of a drive the laser may not have seen the floor below the robot.
    """
    column, row = (int(np.floor(each)) for each in grid.to_cells(x, y))
    rows, columns = grid.depth.shape
    if not (0 < column < columns - 1 and 0 < row < rows - 1) or grid.cells[row - 1, column - 1] >= OCCUPIED_FROM:
        return False
    # as deep in unknown cells as the grid distinguishes
    return bool(grid.depth[row, column] > -UNKNOWN_NEAR)


def checked(settings: MappingConfig) -> None:
    """Check the settings; raises ConfigError: they contradict each other, or there is no such map."""
    if settings.room is not None and settings.make is not None:
        raise ConfigError("mapping.make, mapping.room (--map, --in): a map is made, or driven in; give one of them")
    if settings.at is not None:
        if settings.room is None:
            raise ConfigError("mapping.at (--at) is a place on a map: give the map, with --in MAP")
        if not may_stand(map_of(settings.room).grid, *settings.at[:2]):
            x, y, _ = settings.at
            raise ConfigError(
                f"mapping.at: ({x:g}, {y:g}) is no free floor on the map {settings.room}: see its picture"
            )
    elif settings.room is not None:
        map_of(settings.room)
    if settings.make is not None:
        output = Path(settings.make)
        if output.suffix in (".yaml", ".pgm", ".graph"):
            raise ConfigError(f"mapping.make: {output}: give the name without {output.suffix}")
        if not output.absolute().parent.is_dir():
            raise ConfigError(f"mapping.make: there is no folder {output.absolute().parent}; make it first")


class NewsSensor:
    """The work on scans as a sensor; `connect` gives it the laser and the odometry."""

    # it notes odometry in each cycle; results come as often as scans
    period, simulated = 0.02, True

    def __init__(self, setup: Setup) -> None:
        self.topic = news_topic(setup.name)
        self._settings = setup.config.section(MappingConfig)
        self._seed = setup.config.own_seed
        self._place = self._settings.at
        self._sweeper = Sweeper()
        self.newest: Sweep | None = None
        """The newest scan."""
        self._odometry: Any = None
        self._mount = Mount()
        self._worker: Near | Far | None = None
        self._wait = 0.0
        self._last = -1.0

    def connect(self, odometry: Any) -> Callable[[Reading[Scan]], None]:
        """Take a function that returns odometry and its time; return the function that takes the laser's readings."""
        self._odometry = odometry
        return self._seen

    def turned(self, reading: Reading[ImuReading]) -> None:
        """Take a reading of the gyro."""
        self._sweeper.turned(reading.time, reading.value.rates[2])

    def place(self, pose: Pose) -> None:
        """Start again at a pose on the map, with the next scan; theta nan: any heading."""
        self._place = pose

    def _seen(self, reading: Reading[Scan]) -> None:
        self._mount = reading.value.mount
        self._sweeper.seen(reading.time, reading.value)

    async def open(self) -> None:
        """Start the work: in virtual time in the event loop, else in a process of its own, which is waited for."""
        settings = self._settings
        checked(settings)
        if isinstance(asyncio.get_running_loop(), VirtualTimeLoop):
            self._worker, self._wait = Near(self._made), settings.delay
        elif settings.room is not None:
            self._worker = Far({"room": settings.room, "seed": self._seed})
        else:
            self._worker = Far({"make": settings.make, "resolution": settings.resolution})
        try:
            await self._worker.open()
            if settings.room is not None:
                # planning needs them; imported with the first goal, they stopped the loop for some cycles
                import_module("scipy.ndimage")
        except ImportError:
            raise MissingExtra("a map", "fast") from None

    def _made(self) -> Work:
        settings = self._settings
        if settings.room is not None:
            return locating(settings.room, self._seed)
        return Mapping(Path(settings.make or ""), settings.resolution)

    async def close(self) -> None:
        """Do nothing: writing a map takes time, so `finish` does it."""

    async def finish(self) -> list[str]:
        """End the work, and return lines for the event log."""
        worker, self._worker = self._worker, None
        return [] if worker is None else await worker.finish()

    def read(self, now: float) -> Reading[MapNews] | None:
        """Return the oldest result that is due, None if there is none."""
        worker = self._worker
        if worker is None:
            return None
        if worker.failure:
            raise HalError(worker.failure)
        odometry, time = self._odometry()
        mount = self._mount
        for sweep in self._sweeper.moved(time, odometry.x, odometry.y, odometry.theta):
            place, self._place = self._place, None
            self.newest = sweep
            worker.give(ScanTask(sweep, (mount.x, mount.y, mount.yaw), place))
        while worker.done and worker.done[0].time + self._wait <= now:
            news = worker.done.popleft()
            if self._last < news.time <= now:
                self._last = news.time
                return Reading(news.time, news)
        return None


class MapSensor:
    """The pose on the map as a sensor; it gets the results."""

    period, simulated = 0.02, True

    def __init__(self, setup: Setup) -> None:
        self.topic = tracker_topic(setup.name)
        settings = setup.config.section(MappingConfig)
        if settings.room is None and settings.make is None:
            raise ConfigError(f"sensors.{setup.name}: mapping.room names no map; give one, or --in MAP")
        self._news: deque[MapNews] = deque(maxlen=1)

    async def open(self) -> None:
        """Do nothing; the sensor holds no resources."""

    async def close(self) -> None:
        """Do nothing; the sensor holds no resources."""

    def heard(self, reading: Reading[MapNews]) -> None:
        """Take a result."""
        if not reading.value.lost:
            self._news.append(reading.value)

    def read(self, now: float) -> Reading[TrackerReading] | None:
        """Return the newest pose, None if there is no new pose or the robot is lost."""
        del now
        if not self._news:
            return None
        news = self._news.popleft()
        x, y, theta = news.pose
        # what the map is wrong by does not change from scan to scan: no filter can average it away
        sigma_x, sigma_y, sigma_theta = (sqrt((news.local or news.covariance)[k]) for k in (0, 4, 8))
        turn = (0.0, 0.0, sin(0.5 * theta), cos(0.5 * theta))
        reading = TrackerReading(
            x, y, 0.0, turn, subject=POSE, sigma_x=sigma_x, sigma_y=sigma_y, sigma_theta=min(sigma_theta, pi)
        )
        return Reading(news.time, reading)


class OnMap(MapInUse):
    """The robot on its map, found by `Runtime.part`."""

    def __init__(self, runtime: Runtime, making: bool, sensor: NewsSensor | None) -> None:
        self._runtime, self._sensor = runtime, sensor
        self.making = making
        self.news: MapNews | None = None
        """The newest result."""
        self.sheet: MapSheet | None = None
        """The map; None while it is unknown."""
        self._trouble = ""
        self._floor: tuple[MapSheet, Room] | None = None
        self._seen: SeenFloor | None = None
        self._newest: Sweep | None = None
        bus = runtime.bus
        bus.offer(MAP, lambda: self.sheet)
        bus.offer(MAP_POSE, self.pose)
        bus.offer(WALLS_ON_MAP, lambda: None if self.sheet is None else (*self.sheet.walls, *self.keep_out()))
        if ROOM in bus.offered:
            state = runtime.state
            bus.offer(ROOM, lambda: None)
            bus.offer(
                ROOM_BELOW,
                lambda: (
                    None
                    if state.pose is None
                    else origin((0.0, 0.0, 0.0), Odometry(*origin(state.pose, state.odometry)))
                ),
            )
        # a replay has no scans, but their results
        if sensor is not None:
            bus.offer(SCAN_ON_MAP, self._scan)
        bus.offer(PARTICLES, lambda: (self.news.particles or None) if self.news is not None else None)

    def heard(self, reading: Reading[MapNews]) -> None:
        """Take a result, and publish the values that follow from it."""
        runtime, before, news = self._runtime, self.news, reading.value
        bus, time = runtime.bus, reading.time
        self.news = news
        if news.sheet is not None:
            self.sheet = news.sheet
        self._look(before)
        if not news.lost:
            bus.publish(MAP_TRANSFORM, news.origin, time)
        if news.particles:
            bus.publish(PARTICLES, news.particles, time)
        if before is not None and before.lost is not news.lost:
            self._tell("the robot is lost on the map" if news.lost else "the robot knows where it is on the map")
        if before is not None and before.closed < news.closed:
            self._tell(f"the map closes a loop, the {news.closed}. so far")
        if news.trouble != self._trouble:
            self._trouble = news.trouble
            if news.trouble:
                self._tell(news.trouble)

    def _tell(self, text: str) -> None:
        runtime = self._runtime
        runtime.state.tell(runtime.now, text)

    def pose(self) -> MapPose | None:
        """Return the present pose, from the last scan and the odometry since then; None before the first scan."""
        news = self.news
        if news is None:
            return None
        x, y, theta = map(float, composed(news.origin, self._runtime.state.odometry[:3]))
        sigma = sqrt(news.covariance[0] + news.covariance[4])
        return MapPose(x, y, theta, sigma, sqrt(news.covariance[8]), news.fit, news.lost)

    def _look(self, before: MapNews | None) -> None:
        """Note the floor seen by the newest scan, and the floor below the robot."""
        news, sensor, room, pose = self.news, self._sensor, self._walls(), self.pose()
        if sensor is None or room is None or self.sheet is None or news is None or pose is None:
            return
        if news.lost or (before is not None and _apart(before, news) > JUMP):
            self._seen = None
        sweep = sensor.newest
        if news.lost or sweep is None or sweep is self._newest:
            return
        self._newest = sweep
        if self._seen is None:
            self._seen = SeenFloor(self.sheet.floor)
        self._seen.see(composed(news.origin, sweep.odometry), sweep.points, sweep.time)
        self._seen.stand(pose[:3], self._runtime.config.geometry, sweep.time)

    def floor(self, remembered: bool = True, lately: bool = False) -> Room | None:
        """Return the map in which the robot drives, with the floor it has seen; None: unknown, or being made."""
        room, seen = self._walls(), self._seen
        if room is None or seen is None:
            return room
        since = self._runtime.now - LATELY if lately else -inf
        return seen.floor(np.reshape(self.seen(), (-1, 2)), remembered, since)

    def seen(self) -> Sequence[tuple[float, float]]:
        """Return places near the robot that the newest scan shows and the map does not, m on the map."""
        return self.off(self._walls())

    def off(self, room: Room | None) -> Sequence[tuple[float, float]]:
        """Return the places near the robot that the newest scan shows away from the walls of a room, m on the map."""
        found = self.newest()
        if found is None or room is None or room.walls is None:
            return ()
        laser, sweep = found
        points = sweep.points[np.hypot(*sweep.points.T) < SCAN_RANGE_MAX]
        return [(x, y) for x, y in placed(laser, points).tolist() if room.walls.distance(x, y) > OFF_WALLS]

    def newest(self) -> tuple[Array, Sweep] | None:
        """Return the newest scan and the laser's pose on the map (x, y, theta; m, rad); None: lost, or too old."""
        news, sweep = self.news, None if self._sensor is None else self._sensor.newest
        if news is None or news.lost or sweep is None or self._runtime.now - sweep.time > SCAN_AGE_MAX:
            return None
        return composed(news.origin, sweep.odometry), sweep

    def _scan(self) -> tuple[tuple[float, float], ...]:
        """Return the ends of some rays of the newest scan, m on the map; empty while the robot is lost."""
        news, sweep = self.news, None if self._sensor is None else self._sensor.newest
        if news is None or news.lost or sweep is None:
            return ()
        points = sweep.points[:: 1 + len(sweep.points) // SHOWN_RAYS]
        return tuple((x, y) for x, y in np.round(placed(composed(news.origin, sweep.odometry), points), 2).tolist())

    def _walls(self) -> Room | None:
        sheet = self.sheet
        if sheet is None or self.making:
            return None
        if self._floor is None or self._floor[0] is not sheet:
            self._floor = sheet, Room(walls=Walls(Map("map", Path(), sheet.floor, "")))
        return self._floor[1]

    def keep_out(self) -> tuple[Line, ...]:
        """Return the areas of the map that the robot keeps out of."""
        return () if self.sheet is None else self.sheet.keep_out or ()

    def place(self, x: float, y: float, theta: float | None) -> None:
        """Set the robot's place on the map, m and rad (None: any heading); raises CommandRefused: there is no
        free floor.
        """
        if self.making or self._sensor is None:
            raise CommandRefused("the map is in the making, and begins where the robot began: no place can be given")
        if self.sheet is not None and not may_stand(self.sheet.grid, x, y):
            raise CommandRefused(f"({x:.2f} m, {y:.2f} m) is no free floor on the map: give a place that is")
        self._sensor.place((float(x), float(y), nan if theta is None else float(theta)))


def _apart(before: MapNews, after: MapNews) -> float:
    """Return the distance in m by which a correction moves a robot."""
    there = composed(before.origin, difference(after.origin, after.pose))
    return float(np.hypot(there[0] - after.pose[0], there[1] - after.pose[1]))


async def prepare(runtime: Runtime, settings: MappingConfig) -> OnMap | None:
    """Open the sensors, and connect them with the laser; return None without a map.

    Raises ConfigError: there is no laser.
    """
    if settings.room is None and settings.make is None:
        return None
    lasers = [name for name, each in runtime.sensors.items() if each.sensor.topic.type is Scan]
    if not lasers:
        raise ConfigError("mapping: no laser is configured; give one, such as --set sensors.laser.driver=sim_laser")
    laser = lasers[0] if settings.laser is None and len(lasers) == 1 else settings.laser
    if laser not in lasers:
        raise ConfigError(f"mapping.laser: {laser}; there are: {', '.join(lasers)}")
    await runtime.open_sensor(NEWS, SensorConfig(driver="map_news"))
    await runtime.open_sensor(POSE, SensorConfig(driver="map"))
    news, pose = (runtime.sensors[name].sensor for name in (NEWS, POSE))
    # in a replay the recorded readings of both are used
    real = news if isinstance(news, NewsSensor) else None
    there = OnMap(runtime, settings.make is not None, real)
    runtime.sensors[NEWS].listeners.append(there.heard)
    if real is not None:
        state = runtime.state
        runtime.sensors[laser].listeners.append(real.connect(lambda: (state.odometry, state.odometry_time)))
        gyros = [each for each in runtime.sensors.values() if each.sensor.topic.type is ImuReading]
        for each in gyros[:1]:
            each.listeners.append(real.turned)
    if isinstance(pose, MapSensor):
        runtime.sensors[NEWS].listeners.append(pose.heard)
    return there


@asynccontextmanager
async def watch(runtime: Runtime, settings: MappingConfig) -> AsyncIterator[None]:
    """End the work after the run; writing a map may take time."""
    try:
        yield
    finally:
        polled = runtime.sensors.get(NEWS)
        if polled is not None and isinstance(polled.sensor, NewsSensor):
            ending = asyncio.ensure_future(polled.sensor.finish())
            if not (await asyncio.wait([ending], timeout=SOON))[0] and settings.make is not None:
                # a second signal ends this process; the worker ignores it
                say("the map is being finished, which takes some seconds; Ctrl-C leaves that to the background")
            for line in await ending:
                say(line)


def create_news(setup: Setup) -> NewsSensor:
    """Make the sensor ``mapping``."""
    return NewsSensor(setup)


def create(setup: Setup) -> MapSensor:
    """Make the sensor ``map``."""
    return MapSensor(setup)
