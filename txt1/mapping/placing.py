"""The sensor ``map``: where the robot is on a map, from a laser's scans and odometry.

How it works
------------

The laser's readings and odometry go to a `Sweeper`, whose scans go to a `Locator`. In virtual time the filter works at
once, and its pose is told a fixed time after the scan. On the real clock it works in a thread, which takes the newest
scan when it is ready; numba lets go of the interpreter while it computes. The filter's poses are readings of a sensor,
so a recording holds each of them and when it took effect, and a replay gives them again without computing them.

While the filter is lost, the sensor tells nothing, so nobody drives by it.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from math import cos, pi, sin, sqrt
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.config import Config
from txt1.config.schema import SensorConfig
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.kernel.loop import VirtualTimeLoop
from txt1.mapping.drive import Sweep, Sweeper
from txt1.mapping.locate import Located, Locator
from txt1.mapping.poses import composed, difference
from txt1.mapping.settings import MappingConfig
from txt1.maps import files
from txt1.maps.grid import Grid
from txt1.runtime import Runtime
from txt1.sensors.base import Reading, Setup
from txt1.sensors.readings import Mount, Scan, TrackerReading, tracker_topic

NAME: Final = "map"
ENDING: Final = 3.0
"""s that the thread has to end."""


class PlaceOnMap(NamedTuple):
    """A checked map, and where the robot begins on it."""

    grid: Grid
    at: tuple[float, float, float] | None
    seed: int

    def warm(self) -> None:
        """Compile, so that no cycle waits for it."""
        from txt1.maps.rays import prepare as prepare_rays

        prepare_rays()
        locator = Locator(self.grid, 0, count=10)
        points = np.column_stack((np.linspace(-1.0, 1.0, 60), np.full(60, 1.0)))
        locator.update(0.0, points, (0.0, 0.0, 0.0))
        locator.place((0.0, 0.0, 0.0))
        locator.update(0.1, points, (0.0, 0.0, 0.0))


def checked(settings: MappingConfig, config: Config) -> PlaceOnMap:
    """Return the map of the settings; raises ConfigError: there is none, or the start is no place on it."""
    assert settings.room is not None
    name = settings.room
    room = name if name.endswith((".yaml", ".yml")) else f"{name}.yaml"
    grid = files.read(room).grid
    if settings.at is not None and not grid.is_free(*settings.at[:2]):
        x, y, _ = settings.at
        raise ConfigError(f"mapping.at: ({x:g}, {y:g}) is no free floor on the map {room}; look at its picture")
    return PlaceOnMap(grid, settings.at, config.own_seed)


class MapSensor:
    """The filter as a sensor; `connect` gives it its laser and odometry."""

    # at each cycle it notes odometry; poses come as often as scans
    period, simulated = 0.02, True

    def __init__(self, setup: Setup) -> None:
        self.topic = tracker_topic(setup.name)
        self._settings = setup.config.section(MappingConfig)
        if self._settings.room is None:
            raise ConfigError(f"sensors.{setup.name}: mapping.room names no map; give one, or --in MAP")
        try:
            self._locator = Locator(*_begun(checked(self._settings, setup.config)))
        except ImportError:
            raise MissingExtra("locating on a map", "mapping") from None
        self._place = self._settings.at
        self._sweeper = Sweeper()
        self._odometry: Any = None
        self._mount = Mount()
        self._done: deque[tuple[Located, Mount]] = deque(maxlen=8)
        self._last = -1.0
        self._todo: Sweep | None = None
        self._wake = threading.Condition()
        self._over = False
        self._failure = ""
        self._thread: threading.Thread | None = None

    def connect(self, odometry: Any) -> Any:
        """Take what returns odometry and its time; return what is to be told of the laser's readings."""
        self._odometry = odometry
        return self._seen

    def _seen(self, reading: Reading[Scan]) -> None:
        mount = reading.value.mount
        if self._place is not None:
            self._locator.place(composed(self._place, (mount.x, mount.y, mount.yaw)))
            self._place = None
        self._mount = mount
        self._sweeper.seen(reading.time, reading.value)

    async def open(self) -> None:
        """Begin the thread, on the real clock."""
        self._over = False
        if not isinstance(asyncio.get_running_loop(), VirtualTimeLoop):
            self._thread = threading.Thread(target=self._work, daemon=True, name="map")
            self._thread.start()

    async def close(self) -> None:
        """End the thread."""
        thread, self._thread = self._thread, None
        if thread is not None:
            with self._wake:
                self._over = True
                self._wake.notify()
            await asyncio.to_thread(thread.join, ENDING)

    def read(self, now: float) -> Reading[TrackerReading] | None:
        """Return the newest pose, None where there is no new one or the filter is lost."""
        if self._failure:
            raise HalError(self._failure)
        odometry, time = self._odometry()
        for sweep in self._sweeper.moved(time, odometry.x, odometry.y, odometry.theta):
            if self._thread is None:
                self._done.append((self._located(sweep), self._mount))
            else:
                with self._wake:
                    self._todo = sweep
                    self._wake.notify()
        told = None
        wait = self._settings.delay if self._thread is None else 0.0
        while self._done and self._done[0][0].time + wait <= now:
            located, mount = self._done.popleft()
            if not located.lost and self._last < located.time <= now:
                told = Reading(located.time, _reading(located, mount))
        if told is not None:
            self._last = told.time
        return told

    def _located(self, sweep: Sweep) -> Located:
        return self._locator.update(sweep.time, sweep.points, sweep.odometry)

    def _work(self) -> None:
        """In the thread: take the newest scan, and put its pose down."""
        while True:
            with self._wake:
                while self._todo is None and not self._over:
                    self._wake.wait()
                if self._over:
                    return
                sweep, self._todo = self._todo, None
            assert sweep is not None
            try:
                self._done.append((self._located(sweep), self._mount))
            except Exception as error:  # told by the sensor, which is then not healthy
                self._failure = f"the filter on the map failed: {type(error).__name__}: {error}"
                return


def _begun(place: PlaceOnMap) -> tuple[Grid, int]:
    return place.grid, place.seed


def _reading(located: Located, mount: Mount) -> TrackerReading:
    """Return the robot's pose of the laser's."""
    back = difference((mount.x, mount.y, mount.yaw), (0.0, 0.0, 0.0))
    x, y, theta = map(float, composed(located.pose, back))
    sigma_x, sigma_y, sigma_theta = (sqrt(float(located.covariance[k, k])) for k in range(3))
    turn = (0.0, 0.0, sin(0.5 * theta), cos(0.5 * theta))
    return TrackerReading(
        x, y, 0.0, turn, subject=NAME, sigma_x=sigma_x, sigma_y=sigma_y, sigma_theta=min(sigma_theta, pi)
    )


create = MapSensor


async def prepare(runtime: Runtime, settings: MappingConfig) -> MapSensor | None:
    """Open the sensor ``map``, and give it the laser; None where there is no map, or a replay gives the readings.

    Raises ConfigError: there is no laser.
    """
    if settings.room is None:
        return None
    lasers = [name for name, each in runtime.sensors.items() if each.sensor.topic.type is Scan]
    if not lasers:
        raise ConfigError("mapping: no laser is configured; give one, such as --set sensors.laser.driver=sim_laser")
    laser = lasers[0] if settings.laser is None and len(lasers) == 1 else settings.laser
    if laser not in lasers:
        raise ConfigError(f"mapping.laser: {laser}; there are: {', '.join(lasers)}")
    await runtime.open_sensor(NAME, SensorConfig(driver="map"))
    sensor = runtime.sensors[NAME].sensor
    if not isinstance(sensor, MapSensor):
        return None
    state = runtime.state
    runtime.sensors[laser].listeners.append(sensor.connect(lambda: (state.odometry, state.odometry_time)))
    return sensor
