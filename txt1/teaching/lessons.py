"""Lessons from recordings: the times at which a human drove, the sensors' readings, and the human's commands.

The commander's topic has the driving source at every time. A source counts as human if its priority is that of a hand,
30 or more (`txt1.control.commander.PRIORITIES`), or if it is named. A lesson is a reading of the first sensor, with the
latest readings of the other sensors, and the command in force: its share of full lock, and its speed. Readings that are
left out are counted by reason.

A human reacts after some 0.2 s, so a lesson takes the command of that much later. Otherwise a policy would learn to be
as late as a human.

A human who takes over from a policy shows where the policy goes wrong. These times count more, most of all their first
seconds (HG-DAgger, arXiv 1810.02890: the human's commands during a take-over are the labels).
"""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.additions import priority_of
from txt1.bags.reader import is_bag
from txt1.config import Config, recorded
from txt1.control.commander import PRIORITIES
from txt1.errors import ConfigError, RecordingError
from txt1.file_limits import open_file
from txt1.model.light_sensors import Readings
from txt1.record.reader import Decoding, FilePass, check_own, robot_in, robots_in, trusting
from txt1.record.summary import ending_of
from txt1.sensors.readings import Image, Scan
from txt1.teaching import tubs
from txt1.teaching.features import Kind, Seen, Sight, Unfit, check, seen, sight_of
from txt1.teaching.human_drive import HumanDrive
from txt1.teaching.policy import Taught
from txt1.teaching.policy_driver import POLICY
from txt1.teaching.training import LessonSet
from txt1.telemetry import exact

HAND: Final = 30
"""Least priority of a human's source of commands."""
LESSON_RATE: Final = 20.0
"""Lessons a second at most."""
SPEED_MIN: Final = 0.05
"""m/s; slower motion is not driving."""
BEFORE_STOP: Final = 1.0
"""s before a stop or a disarming that are left out."""
LESSON_TIME_MAX: Final = 0.5
"""s: the longest time that a lesson counts for, if readings are missing."""
TAKEOVER: Final = 3.0
"""s after a take-over that count more."""
TAKEOVER_WEIGHT: Final = 4.0
"""Factor by which they count more."""
SECONDS_MIN: Final = 20.0
"""s; less driving than this is not enough for a policy."""
SECONDS_FEW: Final = 60.0
"""s; with less driving a policy hardly steers better at a new place than straight on."""
BETWEEN: Final = 60.0
"""s between two recordings, so that no block of time contains parts of both."""

TUB_VEHICLE: Final = "donkeycar"
"""The car of a tub of donkeycar."""
HUMAN_LAG: Final = 0.2
"""s by which a human's commands follow the sight, as in models of drivers."""

_MESSAGES: Final = {
    "sensor_msgs/LaserScan": "laser",
    "sensor_msgs/CompressedImage": "camera",
    "txt1_msgs/Light": "light",
}
_TYPES: Final[dict[str, Any]] = {"laser": Scan, "camera": Image, "light": Readings}


class Ask(NamedTuple):
    """A requested sensor: its kind, and its name, or "" for the only sensor of the kind."""

    kind: Kind
    sensor: str = ""


def is_hand(source: str, also: Collection[str] = ()) -> bool:
    """Return whether a source of commands is a human's, or is listed in `also`."""
    rank = PRIORITIES.get(source, priority_of(source))
    return source in also or (rank is not None and rank >= HAND)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, or of a tub of donkeycar; raises RecordingError."""
    if tubs.is_tub(path):
        return tubs.digest(path)
    try:
        with open_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"{path}: cannot read it: {error.strerror}; check the name") from None


def drive_in(
    path: Path,
    asks: Sequence[Ask],
    also: Collection[str] = (),
    robot: str | None = None,
    lag: float = HUMAN_LAG,
    vehicle: str = TUB_VEHICLE,
) -> HumanDrive:
    """Return the lessons of a recording, or of a tub of donkeycar of a `vehicle`; the human reacts after `lag` s.

    Raises RecordingError: it cannot be read, has several robots and none is named, has no such sensor, or no human
    drove in it.
    """
    if path.is_dir() and not is_bag(path):
        return tubs.drive_of_tub(path, [(ask.kind, ask.sensor) for ask in asks], vehicle, lag)
    check_own(path)
    names = robots_in(path)
    if robot is None and len(names) > 1:
        raise RecordingError(f"{path}: it has several robots; choose one with --robot: {', '.join(names)}")
    name = robot_in(path, robot)
    with trusting(path):
        reader = _Reader(path, name, asks, also, lag)
        for item in reader.file:
            reader.take(item)
        return reader.drive()


class _Row(NamedTuple):
    """A lesson."""

    time: float
    looks: tuple[Any, ...]
    v: float
    omega: float
    weight: float
    seconds: float
    by: str
    takeover: bool


class _Reader:
    """Reads a recording."""

    def __init__(self, path: Path, robot: str, asks: Sequence[Ask], also: Collection[str], lag: float) -> None:
        self.path, self.robot, self.also, self.asks, self.lag = path, robot, also, asks, lag
        self.file, self._decoding = FilePass(path, robot), Decoding()
        self._driver, self._armed = "", False
        self._command, self._velocities = (0.0, 0.0), (0.0, 0.0)
        self._lost = -1e9
        """Time at which a policy last had the wheel, s of the run."""
        self._taken = -1e9
        """Time since which a human has the wheel after taking it from a policy, s of the run."""
        self._overruled = False
        self._takeovers = 0
        self._kinds: dict[str, str] = {}
        self._names: dict[str, str] = {}
        self._latest: dict[str, tuple[float, Any]] = {}
        self._sights: list[Sight] = []
        self._before = -1e9
        self._rows: list[_Row] = []
        self._commands: list[tuple[float, float, float, str]] = [(-1e9, 0.0, 0.0, "")]
        """Time, command and source of each command."""
        self._left: defaultdict[str, float] = defaultdict(float)
        self._by: defaultdict[str, float] = defaultdict(float)

    def take(self, item: Any) -> None:
        """Take the next message."""
        now = self.file.run_time(item)
        if kind := _MESSAGES.get(item.schema.name.replace("/msg/", "/")):
            sensor = "light" if item.name == "/light" else item.name.rpartition("/")[2]
            self._kinds.setdefault(f"sensor {sensor}", kind)
            return
        match item.name:
            case "/driver":
                self._drives(self._decoding.message(item).name, now)
            case "/mode":
                armed = bool(self._decoding.message(item).armed)
                if self._armed and not armed:
                    self._stopped(now)
                self._armed = armed
            case "/cmd_vel":
                twist = self._decoding.message(item).twist
                self._command = twist.linear.x, twist.angular.z
                self._commands.append((now, *self._command, self._driver))
            case "/odom":
                twist = self._decoding.message(item).twist.twist
                self._velocities = twist.linear.x, twist.angular.z
            case "/reports":
                report = self._decoding.message(item)
                if report.kind == "reading":
                    self._reads(report.source, bytes(report.data), now)

    def _drives(self, name: str, now: float) -> None:
        before, self._driver = self._driver, name
        if name == before:
            return
        if before == POLICY:
            self._lost = now
        if is_hand(name, self.also):
            # a policy that stood, or released the wheel a moment ago, counts as taken over, too
            self._overruled = now - self._lost < LESSON_TIME_MAX
            self._takeovers += self._overruled
            self._taken = now

    def _stopped(self, now: float) -> None:
        while self._rows and self._rows[-1].time > now - BEFORE_STOP:
            self._leave("just before a stop", self._rows.pop().seconds)

    def _leave(self, reason: str, seconds: float) -> None:
        self._left[reason] += seconds

    def _reads(self, source: str, data: bytes, now: float) -> None:
        kind = self._kinds.get(source)
        if kind is None or not data:
            # the sensor's own topic follows; its first reading shows the kind
            self._kinds_of(source)
            kind = self._kinds.get(source)
        if kind is None:
            return
        sensor = source.removeprefix("sensor ")
        wanted = [ask for ask in self.asks if ask.kind == kind and ask.sensor in ("", sensor)]
        if not wanted or (sensor != self._first_name(kind, sensor)):
            return
        value = exact.decode(_TYPES[kind], data)
        self._latest[kind] = now, value
        if kind == self.asks[0].kind:
            self._moment(now)

    def _kinds_of(self, source: str) -> None:
        for channel in self.file.channels.values():
            schema = self.file.schemas.get(channel.schema_id)
            topic = channel.metadata.get("topic", channel.topic)
            kind = None if schema is None else _MESSAGES.get(schema.name.replace("/msg/", "/"))
            if kind is not None and source == f"sensor {'light' if topic == '/light' else topic.rpartition('/')[2]}":
                self._kinds[source] = kind

    def _first_name(self, kind: str, sensor: str) -> str:
        """Return the name of the requested sensor, or of the first of its kind."""
        return self._names.setdefault(kind, sensor)

    def _moment(self, now: float) -> None:
        """Take a reading of the first sensor: make it a lesson, or leave it out."""
        seconds = min(now - self._before, LESSON_TIME_MAX) if self._before > -1e8 else 0.0
        if now - self._before < 1.0 / LESSON_RATE - 1e-4:
            return
        self._before = now
        reason = self._reason(now)
        if reason:
            self._leave(reason, seconds)
            return
        self._latest["odometry"] = now, self._velocities
        values = tuple(self._latest[ask.kind][1] for ask in self.asks)
        if not self._sights:
            self._sights = [
                sight_of(ask.kind, self._names.get(ask.kind, ""), value)
                for ask, value in zip(self.asks, values, strict=True)
            ]
        try:
            for sight, value in zip(self._sights, values, strict=True):
                check(sight, value)
            looks = tuple(seen(sight, value) for sight, value in zip(self._sights, values, strict=True))
        except Unfit as error:
            raise RecordingError(f"{self.path}: {error}") from None
        v, omega = self._command
        weight = TAKEOVER_WEIGHT if self._overruled and now - self._taken < TAKEOVER else 1.0
        self._rows.append(_Row(now, looks, v, omega, weight, seconds, self._driver, self._overruled))

    def _reason(self, now: float) -> str:
        """Return why this reading is no lesson; "" if it is."""
        if not self._armed:
            return "disarmed"
        if not self._driver:
            return "nobody drove"
        if not is_hand(self._driver, self.also):
            return f"'{self._driver}' drove"
        if self._command[0] < -SPEED_MIN:
            return "reversed"
        if self._command[0] < SPEED_MIN:
            return "stood"
        for ask in self.asks:
            if ask.kind != "odometry" and now - self._latest.get(ask.kind, (-1e9, None))[0] > LESSON_TIME_MAX:
                return f"no {ask.kind}"
        return ""

    def drive(self) -> HumanDrive:
        """Return all lessons."""
        config = self._read_config()
        radius, v_max = config.geometry.radius_min, config.safety.v_max
        if missing := [ask for ask in self.asks if ask.kind != "odometry" and ask.kind not in self._latest]:
            there = ", ".join(sorted(set(self._kinds.values()))) or "none that can be learned from"
            word = f"{missing[0].kind}:{missing[0].sensor}" if missing[0].sensor else missing[0].kind
            raise RecordingError(f"{self.path}: no exact readings of --see {word} in it; its sensors: {there}")
        if not self._rows:
            why = ", ".join(f"{reason} {seconds:.0f} s" for reason, seconds in self._left.items())
            raise RecordingError(f"{self.path}: no human drove in it ({why or 'it is empty'}); record one who does")
        for row in self._rows:
            self._by[row.by] += row.seconds
        parts = zip(*(row.looks for row in self._rows), strict=True)
        commands = np.array([_shares(*self._later(row), radius, v_max) for row in self._rows], np.float32)
        lessons = LessonSet(
            Seen(tuple(np.stack(each) for each in parts)),
            commands,
            np.array([row.weight for row in self._rows], np.float32),
            np.array([row.time for row in self._rows]),
        )
        taught = Taught(
            str(self.path.resolve()),
            sha256_of(self.path),
            round(sum(self._by.values()), 3),
            {name: round(seconds, 3) for name, seconds in self._by.items()},
            round(sum(row.seconds for row in self._rows if row.takeover), 3),
            self._takeovers,
            {reason: round(seconds, 3) for reason, seconds in self._left.items() if seconds > 0.0},
        )
        sights, ends = tuple(self._sights), ending_of(self.file)
        return HumanDrive(taught, sights, lessons, config.vehicle, radius, v_max, ends)

    def _later(self, row: _Row) -> tuple[float, float]:
        """Return the same human's command a little later; the last command if the human released the wheel before."""
        first = bisect_right(self._commands, row.time, key=lambda one: one[0])
        v, omega = row.v, row.omega
        for time, later_v, later_omega, by in self._commands[first:]:
            if time > row.time + self.lag or by != row.by or later_v < SPEED_MIN:
                break
            v, omega = later_v, later_omega
        return v, omega

    def _read_config(self) -> Config:
        about = self.file.metadata.get("txt1", {})
        try:
            own = json.loads(about["robots"])[self.robot] if "robots" in about else None
            return recorded(json.loads(about["config"]), own)
        except (KeyError, ValueError, ConfigError) as error:
            raise RecordingError(
                f"{self.path}: no configuration in it that can be read ({error}); was it made by txt1?"
            ) from None


def _shares(v: float, omega: float, radius: float, v_max: float) -> tuple[float, float]:
    """Return a command as shares of full lock and of the largest speed."""
    return min(max(omega * radius / v, -1.0), 1.0), min(v / v_max, 1.0)


def together(drives: Sequence[HumanDrive]) -> tuple[tuple[Sight, ...], LessonSet, NDArray[np.int64]]:
    """Return the sights and lessons of all recordings, and the recording of each lesson.

    Raises RecordingError: they are of different cars or sensors, too short, or one is there twice.
    """
    first, files = drives[0], dict[str, str]()
    for each in drives:
        file = each.taught.file
        if each.taught.sha256 in files:
            raise RecordingError(f"{file}: it is the recording {files[each.taught.sha256]} once more; name it once")
        files[each.taught.sha256] = file
        if (each.vehicle, each.radius_min) != (first.vehicle, first.radius_min):
            raise RecordingError(
                f"{file}: it is of another car ({each.vehicle}, turning radius {each.radius_min:g} m) than "
                f"{first.taught.file} ({first.vehicle}, {first.radius_min:g} m); teach one policy for each"
            )
        if each.v_max != first.v_max:
            raise RecordingError(
                f"{file}: its safety.v_max is {each.v_max:g} m/s, and that of {first.taught.file} {first.v_max:g}"
            )
        for one, other in zip(first.sights, each.sights, strict=True):
            if replace(one, mean=(), deviation=()) != replace(other, mean=(), deviation=()):
                raise RecordingError(
                    f"{file}: '{other.name}' is not the sensor of {first.taught.file}, or sits elsewhere on the car"
                )
    seconds = sum(each.taught.seconds for each in drives)
    if seconds < SECONDS_MIN:
        raise RecordingError(
            f"{', '.join(each.taught.file for each in drives)}: a human drives for {seconds:.0f} s in it; at least "
            f"{SECONDS_MIN:.0f} s are needed, ten minutes are better"
        )
    offsets = np.cumsum([0.0, *(each.lessons.times[-1] - each.lessons.times[0] + BETWEEN for each in drives)])
    times = [each.lessons.times - each.lessons.times[0] + offset for each, offset in zip(drives, offsets, strict=False)]
    lessons = LessonSet(
        Seen(tuple(np.concatenate(parts) for parts in zip(*(each.lessons.seen.parts for each in drives), strict=True))),
        np.concatenate([each.lessons.commands for each in drives]),
        np.concatenate([each.lessons.weights for each in drives]),
        np.concatenate(times),
    )
    origin = np.repeat(np.arange(len(drives)), [len(each.lessons) for each in drives])
    return first.sights, lessons, origin
