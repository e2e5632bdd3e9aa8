"""The MAP screen: room or walls, obstacles, light, path, particles, scan and robots on a canvas of braille dots.

A braille character has two by four dots. A terminal's cell is about twice as high as wide, so the dots are square.
Both axes have the same scale, in metres per dot, and a circle is round.
"""

from collections.abc import Sequence
from itertools import chain, groupby, pairwise
from math import ceil, cos, degrees, dist, floor, isfinite, log10, sin
from operator import itemgetter
from typing import Final

from rich.panel import Panel
from rich.text import Text

from txt1.tasks.battery import RANGE
from txt1.tasks.encoder import POSE
from txt1.tasks.fields import MOVERS, SEEN, SURROUNDINGS, VEHICLES, WALLS, Surroundings
from txt1.tasks.on_map import MAP_POSE, PARTICLES, SCAN_ON_MAP, WALLS_ON_MAP
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.text import DIM, Kept
from txt1.ui.viewer import Viewer, pose_of

# the robot is drawn at least this number of dots long, so that its heading is visible
BODY_DOTS: Final = 9.0
# side of the smallest view without a room, m
VIEW_MIN: Final = 2.0
_BITS: Final = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""Bit of the dot in column x and row y of a braille character."""

# the braille character without a dot
_BLANK: Final = 0x2800
_STYLES: Final = (DIM, "white", "cyan", "yellow", "bold bright_green")
"""Colour of a cell: that of the highest layer with a dot in it."""

AXES, WALL, PATH, OTHER, ROBOT = range(len(_STYLES))

# x and y, m
Point = tuple[float, float]
# left, bottom, right and top of a rectangle, m
Bounds = tuple[float, float, float, float]


# by size: the values drawn last, and the picture
_kept: dict[tuple[int, int], tuple[object, Kept]] = {}


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> Kept:
    """Return the screen MAP, of width x rows cells; an unchanged picture is not drawn again."""
    path = viewer.path
    snapshot = on_map(snapshot)
    about, walls, others = snapshot.get(SURROUNDINGS), snapshot.get(WALLS), snapshot.get(VEHICLES)
    left = snapshot.get(RANGE)
    place = pose_of(snapshot), _frame(snapshot), snapshot.get(PARTICLES), snapshot.get(SCAN_ON_MAP)
    seen = snapshot.get(SEEN)
    key = (
        place,
        about,
        walls,
        seen,
        snapshot.get(MOVERS),
        others,
        len(path),
        path[:1],
        path[-1:],
        viewer.spacing,
        left,
    )
    known, picture = _kept.get((width, rows), (None, None))
    if picture is None or known != key:
        lines = Text("\n").join(draw_map(snapshot, viewer, width - 2, rows - 2))
        range_left = None if left is None else f"{left:.0f} m left"
        picture = Kept(Panel(lines, title="MAP", subtitle=range_left, padding=0, border_style=DIM))
        # the window has changed: forget pictures of other sizes
        _kept.clear()
        _kept[width, rows] = key, picture
    return picture


class Canvas:
    """Braille dots over a rectangle of the plane, x to the right, y up, with the same scale on both axes.

    The rectangle `bounds`, in m, is centred on the given columns and rows of cells. `scale` is in m per dot; None takes
    the smallest scale at which the rectangle fits.
    """

    def __init__(self, bounds: Bounds, columns: int, rows: int, scale: float | None = None) -> None:
        self.columns, self.rows = columns, rows
        self.scale = scale or fitting_scale(bounds, columns, rows)
        left, bottom, right, top = bounds
        self._left = (left + right) / 2.0 - columns * self.scale
        self._top = (bottom + top) / 2.0 + 2.0 * rows * self.scale
        self._bits = [[0] * columns for _ in range(rows)]
        self._layers = [[0] * columns for _ in range(rows)]
        self._marks: dict[tuple[int, int], tuple[str, str]] = {}

    def line(self, start: Point, end: Point, layer: int) -> None:
        """Draw a straight line between two points, m, as far as it is inside."""
        x0, y0 = self._dots(start)
        x1, y1 = self._dots(end)
        steps = min(10_000, max(1, ceil(max(abs(x1 - x0), abs(y1 - y0)))))
        for step in range(steps + 1):
            share = step / steps
            x, y = _whole(x0 + share * (x1 - x0)), _whole(y0 + share * (y1 - y0))
            column, row = x >> 1, y >> 2
            if 0 <= column < self.columns and 0 <= row < self.rows:
                self._bits[row][column] |= _BITS[x & 1][y & 3]
                # the highest layer gives the cell its colour
                self._layers[row][column] = max(layer, self._layers[row][column])

    def outline(self, corners: Sequence[Point], layer: int) -> None:
        """Draw lines from corner to corner, and from the last to the first."""
        for start, end in pairwise([*corners, corners[0]]):
            self.line(start, end, layer)

    def path(self, points: Sequence[Point], layer: int) -> None:
        """Draw lines from point to point; points within the same dot take no time."""
        dots = ((_whole(x), _whole(y)) for x, y in map(self._dots, points))
        apart = [next(same)[1] for _, same in groupby(zip(dots, points, strict=True), key=itemgetter(0))]
        for start, end in pairwise(apart):
            self.line(start, end, layer)

    def mark(self, point: Point, character: str, style: str) -> None:
        """Put a character over the cell of a point, m."""
        x, y = self._dots(point)
        self._marks[_whole(y) >> 2, _whole(x) >> 1] = (character, style)

    def lines(self) -> list[Text]:
        """Return the canvas, a text for each row of cells; neighbouring cells of the same colour are a single piece."""
        lines = []
        for row, (bits, layers) in enumerate(zip(self._bits, self._layers, strict=True)):
            cells = (
                self._marks.get((row, column)) or (chr(_BLANK + dots) if dots else " ", _STYLES[layer])
                for column, (dots, layer) in enumerate(zip(bits, layers, strict=True))
            )
            runs = (("".join(cell[0] for cell in run), style) for style, run in groupby(cells, key=itemgetter(1)))
            lines.append(Text.assemble(*runs, no_wrap=True))
        return lines

    def _dots(self, point: Point) -> Point:
        return (point[0] - self._left) / self.scale, (self._top - point[1]) / self.scale


def _whole(dots: float) -> int:
    """Return the dot of a coordinate; rounding errors do not move a wall over its edge."""
    return floor(dots + 1e-6)


def fitting_scale(bounds: Bounds, columns: int, rows: int) -> float:
    """Return the smallest m per dot at which the bounds fit, with a free dot on every side."""
    left, bottom, right, top = bounds
    return max((right - left) / max(1, 2 * columns - 2), (top - bottom) / max(1, 4 * rows - 2))


def draw_map(snapshot: Snapshot, viewer: Viewer, columns: int, rows: int) -> list[Text]:
    """Return the map and, as its last row, the legend with the scale."""
    snapshot = on_map(snapshot)
    rows = max(1, rows - 1)
    about = snapshot.get(SURROUNDINGS, Surroundings())
    walls = snapshot.get(WALLS, ())
    if walls:
        xs, ys = zip(*chain.from_iterable(walls), strict=True)
        canvas = Canvas((min(xs), min(ys), max(xs), max(ys)), columns, rows)
    elif about.room is None:
        bounds = around(snapshot, viewer)
        canvas = Canvas(bounds, columns, rows, round_up(fitting_scale(bounds, columns, rows)))
    else:
        # the room lies around the origin
        x, y = 0.5 * about.room[0], 0.5 * about.room[1]
        canvas = Canvas((-x, -y, x, y), columns, rows)
        canvas.outline([(-x, -y), (x, -y), (x, y), (-x, y)], WALL)
    arm = 4.0 * canvas.scale
    canvas.line((-arm, 0.0), (arm, 0.0), AXES)
    canvas.line((0.0, -arm), (0.0, arm), AXES)
    for outline in (*walls, *about.obstacles):
        canvas.outline(outline, WALL)
    for mover in snapshot.get(MOVERS, ()):
        canvas.outline(mover, OTHER)
    for other in snapshot.get(VEHICLES, ()):
        _draw_robot(canvas, other, about.body, OTHER)
    canvas.path(viewer.path, PATH)
    seen = snapshot.get(SEEN, ())
    particles = [each[:2] for each in snapshot.get(PARTICLES, ())]
    for point in (*particles, *snapshot.get(SCAN_ON_MAP, ()), *seen):
        if all(map(isfinite, point)):
            canvas.line(point, point, OTHER)
    pose = pose_of(snapshot)
    if all(map(isfinite, pose)):
        _draw_robot(canvas, pose, about.body, ROBOT)
    if about.light is not None:
        canvas.mark(about.light, "✶", "bold bright_yellow")
    return [*canvas.lines(), _legend(snapshot, canvas.scale, columns)]


def on_map(snapshot: Snapshot) -> Snapshot:
    """Return the snapshot of a robot that has a map: with the map's walls, and without the simulated room."""
    if snapshot.get(MAP_POSE) is None:
        return snapshot
    body = snapshot.get(SURROUNDINGS, Surroundings()).body
    walls = snapshot.get(WALLS_ON_MAP)
    return snapshot.replaced(
        {SURROUNDINGS: Surroundings(body=body), WALLS: walls, MOVERS: None, VEHICLES: None, SEEN: None}
    )


def _frame(snapshot: Snapshot) -> str:
    """Return the frame of the drawn pose."""
    there = snapshot.get(MAP_POSE)
    if there is not None:
        return "lost on the map" if there.lost else "map"
    return "odometry" if snapshot.get(POSE) is None else "room"


def around(snapshot: Snapshot, viewer: Viewer) -> Bounds:
    """Return the view without a room: path, robot and light, with a margin; a coarse grid keeps the picture still."""
    about = snapshot.get(SURROUNDINGS, Surroundings())
    points = [*viewer.path, pose_of(snapshot)[:2], *([about.light] if about.light else [])]
    xs = [x for x, _ in points if isfinite(x)] or [0.0]
    ys = [y for _, y in points if isfinite(y)] or [0.0]
    grid = 10.0 ** floor(log10(max(VIEW_MIN, max(xs) - min(xs), max(ys) - min(ys))))
    margin = 0.5 * about.body[0]
    left, bottom = (floor((min(values) - margin) / grid) * grid for values in (xs, ys))
    right, top = (ceil((max(values) + margin) / grid) * grid for values in (xs, ys))
    return left, bottom, right, top


def round_up(scale: float) -> float:
    """Return the next larger of 1, 1.5, 2, 3, 5, 7 times a power of ten, so that the scale changes seldom."""
    power = 10.0 ** floor(log10(scale))
    return power * next((step for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if step * power >= scale), 10.0)


def _draw_robot(canvas: Canvas, pose: tuple[float, float, float], body: tuple[float, float, float], layer: int) -> None:
    """Draw the outline of a body (length, width, offset of its centre ahead of the pose; m), and a pointer at
    its front.
    """
    x, y, theta = pose
    enlarge = max(1.0, BODY_DOTS * canvas.scale / body[0])
    front, side = 0.5 * enlarge * body[0], 0.5 * enlarge * body[1]
    middle = enlarge * body[2]
    c, s = cos(theta), sin(theta)

    def place(ahead: float, left: float) -> Point:
        return x + ahead * c - left * s, y + ahead * s + left * c

    nose, tail = middle + front, middle - front
    canvas.outline([place(nose, side), place(tail, side), place(tail, -side), place(nose, -side)], layer)
    canvas.line(place(middle, 0.0), place(nose + front, 0.0), layer)


def _legend(snapshot: Snapshot, scale: float, columns: int) -> Text:
    """Return the scale and the pose, and the meaning of the signs, in full or as far as the columns suffice."""
    whole = _caption(snapshot, scale)
    return whole if whole.cell_len <= columns else _caption(snapshot, scale, short=True)


def _caption(snapshot: Snapshot, scale: float, short: bool = False) -> Text:
    length, cells = scale_bar(scale)
    light = snapshot.get(SURROUNDINGS, Surroundings()).light
    x, y, theta = pose_of(snapshot)
    legend = Text(no_wrap=True, overflow="ellipsis").append(f"├{'─' * (cells - 2)}┤ {length:g} m  ", "white")
    if not short:
        legend.append("⣀", _STYLES[PATH]).append(" path  ", DIM)
    if snapshot.get(SEEN) and not short:
        legend.append("⠢", _STYLES[OTHER]).append(" laser  ", DIM)
    legend.append(_frame(snapshot), "cyan")
    if isfinite(x):
        legend.append(f" x {x:.2f} y {y:.2f} m θ {degrees(theta):.0f}°")
    if light is not None:
        legend.append(" ✶", "bold bright_yellow").append(f" light {dist((x, y), light):.2f} m", DIM)
    return legend


def scale_bar(scale: float) -> tuple[float, int]:
    """Return length in m and width in cells of a scale bar of about ten cells; a cell is two dots wide."""
    power = 10.0 ** floor(log10(20.0 * scale))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 20.0 * scale)
    return length, max(2, round(length / (2.0 * scale)))
