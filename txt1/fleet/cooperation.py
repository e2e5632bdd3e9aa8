"""A robot's task in a team: it tells where it is, hears the others, and drives by a law, 20 times a second."""

import asyncio
from collections.abc import Callable
from math import atan2

from txt1.config import Config
from txt1.driver import REFRESH
from txt1.fleet.law import Law
from txt1.fleet.radio import SILENCE, Medium, Said, placed
from txt1.fleet.steering import Body
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot

See = Callable[[Robot], tuple[float, float] | None]


class Cooperation:
    """A robot that cooperates."""

    def __init__(self, robot: Robot, medium: Medium, law: Law, see: See = lambda robot: None) -> None:
        self.law = law
        """Its part."""
        self.silent = ""
        """Whom it cannot do without and does not hear: it stands until then."""
        self._robot, self._medium, self._see = robot, medium, see
        self._source = robot.source("team")
        self._start = robot.config.sim.start

    def begin(self) -> None:
        """Set the robot to it."""
        self._robot.add_task("team", REFRESH, self._cooperate)

    def said(self) -> Said:
        """Where the robot is by its odometry, from where it started, and how it moves."""
        odometry = self._robot.odometry
        pose = placed(self._start, odometry.x, odometry.y, odometry.theta)
        return Said(*pose, odometry.v, odometry.omega, asyncio.get_running_loop().time(), self.law.data)

    async def _cooperate(self, ticks: Ticks) -> None:
        robot = self._robot
        async for _ in ticks:
            me = self.said()
            heard = {name: one for name, one in self._medium.heard().items() if me.time - one.time <= SILENCE}
            self._listen(", ".join(sorted(self.law.needs - heard.keys())))
            if not self.silent and robot.armed:
                self._source.command(*self.law.step(me, heard, self._see(robot)))
                me = me._replace(data=self.law.data)
            self._medium.say(me)

    def _listen(self, silent: str) -> None:
        """The rule of silence."""
        if silent == self.silent:
            return
        self.silent = silent
        self._source.release()
        self._robot.tell(f"cooperates no more: {silent} not heard for {SILENCE:g} s" if silent else "cooperates")


def body_of(config: Config) -> Body:
    """Return a robot's own body."""
    return Body.of(config.geometry, config.safety.v_max)


def see_simulated(robot: Robot) -> tuple[float, float] | None:
    """Brightness in lux and bearing in rad of the simulated light, from the robot's true pose and without noise."""
    if robot.pose is None:
        return None
    x, y, theta = robot.pose
    light, room = robot.config.sim.light, robot.config.sim.room
    dx, dy = room.light[0] - x, room.light[1] - y
    return light.intensity / max(dx * dx + dy * dy, 1e-4), atan2(dy, dx) - theta
