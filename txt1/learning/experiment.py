"""The files of a learning experiment, its figures, and how it is carried on.

    experiment.json      the experiment: agent, seed, episodes, settings
    trials/0001.json     each trial: its episodes, its table, the paths of some of them
    qtable.json          the table of the best trial: most successes, then least time over its last 10 episodes
    learning.csv         a line for each episode
    metrics.json         the summary of all trials
    *.png                pictures, where matplotlib is installed

`prepare` writes or compares experiment.json and returns the finished trials. The command does the missing trials and
saves each as it ends (`save_result`). `write` makes the other files from all trials, each time anew.

A trial in simulation repeats bit for bit from its seed, so an interrupted trial is done again from its start. A real
robot does not repeat: there the agent carries on from its memory.
"""

import itertools
import json
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.commands import need
from txt1.config import Config, completed, flatten
from txt1.errors import ConfigError, QTableError
from txt1.kernel.loop import Speed
from txt1.learning import qtable
from txt1.learning.best_time import Floor, known_floor
from txt1.learning.qtable import StoredTable
from txt1.learning.registry import with_settings
from txt1.learning.settings import LearningConfig
from txt1.learning.task import SIMULATED
from txt1.learning.trial import Episode, Start, TrialResult, recorded_plan, robot_config
from txt1.learning.world import settled
from txt1.record.session import discard
from txt1.trials.provenance import code_hash, provenance

FORMAT: Final = "txt1 learning"
VERSION: Final = 1
COLUMNS: Final = (
    *("trial", "episode", "bearing_rad", "heading_rad", "time_s", "success", "optimal_time_s", "floor_s"),
    *("unfit_s", "touched"),
)

# beside the learner's own notes in a trial's file, which may have any other key
OURS: Final = "txt1 learn"
# of a `TrialResult`, as they are
KEPT: Final = ("trial", "complete", "voided", "memory")

# mean time to the light after the first seven episodes that the thesis reports, s (5.4)
THESIS_MEAN: Final = 7.165
# episodes after which the thesis takes its mean
LEARNED: Final = 7
# episodes at the end that are reported separately
LAST_EPISODES: Final = 10
# episodes whose ratio to the optimum is reported
MILESTONES: Final = (1, 2, 4, 8, 16, 31)


class Plan(NamedTuple):
    """The trials to be done."""

    # name of the learner
    agent: str
    # each from scratch
    trials: int
    # of each trial
    episodes: int
    seed: int
    config: Config
    # of the robot's time
    speed: Speed = "max"
    # whether to arm a robot that does not arm by itself
    arm: bool = False
    # the file to record to; with several trials, the beginning of their names
    log: Path | None = None

    @property
    def simulated(self) -> bool:
        """Whether trials repeat, so that several can run in parallel."""
        light = self.config.sensors.get(self.config.section(LearningConfig).sensor)
        return self.config.hal == "sim" and (light is None or light.driver == SIMULATED)

    def keep_paths(self) -> set[int]:
        """Numbers of the episodes whose paths are kept: the first, the thesis's tenth, and the last."""
        return {1, min(10, self.episodes), self.episodes}

    def identity(self) -> dict[str, Any]:
        """Return all that must be equal when a run carries on another; only the number of trials may grow."""
        config = {key: value for key, value in flatten(completed(self.config)) if key != "seed"}
        return {"agent": self.agent, "episodes": self.episodes, "seed": self.seed, "config": config}


# called with each episode as it ends, and the number of its trial
Watch = Callable[[int, Episode], None]


def recordings(plan: Plan, numbers: Sequence[int], begun: Collection[int], resume: bool) -> dict[int, Path]:
    """Return the file to record each trial to; empty without `plan.log`.

    A trial that is done again from its start replaces its recording. A trial that carries on gets a new file.

    Raises ConfigError: such a file exists and is not a recording of this trial; MissingExtra: the extra `record` is not
    installed.
    """
    log = plan.log
    if log is None:
        return {}
    need("--log", "record", "mcap", "zstandard", "lz4")
    files = {}
    for number in numbers:
        file = log if plan.trials == 1 else log.with_name(f"{log.stem}-trial-{number:04d}{log.suffix}")
        # a real robot does not repeat
        if number in begun or (resume and file.exists() and not plan.simulated):
            again = (file.with_name(f"{file.stem}-again-{k}{file.suffix}") for k in itertools.count(1))
            file = next(each for each in again if not each.exists())
        elif file.exists():
            own = robot_config(plan.config, plan.seed, number)
            told = recorded_plan(plan.agent, plan.seed, number, plan.episodes)
            if not (resume and discard(file, own, told)):
                raise ConfigError(f"--log: there is a file {file} already; choose another name")
        files[number] = file
    return files


def prepare(plan: Plan, out: Path, resume: bool) -> list[TrialResult]:
    """Return the trials that the directory holds already; the directory is made if it is missing.

    Raises ConfigError: it cannot be used, it holds another experiment, or it must not be carried on.
    """
    mark = out / "experiment.json"
    identity = plan.identity()
    try:
        (out / "trials").mkdir(parents=True, exist_ok=True)
        trials = any((out / "trials").glob("*.json"))
        before = json.loads(mark.read_text(encoding="utf-8")) if mark.exists() else None
        if before is not None and (before.get("format"), before.get("version")) != (FORMAT, VERSION):
            raise ConfigError(f"--out {out}: experiment.json is not this program's; give another directory")
        # no trial was finished here, if any was begun
        if not trials:
            content = {"format": FORMAT, "version": VERSION, **identity, "provenance": provenance()}
            mark.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
            return []
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror}; give a directory that can be made or written to") from None
    except (ValueError, AttributeError) as error:
        raise ConfigError(f"--out {out}: experiment.json is damaged ({error}); give another directory") from None
    if before is None:
        raise ConfigError(f"--out {out}: holds trials without their experiment.json; give another directory")
    if not resume:
        raise ConfigError(f"--out {out}: holds an experiment; --resume carries it on, or give another directory")
    begun = (before.get("provenance") or {}).get("code")
    if begun != code_hash():
        raise ConfigError(
            f"--resume: {out} was begun by other code ({begun or 'not told'}, this is {code_hash()}); go on with the "
            "version that began it, or give another directory"
        )
    was, now = (each | each.get("config", {}) for each in (before, identity))
    for key in sorted((now.keys() | was.keys()) - {"config", "format", "version", "provenance"}):
        if was.get(key) != now.get(key):
            raise ConfigError(
                f"--resume: {out} was begun with {key}={was.get(key)}, not {now.get(key)}; repeat that, or give "
                "another directory"
            )
    return load_results(out)


def load_results(out: Path) -> list[TrialResult]:
    """Return the trials in a directory, in order; raises QTableError: one of them is damaged."""
    return [load_result(path) for path in sorted((out / "trials").glob("*.json"))]


def result_file(out: Path, number: int) -> Path:
    """A trial's file."""
    return out / "trials" / f"{number:04d}.json"


def save_result(out: Path, result: TrialResult) -> None:
    """Write a trial to a file of its own: a checked Q-table, and the rest beside it."""
    ours = {
        **{key: getattr(result, key) for key in KEPT},
        "learned": [[*one.start, *one[2:]] for one in result.episodes],
        "paths": {str(number): path for number, path in result.paths.items()},
    }
    qtable.save(result_file(out, result.trial), StoredTable(result.table.values, {**result.table.about, OURS: ours}))


def load_result(path: Path) -> TrialResult:
    """Return a trial from its file; raises QTableError: it was cut off or altered, or is no trial."""
    again = "delete it, and it is done again"
    try:
        stored = qtable.load(path)
    except QTableError as error:
        raise QTableError(str(path), error.problem, again) from error
    about = dict(stored.about)
    # files of before have it among the learner's notes
    ours = about.pop(OURS, about)
    try:
        episodes = [
            Episode(k, Start(bearing, heading), time, success, best, *rest)
            for k, (bearing, heading, time, success, best, *rest) in enumerate(ours.pop("learned"), 1)
        ]
        paths = {int(number): [(x, y) for x, y in path] for number, path in ours.pop("paths").items()}
        kept = {key: ours.pop(key) for key in KEPT}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise QTableError(str(path), f"is no trial: {error}", again) from error
    return TrialResult(episodes=episodes, table=StoredTable(stored.values, about), paths=paths, **kept)


def best(results: Sequence[TrialResult]) -> TrialResult:
    """The trial that ended best: most successes, then least time over its last 10 episodes."""

    def merit(one: TrialResult) -> tuple[int, float]:
        last = one.episodes[-LAST_EPISODES:]
        return sum(each.success for each in last), -sum(each.time for each in last) / max(1, len(last))

    return max(results, key=merit)


def write(plan: Plan, out: Path, results: Sequence[TrialResult]) -> dict[str, Any]:
    """Write all files but the pictures, and return the metrics; raises QTableError or OSError: it cannot."""
    floor = known_floor(plan.config)
    lines: list[tuple[str, ...]] = [COLUMNS]
    for result in results:
        for one in result.episodes:
            least = "" if floor is None else floor.time(one.start)
            numbers = (*one.start, one.time, int(one.success), one.optimal_time)
            told = "" if one.unfit is None else str(round(one.unfit, 9)), str(int(one.touched))
            lines.append((str(result.trial), str(one.number), *(str(round(x, 9)) for x in numbers), str(least), *told))
    qtable.replace_file(out / "learning.csv", "".join(",".join(line) + "\r\n" for line in lines))
    metrics = {
        "agent": plan.agent,
        "seed": plan.seed,
        "hal": plan.config.hal,
        "voided": sum(one.voided for one in results),
        "provenance": provenance(),
        "settings": plan.config.section(LearningConfig).model_dump(mode="json").get(plan.agent),
        "config": completed(plan.config).model_dump(mode="json", exclude={"seed"}),
        **summary([one.episodes for one in results], floor),
    }
    qtable.replace_file(out / "metrics.json", json.dumps(metrics, indent=1) + "\n")
    if results:
        chosen = best(results)
        about = {"seed": plan.seed, "trial": chosen.trial, **chosen.table.about}
        table = with_settings(settled(plan.config), plan.agent, StoredTable(chosen.table.values, about))
        qtable.save(out / "qtable.json", table)
    return metrics


def summary(trials: Sequence[Sequence[Episode]], floor: Floor | None = None) -> dict[str, Any]:
    """Return times in s, success as shares, ratios to optimum and floor; JSON values. Trials may differ in length.

    Failures are counted separately. Times and ratios are of successes, and None if there are none. Only
    `mean_time_of_all_s` includes the time of failures.
    """
    every = [one for trial in trials for one in trial]
    # when the learner reported that its model does not fit, s
    said = [one.unfit for one in every if one.unfit is not None]
    # an episode, over all trials that reached it
    curve = {k: some for k in MILESTONES if (some := [trial[k - 1] for trial in trials if len(trial) >= k])}
    return {
        "trials": len(trials),
        "episodes": len(every),
        "failures": sum(not one.success for one in every),
        "contacts": sum(one.touched for one in every),
        "model_does_not_fit": {"episodes": len(said), "median_s": _round(np.median(said)) if said else None},
        "thesis_mean_time_s": THESIS_MEAN,
        "after_episode_7": _figures([one for trial in trials for one in trial[LEARNED:]], floor),
        "last_10": _figures([one for trial in trials for one in trial[-LAST_EPISODES:]], floor),
        "ratio_at_episode": {str(k): _figures(some, floor).get("ratio_to_optimum") for k, some in curve.items()},
    }


def _figures(some: Sequence[Episode], floor: Floor | None) -> dict[str, Any]:
    """Return the success, and the times and regret of the successes."""
    if not some:
        return {"episodes": 0}
    won = [one for one in some if one.success]
    counts = {
        "episodes": len(some),
        "failures": len(some) - len(won),
        "success": len(won) / len(some),
        # failures with their time, as in the thesis's learning curve
        "mean_time_of_all_s": _round(np.mean([one.time for one in some])),
    }
    if not won:
        return counts
    time, best = np.array([(one.time, one.optimal_time) for one in won]).T
    least = None if floor is None else sum(floor.time(one.start) for one in won)
    return {
        **counts,
        "mean_time_s": _round(time.mean()),
        "median_time_s": _round(np.median(time)),
        "optimal_mean_time_s": _round(best.mean()),
        "mean_regret_s": _round((time - best).mean()),
        "ratio_to_optimum": _round(time.sum() / best.sum()),
        "ratio_to_floor": None if least is None else _round(time.sum() / least),
    }


def _round(value: Any) -> float:
    return round(float(value), 4)
