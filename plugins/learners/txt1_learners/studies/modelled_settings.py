"""The settings that trials in lockstep, floors and environments of Stable-Baselines3 model.

Any other is refused by its name, as `txt1.learning.modelled_settings` says.
"""

from collections.abc import Sequence
from functools import partial
from importlib.metadata import entry_points
from typing import Final

from txt1.config import Config
from txt1.learning import modelled_settings
from txt1.learning.modelled_settings import CAR, LOOPS, NAMES, SHOWN, TASK, VEHICLE, WHEELS
from txt1.learning.settings import GROUP, LearningConfig

CHANGING: Final = ("learning.changes", "learning.drift")
BROUGHT: Final = {f"learning.{name}" for name in entry_points(group=GROUP).names}
LEARNERS: Final = ("learning.thesis", "learning.options", *sorted(BROUGHT - {*CHANGING}))
FLOOR: Final = (
    *NAMES, *CAR, *WHEELS, *LOOPS, *VEHICLE, *TASK, *LEARNERS, "sim.light", "sim.room.light", "sensors",
    "learning.delay", "learning.time_limit", "learning.pose",
)  # fmt: skip
LOCKSTEP: Final = (*FLOOR, *SHOWN, *CHANGING, "learning.goal_period")
# environments of Stable-Baselines3, which know no episode's number
STEPS: Final = (*FLOOR, *SHOWN)


def refuse_others(config: Config, known: Sequence[str], who: str) -> None:
    """Refuse the settings that `who`, a simulation in words, does not model; ConfigError names the key."""
    modelled_settings.refuse_others(config, known, who, partial(_unseen, config, known is LOCKSTEP))


def lasers(config: Config) -> list[str]:
    """The names of the simulated laser scanners."""
    return [name for name, one in config.sensors.items() if one.driver == "sim_laser"]


def _unseen(config: Config, looks: bool, key: str) -> str:
    """Return why a setting of a sensor, or of the pose, is not modelled; a laser is where learners `look`."""
    if not key.startswith(("sensors", "learning.pose")) or _sees_plainly(config, key, looks):
        return ""
    return "know plain light sensors, and motion capture that learning.pose names, without options"


def _sees_plainly(config: Config, key: str, looks: bool) -> bool:
    """Whether a setting of a sensor, or of the pose, is modelled; a laser is where learners `look`."""
    learning = config.section(LearningConfig)
    if key == "learning.pose":
        told = config.sensors.get(learning.pose)
        return told is not None and told.driver == "sim_vicon"
    _, name, what = key.split(".")
    one = config.sensors[name]
    drivers = {learning.sensor: "sim_light", learning.pose: "sim_vicon"}
    known = drivers.get(name) == one.driver or (looks and lasers(config) == [name])
    return known and (what == "driver" or not getattr(one, what))
