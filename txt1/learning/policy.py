"""Policies that choose an action from a row of Q-values; schedules of exploration and learning (thesis 5.2.1, 5.4).

All randomness comes from the generator that is passed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

Row = NDArray[np.floating[Any]]
"""The Q-values of one state's actions."""


# -- policies ----------------------------------------------------------------------------------------------------


def boltzmann(q: Row, temperature: float) -> list[float]:
    """Probabilities of one state's actions, exp(Q / T) / sum of exp(Q / T) (5.2); q has the shape (actions,).

    The largest Q is subtracted first, which changes nothing in the quotient and keeps every exponent at or below 0: no
    temperature and no Q overflows. Towards T = 0 it is the greedy policy (5.4), towards infinity a uniform one (5.3).

    Plain numbers, as for so few of them an array costs ten times as much.

    Raises:
        ValueError: T is not positive, or a Q-value is not finite.

    """
    if not temperature > 0.0:
        raise ValueError(f"a temperature is positive, not {temperature:g}")
    values: list[float] = q.tolist()
    _check(values)
    largest = max(values)
    weights = [exp((value - largest) / temperature) for value in values]
    total = 0.0
    for weight in weights:
        total += weight
    return [weight / total for weight in weights]


def choose(probabilities: Sequence[float], rng: np.random.Generator) -> int:
    """An action drawn with these probabilities: the one whose share of their cumulative sum holds a random number."""
    u = rng.random()
    cumulative = 0.0
    for action, probability in enumerate(probabilities):
        cumulative += probability
        if u < cumulative:
            return action
    return max(range(len(probabilities)), key=probabilities.__getitem__)  # the sum was rounded to a little less than 1


def boltzmann_action(q: Row, temperature: float, rng: np.random.Generator) -> int:
    """An action drawn from the Boltzmann distribution (5.2) of one state's Q-values, shape (actions,)."""
    return choose(boltzmann(q, temperature), rng)


def greedy_action(q: Row, rng: np.random.Generator) -> int:
    """The action with the largest Q-value, shape (actions,); of several that are equal, one drawn at random.

    At random, because the lowest index would favour turning right.

    Raises:
        ValueError: a Q-value is not finite.

    """
    values: list[float] = q.tolist()
    _check(values)
    largest = max(values)
    best = [action for action, value in enumerate(values) if value == largest]
    return best[0] if len(best) == 1 else int(rng.choice(best))


def random_action(actions: int, rng: np.random.Generator) -> int:
    """Any of so many actions, each as likely as the other, whatever has been learned."""
    return int(rng.integers(actions))


def _check(values: list[float]) -> None:
    """Refuse Q-values that no comparison can order."""
    for value in values:
        if not -inf < value < inf:
            raise ValueError(f"Q-values are finite numbers, not {values}")


# -- schedules ---------------------------------------------------------------------------------------------------


def temperature(episode: int, start: float = 5.0, decay: float = 0.65, floor: float = 0.05) -> float:
    """Temperature T = C alpha^k of episode k, from 0, but at least the floor (5.4): reached at k = 11."""
    return max(floor, start * decay**episode)


def learning_rate(episode: int, start: float = 0.3, decay: float = 1.0, floor: float = 0.0) -> float:
    """Learning rate alpha of episode k, from 0: start decay^k, but at least the floor.

    The default is the thesis's constant 0.3; start = 1 with a decay below 1 is its outlook, full weight for what is new
    at first and less and less later (5.2.1).
    """
    return max(floor, start * decay**episode)


def state_learning_rate(visits: int, start: float = 1.0, half: float = 10.0, floor: float = 0.0) -> float:
    """Learning rate alpha of a state updated so many times before: start / (1 + visits / half), at least the floor.

    It falls faster in a state that is visited more often (5.2.1), to half of the start after `half` visits. The sum of
    all rates grows without bound and that of their squares does not, which is what Q-learning's convergence asks for; a
    positive floor gives that up to keep learning after the training.
    """
    return max(floor, start / (1.0 + visits / half))
