"""The floor of a world: the best time with full knowledge, through the real loops and with the goal's sampling.

By the light's symmetry a start is a single number, the bearing of the light in the robot's frame. Between the driven
bearings the time is interpolated, and then rounded up to a decision. Decisions are 0.1 s apart, whatever the learner's
period. The floors of known worlds are in floors.json; the plug-in txt1-learners searches for others.
"""

import hashlib
import json
from collections.abc import Sequence
from math import nan, pi
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from txt1.config import Config, completed, flatten
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import Start
from txt1.sim.dynamics import VERSION

# number of driven bearings, 3 degrees apart
DRIVEN_BEARINGS: Final = 120
# between two looks for the goal
DECISION_MS: Final = 100
# keys of the configuration, or what they begin with
DEPENDS: Final = (
    "geometry.",
    "sim.physics",
    "sim.vehicle.",
    "sim.battery.used_",
    "car.",
    "control.",
    "safety.motor_max",
    "learning.actions",
    "learning.start_radius",
    "learning.goal_radius",
    "learning.delay",
)


class Floor(NamedTuple):
    """The floor by the light's bearing in the robot's frame at the start."""

    # s, unrounded, for bearings from -pi on, evenly; inf: no plan reaches the goal
    times: tuple[float, ...]
    # mean share by which a third piece of the plan still shortened the time
    gap: float
    # way driven in these times, m; floors.json has none
    ways: tuple[float, ...] = ()

    @property
    def exists(self) -> bool:
        """Whether the goal can be reached from everywhere."""
        return bool(np.isfinite(self.times).all())

    def time(self, start: Start) -> float:
        """The least time from a start, s, rounded up to a decision."""
        return rounded_up(self.exact(start))

    def exact(self, start: Start) -> float:
        """The least time from a start if the goal is looked for all the time, s."""
        return _between(self.times, start)

    def way(self, start: Start) -> float:
        """The way driven in the least time, m; NaN: unknown."""
        return _between(self.ways, start) if self.ways else nan


def rounded_up(time: float) -> float:
    """Return a time, rounded up to a decision, s."""
    return float(np.ceil(time / (0.001 * DECISION_MS) - 1e-6)) * 0.001 * DECISION_MS


def _between(values: Sequence[float], start: Start) -> float:
    """Return the value for a start, interpolated between values for bearings from -pi on."""
    bearing = (start.bearing + pi - start.heading + pi) % (2.0 * pi)
    return float(np.interp(bearing / (2.0 * pi) * DRIVEN_BEARINGS, range(DRIVEN_BEARINGS + 1), (*values, values[0])))


def known_floor(config: Config) -> Floor | None:
    """The floor of a world that was searched before (floors.json); None: the plug-in txt1-learners searches for it.

    None, too, where a world of its own or things in the way may have another one.
    """
    if config.section(LearningConfig).world is not None or config.sim.obstacles or config.sim.room.map is not None:
        return None
    known = json.loads(Path(__file__).with_name("floors.json").read_text(encoding="utf-8"))
    found = known.get(key_of(config))
    return None if found is None else Floor(tuple(found["times"]), found["gap"])


def key_of(config: Config) -> str:
    """Return a hash of all that a floor depends on and that is not its default, and of our physics' version."""
    usual = dict(flatten(completed(Config())))
    told = {
        key: value for key, value in flatten(completed(config)) if key.startswith(DEPENDS) and usual.get(key) != value
    }
    told["version of the physics"] = VERSION
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]
