"""The world that settings compose: several lights that move, hang or flicker, sensors that err, odometry that drifts.

    learning:
      world: composed
      world_options:
        lamps: [{}, {x: 3.0, y: 2.0, intensity: 60.0, flicker: 0.5}]   # the first is the goal, by sim.light
        ambient: 5.0
        sensors: [{quantum: 20.0}]                                      # one for all four, or four
        odometry: {drift: 0.1}
        changes: [{episode: 16, set: {odometry: {drift: 0.3}}}]

A sample is computed in this order: lamps, shadows and surroundings; the sensor's gain and noise (`sim.light`); its lag
and delay; its offset; its range and its steps; at last its faults: it hangs, drops out or lies.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, exp, pi, sin
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Len
from pydantic import Field

from txt1 import Odometry
from txt1.config.sources import checked
from txt1.errors import ConfigError
from txt1.learning.settings import LearningConfig
from txt1.learning.world import Command, LightWorld, Pose
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, SAMPLE_PERIOD, SENSORS, Readings, SensorFault
from txt1.sim.lamp import NEAREST, noise_for_jitter
from txt1.sim.shadow import lit_by
from txt1.units import NotNegative, Positive, PositiveInt, Share

if TYPE_CHECKING:
    import numpy as np

    from txt1 import Box
    from txt1.config import Config

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light; a null field takes its value from `sim.light` and `sim.room.light`."""

    x: float | None = None
    """Its first place along x, m."""
    y: float | None = None
    """Its first place along y, m."""
    intensity: Positive | None = None
    """Lux at 1 m."""
    exponent: Positive | None = None
    """Its light falls as 1 / d^exponent."""
    height: NotNegative | None = None
    """Above the sensors' plane, m."""
    velocity: Point = (0.0, 0.0)
    """Its velocity along x and y, m/s."""
    swing: Point = (0.0, 0.0)
    """Its swing to either side along x and y, m, as a lamp on a cable swings."""
    circle: NotNegative = 0.0
    """It goes round in a circle of this radius through its place, m."""
    period: Positive = 4.0
    """Period of a swing or a round, s."""
    flicker: Share = 0.0
    """Amplitude of its flicker, a sine, as a share of its light."""
    flicker_period: Positive = 0.5
    """Period of its flicker, s."""
    dark_every: NotNegative = 0.0
    """Mean time from one outage to the next, s; 0: no outages."""
    dark_for: Positive = 0.3
    """Mean length of an outage, s."""


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """How a sensor errs, beside its gain, noise and fault in `sim.light`."""

    gain: NotNegative = 1.0
    """Factor on its light."""
    offset: float = 0.0
    """Offset that it adds, lux."""
    low: NotNegative = LUX_MIN
    """The lower limit of its readings, lux."""
    high: Positive = LUX_MAX
    """The upper limit of its readings, lux."""
    quantum: NotNegative = 0.0
    """Step of its readings, lux; 0: no steps."""
    lag: NotNegative = 0.0
    """Time constant with which it follows the light, s."""
    delay: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    """Delay of its readings, s."""
    lies: NotNegative | None = None
    """A false reading, lux, with noise, in place of the light; null: true readings."""
    hangs_every: NotNegative = 0.0
    """Mean time from one hang to the next, s; while it hangs, it repeats its reading; 0: it never hangs."""
    hangs_for: Positive = 1.0
    """Mean length of a hang, s."""
    drop_out: Share = 0.0
    """Share of its samples that read 0."""


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """How odometry errs, as the learner is told of it."""

    drift: float = 0.0
    """Drift of its turns, rad/s."""
    turns: float = 1.0
    """Factor on its turns."""
    ways: float = 1.0
    """Factor on its distances."""
    noise: NotNegative = 0.0
    """Standard deviation of the distance and the turn between two samples, as a share of them."""
    missing: bool = False
    """Whether there is no odometry: it says that the robot stands at 0."""


@dataclass(frozen=True, slots=True)
class Change:
    """Other options from an episode on."""

    episode: PositiveInt
    """The first episode with these options."""
    set: dict[str, Any]
    """The options that change, by their names."""


@dataclass(frozen=True, slots=True)
class WorldOptions:
    """The settings under `learning.world_options`."""

    lamps: Annotated[tuple[Lamp, ...], Field(min_length=1)] = (Lamp(),)
    """The lights; the first is the goal."""
    ambient: NotNegative = 0.0
    """Light from everywhere, lux."""
    gradient: Point = (0.0, 0.0)
    """Its growth along x and y, lux a metre; the sum is never below 0."""
    sensors: Annotated[tuple[SensorErrors, ...], Len(1, 4)] = (SensorErrors(),)
    """The errors of the four sensors; a single entry is for all four."""
    odometry: OdometryErrors = field(default_factory=OdometryErrors)
    """Odometry's errors."""
    turning: float = 1.0
    """Factor on the yaw rate of every action; -1 swaps left and right."""
    turning_from: NotNegative = 0.0
    """Time in an episode from which the factor on the yaw rate acts, s."""
    changes: tuple[Change, ...] = ()
    """Changes in mid-trial."""


class Spells:
    """Spells of outage or hanging, which begin and end at random."""

    def __init__(self, every: float, length: float, rng: np.random.Generator) -> None:
        self._every, self._length, self._rng = every, length, rng
        self._begins = self._ends = float(rng.exponential(every)) if every else float("inf")
        self._ends += float(rng.exponential(length)) if every else 0.0

    def at(self, now: float) -> bool:
        """Return whether a spell is on at `now`; times only go forward."""
        while now >= self._ends:
            self._begins = self._ends + float(self._rng.exponential(self._every))
            self._ends = self._begins + float(self._rng.exponential(self._length))
        return now >= self._begins


class Composed(LightWorld):
    """The world; see the module."""

    def __init__(self, config: Config, rng: np.random.Generator, movers: Callable[[], Sequence[Box]] = tuple) -> None:
        super().__init__(config, rng, movers)
        self._movers = movers
        light = config.sim.light
        exponent, height = float(light.exponent), light.height
        self._noise = noise_for_jitter(exponent=exponent, height=height) if light.noise is None else light.noise
        walls = config.sim.room.built().walls
        self._grid = None if walls is None else walls.grid
        self._shades = bool(walls is not None or config.sim.obstacles or config.sim.movers)
        self._take(config.section(LearningConfig).world_options)
        # refused before anything begins
        for change in self.options.changes:
            options_of({**config.section(LearningConfig).world_options, **change.set})
        self.begin(1)

    def _take(self, options: Mapping[str, Any]) -> None:
        self.options = options_of(options)
        sensors = self.options.sensors
        self._sensors = sensors if len(sensors) == len(SENSORS) else sensors * len(SENSORS)

    def begin(self, episode: int) -> None:
        """Begin an episode: the lights are at their first places, sensors and odometry are reset."""
        plain = self.config.section(LearningConfig).world_options
        changes = [each for each in options_of(plain).changes if each.episode <= episode]
        self._take({key: value for each in ({**plain}, *(one.set for one in changes)) for key, value in each.items()})
        rng = self.rng
        self._phases = [float(rng.uniform(0.0, 2.0 * pi)) for _ in self.options.lamps]
        self._dark = [Spells(each.dark_every, each.dark_for, rng) for each in self.options.lamps]
        self._hangs = [Spells(each.hangs_every, each.hangs_for, rng) for each in self._sensors]
        self._followed = [0.0] * len(SENSORS)
        self._told = [0.0] * len(SENSORS)
        self._past = [deque[float](maxlen=1 + round(each.delay / SAMPLE_PERIOD)) for each in self._sensors]
        self._before: Odometry | None = None
        self._wheels = Odometry()
        self._at = 0.0

    # -- light ---------------------------------------------------------------------------------------------------

    def place(self, number: int, now: float) -> Point:
        """Return the place of a lamp, m."""
        lamp, (x, y) = self.options.lamps[number], self.config.sim.room.light
        turn = 2.0 * pi * now / lamp.period
        x, y = x if lamp.x is None else lamp.x, y if lamp.y is None else lamp.y
        vx, vy = lamp.velocity
        swing_x, swing_y = lamp.swing
        return (
            x + vx * now + swing_x * sin(turn) + lamp.circle * (cos(turn) - 1.0),
            y + vy * now + swing_y * sin(turn) + lamp.circle * sin(turn),
        )

    def goal(self, now: float) -> Point:
        """The place of the first lamp, m."""
        return self.place(0, now)

    def see(self, now: float, pose: Pose) -> Readings:
        """Return a sample of the four sensors, lux."""
        return Readings(*map(self._told_by, range(len(SENSORS)), [now] * len(SENSORS), self._lit(now, pose)))

    def _lit(self, now: float, pose: Pose) -> list[float]:
        """Return the light on each sensor, lux."""
        x, y, theta = pose
        c, s = cos(theta), sin(theta)
        light, options = self.config.sim.light, self.options
        places = [(x + c * ahead - s * left, y + s * ahead + c * left) for ahead, left in light.mount]
        gx, gy = options.gradient
        lux = [max(0.0, options.ambient + gx * px + gy * py) for px, py in places]
        for k, lamp in enumerate(options.lamps):
            if self._dark[k].at(now):
                continue
            at = self.place(k, now)
            bright = light.intensity if lamp.intensity is None else lamp.intensity
            bright *= 1.0 + lamp.flicker * sin(2.0 * pi * now / lamp.flicker_period + self._phases[k])
            half = 0.5 * (float(light.exponent) if lamp.exponent is None else lamp.exponent)
            up = light.height if lamp.height is None else lamp.height
            seen: Sequence[bool] = (True,) * len(SENSORS)
            if self._shades:
                seen = lit_by(at, self._grid, self.config.sim.obstacles, self._movers, light.mount)(x, y, theta)
            for i, (px, py) in enumerate(places):
                if seen[i]:
                    square = max((px - at[0]) ** 2 + (py - at[1]) ** 2 + up * up, NEAREST)
                    lux[i] += bright / square**half
        return lux

    def _told_by(self, k: int, now: float, lux: float) -> float:
        """Return a sensor's reading for the light on it, lux."""
        one, light = self._sensors[k], self.config.sim.light
        noise = 1.0 + self._noise * float(self.rng.standard_normal())
        # before the episode the robot stood on its start
        past = self._past[k]
        past.append(lux)
        clean = one.gain * light.gains[k] * past[0] if one.lies is None else one.lies
        seen = clean * noise
        if one.lag:
            share = exp(-SAMPLE_PERIOD / one.lag)
            seen = self._followed[k] = share * (self._followed[k] or clean) + (1.0 - share) * seen
        told = seen + one.offset
        if one.quantum:
            told = one.quantum * round(told / one.quantum)
        told = min(max(told, one.low), one.high)
        fault = light.faults[k]
        if self._told[k] and (fault is SensorFault.FROZEN or self._hangs[k].at(now)):
            told = self._told[k]
        self._told[k] = told
        if one.drop_out and self.rng.random() < one.drop_out:
            return 0.0
        return 0.0 if fault is SensorFault.DEAD else float("nan") if fault is SensorFault.NAN else told

    # -- motion --------------------------------------------------------------------------------------------------

    def odometry(self, now: float, odometry: Odometry) -> Odometry:
        """Return odometry with its errors: each true step, with errors, continues the false course."""
        wrong = self.options.odometry
        if wrong == OdometryErrors():
            return odometry
        if wrong.missing:
            return Odometry()
        before, self._before = self._before or odometry, odometry
        lasted, self._at = now - self._at, now
        turn = wrap_angle(odometry.theta - before.theta)
        middle = before.theta + 0.5 * turn
        way = (odometry.x - before.x) * cos(middle) + (odometry.y - before.y) * sin(middle)
        if wrong.noise:
            way *= 1.0 + wrong.noise * float(self.rng.standard_normal())
            turn *= 1.0 + wrong.noise * float(self.rng.standard_normal())
        way, turn = wrong.ways * way, wrong.turns * turn + wrong.drift * lasted
        x, y, theta = self._wheels[:3]
        middle = theta + 0.5 * turn
        omega = wrong.turns * odometry.omega + wrong.drift
        self._wheels = Odometry(
            x + way * cos(middle), y + way * sin(middle), wrap_angle(theta + turn), wrong.ways * odometry.v, omega
        )
        return self._wheels

    def command(self, now: float, command: Command) -> Command:
        """Return a command as it reaches the robot."""
        v, omega = command
        return v, omega * (self.options.turning if now >= self.options.turning_from else 1.0)


def options_of(options: Mapping[str, Any]) -> WorldOptions:
    """Return the checked options; raises ConfigError."""
    made = checked(WorldOptions, options, "learning.world_options")
    if len(made.sensors) not in (1, len(SENSORS)):
        raise ConfigError(f"learning.world_options.sensors: {len(made.sensors)} of them; give one for all, or four")
    return made
