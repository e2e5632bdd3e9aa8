"""A robot's task in a team: 20 times a second it tells its state, hears the others, and drives by a law."""

import asyncio
from collections.abc import Callable
from math import atan2, hypot, inf, isfinite
from typing import Final

from txt1.config import Config
from txt1.driver import REFRESH
from txt1.fleet.body import Body
from txt1.fleet.guard import Room, TeamGuard
from txt1.fleet.law import Law
from txt1.fleet.radio import ROBOT_SILENCE, Medium, Pose, Said, placed
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.sensors.readings import TrackerReading

See = Callable[[Robot], tuple[float, float] | None]

# s; a robot that wants to drive is stuck if within this time ...
STUCK_AFTER: Final = 20.0
# ... it moves less than this many m
STUCK_WITHIN: Final = 0.25


class Cooperation:
    """A robot that cooperates: its law proposes a velocity, and its guard limits it."""

    def __init__(
        self, robot: Robot, medium: Medium, law: Law, room: Room | None, see: See = lambda robot: None
    ) -> None:
        self.law = law
        """The robot's law."""
        self.silent = ""
        """The robots that it needs and does not hear; it stands until they are heard."""
        self.stuck = ""
        """The name of the obstacle, if it wants to drive and has not moved for long; "" otherwise."""
        self._robot, self._medium, self._see = robot, medium, see
        self._source = robot.source("team")
        self._start = robot.config.sim.start
        self._body = body_of(robot.config)
        self._guard = TeamGuard(self._body, room if room is not None and all(map(isfinite, room)) else None)
        # place of its last motion, m, and the time, s of the loop
        self._moved = 0.0, 0.0, -inf

    def begin(self) -> None:
        """Start the robot's task."""
        self._robot.add_task("team", REFRESH, self._cooperate)

    def said(self) -> Said:
        """The robot's place in the room, and its motion."""
        robot, odometry = self._robot, self._robot.odometry
        pose = pose_in_room(robot) or placed(self._start, odometry.x, odometry.y, odometry.theta)
        time = asyncio.get_running_loop().time()
        return Said(*pose, odometry.v, odometry.omega, time, self.law.data, self._body)

    async def _cooperate(self, ticks: Ticks) -> None:
        robot = self._robot
        async for _ in ticks:
            me = self.said()
            heard = {name: one for name, one in self._medium.heard().items() if me.time - one.time <= ROBOT_SILENCE}
            self._listen(", ".join(sorted(self.law.needs - heard.keys())))
            wanted = 0.0, 0.0
            if not self.silent and robot.armed:
                wanted = self.law.step(me, heard, self._see(robot))
                self._source.command(*self._guard.step(me, heard, *wanted))
                me = me._replace(data=self.law.data)
            self._watch(me, wants=wanted != (0.0, 0.0))
            self._medium.say(me)

    def _listen(self, silent: str) -> None:
        """Apply the rule of silence."""
        if silent == self.silent:
            return
        self.silent = silent
        self._source.release()
        self._robot.tell(f"cooperates no more: {silent} not heard for {ROBOT_SILENCE:g} s" if silent else "cooperates")

    def _watch(self, me: Said, *, wants: bool) -> None:
        """Notice whether the robot moves while it wants to."""
        x, y, since = self._moved
        if not wants or hypot(me.x - x, me.y - y) > STUCK_WITHIN:
            self._moved = me.x, me.y, me.time
            if self.stuck:
                self.stuck = ""
                self._robot.tell("is stuck no more")
        elif not self.stuck and me.time - since > STUCK_AFTER:
            self.stuck = self._guard.by or "nothing that it knows of"
            self._robot.tell(f"stuck: has not moved {STUCK_WITHIN:g} m in {STUCK_AFTER:g} s; in the way: {self.stuck}")


def pose_in_room(robot: Robot) -> Pose | None:
    """Return a robot's place in the room by motion capture, or the true pose in simulation; None if neither is known.

    A pose of motion capture older than `ROBOT_SILENCE` is ignored. In simulation without motion capture the true pose
    replaces it.
    """
    for polled in robot.sensors.values():
        last = polled.last
        if last is not None and isinstance(last.value, TrackerReading) and robot.now - last.time <= ROBOT_SILENCE:
            return last.value.x, last.value.y, last.value.theta
    return robot.pose


def body_of(config: Config) -> Body:
    """Return the body of a robot with this configuration."""
    return Body.of(config.geometry, config.safety)


def see_simulated(robot: Robot) -> tuple[float, float] | None:
    """Brightness in lux and bearing in rad of the simulated light, from the robot's true pose and without noise."""
    if robot.pose is None:
        return None
    x, y, theta = robot.pose
    light, room = robot.config.sim.light, robot.config.sim.room
    dx, dy = room.light[0] - x, room.light[1] - y
    return light.intensity / max(dx * dx + dy * dy, 1e-4), atan2(dy, dx) - theta
