"""A drive as a moving picture: an SVG that any browser plays, and that a page may hold."""

from collections.abc import Sequence
from math import degrees
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.sim.obstacles import Outline

# s that the picture moves, at most, before it begins again
PICTURE_LASTS: Final = 12.0
# poses of the car in it
POSES: Final = 240
# pixels of its longer side
SIDE: Final = 640
# m around all that is drawn
DRAWN_MARGIN: Final = 0.4
# m to the next pose from which on the car was placed there and has not driven
PLACED: Final = 0.3
WALL, PATH, CAR, LIGHT, INK = "#59636e", "#0072B2", "#D55E00", "#E69F00", "#24292f"


class DrawnRoom(NamedTuple):
    """The room in which a car drove: outlines of walls and obstacles, and the light, in m; empty where unknown."""

    walls: tuple[Outline, ...] = ()
    light: tuple[float, float] | None = None


def moving_drawing(
    poses: NDArray[np.float64], place: DrawnRoom, body: tuple[float, float, float], name: str = "the drive"
) -> str:
    """Return the SVG of a drive; "" for one of fewer than two poses.

    `poses` has time (s), x, y (m) and heading (rad) as rows. `body` is length, width, and how far its
    centre is ahead of the pose (m).
    """
    if poses.shape[1] < 2:
        return ""
    time = np.linspace(poses[0, 0], poses[0, -1], POSES)
    # the pose that was known at each time: a car that was placed elsewhere jumps, and does not glide
    at = np.searchsorted(poses[0], time, side="right") - 1
    x, y, theta = poses[1:, at]
    elapsed = float(time[-1] - time[0])
    lasts = min(PICTURE_LASTS, max(elapsed, 1.0))
    left, bottom, right, top = _bounds(poses, place)
    scale = SIDE / max(right - left, top - bottom)
    width, height = scale * (right - left), scale * (top - bottom)

    def pixels(points: Sequence[tuple[float, float]]) -> str:
        return " ".join(f"{scale * (a - left):.1f},{scale * (top - b):.1f}" for a, b in points)

    moves = f'calcMode="discrete" dur="{lasts:.2f}s" repeatCount="indefinite"'
    transform = 'animateTransform attributeName="transform"'
    steps = ";".join(f"{scale * (a - left):.1f} {scale * (top - b):.1f}" for a, b in zip(x, y, strict=True))
    turns = ";".join(f"{-degrees(each):.1f}" for each in np.unwrap(theta))
    length, breadth, ahead = (scale * each for each in body)
    marks = [f'<polygon points="{pixels(each)}" fill="none" stroke="{WALL}" stroke-width="3"/>' for each in place.walls]
    for piece in np.split(np.column_stack((x, y)), np.flatnonzero(_jumps(x, y)) + 1):
        way = pixels([(float(a), float(b)) for a, b in piece])
        marks.append(f'<polyline points="{way}" fill="none" stroke="{PATH}" stroke-width="2" stroke-linejoin="round"/>')
    legend = [("walls", WALL)] if place.walls else []
    legend += [("path", PATH), ("car", CAR)]
    if place.light is not None:
        legend.append(("light", LIGHT))
        (spot,) = pixels([place.light]).split()
        a, b = spot.split(",")
        marks.append(f'<circle cx="{a}" cy="{b}" r="7" fill="{LIGHT}"/>')
    nose = ahead + 0.5 * length
    marks.append(
        f'<g><{transform} type="translate" values="{steps}" {moves}/>'
        f'<g><{transform} type="rotate" values="{turns}" {moves}/>'
        f'<rect x="{ahead - 0.5 * length:.1f}" y="{-0.5 * breadth:.1f}" width="{length:.1f}" height="{breadth:.1f}" '
        f'fill="{CAR}"/><path d="M{nose:.1f} 0h{0.4 * length:.1f}" stroke="{CAR}" stroke-width="3"/></g></g>'
    )
    row, at_x = height + 22.0, 4.0
    for label, colour in legend:
        marks.append(f'<rect x="{at_x:.0f}" y="{row - 10:.0f}" width="14" height="10" fill="{colour}"/>')
        marks.append(f'<text x="{at_x + 20:.0f}" y="{row:.0f}">{label}</text>')
        at_x += 30.0 + 9.0 * len(label)
    pace = f"{elapsed:.1f} s, shown in {lasts:.0f} s"
    marks.append(f'<text x="4" y="{row + 20:.0f}">{pace}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height + 52:.0f}" role="img" '
        f'aria-label="{name}, moving" style="max-width:100%;width:{width:.0f}px" font-family="sans-serif" '
        f'font-size="15" fill="{INK}">{"".join(marks)}</svg>'
    )


def _jumps(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the car was placed somewhere else between two poses."""
    gone = np.hypot(np.diff(x), np.diff(y))
    return gone > max(PLACED, 8.0 * float(np.median(gone)))


def _bounds(poses: NDArray[np.float64], place: DrawnRoom) -> tuple[float, float, float, float]:
    """Return left, bottom, right and top of all that is drawn, m."""
    points = [corner for each in place.walls for corner in each] + ([place.light] if place.light else [])
    xs = np.concatenate((poses[1], [a for a, _ in points]))
    ys = np.concatenate((poses[2], [b for _, b in points]))
    return xs.min() - DRAWN_MARGIN, ys.min() - DRAWN_MARGIN, xs.max() + DRAWN_MARGIN, ys.max() + DRAWN_MARGIN
