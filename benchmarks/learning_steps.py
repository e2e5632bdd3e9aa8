"""Vehicle steps (20 ms) and decisions a second of many simulated robots, beside gymnasium's own vectorised CartPole.

    python -m benchmarks.learning_steps [--threads N]

Needs the extras gym and fast. All get random actions, and their random generators are part of what is timed. A robot's
step has dynamics, both velocity loops, the encoders' quantisation and the floor's noise; "with light" adds four noisy,
filtered readings; "environment" is the whole vectorised environment with light, observations, rewards and new starts,
25 steps of 20 ms a decision. One thread for all, as CartPole has one; with N threads CartPole has N environments, each
in a thread of its own.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from statistics import median

import numpy as np
from gymnasium.envs.classic_control.cartpole import CartPoleVectorEnv

from txt1.control.parameters import Safety
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.processors import processors
from txt1.learning.batch import TICK_MS, Batch
from txt1.learning.drive_tasks import ToLight
from txt1.learning.env import DriveVectorEnv
from txt1.learning.trial import COMMANDS
from txt1.model.vehicle import Geometry
from txt1.sim.lamp import PointLight
from txt1.sim.parameters import VehicleParameters

COUNT, ROUNDS = 4000, 7
TICKS = round(1000.0 * ToLight.period) // TICK_MS  # vehicle steps of a decision


def robots(*, sense: bool) -> Callable[[], int]:
    """A round of the robots: twenty decisions of 0.5 s; returns the vehicle steps."""
    rng = np.random.default_rng(1)
    many = Batch(COUNT, PointLight(), 0.3, 0.03, VehicleParameters(), Geometry(), Safety())
    many.place(np.ones(COUNT, bool), rng.uniform(-2.0, 2.0, (COUNT, 3)), rng)
    commands = np.array(COMMANDS)

    def one_round() -> int:
        for _ in range(20):
            many.commands[:] = commands[rng.integers(0, 3, COUNT)]
            many.run(TICKS, rng, sense=sense)
        return 20 * TICKS * COUNT

    return one_round


def environment() -> Callable[[], int]:
    """A round of the environment: twenty decisions; returns the vehicle steps."""
    many = DriveVectorEnv(COUNT)
    many.reset(seed=1)
    rng = np.random.default_rng(1)

    def one_round() -> int:
        for _ in range(20):
            many.step(rng.integers(0, 3, COUNT))
        return 20 * TICKS * COUNT

    return one_round


def cart_poles(threads: int) -> Callable[[], int]:
    """A round of gymnasium's vectorised CartPole: 500 steps."""
    each = COUNT // threads
    poles = [CartPoleVectorEnv(each) for _ in range(threads)]
    rngs = [np.random.default_rng(k) for k in range(threads)]
    for k, some in enumerate(poles):
        some.reset(seed=k)

    def steps(k: int) -> None:
        for _ in range(500):
            poles[k].step(rngs[k].integers(0, 2, each))

    pool = ThreadPoolExecutor(threads)

    def one_round() -> int:
        list(pool.map(steps, range(threads)))
        return 500 * each * threads

    return one_round


def main() -> None:
    """Print the medians of interleaved rounds."""
    parser = argparse.ArgumentParser(prog="benchmarks.learning_steps")
    parser.add_argument("--threads", type=int, default=1, help="of each contestant; default: %(default)s")
    threads: int = parser.parse_args().threads
    os.sched_setaffinity(0, set(sorted(os.sched_getaffinity(0))[:threads]))
    print(f"{threads} thread(s) each on {processors()} processor(s); load {os.getloadavg()[0]:.1f}")
    contestants = {
        "CartPole": cart_poles(threads),
        "robots": robots(sense=False),
        "robots with light": robots(sense=True),
        "environment": environment(),
    }
    rates: dict[str, list[float]] = {name: [] for name in contestants}
    for one_round in contestants.values():
        one_round()  # compiled
    for _ in range(ROUNDS):
        for name, one_round in contestants.items():
            began = stopwatch_ns()
            steps = one_round()
            rates[name].append(steps * NS_PER_S / (stopwatch_ns() - began))
    for name, each in rates.items():
        line = f"{name:<18} {median(each) / 1e6:6.2f} ({min(each) / 1e6:.2f} to {max(each) / 1e6:.2f}) million steps/s"
        if name == "environment":
            line += f", {median(each) / TICKS / 1e3:.0f} thousand decisions/s"
        print(line)


if __name__ == "__main__":
    main()
