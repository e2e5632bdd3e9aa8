"""A learner over many seeds, on the bare simulation (txt1.learning.bench): times, success, ratio to the optimum.

    python -m benchmarks.learning_study --agent sweeps --trials 1000 --seed 1 --jobs 2 --permute

Trials run through the same physics, loops and instants as `txt1 learn`, without the robot's tasks. Seed 77 served for
tuning; the figures in docs/learning.md are seed 1's. With --permute, every trial's agent gets the three actions in a
secret order of its own. The thesis's own table from 1000 random starts: --agent table_5_3 --trials 100 --reps 10.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np

from txt1.config import Config, load
from txt1.learning.agent import Agent
from txt1.learning.agents import NAMES
from txt1.learning.conduct import AGENT, on_bench, stream
from txt1.learning.metrics import summary
from txt1.learning.qtable import TABLE_5_3
from txt1.learning.thesis import Settings, ThesisAgent
from txt1.learning.trial import COMMANDS, Repetition

STORED = "table_5_3"
"""Not a learner: the thesis's table, driven greedily."""
ORDER = 9
"""The stream of random numbers that orders the actions."""


def trial(number: int, agent: str, config: Config, seed: int, reps: int, permute: bool) -> list[Repetition]:
    """The repetitions of one trial."""
    order = stream(seed, number, ORDER).permutation(len(COMMANDS)) if permute else np.arange(len(COMMANDS))
    commands = tuple(COMMANDS[k] for k in order)
    learner: Agent | str = agent
    if agent == STORED:
        learner = ThesisAgent(
            stream(seed, number, AGENT), COMMANDS, Settings(policy="greedy", training=0, learn_on=False)
        )
        learner.q = np.array(TABLE_5_3)
    return on_bench(learner, config, seed, number, reps, commands=commands).repetitions


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its figures as JSON."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learning_study", description=__doc__.split("\n")[0])
    parser.add_argument("--agent", choices=(*NAMES, STORED), default="sweeps")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="number of the first trial")
    parser.add_argument("--reps", type=int, default=31)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--permute", action="store_true")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args(argv)
    config = load(None, arguments.set).config
    work = partial(trial, agent=arguments.agent, config=config, seed=arguments.seed, reps=arguments.reps,
                   permute=arguments.permute)  # fmt: skip
    numbers = range(arguments.first, arguments.first + arguments.trials)
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        trials = list(pool.map(work, numbers, chunksize=4))
    print(json.dumps({"command": vars(arguments), **summary(trials)}, indent=1))


if __name__ == "__main__":
    main()
