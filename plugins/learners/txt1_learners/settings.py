"""Settings below ``learning`` that studies read; a learner's stand in its module."""

from typing import Any

from txt1.config import Section
from txt1.units import PositiveInt


class Change(Section):
    """A change of the world in mid-trial."""

    episode: PositiveInt
    """The first episode in which it is in force."""
    set: dict[str, Any]
    """The settings that change, by dotted key, as with --set."""


Changes = tuple[Change, ...]
"""``learning.changes``: changes of the simulated world in mid-trial, in trials in lockstep."""
Drift = dict[str, tuple[float, float]]
"""``learning.drift``: numbers that change slowly, by dotted key, with first and last value; in trials in lockstep."""
OfStableBaselines = dict[str, Any]
"""``learning.ppo`` and ``learning.dqn``: what Stable-Baselines3's learners are made with."""
