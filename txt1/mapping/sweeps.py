"""Combines the scans of a drive with its odometry and its gyro: each scan without the distortion by the robot's motion.

Where there is a gyro, the robot's way is predicted by the wheels' distances and the gyro's turns, as wheels slip most
in turns. The gyro's bias is its mean rate while the wheels stand.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import atan2, cos, degrees, inf, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import ConfigError, RecordingError
from txt1.mapping.carmen_logs import RANGE_USED_MAX, points_of
from txt1.mapping.poses import composed, difference
from txt1.sensors.readings import ImuReading, Mount, Scan

Array = NDArray[np.float64]

ODOMETRY_KEPT: Final = 2.0
"""s of odometry that are kept for later scans."""
GYRO_SILENCE: Final = 0.2
"""s without a reading from which the gyro counts as silent, and the wheels' turns are used."""
CREEP: Final = 0.05
"""rad/s; a robot whose wheels stand and that turns faster is carried, and its gyro's bias is not learned."""
FASTEST: Final = 50.0
"""rad/s; a faster reading is none, as gyros end at 35."""
READINGS: Final = 1000
"""Newest readings of the gyro that are kept while no odometry comes."""
BIASES: Final = 500
"""Steps at rest over which the gyro's bias is averaged."""
STRAIGHT_TURN: Final = 0.05
"""rad: a step that turns less shows the laser's direction."""
LEAST_WAY: Final = 3.0
"""m of straight steps after which the laser's direction is estimated."""
FREE_WITHIN: Final = 2.5
"""m within which floor is free where a beam met nothing: farther away, an error of the heading matters."""
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
    predicted: Array
    """The laser's pose by wheels and gyro; without a gyro the same as `odometry`."""
    free: Array = np.empty((0, 2))
    """Places (n, 2) as `points`, at most `FREE_WITHIN` m away, to which beams met nothing."""
    reach: float = RANGE_USED_MAX
    """m up to which a beam that met nothing met no wall."""


class Gyro:
    """A gyro's turns between two times, without its bias."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=READINGS)
        self._angles: deque[float] = deque(maxlen=READINGS)
        self._rate, self._bias, self._rests = 0.0, 0.0, 0

    def turned(self, time: float, rate: float) -> None:
        """Take a yaw rate, rad/s."""
        if not abs(rate) < FASTEST or (self._times and time <= self._times[-1]):
            return
        if self._times and time - self._times[-1] > GYRO_SILENCE:
            self._times.clear()
            self._angles.clear()
        angle = self._angles[-1] + 0.5 * (self._rate + rate) * (time - self._times[-1]) if self._times else 0.0
        self._times.append(time)
        self._angles.append(angle)
        self._rate = rate

    def awaited(self, at: float, now: float) -> bool:
        """Return whether it has not read yet at a time, s, and is not silent either."""
        newest = self._times[-1] if self._times else -inf
        return newest < at and now - newest <= GYRO_SILENCE

    def turn(self, since: float, until: float, rests: bool) -> float | None:
        """Return its turn, rad, None where it has no readings; `rests`: the wheels stand."""
        if not self._times or since < self._times[0] or until > self._times[-1]:
            return None
        while self._times[1] <= since:
            self._times.popleft()
            self._angles.popleft()
        before, after = np.interp((since, until), self._times, self._angles).tolist()
        rate = (after - before) / (until - since)
        if rests and abs(rate - self._bias) < CREEP:
            self._rests = min(self._rests + 1, BIASES)
            self._bias += (rate - self._bias) / self._rests
            return 0.0
        return float(after - before - self._bias * (until - since))


class Sweeper:
    """Combines odometry, the gyro and scans as they come in."""

    def __init__(self) -> None:
        # time; x, y, theta by odometry, and by wheels and gyro
        self._samples: deque[tuple[float, ...]] = deque()
        # odometry for whose time the gyro has no reading yet
        self._newer: deque[tuple[float, float, float, float]] = deque()
        self._waiting: deque[tuple[float, Scan]] = deque()
        self._gyro: Gyro | None = None

    def turned(self, time: float, rate: float) -> None:
        """Take a gyro's yaw rate, rad/s."""
        if self._gyro is None:
            self._gyro = Gyro()
        self._gyro.turned(time, rate)

    def moved(self, time: float, x: float, y: float, theta: float) -> Iterator[Sweep]:
        """Take a pose of the odometry; yield the scans that are complete with it."""
        samples, newer = self._samples, self._newer
        last = newer[-1] if newer else samples[-1] if samples else None
        if last is not None:
            if time <= last[0]:
                return
            # without a jump at pi, so that poses in between can be interpolated
            theta = last[3] + float(np.angle(np.exp(1j * (theta - last[3]))))
        newer.append((time, x, y, theta))
        while newer and not (self._gyro is not None and self._gyro.awaited(newer[0][0], time)):
            self._take(*newer.popleft())
        while samples and self._waiting and _end(*self._waiting[0]) <= samples[-1][0]:
            yield self._complete(*self._waiting.popleft())
        while len(samples) > 2 and samples[1][0] < time - ODOMETRY_KEPT and not self._waiting:
            samples.popleft()

    def _take(self, time: float, x: float, y: float, theta: float) -> None:
        """Continue the prediction by a step of the wheels, with the gyro's turn."""
        if self._gyro is None or not self._samples:
            self._samples.append((time, x, y, theta, x, y, theta))
            return
        since, x0, y0, theta0, px, py, heading = self._samples[-1]
        way_x, way_y, by_wheels = x - x0, y - y0, theta - theta0
        turn = self._gyro.turn(since, time, not (way_x or way_y or by_wheels))
        if turn is None:
            turn = by_wheels
        # the step from the middle of one turn to the middle of the other
        off = heading + 0.5 * turn - (theta0 + 0.5 * by_wheels)
        c, s = cos(off), sin(off)
        px, py, heading = px + c * way_x - s * way_y, py + s * way_x + c * way_y, heading + turn
        self._samples.append((time, x, y, theta, px, py, heading))

    def seen(self, time: float, scan: Scan) -> None:
        """Take a scan; its first beam left at `time`, s."""
        self._waiting.append((time, scan))

    def _complete(self, time: float, scan: Scan) -> Sweep:
        samples = np.array(self._samples)
        mount = np.array([scan.mount.x, scan.mount.y, scan.mount.yaw])

        def laser(at: Any, column: int) -> Array:
            columns = range(column, column + 3)
            between = np.stack([np.interp(at, samples[:, 0], samples[:, k]) for k in columns], axis=-1)
            return composed(between, mount)

        beams = np.arange(len(scan.ranges), dtype=np.float64)
        middle = time + scan.time_step * len(beams) / 2.0
        predicted = laser(middle, 4)
        swept = difference(predicted, laser(time + scan.time_step * beams, 4))
        angles, ranges = scan.angle_min + scan.angle_step * beams, scan.ranges.astype(np.float64)
        points = points_of(ranges, angles, scan.range_max, swept)
        nothing = np.where(np.isposinf(ranges), min(FREE_WITHIN, 0.99 * scan.range_max), np.nan)
        free = points_of(nothing, angles, scan.range_max, swept)
        return Sweep(middle, points, laser(middle, 1), predicted, free, min(scan.range_max, RANGE_USED_MAX))


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
    from txt1.record.reader import Decoding, FilePass, trusting
    from txt1.tasks.encoder import ODOMETRY
    from txt1.tasks.inputs import REPORT
    from txt1.telemetry import exact

    decoding, sweeper, sweeps = Decoding(), Sweeper(), list[Sweep]()
    lasers: dict[str, Mount] = {}
    gyro = ""
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
                if report.kind == "reading" and b"acceleration" in bytes(report.data):
                    gyro = gyro or report.source
                    if report.source == gyro:
                        sweeper.turned(report.time, exact.decode(ImuReading, bytes(report.data)).rates[2])
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
    straight = (np.abs(theirs[:, 2]) < STRAIGHT_TURN) & (way > 0.05) & (np.abs(ours[:, 2]) < 2.0 * STRAIGHT_TURN)
    if way[straight].sum() < LEAST_WAY:
        return None
    ours, theirs = ours[straight], theirs[straight]
    crossed = np.sum(theirs[:, 1] * ours[:, 0] - theirs[:, 0] * ours[:, 1])
    return degrees(atan2(float(crossed), float(np.sum(ours[:, :2] * theirs[:, :2]))))
