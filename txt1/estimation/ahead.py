"""The way from where all sensors have been heard to now.

A sensor that is late tells nothing of the last moments, so the filter runs behind, where each reading has come when its
turn does. From there an output predictor goes on by the rates that wheels and gyro have told since (A. Khosravian,
J. Trumpf, R. Mahony, T. Hamel, *Recursive attitude estimation in the presence of multi-rate and multi-delay vector
measurements*, ACC 2015; the "fusion time horizon" of PX4's filter). So a late reading has nothing computed again.

The rates are followed one by one, each by the gain of a scalar Kalman filter. A rate that has changed by d from one
reading to the next, in dt seconds, has moved the pose by d dt / 2 more, as of a random walk. The pose and the
covariance go on in one piece.
"""

from collections.abc import Iterable
from math import inf, sqrt
from typing import Final

from txt1.estimation.ekf import OO, UU, Belief, State, predict, turn_share
from txt1.estimation.measurement import KIND_ENCODERS, KIND_GYRO, Measurement
from txt1.estimation.spinning import HOLDS

# s, the longest prediction in one piece
STEP_MAX: Final = 0.1
# standard deviations of a rate's miss beyond which it is the motion that has changed
TRACKS: Final = 2.0
# s from one reading of the wheels to the next
CYCLE: Final = 0.02


def ahead(
    belief: Belief,
    begin: float,
    now: float,
    readings: Iterable[Measurement],
    density: State,
    sideways: tuple[float, float],
    *,
    turning: bool,
    exact: bool = True,
) -> Belief:
    """The belief at `now`, s of the run, of one at `begin` and of the readings since, of believed sensors, in order.

    `density` and `sideways` are those of `ekf.predict`; `turning`: the yaw rate is a gyro's, else the wheels';
    `exact`: their track width is known.
    """
    _, _, _, rolled, omega, bias, slip, width = belief.mean
    _, _, _, qu, qo, _, _, _ = density
    uu, oo = belief.triangle[UU], belief.triangle[OO]
    # of the piece so far, of the wheels, m and rad
    way = turned = 0.0
    time = rolled_at = omega_at = begin
    for at, _, kind, rows, values, sigmas, _ in readings:
        if at - begin > STEP_MAX and time > begin:
            belief = _gone(belief, time - begin, way, turned, (uu, oo), density, sideways)
            begin, way, turned = time, 0.0, 0.0
        since, time = at - time, at
        way, turned = way + rolled * since, turned + omega * since
        if kind is KIND_GYRO:
            dt = at - omega_at
            change, oo = _followed(values[0] - bias - omega, oo + qo * dt, sigmas[0])
            omega, turned, omega_at = omega + change, turned + 0.5 * change * dt, at
        elif kind is KIND_ENCODERS:
            if rows[0] == 0:
                dt = at - rolled_at
                change, uu = _followed(values[0] - rolled, uu + qu * dt, sigmas[0], HOLDS * CYCLE)
                rolled, way, rolled_at = rolled + change, way + 0.5 * change * dt, at
            if rows[-1] == 1 and not turning:
                dt, grip = at - omega_at, 1.0 / turn_share(belief.mean, exact=exact)
                change, oo = _followed(values[-1] * grip - omega, oo + qo * dt, sigmas[-1] * grip)
                omega, turned, omega_at = omega + change, turned + 0.5 * change * dt, at
    way, turned = way + rolled * (now - time), turned + omega * (now - time)
    belief = _gone(belief, now - begin, way, turned, (uu, oo), density, sideways)
    x, y, theta = belief.mean[:3]
    spread = list(belief.triangle)
    spread[UU] += qu * (now - rolled_at)
    spread[OO] += qo * (now - omega_at)
    return Belief((x, y, theta, rolled, omega, bias, slip, width), tuple(spread), belief.lean)


def _followed(left: float, variance: float, sigma: float, most: float = inf) -> tuple[float, float]:
    """The change of a rate that misses its reading by `left`, and its variance then.

    A reading that misses by more than `most` is of wheels that lock or spin: the car's speed is anywhere between its
    last one and theirs.
    """
    noise, square = sigma * sigma, left * left
    if square > TRACKS * TRACKS * (variance + noise):
        # strong tracking, as in the filter
        variance += square
        if square > most * most:
            noise = square
    gain = variance / (variance + noise)
    return gain * left, variance * (1.0 - gain)


def _gone(
    belief: Belief,
    dt: float,
    way: float,
    turned: float,
    rates: tuple[float, float],
    density: State,
    sideways: tuple[float, float],
) -> Belief:
    """The belief dt seconds later, after so long a way (m) and turn (rad).

    The rates have been as uncertain as they are after their readings, of variances `rates`.
    """
    if dt <= 0.0:
        return belief
    x, y, theta, _, _, bias, slip, width = belief.mean
    (
        xx, xy, xt, xu, xo, xb, xs, xw,
        yy, yt, yu, yo, yb, ys, yw,
        tt, tu, to, tb, ts, tw,
        uu, uo, ub, us, uw,
        oo, ob, os, ow,
        bb, bs, bw,
        ss, sw,
        ww,
    ) = belief.triangle  # fmt: skip
    qx, qy, qt, _, _, qb, qs, qw = density
    u, o = sqrt(rates[0] / uu) if uu > 0.0 < rates[0] else 1.0, sqrt(rates[1] / oo) if oo > 0.0 < rates[1] else 1.0
    likely = Belief(
        (x, y, theta, way / dt, turned / dt, bias, slip, width),
        (
            xx, xy, xt, u * xu, o * xo, xb, xs, xw,
            yy, yt, u * yu, o * yo, yb, ys, yw,
            tt, u * tu, o * to, tb, ts, tw,
            rates[0], u * o * uo, u * ub, u * us, u * uw,
            rates[1], o * ob, o * os, o * ow,
            bb, bs, bw,
            ss, sw,
            ww,
        ),
        belief.lean,
    )  # fmt: skip
    return predict(likely, dt, (qx, qy, qt, 0.0, 0.0, qb, qs, qw), sideways)
