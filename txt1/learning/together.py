"""Learning by several robots: each learns by itself, and at a rate all take over what the others have learned.

The tables are merged number by number by their median, over those who have visited the state: so fewer than half may
lie as they like (D. Yin, Y. Chen, K. Ramchandran and P. Bartlett, "Byzantine-robust distributed learning", ICML 2018),
and who is lost is missing, and no more. Each keeps its own episodes and its own random values; its exploration
fades by the episodes of all whom it has heard, because shared tables spare no repetition while it goes on exploring
(each of n that learn in parallel needs a share of the repetitions: R. M. Kretchmar, "Parallel reinforcement learning",
SCI 2002). How many they were is not asked of them: each counts for as many as one's own, so nobody can lie about it.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config
from txt1.learning.qtable import Table
from txt1.learning.task import LearningTask, need_light
from txt1.learning.thesis import ThesisAgent, create
from txt1.learning.trial import AGENT, SENSORS, Episode, Trial, robot_config, starts, stream, task_of
from txt1.robot import Robot

Visits = NDArray[np.int_]  # how often each state was visited, shape (states,)


def merge(own: Table, tables: list[tuple[Table, Visits]]) -> Table:
    """The median of what was learned of each state by those who have been there, else one's own; as `own` in shape."""
    merged = own.copy()
    for state in range(len(own)):
        known = [table[state] for table, visits in tables if visits[state] > 0 and np.isfinite(table[state]).all()]
        if known:
            merged[state] = np.median(known, axis=0)
    return merged


class Shared:
    """What the robots of a team have told of their tables; `every` so many episodes each tells and takes over.

    `lies` makes of a robot's name and table what it tells; `lost` are the names of those who tell and hear nothing;
    `hurry` says whether exploration fades by the episodes of all, or by each one's own.
    """

    def __init__(
        self,
        agents: Mapping[str, ThesisAgent],
        every: int = 1,
        lies: Callable[[str, Table], Table] = lambda name, table: table,
        lost: frozenset[str] = frozenset(),
        hurry: bool = True,
    ) -> None:
        self._agents, self._every, self._lies, self._lost, self._hurry = agents, every, lies, lost, hurry
        self._told: dict[str, tuple[Table, Visits]] = {}

    def episode_over(self, name: str, episode: int) -> None:
        """Tell the others, and take over what they told, if it is time for that."""
        if episode % self._every or name in self._lost:
            return
        agent = self._agents[name]
        self._told[name] = self._lies(name, agent.q.copy()), agent.visits.copy()
        others = [told for other, told in self._told.items() if other != name]
        agent.q[:] = merge(agent.q, [(agent.q.copy(), agent.visits), *others])
        if self._hurry:
            agent.episode += len(others) * self._every


async def learn_together(
    config: Config,
    seed: int,
    names: list[str],
    episodes: int,
    share: Callable[[Mapping[str, ThesisAgent]], Shared] | None,
) -> dict[str, list[Episode]]:
    """Each robot's episodes: of the thesis's learner, in a world of its own, merged as `share` says (None: never)."""
    agents: dict[str, Any] = {
        name: create(config, stream(seed, number, AGENT)) for number, name in enumerate(names, start=1)
    }
    shared = None if share is None else share(agents)
    trials: dict[str, Trial] = {}
    async with AsyncExitStack() as stack:
        ended = []
        for number, name in enumerate(names, start=1):

            def done(one: Episode, name: str = name) -> None:
                if shared is not None:
                    shared.episode_over(name, one.number)

            own = robot_config(config, seed, number).model_copy(update={"name": name})
            trial = Trial(
                agents[name], task_of(config), starts(seed, number, episodes), config.learning.actions, done
            )  # fmt: skip
            robot = await stack.enter_async_context(Robot.open(config=own, arm=True))
            await need_light(robot, [seed, number, SENSORS])
            await robot.load_gains()
            learning = LearningTask(robot, trial)
            learning.start()
            trials[name] = trial
            ended.append(learning.ended.wait())
        await asyncio.gather(*ended)
    return {name: trial.episodes for name, trial in trials.items()}
