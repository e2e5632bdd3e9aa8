"""Policies that choose an action from a row of Q-values; schedules of exploration and learning (thesis 5.2.1, 5.4).

All randomness comes from the generator that is passed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp
from typing import Any

import numpy as np
from numpy.typing import NDArray

Row = NDArray[np.floating[Any]]  # the Q-values of one state's actions


def boltzmann(q: Row, temperature: float) -> list[float]:
    """Probabilities of one state's actions, exp(Q / T) / sum of exp(Q / T) (5.2); q has the shape (actions,).

    The largest Q is subtracted first, which changes nothing in the quotient and keeps every exponent at or below 0: no
    temperature and no Q overflows. Towards T = 0 it is the greedy policy (5.4), towards infinity a uniform one (5.3).
    Plain numbers, as for so few of them an array costs ten times as much.
    """
    values: list[float] = q.tolist()
    largest = max(values)
    weights = [exp((value - largest) / temperature) for value in values]
    total = 0.0
    for weight in weights:  # sum() rounds otherwise from Python 3.12 on
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


def greedy_action(q: Row, rng: np.random.Generator) -> int:
    """The action with the largest Q-value, shape (actions,); of several that are equal, one drawn at random.

    At random, because the lowest index would favour turning right.
    """
    values: list[float] = q.tolist()
    largest = max(values)
    best = [action for action, value in enumerate(values) if value == largest]
    return best[0] if len(best) == 1 else int(rng.choice(best))


def fading(episode: int, start: float, decay: float, floor: float = 0.0) -> float:
    """Return start decay^k for episode k, from 0, but at least the floor: a temperature or a learning rate (5.4).

    The thesis's temperature is 5 x 0.65^k, at least 0.05, which k = 11 reaches; its learning rate does not decay. One
    that begins at 1 and decays is its outlook: full weight for what is new at first, less and less later (5.2.1).
    """
    return max(floor, start * decay**episode)


def state_learning_rate(visits: int) -> float:
    """Return the learning rate alpha of a state updated so many times before: 1 / (1 + visits / 10).

    It falls faster in a state that is visited more often (5.2.1). The sum of all rates grows without bound and that of
    their squares does not, which is what Q-learning's convergence asks for.
    """
    return 1.0 / (1.0 + visits / 10.0)
