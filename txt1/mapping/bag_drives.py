"""Drives in bags of ROS: a laser's scans, the odometry, and the laser's place on the robot.

How it works. The scans' topic is the one with most LaserScans. The odometry is the topic with most Odometry messages;
without one, the transforms from a frame of odometry to the robot's frame; without them, none. The laser's place comes
from the static transforms. Times are those of the headers, if the headers of both topics keep the same clock.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.bags.frames import BODIES, MOVING, STATIC, TRANSFORMS, FrameTree, bare, heading
from txt1.bags.reader import Bag, BagError, Timed
from txt1.mapping.sweeps import Sweep, Sweeper
from txt1.sensors.readings import Mount, Scan

SCANS: Final = "sensor_msgs/LaserScan"
ODOMETRY: Final = "nav_msgs/Odometry"
AGREE: Final = 1.0
"""s by which two topics' headers may differ in their distance from the time of recording."""
SWEEP_MAX: Final = 1.0
"""s; a scan whose beams take longer is one whose driver fills the field with something else."""


class BagDrive(NamedTuple):
    """The scans of a bag."""

    sweeps: list[Sweep]
    laser: str
    """The topics and the laser's place, in a line."""
    alone: bool
    """Whether there is no odometry."""


class _Found(NamedTuple):
    """What a first pass has found."""

    frames: FrameTree
    body: str | None
    """The robot's frame, by the odometry's messages."""
    laser: str
    """The laser's frame."""
    moving: tuple[str, str] | None
    """Frame of the odometry and the robot's frame, if transforms tell the odometry."""
    headers: bool
    """Whether the headers' times are used."""


def read(path: Path, scan: str | None = None, odometry: str | None = None) -> BagDrive:
    """Return the scans of a bag, corrected by its odometry; `scan` and `odometry` name topics.

    Raises BagError: the bag cannot be read, or has no such topics; MissingExtra.
    """
    with Bag(path) as bag:
        scans = bag.chosen(scan, "--scan", SCANS)
        if scans is None:
            there = ", ".join(f"{each.name} ({each.kind})" for each in bag.topics) or "none"
            raise BagError(f"{path}: no topic of {SCANS} in it; there are: {there}")
        others = [each.name for each in bag.topics if each.kind == SCANS and each.messages and each.name != scans]
        wheels = bag.chosen(odometry, "--odometry", ODOMETRY)
        transforms = [each for each in (STATIC, MOVING) if each in bag.of_kind(*TRANSFORMS)]
        found = _first_pass(bag, scans, wheels, transforms)
        place = found.frames.place(found.laser, found.body) or found.frames.place(found.laser)
        mount = Mount() if place is None else Mount(place.x, place.y, 0.0, place.yaw)
        flipped = place is not None and place.upside_down
        if wheels is None and found.moving is None:
            sweeps, by = _alone(bag.messages([scans]), mount, flipped), "no odometry: the scans alone"
        else:
            by = wheels or f"{MOVING} ({' -> '.join(found.moving or ())})"
            sweeps = _with_odometry(bag.messages([scans, wheels or MOVING]), scans, found, mount, flipped)
    if not sweeps:
        raise BagError(f"{path}: no scan of {scans} lies within the time of its odometry, {by}")
    where = f"at {mount.x:g}, {mount.y:g} m, {mount.yaw:.3g} rad{', upside down' if flipped else ''}"
    if place is None:
        where = (
            f"taken to be at the robot's origin, as no transform leads from its frame '{found.laser}' to the robot's"
        )
    choice = f" (--scan: also {', '.join(others)})" if others else ""
    return BagDrive(
        sweeps, f"scans: {scans}{choice}; odometry: {by}; the laser is {where}", wheels is None and not found.moving
    )


def _first_pass(bag: Bag, scans: str, wheels: str | None, transforms: Sequence[str]) -> _Found:
    frames, body, laser = FrameTree(), None, None
    offsets: dict[str, float] = {}
    moving = None
    for message in bag.messages([scans, *transforms, *([wheels] if wheels else [])]):
        offsets.setdefault(message.topic, message.time - message.recorded)
        if message.topic == scans:
            laser = laser or bare(message.value.header.frame_id)
        elif message.topic == wheels:
            body = body or bare(message.value.child_frame_id) or None
        else:
            frames.take(message.value)
            if message.topic == MOVING and moving is None:
                moving = _moving(message.value)
    there = [offsets[each] for each in (scans, wheels or "") if each in offsets]
    return _Found(frames, body, laser or "", None if wheels else moving, max(there) - min(there) < AGREE)


def _moving(message: Any) -> tuple[str, str] | None:
    """Return the frames of the transform that tells the odometry: to one of `BODIES` from a frame named so."""
    for each in message.transforms:
        frame, body = bare(each.header.frame_id), bare(each.child_frame_id)
        if body in BODIES and "odom" in frame:
            return frame, body
    return None


def _with_odometry(messages: Iterator[Timed], scans: str, found: _Found, mount: Mount, flipped: bool) -> list[Sweep]:
    sweeper, sweeps, begun = Sweeper(), list[Sweep](), None
    for message in messages:
        time = message.time if found.headers else message.recorded
        begun = time if begun is None else begun
        if message.topic == scans:
            sweeper.seen(time - begun, _scan(message.value, mount, flipped))
            continue
        pose = message.value.pose.pose if found.moving is None else None
        if pose is not None:
            sweeps += sweeper.moved(time - begun, pose.position.x, pose.position.y, heading(pose.orientation))
            continue
        for each in message.value.transforms:
            if (bare(each.header.frame_id), bare(each.child_frame_id)) == found.moving:
                stamp = each.header.stamp
                time = float(stamp.sec) + 1e-9 * float(stamp.nanosec) if found.headers else message.recorded
                way, turn = each.transform.translation, each.transform.rotation
                sweeps += sweeper.moved(time - begun, way.x, way.y, heading(turn))
    return sweeps


def _alone(messages: Iterator[Timed], mount: Mount, flipped: bool) -> list[Sweep]:
    """Return the scans as if the robot stood while a scan was taken."""
    sweeps, begun = list[Sweep](), None
    rest = np.array([mount.x, mount.y, mount.yaw])
    for message in messages:
        begun = message.time if begun is None else begun
        sweeper = Sweeper()
        sweeper.seen(0.0, _scan(message.value, mount, flipped))
        sweeps += (
            each._replace(time=message.time - begun, odometry=rest, predicted=rest)
            for time in (0.0, 2.0 * SWEEP_MAX)
            for each in sweeper.moved(time, 0.0, 0.0, 0.0)
        )
    return sweeps


def _scan(message: Any, mount: Mount, flipped: bool) -> Scan:
    """Return a LaserScan as the package's reading."""
    ranges = np.array(message.ranges, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        ranges[ranges < message.range_min] = np.nan
    side = -1.0 if flipped else 1.0
    step = float(message.time_increment)
    if not (isfinite(step) and 0.0 <= step * len(ranges) <= SWEEP_MAX):
        step = 0.0
    return Scan(
        side * float(message.angle_min),
        side * float(message.angle_increment),
        step,
        ranges,
        float(message.range_min),
        float(message.range_max),
        mount=mount,
    )
