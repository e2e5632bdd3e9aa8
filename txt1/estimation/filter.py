"""An extended Kalman filter for a car: pose, velocities, the gyro's bias, slip and track.

Pure functions over numbers. "BLK" is Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking
and Navigation* (Wiley, 2001):

    x' = f(x, u),  P' = F P F^T + Q                                  BLK 10.3.2
    S = H P H^T + R,  K = P H^T S^-1,  x' = x + K (z - h(x))         BLK 10.3.2
    P' = P - K S K^T                                                 BLK (5.2.3-13)

The errors of a measurement's numbers are independent. So the numbers are taken in one after the other. The result is
the same (BLK 5.2.6), and the divisions are by numbers, not by matrices. With the miss y = (z - h x) / sigma, w = P h /
sigma, sigma^2 = S,

    x' = x + w y,  P' = P - w w^T,  NIS = sum of y^2

The misses are independent and of variance 1. P is kept as its upper triangle, so it is symmetric whatever is rounded.
The products are written out, as an array costs more than the numbers in it: a step takes two thirds of numpy's time.

Below are beliefs that know less than before, and `Walk`, which has how the state changes by itself.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import asin, cos, exp, hypot, inf, isfinite, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.estimation.sensors import SLOT
from txt1.units import new

Array = NDArray[np.float64]
State = tuple[float, float, float, float, float, float, float, float]
Triangle = tuple[float, ...]
"""36 numbers: the upper triangle of a covariance, row by row."""
Row = State | int
"""A row of a Jacobian; an index if the measured number is that state itself: `THETA`, `ROLLED` or `OMEGA`."""

X, Y, THETA, ROLLED, OMEGA, BIAS, SLIP, WIDTH = range(8)
"""Places in the state: pose (m, rad), the wheels' speed (m/s), yaw rate (rad/s), the gyro's bias (rad/s), slip, width.

Slip is the share of the wheels' way that the ground does not see, because they slip or are smaller than believed: the
car's speed is (1 - slip) of the wheels'. That speed is not in the state itself: then the encoders would seem to tell
something of the slip whenever it changes, which alone they cannot.

Width is the share by which the wheels turn more than the car, as they stand further apart than was measured, or scrub.
Where the track width is known well, it is 0, and wheels that turn otherwise than the gyro tell of their slip.
"""
SIZE: Final = 8
# places of variances in a covariance's triangle
XX, YY, TT, BB, SS = 0, 8, 15, 30, 33
# of all that slip has a part in
OF_SLIP: Final = (6, 13, 19, 24, 28, 31, 33, 34)
# places among the parameters: the share by which a gyro reads too much; how much it slides outwards in curves, s^2/m;
# s by which the gyro is late
SCALE, OUTWARDS, CLOCK = range(3)
# m/s below which the steering angle is not told from speed and yaw rate
CRAWL: Final = 0.05
# s for which the tyres' angle to their way is off by the same amount: about a curve; chosen
SIDEWAYS_FOR: Final = 0.5
# sine of twice the steering angle beyond which it is noise: full lock is 0.56
SINE_MAX: Final = 0.88


class Lean(NamedTuple):
    """How a belief leans with parameters that the filter takes for known, and what places have told of these.

    The separate bias filter of B. Friedland, *Treatment of bias in recursive filtering*, IEEE TAC 14(4), 1969: so many
    states more, kept outside of the filter, which need not know of them. The parameters are told by places alone: what
    wheels and gyro would tell of them may be slip. Elsewhere they are consider states (S. F. Schmidt, Advances in
    Control Systems 3, 1966): they are not estimated, and their uncertainty counts.
    """

    # the parameters, as they are taken for, shape (k,): by `SCALE`, `OUTWARDS`, and three for each sensor of positions
    value: Array
    # the mean's change by a unit of each, shape (8, k)
    by: Array
    # theirs, shape (k, k)
    covariance: Array


@dataclass(slots=True)
class Belief:
    """A state and its covariance; nothing changes it, and a frozen one takes four times as long to make."""

    mean: State
    # of the covariance
    triangle: Triangle
    # None: of no parameter
    lean: Lean | None = None

    @property
    def covariance(self) -> Array:
        """The covariance, shape (8, 8)."""
        matrix = np.empty((SIZE, SIZE))
        matrix[_UPPER] = matrix.T[_UPPER] = self.triangle
        return matrix


_UPPER: Final = np.triu_indices(SIZE)
_UNITS: Final = np.eye(SIZE)


def belief_of(mean: Sequence[float] | Array, covariance: Array, lean: Lean | None = None) -> Belief:
    """The belief of a mean and a covariance, shapes (8,) and (8, 8)."""
    return Belief(_state(mean), tuple(covariance[_UPPER].tolist()), lean)


def _state(numbers: Iterable[float]) -> State:
    x, y, theta, rolled, omega, bias, slip, width = map(float, numbers)
    return x, y, theta, rolled, omega, bias, slip, width


def upright(belief: Belief, moved_by: Array | float = 0.0, spread: Array | None = None) -> Belief:
    """The belief that leans no more: the parameters are moved, and uncertain by this covariance there; None: theirs."""
    lean = belief.lean
    if lean is None:
        return belief
    spread = lean.covariance if spread is None else spread
    mean = np.array(belief.mean) - lean.by @ (moved_by + np.zeros(len(lean.value)))
    return belief_of(mean, belief.covariance + lean.by @ spread @ lean.by.T)


@dataclass(frozen=True, slots=True)
class Drift:
    """How much the state may change by itself in a second: standard deviations of random walks."""

    # m: sideways slip
    position: float = 0.002
    # rad: a gyro's scale and its axis
    heading: float = 0.0015
    # m/s: the motors and the floor
    speed: float = 0.25
    # rad/s: the steering
    yaw_rate: float = 0.35
    # rad/s of the gyro
    bias: float = 0.0002
    # of the wheels: two per cent within 4 s, as floors vary
    slip: float = 0.01
    # of the track width by which a car turns, where it is not known well: tyres, load and floor
    width: float = 0.002
    # s^2/m of the tyres' angle to their way, for each m/s^2 across it, before anything is known of it: rubber has 0.02
    sideways: float = 0.02

    def density(self) -> State:
        """The variances of a second."""
        position, bias, slip, width = self.position**2, self.bias**2, self.slip**2, self.width**2
        return position, position, self.heading**2, self.speed**2, self.yaw_rate**2, bias, slip, width


def ramped(belief: Belief, place: int, variance: float, dt: float) -> Belief:
    """The belief when a rate has changed evenly over the last dt seconds, by an amount of this variance.

    The pose has then changed by half of this over dt. A single random number moves rate and pose, so the covariance
    grows by a matrix of rank one.

    Args:
        belief: as predicted with the rate as it was.
        place: `ROLLED` or `OMEGA`.
        variance: (m/s)^2 or (rad/s)^2.
        dt: s.

    """
    theta, half, row = belief.mean[THETA], 0.5 * dt, np.zeros(SIZE)
    row[place] = 1.0
    if place == OMEGA:
        row[THETA] = half
    else:
        row[[X, Y]] = half * cos(theta), half * sin(theta)
    return widened(belief, variance * np.outer(row, row))


def predict(
    belief: Belief,
    dt: float,
    density: State,
    sideways: tuple[float, float] = (0.0, 0.0),
) -> Belief:
    """The belief dt seconds later, on the arc of its speed and yaw rate, thesis (2.2).

    A tyre pushes sideways by the angle between its heading and its way, so the car slides outwards in curves: its way
    is turned by -k abs(v) omega (R. Rajamani, *Vehicle Dynamics and Control*, Springer 2012, 2.4).

    Args:
        belief: now.
        dt: s.
        density: variances that a second adds, of `Drift.density`.
        sideways: k and its standard deviation, s^2/m, which moves it across its way for `SIDEWAYS_FOR`.

    """
    x, y, theta, rolled, omega, bias, slip, width = belief.mean
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
    qx, qy, qt, qu, qo, qb, qs, qw = density
    grip = 1.0 - slip
    v = rolled * grip
    half = 0.5 * omega * dt
    # the chord's length over the arc's
    ratio = sin(half) / half if abs(half) > 1e-4 else 1.0
    outwards = -sideways[0] * abs(v)
    way = theta + half + outwards * omega
    c, s = dt * ratio * cos(way), dt * ratio * sin(way)
    # variance of a second across the way, over dt^2
    across = SIDEWAYS_FOR * (sideways[1] * v * v * omega) ** 2 / dt if dt > 0.0 else 0.0

    # F is 1 but for these, by row and column; the way's turn is taken to depend on omega alone
    lead = 0.5 * dt + outwards
    f_xt, f_xu, f_xo, f_xs = -v * s, grip * c, -lead * v * s, -rolled * c
    f_yt, f_yu, f_yo, f_ys = v * c, grip * s, lead * v * c, -rolled * s
    f_to = dt

    # M = F P, where it is needed
    m_xx = xx + f_xt * xt + f_xu * xu + f_xo * xo + f_xs * xs
    m_xy = xy + f_xt * yt + f_xu * yu + f_xo * yo + f_xs * ys
    m_xt = xt + f_xt * tt + f_xu * tu + f_xo * to + f_xs * ts
    m_xu = xu + f_xt * tu + f_xu * uu + f_xo * uo + f_xs * us
    m_xo = xo + f_xt * to + f_xu * uo + f_xo * oo + f_xs * os
    m_xb = xb + f_xt * tb + f_xu * ub + f_xo * ob + f_xs * bs
    m_xs = xs + f_xt * ts + f_xu * us + f_xo * os + f_xs * ss
    m_xw = xw + f_xt * tw + f_xu * uw + f_xo * ow + f_xs * sw
    m_yy = yy + f_yt * yt + f_yu * yu + f_yo * yo + f_ys * ys
    m_yt = yt + f_yt * tt + f_yu * tu + f_yo * to + f_ys * ts
    m_yu = yu + f_yt * tu + f_yu * uu + f_yo * uo + f_ys * us
    m_yo = yo + f_yt * to + f_yu * uo + f_yo * oo + f_ys * os
    m_yb = yb + f_yt * tb + f_yu * ub + f_yo * ob + f_ys * bs
    m_ys = ys + f_yt * ts + f_yu * us + f_yo * os + f_ys * ss
    m_yw = yw + f_yt * tw + f_yu * uw + f_yo * ow + f_ys * sw
    m_tt, m_tu, m_to = tt + f_to * to, tu + f_to * uo, to + f_to * oo
    m_tb, m_ts, m_tw = tb + f_to * ob, ts + f_to * os, tw + f_to * ow

    lean = belief.lean
    if lean is not None:
        by = lean.by.copy()
        by[:3] += np.array((
            (0.0, 0.0, f_xt, f_xu, f_xo, 0.0, f_xs, 0.0), (0.0, 0.0, f_yt, f_yu, f_yo, 0.0, f_ys, 0.0),
            (0.0, 0.0, 0.0, 0.0, f_to, 0.0, 0.0, 0.0),
        )) @ lean.by  # fmt: skip
        if len(lean.value) > OUTWARDS:
            by[:2, OUTWARDS] -= abs(v) * omega * v * s, -abs(v) * omega * v * c
        lean = new(Lean, (lean.value, by, lean.covariance))
    # the speed has changed evenly, so it has moved the car by half of that over dt, as in `ramped`: BLK 6.3.2
    shared = 0.5 * qu * dt
    q_xu, q_yu = shared * f_xu, shared * f_yu
    # P' = M F^T + Q dt
    return Belief(
        (x + v * c, y + v * s, theta + omega * dt, rolled, omega, bias, slip, width),
        (
            m_xx + m_xt * f_xt + (m_xu + 0.5 * q_xu) * f_xu + m_xo * f_xo + m_xs * f_xs + qx * dt + across * s * s,
            m_xy + m_xt * f_yt + (m_xu + 0.5 * q_xu) * f_yu + m_xo * f_yo + m_xs * f_ys - across * s * c,
            m_xt + m_xo * f_to, m_xu + q_xu, m_xo, m_xb, m_xs, m_xw,

            m_yy + m_yt * f_yt + (m_yu + 0.5 * q_yu) * f_yu + m_yo * f_yo + m_ys * f_ys + qy * dt + across * c * c,
            m_yt + m_yo * f_to, m_yu + q_yu, m_yo, m_yb, m_ys, m_yw,

            m_tt + m_to * f_to + qt * dt, m_tu, m_to, m_tb, m_ts, m_tw,

            uu + qu * dt, uo, ub, us, uw,

            oo + qo * dt, ob, os, ow,

            bb + qb * dt, bs, bw,

            ss + qs * dt, sw,

            ww + qw * dt,
        ),
        lean,
    )  # fmt: skip


def update(
    belief: Belief,
    residual: Sequence[float],
    h: Sequence[Row],
    sigmas: Sequence[float],
    leans: Array | None = None,
    *,
    tells: bool = True,
) -> tuple[Belief, float, list[float]]:
    """The belief with a measurement taken in, the square of its Mahalanobis distance (NIS), and its misses.

    The misses are the residual's parts in standard deviations, each without the share of the parts before it. A
    measurement that is no number changes nothing.

    Args:
        belief: before.
        residual: measurement less expectation, z - h(x).
        h: Jacobian of the expectation, by rows, each of the pose or of the motion.
        sigmas: standard deviations of the measurement's numbers, the roots of R's diagonal.
        leans: by how much a unit of each parameter that the belief leans with changes each number, by rows; None:
            not at all.
        tells: whether places tell of the parameters.

    """
    lean = belief.lean
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
    # the mean's change
    dx = dy = dt = du = do = db = ds = dw = nis = 0.0
    misses = []
    if lean is not None:
        (_, by, spread_then), delta = lean, np.zeros(len(lean.value))
    for place, row in enumerate(h):
        left, noise = residual[place], sigmas[place]
        # c = P h, its spread h c, and the part of what is left that the mean's change says already
        if isinstance(row, int):
            if row == ROLLED:
                cx, cy, ct, cu, co, cb, cs, cw = xu, yu, tu, uu, uo, ub, us, uw
                spread, said = uu, du
            elif row == OMEGA:
                cx, cy, ct, cu, co, cb, cs, cw = xo, yo, to, uo, oo, ob, os, ow
                spread, said = oo, do
            elif row == THETA:
                cx, cy, ct, cu, co, cb, cs, cw = xt, yt, tt, tu, to, tb, ts, tw
                spread, said = tt, dt
            else:
                raise ValueError(f"state {row} is measured by a row of its own")
        else:
            hx, hy, ht, hu, ho, hb, hs, hw = row
            # of the motion
            if hu or ho or hb or hs or hw:
                cx = xu * hu + xo * ho + xb * hb + xs * hs + xw * hw
                cy = yu * hu + yo * ho + yb * hb + ys * hs + yw * hw
                ct = tu * hu + to * ho + tb * hb + ts * hs + tw * hw
                cu = uu * hu + uo * ho + ub * hb + us * hs + uw * hw
                co = uo * hu + oo * ho + ob * hb + os * hs + ow * hw
                cb = ub * hu + ob * ho + bb * hb + bs * hs + bw * hw
                cs = us * hu + os * ho + bs * hb + ss * hs + sw * hw
                cw = uw * hu + ow * ho + bw * hb + sw * hs + ww * hw
                spread = cu * hu + co * ho + cb * hb + cs * hs + cw * hw
                said = du * hu + do * ho + db * hb + ds * hs + dw * hw
            else:
                # of the pose
                cx, cy, ct = xx * hx + xy * hy + xt * ht, xy * hx + yy * hy + yt * ht, xt * hx + yt * hy + tt * ht
                cu, co = xu * hx + yu * hy + tu * ht, xo * hx + yo * hy + to * ht
                cb, cs = xb * hx + yb * hy + tb * ht, xs * hx + ys * hy + ts * ht
                cw = xw * hx + yw * hy + tw * ht
                spread, said = cx * hx + cy * hy + ct * ht, dx * hx + dy * hy + dt * ht
        sigma = sqrt(spread + noise * noise)
        miss = (left - said) / sigma
        misses.append(miss)
        nis += miss * miss
        wx, wy, wt = cx / sigma, cy / sigma, ct / sigma
        wu, wo = cu / sigma, co / sigma
        wb, ws, wz = cb / sigma, cs / sigma, cw / sigma
        if lean is not None:
            here = 0.0 if leans is None else leans[place]
            by, spread_then, delta, square = _leaning(
                by, spread_then, delta, row, here, sigma, miss, (wx, wy, wt, wu, wo, wb, ws, wz)
            )
            nis += square - miss * miss
        dx, dy, dt, du = dx + wx * miss, dy + wy * miss, dt + wt * miss, du + wu * miss
        do, db, ds = do + wo * miss, db + wb * miss, ds + ws * miss
        dw += wz * miss
        # by twos and threes, as more at once make a tuple
        xx, xy, xt = xx - wx * wx, xy - wx * wy, xt - wx * wt
        xu, xo = xu - wx * wu, xo - wx * wo
        xb, xs, xw = xb - wx * wb, xs - wx * ws, xw - wx * wz
        yy, yt, yu = yy - wy * wy, yt - wy * wt, yu - wy * wu
        yo, yb, ys = yo - wy * wo, yb - wy * wb, ys - wy * ws
        yw, tw = yw - wy * wz, tw - wt * wz
        tt, tu, to = tt - wt * wt, tu - wt * wu, to - wt * wo
        tb, ts = tb - wt * wb, ts - wt * ws
        uu, uo = uu - wu * wu, uo - wu * wo
        ub, us, uw = ub - wu * wb, us - wu * ws, uw - wu * wz
        oo, ob, os = oo - wo * wo, ob - wo * wb, os - wo * ws
        ow, bw, sw = ow - wo * wz, bw - wb * wz, sw - ws * wz
        bb, bs = bb - wb * wb, bs - wb * ws
        ss, ww = ss - ws * ws, ww - wz * wz
    if not isfinite(nis):
        return belief, nis, misses
    if lean is not None:
        if leans is not None and tells:
            # the parameters, too, are where their mean is now
            more = (by @ delta).tolist()
            dx, dy, dt, du = dx - more[0], dy - more[1], dt - more[2], du - more[3]
            do, db, ds, dw = do - more[4], db - more[5], ds - more[6], dw - more[7]
            lean = new(Lean, (lean.value + delta, by, spread_then))
        else:
            lean = new(Lean, (lean.value, by, lean.covariance))
    x, y, t, u, o, b, s, w = belief.mean
    return Belief((x + dx, y + dy, t + dt, u + du, o + do, b + db, s + ds, w + dw), (
        xx, xy, xt, xu, xo, xb, xs, xw,
        yy, yt, yu, yo, yb, ys, yw,
        tt, tu, to, tb, ts, tw,
        uu, uo, ub, us, uw,
        oo, ob, os, ow,
        bb, bs, bw,
        ss, sw,
        ww,
    ), lean), nis, misses  # fmt: skip


def _leaning(
    by: Array, spread: Array, delta: Array, row: Row, leans: Array | float, sigma: float, miss: float, w: State
) -> tuple[Array, Array, Array, float]:
    """How the belief leans after a number: its row of the Jacobian, miss, sigma and w, as in `update`.

    By how much the parameters have moved, `delta`, and their covariance are those of a Kalman filter of the misses.
    The last is the number's part of the NIS.
    """
    if isinstance(row, int):
        expected, tells = by[row], row <= THETA
    else:
        expected, tells = np.array(row) @ by, any(row[:ROLLED])
    moved = (leans - expected) / sigma
    by = by + np.array(w)[:, None] * moved
    if not tells:
        return by, spread, delta, miss * miss
    gain = spread @ moved
    own, left = 1.0 + float(moved @ gain), miss - float(moved @ delta)
    return by, spread - gain[:, None] * (gain / own), delta + gain * (left / own), left * left / own


def encoders(mean: State, *, exact: bool = True) -> tuple[tuple[float, float], tuple[Row, Row]]:
    """Speed and yaw rate that the wheels tell in a state, and the rows of their Jacobian."""
    _, _, _, rolled, omega, _, slip, width = mean
    if not exact:
        share = 1.0 + width
        return (rolled, omega * share), (ROLLED, (0.0, 0.0, 0.0, 0.0, share, 0.0, 0.0, omega))
    grip = 1.0 - slip
    return (rolled, omega / grip), (ROLLED, (0.0, 0.0, 0.0, 0.0, 1.0 / grip, 0.0, omega / (grip * grip), 0.0))


def centred(v: float, omega: float, wheelbase: float, phi: float | None, share: float = 1.0) -> tuple[float, float]:
    """Speed and yaw rate of the car's middle by encoder wheels that are steered, m/s and rad/s.

    A hub's velocity is projected on its wheel's heading, and the wheels tell that: of both sides the mean v and the
    difference over the track omega, with the angle phi

        v = u cos(phi) + L / 2 omega' sin(phi),  omega = omega' cos(phi)

    This is geometry, so understeer and tyres that slide aside change nothing of it.

    Args:
        v: that the wheels tell, m/s.
        omega: likewise, rad/s.
        wheelbase: L, m; 0 where the encoder wheels do not steer.
        phi: of the front axle, rad, the rear's being the opposite; None: unknown; then the wheels themselves
            tell it, as without understeer sin(2 phi) = L omega / v.
        share: by how much they turn more than the car, as their track width is another than was measured.

    """
    if not wheelbase:
        return v, omega
    if phi is None:
        double = wheelbase * omega / (share * v) if abs(v) > CRAWL else 0.0
        phi = 0.5 * asin(double) if abs(double) < SINE_MAX else 0.0
    turning = omega / cos(phi)
    return (v - 0.5 * wheelbase * turning / share * sin(phi)) / cos(phi), turning


def velocities(mean: State) -> tuple[tuple[float, float], tuple[Row, Row]]:
    """Speed and yaw rate, and the rows of the Jacobian."""
    _, _, _, rolled, omega, _, slip, _ = mean
    return (rolled * (1.0 - slip), omega), ((0.0, 0.0, 0.0, 1.0 - slip, 0.0, 0.0, -rolled, 0.0), OMEGA)


def antenna(mean: State, at: tuple[float, float]) -> tuple[tuple[float, float], tuple[State, State]]:
    """Where a receiver at a place on the robot (x forward, y left, m) is, and the rows of the Jacobian."""
    x, y, theta = mean[:3]
    c, s = cos(theta), sin(theta)
    dx, dy = at[0] * c - at[1] * s, at[0] * s + at[1] * c
    return (x + dx, y + dy), ((1.0, 0.0, -dy, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, dx, 0.0, 0.0, 0.0, 0.0, 0.0))


def turned(
    belief: Belief, turn: float, x: float, y: float, spread: Array, leans: tuple[Array, Array] | None = None
) -> Belief:
    """The belief in another frame: turned by `turn` rad about the origin, then moved by (x, y) m.

    `spread` is the covariance of x, y and turn, shape (3, 3), of the frame where the robot is now. `leans` is how the
    turn, shape (k,), and the robot's place before it, shape (2, k), lean.
    """
    px, py, theta, *rest = belief.mean
    c, s = cos(turn), sin(turn)
    f = np.eye(SIZE)
    f[:2, :2] = (c, -s), (s, c)
    rotated = f @ belief.covariance @ f.T
    rotated[:3, :3] += spread
    lean = belief.lean
    if lean is not None and leans is not None:
        by = lean.by.copy()
        by[THETA] += leans[0]
        by[:2] = f[:2, :2] @ leans[1]
        lean = lean._replace(by=by)
    return belief_of((x + c * px - s * py, y + s * px + c * py, theta + turn, *rest), rotated, lean)


def outside(
    belief: Belief, besides: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
) -> tuple[float, tuple[float, ...]]:
    """The car's speed, m/s, and the covariance of x, y, theta, that speed and the yaw rate, row by row.

    `besides` is what the pose's covariance is larger than believed: at x, at x and y, at y, and at theta.
    """
    rolled, grip = belief.mean[ROLLED], 1.0 - belief.mean[SLIP]
    rows = _UNITS[:5].copy()
    rows[ROLLED, [ROLLED, SLIP]] = grip, -rolled
    told = rows @ belief.covariance @ rows.T
    xx, xy, yy, tt = besides
    # symmetric whatever is rounded
    told = 0.5 * (told + told.T)
    told[:3, :3] += ((xx, xy, 0.0), (xy, yy, 0.0), (0.0, 0.0, tt))
    return rolled * grip, tuple(told.ravel().tolist())


# m/s, standard deviation of the speed at the start: it may be driving already
START_SPEED_SIGMA: Final = 0.5


def late_by(belief: Belief, change: float) -> Belief:
    """The belief as the yaw rate has changed by so much, rad/s, which a gyro tells late: it has turned on meanwhile."""
    lean = belief.lean
    if lean is None or len(lean.value) <= CLOCK:
        return belief
    by = lean.by.copy()
    by[THETA, CLOCK] -= change
    x, y, theta, *rest = belief.mean
    mean = _state((x, y, theta + float(lean.value[CLOCK]) * change, *rest))
    return Belief(mean, belief.triangle, lean._replace(by=by))


def considered(belief: Belief, residual: Sequence[float], h: Sequence[Row], sigmas: Sequence[float]) -> Belief:
    """The belief with the rates that wheels tell, which alone tell nothing of their slip.

    Slip and width are consider states (S. F. Schmidt, Advances in Control Systems 3, 1966): their uncertainty counts,
    but they are not estimated, and the pose follows from the rates. Joseph's form holds for any gain.
    """
    p, rows = belief.covariance, np.array([_UNITS[row] if isinstance(row, int) else row for row in h])
    noise = np.diag(np.square(sigmas))
    rates = rows.copy()
    rates[:, SLIP:] = 0.0
    gain = np.zeros((SIZE, len(rows)))
    both = [ROLLED, OMEGA]
    gain[both] = np.linalg.solve(rates @ p @ rates.T + noise, rates @ p[:, both]).T
    left = np.eye(SIZE) - gain @ rows
    lean = belief.lean
    if lean is not None:
        lean = lean._replace(by=left @ lean.by)
    return belief_of(np.array(belief.mean) + gain @ np.array(residual), left @ p @ left.T + gain @ noise @ gain.T, lean)


def slipping(belief: Belief, dt: float, density: float) -> Belief:
    """The belief when slip varies for dt seconds with this spectral density, 1/s, and nothing tells of it.

    Way and turn are off by the same share. The slip that lasts is a state of the belief.
    """
    _, _, theta, rolled, omega, _, slip, _ = belief.mean
    v = rolled * (1.0 - slip)
    missed = np.array([v * cos(theta), v * sin(theta), omega])
    covariance = belief.covariance
    covariance[:3, :3] += density * max(dt, 0.0) * np.outer(missed, missed)
    return belief_of(belief.mean, covariance, belief.lean)


def wandering(belief: Belief, dt: float, sigma: float, lasts: float) -> Belief:
    """The belief when slip wanders about what is known of it, for dt seconds: by sigma, related over `lasts` seconds.

    A Gauss-Markov process (A. Gelb, *Applied Optimal Estimation*, MIT Press 1974, 3.8). What the slip did before tells
    less and less of it.
    """
    spread, keeps = list(belief.triangle), exp(-max(dt, 0.0) / lasts)
    for place in OF_SLIP:
        spread[place] *= keeps
    spread[SS] = keeps * spread[SS] + (1.0 - keeps * keeps) * sigma * sigma
    return Belief(belief.mean, tuple(spread), belief.lean)


def slip_unknown(belief: Belief, sigma: float, track_sigma: float) -> Belief:
    """The belief when nothing is known of slip and track width but their standard deviations.

    The car's speed stays as it is.
    """
    v, covariance = belief.mean[ROLLED] * (1.0 - belief.mean[SLIP]), belief.covariance
    covariance[SLIP:, :] = covariance[:, SLIP:] = 0.0
    covariance[SLIP, SLIP], covariance[WIDTH, WIDTH] = sigma**2, track_sigma**2
    covariance[ROLLED, ROLLED] += START_SPEED_SIGMA**2
    x, y, theta, _, omega, bias, _, _ = belief.mean
    return belief_of((x, y, theta, v, omega, bias, 0.0, 0.0), covariance, belief.lean)


def widened(belief: Belief, by: Array) -> Belief:
    """The belief with a covariance that is larger by a matrix, shape (8, 8)."""
    return belief_of(belief.mean, belief.covariance + by, belief.lean)


def moved(belief: Belief, by: tuple[float, float, float]) -> Belief:
    """The belief somewhere else (m, m), with this slip."""
    x, y, theta, rolled, omega, bias, _, width = belief.mean
    return Belief((x + by[0], y + by[1], theta, rolled, omega, bias, by[2], width), belief.triangle, belief.lean)


def grown(rows: Sequence[int], residual: Sequence[float], slid: float) -> Array:
    """The covariance of a pose that is off by a residual, and of motion that has changed, shape (8, 8)."""
    spread = np.zeros((SIZE, SIZE))
    size = hypot(*residual[:2])
    for row, each in zip(rows, residual, strict=False):
        spread[row, row] = each * each if row == THETA else 0.5 * size * size
    spread[ROLLED, ROLLED] = (size / SLOT) ** 2 if slid == 0.0 else 0.0
    spread[SLIP, SLIP] = slid * slid
    return spread


# s, the longest prediction in one piece
STEP_MAX: Final = 0.1
# standard deviations of a rate's miss beyond which it is the motion that has changed
TRACKS: Final = 2.0
# turns over which the walk of the slip is averaged
TURNS_AVERAGED: Final = 5
# standard deviation of a slip that has changed
SLID: Final = 0.1
# s without a reading of the place, after which slip walks further: the time of so many readings, within these bounds
BLIND_READINGS: Final = 5
BLIND_LEAST: Final = 0.1
BLIND_MOST: Final = 0.5
# m/s by which a speed that nothing tells changes in a second; chosen
SPEED_WALK: Final = 0.5


class Walk:
    """The spectral densities of the state's random walks.

    Args:
        drift: of the state by itself.
        slip_sigma: standard deviation of the wheels' slip before anything is known of it.
        exact: the track width is known, so that turns tell of slip; else they tell of that width.

    """

    def __init__(self, drift: Drift, slip_sigma: float, *, exact: bool) -> None:
        self.slip_sigma = slip_sigma
        self._exact = exact
        x, y, theta, rolled, omega, bias, slip, width = drift.density()
        self._least: State = x, y, theta, rolled, omega, bias, slip, 0.0 if exact else width
        # much, until turns tell otherwise
        self._slips = slip_sigma**2
        # of the track width nothing, until turns tell
        self._widths = 0.0
        self.told = self._with(self._slips)
        """The variances that a second adds, with slip as turns have told of it."""
        self.blind = self._with(SLID**2)
        """The same when no sensor tells the place any more: while one did, the slip was followed before a turn was
        over, so turns have told too little."""
        self.blind_from = inf
        """s of the run, from when on no sensor has told the place for too long."""

    def _with(self, slips: float) -> State:
        x, y, theta, rolled, omega, bias, usual, width = self._least
        return x, y, theta, rolled, omega, bias, max(usual, slips), max(width, self._widths)

    def placed(self, time: float, before: float | None) -> None:
        """Note that a sensor has told the place at a time, s of the run, and before."""
        waits = BLIND_READINGS * (time - before) if before is not None else BLIND_MOST
        waits = waits if waits > BLIND_LEAST else BLIND_LEAST
        self.blind_from = time + (waits if waits < BLIND_MOST else BLIND_MOST)

    def untold(self, density: State) -> State:
        """These densities when nothing tells how fast the wheels turn."""
        x, y, theta, _, omega, bias, slip, width = density
        return x, y, theta, SPEED_WALK**2, omega, bias, slip, width

    def settled(self, variance: float) -> State:
        """The densities when nothing tells of the slip that lasts, of which so much is unknown.

        It walks until it is as uncertain as at first; while a sensor told the place, it was known better.
        """
        x, y, theta, rolled, omega, bias, slip, _ = self.blind
        left = max(0.0, 1.0 - variance / self.slip_sigma**2)
        return x, y, theta, rolled, omega, bias, slip * left, self.told[WIDTH]

    def changed(self, square: float, dt: float) -> None:
        """Adapt the slip's walk to a turn: the square of its change in dt seconds.

        Covariance matching (A. H. Mohamed and K. P. Schwarz): the excess of the innovation's square over its
        expectation is added to the expectation.
        """
        self._slips += (min(max(square, 0.0), SLID * SLID) / dt - self._slips) / TURNS_AVERAGED
        # slip in curves looks like a wider track
        self._widths = 0.0 if self._exact else self._slips
        self.told = self._with(self._slips)
