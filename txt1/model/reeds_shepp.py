"""Shortest paths of a car that drives forward and backward (Reeds and Shepp, 1990).

A path is made of arcs at the minimum turning radius and straight lines. Reeds and Shepp list 48 words, among which the
shortest path is always found. They follow from nine formulas for a car at the origin, heading along +x, by three
symmetries: driving the path in the other gear (x and theta change sign), mirroring it (y and theta change sign), and
driving it from its end to its start. The formulas are numbered as in the paper, for a turning radius of 1.
"""

from collections.abc import Callable, Iterator
from math import acos, asin, atan2, cos, hypot, pi, sin, sqrt
from typing import Final, NamedTuple

from txt1.model.kinematics import wrap_angle

# x and y in m, theta in rad
Pose = tuple[float, float, float]

# shorter segments, in radii, do not count
SHORTEST: Final = 1e-9
QUARTER: Final = pi / 2.0


class Segment(NamedTuple):
    """A piece of a path."""

    # 1/m, left positive: 1 / R, 0 or -1 / R
    curvature: float
    # m, backward negative
    distance: float


Path = tuple[Segment, ...]
_Lengths = tuple[float, ...]
_Formula = Callable[[float, float, float], _Lengths | None]


def length(path: Path) -> float:
    """Return the length of a path in both gears, m."""
    return sum(abs(segment.distance) for segment in path)


def paths(start: Pose, goal: Pose, radius: float) -> list[Path]:
    """Return every Reeds-Shepp path between two poses for a turning radius in m, shortest first; never empty."""
    dx, dy = (goal[0] - start[0]) / radius, (goal[1] - start[1]) / radius
    c, s = cos(start[2]), sin(start[2])
    x, y, phi = c * dx + s * dy, c * dy - s * dx, wrap_angle(goal[2] - start[2])
    found = [
        tuple(
            Segment({"L": 1.0, "S": 0.0, "R": -1.0}[turn] / radius, part * radius)
            for turn, part in zip(word, lengths, strict=True)
            if abs(part) > SHORTEST
        )
        for word, lengths in _words(x, y, phi)
    ]
    return sorted(found, key=length)


def _words(x: float, y: float, phi: float) -> Iterator[tuple[str, _Lengths]]:
    """Yield every word that leads from the origin to (x, y, phi), with the lengths of its letters, in radii."""
    back_x, back_y = x * cos(phi) + y * sin(phi), x * sin(phi) - y * cos(phi)
    for word, formula, reversible in _FORMULAS:
        for from_end in (False, True) if reversible else (False,):
            px, py = (back_x, back_y) if from_end else (x, y)
            for gear in (1.0, -1.0):
                for side in (1.0, -1.0):
                    lengths = formula(gear * px, side * py, gear * side * phi)
                    if lengths is None:
                        continue
                    letters = word if side > 0.0 else word.translate(_MIRROR)
                    if from_end:
                        letters, lengths = letters[::-1], lengths[::-1]
                    yield letters, tuple(gear * part for part in lengths)


_MIRROR: Final = str.maketrans("LR", "RL")


def _lsl(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ S+ L+, (8.1)."""
    u, t = _polar(x - sin(phi), y - 1.0 + cos(phi))
    v = wrap_angle(phi - t)
    return (t, u, v) if t >= 0.0 and v >= 0.0 else None


def _lsr(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ S+ R+, (8.2)."""
    rho, theta = _polar(x + sin(phi), y - 1.0 - cos(phi))
    if rho < 2.0:
        return None
    u = sqrt(rho * rho - 4.0)
    t = wrap_angle(theta + atan2(2.0, u))
    v = wrap_angle(t - phi)
    return (t, u, v) if t >= 0.0 and v >= 0.0 else None


def _lrl(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ R- L, (8.3) and (8.4)."""
    rho, theta = _polar(x - sin(phi), y - 1.0 + cos(phi))
    if rho > 4.0:
        return None
    u = -2.0 * asin(0.25 * rho)
    t = wrap_angle(theta + 0.5 * u + pi)
    v = wrap_angle(phi - t + u)
    return (t, u, v) if t >= 0.0 else None


def _lrlr_outer(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ R+ L- R-, (8.7)."""
    xi, eta = x + sin(phi), y - 1.0 - cos(phi)
    rho = 0.25 * (2.0 + hypot(xi, eta))
    if rho > 1.0:
        return None
    u = acos(rho)
    t, v = _outer_turns(u, -u, xi, eta, phi)
    return (t, u, -u, v) if t >= 0.0 and v <= 0.0 else None


def _lrlr_inner(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ R- L- R+, (8.8)."""
    xi, eta = x + sin(phi), y - 1.0 - cos(phi)
    rho = (20.0 - xi * xi - eta * eta) / 16.0
    if not 0.0 <= rho <= 1.0:
        return None
    u = -acos(rho)
    t, v = _outer_turns(u, u, xi, eta, phi)
    return (t, u, u, v) if t >= 0.0 and v >= 0.0 else None


def _lrsl(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ R- S- L-, (8.9), its R a quarter turn."""
    rho, theta = _polar(x - sin(phi), y - 1.0 + cos(phi))
    if rho < 2.0:
        return None
    r = sqrt(rho * rho - 4.0)
    u = 2.0 - r
    t = wrap_angle(theta + atan2(r, -2.0))
    v = wrap_angle(phi - QUARTER - t)
    return (t, -QUARTER, u, v) if t >= 0.0 and u <= 0.0 and v <= 0.0 else None


def _lrsr(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ R- S- R-, (8.10), its first R a quarter turn."""
    rho, t = _polar(-(y - 1.0 - cos(phi)), x + sin(phi))
    if rho < 2.0:
        return None
    u = 2.0 - rho
    v = wrap_angle(t + QUARTER - phi)
    return (t, -QUARTER, u, v) if t >= 0.0 and u <= 0.0 and v <= 0.0 else None


def _lrslr(x: float, y: float, phi: float) -> _Lengths | None:
    """L+ R- S- L- R+, (8.11), its inner arcs quarter turns."""
    xi, eta = x + sin(phi), y - 1.0 - cos(phi)
    rho = hypot(xi, eta)
    if rho < 2.0:
        return None
    u = 4.0 - sqrt(rho * rho - 4.0)
    if u > 0.0:
        return None
    t = wrap_angle(atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    v = wrap_angle(t - phi)
    return (t, -QUARTER, u, -QUARTER, v) if t >= 0.0 and v >= 0.0 else None


# word, formula, and whether the word driven from its end is a different word
_FORMULAS: Final[tuple[tuple[str, _Formula, bool], ...]] = (
    ("LSL", _lsl, False),
    ("LSR", _lsr, False),
    ("LRL", _lrl, True),
    ("LRLR", _lrlr_outer, False),
    ("LRLR", _lrlr_inner, False),
    ("LRSL", _lrsl, True),
    ("LRSR", _lrsr, True),
    ("LRSLR", _lrslr, False),
)


def _outer_turns(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """Return first and last arc of a word of four arcs with inner arcs u and v, (8.7) and (8.8)."""
    delta = wrap_angle(u - v)
    a, b = sin(u) - sin(delta), cos(u) - cos(delta) - 1.0
    first = atan2(eta * a - xi * b, xi * a + eta * b)
    tau = wrap_angle(first + pi if 2.0 * (cos(delta) - cos(v) - cos(u)) + 3.0 < 0.0 else first)
    return tau, wrap_angle(tau - u + v - phi)


def _polar(x: float, y: float) -> tuple[float, float]:
    return hypot(x, y), atan2(y, x)
