"""A learner that surveys its own sensors, keeps the light on a map, and plans the quickest course to it.

It is not told where its sensors sit, which way an action turns, or how fast. It knows three things. The light is a
point, and its brightness falls by some power of the distance. The sensors sit somewhere on the robot. Odometry tells
how far the robot went and how much it turned (perhaps with a wrong scale). Lengths are odometry's, times are decisions:

    z     <- log of the mean of the readings since the last decision
    d, h  <- distance and turn since then, by odometry
    learn   d' = k d + c(a),  (h/d)' = l (h/d) + e(a),  a: the action in force (`action_effects.Effects`)
    Q     <- places of the light in the robot's frame that z allows, at first; then each is moved by d, h and
             corrected by z (Kalman filters), and unlikely places are dropped (`sensor_map`)
    if lost, or late, or at an episode's end:
        survey: p, g, n, s, b, u and the light of each episode  (Gauss-Newton, `sensor_map.surveyed`)
                <- argmin sum (z - g + n/2 log(|q - p|^2 + u))^2 + what it was before (`sensor_map.by_part`)
    a     <- first action of the quickest plan "a for m decisions, then b" to the goal's distance from q, on average
             over the likely q (`planner.quickest`)

The sensors sit at p with brightness g and power n, and the light hangs sqrt(u) above them; the robot turns by s h + b
in a decision when odometry says h. A course that only grazes the goal may miss it and go round again, so it counts as
longer; how much it may miss by is the scatter of the distances at which episodes ended well, of which the goal's
distance is the mean. Where an episode goes on although the robot is nearer, it looks for the goal nearer still.

A survey uses the readings of the last few episodes. What those before them told of the sensors and of odometry stays
with it, as the prior of the next survey; where the readings say otherwise it counts for little. Without it a survey
through a light that moves, or through readings that lag, goes astray in a few episodes.

What it finds out of its sensors and of the light:

- A sensor that fits worse than the others is trusted less: its variances are multiplied by its own misfit.
- A sensor that noise around a constant explains, while others vary far more, is blind (`unmoved`).
- A largest reading that repeats is the end of a sensor's range (`ceilings`). It says that the light is at least so
  bright, and counts only where the survey foretells less.
- When something does not fit, it compares surveys with readings that are late by 0 to 15 decisions, one with a light
  that moves, evenly for five seconds at a time, and one with a light that flickers, whose readings have a part in
  common that tells nothing (`_think_again`). In the filter a light that moves then wanders.

The pilot is lost at first. It is lost again when the readings no longer fit, or when it is late by half of its plan
although it has surveyed again. Then it forgets its survey, and surveys from several guesses at the light's place. At
first and when it is late it tries each action before that. A survey that led to the goal before is taken again, where
it fits the latest readings as well as the new one (`_taken_again`).

Where a laser has seen something near, the plan is "a for m decisions, b for n, then e", and costs more where the body
comes near to what was seen (`clear_course`). While it is lost it takes only actions after which it can still keep
clear, by odometry's own turns: a survey that never led to the goal may turn the map.

Every half second it judges itself by the last 5 s (`_judge`). It says that its model does not fit if

        sum (z - g + n/2 log(|q - p|^2 + u))^2 / var z  >  chi^2   with the best survey for these readings and a light
        that stands still
        (turn and way of the last second - those predicted) ^2 / (slip of odometry)^2  >  chi^2

It says so, too, when it is late, when it forgets its survey, where one sensor alone tells of the light, and where the
light moves. It says so at the start of an episode, if one of the last five failed, or took 1.5 times the plan that it
would have made at its start, had it known where the light was (`_wasted`); after the second such episode for ten
episodes, and so on.

It makes the second of these tests at each decision. Where that fails, it goes on by what the actions did before they
last changed, or learns them anew, and plans anew (`action_effects.MotionModel`). An action that does then what another
one did may have changed places with it, so it tries the other, too.

Here chi^2 is the quantile that noise of the stated size exceeds with the probability `alarm`: the global test of an
adjustment (W. Baarda, A Testing Procedure for Use in Geodetic Networks, 1968), and the test of innovations (Y.
Bar-Shalom, X. R. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.4). After such
a report it drives on as before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, exp, hypot, inf, isfinite, log, pi, sin, sqrt
from statistics import NormalDist
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from txt1 import Odometry
from txt1.config import Config
from txt1.learning.agent import Decision, Learned, PeriodicAgent, Rows, StoredTable
from txt1.learning.settings import LearningConfig
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import LUX_MAX, LUX_MIN
from txt1.units import NotNegative, Positive, PositiveInt, Share
from txt1_learners.action_effects import Effects, MotionModel, steady
from txt1_learners.clear_course import (
    MARGIN,
    ActionPlan,
    Discs,
    SeenPoints,
    body_of,
    clearest,
    distances,
    quickest_clear,
)
from txt1_learners.planner import Array, Belief, Place, quickest
from txt1_learners.sensor_map import (
    DRIFT,
    HEIGHT,
    NUMBERS,
    PLACES,
    POWER,
    POWERS,
    SCALE,
    SCALES,
    SENSORS,
    UNLIKELY,
    Prior,
    Stations,
    by_part,
    followed,
    moved,
    seen_along,
    sighted,
    surveyed,
    told,
    turned,
    way,
)

# a probability
Rare = Annotated[float, Field(gt=0.0, lt=0.5)]


@dataclass(frozen=True, slots=True)
class PilotSettings:
    """The hyper-parameters, which `learning.pilot` sets."""

    # time from one decision to the next, s
    period: Positive = 0.1
    # decisions in a row for which each action is tried when it is lost
    tries: PositiveInt = 5
    # weight of the past in the effects of an action, per decision that it is in force
    forgets: Share = 0.99
    # decisions that a survey uses
    window: PositiveInt = 250
    # decisions from one survey to the next when it is lost
    anew: PositiveInt = 5
    # mean square of the readings' misfit, in their own deviations, above which it is lost
    doubt: Positive = 2.5
    # standard deviation of odometry in one decision, as a share of distance and turn
    slip: NotNegative = 0.15
    # standard deviation of the brightness's law, as a share
    model: NotNegative = 0.03
    # standard deviation of the goal's distance, as a share, at least: a course that grazes the goal might miss it
    graze: Share = 0.06
    # decisions by which it judges whether its model fits
    judged: PositiveInt = 50
    # probability of a false report that the model does not fit, each time it judges
    alarm: Rare = 1e-6
    # an action takes effect at most this many decisions, less one, after it was taken
    delays: PositiveInt = 17


SETTINGS: Final = PilotSettings()
# it is a survey, which the floor shows
TABLE_IS_DRAWN: Final = False
# standard deviation of odometry's drift before anything is known, rad in a decision
DRIFTS: Final = 0.01
# standard deviation of the square of the light's height above the sensors, m2
HEIGHTS: Final = 0.1
# delays of which the effects are shared with other robots: a message has little room
SHARED: Final = 5
# share of what it knows from earlier episodes that each episode leaves
KEPT: Final = 0.95
# samples that give the same largest reading, after which a sensor's range ends there
REPEATED: Final = 10
# share of the light's distance at which the goal is looked for, when it should have been there
NEARER: Final = 0.9
# m, rad, log lux and sums of them: no number that it keeps is larger
LARGEST: Final = 1e6
# numbers of a decision that it keeps: distance, turn, four log readings, their four variances
_RECORD: Final = 2 + 2 * SENSORS
# episodes after which a survey that led to the goal is taken again where it fits, and is not forgotten for being late
# if the light moves
KNOWN: Final = 3
# episodes at whose start it says so after the first that took far too long
DOUBTS: Final = 5
LONG: Final = "how long the way takes"
MOVES: Final = "the light, which moves"
# decisions from one station of a light that moves to the next
STATION: Final = 50
# m in a decision that a light moves, at least
SLOWEST: Final = 1e-3
# decisions by which it judges whether its model of a light that moves fits
PIECE: Final = 10
# standard deviation of the brightness of a light that flickers, as a logarithm
FLICKER: Final = 0.5
# decisions by which readings may be late
LATE: Final = (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 15)


def create(config: Config, rng: np.random.Generator, table: StoredTable | None = None) -> "PilotAgent":
    """Return a learner as configured, or a driver by a stored survey; ValueError: the survey cannot be."""
    learning = config.section(LearningConfig)
    settings = learning.part("pilot", SETTINGS)
    body = config.geometry
    discs = body_of(body.length, body.width, body.centre)
    agent = PilotAgent(rng, len(learning.actions), settings, discs)
    # one of them may be a laser
    _compile(round_obstacles=bool(config.sensors.keys() - {learning.sensor, learning.pose}))
    if table is not None:
        table.shaped(*agent.table().shape)
        new = agent.memory()
        agent.recall({**new, **table.about["knows"]})
        known = agent.memory()
        for name in ("survey", "spread", "trust", "blind", "least", "most", "repeats", "information", "product"):
            if np.shape(known[name]) != np.shape(new[name]):
                raise ValueError(f"keeps '{name}' of the shape {np.shape(known[name])}, not {np.shape(new[name])}")
        if not agent.survey[HEIGHT] >= 0.0:
            raise ValueError(f"keeps a light whose squared height is {agent.survey[HEIGHT]:g} m2, below 0")
        for name, sound in agent.sound().items():
            if not sound:
                raise ValueError(f"keeps '{name}' with numbers out of their range")
    return agent


class PilotAgent(PeriodicAgent):
    """The learner; see the module."""

    name = "pilot"

    def __init__(
        self,
        rng: np.random.Generator,
        actions: int = 3,
        settings: PilotSettings = SETTINGS,
        body: Discs = body_of(0.51, 0.385, 0.0),  # noqa: B008 - immutable
    ) -> None:
        super().__init__(settings.period)
        self.settings = settings
        self._body = body
        self.actions = actions
        self.episode = 0
        self._motion_model = MotionModel(
            actions,
            settings.delays,
            slip=settings.slip,
            limit=chi_square(2, settings.alarm),
            tries=settings.tries,
            forgets=settings.forgets,
        )
        # see POWER, PLACES, SCALE
        self.survey = np.zeros(NUMBERS)
        self.survey[POWER], self.survey[SCALE] = 2.0, 1.0
        # mean square of one sample, as a share of its mean
        self.spread = np.full(SENSORS, 0.1)
        # distance from the light at which an episode ends; 0: unknown
        self.goal = 0.0
        # number of episodes of which it is the mean
        self._goals = 0
        # mean square of their differences from it
        self._scatter = 0.0
        # factor on each sensor's variances
        self.trust = np.ones(SENSORS)
        # decisions by which the readings are late, whether the light moves, and whether it flickers
        self.late = 0
        self.moves = self.flickers = False
        # sensors whose readings the light does not move
        self.blind = np.zeros(SENSORS, bool)
        # each sensor's smallest and largest reading, and the number of samples that gave the largest
        self.least = np.full(SENSORS, LUX_MAX)
        self.most = np.zeros(SENSORS)
        self.repeats = np.zeros(SENSORS, np.int64)
        self.lost = True
        self.misfit = 1.0
        self._rng = rng
        self._untried = self._all()
        # what episodes before those in `_past` told of the survey: see `sensor_map.told`
        self._told = np.zeros((NUMBERS, NUMBERS)), np.zeros(NUMBERS)
        # for each episode, rows of _RECORD numbers a decision
        self._past: list[Array] = []
        # episodes for which it doubts the model, since one took too long, and the number of these
        self._doubts = self._wastes = 0
        self.begin()

    def _all(self) -> list[int]:
        return [int(a) for a in self._rng.permutation(self.actions) for _ in range(self.settings.tries)]

    # -- the learner as the trial sees it ------------------------------------------------------------------------

    def begin(self) -> None:
        """An episode begins."""
        super().begin()
        self._motion_model.begin()
        self._rows: list[list[float]] = []
        # actions, the latest first
        self._taken = [self.actions] * self.settings.delays
        # distance and curvature of the last decision
        self._pace: Place = (0.0, 0.0)
        # likely places of the light in the robot's frame, the likeliest first, now and when the last readings were true
        self._lights: list[tuple[Belief, float]] = []
        self._lights_then = self._lights
        # distance from the light at the last decision but one, and at the last
        self._range = (inf, inf)
        # the goal's distance as it shows in this episode
        self._near = self.goal
        # latest decision at which it arrives if all goes well
        self._arrival = inf
        # the part that its model does not fit, once reported in this episode
        self.unfit = LONG if self._doubts else MOVES if self.moves else ""
        self._began_lost = self.lost
        # the survey by which the last episodes ended well
        self._known = self.survey.copy() if self._goals >= KNOWN and not self.lost else None
        # whether it has surveyed again in this episode because it was late
        self._surveyed = False
        # length of the plan, decisions
        self.plan = inf
        # what the laser has seen, and the sweeps since the last decision with the odometry of their moments
        self._seen_before = SeenPoints()
        self._sweeps: list[tuple[Array, Odometry]] = []
        # the plan round what was seen; None: nothing is near
        self._round: ActionPlan | None = None

    def look(self, points: Array, odometry: Odometry) -> None:
        """One sweep of the laser."""
        self._sweeps = [*self._sweeps[-9:], (points, odometry)]

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the result of the last action, and choose the next action."""
        self._decides(now)
        self._learn(odometry)
        # at every likely place the episode goes on, so the goal is nearer to the light
        if self._lights:
            farthest = max(hypot(x, y) + sqrt(0.5 * (xx + yy)) for (x, y, xx, yy, _), _ in self._lights)
            self._near = NEARER * farthest if farthest < self._near else self._near
        if self.lost and len(self._rows) % self.settings.anew == 0:
            self._survey_anew()
        if not self.lost and self.misfit > self.settings.doubt:
            self._misfits()
        self._untried += [a for a in self._motion_model.doubtful() for _ in range(self.settings.tries)]
        if not self.unfit and len(self._rows) % self.settings.anew == 0:
            self.unfit = self._judge()
        a = self._choose()
        if not self.lost and len(self._rows) + self.plan > self._arrival:
            self._late()
        self._taken = [a, *self._taken[:-1]]
        return a

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over."""
        self._learn(odometry)
        self._motion_model.end()
        self.episode += 1
        if len(self._rows) > 2:
            self._past.append(np.array(self._rows))
        wasted = not self._began_lost and self._wasted(success)
        self._wastes += wasted
        self._doubts = DOUBTS * self._wastes if wasted else max(self._doubts - 1, 0)
        if success and self._light is not None:
            # outside before, inside now
            seen = 0.5 * (self._range[0] + self._range[1])
            self._goals = 1 if self.lost else self._goals + 1
            off, count = seen - self.goal, min(self._goals, 10)
            self.goal += off / count
            # of the last ten
            self._scatter = self._scatter + (off * off - self._scatter) / count if count > 1 else 0.0
            self.lost = False
            self.misfit = 1.0
        self._trim()
        if self._past:
            if self.unfit or self._doubts or self.moves or self.flickers:
                self._think_again(self._past)
            self._survey_on(self._past)

    # -- learning ------------------------------------------------------------------------------------------------

    def _learn(self, odometry: Odometry) -> None:
        """Take the readings and the odometry since the last decision."""
        z, noise = self._readings()
        first = self._at is None
        distance, turn = self._moved(odometry)
        if not first:
            pace = distance, (turn / distance if abs(distance) > 0.1 * abs(self._usual()) > 0.0 else self._pace[1])
            if self._motion_model.learn(self._pace, np.array(self._taken), pace):
                self.unfit = self.unfit or "what the actions do"
                self._arrival = inf
            self._pace = pace
        self._look_round(distance, turn, odometry)
        self._rows.append([distance, turn, *z, *noise])
        self._track(z, noise)

    def _look_round(self, distance: float, turn: float, odometry: Odometry) -> None:
        """Take what the laser has seen since the last decision."""
        scale, drift = self._turning(near=True)
        self._seen_before.move(distance, scale * turn + (drift if self._rows else 0.0))
        for points, then in self._sweeps:
            way_x, way_y = odometry.x - then.x, odometry.y - then.y
            c, s = cos(then.theta), sin(then.theta)
            since = c * way_x + s * way_y, c * way_y - s * way_x, scale * wrap_angle(odometry.theta - then.theta)
            self._seen_before.add(points, since)
        self._sweeps = []

    @property
    def effects(self) -> Effects:
        """What each action does."""
        return self._motion_model.effects

    def _judge(self) -> str:
        """Return the part of the readings' model that does not fit; "" if the stated noise explains the last ones."""
        rows = self._latest(PIECE if self.moves else self.settings.judged)
        telling = np.isfinite(rows[:, 6:])
        if telling.any(axis=0).sum() == 1:
            return "the light, of which one sensor alone tells"
        readings = int(telling.sum())
        if self._untried or len(rows) < 2 * self.settings.anew or not readings:
            return ""
        limit = chi_square(readings, self.settings.alarm)
        _, square = seen_along(self.survey, rows, 0.0, *self._unsteady())
        # the survey fits as it is, so no search for a better survey is needed
        if square * readings <= limit:
            return ""
        survey, lights, _, _ = self._survey_with([*map(self._weighed, self._past), rows])
        if np.nansum(self._misses(survey, rows, lights)) <= limit:
            return ""
        if self.moves:
            return "the light"
        # the known survey may be a wrong minimum of the cost
        episode = self._latest(self.settings.window)
        survey, lights, _, _ = self._searched(episode)
        squares = self._misses(survey, episode, lights[-1])[-self.settings.judged :]
        return "the light" if np.nansum(squares) > limit else ""

    def _wasted(self, success: bool) -> bool:
        """Whether the episode took far longer than a plan from its start to where the light was at its end."""
        if not success or self._light is None:
            return True
        there = *self._on_map(np.array(self._rows), self._light), 0.0, 0.0, 0.0
        _, pending, k, effects = self._motion()
        at_rest = np.full_like(pending, self.actions)
        goal = hypot(*self._light[:2])
        least = quickest(there, 0.0, 0.0, at_rest, k, effects, 1.0, goal, self.settings.graze * goal).min()
        return bool(len(self._rows) - 1 > 1.5 * least)

    def _usual(self) -> float:
        """The longest distance to which an action leads in a decision."""
        return float(np.abs(self.effects.c[0, 0] / (1.0 - self.effects.k[0, 0])).max()) or 1e-9

    def _readings(self) -> tuple[Array, Array]:
        """Logarithms of the mean readings, and their variances; infinite for a useless sensor, see `sensor_map`."""
        lux = self._seen()
        n = len(lux)
        z, noise = np.zeros(SENSORS), np.full(SENSORS, inf)
        if not n:
            return z, noise
        varies = lux.std(axis=0) > 1e-6 * np.abs(lux.mean(axis=0))
        if not varies.any():
            # one sample, repeated
            lux, n = lux[-1:], 1
        dark, dazzled = (lux <= LUX_MIN).sum(axis=0), (lux >= self.ceilings(lux)).sum(axis=0)
        for k in range(SENSORS):
            frozen = not varies[k] and varies.any()
            if 2 * dazzled[k] >= n:
                z[k], noise[k] = log(np.median(lux[:, k])), -(self.spread[k] * 0.5 * pi / n + self.settings.model**2)
                continue
            if not isfinite(lux[:, k].sum()) or 2 * dark[k] >= n or frozen:
                continue
            mean = float(lux[:, k].mean())
            clipped = dark[k] or dazzled[k]
            if n > 2 and not clipped:
                share = float(lux[:, k].var()) / (mean * mean) * n / (n - 1)
                self.spread[k] += 0.02 * (share - self.spread[k])
            # the limit of a sensor's range distorts a mean but no median, which has more noise
            z[k] = log(np.median(lux[:, k]) if clipped else mean)
            noise[k] = self.spread[k] * (0.5 * pi if clipped else 1.0) / n + self.settings.model**2
        return z, noise

    def ceilings(self, lux: Array) -> Array:
        """Take samples, lux; return the largest readings that the sensors can give, as far as all samples show them."""
        most = np.fmax(self.most, np.fmax.reduce(lux))
        self.repeats[most > self.most] = 0
        self.most = most
        self.repeats += (lux == most).sum(axis=0)
        # a frozen sensor gives nothing else
        self.least = np.fmin(self.least, np.fmin.reduce(lux))
        return np.where((self.repeats >= REPEATED) & (self.least < most), np.minimum(most, LUX_MAX), LUX_MAX)

    def _track(self, z: Array, noise: Array) -> None:
        """Move the light's place in the robot's frame, and correct it by the readings of the middle of the way."""
        noise = np.where(self.blind, inf, noise * self.trust)
        if self._lights_then:
            then = len(self._rows) - 1 - self.late
            distance, turn = self._motion_at(then) if then > 0 else (0.0, 0.0)
            self._lights_then, square, count = followed(
                self._lights_then, self.survey, z, noise, distance, turn, self.settings.slip, *self._unsteady()
            )
            if count:
                self.misfit += 0.1 * (square / count - self.misfit)
        elif not self.lost:
            self._lights_then = sighted(self.survey, z, noise, self._unsteady()[1])
        self._carry_on()
        if self._light is not None:
            self._range = self._range[1], hypot(*self._light[:2])

    def _motion_at(self, number: int) -> Place:
        """Distance and turn of a decision of this episode, by the survey."""
        distance, turn = self._rows[number][:2]
        return distance, float(self.survey[SCALE] * turn + self.survey[DRIFT])

    def _carry_on(self) -> None:
        """Move the light's places from the time of the last readings to the present."""
        self._lights = list(self._lights_then)
        for number in range(max(len(self._rows) - self.late, 1), len(self._rows)):
            step = self._motion_at(number)
            self._lights = [
                (moved(light, *step, self.settings.slip, self._unsteady()[0]), cost) for light, cost in self._lights
            ]

    def _unsteady(self) -> tuple[float, float]:
        """Standard deviation of the light's own way in a decision, and the variance of its brightness."""
        return 0.5 * self._usual() if self.moves else 0.0, FLICKER**2 if self.flickers else 0.0

    def _misfits(self) -> None:
        """Survey again with the data of this episode; forget the survey if the readings do not fit even then."""
        rows = np.array(self._rows[-self.settings.window :])
        self._think_again([*self._past, rows])
        light, doubt = self._survey_on([*self._past, rows])
        misfit = self._follow(rows, light, doubt)
        if misfit > self.settings.doubt:
            self.unfit = self.unfit or self._judge()
            self._lose()
            self._survey_anew()
        else:
            self.misfit = 1.0

    def _late(self) -> None:
        """Survey again with the data of this episode; forget the survey if that was done before."""
        self.unfit = self.unfit or LONG
        if self._surveyed and not (self.moves and self._goals >= KNOWN):
            self._lose()
            self._rows, self._untried = self._rows[-10:], self._all()
            return
        self._surveyed, self._arrival = True, inf
        rows = np.array(self._rows[-self.settings.window :])
        self._think_again([*self._past, rows])
        light, doubt = self._survey_on([*self._past, rows])
        self._follow(rows, light, doubt)

    @property
    def _light(self) -> Belief | None:
        """The light's likeliest place in the robot's frame; None: unknown."""
        return self._lights[0][0] if self._lights else None

    def _lose(self) -> None:
        """Forget the survey, and the rows of the episodes before this one; what was kept of the sensors stays."""
        self.unfit = self.unfit or "the light"
        self.lost = True
        self.misfit = 1.0
        self.trust, self.blind, self.moves = np.ones(SENSORS), np.zeros(SENSORS, bool), False
        self.flickers = False
        self._past = []
        self._lights = self._lights_then = []
        self._arrival = inf

    def _trim(self) -> None:
        """Keep only the latest episodes."""
        while len(self._past) > 1 and sum(map(len, self._past)) - len(self._past[0]) > self.settings.window:
            self._keep(self._past.pop(0))
        self._past[-1:] = [rows[-self.settings.window :] for rows in self._past[-1:]]

    def _keep(self, rows: Array) -> None:
        """Keep what an episode told of the survey."""
        rows = self._weighed(rows)
        information, product = told(rows, self._stations([rows]), self.survey, self._sights(rows), self._unsteady()[1])
        if np.isfinite(information).all() and np.isfinite(product).all():
            self._told = KEPT * self._told[0] + information, KEPT * self._told[1] + product

    def _expected(self) -> Prior:
        """The survey to expect, by no robot in particular, and by what earlier episodes told of this one."""
        mean, square = self._prior()
        mean[:SENSORS] = self.survey[:SENSORS].mean()
        information, product = self._told
        known = np.asarray(np.linalg.solve(information + np.diag(1.0 / square), product + mean / square), np.float64)
        known[POWER] = min(max(known[POWER], POWERS[0]), POWERS[1])
        known[SCALE] = min(max(known[SCALE], SCALES[0]), SCALES[1])
        known[HEIGHT] = max(known[HEIGHT], 0.0)
        return Prior(mean, square, known, by_part(information))

    def _prior(self) -> tuple[Array, Array]:
        """The survey to expect without readings, with squared deviations: equal sensors, placed on the robot."""
        curvature = np.abs(self.effects.c[0, 1] / (1.0 - self.effects.k[0, 1])).max()
        # half its smallest turning circle
        on_robot = 0.5 / max(curvature, 1e-3)
        deviations = np.array([0.2] * 4 + [0.7] + [on_robot] * 8 + [0.1, DRIFTS, HEIGHTS])
        mean = np.zeros(NUMBERS)
        mean[POWER], mean[SCALE] = 2.0, 1.0
        return mean, deviations**2

    def _survey_anew(self) -> None:
        """Survey with the data of this episode alone."""
        rows = np.array(self._rows[-self.settings.window :])
        if len(rows) < 2 * self.settings.anew or self._untried:
            return
        self.blind = unmoved(rows)
        as_seen = self._weighed(rows)
        survey, lights, cost, doubt = self._searched(as_seen)
        if not isfinite(cost):
            return
        squares = self._misses(survey, as_seen, lights[0])
        if self._taken_again(as_seen, squares):
            return
        self.survey = survey
        if np.nansum(squares) <= self.settings.doubt * np.isfinite(squares).sum():
            self._follow(rows, lights[0], doubt)
            return
        self._think_again([rows])
        light, doubt = self._survey_on([rows])
        self._follow(rows, light, doubt)

    def _taken_again(self, rows: Array, squares: Array) -> bool:
        """Go by the survey of before again, if it fits the latest rows as well as the new one; return whether it does.

        `squares` are the new one's squared misfits. Its numbers were chosen by these rows, so it must fit better by
        twice their number to be preferred (H. Akaike, A New Look at the Statistical Model Identification, 1974).
        """
        latest = self.settings.judged // 2
        if self._known is None or len(rows) < latest:
            return False
        light, square = seen_along(self._known, rows[-latest:], self.settings.slip, *self._unsteady())
        readings = int(np.isfinite(rows[-latest:, 2 + SENSORS :]).sum())
        limit = min(chi_square(readings, self.settings.alarm), np.nansum(squares[-latest:]) + 2.0 * NUMBERS)
        if not square * readings <= limit:
            return False
        self.survey, self.lost, self.misfit = self._known.copy(), False, 1.0
        self._lights_then = [(light, 0.0)]
        self._carry_on()
        return True

    def _searched(self, rows: Array) -> tuple[Array, Array, float, Array]:
        """Survey an episode, starting from several guesses at the light's place; see `surveyed`."""
        prior = self._expected()
        radius = 2.0 * sqrt(prior.square[PLACES])
        one = np.zeros(len(rows), np.int64)
        stations = Stations(one, one, np.zeros(len(rows)), 0.0)
        found = []
        for start in [prior.mean, prior.known] if self._told[0].any() else [prior.mean]:
            for r in (radius, 3.0 * radius):
                for bearing in np.arange(8) * (pi / 4.0):
                    guess = start.copy()
                    guess[:4] += np.median(rows[:, 2:6]) + guess[POWER] * log(r) - guess[:4].mean()
                    light = np.array([[r * cos(bearing), r * sin(bearing)]])
                    found.append(surveyed(rows, stations, guess, light, prior, self._unsteady()[1], 12))
        best: tuple[Array, Array, float, Array] = min(found, key=lambda one: one[2])
        return best

    def _follow(self, rows: Array, on_the_map: Array, doubt: Array) -> float:
        """Follow the light from where a survey put it on the map of these rows; return their mean square misfit.

        A light that moves is followed along the rows instead.
        """
        rows = self._weighed(rows)
        along = rows[-self.settings.judged :] if self.moves else rows
        light, misfit = seen_along(self.survey, along, self.settings.slip, *self._unsteady())
        if not self.moves:
            x, y, heading = way(rows[:, 0], turned(self.survey, rows))
            on_map = on_the_map[0], on_the_map[1], doubt[0, 0], doubt[1, 1], doubt[0, 1]
            distance, bearing = hypot(x[-1], y[-1]), atan2(y[-1], x[-1])
            there = moved(moved(on_map, 0.0, bearing, 0.0, 0.0), distance, 0.0, 0.0, 0.0)
            light = moved(there, 0.0, heading[-1] - bearing, 0.0, 0.0)
        self._lights_then = [(light, 0.0)]
        self._carry_on()
        self._range = self._range[1], hypot(*self._lights[0][0][:2])
        return float(misfit)

    def _survey_with(self, episodes: list[Array], *, anew: bool = True) -> tuple[Array, Array, float, Array]:
        """Survey these episodes, starting from the known survey; see `surveyed`. The light's places are those in the
        last episode, one a row.

        `anew` starts from sensors in the middle, too, with the light at their height and above them.
        """
        prior, stations = self._expected(), self._stations(episodes)
        lights = np.concatenate([self._sights(rows) for rows in episodes])
        guesses = [self.survey]
        for height in (0.0, 1.0) if anew else ():
            guesses.append(np.concatenate([self.survey[:PLACES], prior.mean[PLACES:HEIGHT], [height]]))
        rows = np.concatenate(episodes)
        found = [surveyed(rows, stations, guess, lights, prior, self._unsteady()[1], 6) for guess in guesses]
        survey, lights, cost, doubt = min(found, key=lambda one: one[2])
        before, share = (each[-len(episodes[-1]) :] for each in (stations.before, stations.share[:, None]))
        after = np.minimum(before + 1, len(lights) - 1)
        return survey, (1.0 - share) * lights[before] + share * lights[after], cost, doubt

    def _stations(self, episodes: list[Array]) -> Stations:
        """The stations of the light in episodes: one each, or, if it moves, one every `STATION` decisions."""
        lengths = [len(rows) for rows in episodes]
        episode = np.repeat(np.arange(len(episodes)), lengths)
        if not self.moves:
            return Stations(episode, episode, np.zeros(len(episode)), 0.0)
        since = np.concatenate([np.arange(length) for length in lengths])
        first = np.cumsum([0, *((length - 1) // STATION + 2 for length in lengths)])
        # without odometry it knows of no way of its own
        farthest = STATION * max(self._usual(), SLOWEST)
        return Stations(episode, first[episode] + since // STATION, since % STATION / STATION, farthest**2)

    def _sights(self, rows: Array) -> Array:
        """The light's stations on the map of an episode, as the survey sees them; shape (stations, 2)."""
        ends = [len(rows)]
        if self.moves:
            ends = [min(STATION * k + 1, len(rows)) for k in range((len(rows) - 1) // STATION + 2)]
        found = []
        for end in ends:
            latest = rows[max(0, end - 6) if self.moves else 0 : end]
            light, _ = seen_along(self.survey, latest, self.settings.slip, *self._unsteady())
            found.append(self._on_map(rows[:end], light))
        return np.array(found)

    def _think_again(self, episodes: list[Array]) -> None:
        """Choose how late the readings are, and whether the light moves: as before, if nothing fits clearly better."""
        before = self.late, self.moves, self.flickers
        readings = sum(int(np.isfinite(rows[:, 6:]).sum()) for rows in episodes)
        others = [(0, True, False), (0, False, True), *((late, False, False) for late in LATE)]
        costs = {}
        for self.late, self.moves, self.flickers in dict.fromkeys([before, *others]):
            as_seen = list(map(self._weighed, episodes))
            cost = self._survey_with(as_seen, anew=False)[2]
            # H. Akaike, A New Look at the Statistical Model Identification, 1974, counts twice the numbers that are
            # chosen; a light that moves counts as if it had a place every PIECE decisions
            numbers = 4.0 * sum(max(1, len(rows) // PIECE) if self.moves else 1 for rows in as_seen)
            # what is more likely to vary is less likely to be what it is
            sure = [np.log1p(self._unsteady()[1] * (1.0 / np.abs(rows[:, 6:])).sum(axis=1)).sum() for rows in as_seen]
            costs[self.late, self.moves, self.flickers] = cost, numbers + float(sum(sure))
        least = min(cost for cost, _ in costs.values()) / (readings + 1.0)
        best = {key: cost / max(least, 1.0) + numbers for key, (cost, numbers) in costs.items()}
        best[before] -= UNLIKELY
        self.late, self.moves, self.flickers = min(best, key=lambda key: best[key])

    def _survey_on(self, episodes: list[Array]) -> tuple[Array, Array]:
        """Survey with these episodes; return the light's place in the last."""
        self.blind = unmoved(episodes[-1])
        survey, lights, cost, doubt = self._survey_with([self._weighed(rows) for rows in episodes])
        if isfinite(cost):
            self.survey = survey
            self._weigh(self._misses(survey, delayed(episodes[-1], self.late), lights))
        return lights[-1], doubt

    def _misses(self, survey: Array, rows: Array, light: Array) -> Array:
        """As `_squares`, with a light as steady as this one is."""
        return _squares(survey, rows, light, self._unsteady()[1])

    def _weigh(self, misfits: Array) -> None:
        """Trust a sensor less where it fits worse than the others, if most of them fit."""
        counts = np.isfinite(misfits).sum(axis=0)
        if (used := counts > self.settings.anew).sum() < 3:
            return
        each = np.where(used, np.nansum(misfits, axis=0) / np.maximum(counts, 1), 1.0)
        if np.median(each[used]) <= self.settings.doubt:
            self.trust = np.where(each > self.settings.doubt, each, 1.0)

    def _weighed(self, rows: Array) -> Array:
        """Rows as a survey takes them: readings beside the motion of their time, variances by each sensor's trust."""
        noise = np.where(self.blind, inf, rows[:, 2 + SENSORS :] * self.trust)
        return np.concatenate([delayed(rows, self.late)[:, : 2 + SENSORS], noise], axis=1)

    def _latest(self, count: int) -> Array:
        """At most so many of the latest rows of this episode, as a survey takes them."""
        return self._weighed(np.array(self._rows[-count - self.late :]))[-count:]

    def _on_map(self, rows: Array, light: Belief) -> Place:
        """The place, on the map of an episode's rows, of a light in the robot's frame at their end."""
        x, y, heading = way(rows[:, 0], turned(self.survey, rows))
        (ahead, left, *_), c, s = light, cos(heading[-1]), sin(heading[-1])
        return float(x[-1] + c * ahead - s * left), float(y[-1] + s * ahead + c * left)

    # -- choosing ------------------------------------------------------------------------------------------------

    def _choose(self) -> int:
        near = self._seen_before.near()
        if self._untried:
            return self._cautious(self._untried.pop(0), near)
        if self._light is None:
            return self._cautious(int(self._rng.integers(self.actions)), near)
        pace, pending, k, c = self._motion(near=len(near) > 0)
        goal = self._near or 0.25 * sqrt(self._prior()[1][PLACES])
        graze = max(self.settings.graze * goal, sqrt(self._scatter))
        times = [quickest(light, *pace, pending, k, c, 1.0, goal, graze) for light, _ in self._lights]
        likely = [exp(-0.5 * cost) for _, cost in self._lights]
        on_average = np.average(times, axis=0, weights=likely)
        a = int(on_average.argmin())
        self.plan = float(on_average[a])
        if len(near):
            before = (0, -1, 0, 0, 0) if self._round is None else self._round.later()[:5]
            found = ActionPlan(
                *quickest_clear(
                    self._light, *pace, pending, k, c, 1.0, goal, graze, distances(near), self._body, before
                )
            )
            if self._round is not None and self._arrival < inf:
                # what is seen on the way may make it longer
                self._arrival += 1.5 * max(0.0, found.time - self._round.time + 1.0)
            a, self.plan, self._round = found.a if found.m else found.e, found.time, found
            if self.lost:
                # its light may be elsewhere at the next decision, and the way round on the other side
                a = self._cautious(a, near)
        else:
            self._round = None
        if self._arrival == inf:
            longest = max(self.plan, *(float(each[a]) for each in times))
            self._arrival = len(self._rows) + 1.5 * longest + 2.0 * self.settings.tries
        return a

    def _turning(self, *, near: bool) -> tuple[float, float]:
        """Odometry's scale and drift; near obstacles a survey that never led to the goal is no better than none."""
        if near and self.lost:
            return 1.0, 0.0
        return float(self.survey[SCALE]), float(self.survey[DRIFT])

    def _motion(self, *, near: bool = False) -> tuple[Place, NDArray[np.int64], Array, Array]:
        """Distance and curvature of the last decision, the actions under way, and k and c; turns are true to scale."""
        delay = self._motion_model.delay()
        k, c = self.effects.k[delay], self.effects.c[delay].copy()
        scale, drift = self._turning(near=near)
        reached, least = c[0] / (1.0 - k[0]), 0.1 * self._usual()
        moves = np.abs(reached) > least
        c[1] *= scale
        c[1, moves] += (1.0 - k[1]) * drift / reached[moves]
        distance, curvature = self._pace
        curvature = scale * curvature + drift / distance if abs(distance) > least else scale * curvature
        return (distance, curvature), np.array(self._taken[:delay][::-1], np.int64), k, c

    def _cautious(self, wanted: int, near: Array) -> int:
        """The wanted action, or another that keeps clear of what is near.

        An untried action may be as bad as any: straight ahead. But where no other keeps clear, it may be the way out.
        """
        if not len(near):
            return wanted
        pace, pending, k, c = self._motion(near=True)
        untried = self.effects.sums[self._motion_model.delay(), 0, :, 0] < 1.0
        if untried.all():
            return wanted
        c[0, untried], c[1, untried] = c[0, int(np.abs(c[0]).argmax())], 0.0
        a, room = clearest(wanted, *pace, pending, k, c, 1.0, distances(near), self._body)
        others = np.flatnonzero(untried[: self.actions])
        if room < MARGIN and len(others):
            a = wanted if wanted in others else others[0]
        return int(a)

    def decision(self, odometry: Odometry) -> Decision:
        """The bearing's cell of 5 degrees, 0 behind; the misfit; distance and bearing of the light, and the plan."""
        del odometry
        if self._light is None:
            return Decision(None, None, ())
        bearing = atan2(self._light[1], self._light[0])
        values = hypot(*self._light[:2]), bearing, min(self.plan, 1e6)
        return Decision(round((bearing + pi) / (2.0 * pi) * 72) % 72, self.misfit, values)

    # -- what it keeps -------------------------------------------------------------------------------------------

    def table(self) -> StoredTable:
        """The survey: a row for each sensor with brightness, power and place; `about` holds all else it knows."""
        places = self.survey[PLACES:SCALE].reshape(4, 2)
        values = np.column_stack([self.survey[:4], np.full(4, self.survey[POWER]), places])
        memory = self.memory()
        del memory["rng"]
        about = {"agent": self.name, "episodes": self.episode, "sensors": places.tolist(), "knows": memory}
        return StoredTable(values, about)

    def shared(self) -> Learned:
        """One row: survey, spread, goal, and the actions' effects.

        It counts as known unless the pilot is lost, or its actions take longer than the shared delays.
        """
        row = np.concatenate([self.survey, self.spread, [self.goal], self.effects.numbers(SHARED)])
        visits = 0 if self.lost or self._motion_model.delay() >= SHARED else max(1, self._goals)
        return Learned(self.name, self.episode, (visits,), (tuple(row.tolist()),))

    def take(self, rows: Rows, taken: Sequence[bool], episodes: int) -> int:
        """Take over the others' row while it is lost; otherwise it keeps its own measurements."""
        del episodes
        survey, spread, goal, effects = np.split(np.array(rows[0]), np.cumsum([NUMBERS, SENSORS, 1]))
        if not (self.lost and taken[0] and _possible(survey, spread, float(goal[0]))):
            return 0
        self.survey, self.spread, self.goal = survey.copy(), spread.copy(), float(goal[0])
        self.effects.take(effects)
        self.lost, self.misfit, self._goals, self._untried = False, 1.0, 1, []
        return 1

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        return {
            **self._motion_model.memory(),
            "survey": self.survey.tolist(),
            "spread": self.spread.tolist(),
            "late": self.late,
            "moves": self.moves,
            "flickers": self.flickers,
            "trust": self.trust.tolist(),
            "blind": self.blind.tolist(),
            "least": self.least.tolist(),
            "most": self.most.tolist(),
            "repeats": self.repeats.tolist(),
            "goal": self.goal,
            "goals": self._goals,
            "scatter": self._scatter,
            "lost": self.lost,
            "doubts": self._doubts,
            "wastes": self._wastes,
            "untried": list(self._untried),
            "episode": self.episode,
            "information": self._told[0].tolist(),
            "product": self._told[1].tolist(),
            "past": [np.where(np.isfinite(rows), rows, -1.0).tolist() for rows in self._past],
            "rng": self._rng.bit_generator.state,
        }

    def sound(self) -> dict[str, bool]:
        """Return whether what it keeps is within its range, by the names of `memory`."""
        survey, rows = self.survey, np.concatenate([np.ones((1, _RECORD)), *self._past])
        within = POWERS[0] <= survey[POWER] <= POWERS[1] and SCALES[0] <= survey[SCALE] <= SCALES[1]
        return {
            "effects": self._motion_model.sound(LARGEST),
            "survey": _small(survey) and bool(within),
            "spread": _small(self.spread) and bool((self.spread > 0.0).all()),
            "trust": _small(self.trust) and bool((self.trust > 0.0).all()),
            "late": 0 <= self.late <= max(LATE),
            "doubts": 0 <= self._doubts <= DOUBTS * self._wastes <= LARGEST,
            "goal": 0.0 <= self.goal <= LARGEST,
            "scatter": 0.0 <= self._scatter <= LARGEST,
            "information": bool(np.isfinite(self._told[0]).all()),
            "product": bool(np.isfinite(self._told[1]).all()),
            "past": _small(rows[:, : 2 + SENSORS]) and bool((np.abs(rows[:, 2 + SENSORS :]) > 0.0).all()),
        }

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""
        self._motion_model.recall(memory)
        self.survey, self.spread = np.array(memory["survey"]), np.array(memory["spread"])
        self.trust = np.array(memory["trust"])
        # older memories lack some
        self.late, self.moves = int(memory.get("late", 0)), bool(memory.get("moves", False))
        self.flickers = bool(memory.get("flickers", False))
        self.blind = np.array(memory.get("blind", self.blind))
        self.least = np.array(memory.get("least", self.least))
        self.most = np.array(memory.get("most", self.most))
        self.repeats = np.array(memory.get("repeats", self.repeats))
        self.goal, self.lost, self.episode = float(memory["goal"]), bool(memory["lost"]), int(memory["episode"])
        self._goals, self._untried = int(memory["goals"]), list(memory["untried"])
        self._scatter = float(memory.get("scatter", 0.0))
        if "information" in memory:
            self._told = np.array(memory["information"]), np.array(memory["product"])
        self._past = [np.array(rows) for rows in memory["past"]]
        for rows in self._past:
            rows[:, 6:][rows[:, 6:] == -1.0] = inf
        self._doubts = int(memory.get("doubts", 0))
        self._wastes = int(memory.get("wastes", self._doubts > 0))
        self._rng.bit_generator.state = memory["rng"]


def _small(numbers: Array) -> bool:
    """Whether all numbers are at most `LARGEST`."""
    return bool((np.abs(numbers) <= LARGEST).all())


def chi_square(count: int, alarm: float) -> float:
    """Return the value that the sum of `count` squared deviations exceeds with the probability `alarm`.

    By E. B. Wilson and M. M. Hilferty, The Distribution of Chi-Square, 1931: its cube root is nearly normal.
    """
    if not count:
        return inf
    ninth = 2.0 / (9.0 * count)
    return float(count * (1.0 - ninth + NormalDist().inv_cdf(1.0 - alarm) * sqrt(ninth)) ** 3)


def delayed(rows: Array, late: int) -> Array:
    """Return an episode's rows with each reading beside the motion of `late` decisions before; it began at rest."""
    motion = np.concatenate([np.zeros((min(late, len(rows)), 2)), rows[: max(len(rows) - late, 0), :2]])
    return np.concatenate([motion, rows[:, 2:]], axis=1)


def unmoved(rows: Array) -> NDArray[np.bool_]:
    """Return the sensors whose readings in an episode's rows noise around a constant explains, while others vary.

    Others vary if the sum of their squares is four times what noise may make. A sensor that sees the light varies as
    they do, as the robot drives. Shape (4,).
    """
    weights = np.maximum(1.0 / rows[:, 2 + SENSORS :], 0.0)
    z, counts = rows[:, 2 : 2 + SENSORS], (weights > 0.0).sum(axis=0)
    mean = (weights * z).sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-12)
    squares = (weights * (z - mean) ** 2).sum(axis=0)
    limits = np.array([chi_square(int(count) - 1, 1e-3) if count >= 20 else inf for count in counts])
    varies = squares > 4.0 * limits
    blind: NDArray[np.bool_] = (squares <= limits) & np.isfinite(limits) & varies.any()
    return blind


def _squares(survey: Array, rows: Array, light: Array, common: float) -> Array:
    """Squared misfits of an episode's readings, in deviations, with the light at a place on its map; (rows, sensors).

    NaN for a useless sensor. `common` is the variance of what all readings have in common.
    """
    distance, turn = rows[:, 0], turned(survey, rows)
    x, y, heading = way(distance, turn)
    # the readings belong to the middle of the way
    middle, quarter = heading - 0.5 * turn, heading - 0.25 * turn
    east = light[..., 0] - x + 0.5 * distance * np.cos(quarter)
    north = light[..., 1] - y + 0.5 * distance * np.sin(quarter)
    ahead, left = (
        np.cos(middle) * east + np.sin(middle) * north,
        np.cos(middle) * north - np.sin(middle) * east,
    )
    places = survey[PLACES:SCALE].reshape(SENSORS, 2)
    square = (ahead[:, None] - places[:, 0]) ** 2 + (left[:, None] - places[:, 1]) ** 2 + survey[HEIGHT] + 1e-4
    foretold = survey[:SENSORS] - 0.5 * survey[POWER] * np.log(square)
    noise, miss = rows[:, 2 + SENSORS :], rows[:, 2 : 2 + SENSORS] - foretold
    if common:
        weights = 1.0 / np.abs(noise)
        miss -= ((weights * miss).sum(axis=1) / (1.0 / common + weights.sum(axis=1)))[:, None]
    return np.where(np.isfinite(noise) & ((noise > 0.0) | (miss > 0.0)), miss**2 / np.abs(noise), np.nan)


def _possible(survey: Array, spread: Array, goal: float) -> bool:
    """Whether these numbers can belong to a real robot and goal."""
    usual = POWERS[0] <= survey[POWER] <= POWERS[1] and SCALES[0] <= survey[SCALE] <= SCALES[1]
    positive = 0.0 < spread.min() <= spread.max() < 10.0 and 0.0 < goal < 50.0
    return bool(usual and positive and survey[HEIGHT] >= 0.0 and np.abs(survey).max() < 50.0)


def courses(table: StoredTable, lights: Array) -> Array:
    """Return the curvature that a stored survey drives for each place of the light, 1/m; shape (places,).

    The robot comes along straight ahead, and no action is pending. `lights` are places in the robot's frame, shape
    (places, 2), m.
    """
    memory = table.about["knows"]
    k, c = np.array(memory["effects"]["k"])[0], np.array(memory["effects"]["c"])[0]
    driven = steady(k, c)
    straight = int(np.abs(driven[1]).argmin())
    pending, scale = np.zeros(0, np.int64), float(memory["survey"][SCALE])
    goal = float(memory["goal"]) or 1e-3
    graze, pace = SETTINGS.graze * goal, driven[:, straight].tolist()
    beliefs = [(x, y, 0.0, 0.0, 0.0) for x, y in lights.tolist()]
    found = [int(quickest(each, *pace, pending, k, c, scale, goal, graze).argmin()) for each in beliefs]
    return np.asarray(scale * driven[1, found])


def _compile(*, round_obstacles: bool) -> None:
    """Let numba compile now the functions that are called while the robot drives, so that driving never waits.

    Those for obstacles take seconds, and are needed only with a laser.
    """
    rows, survey, square = np.ones((2, 2 + 2 * SENSORS)), np.ones(NUMBERS), np.ones(NUMBERS)
    prior = Prior(survey, square, survey, np.zeros((2, NUMBERS, NUMBERS)))
    stations = Stations(np.zeros(2, np.int64), np.zeros(2, np.int64), np.zeros(2), 0.0)
    surveyed(rows, stations, survey, np.ones((1, 2)), prior, 0.0, 1)
    told(rows, stations, survey, np.ones((1, 2)), 0.0)
    seen_along(survey, rows, 0.1, 0.0, 0.0)
    pending, c = np.zeros(1, np.int64), np.ones((2, 3))
    quickest((1.0, 0.0, 0.1, 0.1, 0.0), 0.1, 0.0, pending, np.zeros(2), c, 1.0, 0.5, 0.1)
    Effects(2, 1).learn(pending, (0.1, 0.1), (0.0, 0.0), 0.9)
    if round_obstacles:
        grid, body = distances(np.ones((1, 2))), body_of(0.5, 0.4, 0.0)
        motion = 0.1, 0.0, pending, np.zeros(2), c, 1.0
        quickest_clear((1.0, 0.0, 0.1, 0.1, 0.0), *motion, 0.5, 0.1, grid, body, (0, -1, 0, 0, 0))
        clearest(0, *motion, grid, body)
