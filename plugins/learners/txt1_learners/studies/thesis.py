"""The thesis's simulation (5.4) by each reading of its text, beside the 7.165 s that it reports.

    FILE.jsonl   a line for each reading and trial: the times of its repetitions, and which of them succeeded
    FILE.md      the table, from that file alone

A reading is the world `thesis-simulation` with some settings changed. 7.165 s is the mean over five trials of all
repetitions after the 7th. So of the trials of a reading five are drawn with replacement, `DRAWS` times, and a reading
reproduces the figure when it lies within the middle 95 % of these means. docs/results/thesis.md argues which reading is
the text's.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.config import Config, load
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.learning.experiment import LEARNED, THESIS_MEAN
from txt1.learning.qtable import replace_file
from txt1.learning.registry import make
from txt1.learning.world_presets import world_named
from txt1.trials.provenance import provenance
from txt1.trials.run import Rows
from txt1_learners.studies.lockstep import trials
from txt1_learners.studies.suite import Each

FORMAT: Final = "txt1 readings of the thesis"
WORLD: Final = "thesis-simulation"
EPISODES: Final = 31
TRIALS_OF_THE_THESIS: Final = 5
DRAWS: Final = 10_000
BLOCK: Final = 20  # trials that are done side by side

SUMMED: Final = {"learning.thesis.direction": "summed"}
DIAGONAL: Final = {"learning.thesis.direction": "diagonal"}
FOURTH: Final = {"sim.light.exponent": 4}

READINGS: Final[dict[str, dict[str, Any]]] = {
    "the reading held": {},
    "weighted sum, by the letter": SUMMED,
    "45 degrees for each sensor": DIAGONAL,
    "true bearing, as the original program": {"sim.light.true_bearing": True},
    "1/d^4": FOURTH,
    "weighted sum, 1/d^4": SUMMED | FOURTH,
    "45 degrees, 1/d^4": DIAGONAL | FOURTH,
    "boundary +-4 m": {"learning.boundary": 4.0},
    "boundary +-2.5 m": {"learning.boundary": 2.5},
    "weighted sum, boundary +-4 m": SUMMED | {"learning.boundary": 4.0},
    "weighted sum, boundary +-2.5 m": SUMMED | {"learning.boundary": 2.5},
    "no remedy": {"learning.thesis.remedy": "none"},
    "remedy 1, hold": {"learning.thesis.remedy": "hold"},
    "weighted sum, remedy 1": SUMMED | {"learning.thesis.remedy": "hold"},
    "greedy": {"learning.thesis.policy": "greedy"},
    "random, then greedy from repetition 8": {"learning.thesis.policy": "random", "learning.thesis.training": LEARNED},
    "no lowest temperature": {"learning.thesis.temperature_floor": 1e-9},
    "cooled by decisions": {"learning.thesis.cooling": "decisions"},
    "goal looked for ten times a second": {"learning.goal_period": 0.1},
    "weighted sum, goal ten times a second": SUMMED | {"learning.goal_period": 0.1},
    "weighted sum, with the hardware's filter": SUMMED | {"learning.thesis.filtered": True},
    "with the hardware's filter": {"learning.thesis.filtered": True},
}


def config_of(reading: str) -> Config:
    """Return the world of a reading."""
    return with_values(load(world_named(WORLD)).config, READINGS[reading])


def run_told(told: Sequence[Any]) -> list[dict[str, Any]]:
    """Do some trials of a reading; a line of the file for each."""
    reading, first, count, seed = told
    config, code = config_of(reading), provenance()["code"]
    done = trials(config, lambda rng: make("thesis", config, rng), range(first, first + count), EPISODES, seed)
    return [
        {
            "reading": reading,
            "trial": first + k,
            "code": code,
            "times": [round(one.time, 3) for one in each.episodes],
            "success": [int(one.success) for one in each.episodes],
        }
        for k, each in enumerate(done)
    ]


def study(file: Path, count: int, seed: int, each: Each, tell: Callable[[str], None], names: Sequence[str] = ()) -> int:
    """Do the trials that the file does not hold yet, then write the table; the exit code.

    Raises ConfigError: the file is of something else, or of another seed.
    """
    rows = Rows(file)
    new, (first, lines) = not file.exists(), rows.headed("reading", "trial", "times", "success", "code")
    head = {"format": FORMAT, "seed": seed, "world": WORLD, "provenance": provenance()}
    if new:
        rows.add(head)
    elif first.get("format") != FORMAT or first.get("seed") != seed:
        raise ConfigError(f"{file}: is of something else, or of another seed; give another file")
    done = {(line["reading"], line["trial"]) for line in lines}
    missing = {
        (reading, first): [reading, first, min(BLOCK, count + 1 - first), seed]
        for reading in names or READINGS
        for first in range(1, count + 1, BLOCK)
        if (reading, first) not in done
    }

    def keep(place: tuple[str, int], some: list[dict[str, Any]]) -> None:
        for line in some:
            rows.add(line)
        tell(f"{place[0]}, trials {place[1]} to {place[1] + len(some) - 1}")

    code = each(run_told, missing, keep)
    replace_file(file.with_suffix(".md"), table(file))
    return code


def figures(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the trials of a reading come to; times in s, of all repetitions after the 7th."""
    times = np.array([line["times"] for line in lines])[:, LEARNED:]
    won = np.array([line["success"] for line in lines])[:, LEARNED:] == 1
    means = times.mean(axis=1)
    rng = np.random.default_rng(0)
    five = means[rng.integers(0, len(means), (DRAWS, TRIALS_OF_THE_THESIS))].mean(axis=1)
    low, high = np.percentile(five, (2.5, 97.5))
    return {
        "trials": len(means),
        "mean": float(means.mean()),
        "error": float(means.std(ddof=1) / np.sqrt(len(means))) if len(means) > 1 else float("nan"),
        "low": float(low),
        "high": float(high),
        "median": float(np.median(times)),
        "success": float(won.mean()),
        "of_successes": float(times[won].mean()) if won.any() else float("nan"),
        "reproduced": bool(low <= THESIS_MEAN <= high),
    }


def table(file: Path) -> str:
    """The table in Markdown, in the order of `READINGS`."""
    head, *lines = Rows(file).read()
    trials: set[int] = set()
    rows = [
        "| reading: that held, with | mean | means of five trials, 95 % | 7.165 s within | success |",
        "|---" * 5 + "|",
    ]
    for reading in READINGS:
        some = [line for line in lines if line["reading"] == reading]
        if some:
            one = figures(some)
            rows.append(
                f"| {reading} | {one['mean']:.2f} +- {one['error']:.2f} | {one['low']:.2f} to {one['high']:.2f} | "
                f"{'yes' if one['reproduced'] else 'no'} | {100.0 * one['success']:.1f} % |"
            )
            trials.add(one["trials"])
    codes = ", ".join(sorted({line["code"] for line in lines}))
    many = " to ".join(map(str, sorted({min(trials, default=0), max(trials, default=0)})))
    return "\n".join([*rows, "", f"Seed {head['seed']}, {many} trials of {EPISODES} repetitions; code {codes}.", ""])
