"""Driving a car-like vehicle to a pose, forward and backward."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import cos, degrees, hypot, inf, radians, sin, sqrt
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from txt1.control.limits import clip
from txt1.control.schedule import Schedule
from txt1.driver import REFRESH, CommandSource
from txt1.errors import CommandRefused
from txt1.guards.keep_out.guard import AreaGuard
from txt1.guards.obstacle_stop.guard import LaserGuard
from txt1.kernel.loop import VirtualTimeLoop
from txt1.mapping.poses import Array, placed
from txt1.mapping.seen_floor import with_walls_at
from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.model.reeds_shepp import Path, Pose, length
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.navigation.pace import pace
from txt1.navigation.plan import STRETCH_MIN, NoPath, plan, plan_with_run_up, seen_part, stretches
from txt1.navigation.pose_source import PoseSource, encoders_view, wheel_pose
from txt1.navigation.search import heading_at
from txt1.robot import Robot
from txt1.sim.room import Room
from txt1.tasks.on_map import MapInUse

T = TypeVar("T")

# m: close enough to the goal; the requirement is 5 cm, and the pose source has an error
POSITION: Final = 0.035
# rad: the same for the heading; the requirement is 5 degrees
HEADING: Final = radians(3.5)
# m from the path at the end of a stretch beyond which a new path is planned
OFF_POSITION: Final = 0.06
# rad: the same for the heading
OFF_HEADING: Final = radians(10.0)
# m from the goal within which a path is a correction
CORRECTION: Final = 0.2
# number of paths after which the robot accepts its pose
ATTEMPTS: Final = 8
# number of times that the robot looks for a way round an obstacle before it gives up and stays
DETOURS: Final = 3
# number of paths after which 5 cm and 5 degrees suffice on a map, whose poses have an error of some centimetres
CONTENT: Final = 3
# m/s^2 by which the set-point falls before the end of a stretch
BRAKING: Final = 0.4
# m/s, the slowest set-point: slower motion is uneven, by the motors' dead band and the encoders
CRAWL: Final = 0.1
# s by which the vehicle's speed lags behind the set-point, so it comes to rest later
SPEED_LAG: Final = 0.15
# s from a command to the wheels: a period each of driver, controller and encoder task
DEAD_TIME: Final = 0.05
# m: the yaw-rate loop has to follow within this distance for curves to be driven at full speed
FOLLOWS_WITHIN: Final = 0.12
# m ahead that must be straight for a speed at which the loop follows less closely
STRAIGHT_AHEAD: Final = 0.3
# m/s from the border of a gain set, two quanta of the encoders
CLEARANCE: Final = 0.03
# s without motion after which the vehicle is at rest
REST_TIME: Final = 0.25
# s that it has for that: a vehicle that is pushed, or rolls on, goes on from where it is
RESTS_WITHIN: Final = 5.0
# s in which the vehicle has to get on by HARDLY m, else something stops it; some ESCs wait 2.5 s before reverse
STUCK_AFTER: Final = 4.0
# m
HARDLY: Final = 0.05
# m before the body of what stops the vehicle unseen
TOUCHES: Final = 0.03
# m of path in which an error falls to a quarter; shorter would oscillate
RETURN_LENGTH: Final = 0.25
# curvature per lateral error, 1/m^2
LATERAL_GAIN: Final = 1.0 / RETURN_LENGTH**2
# m from the body within which something seen is in the way
BESIDE: Final = 0.03
# s between two checks of the things seen
SEEN_CHECK_PERIOD: Final = 0.1
# m of path beyond the braking distance that must be free of things seen
SEEN_AHEAD: Final = 0.3
# curvature per heading error, 1/m: critical damping
HEADING_GAIN: Final = 2.0 / RETURN_LENGTH


class Blocked(CommandRefused):
    """Something stands in the way.

    >>> raise Blocked(1.0, 2.0)
    Traceback (most recent call last):
    txt1.navigation.goto.Blocked: something stands in the way at (1.00 m, 2.00 m): the robot has stopped before it
    """

    told = "something stands in the way at ({x:.2f} m, {y:.2f} m): the robot has stopped before it"

    def __init__(self, x: float, y: float, more: str = "") -> None:
        super().__init__(self.told.format(x=x, y=y) + more)
        self.place = x, y
        self.met: Array = np.empty((0, 2))
        """Places (m, in the frame of the pose) that are taken for walls from now on."""


class Halted(Blocked):
    """The robot is told to drive, and does not move.

    >>> raise Halted(1.0, 2.0)
    Traceback (most recent call last):
    txt1.navigation.goto.Halted: the robot is told to drive and hardly moves: something at (1.00 m, 2.00 m) stops it
    """

    told = "the robot is told to drive and hardly moves: something at ({x:.2f} m, {y:.2f} m) stops it"


class Arrival(NamedTuple):
    """The pose to which `go_to` has brought the robot, by the pose source."""

    # the robot's pose, m and rad
    pose: Pose
    # distance from the goal, m
    distance: float
    # difference from the goal's heading, rad, never negative
    turn: float
    # number of paths driven
    plans: int

    @property
    def arrived(self) -> bool:
        """Whether it is within 5 cm and 5 degrees of the goal."""
        return self.distance <= 0.05 and degrees(self.turn) <= 5.0


async def go_to(
    robot: Robot,
    pose: Pose,
    *,
    pose_source: PoseSource | None = None,
    room: Room | None = None,
    speed: float | str = 0.4,
    source: CommandSource | None = None,
) -> Arrival:
    """Drive to a pose (x, y in m, theta in rad) and come to rest there; return the robot's pose.

    The pose and the room, around the origin, are in the frame of the pose source, by default the odometry's. Without a
    room there are no walls. The robot must be armed, with its gains loaded. It drives at most at `speed` m/s; "time" or
    "energy" chooses the speed that saves it. `source` is the source of its commands; None: the program's.

    On a map (`map_pose`, `map_floor`), each way is planned on the floor as it is seen at that time. If something comes
    into the way, or stops the robot, it looks for a way round it, up to `DETOURS` times; while there is none, it waits
    `STUCK_AFTER` s before it looks again. No path is closer to walls than the obstacle stop lets the robot drive.

    Raises NoPath: the goal cannot be reached inside the room; Blocked: something that is seen stands in the way, or the
    robot does not move (`Halted`);
    NotArmed: the gate is closed, or closes on the way; Overruled: another source of commands drives, or takes the wheel
    on the way; CommandRefused: the speed is not positive, or the pose source knows no pose.
    """
    speed = pace(speed, robot.config)
    if not CRAWL <= speed <= robot.config.safety.v_max:
        raise CommandRefused(f"speed must be from {CRAWL} to {robot.config.safety.v_max} m/s, not {speed!r}")
    poses = wheel_pose(robot) if pose_source is None else pose_source
    wheel = robot.program if source is None else source
    wheel.begin()
    there = poses.sees
    guards = (robot.runtime.part(LaserGuard), robot.runtime.part(AreaGuard))
    keep, met = max((guard.margin for guard in guards if guard is not None), default=0.0), np.empty((0, 2))
    plans, detours, blocked, arrival = 0, 0, None, None
    while True:
        plans += 1
        start = poses.pose()
        far = _miss(start, pose)[0] > CORRECTION
        make = plan if plans == 1 or far else plan_with_run_up
        try:
            path = await _beside(make, start, pose, room, robot.config.geometry, there, met, keep)
            await _drive(robot, wheel, poses, start, path, speed)
        except Blocked as error:
            if detours == DETOURS:
                raise type(error)(*error.place, f", and {DETOURS} looks for another way did not help") from None
            detours, blocked, met = detours + 1, error, np.concatenate((met, error.met))
            robot.tell(f"{error}, and looks for another way")
            await rest(robot, wheel, poses)
            wheel.release()
            continue
        except NoPath as error:
            if arrival is not None and arrival.distance <= CORRECTION:
                # the robot is nearly there, and cannot correct its pose
                return arrival
            if blocked is None:
                raise
            if detours == DETOURS:
                raise type(blocked)(*blocked.place, f"; round it, {error}") from None
            # who stands there, or stopped it unseen, may go
            detours, met = detours + 1, met[:0]
            robot.tell(f"finds no way round it, waits {STUCK_AFTER:.0f} s, and looks again")
            await rest(robot, wheel, poses, STUCK_AFTER)
            wheel.release()
            continue
        reached = poses.pose()
        arrival = Arrival(reached, *_miss(reached, pose), plans)
        if (arrival.distance <= POSITION and arrival.turn <= HEADING) or plans - detours >= ATTEMPTS:
            if arrival.distance > CORRECTION:
                raise CommandRefused(f"after {plans} paths the robot is still {arrival.distance:.2f} m from the goal")
            return arrival
        if there is not None and arrival.arrived and plans - detours >= CONTENT:
            return arrival


async def go_to_places(
    robot: Robot,
    places: Sequence[tuple[float, float]],
    *,
    pose_source: PoseSource,
    room: Room,
    speed: float | str = 0.4,
    source: CommandSource | None = None,
) -> None:
    """Drive round the walls of a map from place to place (m); the heading at each place is that of the shortest way.

    Raises as `go_to`.
    """
    for place in places:
        heading = await _beside(
            heading_at, pose_source.pose(), place, room, robot.config.geometry, pose_source.sees, np.empty((0, 2))
        )
        await go_to(robot, (*place, heading), pose_source=pose_source, room=room, speed=speed, source=source)


async def _beside(
    do: Callable[..., T],
    start: Pose,
    goal: Any,
    room: Room | None,
    body: Geometry,
    there: MapInUse | None,
    met: Array,
    *keep: float,
) -> T:
    """Return the result of a search, in which the places `met` are walls."""

    def search() -> T:
        if there is None or room is None or (seen := there.floor(lately=True)) is None:
            return do(start, goal, with_walls_at(met, room), body, *keep)
        with suppress(NoPath):
            return do(start, goal, with_walls_at(met, seen), body, *keep)
        if seen.blind:
            with suppress(NoPath):
                return do(start, goal, with_walls_at(met, there.floor()), body, *keep)
        # what is not seen now may have gone
        return do(start, goal, with_walls_at(met, there.floor(remembered=False)), body, *keep)

    return search() if room is None or room.walls is None else await in_thread(search)


async def in_thread(search: Callable[[], T]) -> T:
    """Return the result of a search that takes longer than a tick; on the real clock a thread of its own does it."""
    if isinstance(asyncio.get_running_loop(), VirtualTimeLoop):
        return search()
    return await asyncio.to_thread(search)


async def _drive(robot: Robot, wheel: CommandSource, poses: PoseSource, start: Pose, path: Path, speed: float) -> None:
    """Drive a path, gear by gear, to its end, or to a change of gear at which the robot is off the path, or has not
    seen the floor behind it; where the path begins backward, as far as that was seen.
    """
    try:
        for number, part in enumerate(stretches(path)):
            floor = None if poses.sees is None or part[0].distance > 0.0 else poses.sees.floor()
            seen = seen_part(start, part, floor, robot.config.geometry)
            if seen != part and (number or length(seen) < STRETCH_MIN):
                return
            stretch = Stretch(start, seen)
            await _drive_stretch(robot, wheel, poses, stretch, speed)
            start = stretch.end
            distance, turn = _miss(poses.pose(), start)
            if seen != part or distance > OFF_POSITION or turn > OFF_HEADING:
                return
    finally:
        wheel.release()


async def _drive_stretch(robot: Robot, wheel: CommandSource, poses: PoseSource, stretch: Stretch, speed: float) -> None:
    """Drive a stretch to its end and come to rest; raises Blocked if something is seen on the way."""
    there, looked, doubt = poses.sees, 0.0, 0
    geometry = robot.config.geometry
    schedule = robot.runtime.state.gains.angular
    sharpest = 1.0 / geometry.radius_min
    in_curves = curve_speed(speed, stretch.gear, schedule, geometry)
    driven, mark, since = 0.0, -HARDLY, robot.now
    while True:
        pose = poses.pose()
        driven = stretch.nearest(pose, driven)
        if driven >= mark + HARDLY:
            mark, since = driven, robot.now
        elif robot.now - since > STUCK_AFTER:
            raise halted(robot, stretch.gear, pose)
        moving = abs(robot.odometry.v)
        if there is not None and robot.now >= looked:
            looked = robot.now + SEEN_CHECK_PERIOD
            ahead = driven + moving * moving / (2.0 * BRAKING) + SEEN_AHEAD
            found = _in_the_way(stretch, driven, ahead, there.seen(), geometry)
            # a single scan may be wrong
            doubt = 0 if found is None else doubt + 1
            if found is not None and doubt > 1:
                raise Blocked(*found)
        left = stretch.length - driven - moving * SPEED_LAG
        if left <= 0.0:
            break
        bends = stretch.bends(driven, driven + STRAIGHT_AHEAD) or stretch.length - driven < STRAIGHT_AHEAD
        v = min(in_curves if bends else speed, max(CRAWL, sqrt(2.0 * BRAKING * left)))
        preview = min(steering_distance(stretch.gear * v, schedule, geometry), FOLLOWS_WITHIN) + moving * DEAD_TIME
        curvature = clip(stretch.steer(pose, driven, preview), sharpest)
        wheel.insist(*encoders_view(stretch.gear * v, curvature, geometry))
        await asyncio.sleep(REFRESH)
    await rest(robot, wheel, poses)


async def rest(robot: Robot, wheel: CommandSource, poses: PoseSource, seconds: float = REST_TIME) -> None:
    """Stop, and wait until the robot has been at rest for so long, at most `RESTS_WITHIN` s."""
    still, ends = 0.0, robot.now + RESTS_WITHIN
    while still < seconds and robot.now < ends:
        wheel.insist(0.0, 0.0)
        await asyncio.sleep(REFRESH)
        # the encoders' pose has to be read all the time
        poses.pose()
        still = still + REFRESH if robot.odometry.v == 0.0 else 0.0


def halted(robot: Robot, gear: float, pose: Pose) -> Halted:
    """Return the error for a robot that does not move, with what stops it: seen by the obstacle stop, or touched."""
    guard, body = robot.runtime.part(LaserGuard), robot.config.geometry
    seen = np.empty((0, 2)) if guard is None else guard.ahead(robot.now, gear)
    if not len(seen):
        across = np.linspace(-0.5, 0.5, 9) * body.width
        seen = np.column_stack((np.full(9, body.centre + gear * (0.5 * body.length + TOUCHES)), across))
    met = placed(np.array(pose), seen)
    x, y = met[np.argmin(np.hypot(seen[:, 0] - body.centre, seen[:, 1]))].tolist()
    error = Halted(x, y)
    error.met = met
    return error


def _in_the_way(
    stretch: Stretch, driven: float, ahead: float, seen: Sequence[tuple[float, float]], body: Geometry
) -> tuple[float, float] | None:
    """Return the first of the places seen that the body would touch from `driven` m on, for `ahead` m, at most
    to the end.
    """
    if not seen:
        return None
    end, at = min(ahead, stretch.length), driven
    while True:
        (x, y, theta), _ = stretch.at(at)
        c, s = cos(theta), sin(theta)
        for px, py in seen:
            along, aside = (px - x) * c + (py - y) * s - body.centre, (py - y) * c - (px - x) * s
            if abs(along) <= 0.5 * body.length + BESIDE and abs(aside) <= 0.5 * body.width + BESIDE:
                return px, py
        if at >= end:
            return None
        at = min(end, at + 0.1)


def steering_distance(v: float, schedule: Schedule, geometry: Geometry) -> float:
    """Return the distance in m in which the yaw-rate loop follows a set-point to 1 - 1/e at v m/s; inf without gains.

    The steering turns u counts into the yaw rate abs(v) u / (18000 R_min). Let k = 1000 / (18000 R_min) and
    g = abs(v) k. Then the loop is of first order, with the time constant (1 + K_P g) / (K_I g). In this time the robot
    drives (1 + K_P g) / (K_I k).
    """
    kp, ki, _ = schedule.at(v)
    k = 1000.0 / (STEERING_MAX * geometry.radius_min)
    return (1.0 + kp * abs(v) * k) / (ki * k) if ki > 0.0 else inf


def curve_speed(speed: float, gear: float, schedule: Schedule, geometry: Geometry) -> float:
    """Return the fastest speed up to `speed` at which the steering follows closely enough for curves, m/s.

    The thesis's gains for driving backward are so low that the steering takes a third of a metre to follow at -0.3 m/s.
    """
    below = [abs(gain_set.v_max) - CLEARANCE for gain_set in schedule.sets]
    candidates = [speed, *(v for v in below if CRAWL <= v < speed)]
    close = [v for v in candidates if steering_distance(gear * v, schedule, geometry) <= FOLLOWS_WITHIN]
    return max(close) if close else min(candidates)


def _miss(pose: Pose, goal: Pose) -> tuple[float, float]:
    """Return the distance in m and the angle in rad from a pose to a goal."""
    return hypot(goal[0] - pose[0], goal[1] - pose[1]), abs(wrap_angle(goal[2] - pose[2]))


class Stretch:
    """A part of a path that is driven in one gear, from `start` on; it is extended straight beyond both ends."""

    def __init__(self, start: Pose, path: Path) -> None:
        # forward, backward
        self.gear = 1.0 if path[0].distance > 0.0 else -1.0
        # path driven before, pose there, curvature
        self._pieces: list[tuple[float, Pose, float]] = []
        self.length, pose = 0.0, start  # m
        for curvature, distance in path:
            self._pieces.append((self.length, pose, curvature))
            self.length += abs(distance)
            pose = move_along_arc(*pose, distance, curvature, 0.0)
        self.end = pose

    def at(self, driven: float) -> tuple[Pose, float]:
        """Return pose and curvature (1/m) after `driven` m."""
        if driven <= 0.0:
            return move_along_arc(*self._pieces[0][1], self.gear * driven, 0.0, 0.0), self._pieces[0][2]
        if driven >= self.length:
            return move_along_arc(*self.end, self.gear * (driven - self.length), 0.0, 0.0), self._pieces[-1][2]
        before, pose, curvature = next(piece for piece in reversed(self._pieces) if piece[0] <= driven)
        return move_along_arc(*pose, self.gear * (driven - before), curvature, 0.0), curvature

    def bends(self, first: float, last: float) -> bool:
        """Return whether there is a curve between two places of the stretch, in m driven."""
        ends = [before for before, _, _ in self._pieces[1:]] + [self.length]
        return any(
            curvature != 0.0 and before <= last and ends_at >= first
            for (before, _, curvature), ends_at in zip(self._pieces, ends, strict=True)
        )

    def nearest(self, pose: Pose, around: float) -> float:
        """Return the metres driven at the point nearest to a pose, sought near `around`."""
        driven = around
        for _ in range(4):
            (x, y, theta), _ = self.at(driven)
            driven += self.gear * ((pose[0] - x) * cos(theta) + (pose[1] - y) * sin(theta))
        return driven

    def errors(self, pose: Pose, driven: float) -> tuple[float, float]:
        """Return lateral error (m, left positive) and heading error (rad) of a pose, relative to the point at
        `driven`.
        """
        (x, y, theta), _ = self.at(driven)
        return (pose[1] - y) * cos(theta) - (pose[0] - x) * sin(theta), wrap_angle(pose[2] - theta)

    def steer(self, pose: Pose, driven: float, preview: float) -> float:
        """Return the curvature, 1/m, that brings the robot back to the path. Its base is the path's, `preview` m ahead.

        Let e be the lateral error, a the heading error, g the gear, and ' the derivative by the distance driven. Then
        e' = g a and a' = g (curvature - path's). The curvature path's - e / l^2 - g a 2 / l gives
        e'' + 2 / l e' + e / l^2 = 0.
        """
        lateral, heading = self.errors(pose, driven)
        _, base = self.at(driven + preview)
        return base - LATERAL_GAIN * lateral - self.gear * HEADING_GAIN * heading
