"""Gains for an identified vehicle, found on its model: of the speed, and the whole schedule of the yaw rate."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from txt1.control.pid import Gains
from txt1.control.schedule import GainSet, Schedule
from txt1.experiments.identify import SAMPLING_PERIOD, Plant, speed_response, yaw_response
from txt1.experiments.metrics import BAND, excess, settled_after, smooth
from txt1.experiments.recording import Array
from txt1.model.vehicle import Geometry

# steps of the speed on which gains are tested, m/s
SPEEDS: Final = (0.25, 0.5, 0.75, 1.0)
# steps of the yaw rate, rad/s
TURNS: Final = ((0.0, 0.3), (0.3, 0.4), (0.4, 0.6), (0.6, 0.8))
# m/s at which they are tested; the loop's gain is the same at every speed
TEST_SPEED: Final = 0.5
# m/s, the fastest the controller accepts (thesis 4.2)
V_MAX: Final = 1.5
# seeds of the tests of the speed
SEEDS: Final = range(16)
# seeds of the yaw rate: more, as an encoder count is a larger share of a step there
TURN_SEEDS: Final = range(32)
# s of a test of the speed
TRIAL: Final = 4.0
# s of a test of the yaw rate
TURN_TRIAL: Final = 2.5
# allowed share of the present overshoot in the model, so that the vehicle shows no more than before
LESS: Final = 0.9
# overshoot, as a share of the step, that noise adds to a speed response without overshoot
NO_OVERSHOOT: Final = 0.001
# the same for the yaw rate
TURN_NO_OVERSHOOT: Final = 0.002
# s, the cost of an overshoot of 1 beyond the allowed; the same for noise, as a share of a step
EXCESS: Final = 10000.0
# s by which every step of the speed has to settle sooner in the model, to do so on the vehicle, ..
SETTLE_MARGIN: Final = 0.03
# ... and every step of the yaw rate
TURN_MARGIN: Final = 0.06
# cost of each s by which a step settles later than before, however soon others do
SLOWER: Final = 50.0

# values of K_P to test, times the speed per count
PROPORTIONAL: Final = (2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0)
# values of K_I / K_P to test, times the lag: 1 cancels the lag
RATES: Final = (0.4, 0.6, 0.7, 0.8, 0.9, 1.0)
# shares by which the best of these are then changed
FINER: Final = (0.06, 0.03, 0.015)
# values of K_P of the yaw rate, times the yaw rate per count
TURN_PROPORTIONAL: Final = (0.0, 0.05, 0.1, 0.15)
# values of K_I times the same, 1/s: the closed loop's rate
TURN_RATES: Final = (4.0, 5.0, 6.0, 6.5, 7.0, 7.5, 8.0, 9.0)

# number of gains tested altogether
CANDIDATES: Final = len(PROPORTIONAL) * len(RATES) + len(TURN_PROPORTIONAL) * len(TURN_RATES) + 2 * 9 * len(FINER)

# from one set-point to another, m/s or rad/s
Step = tuple[float, float]


class Quality(NamedTuple):
    """The quality of a response."""

    settling: float  # s
    # overshoot, as a share of the step
    overshoot: float
    # standard deviation when steady, as a share of the step
    noise: float


def linear_gains(
    plant: Plant, geometry: Geometry, before: Gains, motor_max: float, tried: Callable[[], None] = lambda: None
) -> Gains:
    """Return the gains with which the speed settles soonest, with no more overshoot and noise than before.

    `motor_max` is the safety gate's limit, counts; `tried` is called for each of the `CANDIDATES` of both loops.
    """

    def respond(gains: Gains, step: Step) -> list[Array]:
        return [speed_response(plant, gains, step[1], TRIAL, geometry, seed, motor_max) for seed in SEEDS]

    per_count = 1000.0 * plant.speed_gain  # mm/s
    candidates = (
        Gains(kp / per_count, kp / per_count * rate / plant.time_constant, 0.0)
        for kp, rate in product(PROPORTIONAL, RATES)
    )
    steps = [(0.0, v) for v in SPEEDS]
    return _best(respond, steps, before, candidates, SETTLE_MARGIN, NO_OVERSHOOT, tried)


def angular_gains(
    plant: Plant, geometry: Geometry, schedule: Schedule, tried: Callable[[], None] = lambda: None
) -> tuple[GainSet, ...]:
    """Return the schedule, with the same borders, with which the yaw rate settles soonest, with no more
    overshoot and noise.

    The yaw rate of a count is proportional to the speed. So gains found at one speed are divided by the ratio of the
    speeds for another. Each set takes the highest speed at which it is in force, because its loop gain is highest
    there.
    """
    borders = [gain_set.v_max for gain_set in schedule.sets]
    highest = [_highest(below, v_max, borders) for below, v_max in zip((-V_MAX, *borders), borders, strict=False)]
    # of the set in force in the tests
    here = highest[min(bisect_left(borders, TEST_SPEED), len(borders) - 1)]

    def respond(gains: Gains, step: Step) -> list[Array]:
        return [yaw_response(plant, gains, TEST_SPEED, *step, TURN_TRIAL, geometry, seed) for seed in TURN_SEEDS]

    # mrad/s
    per_count = 1000.0 * plant.steering_gain * here
    candidates = (Gains(kp / per_count, ki / per_count, 0.0) for kp, ki in product(TURN_PROPORTIONAL, TURN_RATES))
    best = _best(respond, TURNS, schedule.at(TEST_SPEED), candidates, TURN_MARGIN, TURN_NO_OVERSHOOT, tried)
    return tuple(
        GainSet(v_max, Gains(round(best.kp * here / speed, 3), round(best.ki * here / speed, 3), 0.0))
        for v_max, speed in zip(borders, highest, strict=True)
    )


def _highest(below: float, v_max: float, borders: Sequence[float]) -> float:
    """Return the highest speed at which a set is in force, m/s; the first and the last set extend to the limit."""
    return V_MAX if v_max in (borders[0], borders[-1]) else max(abs(below), abs(v_max))


def _best(
    respond: Callable[[Gains, Step], list[Array]],
    steps: Sequence[Step],
    before: Gains,
    candidates: Iterable[Gains],
    margin: float,
    no_overshoot: float,
    tried: Callable[[], None],
) -> Gains:
    """Return the best of the candidates and of gains between them, by their responses to the steps."""

    def qualities(gains: Gains) -> list[Quality]:
        return [_quality(respond(gains, step), *step) for step in steps]

    bars = qualities(before)

    def trial(gains: Gains) -> float:
        tried()
        costs = [_cost(one, bar, margin, no_overshoot) for one, bar in zip(qualities(gains), bars, strict=True)]
        return float(np.mean(costs))

    best = min(candidates, key=trial)
    for share in FINER:
        factors = (1.0 - share, 1.0, 1.0 + share)
        best = min((Gains(best.kp * p, best.ki * i, best.kd) for p, i in product(factors, factors)), key=trial)
    return Gains(*(round(value, 3) for value in best))


def _quality(responses: Sequence[Array], before: float, after: float) -> Quality:
    """Return the quality of the mean of several tests, judged as in `txt1.experiments.metrics`."""
    shares = (np.array(responses) - before) / (after - before)
    times: Array = np.arange(shares.shape[1], dtype=np.float64) * SAMPLING_PERIOD
    means = smooth(shares.mean(axis=0), times)
    noise = shares[:, len(times) // 2 :].std(axis=1).mean()
    overshoot = max(0.0, float(excess(means, 1.0).max()))
    return Quality(min(settled_after(means - 1.0, BAND, times), TRIAL), overshoot, float(noise))


def _cost(quality: Quality, bar: Quality, margin: float, no_overshoot: float) -> float:
    """Return the settling time, s, plus the costs of being worse than the bar."""
    more = max(0.0, quality.overshoot - max(LESS * bar.overshoot, no_overshoot)) + max(0.0, quality.noise - bar.noise)
    slower = max(0.0, quality.settling - bar.settling + margin)
    return quality.settling + EXCESS * more + SLOWER * slower
