"""A learner over many seeds: times, success, ratio to the optimum.

    python -m benchmarks.learning_study --agent sweeps --trials 1000 --seed 1 --jobs 2 --permute

Trials are those of `txt1 learn`. Seed 77 served for tuning; the figures in docs/results/learning.md are seed 1's. With
--permute, every trial's agent gets the three actions in a secret order of its own. The thesis's own table from 1000
random starts: --agent table_5_3 --trials 100 --episodes 10.
With --where, `thesis` is watched, and the figures end with where its time after episode 7 goes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from txt1.config import Config, load
from txt1.learning.command.trials import on_robot
from txt1.learning.experiment import LEARNED, Plan, summary
from txt1.learning.light_direction import sector
from txt1.learning.registry import LEARNERS
from txt1.learning.settings import LearningConfig, ThesisConfig
from txt1.learning.thesis import TABLE_5_3, ThesisAgent
from txt1.learning.trial import AGENT, COMMANDS, TICK, Episode, stream
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import SENSOR_X, SENSOR_Y
from txt1.model.odometry import Odometry

STORED = "table_5_3"
"""Not a learner: the thesis's table, driven greedily."""
ORDER = 9
"""The stream of random numbers that orders the actions."""


def trial(number: int, agent: str, config: Config, seed: int, episodes: int, permute: bool) -> list[Episode]:
    """The episodes of one trial."""
    order = stream(seed, number, ORDER).permutation(len(COMMANDS)) if permute else np.arange(len(COMMANDS))
    commands = tuple(COMMANDS[k] for k in order)
    learner: ThesisAgent | None = None
    if agent == STORED:
        learner = ThesisAgent(
            stream(seed, number, AGENT), COMMANDS, ThesisConfig(policy="greedy", training=0, learn_on=False)
        )
        learner.q = np.array(TABLE_5_3)
    plan = Plan(agent, number, episodes, seed, config)
    return on_robot(plan, number, agent=learner, commands=commands).episodes


# -- where the time goes -----------------------------------------------------------------------------------------

SLOW = 15.0
"""An episode that takes longer is slow, s."""
BANDS = (0.75, 1.25, 2.5)
"""Distances from the light between which time is told apart, m."""
CAUSES = ("right", "compression", "noise", "table", "exploration")
"""What an action was, or why it was wrong. Right: straight on with the light in front centre, else a turn to its side
(at rear centre, either turn). A wrong one was exploration where it was not the table's; the table's fault where it is
wrong for the sensed sector, too; else the sensed sector was not the true one: by the sum's compression of the true
bearing alone, or by noise and the filter's delay."""
SIDES = {"ahead": (3, 4, 5), "abeam": (2, 6), "behind": (7, 0, 1)}
"""True sectors of the light."""


class Decision(NamedTuple):
    """A decision and what came of it.

    Attributes:
        slow: whether its episode was.
        episode: number, from 1.
        state: true sector of the light.
        distance: from the light, m.
        cause: index of what it was.
        duration: until the next one, s.
        gained: distance that it took off, m.

    """

    slow: bool
    episode: int
    state: int
    distance: float
    cause: int
    duration: float
    gained: float


Noted = tuple[float, int | None, int, bool]
"""Of a decision: time (s), sensed sector, action, whether it was the table's best."""


class Watched(ThesisAgent):
    """The thesis's learner, and the decisions of each episode."""

    def __init__(self, rng: np.random.Generator, settings: ThesisConfig) -> None:
        self.logs: list[list[Noted]] = []
        super().__init__(rng, COMMANDS, settings)

    def begin(self) -> None:
        """Note a new episode."""
        super().begin()
        self._log: list[Noted] = []

    def act(self, now: float, odometry: Odometry) -> int:
        """Note the decision."""
        state = self.state()
        action = super().act(now, odometry)
        best = state is not None and self.q[state][action] == max(self.q[state])
        self._log.append((now, state, action, best))
        return action

    def end(self, success: bool, odometry: Odometry) -> None:
        """Keep what was noted."""
        super().end(success, odometry)
        self.logs.append(self._log)


class EveryPath(Plan):
    """A plan that keeps the paths of all its episodes."""

    def keep_paths(self) -> set[int]:
        """All of them."""
        return set(range(1, self.episodes + 1))


def watched(number: int, config: Config, seed: int, episodes: int) -> tuple[list[Episode], list[Decision]]:
    """A trial's episodes, and the decisions of those after the 7th."""
    agent = Watched(stream(seed, number, AGENT), config.section(LearningConfig).thesis)
    outcome = on_robot(EveryPath("thesis", number, episodes, seed, config), number, agent=agent)
    decisions = []
    for one, log in zip(outcome.episodes[LEARNED:], agent.logs[LEARNED:], strict=True):
        x, y = np.array(outcome.paths[one.number]).T - np.array(config.sim.room.light)[:, None]
        distance = np.hypot(x, y)
        ticks = [round((now - log[0][0]) / TICK) for now, *_ in log] + [len(x) - 1]
        for (_, sensed, action, best), k, after in zip(log, ticks, ticks[1:], strict=False):
            heading = np.arctan2(y[k] - y[k - 1], x[k] - x[k - 1]) if k else one.start.heading
            bearing = wrap_angle(float(np.arctan2(-y[k], -x[k]) - heading))
            summed = float(np.arctan2(SENSOR_Y**2 * np.sin(bearing), SENSOR_X**2 * np.cos(bearing)))
            if is_right(action, sector(bearing)):
                cause = "right"
            elif not best or sensed is None:
                cause = "exploration"
            elif not is_right(action, sensed):
                cause = "table"
            else:
                compressed = agent.settings.direction == "summed" and sensed == sector(summed)
                cause = "compression" if compressed else "noise"
            decisions.append(
                Decision(
                    one.time > SLOW,
                    one.number,
                    sector(bearing),
                    float(distance[k]),
                    CAUSES.index(cause),
                    (after - k) * TICK,
                    float(distance[k] - distance[after]),
                )
            )
    return outcome.episodes, decisions


def is_right(action: int, state: int) -> bool:
    """Whether an action is the one to take with the light in this sector."""
    if state in (0, 4):
        return (action == 1) == (state == 4)
    return action == (0 if state < 4 else 2)


def where(decisions: Sequence[Decision]) -> dict[str, Any]:
    """Of slow and of other episodes: shares of their time by cause, distance and side; m/s gained meanwhile."""
    table = np.array(decisions)
    found: dict[str, Any] = {}
    for name, some in (("slow", table[table[:, 0] == 1.0]), ("other", table[table[:, 0] == 0.0])):
        _, number, state, distance, cause, duration, gained = some.T
        parts = {f"cause: {each}": cause == k for k, each in enumerate(CAUSES)}
        edges = (0.0, *BANDS, float("inf"))
        for low, high in pairwise(edges):
            parts[f"distance: {low} to {high} m"] = (distance >= low) & (distance < high)
        for low, high in pairwise((8, 11, 16, 1000)):
            parts[f"episodes {low} to {high - 1}"] = (number >= low) & (number < high)
        for side, states in SIDES.items():
            there = np.isin(state, states)
            parts[f"light {side}"] = there
            parts |= {f"light {side}, {each}": there & (cause == k) for k, each in enumerate(CAUSES)}
        parts[f"light abeam, nearer than {BANDS[0]} m"] = np.isin(state, SIDES["abeam"]) & (distance < BANDS[0])
        found[name] = {"robot_seconds": round(float(duration.sum()), 1)} | {
            part: {
                "share_of_time": round(float(duration[mask].sum() / duration.sum()), 3),
                "gained_m_per_s": round(float(gained[mask].sum() / duration[mask].sum()), 3) if mask.any() else None,
            }
            for part, mask in parts.items()
        }
    return found


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its figures as JSON."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learning_study", description=__doc__.split("\n")[0])
    parser.add_argument("--agent", choices=(*LEARNERS.names(), STORED), default="sweeps")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="number of the first trial")
    parser.add_argument("--episodes", type=int, default=31)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--permute", action="store_true")
    parser.add_argument("--where", action="store_true", help="where the time of slow episodes goes; thesis only")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args(argv)
    config = load(None, arguments.set).config
    work = partial(
        trial,
        agent=arguments.agent,
        config=config,
        seed=arguments.seed,
        episodes=arguments.episodes,
        permute=arguments.permute,
    )
    numbers = range(arguments.first, arguments.first + arguments.trials)
    if arguments.where and (arguments.agent != ThesisAgent.name or arguments.permute or arguments.episodes <= LEARNED):
        parser.error(f"--where goes with --agent thesis, more than {LEARNED} episodes, and without --permute")
    found: dict[str, Any] = {}
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        if arguments.where:
            look = partial(watched, config=config, seed=arguments.seed, episodes=arguments.episodes)
            both = list(pool.map(look, numbers, chunksize=4))
            trials = [episodes for episodes, _ in both]
            found["where"] = where([one for _, decisions in both for one in decisions])
        else:
            trials = list(pool.map(work, numbers, chunksize=4))
    print(json.dumps({"command": vars(arguments), **summary(trials), **found}, indent=1))


if __name__ == "__main__":
    main()
