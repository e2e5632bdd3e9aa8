"""Driving tasks for learners, each defined once: what is seen, what is done, what it earns, how it begins and ends.

How it works. A task knows no simulator. `TaskView` is what is known of n robots at a decision, as arrays; a simulation
of one robot, one of thousands (`txt1.learning.env`) and the running robot (`txt1.learning.robot_env`) each make it. The
functions of a task compute n rows at once, so that all three give the same numbers by the same code.

*Reward.* Time costs and the goal pays. A decision of h seconds that brings the goal nearer by s metres earns

    s / speed - h,   + PAYS at the goal,   - COSTS for leaving the boundary or touching something

`speed` is the largest speed of the actions. The first term sums to the way from the start, whatever the path (A. Ng, D.
Harada and S. Russell, "Policy invariance under reward transformations", ICML 1999). So returns are ordered as times: a
circle costs its seconds and gains nothing, and to be lost is worse than to be late.

*Actions.* The light has the numbers of `learning.actions`. The other tasks have two numbers: the speed, 0 to 1 of
`safety.v_max`, and the steering, -1 (right) to 1 of full lock.
"""

from collections.abc import Mapping
from math import hypot, inf, log, pi
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config
from txt1.errors import ConfigError
from txt1.learning.settings import LearningConfig
from txt1.maps.files import file_of
from txt1.model.light_sensors import LUX_MAX

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Generator = np.random.Generator

# for the goal, and for leaving the boundary or touching something
PAYS, COSTS = 10.0, 60.0
# s, after which an episode is broken off
TIME_LIMIT: Final = 60.0
# of the laser, rad in the robot's frame
RAYS: Final = np.linspace(-2.0 * pi / 3.0, 2.0 * pi / 3.0, 37)
# m, beyond which a ray tells nothing
RAY_REACH: Final = 4.0
# m/s and rad/s, of an observation
FASTEST, SHARPEST = 5.0, 10.0


class TaskView(NamedTuple):
    """What is known of n robots at a decision."""

    # in the room, x, y in m and theta in rad, shape (n, 3)
    poses: Array
    # sensed v and omega, m/s and rad/s, shape (n, 2)
    velocities: Array
    # filtered readings FL FR RL RR, lux, shape (n, 4)
    lux: Array
    # along RAYS, m, infinite if nothing is there, shape (n, 37)
    ranges: Array
    # whether the body touches something, shape (n,)
    touched: Bools


class TaskOutcome(NamedTuple):
    """What came of a decision, shape (n,) each."""

    rewards: Array
    success: Bools
    # it left the boundary, or touched something
    lost: Bools


class DriveTask:
    """The base of a task for `count` robots; a task replaces `_sees`, `far`, `begin` and its constants."""

    name: ClassVar[str]
    # the sensors that it needs
    light: ClassVar[bool] = False
    laser: ClassVar[bool] = False
    # s, from one decision to the next
    period: ClassVar[float] = 0.1

    def __init__(self, config: Config, count: int = 1) -> None:
        self.config, self.count = config, count
        learning = config.section(LearningConfig)
        # v and omega by number, shape (actions, 2); None: the actions are speed and steering
        self.commands: Array | None = None
        self.speed = min(config.safety.v_max, 1.0)
        self.radius = config.geometry.radius_min
        self.boundary = learning.boundary
        self.time_limit = min(TIME_LIMIT, learning.time_limit)
        self.low, self.high = self._bounds()
        self._far = np.zeros(count)

    def driven(self, actions: NDArray[Any]) -> Array:
        """Return v and omega of n actions, m/s and rad/s, shape (n, 2); ValueError: an action is none of the task's."""
        given = np.asarray(actions)
        if self.commands is not None:
            whole = given.dtype.kind in "iu" and given.shape == (self.count,)
            if not whole or given.min() < 0 or given.max() >= len(self.commands):
                raise ValueError(f"actions {given!r}: give {self.count} numbers from 0 to {len(self.commands) - 1}")
            chosen: Array = self.commands[given]
            return chosen
        if given.shape != (self.count, 2) or not np.isfinite(given).all():
            raise ValueError(
                f"actions {given!r}: give {self.count} finite pairs, speed (0 to 1) and steering (-1 to 1)"
            )
        v = self.speed * np.clip(given[..., 0], 0.0, 1.0)
        return np.stack([v, np.clip(given[..., 1], -1.0, 1.0) * v / self.radius], axis=-1)

    def begun(self, seen: TaskView, which: Bools) -> None:
        """Note that the robots in `which` begin an episode now, from what is seen of them."""
        self._far = np.where(which, self.far(seen, which), self._far)

    def observed(self, seen: TaskView) -> NDArray[np.float32]:
        """Return the observations, shape (n, numbers)."""
        return np.minimum(np.maximum(self._sees(seen), self.low), self.high).astype(np.float32)

    def judged(self, seen: TaskView) -> TaskOutcome:
        """Return what came of the last decision."""
        far = self.far(seen, np.zeros(self.count, bool))
        outside = np.abs(seen.poses[:, :2]).max(axis=1) > self.boundary
        success = (far <= 0.0) & ~seen.touched
        lost = (outside | seen.touched) & ~success
        rewards = (self._far - far) / self.speed - self.period + PAYS * success - COSTS * lost
        self._far = far
        return TaskOutcome(rewards, success, lost)

    # -- what a task has of its own ------------------------------------------------------------------------------------

    def begin(self, count: int, rng: Generator) -> Array:
        """Return so many poses at which episodes begin, m and rad, shape (count, 3)."""
        raise NotImplementedError

    def far(self, seen: TaskView, fresh: Bools) -> Array:
        """Return how far the goal still is, m; 0 and less is at the goal. Robots in `fresh` begin an episode."""
        raise NotImplementedError

    def _sees(self, seen: TaskView) -> Array:
        raise NotImplementedError

    def _bounds(self) -> tuple[Array, Array]:
        """Return the least and the largest numbers of an observation."""
        raise NotImplementedError


class ToLight(DriveTask):
    """Find the light by four light sensors (thesis 5): logarithms of the readings over that of the limit, v, omega."""

    name, light, period = "light", True, 0.5

    def __init__(self, config: Config, count: int = 1) -> None:
        super().__init__(config, count)
        learning = config.section(LearningConfig)
        self.commands = np.array(learning.actions)
        self.speed = max(abs(v) for v, _ in learning.actions)
        self.goal, self.start_radius, self.place = learning.goal_radius, learning.start_radius, config.sim.room.light

    def begin(self, count: int, rng: Generator) -> Array:
        """Return poses on the circle around the light, of any heading."""
        return _around(self.place, np.full(count, self.start_radius), rng)

    def far(self, seen: TaskView, fresh: Bools) -> Array:
        """Return the distance to the goal circle."""
        away: Array = np.hypot(seen.poses[:, 0] - self.place[0], seen.poses[:, 1] - self.place[1])
        return away - self.goal

    def _sees(self, seen: TaskView) -> Array:
        # the bounds of an observation are those of the readings' logarithms, too
        return np.concatenate([np.log(np.maximum(seen.lux, 1.0)) / log(LUX_MAX), seen.velocities], axis=1)

    def _bounds(self) -> tuple[Array, Array]:
        return _with_velocities([0.0] * 4, [1.0] * 4)


class ToPose(DriveTask):
    """Drive to a pose, the origin: its place ahead and left in m, cosine and sine of its heading, v, omega.

    It begins 1 to 2.5 m away. It is there within 0.2 m and 20 degrees.
    """

    name = "pose"
    near, turned = 0.2, pi / 9.0

    def begin(self, count: int, rng: Generator) -> Array:
        """Return poses around the goal, of any heading."""
        return _around((0.0, 0.0), rng.uniform(1.0, 2.5, count), rng)

    def far(self, seen: TaskView, fresh: Bools) -> Array:
        """Return distance and turn still to go, as the way along the sharpest turn."""
        x, y, theta = seen.poses.T
        turn = np.abs(np.angle(np.exp(1j * theta)))
        away = np.maximum(np.hypot(x, y) - self.near, 0.0)
        to_go: Array = away + self.radius * np.maximum(turn - self.turned, 0.0)
        return to_go

    def _sees(self, seen: TaskView) -> Array:
        x, y, theta = seen.poses.T
        c, s = np.cos(theta), np.sin(theta)
        return np.column_stack([-c * x - s * y, s * x - c * y, c, -s, seen.velocities])

    def _bounds(self) -> tuple[Array, Array]:
        reach = 2.0 * self.boundary
        return _with_velocities([-reach, -reach, -1.0, -1.0], [reach, reach, 1.0, 1.0])


class LaserTask(DriveTask):
    """The base of a task by laser: ranges over RAY_REACH, v, omega."""

    laser = True

    def _sees(self, seen: TaskView) -> Array:
        return np.concatenate([np.minimum(seen.ranges, RAY_REACH) / RAY_REACH, seen.velocities], axis=1)

    def _bounds(self) -> tuple[Array, Array]:
        return _with_velocities([0.0] * len(RAYS), [1.0] * len(RAYS))


class AlongTrack(LaserTask):
    """Drive a lap of the track `sim.room.map` by laser.

    The map's centre line lies beside it as NAME_centerline.csv (x, y in m), which only rewards and ends use.
    """

    name = "track"

    def __init__(self, config: Config, count: int = 1) -> None:
        super().__init__(config, count)
        self.line = _centre_line(config)
        edges = np.roll(self.line, -1, axis=0) - self.line
        self._headings = np.arctan2(edges[:, 1], edges[:, 0])
        self._along = np.concatenate([[0.0], np.cumsum(np.hypot(*edges.T))])
        self.length = float(self._along[-1])
        self.boundary = inf
        # a lap at half the speed
        self.time_limit = min(2.0 * self.length / self.speed, config.section(LearningConfig).time_limit)
        self._at, self._left = np.zeros(count), np.zeros(count)

    def begin(self, count: int, rng: Generator) -> Array:
        """Return poses along the centre line, a little to its sides."""
        k = rng.integers(0, len(self.line), count)
        theta = self._headings[k] + rng.uniform(-0.2, 0.2, count)
        return np.column_stack([self.line[k], theta])

    def far(self, seen: TaskView, fresh: Bools) -> Array:
        """Return the way along the centre line that the lap still has."""
        nearest = ((seen.poses[:, None, :2] - self.line) ** 2).sum(axis=2).argmin(axis=1)
        at = self._along[nearest]
        moved = (at - self._at + 0.5 * self.length) % self.length - 0.5 * self.length
        self._left = np.where(fresh, self.length, self._left - moved)
        self._at = at
        return self._left.copy()


class KeepClear(LaserTask):
    """See `cells` squares of floor of half a metre without touching anything, by laser."""

    name = "clear"
    cells, side = 40, 0.5

    def __init__(self, config: Config, count: int = 1) -> None:
        super().__init__(config, count)
        self._been: list[set[tuple[int, int]]] = [set() for _ in range(count)]

    def begin(self, count: int, rng: Generator) -> Array:
        """Return poses in the room; those with too little room are drawn again."""
        room = self.config.sim.room
        reach = min(self.boundary, 0.5 * min(room.length, room.width)) - 0.5
        middle = (0.0, 0.0)
        if (walls := room.built().walls) is not None:
            reach, middle = 3.0, walls.freest()
        return np.column_stack([middle + rng.uniform(-reach, reach, (count, 2)), rng.uniform(-pi, pi, count)])

    def far(self, seen: TaskView, fresh: Bools) -> Array:
        """Return the squares that it has not seen yet, as a way."""
        for k, (i, j) in enumerate(np.floor(seen.poses[:, :2] / self.side).astype(int).tolist()):
            if fresh[k]:
                self._been[k] = set()
            self._been[k].add((i, j))
        return self.side * np.array([float(self.cells - len(each)) for each in self._been])


TASKS: Final[Mapping[str, type[DriveTask]]] = {each.name: each for each in (ToLight, ToPose, AlongTrack, KeepClear)}


def task_named(name: str, config: Config, count: int = 1) -> DriveTask:
    """Return a task by its name; ConfigError: there is none, or the configuration does not fit it."""
    if name not in TASKS:
        raise ConfigError(f"task: {name}: there is no such task; choose {', '.join(TASKS)}")
    return TASKS[name](config, count)


def _around(place: tuple[float, float], distance: Array, rng: Generator) -> Array:
    bearing, heading = rng.uniform(-pi, pi, (2, len(distance)))
    x, y = place[0] + distance * np.cos(bearing), place[1] + distance * np.sin(bearing)
    return np.column_stack([x, y, heading])


def _with_velocities(low: list[float], high: list[float]) -> tuple[Array, Array]:
    return np.array([*low, -FASTEST, -SHARPEST]), np.array([*high, FASTEST, SHARPEST])


def _centre_line(config: Config) -> Array:
    name = config.sim.room.map
    if name is None:
        raise ConfigError("sim.room.map: a track is followed on a map; set sim.room.map=oval, or another track")
    file = file_of(name)
    file = file.with_name(f"{file.stem}_centerline.csv")
    try:
        line = np.loadtxt(file, delimiter=",", usecols=(0, 1), comments="#", ndmin=2)
    except (OSError, ValueError) as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"sim.room.map: {name}: its centre line cannot be read: {told}; take another track") from None
    if len(line) > 3 and hypot(*(line[0] - line[-1])) < 1e-6:
        line = line[:-1]
    if len(line) < 3 or not np.isfinite(line).all():
        raise ConfigError(f"sim.room.map: {name}: its centre line has no three finite points; take another track")
    return np.array(line, float)
