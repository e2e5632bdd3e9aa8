"""One trial: an agent's episodes of the task, and everything that the seed decides (thesis 5.3).

A trial knows neither asyncio nor the robot; `txt1.learning.task` conducts it on the running robot. How it goes: an
episode is brought to its start (MOVE), rests there until the learner has seen enough (REST), and is driven (DRIVE)
until the goal, the boundary, the time or a contact ends it. At each `tick` the learner says whether its action goes
on, and decides where it does not; the action's velocity reaches the robot, later if there is a delay. An episode that
is void is done again from the same start, and the learner forgets it.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import cos, hypot, inf, pi, sin
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from txt1.config import Config
from txt1.errors import LightFault
from txt1.learning.agent import Agent, Doubter, Looker
from txt1.learning.finite_readings import FiniteReadings
from txt1.learning.qtable import StoredTable
from txt1.learning.settings import LearningConfig
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1.model.optimal import GOAL_RADIUS, optimal_time
from txt1.model.vehicle import LEARNING_SPEED, Geometry
from txt1.sensors.light import STREAM
from txt1.sim.pcg64 import Pcg64

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from txt1.learning.world import CheckedWorld, LightWorld

Pose = tuple[float, float, float]

# the set-point is refreshed 20 times a second, s
TICK: Final = 0.05

# (v, omega) of each action, m/s and rad/s
Commands = tuple[tuple[float, float], ...]
# right, straight, left (table 5.2)
COMMANDS: Final[Commands] = LearningConfig().actions

# in place of an action, after the end of an episode
OVER: Final = -1

# streams of random numbers of a trial
STARTS, ROBOT, SENSORS, AGENT = 1, 2, STREAM, 4

# distance of the walls beyond the boundary, m: half a body, and room to stop
WALL_MARGIN: Final = 1.0


class Task(NamedTuple):
    """The task to be learned."""

    # in the room, m
    light: tuple[float, float] = (0.0, 0.0)
    # from the light, m, and half the side of the square around the room's centre (5.4)
    start_radius: float = 1.25
    goal_radius: float = GOAL_RADIUS
    boundary: float = 8.0
    # an episode has failed after this time, s; not in the thesis
    time_limit: float = 300.0
    # rest before the first decision, s
    settle: float = 0.5
    # the fastest of the actions, m/s
    speed: float = LEARNING_SPEED
    # of the sharpest turn among the actions, m
    radius_min: float = Geometry().radius_min
    # delay with which an action reaches the robot, s
    delay: float = 0.0
    # time between two looks for goal and boundary, s; None: at the agent's decisions
    goal_period: float | None = None


class Start(NamedTuple):
    """The start of an episode: bearing of the robot from the light, and its heading, rad."""

    bearing: float
    heading: float

    def pose(self, task: Task) -> Pose:
        """The start as a pose in the room, m and rad."""
        x, y = task.light
        return x + task.start_radius * cos(self.bearing), y + task.start_radius * sin(self.bearing), self.heading

    def optimal_time(self, task: Task) -> float:
        """The least possible time to the light from here, s."""
        x, y, theta = self.pose(task)
        x, y = x - task.light[0], y - task.light[1]
        return optimal_time(x, y, theta, task.speed, task.radius_min, task.goal_radius)


class Episode(NamedTuple):
    """The course of an episode: one line of learning.csv."""

    # from 1
    number: int
    # pose at its beginning
    start: Start
    # from the first decision to the end, s
    time: float
    # whether it ended at the light
    success: bool
    # the least time from this start, s
    optimal_time: float
    # when the learner said that its model does not fit, s from the first decision
    unfit: float | None = None
    # whether it ended, and failed, as the robot touched something
    touched: bool = False


class Phase(StrEnum):
    """The part of an episode that the robot is in."""

    MOVE = "moves to the next start"
    REST = "rests on the start"
    DRIVE = "looks for the light"
    DONE = "has done all episodes"
    WAIT = "waits to be asked for an episode"


@dataclass
class TrialResult:
    """The result of a trial."""

    # its number, from 1
    trial: int
    # those that are over, and whether all are
    episodes: list[Episode]
    complete: bool
    table: StoredTable
    # with which the agent can carry on
    memory: dict[str, Any]
    # by the episode's number, (x, y) in m 20 times a second
    paths: dict[int, list[tuple[float, float]]]
    # episodes that were broken off by a disarm and done again
    voided: int = 0


def stream(seed: int, trial: int, which: int) -> Pcg64:
    """One of a trial's streams of random numbers."""
    return Pcg64([seed, trial, which])


def starts(seed: int, trial: int, count: int) -> list[Start]:
    """The starts of a trial's episodes: the same for every agent."""
    angles = stream(seed, trial, STARTS).uniform(-pi, pi, 2 * count)
    return [Start(bearing, heading) for bearing, heading in zip(angles[::2], angles[1::2], strict=True)]


def task_of(config: Config) -> Task:
    """Return the task, as configured."""
    one = config.section(LearningConfig)
    speed = max(abs(v) for v, _ in one.actions)
    sharpest = min((abs(v / omega) for v, omega in one.actions if omega), default=inf)
    radius_min = max(config.geometry.radius_min, sharpest)
    return Task(
        config.sim.room.light,
        one.start_radius,
        one.goal_radius,
        one.boundary,
        one.time_limit,
        speed=speed,
        radius_min=radius_min,
        delay=one.delay,
        goal_period=one.goal_period,
    )


def ready_to_learn(config: Config) -> Config:
    """Return the configuration with a simulated room that holds the boundary, and power that never runs out."""
    side = 2.0 * (config.section(LearningConfig).boundary + WALL_MARGIN)
    sim = config.sim
    room = sim.room.model_copy(update={"length": max(side, sim.room.length), "width": max(side, sim.room.width)})
    battery = replace(sim.battery, used_1=None, used_2=None)
    return config.model_copy(update={"sim": sim.model_copy(update={"room": room, "battery": battery})})


def robot_config(config: Config, seed: int, trial: int) -> Config:
    """The configuration of a trial's own robot."""
    own = stream(seed, trial, ROBOT).integers(2**32)
    return ready_to_learn(config).model_copy(update={"seed": own})


def recorded_plan(name: str, seed: int, number: int, episodes: int) -> dict[str, object]:
    """Return the description of a trial that its recording holds."""
    return {"learn": name, "seed": seed, "trial": number, "episodes": episodes}


@dataclass
class Trial:
    """Episodes by one agent.

    Whoever conducts it brings the robot to `start` while the phase is MOVE, calls `placed`, shows it every sample of
    the light by `see`, and calls `tick` 20 times a second.
    """

    agent: Agent
    task: Task
    starts: list[Start]
    commands: Commands = COMMANDS
    # called with each episode as it ends
    done: Callable[[Episode], None] = lambda _: None
    # numbers of the episodes whose paths are kept
    keep_paths: Collection[int] = ()
    # called with every decided action, and with OVER at the end of an episode
    decided: Callable[[int], None] = lambda _: None
    # called before an episode begins
    begins: Callable[[], None] = lambda: None
    # what the learner is told; None: odometry as it is
    world: "LightWorld | CheckedWorld | None" = None
    # those that are over
    episodes: list[Episode] = field(default_factory=list)
    paths: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    voided: int = 0

    def __post_init__(self) -> None:
        # when the robot was put on its start
        self.since = 0.0
        self._began = 0.0
        # time of the next look for the goal
        self._looks = 0.0
        self._action = 0
        # commands, and when each reaches the robot
        self._under_way: list[tuple[float, tuple[float, float]]] = []
        self._in_force = (0.0, 0.0)
        self._unfit: float | None = None
        self._gate = FiniteReadings()
        self._next()

    def carry_on(self, before: TrialResult) -> None:
        """Count the episodes of an earlier result, keep their paths, and restore the agent's memory."""
        self.agent.recall(before.memory)
        self.episodes.extend(before.episodes)
        self.paths.update({number: path for number, path in before.paths.items() if number <= len(before.episodes)})
        self.voided += before.voided
        self._next()

    def result(self, number: int) -> TrialResult:
        """Return the result so far; `number` is the trial's."""
        complete, agent = len(self.episodes) == len(self.starts), self.agent
        return TrialResult(number, self.episodes, complete, agent.table(), agent.memory(), self.paths, self.voided)

    @property
    def start(self) -> Pose:
        """The pose at which the next episode begins."""
        return self.starts[len(self.episodes)].pose(self.task)

    def placed(self, now: float) -> None:
        """Note that the robot stands on its start pose since `now`."""
        self.phase = Phase.REST
        self._began = self.since = now
        self._under_way, self._in_force, self._unfit = [], (0.0, 0.0), None
        self._gate.clear()
        self.begins()
        if self.world is not None:
            self.world.begin(len(self.episodes) + 1)
        self.agent.begin()

    def see(self, now: float, readings: Readings, odometry: Odometry) -> None:
        """Show the agent a sample of the light, lux, through the gate for numbers; raises LightFault."""
        passed = self._gate.readings(now, readings)
        if passed is None:
            return
        try:
            self.agent.see(passed, self._told(now, odometry))
        except LightFault as fault:
            if not self._gate.fault:
                raise
            # the sensor counts as dark because of what it reads
            raise LightFault(self._gate.fault) from fault

    def look(self, now: float, points: "NDArray[np.float64]", odometry: Odometry) -> None:
        """Show an agent that looks where a sweep's beams ended, in the robot's frame, m."""
        if isinstance(self.agent, Looker):
            finite = abs(points).sum(axis=1) < inf
            self.agent.look(points[finite], self._told(now, odometry))

    def _told(self, now: float, odometry: Odometry) -> Odometry:
        told = odometry if self.world is None else self.world.odometry(now - self.since, odometry)
        return self._gate.odometry(told)

    def tick(
        self, now: float, armed: bool, pose: Pose, odometry: Odometry, touches: bool = False
    ) -> tuple[float, float]:
        """The velocity to command, m/s and rad/s, at a pose in the room.

        The episode of a robot that is not `armed` is void; an episode with a contact (`touches`) has failed.
        """
        if not armed:
            self.void()
        if self.phase is Phase.MOVE or self.phase is Phase.DONE:
            return 0.0, 0.0
        if self.phase is Phase.REST:
            if now - self._began < self.task.settle - 1e-9 or not self.agent.ready:
                return 0.0, 0.0
            self.phase = Phase.DRIVE
            self._began = self._looks = now
        number = len(self.episodes) + 1
        if number in self.keep_paths:
            self.paths.setdefault(number, []).append((pose[0], pose[1]))
        odometry = self._told(now, odometry)
        if touches:
            self._end(now, False, odometry, touched=True)
            return 0.0, 0.0
        decides = not self.agent.waits(now, odometry)
        if self._looks_now(now, decides):
            ended = self._ended(now, pose)
            if ended is not None:
                self._end(now, ended, odometry)
                return 0.0, 0.0
        if decides:
            self._action = self.agent.act(now, odometry)
            if self._unfit is None and isinstance(self.agent, Doubter) and self.agent.unfit:
                self._unfit = now - self._began
            self.decided(self._action)
        command = self._delayed(now, self.commands[self._action])
        return command if self.world is None else self.world.command(now - self.since, command)

    def _delayed(self, now: float, command: tuple[float, float]) -> tuple[float, float]:
        """The command that reaches the robot now."""
        if not self.task.delay:
            return command
        self._under_way.append((now + self.task.delay, command))
        while self._under_way and self._under_way[0][0] <= now + 1e-9:
            self._in_force = self._under_way.pop(0)[1]
        return self._in_force

    def void(self) -> None:
        """Do the present episode again from a new beginning."""
        if self.phase is Phase.REST or self.phase is Phase.DRIVE:
            self.agent.void()
            self.voided += 1
            self.paths.pop(len(self.episodes) + 1, None)
            self.phase = Phase.MOVE

    def _looks_now(self, now: float, decides: bool) -> bool:
        """Whether to look for the goal now: at decisions, as the original learner did (O), or by the task's period."""
        period = self.task.goal_period
        if period is None:
            return decides
        if now < self._looks - 1e-9:
            return False
        self._looks += period
        return True

    def _ended(self, now: float, pose: Pose) -> bool | None:
        """Whether the episode has ended: True in success, False in failure, None if it goes on."""
        task = self.task
        x, y, _ = pose
        light = task.light if self.world is None else self.world.goal(now - self.since)
        if hypot(x - light[0], y - light[1]) <= task.goal_radius:
            return True
        if max(abs(x), abs(y)) > task.boundary or now - self._began > task.time_limit:
            return False
        return None

    def _end(self, now: float, success: bool, odometry: Odometry, touched: bool = False) -> None:
        self.agent.end(success, odometry)
        self.decided(OVER)
        number = len(self.episodes) + 1
        start = self.starts[number - 1]
        best = start.optimal_time(self.task)
        episode = Episode(number, start, now - self._began, success, best, self._unfit, touched)
        self.episodes.append(episode)
        self._next()
        self.done(episode)

    def _next(self) -> None:
        self.phase = Phase.MOVE if len(self.episodes) < len(self.starts) else Phase.DONE
