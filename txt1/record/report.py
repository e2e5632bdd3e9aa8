"""A recording in pictures: path, velocities against their set-points, PWM, battery, timing; PNG, and one HTML page."""

import base64
import html
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from math import atan2, isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from txt1.config import Config, flatten, recorded
from txt1.errors import ConfigError, MissingExtra, RecordingError
from txt1.kernel.clock import NS_PER_S
from txt1.record.moving_drawing import DrawnRoom, moving_drawing
from txt1.record.reader import Decoding, FilePass, Item, robot_in, robots_in, trusting
from txt1.record.summary import TopicSummary
from txt1.sim.obstacles import outline
from txt1.sim.parameters import Box
from txt1.tasks.battery import BATTERIES
from txt1.tasks.controller import PWM, SETPOINT
from txt1.tasks.diagnostics import FAULTS, LIMITED, TASKS
from txt1.tasks.encoder import ODOMETRY, POSE
from txt1.tasks.fields import LOG
from txt1.tasks.mode import MODE

PACKS: Final = tuple(topic.name for topic in BATTERIES)
DPI: Final = 110
# ... and seven robots
TOGETHER: Final = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
# robots at most whose names stand at the ends of their paths
NAMED: Final = 20
# the colour-blind, too, tell them apart
BLUE, ORANGE, GREY = "#0072B2", "#E69F00", "0.35"
# V that the battery's axis shows at least: less would make noise look like a fall
SPAN: Final = 1.0
# m: no robot drives as far between two messages, so it was placed somewhere else
PLACED: Final = 0.3


def _heading(orientation: Any) -> float:
    """Return the heading (rad) of a quaternion that turns about the vertical."""
    return 2.0 * atan2(orientation.z, orientation.w)


class Content:
    """A robot's recording as a report needs it; with several robots, the robot of that name.

    RecordingError: it cannot be read, or no odometry is in it.
    """

    def __init__(self, path: Path, robot: str | None = None) -> None:
        self._rows: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
        self.topics: dict[str, TopicSummary] = {}
        self.events: list[tuple[float, str]] = []
        self.disarms: list[float] = []  # s of the run
        self._armed = False
        self.tasks: dict[str, dict[str, str]] = {}
        self.faults: dict[str, str] = {}
        self._decoding = Decoding()
        reading = FilePass(path, robot_in(path, robot))
        for item in reading:
            summary = self.topics.setdefault(item.name, TopicSummary(item.schema.name))
            summary.add(item.message.log_time, item.message.sequence)
            self._take(item, reading.run_time(item))
        self.metadata = reading.metadata
        self.complete = reading.complete
        if ODOMETRY.name not in self.topics:
            raise RecordingError(f"{path}: no odometry in it, so there is nothing to draw; was it recorded by txt1?")

    def columns(self, name: str) -> NDArray[np.float64]:
        """Times (s of the run) and values of that name as columns; six empty ones where there are none."""
        return np.array(self._rows[name]).T if name in self._rows else np.empty((6, 0))

    @property
    def config(self) -> Config | None:
        """The recorded configuration; None for one of another version."""
        try:
            return recorded(json.loads(self.metadata.get("txt1", {}).get("config", "{}")))
        except ConfigError:
            return None

    @property
    def place(self) -> DrawnRoom:
        """The simulated room of a drive whose true pose is known; an empty place for any other."""
        config = self.config
        if config is None or "pose" not in self._rows:
            return DrawnRoom()
        room = config.sim.room
        try:
            walls = room.built().walls
        except (ConfigError, MissingExtra):
            # its map has gone
            return DrawnRoom(light=room.light)
        if walls is not None:
            outlines = tuple(walls.outlines)
        elif isfinite(room.length) and isfinite(room.width):
            outlines = (outline(Box(0.0, 0.0, room.length, room.width)),)
        else:
            outlines = ()
        return DrawnRoom((*outlines, *map(outline, config.sim.obstacles)), room.light)

    def moving(self, name: str) -> str:
        """Return the drive as a moving picture (SVG), in the room where its pose is known; "" for no drive."""
        config = self.config
        shape = Config().geometry if config is None else config.geometry
        way = self.columns("pose") if "pose" in self._rows else self.columns("way")
        return moving_drawing(way[:4], self.place, (shape.length, shape.width, shape.centre), name)

    def _take(self, item: Item, time: float) -> None:
        rows, message = self._rows, self._decoding.message
        match item.name:
            case ODOMETRY.name:
                odometry = message(item)
                position, twist = odometry.pose.pose.position, odometry.twist.twist
                rows["odometry"].append((time, position.x, position.y, twist.linear.x, twist.angular.z))
                rows["way"].append((time, position.x, position.y, _heading(odometry.pose.pose.orientation)))
            case POSE.name:
                pose = message(item).pose
                rows["pose"].append((time, pose.position.x, pose.position.y, _heading(pose.orientation)))
            case SETPOINT.name:
                twist = message(item).twist
                rows["setpoint"].append((time, twist.linear.x, twist.angular.z))
            case PWM.name:
                pwm = message(item)
                rows["pwm"].append((time, pwm.motor, pwm.front, pwm.rear))
            case MODE.name:
                armed = bool(message(item).armed)
                if self._armed and not armed:
                    self.disarms.append(time)
                self._armed = armed
            case LOG.name:
                self.events.append((time, message(item).msg))
            case TASKS.name:
                for status in message(item).status:
                    self.tasks[status.name.removeprefix("task ")] = {each.key: each.value for each in status.values}
            case FAULTS.name:
                self.faults = {each.key: each.value for each in message(item).status[0].values}
            case name if name in PACKS:
                battery = message(item)
                if battery.present:
                    rows[name].append((time, battery.voltage))


def draw(content: Content) -> bytes:
    """The pictures of a recording as one PNG."""
    return _png(figure_of(content))


def figure_of(content: Content) -> Figure:
    """Return the pictures of a recording as one figure."""
    figure = Figure(figsize=(13.0, 13.0), layout="constrained")
    axes = figure.subplot_mosaic([["path", "v"], ["path", "omega"], ["motor", "steering"], ["battery", "timing"]])
    time, x, y, v, omega = content.columns("odometry")[:5]
    setpoint, pwm = content.columns("setpoint"), content.columns("pwm")
    path = axes["path"]
    _room(path, content.place)
    path.plot(*_apart(x, y), color=BLUE, label="odometry, from where it began")
    pose = content.columns("pose")
    if pose.shape[1]:
        path.plot(*_apart(pose[1], pose[2]), color=ORANGE, linestyle="--", label="true pose in the room")
    path.set(xlabel="x / m", ylabel="y / m", aspect="equal", adjustable="datalim")
    path.set_title("Path", loc="left")
    path.grid(visible=True, alpha=0.3)
    _legend(path)
    marks = content.disarms
    _lines(axes["v"], marks, "Speed", "v / (m/s)", (*setpoint[:2], "set-point"), (time, v, "measured"))
    _lines(
        axes["omega"], marks, "Yaw rate", "omega / (rad/s)", (*setpoint[:3:2], "set-point"), (time, omega, "measured")
    )
    _lines(axes["motor"], marks, "Motor", "PWM / counts", (*pwm[:2], "motor"))
    _lines(axes["steering"], marks, "Steering", "PWM / counts", (*pwm[:3:2], "front"), (*pwm[:4:3], "rear"))
    packs = [(*content.columns(name)[:2], name.removeprefix("/")) for name in PACKS]
    _lines(axes["battery"], marks, "Battery", "voltage / V", *packs)
    low, high = axes["battery"].get_ylim()
    if high - low < SPAN:
        axes["battery"].set_ylim(0.5 * (low + high - SPAN), 0.5 * (low + high + SPAN))
    periods = np.diff(time) * 1000.0
    _lines(axes["timing"], marks, "Time between two cycles", "ms", (time[1:], periods, "controller cycles"))
    if not periods.size or np.ptp(periods) < 1.0:
        axes["timing"].set_ylim(0.0, 40.0)
    return figure


def _room(axes: Any, place: DrawnRoom) -> None:
    """Draw walls, obstacles and light."""
    for number, edge in enumerate(place.walls):
        closed = np.array((*edge, edge[0]))
        axes.plot(closed[:, 0], closed[:, 1], color=GREY, linewidth=1.5, label="" if number else "walls")
    if place.light is not None:
        axes.plot(*place.light, "*", color=ORANGE, markersize=12, label="light", linestyle="")


def _png(figure: Figure) -> bytes:
    FigureCanvasAgg(figure)
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=DPI, metadata={"Software": "txt1"})
    return picture.getvalue()


def _lines(axes: Any, disarms: Sequence[float], title: str, unit: str, *curves: tuple[Any, Any, str]) -> None:
    """Curves over time, and where the robot was disarmed."""
    looks = iter(((BLUE, "-"), (ORANGE, "--")))
    for time, values, label in curves:
        colour, style = (GREY, "--") if label == "set-point" else next(looks)
        if len(time):
            axes.plot(time, values, color=colour, linestyle=style, label=label, linewidth=1.0)
    for k, time in enumerate(disarms):
        axes.axvline(time, color=GREY, linestyle=":", linewidth=1.2, label="" if k else "disarmed")
    axes.set(xlabel="t / s", ylabel=unit)
    axes.set_title(title, loc="left")
    axes.grid(visible=True, alpha=0.3)
    if axes.lines:
        _legend(axes)


def _legend(axes: Any) -> None:
    """The legend above the axes, beside the title, where no data are."""
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize="small", frameon=False, borderaxespad=0.2
    )


def _apart(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A path with gaps where the robot was placed somewhere else."""
    placed = np.flatnonzero(np.hypot(np.diff(x), np.diff(y)) > PLACED) + 1
    return np.insert(x, placed, np.nan), np.insert(y, placed, np.nan)


Part = tuple[str, tuple[str, ...], Sequence[Sequence[object]]]
"""A table of the page: its title, the heads of its columns, and its rows."""


def page(name: str, content: Content, picture: bytes) -> str:
    """Return an HTML page with everything in it."""
    topics = [
        (topic, each.count, f"{each.rate:.2f}", f"{each.gap / NS_PER_S:.3f}", each.lost)
        for topic, each in content.topics.items()
    ]
    return _page(
        name,
        picture,
        "path, velocities, PWM, battery, timing",
        summary(content),
        content.moving(name),
        ("The run", ("", ""), [*_facts(content), ("file", "complete" if content.complete else "breaks off")]),
        ("Topics", ("topic", "messages", "rate / Hz", "longest gap / s", "lost"), topics),
        (
            "Tasks",
            ("task", *next(iter(content.tasks.values()), {})),
            [(task, *values.values()) for task, values in content.tasks.items()],
        ),
        ("Faults", ("what", "how often"), [each for each in content.faults.items() if each[0] not in LIMITED]),
        (
            "Values kept within their limits",
            ("what", "how often"),
            [each for each in content.faults.items() if each[0] in LIMITED],
        ),
        ("Events", ("t / s", "what"), [(f"{time:.2f}", text) for time, text in content.events]),
        ("Configuration", ("key", "value"), _changed(content.metadata.get("txt1", {}).get("config", "{}"))),
    )


def summary(content: Content) -> list[str]:
    """Return the drive in sentences, the most important first: distance, stops, faults."""
    odometry = content.columns("odometry")
    seconds = float(np.ptp(odometry[0]))
    fastest = float(np.abs(odometry[3]).max())
    lines = [f"{travelled(content):.2f} m in {seconds:.1f} s by odometry, at most {fastest:.2f} m/s."]
    if content.disarms:
        told = [text for _, text in content.events if text.startswith("disarmed: ")]
        count = "once," if len(content.disarms) == 1 else f"{len(content.disarms)} times, the last time"
        why = f" ({told[-1].removeprefix('disarmed: ')})" if told else ""
        lines.append(f"Disarmed {count} at {content.disarms[-1]:.2f} s{why}.")
    else:
        lines.append("It was never disarmed.")
    lines.append(f"Faults: {_counted(content)}.")
    lost = {topic: each.lost for topic, each in content.topics.items() if each.lost}
    if lost:
        lines.append("Lost messages: " + ", ".join(f"{topic} {count}" for topic, count in lost.items()) + ".")
    if not content.complete:
        lines.append("The file breaks off: txt1 log recover repairs it.")
    return lines


def _counted(content: Content) -> str:
    """Return the faults in a line; values that the gate kept within their limits are none."""
    counted = [f"{what} {count}" for what, count in content.faults.items() if what not in LIMITED]
    return ", ".join(counted) or "none"


def _facts(content: Content) -> list[tuple[str, str]]:
    about = content.metadata.get("txt1", {})
    return [(key, value) for key, value in about.items() if key not in ("config", "plan", "robots")]


def _page(name: str, picture: bytes, shown: str, first: Sequence[str], moving: str, *parts: Part) -> str:
    """Return a page: title, summary, pictures, and each part folded up below its title, a screen long at most."""
    encoded = base64.b64encode(picture).decode("ascii")
    lines = [
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(name)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{html.escape(name)}</h1>",
        "<ul>" + "".join(f"<li>{html.escape(each)}</li>" for each in first) + "</ul>",
        moving,
        f'<img alt="{shown}" src="data:image/png;base64,{encoded}">',
    ]
    for title, heads, rows in parts:
        count = f" ({len(rows)})" if heads[0] else ""
        lines += f"<details><summary>{title}{count}</summary><div>", *_table(heads, rows), "</div></details>"
    return "\n".join((*lines, "</body></html>\n"))


_STYLE: Final = (
    "body{font:15px/1.4 sans-serif;max-width:80rem;margin:2rem auto;padding:0 1rem}img{max-width:100%}"
    "h1{overflow-wrap:anywhere}summary{font-size:1.2em;font-weight:bold;padding:.5rem 0;cursor:pointer}"
    "details div{max-height:85vh;overflow:auto}"
    "table{border-collapse:collapse}td,th{padding:.15rem .8rem;text-align:left;border-bottom:1px solid #ddd}"
    "td{overflow-wrap:anywhere;min-width:4rem}"
    "@media(max-width:40rem){body{margin:1rem auto}td,th{padding:.15rem .4rem}}"
)


def _table(heads: tuple[str, ...], rows: Sequence[Sequence[object]]) -> Iterator[str]:
    if not rows:
        yield "<p>none</p>"
        return
    yield "<table><tr>" + "".join(f"<th>{html.escape(head)}</th>" for head in heads) + "</tr>"
    for row in rows:
        yield "<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>"
    yield "</table>"


def _changed(text: str) -> list[tuple[str, str]]:
    """Every setting of a recorded configuration, dotted."""
    tree = json.loads(text)
    try:
        config = recorded(tree)
    except ConfigError:
        # another version's
        return [(key, json.dumps(value)) for key, value in tree.items()]
    return [(key, json.dumps(value)) for key, value in flatten(config)]


def draw_together(contents: Mapping[str, Content]) -> bytes:
    """The pictures of several robots in one room as one PNG."""
    figure = Figure(figsize=(13.0, 10.0), layout="constrained")
    axes = figure.subplot_mosaic([["path", "v"], ["path", "apart"]], width_ratios=(3, 2))
    _room(axes["path"], next(iter(contents.values())).place)
    poses = {name: each.columns("pose") for name, each in contents.items()}
    for number, (name, pose) in enumerate(poses.items()):
        colour = TOGETHER[number % len(TOGETHER)]
        if pose.shape[1]:
            axes["path"].plot(pose[1], pose[2], color=colour, linewidth=1.0)
            axes["path"].plot(pose[1, -1], pose[2, -1], "o", color=colour)
            if len(poses) <= NAMED:
                axes["path"].annotate(f" {name}", (pose[1, -1], pose[2, -1]), fontsize="small")
        odometry = contents[name].columns("odometry")
        axes["v"].plot(odometry[0], odometry[3], color=colour, linewidth=0.7)
    axes["path"].set(title="Paths in the room", xlabel="x / m", ylabel="y / m", aspect="equal", adjustable="datalim")
    axes["v"].set(title="Speed", xlabel="t / s", ylabel="v / (m/s)")
    time, nearest = distances([pose for pose in poses.values() if pose.shape[1] > 1])
    axes["apart"].plot(time, nearest, linewidth=1.0)
    axes["apart"].set(
        title="Smallest distance between two centres", xlabel="t / s", ylabel="distance / m", ylim=(0.0, None)
    )
    for each in axes.values():
        each.grid(visible=True, alpha=0.3)
    if axes["path"].get_legend_handles_labels()[0]:
        axes["path"].legend(loc="lower left", fontsize="small")
    return _png(figure)


def distances(poses: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times, s, ten a second, and the smallest distance between two robots then, m; empty for fewer than two."""
    if len(poses) < 2:
        return np.empty(0), np.empty(0)
    time = np.arange(max(pose[0, 0] for pose in poses), min(pose[0, -1] for pose in poses), 0.1)
    places = np.array([[np.interp(time, pose[0], pose[row]) for row in (1, 2)] for pose in poses])
    nearest = np.full(len(time), np.inf)
    for number, place in enumerate(places):
        for other in places[:number]:
            nearest = np.minimum(nearest, np.hypot(*(place - other)))
    return time, nearest


def page_together(name: str, contents: Mapping[str, Content], picture: bytes) -> str:
    """Return one HTML page of several robots."""
    robots = [
        (
            robot,
            f"{travelled(each):.2f}",
            _counted(each),
        )
        for robot, each in contents.items()
    ]
    events = sorted((time, robot, text) for robot, each in contents.items() for time, text in each.events)
    return _page(
        name,
        picture,
        "paths, speeds, distances",
        _together(contents),
        "",
        ("The run", ("", ""), _facts(next(iter(contents.values())))),
        ("Robots", ("robot", "driven / m", "faults"), robots),
        ("Events", ("t / s", "robot", "what"), [(f"{time:.2f}", robot, text) for time, robot, text in events]),
    )


def _together(contents: Mapping[str, Content]) -> list[str]:
    """Return the summary of several robots: how far, how near, who was disarmed."""
    _, nearest = distances([pose for pose in map(_pose, contents.values()) if pose.shape[1] > 1])
    lines = [f"{len(contents)} robots drove {sum(map(travelled, contents.values())):.2f} m together."]
    if nearest.size:
        lines.append(f"The smallest distance between two centres was {float(nearest.min()):.2f} m.")
    disarmed = [robot for robot, each in contents.items() if each.disarms]
    lines.append(f"Disarmed during the run: {', '.join(disarmed)}." if disarmed else "None was ever disarmed.")
    return lines


def _pose(content: Content) -> NDArray[np.float64]:
    """The true pose in the room over time, as columns."""
    return content.columns("pose")


def travelled(content: Content) -> float:
    """The length of a robot's path by its odometry, m."""
    return float(np.hypot(*np.diff(content.columns("odometry")[1:3])).sum())


def report(path: Path, stem: Path, robot: str | None = None) -> tuple[Path, Path]:
    """The files drawn, STEM.png and STEM.html; RecordingError when one cannot be read or written.

    A recording of several robots is drawn as one picture, unless one of them is asked for.
    """
    names = robots_in(path)
    with trusting(path):
        if robot is None and len(names) > 1:
            contents = {name: Content(path, name) for name in names}
            picture = draw_together(contents)
            text = page_together(path.name, contents, picture)
        else:
            content = Content(path, robot)
            picture = draw(content)
            text = page(path.name, content, picture)
    png, page_file = stem.with_name(f"{stem.name}.png"), stem.with_name(f"{stem.name}.html")
    try:
        png.write_bytes(picture)
        page_file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{error.filename or stem}: cannot write it: {error.strerror}") from None
    return png, page_file
