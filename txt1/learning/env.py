"""The learning task as Gymnasium environments (extra `gym`).

    gymnasium.make("txt1.learning.env:txt1/LightSeeking-v0")      # Gymnasium imports the module before the colon

A step is a decision of the thesis's learner, 0.5 s.

- Observation: the logarithms of the four filtered readings over the logarithm of a sensor's upper limit, FL FR RL RR, 0
  to 1; and the sensed v (m/s) and omega (rad/s). Shape (6,), float32.
- Action: 0 right, 1 straight, 2 left (table 5.2).
- Reward: the thesis's, from one sector of the light's direction to the next (5.8): -1, 0 or 1.
- Terminated at the goal circle, outside the boundary, and by touching a post, a box or a wall (`info` says which);
  truncated after `time_limit` s.
- ``render_mode="rgb_array"``: a picture from above (`txt1.learning.picture`).

``make_vec(..., vectorization_mode="vector_entry_point")`` gives many robots at once (`txt1.learning.batch`), quick with
the extra `fast`. It does not model a delay, a world or dead sensors; with these settings it gives single environments
side by side. `txt1.learning.parallel_env` has several robots in one room.
"""

from contextlib import suppress
from math import hypot, inf, log, pi
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config, load
from txt1.control.limits import clip
from txt1.control.loops import loops_for
from txt1.control.pid import at_rest
from txt1.errors import ConfigError, LightFault, MissingExtra, NoDirection
from txt1.hal.base import Hal, Outputs
from txt1.hal.channels import rewired
from txt1.hal.registry import create_sim
from txt1.hal.sim import SimHal
from txt1.learning.batch import TICK_MS, Batch, only_ours
from txt1.learning.light_direction import LightFilter, direction, reward, sector
from txt1.learning.modelled_settings import BATCH, ONE, refuse_others
from txt1.learning.picture import Overview, picture
from txt1.learning.settings import LearningConfig
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.trial import Start, ready_to_learn, task_of
from txt1.learning.world import LightWorld, settled, world_of
from txt1.model.light_sensors import LUX_MAX, SENSOR_X, SENSOR_Y, Readings
from txt1.model.odometry import Odometry, WheelOdometry
from txt1.sim.batch import powered
from txt1.sim.lamp import PointLight, noise_for_jitter
from txt1.sim.world import World

try:
    import gymnasium
    from gymnasium.spaces import Box, Discrete
    from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
    from gymnasium.vector.utils import batch_space
except ModuleNotFoundError:
    raise MissingExtra("txt1.learning.env", "gym") from None

Observation = NDArray[np.float32]
Many = VectorEnv[Observation, NDArray[np.int64], NDArray[Any]]
DECISION_MS: Final = 500
# between two samples of the light, ms
LIGHT_MS: Final = 16
# random starts that are tried where something may be in the way
STARTS: Final = 200
# rest on the start before the first observation, ms: the filter settles
REST_MS: Final = 600
SPACE: Final = Box(np.array([0, 0, 0, 0, -2, -10], np.float32), np.array([1, 1, 1, 1, 2, 10], np.float32))


def _observe(readings: NDArray[np.float64], velocities: NDArray[np.float64]) -> Observation:
    """Observations, shape (..., 6)."""
    lux = np.log(np.clip(readings, 1.0, LUX_MAX)) / log(LUX_MAX)
    both: Observation = np.clip(np.concatenate([lux, velocities], axis=-1), SPACE.low, SPACE.high).astype(np.float32)
    return both


class EpisodeCar:
    """A simulated robot with its velocity loops and its odometry, and without its other tasks."""

    def __init__(self, hal: Hal, config: Config) -> None:
        self.command = (0.0, 0.0)
        self._hal = hal
        self._loops = loops_for(config.car, config.geometry)
        self._linear, self._schedule = config.control.linear.gains(), config.control.schedule()
        self._motor_max = config.safety.motor_max
        self._wheels = WheelOdometry(config.geometry)
        self.odometry: Odometry = self._wheels.odometry

    def pose(self, now: float) -> tuple[float, float, float]:
        """Return the true pose in the room at `now` s, m and rad."""
        pose = self._hal.read(now).pose
        assert pose is not None
        return pose

    def control(self, now: float) -> None:
        """Run the cycle of the controller and of the encoders at `now` s."""
        v, omega = self.command
        v_now, omega_now = self.odometry.v, self.odometry.omega
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
        self._wheels.step(counts, now)
        self.odometry = self._wheels.odometry


class Seeker:
    """A simulated robot on its way to the light, for the environments of one robot and of several.

    Raises ValueError: there is an obstacle at its start.
    """

    def __init__(self, config: Config, hal: SimHal, start: Start, rng: np.random.Generator) -> None:
        self.task = task_of(config)
        hal.place(*start.pose(self.task), 0.0)
        self._commands = config.section(LearningConfig).actions
        self._car = EpisodeCar(rewired(hal, config.channels, config.geometry.steering == "skid"), config)
        movers = hal.movers if config.sim.movers else tuple
        self._world = world_of(config, rng, movers) or LightWorld(config, rng, movers)
        self._world.begin(1)
        self._blocked_by = hal.blocked_by
        self._filter = LightFilter(spread=inf)
        # when each command reaches the robot, ms
        self._under_way: list[tuple[int, tuple[float, float]]] = []
        self._in_force = (0.0, 0.0)
        self._ms = 0
        self.way: list[tuple[float, float]] = []
        self.sector = 0
        self.touched = False

    def act(self, action: int) -> None:
        """Begin an action, given its number."""
        self._under_way.append((self._ms + round(1000.0 * self.task.delay), self._commands[action]))

    def stand(self) -> None:
        """Stand still from now on."""
        self._under_way, self._in_force = [], (0.0, 0.0)

    def tick(self) -> None:
        """Simulate a millisecond."""
        ms, now = self._ms, self._ms / 1000.0
        while self._under_way and self._under_way[0][0] <= ms:
            self._in_force = self._under_way.pop(0)[1]
        if ms % TICK_MS == 0:
            self._car.command = self._world.command(now, self._in_force)
            self._car.control(now)
            self.touched = self.touched or self._blocked_by() is not None
        if ms % LIGHT_MS == 0:
            pose = self._car.pose(now)
            self.way.append(pose[:2])
            self._look(self._world.see(now, pose))
        self._ms += 1

    def earned(self) -> float:
        """Return the reward of the last decision."""
        before, self.sector = self.sector, self._state(self.sector)
        return float(reward(before, self.sector))

    def rested(self) -> None:
        """End its rest at the start, and measure the light's direction."""
        self.sector = self._state(0)

    @property
    def pose(self) -> tuple[float, float, float]:
        """Its true pose, m and rad."""
        return self._car.pose(self._ms / 1000.0)

    @property
    def light(self) -> tuple[float, float]:
        """The place of its light, m."""
        return self._world.goal(self._ms / 1000.0)

    def outcome(self) -> tuple[bool, bool, bool]:
        """Return whether it is at the light, whether its episode is over, and whether its time is over."""
        (x, y, _), light = self.pose, self.light
        success = hypot(x - light[0], y - light[1]) <= self.task.goal_radius and not self.touched
        over = success or self.touched or max(abs(x), abs(y)) > self.task.boundary
        return success, over, self._ms - REST_MS >= 1000.0 * self.task.time_limit

    def _look(self, sample: Readings) -> None:
        """Take a sample; a reading that is no number counts as dark."""
        self._filter.step(Readings(*(lux if 0.0 <= lux < inf else 0.0 for lux in sample)))

    def _state(self, otherwise: int) -> int:
        assert self._filter.readings is not None
        try:
            return sector(direction(self._filter.readings))
        except (NoDirection, LightFault):
            # of a dead sensor, too
            return otherwise

    def observation(self) -> Observation:
        """The environment that the module describes."""
        assert self._filter.readings is not None
        told = self._world.odometry(self._ms / 1000.0, self._car.odometry)
        return _observe(np.array(self._filter.readings), np.array(told[3:]))


def placed(config: Config, rng: np.random.Generator, world: World | None = None) -> tuple[Seeker, Start]:
    """Return a robot at a random start with room; ConfigError: there is no room."""
    hal = create_sim(config.model_copy(update={"seed": int(rng.integers(2**32))}), world)
    for _ in range(STARTS):
        start = Start(*map(float, rng.uniform(-pi, pi, 2)))
        with suppress(ValueError):
            return Seeker(config, hal, start, rng), start
    raise ConfigError(
        f"learning.start_radius: {config.section(LearningConfig).start_radius:g}: something is in the way at every "
        "start that was tried; set another, or move sim.obstacles"
    )


def ready(config: Config | None) -> Config:
    """Return the checked configuration of an environment of single robots; raises ConfigError."""
    one = settled(load().config if config is None else config)
    refuse_others(one, ONE, "environments")
    refuse_unsolvable(one)
    return ready_to_learn(one)


def shows(render_mode: str | None) -> str | None:
    """Return the render mode; ConfigError: there is no mode of this name."""
    if render_mode not in (None, "rgb_array"):
        raise ConfigError(f"render_mode: {render_mode}: there is none such; set rgb_array, or leave it out")
    return render_mode


class LightSeekingEnv(gymnasium.Env[Observation, np.int64]):
    """One robot that looks for the light; see the module."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012 - as gymnasium has it

    def __init__(self, config: Config | None = None, render_mode: str | None = None) -> None:
        self.render_mode = shows(render_mode)
        self._config = ready(config)
        self.observation_space = SPACE
        self.action_space = Discrete(len(self._config.section(LearningConfig).actions))
        self._robot: Seeker

    @property
    def sector(self) -> int:
        """The sector of the light's direction."""
        return self._robot.sector

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode at rest on a random start; return its first observation."""
        super().reset(seed=seed, options=options)
        self._robot, start = placed(self._config, self.np_random)
        self._run(REST_MS)
        self._robot.rested()
        return self._robot.observation(), {"optimal_time": start.optimal_time(self._robot.task)}

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out a decision; return observation, reward, terminated, truncated and `info`.

        Raises ValueError: the action is not in the space.
        """
        if not self.action_space.contains(action):
            raise ValueError(f"action {action!r} is none of {self.action_space}")
        robot = self._robot
        robot.act(int(action))
        self._run(DECISION_MS)
        earned = robot.earned()
        success, over, late = robot.outcome()
        return robot.observation(), earned, over, late, {"success": success, "touched": robot.touched}

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture from above, shape (400, 400, 3); None without ``render_mode``."""
        if self.render_mode is None:
            return None
        robot = self._robot
        return picture(Overview(self._config, robot.light, [robot.pose], [robot.way]))

    def _run(self, duration_ms: int) -> None:
        """Simulate the robot for a time."""
        for _ in range(duration_ms):
            self._robot.tick()


class LightSeekingVectorEnv(Many):
    """Many robots, each with a light of its own; after an episode's end the next step begins a new one."""

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, config: Config | None = None) -> None:
        one = load().config if config is None else config
        only_ours(one)
        refuse_others(one, BATCH, "environments of many robots at once")
        refuse_unsolvable(one)
        commands = one.section(LearningConfig).actions
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = SPACE, Discrete(len(commands))
        self.observation_space = batch_space(SPACE, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._task = task_of(one)
        light, (x, y) = one.sim.light, self._task.light
        exponent = float(light.exponent)
        noise = noise_for_jitter(exponent=exponent, height=light.height) if light.noise is None else light.noise
        source = PointLight(x, y, light.intensity, exponent, light.height)
        vehicle = powered(one.sim.vehicle, one.sim.battery)
        self.robots = Batch(num_envs, source, noise, one.sim.noise.drag, vehicle, one.geometry, one.safety)
        self._commands = np.array(commands)
        self.sectors = np.zeros(num_envs, int)
        self.steps = np.zeros(num_envs, int)
        self._over = np.ones(num_envs, bool)
        # random starts of each robot, if each was given a seed
        self._own: list[np.random.Generator] = []

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Return the first observations, at rest on random starts.

        A list of seeds gives each robot its own random starts (None: a random seed), and all seeds together decide the
        noise. The option `reset_mask`, shape (num_envs,), restarts only the robots marked in it; the others go on.
        """
        if isinstance(seed, list):
            if len(seed) != self.num_envs:
                raise ValueError(f"{len(seed)} seeds for {self.num_envs} robots; give one for each")
            drawn = [np.random.SeedSequence(each) for each in seed]
            self._own = [np.random.default_rng(each) for each in drawn]
            self.np_random = np.random.default_rng(
                np.random.SeedSequence([int(each.generate_state(1)[0]) for each in drawn])
            )
        else:
            super().reset(seed=seed, options=options)
            if seed is not None:
                self._own = []
        mask = (options or {}).get("reset_mask")
        which = np.ones(self.num_envs, bool) if mask is None else np.asarray(mask)
        if which.shape != (self.num_envs,) or which.dtype != bool or not which.any():
            raise ValueError(f"reset_mask: give {self.num_envs} of true and false, at least one of them true")
        others, over = self.robots.robots[:, ~which].copy(), self._over & ~which
        self._over = which
        self._begin()
        # the others keep their state while the restarted robots rest
        if others.size:
            self.robots.run(REST_MS // TICK_MS, self.np_random)
            self.robots.robots[:, ~which] = others
        self._over = over
        self.sectors = np.where(which, self.states(), self.sectors)
        return self._observations(), {}

    def _begin(self) -> None:
        """Put robots whose episode is over on new starts; they rest while the others make a step."""
        count = int(self._over.sum())
        if not count:
            return
        bearing, heading = self.np_random.uniform(-pi, pi, (2, count))
        if self._own:
            bearing, heading = np.array([self._own[k].uniform(-pi, pi, 2) for k in np.flatnonzero(self._over)]).T
        x, y = self._task.light
        radius = self._task.start_radius
        poses = np.stack([x + radius * np.cos(bearing), y + radius * np.sin(bearing), heading], axis=1)
        rest = self._over
        self.robots.place(rest, poses, self.np_random)
        if rest.all():
            self.robots.run(REST_MS // TICK_MS, self.np_random)
        self.steps[rest] = 0

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Return observations, rewards, terminated, truncated and `success` of each robot after a decision.

        Raises ValueError: actions outside the space.
        """
        if not self.action_space.contains(np.asarray(actions)):
            raise ValueError(f"actions {actions!r} are not in {self.action_space}")
        fresh = self._over.copy()
        self.robots.commands[:] = self._commands[actions]
        # their command is 0, as their first step is the rest on the start
        self._begin()
        self.robots.run(DECISION_MS // TICK_MS, self.np_random)
        before, self.sectors = self.sectors, self.states()
        task = self._task
        poses = self.robots.poses
        success = np.hypot(poses[:, 0] - task.light[0], poses[:, 1] - task.light[1]) <= task.goal_radius
        lost = np.abs(poses[:, :2]).max(axis=1) > task.boundary
        self.steps += ~fresh
        terminated = (success | lost) & ~fresh
        truncated = (self.steps * DECISION_MS >= 1000.0 * task.time_limit) & ~fresh
        self._over = terminated | truncated
        rewards = np.where(fresh, 0.0, REWARDS[before, self.sectors])
        return self._observations(), rewards, terminated, truncated, {"success": success}

    def states(self) -> NDArray[np.int64]:
        """The sectors, as `txt1.learning.light_direction` computes them."""
        fl, fr, rl, rr = self.robots.readings.T
        angle = np.arctan2(SENSOR_Y * (fl + rl - fr - rr), SENSOR_X * (fl + fr - rl - rr))
        sectors: NDArray[np.int64] = ((np.floor(angle / (pi / 4.0) + 0.5) + 4) % 8).astype(np.int64)
        return sectors

    def _observations(self) -> Observation:
        return _observe(self.robots.readings, self.robots.velocities)


REWARDS: Final = np.array([[reward(s, s_next) for s_next in range(8)] for s in range(8)], float)


def many(num_envs: int = 1, config: Config | None = None, render_mode: str | None = None) -> Many:
    """Make many robots at once: in one fast simulation if it models the configuration, else side by side."""
    one = settled(load().config if config is None else config)
    try:
        if render_mode is None:
            return LightSeekingVectorEnv(num_envs, one)
    except ConfigError:
        refuse_others(one, ONE, "environments")
    return cast("Many", SyncVectorEnv([lambda: LightSeekingEnv(one, render_mode)] * num_envs))


if "txt1/LightSeeking-v0" not in gymnasium.registry:
    gymnasium.register(
        "txt1/LightSeeking-v0",
        entry_point=f"{__name__}:LightSeekingEnv",
        vector_entry_point=f"{__name__}:many",
    )
