"""A survey of light sensors: their places and brightness, the power by which light falls, the light's place and height.

It is made from an episode's rows, a row a decision: distance, turn, four log readings, their four variances. A variance
is infinite for a useless sensor, and negative for one at the end of its range, which tells only that the light is at
least so bright. The sensors sit at p with brightness g and power n, the light hangs sqrt(u) above them, and the
robot turns by s h + b in a decision when odometry says h:

        survey, light  <-  argmin  sum (z - g + n/2 log(|light - p|^2 + u))^2      (Gauss-Newton, outliers count less)

A light that moves does so evenly from each of its `Stations` to the next. What earlier episodes told of the survey is
kept as a normal distribution (`told`), of which each further survey is an update (`Prior`): a fixed-lag smoother that
marginalises what it drops (G. Sibley, L. Matthies and G. Sukhatme, Sliding Window Filter with Application to
Planetary Landing, 2010).

Between surveys a Kalman filter keeps the light's place in the robot's frame. Far from the light it knows the distance
well and the bearing badly: the light is on an arc, and each correction goes along that arc.
"""

from math import cos, exp, hypot, inf, log, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1_learners.planner import Array, Belief, compiled

SENSORS: Final = 4
# of the survey's numbers: brightness of the four first, then power, places, scale, drift, square of the height
POWER, PLACES, SCALE, DRIFT, HEIGHT = 4, 5, 13, 14, 15
NUMBERS: Final = 16
# least and largest power by which light may fall, and ...
POWERS: Final = (0.5, 6.0)
# ... scale of turns
SCALES: Final = (0.3, 3.0)
# squared misfit, in deviations, by which a place of the light is too unlikely, and is dropped
UNLIKELY: Final = 20.0
# square of the misfit, in deviations, from which a reading counts less
TAIL: Final = 8.0
# the same of a whole survey, from which it is taken to be another one than earlier episodes told
CHANGED: Final = 30.0
# variances by which odometry's scale and drift change from episode to episode
WANDERS: Final = (0.05**2, 0.002**2)
# rounds in which the part that readings have in common is found
ROUNDS: Final = 4


@compiled
def _seen_turned(belief: Belief, c: float, s: float) -> Belief:
    """A belief in a frame that has turned by an angle of this cosine and sine."""
    x, y, xx, yy, xy = belief
    return (
        c * x + s * y,
        c * y - s * x,
        c * c * xx + s * s * yy + 2.0 * c * s * xy,
        c * c * yy + s * s * xx - 2.0 * c * s * xy,
        c * s * (yy - xx) + (c * c - s * s) * xy,
    )


@compiled
def moved(belief: Belief, distance: float, turn: float, slip: float, wander: float) -> Belief:
    """Move the light in the robot's frame after the robot's motion, by odometry with an error of the share `slip`.

    `wander` is the standard deviation of the light's own way.
    """
    x, y, xx, yy, xy = belief
    c, s = cos(turn), sin(turn)
    x, y = x - distance * cos(0.5 * turn), y - distance * sin(0.5 * turn)
    xx += slip * slip * (distance * distance + turn * turn * y * y) + wander * wander
    yy += slip * slip * turn * turn * x * x + wander * wander
    xy -= slip * slip * turn * turn * x * y
    there: Belief = _seen_turned((x, y, xx, yy, xy), c, s)
    return there


@compiled
def _foretold(survey: Array, k: int, x: float, y: float) -> tuple[float, float, float, float]:
    """Return the predicted log reading of sensor k with the light at (x, y), and its slopes by x, y and the power."""
    apart_x, apart_y = x - survey[PLACES + 2 * k], y - survey[PLACES + 2 * k + 1]
    square = apart_x * apart_x + apart_y * apart_y + survey[HEIGHT] + 1e-4
    by_power = -0.5 * log(square)
    steep = -survey[POWER] / square
    return survey[k] + survey[POWER] * by_power, steep * apart_x, steep * apart_y, by_power


@compiled
def corrected(belief: Belief, survey: Array, z: Array, noise: Array, common: float) -> tuple[Belief, float, int]:
    """Correct the light's place by readings; return it, the sum of squared misfits in deviations, and their number.

    `common` is the variance of what all readings have in common, as of a light that flickers.
    """
    x, y, xx, yy, xy = belief
    # its estimate, and its covariances with the place
    a, aa, xa, ya = 0.0, common, 0.0, 0.0
    total, count = 0.0, 0
    for k in range(SENSORS):
        if noise[k] == inf:
            continue
        foretold, slope_x, slope_y, _ = _foretold(survey, k, x, y)
        miss = z[k] - foretold - a
        if noise[k] < 0.0 and miss < 0.0:
            continue
        along_x, along_y = xx * slope_x + xy * slope_y + xa, xy * slope_x + yy * slope_y + ya
        along_a = xa * slope_x + ya * slope_y + aa
        variance = slope_x * along_x + slope_y * along_y + along_a + abs(noise[k])
        total += miss * miss / variance
        count += 1
        a += along_a / variance * miss
        xa, ya = xa - along_x * along_a / variance, ya - along_y * along_a / variance
        aa -= along_a * along_a / variance
        step_x, step_y = along_x / variance * miss, along_y / variance * miss
        far = max(hypot(x, y), 1e-3)
        short = min(1.0, 0.5 * far / max(hypot(step_x, step_y), 1e-9))
        xx, yy, xy = (
            xx - along_x * along_x / variance,
            yy - along_y * along_y / variance,
            xy - along_x * along_y / variance,
        )
        # along the arc around the robot, and the belief with it; straight on, its own distance would count as a bearing
        across, onward = short * (x * step_y - y * step_x) / far / far, short * (x * step_x + y * step_y) / far
        c, s, longer = cos(across), sin(across), 1.0 + onward / far
        x, y, xx, yy, xy = _seen_turned((x, y, xx, yy, xy), c, -s)
        x, y = longer * x, longer * y
        xa, ya = c * xa - s * ya, s * xa + c * ya
    return (x, y, xx, yy, xy), total, count


@compiled
def _likely(lights: list[tuple[Belief, float]]) -> list[tuple[Belief, float]]:
    """Return the likely places with their extra cost over the likeliest, which comes first."""
    best = 0
    for i in range(len(lights)):
        if lights[i][1] < lights[best][1]:
            best = i
    kept = [(lights[best][0], 0.0)]
    for i in range(len(lights)):
        if i != best and lights[i][1] - lights[best][1] <= UNLIKELY:
            kept.append((lights[i][0], lights[i][1] - lights[best][1]))
    return kept


@compiled
def sighted(survey: Array, z: Array, noise: Array, common: float) -> list[tuple[Belief, float]]:
    """Find the places of the light that a set of readings allows, the likeliest first: Gauss-Newton from 16 bearings.

    Each comes with its extra cost over the first. With two sensors, or three in a line, there are two places.
    """
    level, weights = 0.0, 1e-12
    for k in range(SENSORS):
        if noise[k] < inf:
            level += (survey[k] - z[k]) / abs(noise[k])
            weights += 1.0 / abs(noise[k])
    far = exp(min(max(level / weights / survey[POWER], -3.0), 3.0))
    found = [((far, 0.0, far * far, far * far, 0.0), inf)]
    for guess in range(16):
        x, y = far * cos(guess * pi / 8.0), far * sin(guess * pi / 8.0)
        xx = yy = xy = cost = 0.0
        for _ in range(6):
            xx = yy = 1e-2 / (far * far)
            xy = to_x = to_y = cost = 0.0
            all_x = all_y = misses = weights = 0.0
            for k in range(SENSORS):
                if noise[k] == inf:
                    continue
                foretold, slope_x, slope_y, _ = _foretold(survey, k, x, y)
                miss = z[k] - foretold
                if noise[k] < 0.0 and miss < 0.0:
                    continue
                weight = 1.0 / abs(noise[k])
                cost += miss * miss * weight
                xx += slope_x * slope_x * weight
                yy += slope_y * slope_y * weight
                xy += slope_x * slope_y * weight
                to_x += slope_x * miss * weight
                to_y += slope_y * miss * weight
                all_x, all_y = all_x + slope_x * weight, all_y + slope_y * weight
                misses, weights = misses + miss * weight, weights + weight
            # without what they have in common
            share = common / (1.0 + common * weights)
            cost -= share * misses * misses
            xx, yy, xy = xx - share * all_x * all_x, yy - share * all_y * all_y, xy - share * all_x * all_y
            to_x, to_y = to_x - share * all_x * misses, to_y - share * all_y * misses
            area = xx * yy - xy * xy
            step_x, step_y = (yy * to_x - xy * to_y) / area, (xx * to_y - xy * to_x) / area
            short = min(1.0, 0.5 * far / max(hypot(step_x, step_y), 1e-9))
            x, y = x + short * step_x, y + short * step_y
        area = xx * yy - xy * xy
        one = ((x, y, yy / area, xx / area, -xy / area), cost)
        new = True
        for i in range(len(found)):
            if hypot(found[i][0][0] - x, found[i][0][1] - y) < 0.25 * far or found[i][1] == inf:
                new = False
                if cost < found[i][1]:
                    found[i] = one
                break
        if new:
            found.append(one)
    kept: list[tuple[Belief, float]] = _likely(found)
    return kept


@compiled
def followed(
    lights: list[tuple[Belief, float]],
    survey: Array,
    z: Array,
    noise: Array,
    distance: float,
    turn: float,
    slip: float,
    wander: float,
    common: float,
) -> tuple[list[tuple[Belief, float]], float, int]:
    """Update the places of the light after a decision; keep the places that the readings allow, the likeliest first.

    Also returned: the squared misfit of the likeliest place, in deviations, and the number of readings in it. The
    readings belong to the middle of the way; `turn` is true to scale.
    """
    after = list(lights)
    least, misfit, readings = inf, 0.0, 0
    for i in range(len(after)):
        belief, cost = after[i]
        belief = moved(belief, 0.5 * distance, 0.5 * turn, slip, wander)
        belief, square, count = corrected(belief, survey, z, noise, common)
        after[i] = moved(belief, 0.5 * distance, 0.5 * turn, slip, 0.0), cost + square
        if cost + square < least:
            least, misfit, readings = cost + square, square, count
    return _likely(after), misfit, readings


@compiled
def seen_along(survey: Array, rows: Array, slip: float, wander: float, common: float) -> tuple[Belief, float]:
    """Return the light's place at the end of an episode's rows, by the survey, and the mean square of the misfit."""
    lights = sighted(survey, rows[0, 2:6], rows[0, 6:], common)
    total, readings = 0.0, 1e-9
    for k in range(1, rows.shape[0]):
        turn = survey[SCALE] * rows[k, 1] + survey[DRIFT]
        lights, square, count = followed(
            lights, survey, rows[k, 2:6], rows[k, 6:], rows[k, 0], turn, slip, wander, common
        )
        total += square
        readings += count
    return lights[0][0], total / readings


def turned(survey: Array, rows: Array) -> Array:
    """The true turn in each decision of an episode's rows, by the survey; the first row is of the start."""
    turns: Array = survey[SCALE] * rows[:, 1]
    turns[1:] += survey[DRIFT]
    return turns


def way(distance: Array, turn: Array) -> tuple[Array, Array, Array]:
    """The way on the map of an episode: x, y and heading after each decision; it begins at 0, 0, 0."""
    heading = np.cumsum(turn)
    middle = heading - 0.5 * turn
    return np.cumsum(distance * np.cos(middle)), np.cumsum(distance * np.sin(middle)), heading


class Stations(NamedTuple):
    """Where the light is at each decision: on the way from one of its stations to the next, evenly."""

    # which episode, which station comes before, and the share of the way from there to the next; shape (rows,)
    episode: NDArray[np.int64]
    before: NDArray[np.int64]
    share: Array
    # variance of the way from a station to the next, m2; 0: it has one station in an episode
    apart: float


class Prior(NamedTuple):
    """What a survey is expected to be: one of no robot in particular, and one that earlier episodes told."""

    # of no robot in particular, and the squared deviations from it; shape (NUMBERS,)
    mean: Array
    square: Array
    # as earlier episodes told, and the information on the sensors and on odometry; shape (2, NUMBERS, NUMBERS)
    known: Array
    information: Array


@compiled
def _cost(
    rows: Array,
    stations: Stations,
    survey: Array,
    lights: Array,
    prior: Prior,
    common: float,
    gradient: Array,
    normal: Array,
) -> float:
    """Cost of a survey and of the light's places; `gradient` and `normal` are overwritten with its slopes."""
    gradient[:] = 0.0
    normal[:] = 0.0
    level = (survey[0] + survey[1] + survey[2] + survey[3]) / SENSORS
    cost = 0.0
    for i in range(NUMBERS):
        off = survey[i] - (level if i < SENSORS else prior.mean[i])
        # odometry is mostly right, and lamps hang low; where not, they may be far off
        tail = TAIL if i >= SCALE else 1e9
        trust = 1.0 / (1.0 + off * off / prior.square[i] / tail)
        cost += tail * log(1.0 + off * off / prior.square[i] / tail)
        gradient[i] += trust * off / prior.square[i]
        normal[i, i] += trust / prior.square[i]
    off_known = survey - prior.known
    for part in range(len(prior.information)):
        # a robot mostly stays as it is; where not, it may be another one
        pull = prior.information[part] @ off_known
        off = max(off_known @ pull, 0.0)
        trust = 1.0 / (1.0 + off / CHANGED)
        cost += CHANGED * log(1.0 + off / CHANGED)
        gradient[:NUMBERS] += trust * pull
        normal[:NUMBERS, :NUMBERS] += trust * prior.information[part]
    column = np.zeros(11, np.int64)
    slope = np.zeros(11)
    count = 11 if stations.apart > 0.0 else 9
    # slopes of what the readings of a decision have in common
    shared = np.zeros(len(gradient))
    # on the map, and how they change with the scale of turns, and with their drift
    x = y = heading = x_by = y_by = heading_by = x_in = y_in = heading_in = 0.0
    for t in range(rows.shape[0]):
        e, share_on = stations.before[t], stations.share[t]
        begins = t == 0 or stations.episode[t - 1] != stations.episode[t]
        if stations.apart > 0.0 and (begins or stations.before[t - 1] != e):
            for i in range(2):
                here, there = NUMBERS + 2 * e + i, NUMBERS + 2 * e + 2 + i
                step = lights[e + 1, i] - lights[e, i]
                cost += step * step / stations.apart
                gradient[here] -= step / stations.apart
                gradient[there] += step / stations.apart
                normal[here, here] += 1.0 / stations.apart
                normal[there, there] += 1.0 / stations.apart
                normal[here, there] -= 1.0 / stations.apart
                normal[there, here] -= 1.0 / stations.apart
        if begins:
            x = y = heading = x_by = y_by = heading_by = x_in = y_in = heading_in = 0.0
        # the first row of an episode is of the start, before which nothing drifts
        since = 0.0 if begins else 1.0
        distance, turn_by = rows[t, 0], rows[t, 1]
        turn = survey[SCALE] * turn_by + survey[DRIFT] * since
        # the readings belong to the middle of a decision's way
        for half in range(2):
            share = 0.25 + 0.5 * half
            middle = heading + share * turn
            middle_by, middle_in = heading_by + share * turn_by, heading_in + share * since
            c, s = cos(middle), sin(middle)
            x, y = x + 0.5 * distance * c, y + 0.5 * distance * s
            x_by, y_by = x_by - 0.5 * distance * s * middle_by, y_by + 0.5 * distance * c * middle_by
            x_in, y_in = x_in - 0.5 * distance * s * middle_in, y_in + 0.5 * distance * c * middle_in
            if half == 1:
                continue
            here = heading + 0.5 * turn
            here_by, here_in = heading_by + 0.5 * turn_by, heading_in + 0.5 * since
            c, s = cos(here), sin(here)
            light_x, light_y = lights[e, 0], lights[e, 1]
            if share_on > 0.0:
                light_x += share_on * (lights[e + 1, 0] - light_x)
                light_y += share_on * (lights[e + 1, 1] - light_y)
            east, north = light_x - x, light_y - y
            ahead, left = c * east + s * north, c * north - s * east
            ahead_by = left * here_by - c * x_by - s * y_by
            left_by = -ahead * here_by - c * y_by + s * x_by
            ahead_in = left * here_in - c * x_in - s * y_in
            left_in = -ahead * here_in - c * y_in + s * x_in
            a = 0.0
            # what the readings have in common: outliers count less there, too
            for again in range(ROUNDS if common > 0.0 else 0):
                misses, weights = 0.0, 1.0 / common
                for k in range(SENSORS):
                    if rows[t, 6 + k] == inf:
                        continue
                    miss = rows[t, 2 + k] - _foretold(survey, k, ahead, left)[0]
                    weight = 1.0 / abs(rows[t, 6 + k])
                    if rows[t, 6 + k] > 0.0 or miss > a:
                        trust = 1.0 / (1.0 + (miss - a) ** 2 * weight / TAIL) if again else 1.0
                        misses, weights = misses + trust * weight * miss, weights + trust * weight
                a = misses / weights
            if common > 0.0:
                cost += a * a / common
            weights = 0.0
            for k in range(SENSORS):
                if rows[t, 6 + k] == inf:
                    continue
                root = 1.0 / sqrt(abs(rows[t, 6 + k]))
                foretold, slope_x, slope_y, by_power = _foretold(survey, k, ahead, left)
                foretold += a
                if rows[t, 6 + k] < 0.0 and foretold > rows[t, 2 + k]:
                    continue
                miss, by_x, by_y = (foretold - rows[t, 2 + k]) * root, slope_x * root, slope_y * root
                cost += TAIL * log(1.0 + miss * miss / TAIL)
                trust = 1.0 / (1.0 + miss * miss / TAIL)
                column[0], slope[0] = k, root
                column[1], slope[1] = POWER, by_power * root
                column[2], slope[2] = PLACES + 2 * k, -by_x
                column[3], slope[3] = PLACES + 2 * k + 1, -by_y
                column[4], slope[4] = SCALE, by_x * ahead_by + by_y * left_by
                by_east, by_north = by_x * c - by_y * s, by_x * s + by_y * c
                column[5], slope[5] = NUMBERS + 2 * e, (1.0 - share_on) * by_east
                column[6], slope[6] = NUMBERS + 2 * e + 1, (1.0 - share_on) * by_north
                column[7], slope[7] = DRIFT, by_x * ahead_in + by_y * left_in
                # by_power is half the logarithm of one over the square
                column[8], slope[8] = HEIGHT, -0.5 * survey[POWER] * exp(2.0 * by_power) * root
                column[9], slope[9] = NUMBERS + 2 * e + 2, share_on * by_east
                column[10], slope[10] = NUMBERS + 2 * e + 3, share_on * by_north
                for i in range(count):
                    gradient[column[i]] += trust * miss * slope[i]
                    for j in range(count):
                        normal[column[i], column[j]] += trust * slope[i] * slope[j]
                    shared[column[i]] += trust * root * slope[i]
                weights += trust * root * root
            if common > 0.0:
                # the survey does not learn from it
                share = common / (1.0 + common * weights)
                for i in range(NUMBERS + 2):
                    row = i if i < NUMBERS else i + 2 * e
                    for j in range(NUMBERS + 2):
                        col = j if j < NUMBERS else j + 2 * e
                        normal[row, col] -= share * shared[row] * shared[col]
            shared[:] = 0.0
        heading, heading_by, heading_in = heading + turn, heading_by + turn_by, heading_in + since
    return cost


@compiled
def surveyed(
    rows: Array,
    stations: Stations,
    survey: Array,
    lights: Array,
    prior: Prior,
    common: float,
    rounds: int,
) -> tuple[Array, Array, float, Array]:
    """Make a survey by Gauss-Newton from a guess; also returns each episode's light, the cost, the last covariance.

    `rows` are the rows of all decisions: distance, turn, four log readings, their four variances; `stations` where
    the light is. Deviations from `mean` cost their square over `square`; brightnesses pay for their differences.
    `common` is the variance of what the readings of a decision have in common.
    """
    size = NUMBERS + 2 * lights.shape[0]
    gradient, normal = np.zeros(size), np.zeros((size, size))
    new_gradient, new_normal = np.zeros(size), np.zeros((size, size))
    cost = _cost(rows, stations, survey, lights, prior, common, gradient, normal)
    damping = 1e-2
    for _ in range(rounds):
        damped = normal.copy()
        for i in range(size):
            damped[i, i] += damping * normal[i, i] + 1e-6
        step = np.linalg.solve(damped, gradient)
        trial = survey - step[:NUMBERS]
        trial[POWER] = min(max(trial[POWER], POWERS[0]), POWERS[1])
        trial[HEIGHT] = max(trial[HEIGHT], 0.0)
        trial[SCALE] = min(max(trial[SCALE], SCALES[0]), SCALES[1])
        moved_lights = lights - step[NUMBERS:].copy().reshape(lights.shape)
        new = _cost(rows, stations, trial, moved_lights, prior, common, new_gradient, new_normal)
        if new < cost:
            gain = cost - new
            survey, lights, cost = trial, moved_lights, new
            gradient[:], normal[:] = new_gradient, new_normal
            damping *= 0.3
            if gain < 1e-3 * cost:
                break
        else:
            damping *= 8.0
    for i in range(size):
        normal[i, i] += 1e-6
    return survey, lights, cost, np.linalg.inv(normal)[-2:, -2:].copy()


@compiled
def told(rows: Array, stations: Stations, survey: Array, lights: Array, common: float) -> tuple[Array, Array]:
    """Return the information that rows have of a survey, and its product with the survey that fits them best.

    Linear about this survey; the lights' places are eliminated, as no other episode has them. Shapes (NUMBERS, NUMBERS)
    and (NUMBERS,).
    """
    size = NUMBERS + 2 * lights.shape[0]
    gradient, normal = np.zeros(size), np.zeros((size, size))
    nothing = Prior(survey, np.full(NUMBERS, inf), survey, np.zeros((0, NUMBERS, NUMBERS)))
    _cost(rows, stations, survey, lights, nothing, common, gradient, normal)
    for i in range(NUMBERS, size):
        normal[i, i] += 1e-6
    cross, places = normal[:NUMBERS, NUMBERS:].copy(), normal[NUMBERS:, NUMBERS:].copy()
    by_places = np.linalg.solve(places, np.column_stack((cross.T.copy(), gradient[NUMBERS:])))
    information = normal[:NUMBERS, :NUMBERS] - cross @ by_places[:, :NUMBERS].copy()
    slope = gradient[:NUMBERS] - cross @ by_places[:, NUMBERS].copy()
    return information, information @ survey - slope


def by_part(information: Array) -> Array:
    """Return the information on the sensors alone, and on odometry alone: either may change without the other.

    The power of the light and its height are left out: another lamp may hang there, and a lamp high above looks like
    one far away, so that a survey which held the one for the other would never find out.

    Odometry's scale and drift change a little from episode to episode, by `WANDERS`. Shape (2, NUMBERS, NUMBERS).
    """
    number = np.arange(NUMBERS)
    odometry, sensors = np.isin(number, (SCALE, DRIFT)), ~np.isin(number, (SCALE, DRIFT, POWER, HEIGHT))
    parts = np.zeros((2, NUMBERS, NUMBERS))
    for part, own in zip(parts, (sensors, odometry), strict=True):
        cross = information[np.ix_(own, ~own)]
        others = information[np.ix_(~own, ~own)] + 1e-6 * np.eye(int((~own).sum()))
        part[np.ix_(own, own)] = information[np.ix_(own, own)] - cross @ np.linalg.solve(others, cross.T)
    both = np.ix_(odometry, odometry)
    parts[1][both] = parts[1][both] @ np.linalg.inv(np.eye(2) + np.diag(WANDERS) @ parts[1][both])
    return parts
