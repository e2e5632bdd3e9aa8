"""Measures of an experiment: steps, stops, droops, circles, legs.

Speeds are judged as means over 0.2 s, from the true motion if it is known, else from the distance counted by the
encoders. The distance contains every count, although behind a line only two readings in five arrive.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import inf, pi
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from txt1.experiments.profile import Profile
from txt1.experiments.recording import Array, Recording, mean_of
from txt1.experiments.runner import Leg, Outcome
from txt1.model.battery import INTERCEPT_V, SAFE_END_MIN, SLOPE_V_PER_MIN

# s of a mean
MEAN_WINDOW: Final = 0.2
# share of a step within which a response counts as settled
BAND: Final = 0.05
# an encoder count in a tick, m/s and rad/s: no band is narrower
QUANTUM: Final = {"v": 0.016, "omega": 0.064}
# share of a step's time, at its end, that counts as steady
STEADY_SHARE: Final = 0.5
# s after which a circle is judged
SETTLE_IN: Final = 2.0
# m of a leg, from its start, in which the robot still comes round the corner
LEG_START: Final = 2.0

# s by which a run's responses may lag behind another's
DELAYS: Final = np.arange(0.0, 0.2, 0.005)
DELAY_MAX: Final = float(DELAYS[-1])

Channel = Literal["v", "omega"]


class StepMetrics(NamedTuple):
    """The response to a change of a set-point."""

    # the set-point that changed
    channel: Channel
    # time of the change, s of the run
    time: float
    # set-point before, m/s or rad/s
    before: float
    # set-point from then on
    after: float
    # s from 10 % to 90 % of the step; None: it never reached 90 %
    rise: float | None
    # share of the step by which the response exceeds its steady value before it is steady; never negative
    overshoot: float
    # standard error of the overshoot for repeated runs; None for a single run, whose noise counts as overshoot
    overshoot_error: float | None
    # s until it stays within the band around the steady value; None: never
    settling: float | None
    # steady value less the set-point, m/s or rad/s
    steady_error: float
    # standard deviation of the unsmoothed response when steady, m/s or rad/s
    noise: float
    # half the band's width, m/s or rad/s
    band: float


def smooth(values: Array, times: Array) -> Array:
    """Return means over 0.2 s centred on each sample, shape as `values`; shorter at both ends."""
    if len(values) < 2:
        return values
    half = round(0.5 * MEAN_WINDOW / float(np.median(np.diff(times))))
    sums = np.concatenate(([0.0], np.cumsum(values)))
    at = np.arange(len(values))
    first, last = np.maximum(at - half, 0), np.minimum(at + half + 1, len(values))
    means: Array = (sums[last] - sums[first]) / (last - first)
    return means


def response(recording: Recording, channel: Channel, first: int = 0, last: int | None = None) -> Array:
    """Return the speed (m/s) or the yaw rate (rad/s) of the samples from `first` to before `last`, as means
    over 0.2 s.
    """
    time = recording["time"][first:last]
    if recording.knows_truth:
        return smooth(recording[f"true_{channel}"][first:last], time)
    read, new = np.unique(recording["read"], return_index=True)
    read, way = even(read), recording["way" if channel == "v" else "turn"][new]
    # a board reads its encoders at 50 Hz and reports at 20 Hz: only means over whole 0.1 s are even
    end = np.minimum(time + 0.5 * MEAN_WINDOW, min(time[-1], read[-1]))
    begin = np.maximum(end - MEAN_WINDOW, time[0])
    span = end - begin
    means: Array = (np.interp(end, read, way) - np.interp(begin, read, way)) / np.where(span > 0.0, span, np.inf)
    return means


def even(times: Array) -> Array:
    """Return times at an even pace, with gaps, that fit these best: readings are even, but arrive unevenly."""
    if len(times) < 3:
        return times
    between = np.diff(times)
    beats = np.concatenate(([0.0], np.cumsum(np.round(between / np.median(between)))))
    # a beat brings a single reading: of two at the same beat the first is late
    spare = beats - np.arange(len(beats))
    beats = np.minimum.accumulate(spare[::-1])[::-1] + np.arange(len(beats))
    fitted: Array = np.polynomial.Polynomial.fit(beats, times, 1)(beats)
    return fitted


def changes(recording: Recording) -> list[tuple[int, int]]:
    """Return first and past-the-last sample of every interval of constant set-points."""
    moved = np.nonzero((np.diff(recording["set_v"]) != 0.0) | (np.diff(recording["set_omega"]) != 0.0))[0] + 1
    bounds = [0, *moved.tolist(), len(recording)]
    return [(a, b) for a, b in pairwise(bounds) if b > a]


def steps(recording: Recording, *, stops: bool = False) -> list[StepMetrics]:
    """Return the responses to every change of a set-point to a value other than 0, or of the speed's to 0, in order."""
    found = []
    channels: tuple[Channel, ...] = ("v",) if stops else ("v", "omega")
    for channel in channels:
        set_point = recording[f"set_{channel}"]
        for first, last in changes(recording):
            # the speed's response goes on while only the yaw rate's set-point changes, but is then disturbed
            # a run begins at rest
            before = float(set_point[first - 1]) if first else 0.0
            if set_point[first] != before and bool(set_point[first]) is not stops and last - first >= 10:
                found.append(_step(recording, channel, first, last, before))
    return sorted(found, key=lambda step: step.time)


def _step(recording: Recording, channel: Channel, first: int, last: int, before: float) -> StepMetrics:
    truth = recording.knows_truth
    after = float(recording[f"set_{channel}"][first])
    size = after - before
    speed = response(recording, channel, first, last)
    elapsed = recording["time"][first:last] - recording["time"][first]
    late = elapsed >= (1.0 - STEADY_SHARE) * elapsed[-1]
    steady = float(speed[late].mean())
    band = BAND * abs(size) if truth else max(BAND * abs(size), QUANTUM[channel])
    settling = settled_after(speed - steady, band, elapsed)
    share = (speed - before) / size
    above = [np.nonzero(share >= level)[0] for level in (0.1, 0.9)]
    return StepMetrics(
        channel,
        float(recording["time"][first]),
        before,
        after,
        float(elapsed[above[1][0]] - elapsed[above[0][0]]) if len(above[1]) else None,
        max(0.0, float(excess(speed, size).max())),
        None,
        settling if settling < (1.0 - 0.5 * STEADY_SHARE) * elapsed[-1] else None,
        steady - after,
        float(recording[f"true_{channel}" if truth else channel][first:last][late].std()),
        band,
    )


def settled_after(deviation: Array, band: float, times: Array) -> float:
    """Return the time from which a deviation stays within its band, also between samples; inf for never."""
    outside = np.nonzero(np.abs(deviation) > band)[0]
    if not len(outside):
        return float(times[0])
    last = int(outside[-1])
    if last + 1 == len(times):
        return inf
    a, b = np.sign(deviation[last]) * deviation[last : last + 2]
    return float(times[last] + (a - band) / (a - b) * (times[last + 1] - times[last]))


def excess(speed: Array, size: float) -> Array:
    """Return the overshoot of a response before its steady part, as a share of the step's size.

    The peaks of the steady part are noise, and a response that creeps up to its end value has not overshot.
    """
    begins = round((1.0 - STEADY_SHARE) * len(speed))
    beyond: Array = (speed[: max(begins, 1)] - speed[begins:].mean()) / size
    return beyond


def repeated_steps(recordings: Sequence[Recording]) -> list[StepMetrics]:
    """Return the responses of the mean of several runs of a profile, each overshoot with its standard error.

    The maximum of noisy values is too high on average, even in a mean of runs. So the first half of the runs gives the
    time of the peak, and the second half its height at this time. Then the halves change roles. The error is that of a
    half: if both halves agree on the time, the two heights are not independent.
    """
    mean = mean_of(recordings)
    if len(recordings) < 2:
        return steps(mean)
    intervals = dict(changes(mean))
    found = []
    for step in steps(mean):
        first = int(np.searchsorted(mean["time"], step.time))
        last, size = intervals[first], step.after - step.before
        beyond = np.array([excess(response(run, step.channel, first, last), size) for run in recordings])
        even, odd = beyond[::2], beyond[1::2]
        heights = np.concatenate((even[:, odd.mean(axis=0).argmax()], odd[:, even.mean(axis=0).argmax()]))
        error = float(heights.std(ddof=1) / np.sqrt(0.5 * len(heights)))
        found.append(step._replace(overshoot=max(0.0, float(heights.mean())), overshoot_error=error))
    return found


class Deviation(NamedTuple):
    """The distance between the responses of two runs of one profile."""

    # the quantity that responded
    channel: Channel
    # delay of the other run's responses to changes, s: least and most
    delay: tuple[float, float]
    # root mean square of the difference of the responses after this delay, m/s or rad/s
    rms: float
    # largest difference, m/s or rad/s
    largest: float


def difference(recording: Recording, other: Recording, channel: Channel) -> Deviation | None:
    """Return the difference of two runs' responses; None if their set-points never changed.

    A line delays responses: each response is moved by the delay with which it fits best, up to 0.2 s.
    """
    delays, apart = [], []
    time, until = recording["time"], min(recording["time"][-1], other["time"][-1]) - DELAY_MAX
    here, there = response(recording, channel), response(other, channel)
    for first, last in changes(recording):
        at = time[first:last]
        # later means overlap with the next response
        at = at[at < min(at[-1] - 0.5 * MEAN_WINDOW, until)]
        if not len(at):
            continue
        tried = [here[first : first + len(at)] - np.interp(at + delay, other["time"], there) for delay in DELAYS]
        best = min(range(len(tried)), key=lambda number: float((tried[number] ** 2).sum()))
        apart.append(tried[best])
        set_point = recording[f"set_{channel}"]
        if first and set_point[first] != set_point[first - 1]:
            delays.append(float(DELAYS[best]))
    if not delays:
        return None
    return Deviation(channel, (min(delays), max(delays)), *_rms_and_largest(np.concatenate(apart)))


def paths_apart(recording: Recording, other: Recording) -> tuple[float, float]:
    """Return the distance of a run's places from the path of the other, m: root mean square and largest."""
    return _rms_and_largest(_distances(*other.path(), *recording.path()))


def _rms_and_largest(errors: Array) -> tuple[float, float]:
    return float(np.sqrt((errors**2).mean())), float(np.abs(errors).max())


class Droop(NamedTuple):
    """The loss of speed at a change of the yaw rate."""

    time: float  # s of the run
    # rad/s commanded
    before: float
    # rad/s commanded
    after: float
    # largest loss of speed, as a share of the set-point; negative: the speed only rose
    droop: float


def droops(recording: Recording) -> list[Droop]:
    """Return the loss of speed in the second after each change of the yaw rate at a constant speed."""
    found = []
    time, set_v, set_omega = recording["time"], recording["set_v"], recording["set_omega"]
    speed = response(recording, "v")
    for first, last in changes(recording):
        if first == 0 or set_v[first] != set_v[first - 1] or set_v[first] == 0.0:
            continue
        until = min(last, int(np.searchsorted(time, time[first] + 1.0)))
        second_before = min(int(np.searchsorted(time, time[first] - 1.0)), int(first) - 1)
        had = float(speed[second_before:first].mean())
        lowest = float((np.sign(had) * speed[first:until]).min())
        droop = (abs(had) - lowest) / abs(float(set_v[first]))
        found.append(Droop(float(time[first]), float(set_omega[first - 1]), float(set_omega[first]), droop))
    return found


class Circle(NamedTuple):
    """A circle that was driven lap after lap."""

    # radius of the least-squares circle, m
    radius: float
    # v / omega of the set-points, m
    asked: float
    # number of whole laps
    laps: int
    # largest distance of a point of a lap from the lap before, m; None for a single lap
    lap_to_lap: float | None


def circle(recording: Recording) -> Circle | None:
    """Return the circle that was driven at the last set-points; None if it was no circle."""
    intervals = [(a, b) for a, b in changes(recording) if recording["set_omega"][a] != 0.0]
    if not intervals:
        return None
    turns = recording["set_omega"][-1] != 0.0
    first, last = intervals[-1] if turns else max(intervals, key=lambda interval: interval[1] - interval[0])
    asked = abs(float(recording["set_v"][first] / recording["set_omega"][first]))
    time = recording["time"]
    first = int(np.searchsorted(time, time[first] + SETTLE_IN))
    if last - first < 10:
        return None
    x, y = (values[first:last] for values in recording.path())
    heading = np.unwrap(recording["true_theta" if recording.knows_truth else "theta"][first:last])
    # least squares: x^2 + y^2 = 2 a x + 2 b y + c
    a, b, c = np.linalg.lstsq(np.c_[2.0 * x, 2.0 * y, np.ones(len(x))], x**2 + y**2, rcond=None)[0]
    turned = np.abs(heading - heading[0])
    laps = int(turned[-1] // (2.0 * pi))
    gaps = []
    for lap in range(1, laps + (turned[-1] > 2.0 * pi * laps)):
        now = (turned >= 2.0 * pi * lap) & (turned < 2.0 * pi * (lap + 1))
        before = (turned >= 2.0 * pi * (lap - 1) - 0.1) & (turned < 2.0 * pi * lap + 0.1)
        gaps.append(float(_distances(x[now], y[now], x[before], y[before]).max()))
    return Circle(float(np.sqrt(c + a * a + b * b)), asked, laps, max(gaps) if gaps else None)


def _distances(x: Array, y: Array, other_x: Array, other_y: Array) -> Array:
    """Return the distance of each point from the line through the others, m."""
    squares = (x[:, None] - other_x) ** 2 + (y[:, None] - other_y) ** 2
    near = squares.argmin(axis=1)
    near = np.clip(near, 1, len(other_x) - 2)
    along_x, along_y = other_x[near + 1] - other_x[near - 1], other_y[near + 1] - other_y[near - 1]
    norm = np.hypot(along_x, along_y)
    across: Array = np.abs((x - other_x[near]) * along_y - (y - other_y[near]) * along_x) / np.where(norm, norm, 1.0)
    return across


class LegMetrics(NamedTuple):
    """The robot's distance from a leg, after the corner."""

    # length of the leg, m
    start: tuple[float, float]
    end: tuple[float, float]  # m
    # cross-track error, m
    rms: float
    largest: float  # m


def cross_track(recording: Recording, leg: Leg) -> Array:
    """Return the distance of every sample's place from the line of a leg, left positive, m."""
    return _on_leg(recording, leg)[1]


def _on_leg(recording: Recording, leg: Leg) -> tuple[Array, Array, float]:
    """Return every sample's place along a leg and left of it, and the leg's length, m."""
    x, y = recording.path()
    (x0, y0), (x1, y1) = leg.start, leg.end
    norm = max(float(np.hypot(x1 - x0, y1 - y0)), 1e-9)
    along: Array = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / norm
    across: Array = ((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / norm
    return along, across, norm


def leg_metrics(recording: Recording, legs: Sequence[Leg]) -> list[LegMetrics]:
    """Return the cross-track error of every leg with samples, except the way to the first waypoint."""
    found = []
    time = recording["time"]
    for leg, ends in zip(legs[1:], [*(each.time for each in legs[2:]), inf], strict=False):
        along, across, length = _on_leg(recording, leg)
        error = across[(time >= leg.time) & (time < ends) & (along >= min(LEG_START, 0.5 * length))]
        if len(error):
            found.append(LegMetrics(leg.start, leg.end, *_rms_and_largest(error)))
    return found


class BatteryMetrics(NamedTuple):
    """The discharge of the battery."""

    # slope of the line through the voltage up to the safe end, V/min
    slope: float
    # intercept of this line, V
    intercept: float
    # deviation from the thesis's line
    slope_error: float
    # likewise
    intercept_error: float
    # minutes until the end
    driven: float
    # root mean square error of the remaining time, against the 46 minutes, s
    remaining_rms: float
    # the largest of these errors, s
    remaining_worst: float


def battery(recording: Recording) -> BatteryMetrics | None:
    """Return the discharge line; None if the voltage is unknown or the run is too short for a line."""
    known = ~np.isnan(recording["voltage"])
    minutes, voltage = recording["time"][known] / 60.0, recording["voltage"][known]
    if len(minutes) < 2 or minutes[-1] - minutes[0] < 0.5:
        return None
    safe = minutes <= SAFE_END_MIN
    slope, intercept = (float(value) for value in np.polyfit(minutes[safe], voltage[safe], 1))
    left = np.maximum(60.0 * (SAFE_END_MIN - minutes), 0.0)
    error = recording["remaining"][known] - left
    off_the_thesis = slope / -SLOPE_V_PER_MIN - 1.0, intercept / INTERCEPT_V - 1.0
    remaining = float(np.sqrt(np.nanmean(error**2))), float(np.nanmax(np.abs(error)))
    return BatteryMetrics(slope, intercept, *off_the_thesis, float(minutes[-1]), *remaining)


def measure(outcome: Outcome, profile: Profile) -> dict[str, Any]:
    """Return all measures of a run, ready for JSON: SI units, minutes for the battery."""
    recording, legs = outcome.recording, outcome.legs
    return {
        "stopped_by": outcome.stopped_by,
        "duration_s": float(recording["time"][-1]) if len(recording) else 0.0,
        "samples": len(recording),
        "battery_warning_s": outcome.warned,
        "pose_source": outcome.pose_source,
        "legs_driven": [[leg.time, leg.start, leg.end] for leg in legs],
        **judge(recording, legs, profile),
    }


def judge(recording: Recording, legs: Sequence[Leg], profile: Profile) -> dict[str, Any]:
    """Return the part of `measure` that follows from the samples and the legs."""
    found: dict[str, Any] = {"judged_by": "true motion" if recording.knows_truth else "encoders"}
    if not len(recording):
        return found
    if profile.waypoints is None:
        found["steps"] = [step._asdict() for step in steps(recording)]
        found["stops"] = [step._asdict() for step in steps(recording, stops=True)]
        found["droop"] = [droop._asdict() for droop in droops(recording)]
        if profile.figure == "path" and (driven := circle(recording)) is not None:
            found["circle"] = driven._asdict()
    else:
        found["legs"] = [leg._asdict() for leg in leg_metrics(recording, legs)]
    if profile.figure == "battery" and (discharge := battery(recording)) is not None:
        found["battery"] = discharge._asdict()
    return found
