"""The tasks of `txt1.learning.drive_tasks` as Gymnasium environments (extra `gym`), of one robot and of many.

docs/environments.md shows how they are made. How they work: `Bodies` are n simulated robots that can be placed, drive
on for a decision, and are seen. `Drives` lets them do episodes of a task: starts, observations, rewards and ends, as
arrays. Both environments are a thin form of it, so one robot and thousands have the same numbers.

- `ManyBodies` is quick (`txt1.learning.batch`, with the extra `fast`). It takes one robot, too.
- `OneBody` models more: a delay, worlds, dead sensors, obstacles that move. It is used where the configuration asks for
  something that `ManyBodies` lacks; many robots are then single environments side by side, and a warning says so.

`learning.randomised` changes the world from robot to robot: each number named there is drawn anew for each episode.

An episode ends at the goal, or where the robot is lost (`info["touched"]` if it touched something); it is truncated
after the task's time limit. ``render_mode="rgb_array"`` gives a picture from above.
"""

from contextlib import suppress
from dataclasses import replace
from math import inf
from typing import Any, ClassVar, Final, Protocol
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config, load
from txt1.config.sources import with_values
from txt1.control.limits import clip
from txt1.control.loops import loops_for
from txt1.control.pid import at_rest
from txt1.errors import ConfigError, LightFault, MissingExtra
from txt1.hal.base import Hal, Outputs
from txt1.hal.channels import rewired
from txt1.hal.registry import create_sim
from txt1.hal.sim import SimHal
from txt1.learning.batch import DRAG, NOISE, TICK_MS, Batch, only_ours, tell_slow
from txt1.learning.drive_tasks import RAYS, Array, Bools, DriveTask, Generator, TaskOutcome, TaskView, task_named
from txt1.learning.finite_readings import FiniteReadings
from txt1.learning.light_direction import LightFilter
from txt1.learning.modelled_settings import BATCH, ONE, refuse_others
from txt1.learning.picture import Overview, picture
from txt1.learning.settings import LearningConfig
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.trial import Start, ready_to_learn, task_of
from txt1.learning.world import NO_ROOM, LightWorld, settled, world_of
from txt1.model.light_sensors import Readings
from txt1.model.odometry import WheelOdometry
from txt1.sensors.sim_laser import standing
from txt1.sim.batch import powered
from txt1.sim.dynamics import dynamics
from txt1.sim.lamp import PointLight, noise_for_jitter
from txt1.sim.rays import cast
from txt1.sim.room import clearance
from txt1.sim.world import World

try:
    import gymnasium
    from gymnasium.spaces import Box, Discrete, Space
    from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
    from gymnasium.vector.utils import batch_space
except ModuleNotFoundError:
    raise MissingExtra("txt1.learning.env", "gym") from None

Observation = NDArray[np.float32]
# between two samples of the light, ms
LIGHT_MS: Final = 16
# random starts that are tried where something may be in the way
STARTS: Final = 200
# rest on the start before the first observation, ms: the filter settles
REST_MS: Final = 600
# of `learning.randomised`, those that many robots at once may differ in
OF_MANY: Final = ("sim.vehicle.", "sim.light.intensity", "sim.light.height", "sim.light.noise", "sim.noise.drag")


class Bodies(Protocol):
    """Robots that a task drives."""

    def place(self, which: Bools, poses: Array, rng: Generator) -> Bools:
        """Put the robots in `which` at rest at poses, shape (which.sum(), 3); return which of these have no room."""

    def rest(self, which: Bools, rng: Generator) -> None:
        """Let the robots in `which` stand on their starts for a while; the others do not move on."""

    def drive(self, commands: Array, duration: int, rng: Generator) -> None:
        """Drive on for `duration` ms by v and omega, m/s and rad/s, shape (n, 2)."""

    def seen(self) -> TaskView:
        """Return what is known of the robots now."""


class ManyBodies:
    """Robots side by side, each in a room of its own; see the module. ConfigError: a setting is not modelled."""

    def __init__(self, config: Config, task: DriveTask) -> None:
        only_ours(config)
        room = ("sim.room.map", "sim.room.length", "sim.room.width") if task.laser else ()
        refuse_others(config, (*BATCH, *room, "learning.randomised"), "environments of many robots at once")
        self.config, self._task = config, task
        self._ranges = config.section(LearningConfig).randomised
        if other := [key for key in self._ranges if not key.startswith(OF_MANY)]:
            raise ConfigError(f"learning.randomised: {other[0]}: many robots at once do not differ in it; leave it out")
        tell_slow()
        light, place = config.sim.light, config.sim.room.light
        exponent = float(light.exponent)
        noise = noise_for_jitter(exponent=exponent, height=light.height) if light.noise is None else light.noise
        self._source = PointLight(*place, light.intensity, exponent, light.height)
        self._vehicle = powered(config.sim.vehicle, config.sim.battery)
        geometry = config.geometry
        drag, differ = config.sim.noise.drag, bool(self._ranges)
        self.batch = Batch(task.count, self._source, noise, drag, self._vehicle, geometry, config.safety, differ)
        self._shapes, self._room = standing(config), config.sim.room.built()
        # what a laser and a bumper tell, and of whom it has to be looked at anew
        self._rays, self._touched = np.zeros((task.count, len(RAYS) * task.laser)), np.zeros(task.count, bool)
        self._moved = np.zeros(task.count, bool)

    def place(self, which: Bools, poses: Array, rng: Generator) -> Bools:
        """As `Bodies`."""
        for k in np.flatnonzero(which) if self._ranges else ():
            self._draw(int(k), rng)
        self.batch.place(which, poses, rng)
        self._moved |= which
        return self.seen().touched[which]

    def rest(self, which: Bools, rng: Generator) -> None:
        """As `Bodies`."""
        self.batch.run(REST_MS // TICK_MS, rng, sense=self._task.light, which=which)

    def drive(self, commands: Array, duration: int, rng: Generator) -> None:
        """As `Bodies`."""
        self.batch.commands[:] = commands
        self.batch.run(duration // TICK_MS, rng, sense=self._task.light)
        self._moved[:] = True

    def seen(self) -> TaskView:
        """As `Bodies`."""
        poses, moved = self.batch.poses, self._moved
        if self._task.laser and moved.any():
            body, places = self.config.geometry, poses[moved]
            self._rays[moved] = _ranges(places, self._shapes)
            clear = [clearance(x, y, theta, self._room, body) for x, y, theta in places.tolist()]
            self._touched[moved] = np.array(clear) < NO_ROOM
        moved[:] = False
        return TaskView(poses, self.batch.velocities, self.batch.readings, self._rays, self._touched.copy())

    def _draw(self, k: int, rng: Generator) -> None:
        """Give a robot a world of its own."""
        drawn = {key: float(rng.uniform(*each)) for key, each in self._ranges.items()}
        own = {key.rpartition(".")[2]: value for key, value in drawn.items() if key.startswith("sim.vehicle.")}
        source = self._source
        for name in ("intensity", "height"):
            source = source._replace(**{name: drawn.get(f"sim.light.{name}", getattr(source, name))})
        vehicle = dynamics(replace(self._vehicle, **own), self.config.geometry)
        self.batch.own[k, : len(vehicle) + len(source)] = *vehicle, *source
        for name, column in (("sim.light.noise", NOISE), ("sim.noise.drag", DRAG)):
            self.batch.own[k, column] = drawn.get(name, self.batch.own[k, column])


class EpisodeCar:
    """A simulated robot with its velocity loops and its odometry, and without its other tasks."""

    def __init__(self, hal: Hal, config: Config) -> None:
        self._hal = hal
        self._loops = loops_for(config.car, config.geometry)
        self._linear, self._schedule = config.control.linear.gains(), config.control.schedule()
        self._motor_max = config.safety.motor_max
        self.wheels = WheelOdometry(config.geometry)

    def pose(self, now: float) -> tuple[float, float, float]:
        """Return the true pose in the room at `now` s, m and rad."""
        pose = self._hal.read(now).pose
        assert pose is not None
        return pose

    def control(self, now: float, v: float, omega: float) -> None:
        """Run the cycle of the controller, by a command in m/s and rad/s, and of the encoders at `now` s."""
        v_now, omega_now = self.wheels.odometry.v, self.wheels.odometry.omega
        motor = steering = 0.0
        if at_rest(v, v_now):
            self._loops.clear()
        else:
            motor, steering = self._loops.step(
                v, omega, v_now, omega_now, self._linear, self._schedule.at(v_now), TICK_MS / 1000.0
            )
            motor = clip(motor, self._motor_max)
        self._hal.write(Outputs(int(motor), int(-steering), int(steering)), now)
        counts = self._hal.read(now).ticks
        assert counts is not None
        self.wheels.step(counts, now)


class OneBody:
    """A robot in the whole simulation, also among others in one room (`world`); see the module."""

    def __init__(self, config: Config, task: DriveTask, world: World | None = None) -> None:
        self.config, self._task, self._shared = config, task, world
        self._shapes = standing(config)
        self.way: list[tuple[float, float]] = []
        self._hal: SimHal | None = None

    def place(self, which: Bools, poses: Array, rng: Generator) -> Bools:
        """As `Bodies`."""
        config = self.config
        if ranges := config.section(LearningConfig).randomised:
            config = with_values(config, {key: float(rng.uniform(*each)) for key, each in ranges.items()})
        if self._hal is None or self._shared is None:
            seeded = config.model_copy(update={"seed": int(rng.integers(2**32))})
            self._hal = create_sim(seeded, self._shared)
        with suppress(ValueError):
            x, y, theta = poses[0].tolist()
            self._hal.place(x, y, theta, 0.0)
            self._begin(config, self._hal, rng)
            return np.array([self.touched])
        return np.array([True])

    def _begin(self, config: Config, hal: SimHal, rng: Generator) -> None:
        movers = hal.movers if config.sim.movers else tuple
        self._car = EpisodeCar(rewired(hal, config.channels, config.geometry.steering == "skid"), config)
        self._world = world_of(config, rng, movers) or LightWorld(config, rng, movers)
        self._world.begin(1)
        self._filter, self._gate = LightFilter(spread=inf), FiniteReadings()
        # when each command reaches the robot, ms
        self._under_way: list[tuple[int, tuple[float, float]]] = []
        self._in_force, self._ms, self.way = (0.0, 0.0), 0, []
        self.touched = hal.blocked_by() is not None

    def act(self, v: float, omega: float) -> None:
        """Begin an action; it reaches the robot after the configured delay."""
        late = round(1000.0 * self.config.section(LearningConfig).delay)
        self._under_way.append((self._ms + late, (v, omega)))

    def stand(self) -> None:
        """Stand still from now on."""
        self._under_way, self._in_force = [], (0.0, 0.0)

    def rest(self, which: Bools, rng: Generator) -> None:
        """As `Bodies`."""
        self.drive(np.zeros((1, 2)), REST_MS, rng)

    def drive(self, commands: Array, duration: int, rng: Generator) -> None:
        """As `Bodies`."""
        self.act(*commands[0].tolist())
        for _ in range(duration):
            self.tick()

    def tick(self) -> None:
        """Simulate a millisecond."""
        assert self._hal is not None
        ms, now = self._ms, self._ms / 1000.0
        while self._under_way and self._under_way[0][0] <= ms:
            self._in_force = self._under_way.pop(0)[1]
        if ms % TICK_MS == 0:
            self._car.control(now, *self._world.command(now, self._in_force))
            self.touched = self.touched or self._hal.blocked_by() is not None
        if ms % LIGHT_MS == 0:
            pose = self._car.pose(now)
            self.way.append(pose[:2])
            with suppress(LightFault):
                passed = self._gate.readings(now, self._world.see(now, pose))
                self._filter.step(Readings(0.0, 0.0, 0.0, 0.0) if passed is None else passed)
        self._ms += 1

    def seen(self) -> TaskView:
        """As `Bodies`; the place is told in the frame of the light, which a world may move."""
        now = self._ms / 1000.0
        poses = np.array([self.pose])
        told = self._world.odometry(now, self._car.wheels.odometry)
        lux = np.array([self._filter.readings or (0.0, 0.0, 0.0, 0.0)])
        ranges = _ranges(poses, self._shapes) if self._task.laser else np.empty((1, 0))
        if self._task.light:
            poses[0, :2] += np.array(self.config.sim.room.light) - self.light
        return TaskView(poses, np.array([told[3:]]), lux, ranges, np.array([self.touched]))

    @property
    def pose(self) -> tuple[float, float, float]:
        """Its true pose, m and rad."""
        return self._car.pose(self._ms / 1000.0)

    @property
    def light(self) -> tuple[float, float]:
        """The place of its light, m."""
        return self._world.goal(self._ms / 1000.0)


class Drives:
    """Episodes of a task on some robots; see the module."""

    def __init__(self, task: DriveTask, bodies: Bodies) -> None:
        self.task, self.bodies = task, bodies
        # decisions since the start of each episode
        self.steps = np.zeros(task.count, int)
        self.touched = np.zeros(task.count, bool)

    def place(self, which: Bools, rng: Generator) -> None:
        """Put robots on starts with room; ConfigError: there is none."""
        left = which.copy()
        for _ in range(STARTS):
            places = np.flatnonzero(left)
            left[places] = self.bodies.place(left, self.task.begin(len(places), rng), rng)
            if not left.any():
                break
        else:
            raise ConfigError(
                "learning.start_radius: something is in the way at every start that was tried; set another, or move "
                "sim.obstacles"
            )
        self.steps[which] = 0

    def begin(self, which: Bools) -> NDArray[np.float32]:
        """Begin the episodes of robots that have rested on their starts; return all observations."""
        seen = self.bodies.seen()
        self.task.begun(seen, which)
        return self.task.observed(seen)

    def decide(self, commands: Array, rng: Generator, resting: Bools) -> tuple[NDArray[np.float32], TaskOutcome, Bools]:
        """Drive on by a decision; return observations, what came of it, and whose time is over.

        Robots in `resting` stand, and begin their episodes with it.
        """
        self.bodies.drive(np.where(resting[:, None], 0.0, commands), round(1000.0 * self.task.period), rng)
        return self.judged(resting)

    def judged(self, resting: Bools) -> tuple[NDArray[np.float32], TaskOutcome, Bools]:
        """Return as `decide`, after the robots have driven on."""
        task, seen = self.task, self.bodies.seen()
        self.touched = seen.touched
        judged = task.judged(seen)
        moves = ~resting
        self.steps += moves
        late = self.steps * task.period >= task.time_limit - 1e-9
        if resting.any():
            task.begun(seen, resting)
            judged = TaskOutcome(np.where(resting, 0.0, judged.rewards), judged.success & moves, judged.lost & moves)
        return task.observed(seen), judged, late


class DriveEnv(gymnasium.Env[Observation, Any]):
    """One robot that does a task; see the module."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 2}  # type: ignore[misc]

    def __init__(self, task: str = "light", config: Config | None = None, render_mode: str | None = None) -> None:
        self.render_mode = shows(render_mode)
        one = settled(load().config if config is None else config)
        made = task_named(task, one)
        bodies: ManyBodies | OneBody
        try:
            if one.sim.obstacles or one.sim.movers or self.render_mode:
                raise ConfigError("they are in the whole simulation alone")
            bodies = ManyBodies(one, made)
        except ConfigError:
            one = ready(one, task)
            made = task_named(task, one)
            bodies = OneBody(one, made)
        if task == "light":
            refuse_unsolvable(one)
        self.drives, self._config = Drives(made, bodies), one
        self.observation_space, self.action_space = spaces(made)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode at rest on a random start; return its first observation."""
        super().reset(seed=seed, options=options)
        drives, one = self.drives, np.ones(1, bool)
        drives.place(one, self.np_random)
        drives.bodies.rest(one, self.np_random)
        first = drives.begin(one)[0]
        if not isinstance(drives.task.commands, np.ndarray):
            return first, {}
        pose = drives.bodies.seen().poses[0]
        return first, {"optimal_time": start_of(pose, self._config).optimal_time(task_of(self._config))}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out a decision; return observation, reward, terminated, truncated and `info`; raises ValueError."""
        drives = self.drives
        commands = drives.task.driven(np.asarray(action)[None])
        seen, (rewards, success, lost), late = drives.decide(commands, self.np_random, np.zeros(1, bool))
        told = {"success": bool(success[0]), "touched": bool(drives.touched[0])}
        return seen[0], float(rewards[0]), bool(success[0] | lost[0]), bool(late[0]), told

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture from above, shape (400, 400, 3); None without ``render_mode``."""
        body = self.drives.bodies
        if self.render_mode is None or not isinstance(body, OneBody):
            return None
        return picture(Overview(self._config, body.light, [body.pose], [body.way]))


class DriveVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """Many robots, each in a room of its own; after an episode's end the next step begins a new one."""

    metadata: ClassVar[dict[str, Any]] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # type: ignore[misc]

    def __init__(self, num_envs: int = 1, task: str = "light", config: Config | None = None) -> None:
        one = settled(load().config if config is None else config)
        made = task_named(task, one, num_envs)
        self.num_envs = num_envs
        self.bodies = ManyBodies(one, made)
        if task == "light":
            refuse_unsolvable(one)
        self.drives = Drives(made, self.bodies)
        self.single_observation_space, self.single_action_space = spaces(made)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.ones(num_envs, bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Return the first observations, at rest on random starts.

        The option `reset_mask`, shape (num_envs,), restarts only the robots marked in it; the others go on.
        """
        super().reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        which = np.ones(self.num_envs, bool) if mask is None else np.asarray(mask)
        if which.shape != (self.num_envs,) or which.dtype != bool or not which.any():
            raise ValueError(f"reset_mask: give {self.num_envs} of true and false, at least one of them true")
        self.drives.place(which, self.np_random)
        self.bodies.rest(which, self.np_random)
        self._over = self._over & ~which
        return self.drives.begin(which), {}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Return observations, rewards, terminated, truncated and `success` after a decision; raises ValueError."""
        commands = self.drives.task.driven(actions)
        resting = self._over
        if resting.any():
            self.drives.place(resting, self.np_random)
        seen, (rewards, success, lost), late = self.drives.decide(commands, self.np_random, resting)
        terminated = success | lost
        self._over = terminated | late
        return seen, rewards, terminated, late, {"success": success}


def start_of(pose: Array, config: Config) -> Start:
    """Return the start of an episode at a pose."""
    x, y = config.sim.room.light
    return Start(float(np.arctan2(pose[1] - y, pose[0] - x)), float(pose[2]))


def spaces(task: DriveTask) -> tuple[Space[Any], Space[Any]]:
    """Return the spaces of a task's observations and actions."""
    seen = Box(task.low.astype(np.float32), task.high.astype(np.float32))
    if task.commands is not None:
        return seen, Discrete(len(task.commands))
    return seen, Box(np.array([0.0, -1.0], np.float32), np.array([1.0, 1.0], np.float32))


def ready(config: Config | None, task: str = "light") -> Config:
    """Return the checked configuration of an environment of single robots; raises ConfigError."""
    one = settled(load().config if config is None else config)
    refuse_others(one, ONE, "environments")
    if task != "light":
        return one
    refuse_unsolvable(one)
    return ready_to_learn(one)


def shows(render_mode: str | None) -> str | None:
    """Return the render mode; ConfigError: there is no mode of this name."""
    if render_mode not in (None, "rgb_array"):
        raise ConfigError(f"render_mode: {render_mode}: there is none such; set rgb_array, or leave it out")
    return render_mode


def _ranges(poses: Array, shapes: Any) -> Array:
    """Return the ranges along RAYS from poses, shape (n, rays), m."""
    x, y, theta = (np.repeat(each, len(RAYS)) for each in poses.T)
    return cast(x, y, theta + np.tile(RAYS, len(poses)), shapes).reshape(len(poses), len(RAYS))


def many(
    num_envs: int = 1, task: str = "light", config: Config | None = None, render_mode: str | None = None
) -> VectorEnv[Any, Any, Any]:
    """Make many robots at once: in one fast simulation if it models the configuration, else side by side."""
    one = settled(load().config if config is None else config)
    if task == "light":
        refuse_unsolvable(one)
    why = "render_mode: rgb_array: many robots at once show no picture"
    try:
        if render_mode is None:
            return DriveVectorEnv(num_envs, task, one)
    except ConfigError as error:
        refuse_others(one, ONE, "environments")
        why = str(error)
    warn(f"{num_envs} single environments side by side, which is slower: {why}", RuntimeWarning, stacklevel=2)
    return SyncVectorEnv([lambda: DriveEnv(task, one, render_mode)] * num_envs)


for _name, _usual in {"txt1/LightSeeking-v0": {"task": "light"}, "txt1/Drive-v0": {}}.items():
    if _name not in gymnasium.registry:
        gymnasium.register(_name, f"{__name__}:DriveEnv", vector_entry_point=f"{__name__}:many", kwargs=_usual)
