"""The floor of a world: the best time that full knowledge reaches through the real loops and the goal's sampling.

By the light's symmetry a start is one number, the bearing of the light in the robot's frame; between the bearings that
were driven the time is interpolated before it is rounded up to a decision. Decisions are 0.1 s apart, whatever the
learner's own. The floors of known worlds are in floors.json; `studies/learners/floor.py` searches for others.
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

BEARINGS: Final = 120  # that are driven, 3 degrees apart
DECISION_MS: Final = 100  # between two looks for the goal
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
)  # keys of the configuration, or what they begin with


class Floor(NamedTuple):
    """The floor by the light's bearing in the robot's frame at the start."""

    times: tuple[float, ...]  # s, unrounded, for bearings from -pi on, evenly; inf: no plan reaches the goal
    gap: float  # mean share by which a third piece of the plan still brought the time down
    ways: tuple[float, ...] = ()  # m driven in these times; none in floors.json

    @property
    def exists(self) -> bool:
        """Whether the goal can be reached from everywhere."""
        return bool(np.isfinite(self.times).all())

    def time(self, start: Start) -> float:
        """The least time from a start, s, at a decision."""
        return float(np.ceil(self.exact(start) / (0.001 * DECISION_MS) - 1e-6)) * 0.001 * DECISION_MS

    def exact(self, start: Start) -> float:
        """The same were the goal looked for all the time, s."""
        return _between(self.times, start)

    def way(self, start: Start) -> float:
        """The way driven in that, m; NaN: not known."""
        return _between(self.ways, start) if self.ways else nan


def _between(values: Sequence[float], start: Start) -> float:
    """The value for a start, of values for bearings from -pi on."""
    bearing = (start.bearing + pi - start.heading + pi) % (2.0 * pi)
    return float(np.interp(bearing / (2.0 * pi) * BEARINGS, range(BEARINGS + 1), (*values, values[0])))


def known_floor(config: Config) -> Floor | None:
    """The floor of a world that was searched before (floors.json); None: studies/learners searches for it.

    None, too, where a world of its own or things in the way may have another one.
    """
    if config.section(LearningConfig).world is not None or config.sim.obstacles or config.sim.room.map is not None:
        return None
    known = json.loads(Path(__file__).with_name("floors.json").read_text(encoding="utf-8"))
    found = known.get(key_of(config))
    return None if found is None else Floor(tuple(found["times"]), found["gap"])


def key_of(config: Config) -> str:
    """All that a floor depends on and that is not its default, and the version of our physics, as a hash."""
    usual = dict(flatten(completed(Config())))
    told = {
        key: value for key, value in flatten(completed(config)) if key.startswith(DEPENDS) and usual.get(key) != value
    }
    told["version of the physics"] = VERSION
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]
