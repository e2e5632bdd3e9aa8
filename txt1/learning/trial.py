"""One trial: episodes of the task by one agent, from random starts, told the time 20 times a second (thesis 5.3).

It knows neither asyncio nor the robot: `txt1.learning.task` conducts it on the running robot.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from enum import StrEnum
from math import cos, hypot, pi, sin
from typing import Final, NamedTuple

import numpy as np

from txt1.learning.agent import Agent
from txt1.model.odometry import Odometry
from txt1.model.optimal import GOAL_RADIUS, SPEED, optimal_time
from txt1.model.vehicle import Geometry

Pose = tuple[float, float, float]

TICK: Final = 0.05  # the set-point is refreshed 20 times a second, s

TURN: Final = SPEED / Geometry().radius_min
"""The sharpest yaw rate at the learning robot's speed, rad/s: 0.54 in table 5.2."""

COMMANDS: tuple[tuple[float, float], ...] = ((SPEED, -TURN), (SPEED, 0.0), (SPEED, TURN))
"""(v, omega) of the actions right, straight, left (table 5.2), m/s and rad/s."""


OVER: Final = -1  # in place of an action, when an episode has ended


class Task(NamedTuple):
    """The task to be learned."""

    light: tuple[float, float] = (0.0, 0.0)  # where it is in the room, x and y in m
    start_radius: float = 1.25  # distance from the light at which an episode begins, m (5.4)
    goal_radius: float = GOAL_RADIUS  # distance at which it has succeeded, m (5.4)
    boundary: float = 8.0  # it has failed outside the square of +-this around the room's centre, m
    time_limit: float = 300.0  # it has failed after so long, s; not in the thesis
    settle: float = 0.5  # rest before the first decision, s


class Start(NamedTuple):
    """The start of an episode: bearing of the robot from the light, and its heading, rad."""

    bearing: float
    heading: float

    def pose(self, task: Task) -> Pose:
        """The same as a pose in the room, m and rad."""
        x, y = task.light
        return x + task.start_radius * cos(self.bearing), y + task.start_radius * sin(self.bearing), self.heading

    def optimal_time(self, task: Task) -> float:
        """The least time it can take from here, s."""
        x, y, theta = self.pose(task)
        return float(optimal_time(x - task.light[0], y - task.light[1], theta, goal_radius=task.goal_radius))


class Episode(NamedTuple):
    """The course of an episode: one line of learning.csv."""

    number: int  # from 1
    start: Start  # where it began
    time: float  # from the first decision to the end, s
    success: bool  # whether it ended at the light
    optimal_time: float  # the least time from this start, s


class Phase(StrEnum):
    """The part of an episode that the robot is in."""

    MOVE = "moves to the next start"
    REST = "rests on the start"
    DRIVE = "looks for the light"
    DONE = "has done all episodes"


def starts(seed: int, trial: int, count: int) -> list[Start]:
    """The starts of a trial's episodes: the same for every agent."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, trial, 1]))
    return [Start(*map(float, pair)) for pair in rng.uniform(-pi, pi, (count, 2))]


class Trial:
    """Episodes by one agent.

    Whoever conducts it brings the robot to `start` while the phase is MOVE, calls `placed`, shows the agent every
    sample of the light, and calls `tick` 20 times a second.

    `commands` are (v, omega) of each action, m/s and rad/s; `done` is told each episode as it ends; `keep_paths` are
    the numbers of the episodes whose paths are kept.
    """

    def __init__(
        self,
        agent: Agent,
        task: Task,
        starts: list[Start],
        commands: tuple[tuple[float, float], ...] = COMMANDS,
        done: Callable[[Episode], None] = lambda _: None,
        keep_paths: Collection[int] = (),
    ) -> None:
        self.agent = agent
        self.task = task
        self.episodes: list[Episode] = []
        self.paths: dict[int, list[tuple[float, float]]] = {}
        self.voided = 0
        self._starts = starts
        self._commands = commands
        self._done = done
        self._keep_paths = keep_paths
        self.decided: Callable[[int], None] = lambda action: None
        """Told the index of every action as it is decided, and OVER when an episode has ended."""
        self._began = 0.0
        self._action = 0
        self.phase: Phase = Phase.MOVE if starts else Phase.DONE

    def carry_on(self, earlier: Sequence[Episode], paths: Mapping[int, list[tuple[float, float]]], voided: int) -> None:
        """Count episodes that were done before, and keep their paths."""
        self.episodes.extend(earlier)
        self.paths.update({number: path for number, path in paths.items() if number <= len(earlier)})
        self.voided += voided
        self.phase = Phase.MOVE if len(self.episodes) < len(self._starts) else Phase.DONE

    @property
    def start(self) -> Pose:
        """The pose at which the next episode begins."""
        return self._starts[len(self.episodes)].pose(self.task)

    def placed(self, now: float) -> None:
        """The robot stands on its start pose since `now`."""
        self.phase = Phase.REST
        self._began = now
        self.agent.begin()

    def tick(self, now: float, armed: bool, pose: Pose, odometry: Odometry) -> tuple[float, float]:
        """The velocity to command, m/s and rad/s.

        `pose` is the robot's in the room, m and rad. When the safety gate closes, the robot is no longer `armed`: the
        episode is void and will be repeated.
        """
        if self.phase is Phase.MOVE or self.phase is Phase.DONE:
            return 0.0, 0.0
        if not armed:
            self.void()
            return 0.0, 0.0
        if self.phase is Phase.REST:
            if now - self._began < self.task.settle - 1e-9 or not self.agent.ready:
                return 0.0, 0.0
            self.phase = Phase.DRIVE
            self._began = now
        number = len(self.episodes) + 1
        if number in self._keep_paths:
            self.paths.setdefault(number, []).append((pose[0], pose[1]))
        if not self.agent.waits(now, odometry):
            ended = self._ended(now, pose)
            if ended is not None:
                self._end(now, ended, odometry)
                return 0.0, 0.0
            self._action = self.agent.act(now, odometry)
            self.decided(self._action)
        return self._commands[self._action]

    def void(self) -> None:
        """Do the present episode again, as if it had never begun."""
        if self.phase is Phase.REST or self.phase is Phase.DRIVE:
            self.agent.void()
            self.voided += 1
            self.paths.pop(len(self.episodes) + 1, None)
            self.phase = Phase.MOVE

    def _ended(self, now: float, pose: Pose) -> bool | None:
        """Whether it has ended, True in success; asked at decisions only, as the original's learner did (O)."""
        task = self.task
        x, y, _ = pose
        if hypot(x - task.light[0], y - task.light[1]) <= task.goal_radius:
            return True
        if max(abs(x), abs(y)) > task.boundary or now - self._began > task.time_limit:
            return False
        return None

    def _end(self, now: float, success: bool, odometry: Odometry) -> None:
        self.agent.end(success, odometry)
        self.decided(OVER)
        number = len(self.episodes) + 1
        start = self._starts[number - 1]
        episode = Episode(number, start, now - self._began, success, start.optimal_time(self.task))
        self.episodes.append(episode)
        self.phase = Phase.MOVE if number < len(self._starts) else Phase.DONE
        self._done(episode)
