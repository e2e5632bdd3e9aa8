"""Combines the scans and the odometry of a drive: each scan without the distortion by the robot's motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import atan2, degrees
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import ConfigError, RecordingError
from txt1.mapping.logs import points_of
from txt1.mapping.poses import composed, difference
from txt1.sensors.readings import Mount, Scan

Array = NDArray[np.float64]

KEPT: Final = 2.0
"""s of odometry that are kept for later scans."""
STRAIGHT: Final = 0.05
"""rad: a step that turns less shows the laser's direction."""
LEAST_WAY: Final = 3.0
"""m of straight steps after which the laser's direction is estimated."""
AWRY: Final = 4.0
"""Degrees from which the laser's direction is reported as wrong."""


class Sweep(NamedTuple):
    """A scan for a mapper."""

    time: float
    """s, the middle of the scan."""
    points: Array
    """(n, 2), m, in the laser's frame at this time."""
    odometry: Array
    """The laser's pose by odometry: x, y, theta (m, rad)."""


class Sweeper:
    """Combines odometry and scans as they come in."""

    def __init__(self) -> None:
        self._odometry: deque[tuple[float, float, float, float]] = deque()
        self._waiting: deque[tuple[float, Scan]] = deque()

    def moved(self, time: float, x: float, y: float, theta: float) -> Iterator[Sweep]:
        """Take a pose of the odometry; yield the scans that are complete with it."""
        before = self._odometry
        if before and time <= before[-1][0]:
            return
        if before:
            # without a jump at pi, so that poses in between can be interpolated
            theta = before[-1][3] + float(np.angle(np.exp(1j * (theta - before[-1][3]))))
        before.append((time, x, y, theta))
        while self._waiting and _end(*self._waiting[0]) <= time:
            yield self._complete(*self._waiting.popleft())
        while len(before) > 2 and before[1][0] < time - KEPT and not self._waiting:
            before.popleft()

    def seen(self, time: float, scan: Scan) -> None:
        """Take a scan; its first beam left at `time`, s."""
        self._waiting.append((time, scan))

    def _complete(self, time: float, scan: Scan) -> Sweep:
        samples = np.array(self._odometry)
        mount = np.array([scan.mount.x, scan.mount.y, scan.mount.yaw])

        def laser(at: Any) -> Array:
            between = np.stack([np.interp(at, samples[:, 0], samples[:, k]) for k in (1, 2, 3)], axis=-1)
            return composed(between, mount)

        beams = np.arange(len(scan.ranges), dtype=np.float64)
        middle = time + scan.time_step * len(beams) / 2.0
        pose = laser(middle)
        swept = difference(pose, laser(time + scan.time_step * beams))
        points = points_of(
            scan.ranges.astype(np.float64), scan.angle_min + scan.angle_step * beams, scan.range_max, swept
        )
        return Sweep(middle, points, pose)


def _end(time: float, scan: Scan) -> float:
    return time + scan.time_step * len(scan.ranges)


class LaserDrive(NamedTuple):
    """The scans of a recorded drive."""

    sensor: str
    """The laser's name."""
    mount: Mount
    sweeps: list[Sweep]


def read(path: Path, robot: str, sensor: str | None = None) -> LaserDrive:
    """Return the scans of a recorded robot's drive, and the laser's mount.

    Raises RecordingError: it has no exact scans, or cannot be read; ConfigError: there is no such laser.
    """
    from txt1.record.reading import Decoding, FilePass, trusting
    from txt1.tasks.encoder import ODOMETRY
    from txt1.tasks.inputs import REPORT
    from txt1.telemetry import exact

    decoding, sweeper, sweeps = Decoding(), Sweeper(), list[Sweep]()
    lasers: dict[str, Mount] = {}
    reading = FilePass(path, robot)
    with trusting(path):
        for item in reading:
            if item.name == ODOMETRY.name:
                message = decoding.message(item)
                place, turn = message.pose.pose.position, message.pose.pose.orientation
                theta = 2.0 * atan2(turn.z, turn.w)
                sweeps += sweeper.moved(reading.run_time(item), place.x, place.y, theta)
            elif item.name == REPORT.name:
                report = decoding.message(item)
                if report.kind != "reading" or b"angle_min" not in bytes(report.data):
                    continue
                scan = exact.decode(Scan, bytes(report.data))
                # the task that reads the laser is "sensor NAME"
                name = report.source.removeprefix("sensor ")
                lasers.setdefault(name, scan.mount)
                if sensor is None:
                    sensor = name
                if name == sensor:
                    sweeper.seen(report.time, scan)
    if sensor is not None and sensor not in lasers:
        raise ConfigError(
            f"{path}: no scans of a laser '{sensor}' in it; there are scans of: {', '.join(lasers) or 'none'}"
        )
    if sensor is None or not sweeps:
        raise RecordingError(
            f"{path}: no scans of a laser in it; drive with one, for example --set sensors.laser.driver=sim_laser"
        )
    return LaserDrive(sensor, lasers[sensor], sweeps)


def awry(poses: Array, odometry: Array) -> float | None:
    """Return by how many degrees the laser looks farther to the left than its mount states; None: not enough data.

    While the robot drives straight, a matched step and the odometry's step have the same direction in the laser's
    frame. A wrong mount makes the directions differ.
    """
    # several scans make a step, so that the noise of the match is small beside it
    apart = np.arange(0, len(poses), 5)
    ours, theirs = (
        difference(poses[apart[:-1]], poses[apart[1:]]),
        difference(odometry[apart[:-1]], odometry[apart[1:]]),
    )
    way = np.hypot(theirs[:, 0], theirs[:, 1])
    straight = (np.abs(theirs[:, 2]) < STRAIGHT) & (way > 0.05) & (np.abs(ours[:, 2]) < 2.0 * STRAIGHT)
    if way[straight].sum() < LEAST_WAY:
        return None
    ours, theirs = ours[straight], theirs[straight]
    crossed = np.sum(theirs[:, 1] * ours[:, 0] - theirs[:, 0] * ours[:, 1])
    return degrees(atan2(float(crossed), float(np.sum(ours[:, :2] * theirs[:, :2]))))
