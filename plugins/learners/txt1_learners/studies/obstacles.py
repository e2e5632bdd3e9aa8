"""The pilot among obstacles that are drawn at random, beside a planner that knows the map.

    NAME.jsonl   the first line says what was done; then a line for each world: its episodes, by `COLUMNS`
    NAME.md      what they come to

A world has one to four posts and boxes between the starts, 2.5 m from the light, and the light; all stand at least
`APART` from one another, so that the car passes between them. The learner has a laser (`sim_laser`), whose sweeps have
noise and see 240 degrees. The gate of the running robot, which would stop it, is not there: whoever touches something,
or comes nearer than 2 cm, has failed.

`Knowing` is the planner that knows the map: it is told the light's place, the places of all obstacles and the start of
each episode. It plans as the pilot does, and learns only what its actions do. It drives in the first of every
`EVERY` worlds. In all worlds the floor of the world without obstacles stands beside, which no planner can be below.
"""

from collections.abc import Callable, Sequence
from math import cos, hypot, nan, pi, sin
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1 import Odometry
from txt1.config import Config
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.learning.agent import Agent
from txt1.learning.experiment import LEARNED
from txt1.learning.qtable import replace_file
from txt1.learning.registry import make
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import Start, Task, starts, task_of
from txt1.sim.obstacles import outline
from txt1.trials.provenance import provenance
from txt1.trials.run import Rows
from txt1_learners.clear_course import body_of
from txt1_learners.pilot import SETTINGS, PilotAgent
from txt1_learners.planner import Array
from txt1_learners.studies.lockstep import asked_alike, trials
from txt1_learners.studies.suite import Each, floors

FORMAT: Final = "txt1 obstacles"
COLUMNS: Final = ("time_s", "success", "touched", "unfit_s", "floor_s")
START: Final = 2.5  # m from the light
NEAREST, FARTHEST = 0.9, 1.3  # of an obstacle's middle from the light, m
APART: Final = 1.0  # m between the middles of two obstacles: a car's width, its turn, and their sizes
EVERY: Final = 4  # in the first of so many worlds the planner that knows the map drives, too
WORLD: Final = 391  # marks the stream of random values by which a world is drawn
ALONG: Final = 0.02  # m between two points of an outline


def drawn(config: Config, seed: int, number: int) -> Config:
    """World number `number` of a seed: posts, and boxes turned by any angle, in a ring around the light."""
    rng = np.random.default_rng([seed, number, WORLD])
    some: list[dict[str, Any]] = []
    for _ in range(int(rng.integers(1, 5))):
        away, bearing = rng.uniform(NEAREST, FARTHEST), rng.uniform(-pi, pi)
        x, y = float(away * cos(bearing)), float(away * sin(bearing))
        post, sizes = rng.random() < 0.5, rng.uniform(0.0, 1.0, 3).tolist()
        if any(hypot(x - each["x"], y - each["y"]) < APART for each in some):
            continue
        if post:
            some.append({"kind": "post", "x": x, "y": y, "radius": 0.03 + 0.12 * sizes[0]})
        else:
            length, width, theta = 0.1 + 0.4 * sizes[0], 0.1 + 0.2 * sizes[1], pi * sizes[2]
            some.append({"kind": "box", "x": x, "y": y, "length": length, "width": width, "theta": theta})
    told = {"sim.obstacles": some, "sensors": {"laser": {"driver": "sim_laser"}}, "learning.start_radius": START}
    return asked_alike(with_values(config, told))


class Knowing(PilotAgent):
    """The planner that knows the map, the light's place and its own start; see the module."""

    name = "knowing"

    def __init__(self, rng: np.random.Generator, config: Config, begins: Sequence[Start]) -> None:
        body, self._task = config.geometry, task_of(config)
        edges = [np.array(outline(each)) for each in config.sim.obstacles]
        self._points = np.concatenate([_along(each) for each in edges])
        self._begins = begins
        actions = len(config.section(LearningConfig).actions)
        super().__init__(rng, actions, SETTINGS, body_of(body.length, body.width, body.centre))

    @property
    def task(self) -> Task:
        """What is to be done."""
        return self._task

    def begin(self) -> None:
        """An episode begins, at a start that it knows."""
        super().begin()
        self.lost, self.goal, self._near = False, self._task.goal_radius, self._task.goal_radius
        self._seen_before.add(self._points, (0.0, 0.0, 0.0), hide=False)
        self._seen_before.pose = self._begins[self.episode].pose(self._task)
        self._place()

    def look(self, points: Array, odometry: Odometry) -> None:
        """It needs no laser."""

    def act(self, now: float, odometry: Odometry) -> int:
        """As the pilot; in its first episode it tries its actions."""
        a = super().act(now, odometry)
        if self._untried:
            a = self._cautious(self._untried.pop(0), self._seen_before.near())
            self._taken[0] = a
        return a

    def _track(self, z: Array, noise: Array) -> None:
        self._place()

    def _place(self) -> None:
        (x, y, heading), (light_x, light_y) = self._seen_before.pose, self._task.light
        east, north, c, s = light_x - x, light_y - y, cos(heading), sin(heading)
        self._lights = [((c * east + s * north, c * north - s * east, 1e-6, 1e-6, 0.0), 0.0)]
        self._range = self._range[1], hypot(east, north)

    def _judge(self) -> str:
        return ""

    def _late(self) -> None:
        self._arrival = float("inf")


def _along(corners: Array) -> Array:
    """Points on a closed outline, `ALONG` apart."""
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return np.concatenate(
        [
            one + np.linspace(0.0, 1.0, int(hypot(*(other - one)) / ALONG) + 2)[:-1, None] * (other - one)
            for one, other in sides
        ]
    )


def run_told(told: Sequence[Any]) -> dict[str, Any]:
    """Drive in a world: a line of the file."""
    config, seed, number, episodes = Config.model_validate(told[0]), *told[1:]
    world, begins = drawn(config, seed, number), starts(seed, number, episodes)
    floor = floors(world, episodes)

    def rows(maker: Callable[[np.random.Generator], Agent]) -> list[list[float | None]]:
        (trial,) = trials(world, maker, [number], episodes, seed)
        return [
            [round(one.time, 3), int(one.success), int(one.touched), one.unfit, round(least.time(one.start), 3)]
            for one, least in zip(trial.episodes, floor, strict=True)
        ]

    line = {"world": number, "code": provenance()["code"], "obstacles": len(world.sim.obstacles)}
    line["pilot"] = rows(lambda rng: make("pilot", world, rng))
    if number % EVERY == 1:
        line["knowing"] = rows(lambda rng: Knowing(rng, world, begins))
    return line


def study(
    file: Path, config: Config, count: int, episodes: int, seed: int, each: Each, tell: Callable[[str], None]
) -> int:
    """Drive in the worlds that the file does not hold yet, then write what they come to; the exit code.

    Raises ConfigError: the file is of something else, or was begun otherwise.
    """
    rows = Rows(file)
    new, (first, lines) = not file.exists(), rows.headed("world", "pilot")
    head = {"format": FORMAT, "seed": seed, "episodes": episodes, "columns": COLUMNS, "provenance": provenance()}
    if new:
        rows.add(head)
    elif [first.get(key) for key in ("format", "seed", "episodes")] != [FORMAT, seed, episodes]:
        raise ConfigError(f"{file}: is of something else, or of another seed or episodes; give another file")
    done = {line["world"] for line in lines}
    whole = config.model_dump(mode="json")
    missing = {k: [whole, seed, k, episodes] for k in range(1, count + 1) if k not in done}

    def keep(number: int, line: dict[str, Any]) -> None:
        rows.add(line)
        failed = [k for k, row in enumerate(line["pilot"], 1) if not row[1]]
        touched = [k for k, row in enumerate(line["pilot"], 1) if row[2]]
        tell(f"world {number}: {line['obstacles']} obstacles; failed {failed or 'none'}, touched {touched or 'none'}")

    code = each(run_told, missing, keep)
    replace_file(file.with_suffix(".md"), report(file))
    return code


def figures(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the worlds come to; ratios are of the episodes after the 7th that succeeded, with fewer of the last one."""
    pilot = np.array([line["pilot"] for line in lines], float)
    first = min(LEARNED, pilot.shape[1] - 1)
    late = pilot[:, first:]
    won = late[..., 1] == 1.0
    both = [line for line in lines if "knowing" in line]
    found: dict[str, Any] = {
        "worlds": len(lines),
        "episodes": pilot[..., 0].size,
        "contacts": int(pilot[..., 2].sum()),
        "failures": int((pilot[..., 1] == 0.0).sum()),
        "late_episodes": int(won.size),
        "late_failures": int((~won).sum()),
        "to_floor": float(late[..., 0][won].sum() / late[..., 4][won].sum()) if won.any() else nan,
        "compared": 0,
    }
    if both:
        own = np.array([line["pilot"] for line in both], float)[:, first:]
        known = np.array([line["knowing"] for line in both], float)[:, first:]
        reached = (own[..., 1] == 1.0) & (known[..., 1] == 1.0)
        found["compared"] = int(reached.sum())
        found["knowing_failures"], found["knowing_contacts"] = (
            int((known[..., 1] == 0.0).sum()),
            int(known[..., 2].sum()),
        )
        if not reached.any():
            return found
        found["to_knowing"] = float(own[..., 0][reached].sum() / known[..., 0][reached].sum())
        ratios = [float(a[r, 0].sum() / b[r, 0].sum()) for a, b, r in zip(own, known, reached, strict=True) if r.any()]
        rng = np.random.default_rng(0)
        again = np.array(ratios)[rng.integers(0, len(ratios), (1000, len(ratios)))].mean(axis=1)
        found["to_knowing_95"] = [float(each) for each in np.percentile(again, (2.5, 97.5))]
    return found


def report(file: Path) -> str:
    """What the file holds, in a few sentences."""
    head, *lines = Rows(file).read()
    if not lines:
        return "No world yet.\n"
    one = figures(lines)
    text = (
        f"{one['contacts']} contacts in {one['episodes']} episodes, {one['worlds']} worlds; {one['failures']} failed, "
        f"of these {one['late_failures']} of the {one['late_episodes']} after the {LEARNED}th. After it "
        f"{one['to_floor']:.3f} times the floor of the worlds without obstacles"
    )
    if one["compared"]:
        low, high = one["to_knowing_95"]
        text += (
            f"; {one['to_knowing']:.3f} times ({low:.3f} to {high:.3f} over worlds) a planner that knows the map, over "
            f"{one['compared']} episodes. That planner failed in {one['knowing_failures']} episodes, of these "
            f"{one['knowing_contacts']} by a contact"
        )
    codes = ", ".join(sorted({line["code"] for line in lines}))
    return f"{text}. Seed {head['seed']}, {head['episodes']} episodes a world; code {codes}.\n"
