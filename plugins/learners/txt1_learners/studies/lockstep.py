"""Trials of one world side by side: the same task and the same learners as on the running robot, many times as fast.

The vehicles move by `txt1.sim.batch`, their loops and encoders run as in `txt1.learning.batch`, the light is sampled
every 16 ms, and a `Trial` each tells the learners when to act. Nothing else of the robot is there. All trials do their
first episode, then all their second, so that a world which changes in mid-trial changes for everyone alike. Trials
repeat bit for bit from the seed and their numbers. Decisions are multiples of 0.1 s apart.

What a world of its own shows (`txt1.learning.world`), and the shadows of what stands about, is asked for sample by
sample. Who touches something has failed: bodies do not stop one another here.

numba makes it quick (extra `fast`). Without numba it is the same, slowly.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import cos, inf, nan, pi, sin
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1 import Odometry
from txt1.config import Config
from txt1.config.sources import with_values
from txt1.control.car import CarParameters, car_of
from txt1.control.pid import Gains
from txt1.errors import ConfigError
from txt1.learning.agent import Agent, Looker
from txt1.learning.batch import COUNT, OUTPUT, PHASE, ROWS, SENSED, TICK_MS, UNKNOWN, control, encode, only_ours
from txt1.learning.best_time import DECISION_MS
from txt1.learning.settings import LearningConfig
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.trial import AGENT, SENSORS, Phase, Trial, starts, stream, task_of
from txt1.learning.world import NO_ROOM, CheckedWorld, LightWorld, Pose, settled, world_of
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, Mount, Readings, SensorFault
from txt1.sensors.sim_laser import LaserParameters, SimulatedLaser
from txt1.sensors.sim_vicon import TrackerErrors
from txt1.sim.batch import LEFT, RIGHT, THETA, Array, X, Y, move, powered
from txt1.sim.dynamics import Dynamics, dynamics
from txt1.sim.lamp import PointLight, lux_at, noise_for_jitter
from txt1.sim.machine_code import compiled
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Box
from txt1.sim.rays import shapes_of, walls_of
from txt1.sim.room import clearance
from txt1_learners.settings import Changes, Drift
from txt1_learners.studies.modelled_settings import LOCKSTEP, lasers, refuse_others

LIGHT_MS: Final = 16  # between two samples of the light
REST_MS: Final = 500  # on the start, before the first decision: 31 samples, which settle the filters
ABREAST: Final = 7  # marks the stream of random values of the vehicles and sensors
FROZEN, DEAD, NAN = 1.0, 2.0, 3.0  # faults of a sensor, as numbers
CODES: Final = {SensorFault.NONE: 0.0, SensorFault.FROZEN: FROZEN, SensorFault.DEAD: DEAD, SensorFault.NAN: NAN}

Shown = LightWorld | CheckedWorld | None

_lux_at = compiled(lux_at)


class Loops(NamedTuple):
    """What closes the velocity loops of all cars alike: `control` takes it apart."""

    motor_max: float  # counts
    gains: Array  # of the yaw rate: rows v_max, kp, ki, kd
    linear: Gains
    car: CarParameters
    known: bool  # whether the loops know the car, else they are the thesis's


class Wheels(NamedTuple):
    """What `encode` takes."""

    count_length: float  # m of the encoders' counts
    track_width: float  # m


class Cars(NamedTuple):
    """The state of some cars, a column each."""

    robots: Array  # rows of txt1.learning.batch
    odometry: Array  # x, y (m) and theta (rad)
    frozen: Array  # the latest reading of each sensor, lux


class Fixed(NamedTuple):
    """What is the same for all cars of a world, and at all times."""

    dynamics: Dynamics
    loops: Loops
    wheels: Wheels
    light: PointLight
    mount: Mount
    gains: Array  # of each sensor
    faults: Array  # of each sensor, as CODES


class Samples(NamedTuple):
    """The samples of the light, of all cars at the same times."""

    noise: Array  # a share of each reading, given, shape (samples, n, 4)
    lux: Array  # written, shape (samples, n, 4)
    seen_from: Array  # the odometry with each, written, shape (samples, n, 5)
    poses: Array  # the true pose with each, written, shape (samples, n, 3)


@partial(compiled, nogil=True, cache=True)
def _advance(cars: Cars, commands: Array, first: int, drag: Array, samples: Samples, world: Fixed) -> int:
    """Move all by len(drag) ticks after tick `first`; the samples of the light are written, and counted.

    A tick is a piece of the way, the samples of the light that fall due on it, the controller, the encoders and the
    odometry, in the order in which the running robot has them.
    """
    robots, odometry, frozen = cars.robots, cars.odometry, cars.frozen
    noise, lux, seen_from, poses = samples.noise, samples.lux, samples.seen_from, samples.poses
    light, mount, gains, faults = world.light, world.mount, world.gains, world.faults
    motor_max, schedule, linear, car, known = world.loops
    count_length, track_width = world.wheels
    n = robots.shape[1]
    rolled, target, remaining = robots[:2].copy(), robots[0].copy(), robots[0].copy()
    sample = 0
    for k in range(drag.shape[0]):
        tick = first + k + 1
        dt = tick * TICK_MS / 1000.0 - (tick - 1) * TICK_MS / 1000.0
        rolled[0], rolled[1] = robots[RIGHT], robots[LEFT]
        before = robots[:3].copy()
        move(robots, robots[OUTPUT], robots[OUTPUT + 1], drag[k], dt, world.dynamics, target, remaining)
        until = tick * TICK_MS
        due = ((until - TICK_MS) // LIGHT_MS + 1) * LIGHT_MS
        while due <= until:
            share = (due - (until - TICK_MS)) / TICK_MS
            for i in range(n):
                turned = robots[THETA, i] - before[2, i]
                turned -= 2.0 * pi * np.round(turned / (2.0 * pi))
                x = before[0, i] + share * (robots[X, i] - before[0, i])
                y = before[1, i] + share * (robots[Y, i] - before[1, i])
                poses[sample, i, 0], poses[sample, i, 1], poses[sample, i, 2] = x, y, before[2, i] + share * turned
                seen = _lux_at(x, y, before[2, i] + share * turned, light, mount)
                for s in range(4):
                    reading = gains[s] * seen[s] * (1.0 + noise[sample, i, s])
                    reading = min(max(reading, LUX_MIN), LUX_MAX)
                    if faults[s] == FROZEN and frozen[s, i] > 0.0:
                        reading = frozen[s, i]
                    frozen[s, i] = reading
                    lux[sample, i, s] = 0.0 if faults[s] == DEAD else nan if faults[s] == NAN else reading
                for s in range(3):
                    seen_from[sample, i, s] = odometry[s, i]
                seen_from[sample, i, 3], seen_from[sample, i, 4] = robots[SENSED, i], robots[SENSED + 1, i]
            sample += 1
            due += LIGHT_MS
        control(robots, commands, motor_max, schedule, linear, car, known)
        encode(robots, rolled, dt, count_length, track_width)
        for i in range(n):
            v, omega = robots[SENSED, i], robots[SENSED + 1, i]
            half = 0.5 * omega * dt  # along an arc, (2.2); the chord is its length but for a part in 10^5
            odometry[0, i] += v * dt * cos(odometry[2, i] + half)
            odometry[1, i] += v * dt * sin(odometry[2, i] + half)
            theta = odometry[2, i] + 2.0 * half
            odometry[2, i] = theta - 2.0 * pi * np.round(theta / (2.0 * pi))
    return sample


class Lockstep:
    """Vehicles of one world, each on a start of its own; see the module.

    `worlds`: what each is shown, where that is more than the light; None: made here, as the configuration has it.
    """

    def __init__(
        self, config: Config, poses: Array, rng: np.random.Generator, worlds: Sequence[Shown] | None = None
    ) -> None:
        only_ours(config)
        refuse_others(config, LOCKSTEP, "trials in lockstep")
        self.robots: Array = np.zeros((ROWS, len(poses)))
        self.robots[:3] = poses.T
        self.robots[PHASE : PHASE + 2] = rng.random((2, len(poses)))
        self.robots[COUNT : COUNT + 2] = 0.0
        self.odometry: Array = np.zeros((3, len(poses)))
        self.frozen: Array = np.zeros((4, len(poses)))
        self.tick = 0
        self.touched = np.zeros(len(poses), bool)
        self._tracked = config.section(LearningConfig).pose != "truth"
        made = [shown(config, rng) for _ in poses] if worlds is None else worlds
        self.worlds = [each for each in made if each is not None]
        self._lasers = [laser_of(config, rng) for _ in poses]
        self._touches = touches(config)
        self._put_down = np.zeros(len(poses), int)  # the tick at which each was put down
        self._begun = np.zeros(len(poses), int)
        self._rng = rng
        sim, light = config.sim, config.sim.light
        exponent = float(light.exponent)
        jitters = noise_for_jitter(exponent=exponent, height=light.height)
        self._noise = jitters if light.noise is None else light.noise
        self._drag = sim.noise.drag
        self._world = Fixed(
            dynamics(powered(sim.vehicle, sim.battery), config.geometry),
            loops_of(config),
            wheels_of(config),
            PointLight(*sim.room.light, light.intensity, exponent, light.height),
            light.mount,
            np.array(light.gains),
            np.array([CODES[fault] for fault in light.faults]),
        )

    def swept(self, k: int, begins: bool = False) -> Array | None:
        """Where the laser's beams end, in the robot's frame, m; None: it has no laser, or the first sweep `begins`."""
        if (laser := self._lasers[k]) is None:
            return None
        x, y, theta = self.robots[:3, k].tolist()
        now = 0.001 * TICK_MS * self.tick
        sweep = laser.see((x, y, theta), now, -inf if begins else now - 0.001 * DECISION_MS)
        return None if sweep is None else sweep.value.points

    @property
    def since(self) -> Array:
        """The time since each was put down, s; shape (n,)."""
        return 0.001 * TICK_MS * (self.tick - self._put_down)

    def told(self) -> Array:
        """The poses by which goal and boundary are judged: the truth, or as motion capture sees it; shape (3, n)."""
        poses: Array = self.robots[:3]
        if not self._tracked:
            return poses
        errors = TrackerErrors()
        noise = np.array([[errors.noise], [errors.noise], [errors.angle_noise]])
        return poses + noise * self._rng.standard_normal(poses.shape)

    def place(self, which: NDArray[np.intp], poses: Array) -> None:
        """Put some down at poses (m, rad), at rest, as new; shape (len(which), 3)."""
        for each in (self.robots, self.odometry, self.frozen):
            each[:, which] = 0.0
        self.robots[:3, which] = poses.T
        self.robots[PHASE : PHASE + 2, which] = self._rng.random((2, len(which)))
        self.touched[which] = False
        self._put_down[which] = self.tick
        self._begun[which] += 1
        for k in which if self.worlds else ():
            self.worlds[k].begin(int(self._begun[k]))

    def advance(self, which: NDArray[np.intp], commands: Array, ticks: int) -> tuple[Array, Array]:
        """Let some drive on at commands (v, omega), shape (len(which), 2); their samples, and the odometry with each.

        Shapes (samples, len(which), 4), lux, and (samples, len(which), 5), m, rad, m/s and rad/s.
        """
        cars = Cars(self.robots[:, which], self.odometry[:, which], self.frozen[:, which])
        begin, end = self.tick * TICK_MS // LIGHT_MS, (self.tick + ticks) * TICK_MS // LIGHT_MS
        shape = (end - begin, len(which))
        drag = self._drag * self._rng.standard_normal((ticks, len(which)))
        noise = self._noise * self._rng.standard_normal((*shape, 4))
        samples = Samples(noise, np.empty((*shape, 4)), np.empty((*shape, 5)), np.empty((*shape, 3)))
        _advance(cars, commands, self.tick, drag, samples, self._world)
        if self.worlds or self._touches is not None:
            for k, index in enumerate(which):
                driven = list(map(tuple, samples.poses[:, k].tolist()))
                if self.worlds:
                    since = 0.001 * TICK_MS * self._put_down[index]
                    times = 0.001 * LIGHT_MS * np.arange(begin + 1, end + 1) - since
                    see = self.worlds[index].see
                    samples.lux[:, k] = [see(*each) for each in zip(times.tolist(), driven, strict=True)]
                if self._touches is not None:
                    self.touched[index] |= any(map(self._touches, driven))
        self.robots[:, which], self.odometry[:, which], self.frozen[:, which] = cars
        self.tick += ticks
        return samples.lux, samples.seen_from


def asked_alike(config: Config) -> Config:
    """The configuration with the rule that all contenders are asked for the goal by, where it has none of its own."""
    if config.section(LearningConfig).goal_period is not None:
        return config
    return with_values(config, {"learning.goal_period": DECISION_MS / 1000.0})


def touches(config: Config) -> Callable[[Pose], bool] | None:
    """Whether a robot at a pose touches a wall of the map, a post or a box that stands; None: nothing is there."""
    room, obstacles, body = config.sim.room.built(), config.sim.obstacles, config.geometry
    if room.walls is None and not obstacles:
        return None

    def touched(pose: Pose) -> bool:
        x, y, theta = pose
        if room.walls is not None and clearance(x, y, theta, room, body) < NO_ROOM:
            return True
        at = Box(x + body.centre * cos(theta), y + body.centre * sin(theta), body.length, body.width, theta)
        return any(gap(at, each) < NO_ROOM for each in obstacles)

    return touched


def shown(config: Config, rng: np.random.Generator) -> Shown:
    """What a robot is shown, sample by sample, which takes longer; None: nothing but the light."""
    world = world_of(config, rng)
    if world is None and (config.sim.light.true_bearing or touches(config) is not None):
        return LightWorld(config, rng)
    return world


def laser_of(config: Config, rng: np.random.Generator) -> SimulatedLaser | None:
    """The laser scanner of a robot, if it is configured; it sweeps once a decision."""
    if not lasers(config):
        return None
    shapes = shapes_of(config.sim.obstacles)
    if config.sim.room.map is not None:
        shapes = walls_of(config.sim.room.built()) + shapes
    return SimulatedLaser(lasers(config)[0], lambda: None, shapes, LaserParameters(), rng)


def loops_of(config: Config) -> Loops:
    """The velocity loops of a world."""
    car, control = car_of(config.car, config.geometry), config.control
    gains = np.array([[s.v_max, *s.gains] for s in control.schedule().sets])
    return Loops(float(config.safety.motor_max), gains, control.linear.gains(), car or UNKNOWN, car is not None)


def wheels_of(config: Config) -> Wheels:
    """The encoders of a world."""
    return Wheels(config.geometry.count_length, config.geometry.track_width)


def world_at(config: Config, episode: int, episodes: int) -> Config:
    """The configuration in force in an episode, from 1: with the changes up to it, and what drifts."""
    values: dict[str, Any] = {}
    learning = config.section(LearningConfig)
    for change in learning.part("changes", Changes()):
        if change.episode <= episode:
            values |= change.set
    share = (episode - 1) / max(1, episodes - 1)
    for key, (first, last) in learning.part("drift", Drift()).items():
        values[key] = first + share * (last - first)
    return with_values(config, values) if values else config


def trials(
    config: Config,
    make: Callable[[np.random.Generator], Agent],
    numbers: Sequence[int],
    episodes: int,
    seed: int,
    done: Callable[[int, Trial], None] = lambda episode, trial: None,
) -> list[Trial]:
    """Do trials of these numbers, `make` giving each its learner; `done` is told as each episode of a trial ends."""
    config = settled(config)
    rng = stream(seed, numbers[0], ABREAST).numpy()
    seen = [stream(seed, k, SENSORS).numpy() for k in numbers]
    task = task_of(config)
    actions = config.section(LearningConfig).actions
    every = [Trial(make(stream(seed, k, AGENT).numpy()), task, starts(seed, k, episodes), actions) for k in numbers]
    if lasers(config) and not all(isinstance(trial.agent, Looker) for trial in every):
        raise ConfigError(
            f"sensors.{lasers(config)[0]}: the learner '{every[0].agent.name}' looks at no laser, so it would have no "
            "effect; take it out, or take the learner pilot"
        )
    before = None
    for episode in range(1, episodes + 1):
        world = world_at(config, episode, episodes)
        if world is not before:
            refuse_unsolvable(world)
            refuse_others(world, LOCKSTEP, "trials in lockstep")
            for trial, own in zip(every, seen, strict=True):
                trial.world = shown(world, own)
        before = world
        for trial in every:
            trial.task, trial.commands = task_of(world), world.section(LearningConfig).actions
        _episode(world, every, rng)
        for trial in every:
            done(episode, trial)
    return every


def _episode(world: Config, every: Sequence[Trial], rng: np.random.Generator) -> None:
    """Let everyone do an episode."""
    cars = Lockstep(world, np.array([trial.start for trial in every]), rng, [trial.world for trial in every])
    for index, trial in enumerate(every):
        trial.placed(0.0)
        cars.swept(index, begins=True)
    ticks = REST_MS // TICK_MS
    which = np.arange(len(every))
    commands = np.zeros((len(every), 2))
    while len(which):
        lux, seen_from = cars.advance(which, commands, ticks)
        ticks = DECISION_MS // TICK_MS
        now = cars.tick * TICK_MS / 1000.0
        due = cars.tick * TICK_MS // LIGHT_MS
        times = [0.001 * LIGHT_MS * k for k in range(due - len(lux) + 1, due + 1)]
        poses = cars.told().T[which].tolist()
        velocities = cars.robots[SENSED : SENSED + 2, which].T.tolist()
        places = cars.odometry[:, which].T.tolist()
        driving, given = [], []
        for k, index in enumerate(which.tolist()):
            trial = every[index]
            for time, reading, odometry in zip(times, lux[:, k].tolist(), seen_from[:, k].tolist(), strict=True):
                trial.see(time, Readings(*reading), Odometry(*odometry))
            if (points := cars.swept(index)) is not None:
                trial.look(now, points, Odometry(*places[k], *velocities[k]))
            command = trial.tick(
                now, True, tuple(poses[k]), Odometry(*places[k], *velocities[k]), bool(cars.touched[index])
            )
            if trial.phase is Phase.REST or trial.phase is Phase.DRIVE:
                driving.append(index)
                given.append(command)
        which, commands = np.array(driving, np.intp), np.array(given).reshape(-1, 2)
