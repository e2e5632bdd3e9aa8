"""The learning task: a trial on the running robot, beside its other tasks and through its API alone (thesis 5).

Two periodic tasks are added: `light` reads the sensors every 16 ms, `learning` refreshes the set-point 20 times a
second. Where the HAL can place the robot it is placed at the next start; elsewhere it drives there.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np

from txt1.config import Config
from txt1.errors import HalError, NotArmed
from txt1.kernel.scheduler import Ticks
from txt1.learning.sensors import Compass, LightSource, PhidgetSensors, SimulatedSensors
from txt1.learning.trial import TICK, Phase, Task, Trial
from txt1.model.light import SAMPLE_PERIOD
from txt1.navigation import PoseSource, go_to, true_pose, wheel_pose
from txt1.robot import Robot
from txt1.sim.light import LightSensors, PointLight, noise_for_jitter

PRIORITY = 0


class LearningTask:
    """A trial, conducted on a robot.

    A disarm voids the repetition; after the arm the robot goes to the start once more and repeats it.

    Args:
        robot: armed or not, its gains loaded.
        trial: what to do.
        source: the light sensors.
        pose: where the robot is in the room, for the goal and the boundary. None: the simulation's truth; or, where
            there is none or `learning.pose` says so, odometry.
        stopped: asked 20 times a second; once it says yes the trial is over.

    """

    def __init__(
        self,
        robot: Robot,
        trial: Trial,
        source: LightSource,
        pose: PoseSource | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.trial = trial
        self.ended = asyncio.Event()
        """Set when the last repetition is over, or somebody stopped the trial."""
        self._robot = robot
        self._source = source
        self._given = pose
        self._stopped = stopped
        self._truth = robot.config.learning.pose == "truth" and robot.hal.capabilities.pose
        self._pose = pose or (true_pose(robot) if self._truth else wheel_pose(robot))
        self._places = robot.hal.capabilities.place
        self._drive: asyncio.Task[object] | None = None

    def start(self) -> None:
        """Add the two tasks to the robot's."""
        self._robot.add_task("light", SAMPLE_PERIOD, self.light, PRIORITY)
        self._robot.add_task("learning", TICK, self.learning, PRIORITY)

    async def light(self, ticks: Ticks) -> None:
        """Show the agent every sample of the light while a repetition is on."""
        robot, trial, source = self._robot, self.trial, self._source
        sees_pose = robot.hal.capabilities.pose
        try:
            async for _ in ticks:
                if trial.phase is Phase.REST or trial.phase is Phase.DRIVE:
                    pose = robot.runtime.look().pose if sees_pose else None
                    trial.agent.see(source.read(pose), robot.odometry)
        finally:
            source.close()

    async def learning(self, ticks: Ticks) -> None:
        """Bring the robot to each start, and command what the agent decides."""
        robot, trial = self._robot, self.trial
        try:
            async for now in ticks:
                if self._stopped():
                    trial.phase = Phase.DONE
                pose = self._pose.read()
                if trial.phase is Phase.MOVE:
                    if not self._moved(now):
                        continue
                    pose = self._pose.read()
                if pose is None:  # lost, so there is no telling where the boundary is
                    trial.void()
                    robot.command(0.0, 0.0)
                    continue
                before = trial.phase
                robot.command(*trial.tick(now, robot.armed, pose, robot.odometry))
                if trial.phase is Phase.DONE:
                    self.ended.set()
                elif trial.phase is not before:
                    robot.tell(f"repetition {len(trial.repetitions) + 1} {trial.phase.value}")
        finally:
            if self._drive is not None:
                self._drive.cancel()

    def _moved(self, now: float) -> bool:
        """Whether the robot is at its start now; sees to it that it will be."""
        robot, trial = self._robot, self.trial
        if not robot.armed:
            return False
        if self._places:
            robot.command(0.0, 0.0)
            if robot.odometry.v or robot.odometry.omega:  # a robot that rolls is not lifted
                return False
            robot.place(*trial.start)
            if self._given is None and not self._truth:
                self._pose = wheel_pose(robot, trial.start)
        else:
            if self._drive is None:
                self._drive = asyncio.ensure_future(go_to(robot, trial.start, pose_source=self._pose))
            if not self._drive.done():
                return False
            drive, self._drive = self._drive, None
            error = drive.exception()
            if isinstance(error, NotArmed):  # on the way; it drives on after the arm
                return False
            if error is not None:
                raise error
        trial.placed(now)
        return True


def task_of(config: Config) -> Task:
    """What is to be learned, as configured."""
    one = config.learning
    return Task(config.sim.room.light, one.start_radius, one.goal_radius, one.boundary, one.time_limit)


def light_source(config: Config, robot: Robot, rng: np.random.Generator) -> LightSource:
    """The configured light sensors.

    Raises:
        HalError: there are none.
        MissingExtra: Phidgets are asked for and their driver is not installed.

    """
    if config.learning.sensors == "phidgets":
        return PhidgetSensors()
    if config.learning.sensors == "none" or not robot.hal.capabilities.pose:
        raise HalError(
            f"learning needs four light sensors, and with the HAL '{robot.hal.name}' there are none: plug in a "
            "Phidgets Interface Kit and set learning.sensors=phidgets (pip install 'txt1[phidgets]')"
        )
    return simulated_light(config, rng)


def simulated_light(config: Config, rng: np.random.Generator) -> LightSource:
    """The simulated light's sensors, as configured."""
    light, (x, y) = config.sim.light, config.sim.room.light
    if light.true_bearing:
        return Compass((x, y))
    exponent = float(light.exponent)
    noise = noise_for_jitter(exponent=exponent) if light.noise is None else light.noise
    return SimulatedSensors(LightSensors(PointLight(x, y, light.intensity, exponent), noise, rng))
