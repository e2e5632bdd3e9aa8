"""Vehicle steps (20 ms) a second of many simulated robots, beside gymnasium's own vectorised CartPole.

    python -m benchmarks.learning_steps

Needs the extras gym and fast. Both get random actions, and their random generators are part of what is timed. The
robots' step has dynamics, both velocity loops, the encoders' quantisation and the floor's noise; "with light" adds four
noisy, filtered readings.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median

import numpy as np
from gymnasium.envs.classic_control.cartpole import CartPoleVectorEnv

from txt1.control.parameters import Safety
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.learning.batch import Batch
from txt1.learning.trial import COMMANDS
from txt1.model.vehicle import Geometry
from txt1.sim.light import PointLight
from txt1.sim.parameters import VehicleParameters

COUNT, TICKS, ROUNDS = 4000, 25, 7


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


def cart_poles() -> Callable[[], int]:
    """A round of gymnasium's vectorised CartPole: 500 steps."""
    poles = CartPoleVectorEnv(COUNT)
    poles.reset(seed=1)
    rng = np.random.default_rng(1)

    def one_round() -> int:
        for _ in range(500):
            poles.step(rng.integers(0, 2, COUNT))
        return 500 * COUNT

    return one_round


def main() -> None:
    """Print the medians of interleaved rounds."""
    contestants = {"CartPole": cart_poles(), "robots": robots(sense=False), "robots with light": robots(sense=True)}
    rates: dict[str, list[float]] = {name: [] for name in contestants}
    for one_round in contestants.values():
        one_round()  # compiled
    for _ in range(ROUNDS):
        for name, one_round in contestants.items():
            began = stopwatch_ns()
            steps = one_round()
            rates[name].append(steps * NS_PER_S / (stopwatch_ns() - began))
    for name, each in rates.items():
        print(f"{name:<18} {median(each) / 1e6:6.2f} ({min(each) / 1e6:.2f} to {max(each) / 1e6:.2f}) million steps/s")


if __name__ == "__main__":
    main()
