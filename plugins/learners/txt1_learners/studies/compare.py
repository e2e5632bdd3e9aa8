"""Contenders beside each other in one world, per seconds driven: raw results in a file, a table and a figure of them.

    NAME.jsonl   the first line says what was done, with which configuration and versions; then a line for each
                 contender and trial, with its code's hash, in the order they were done: see `run`
    NAME.md      the table, NAME.png the figure: both from that file alone

All have the same starts and the same simulated robot, and one rule holds for all: ten times a second it is looked
whether the robot is at the goal or has left the boundary (`asked_alike`), whatever the learner's own rate. Those that
learn while they drive (`txt1.learning.registry`) are judged by the episodes in which they learn. PPO and DQN are
trained by several robots at once and judged at checkpoints, apart, by their best actions: the seconds of these tests
are not counted.

Failures are counted apart and are in no ratio; the time they took is among the seconds driven.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from txt1.config import Config, completed
from txt1.config.schema import RECORDED
from txt1.config.sources import with_values
from txt1.errors import ConfigError, LightFault
from txt1.learning.agent import Agent
from txt1.learning.qtable import replace_file
from txt1.learning.registry import LEARNERS, make
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.trial import starts, stream, task_of
from txt1.learning.world import settled
from txt1.trials.provenance import provenance
from txt1.trials.run import Rows
from txt1_learners.studies import homing
from txt1_learners.studies.contenders import COLUMNS, TRAINED, Line, draw, table
from txt1_learners.studies.lockstep import asked_alike, trials
from txt1_learners.studies.modelled_settings import LOCKSTEP, refuse_others
from txt1_learners.studies.suite import Each, floors, leaves_out

FORMAT: Final = "txt1 comparison"
LONG: Final = 20  # trials of those, at most: they train long
VARIANTS: Final[dict[str, tuple[str, dict[str, Any]]]] = {  # contenders that are a learner with other settings
    "thesis-10": ("thesis", {"learning.thesis.period": 0.1}),  # at the others' decision rate
}
RULES: Final[dict[str, Callable[[Config, Any], Agent]]] = {"homing": homing.create}  # contenders that learn nothing
CHECKPOINTS: Final = (100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10_000.0, 20_000.0)  # s driven
TRAIN, TEST = 7, 8  # mark streams of random values


def run(name: str, number: int, config: Config, episodes: int, seed: int) -> Line:
    """A contender's trial as a line of the file: JSON values.

    `curve` is a list of [seconds driven before, rows by COLUMNS]: one pair for who learns as he drives, one for each
    checkpoint of who is trained. `refused` says why there is none: sensors that a learner does not believe.
    """
    config = settled(config)
    floor, task = floors(config, episodes), task_of(config)
    where = starts(seed, number, episodes)
    line: Line = {"contender": name, "trial": number, "code": provenance()["code"]}
    if left_out := leaves_out(config):
        line["floor_leaves_out"] = left_out
    curve: list[tuple[float, list[list[float]]]] = []

    def rows(outcomes: Sequence[tuple[float, bool]]) -> list[list[float]]:
        return [
            [round(time, 3), int(success), round(start.optimal_time(task), 3), round(least.time(start), 3)]
            for (time, success), start, least in zip(outcomes, where, floor, strict=True)
        ]

    if name in TRAINED:
        from txt1_learners.studies import sb3

        test = stream(seed, number, TEST).integers(2**31)

        def check(driven: float, model: Any) -> None:
            curve.append((round(driven, 1), rows(sb3.drive(model, config, where, test))))

        sb3.train(name, config, stream(seed, number, TRAIN).integers(2**31), CHECKPOINTS, check)
    else:
        agent, values = VARIANTS.get(name, (name, {}))
        own = asked_alike(with_values(config, values) if values else config)
        rule = RULES.get(agent)

        def maker(rng: np.random.Generator) -> Agent:
            return make(agent, own, rng) if rule is None else rule(own, rng)

        try:
            (trial,) = trials(own, maker, [number], episodes, seed)
        except LightFault as fault:
            return {**line, "refused": str(fault), "curve": []}
        curve.append((0.0, rows([(one.time, one.success) for one in trial.episodes])))
    return {**line, "curve": curve}


def run_told(told: Sequence[Any]) -> Line:
    """As `run`: its arguments, and its result, as JSON values."""
    name, number, config, episodes, seed = told
    return run(name, number, Config.model_validate(config), episodes, seed)


def compare(
    file: Path,
    names: Sequence[str],
    config: Config,
    count: int,
    episodes: int,
    seed: int,
    each: Each,
    tell: Callable[[Line], None] = lambda line: None,
) -> tuple[list[Line], int]:
    """Do the trials that the file does not hold yet, write each as it is done, then table and figure; all lines.

    `each` is `txt1.trials.run.run` with its workers; its exit code comes with the lines.

    A file that other code began is carried on, as contenders change one by one; each line has the hash of its code, and
    the table tells of all.

    Raises ConfigError: there is no such contender, the world is not modelled or cannot be solved, or the file is of
    another comparison; MissingExtra: PPO or DQN without Stable-Baselines3.
    """
    for name in names:
        if name in TRAINED:
            from txt1_learners.studies import sb3  # noqa: F401 - says that the extra is missing
        elif name not in RULES:
            LEARNERS.place("agent", VARIANTS.get(name, (name, {}))[0])
    # refused before the file is begun
    refuse_unsolvable(settled(config))
    refuse_others(settled(config), LOCKSTEP, "trials in lockstep")
    told = completed(config).model_dump(mode="json", exclude={"seed"})
    head = {"format": FORMAT, "version": 1, "seed": seed, "episodes": episodes, "columns": COLUMNS, "config": told}
    rows, lines = Rows(file), _begun(file, {**head, "provenance": provenance("stable-baselines3", "torch")})
    done = {(line["contender"], line["trial"]) for line in lines}
    whole = config.model_dump(mode="json")
    missing = {
        (name, number): [name, number, whole, episodes, seed]
        for number in range(1, count + 1)
        for name in names
        if (name, number) not in done and (name not in TRAINED or number <= LONG)
    }

    def keep(_: tuple[str, int], line: Line) -> None:
        rows.add(line)
        lines.append(line)
        tell(line)

    code = each(run_told, missing, keep)
    report(file)
    return lines, code


def _begun(file: Path, head: Line) -> list[Line]:
    """The lines of a file that is to be carried on; a new one gets its first line."""
    if not file.exists():
        Rows(file).add(head)
        return []
    before, lines = read(file)
    known = {**before, "config": _as_today(before.get("config"))}
    for key in ("format", "seed", "episodes", "config"):
        if known.get(key) != json.loads(json.dumps(head[key])):
            raise ConfigError(f"{file}: was begun with another {key}; repeat that, or give another file")
    return lines


def _as_today(config: Any) -> Any:
    """A configuration with the defaults of what it did not know yet; None: it is none of today's."""
    try:
        known = completed(Config.model_validate(config, context=RECORDED))
        return json.loads(json.dumps(known.model_dump(mode="json", exclude={"seed"})))
    except ValidationError:
        return None


def read(file: Path) -> tuple[Line, list[Line]]:
    """The first line of a raw file, and all others; one that was cut off is left out."""
    head, lines = Rows(file).headed("contender", "trial", "curve")
    if head.get("format") != FORMAT:
        raise ConfigError(f"{file}: is no comparison of this program; give another file")
    return head, lines


def report(file: Path) -> None:
    """Write the table beside the raw file and, where matplotlib is installed, the figure."""
    head, lines = read(file)
    replace_file(file.with_suffix(".md"), table(head, lines))
    if lines:
        draw(file.with_suffix(".png"), lines)
