"""The world that a learner sees, as a small class: composed, of the plug-in txt1-learners, or another package's.

A package announces its class in its pyproject.toml::

    [project.entry-points."txt1.worlds"]
    mine = "mypackage.mine:Mine"

where ``Mine(config, rng)`` derives from `LightWorld` and replaces the methods that differ.
``learning.world=mine`` asks for it, and its own settings come in ``learning.world_options``. The running robot, the
environments and trials in lockstep (the plug-in txt1-learners) each make one for every robot, and ask all of it.
Whatever it raises becomes one line with its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, Final

from txt1.config.sources import with_values
from txt1.errors import ConfigError, Txt1Error
from txt1.learning.checked_learner import blaming
from txt1.learning.settings import LearningConfig
from txt1.model.light_sensors import SENSORS, Readings
from txt1.model.odometry import Odometry
from txt1.plugins import Registry
from txt1.sensors.light import eyes
from txt1.sim.parameters import Box

if TYPE_CHECKING:
    import numpy as np

    from txt1.config import Config

# in the room, m and rad
Pose = tuple[float, float, float]
# v and omega, m/s and rad/s
Command = tuple[float, float]

# m: with less room than this the robot touches what is there
NO_ROOM: Final = 0.02


class LightWorld:
    """The world of the configuration, one object for each robot; other worlds derive from it.

    Times are s since the robot was put on its start. Every random value comes from `rng`, so that trials repeat.
    """

    def __init__(self, config: Config, rng: np.random.Generator, movers: Callable[[], Sequence[Box]] = tuple) -> None:
        self.config, self.rng = config, rng
        self._eyes = eyes(config, rng, movers=movers)

    @staticmethod
    def settings(config: Config) -> Mapping[str, Any]:
        """Values of the configuration that it brings, by dotted key: obstacles, actions, the vehicle, the floor."""
        return {}

    def begin(self, episode: int) -> None:
        """Episode number `episode`, from 1, begins: the robot is on its start, and times count from 0."""

    def see(self, now: float, pose: Pose) -> Readings:
        """A sample of the four sensors, lux, at a pose; once every 16 ms."""
        return self._eyes(pose)

    def odometry(self, now: float, odometry: Odometry) -> Odometry:
        """Return odometry for the learner; called with each sample of the light and at each decision."""
        return odometry

    def command(self, now: float, command: Command) -> Command:
        """Return a command as it reaches the robot."""
        return command

    def goal(self, now: float) -> tuple[float, float]:
        """Where the light is that is to be reached, m."""
        return self.config.sim.room.light


WORLDS: Final = Registry("world", "txt1.worlds", {})


def named(config: Config) -> str | None:
    """The name of the world that is asked for; ConfigError: there are options for none."""
    one = config.section(LearningConfig)
    if one.world is None and one.world_options:
        raise ConfigError(
            f"learning.world_options: {one.world_options}: no world is asked for; set learning.world=composed, or "
            "that of a package"
        )
    if one.world is not None and one.sensor in config.sensors:
        raise ConfigError(
            f"sensors.{one.sensor}: the world '{one.world}' says what light sensors see; take the sensor out, or "
            "leave out learning.world"
        )
    return one.world


def settled(config: Config) -> Config:
    """Return the configuration with its world's settings; ConfigError, Txt1Error: no such world, or it fails."""
    name = named(config)
    if name is None:
        return config
    kind, place = WORLDS.find("learning.world", name)
    with blaming(f"the world '{name}' ({place})", "settings"):
        values = kind.settings(config)  # type: ignore[attr-defined]
    return with_values(config, values) if values else config


def world_of(
    config: Config, rng: np.random.Generator, movers: Callable[[], Sequence[Box]] = tuple
) -> LightWorld | CheckedWorld | None:
    """Return one robot's world for a `settled` configuration; None: it has no world."""
    name = named(config)
    if name is None:
        return None
    made = WORLDS.make("learning.world", name, config, rng, *(() if movers is tuple else (movers,)))
    return CheckedWorld(made, f"the world '{name}' ({WORLDS.place('learning.world', name)})")


class CheckedWorld:
    """A `LightWorld` whose errors name it, and whose answers are looked at: numbers where they belong."""

    def __init__(self, world: LightWorld, who: str) -> None:
        self.world, self.who = world, who
        if missing := [name for name in vars(LightWorld) if not name.startswith("_") and not hasattr(world, name)]:
            raise Txt1Error(f"{who} is no txt1.learning.world.LightWorld: it has no {', '.join(missing)}")

    def begin(self, episode: int) -> None:
        """As of a world."""
        with blaming(self.who, "begin"):
            self.world.begin(episode)

    def see(self, now: float, pose: Pose) -> Readings:
        """As of a world; a sensor may read NaN."""
        return Readings(*self._numbers("see", len(SENSORS), False, now, pose))

    def odometry(self, now: float, odometry: Odometry) -> Odometry:
        """As of a world."""
        return Odometry(*self._numbers("odometry", 5, True, now, odometry))

    def command(self, now: float, command: Command) -> Command:
        """As of a world."""
        v, omega = self._numbers("command", 2, True, now, command)
        return v, omega

    def goal(self, now: float) -> tuple[float, float]:
        """As of a world."""
        x, y = self._numbers("goal", 2, True, now)
        return x, y

    def _numbers(self, name: str, count: int, finite: bool, *given: Any) -> list[float]:
        with blaming(self.who, name):
            told = getattr(self.world, name)(*given)
        try:
            numbers = [float(each) for each in told]
        except (TypeError, ValueError):
            numbers = []
        if len(numbers) != count or (finite and not all(map(isfinite, numbers))):
            raise Txt1Error(
                f"{self.who}: {name} returned {told!r}; return {count} {'finite ' if finite else ''}numbers"
            )
        return numbers
