"""Many trials: over processes, into files, and carried on after an interruption.

A directory holds

    experiment.json      what is done: agent, seed, episodes, settings
    trials/0001.json     each trial: its episodes, its table, the paths of some of them
    qtable.json          the table of the best trial: most successes, then least time over its last 10 episodes
    learning.csv         a line for each episode
    metrics.json         what it all amounts to
    *.png                pictures, where matplotlib is installed

A trial in simulation repeats bit for bit from its seed. So a trial that was interrupted is done again from its start,
and the result is the very one of an uninterrupted run. A real robot does not repeat: there, the agent carries on from
what it had learned.
"""

from __future__ import annotations

import csv
import itertools
import json
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.config import Config
from txt1.errors import ConfigError, QTableError, Txt1Error
from txt1.kernel.loop import Speed
from txt1.learning import qtable
from txt1.learning.conduct import Outcome, on_robot, recorded_plan, robot_config
from txt1.learning.metrics import LAST, summary
from txt1.learning.qtable import StoredTable
from txt1.learning.task import SIMULATED
from txt1.learning.trial import Episode, Start
from txt1.record.session import discard, need

FORMAT: Final = "txt1 learning"
VERSION: Final = 1
COLUMNS: Final = ("trial", "episode", "bearing_rad", "heading_rad", "time_s", "success", "optimal_time_s")
SIGNALS: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
POLL: Final = 0.1
"""s of real time between two looks at what the processes have to tell."""


class Plan(NamedTuple):
    """What is to be done.

    Attributes:
        agent: name of the learner.
        trials: how many, each from scratch.
        episodes: of each trial.
        seed: repeats every random value.
        config: of everything else.
        speed: of the robot's time.
        jobs: processes.
        arm: whether to arm a robot that does not arm by itself.
        log: the file to record to; with several trials, what the names of their files begin with.

    """

    agent: str
    trials: int
    episodes: int
    seed: int
    config: Config
    speed: Speed = "max"
    jobs: int = 1
    arm: bool = False
    log: Path | None = None

    @property
    def simulated(self) -> bool:
        """Whether trials repeat, and can be done side by side."""
        light = self.config.sensors.get(self.config.learning.sensor)
        return self.config.hal == "sim" and (light is None or light.driver == SIMULATED)

    def keep_paths(self) -> set[int]:
        """Numbers of the episodes whose paths are kept: the first, the thesis's 10th, the last."""
        return {1, min(10, self.episodes), self.episodes}

    def identity(self) -> dict[str, Any]:
        """What must be the same for one run to carry on where another ended; the number of trials may grow."""
        config = self.config.model_dump(mode="json", exclude={"seed"})
        return {"agent": self.agent, "episodes": self.episodes, "seed": self.seed, "config": config}


Watch = Callable[[int, Episode], None]
"""Told each episode as it ends, with the number of its trial."""

Ended = signal.Signals | Txt1Error | None
"""Why there are no more trials: a signal or an error ended them, or, None, all are complete."""


# -- running -----------------------------------------------------------------------------------------------------


def conduct(plan: Plan, out: Path, resume: bool, watch: Watch) -> tuple[list[Outcome], Ended]:
    """What came of the trials, in their order, and why there are no more; a signal ends it early, nothing is lost.

    Raises:
        ConfigError: the directory cannot be used, or holds another experiment.

    """
    done = prepare(plan, out, resume)
    outcomes = {one.trial: one for one in done if one.complete}
    for outcome in outcomes.values():
        for episode in outcome.episodes:
            watch(outcome.trial, episode)
    missing = [number for number in range(1, plan.trials + 1) if number not in outcomes]
    begun = {} if plan.simulated else {one.trial: one for one in done if not one.complete}
    logs = recordings(plan, missing, begun, resume)

    def keep(outcome: Outcome) -> None:
        outcomes[outcome.trial] = outcome

    ended: Ended = None
    with _signals() as came:
        try:
            if plan.jobs > 1 and plan.simulated and len(missing) > 1:
                _side_by_side(plan, missing, logs, out, watch, keep, came)
            else:
                _one_by_one(plan, missing, logs, begun, out, watch, keep, came)
        except Txt1Error as error:
            ended = error
    complete = len(outcomes) >= plan.trials and all(one.complete for one in outcomes.values())
    if came and not complete:
        ended = came[0]
    return [outcomes[number] for number in sorted(outcomes)], ended


@contextmanager
def _signals() -> Iterator[list[signal.Signals]]:
    """Within the block, Ctrl-C and other requests to end only add to the list that it yields."""
    came: list[signal.Signals] = []
    before = {each: signal.signal(each, lambda number, _: came.append(signal.Signals(number))) for each in SIGNALS}
    try:
        yield came
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes born within the block are deaf to signals, which are their parent's business."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def recordings(plan: Plan, numbers: Sequence[int], begun: Collection[int], resume: bool) -> dict[int, Path]:
    """The files to which these trials are to be recorded, and nothing stands in their way; none without `plan.log`.

    A trial that is done again from its start is recorded anew; one that carries on, to a file of its own.

    Raises:
        ConfigError: there is such a file already, and it is no recording of that trial.
        MissingExtra: the extra `record` is not installed.

    """
    log = plan.log
    if log is None:
        return {}
    need("--log", "record", "mcap", "zstandard", "lz4")
    files = {}
    for number in numbers:
        file = log if plan.trials == 1 else log.with_name(f"{log.stem}-trial-{number:04d}{log.suffix}")
        if number in begun or (resume and file.exists() and not plan.simulated):  # it does not repeat
            again = (file.with_name(f"{file.stem}-again-{k}{file.suffix}") for k in itertools.count(1))
            file = next(each for each in again if not each.exists())
        elif file.exists():
            own = robot_config(plan.config, plan.seed, number)
            told = recorded_plan(plan.agent, plan.seed, number, plan.episodes)
            if not (resume and discard(file, own, told)):
                raise ConfigError(f"--log: there is a file {file} already; choose another name")
        files[number] = file
    return files


def _one_by_one(
    plan: Plan, numbers: Sequence[int], logs: dict[int, Path], begun: dict[int, Outcome], out: Path, watch: Watch,
    keep: Callable[[Outcome], None], came: Sequence[signal.Signals],
) -> None:  # fmt: skip
    """The trials in this process."""

    def save(outcome: Outcome) -> None:
        save_outcome(out, outcome)
        keep(outcome)

    for number in numbers:
        if came:
            return
        before = begun.get(number)
        for episode in before.episodes if before else []:
            watch(number, episode)
        on_robot(
            plan.agent, plan.config, plan.seed, number, plan.episodes, speed=plan.speed, arm=plan.arm,
            done=lambda episode, number=number: watch(number, episode),  # type: ignore[misc]
            keep_paths=plan.keep_paths(), stopped=lambda: bool(came), before=before, keep=save, log=logs.get(number),
        )  # fmt: skip


_stop: Any = None
_news: Any = None


def _enter(stop: Any, news: Any) -> None:
    """Make a process ready to work; it ends with its parent."""
    global _stop, _news
    _stop, _news = stop, news

    def end_with_parent() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def _work(plan: Plan, number: int, log: Path | None, out: Path) -> Outcome | None:
    """One trial in a process of its own; None when it was not begun."""
    if _stop.is_set():
        return None
    return on_robot(
        plan.agent, plan.config, plan.seed, number, plan.episodes, keep_paths=plan.keep_paths(),
        done=lambda episode: _news.put((number, episode)), stopped=_stop.is_set,
        keep=lambda outcome: save_outcome(out, outcome), log=log,
    )  # fmt: skip


def _side_by_side(
    plan: Plan, numbers: Sequence[int], logs: dict[int, Path], out: Path, watch: Watch,
    keep: Callable[[Outcome], None], came: Sequence[signal.Signals],
) -> None:  # fmt: skip
    """The trials in several processes."""
    context = multiprocessing.get_context("spawn")
    with _deaf():  # here the process is born that tidies up after the others
        stop, news = context.Event(), context.Queue()

    def listen(timeout: float) -> None:
        try:
            while True:
                watch(*news.get(timeout=timeout))
                timeout = 0.0
        except queue.Empty:
            pass

    with ProcessPoolExecutor(plan.jobs, context, _enter, (stop, news)) as pool:
        with _deaf():
            futures: list[Future[Outcome | None]] = [
                pool.submit(_work, plan, number, logs.get(number), out) for number in numbers
            ]
        try:
            while wait(futures, timeout=0.0).not_done:
                if came or any(future.done() and future.exception() for future in futures):
                    stop.set()
                listen(POLL)
            listen(POLL)
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        for future in futures:
            if future.exception() is None and (outcome := future.result()) is not None:
                keep(outcome)
        try:
            for future in futures:
                future.result()
        except BrokenProcessPool:
            for child in multiprocessing.active_children():  # the pool asks them in a way they are deaf to
                child.kill()
            raise Txt1Error("a process that did a trial was killed from outside, perhaps for lack of memory") from None


# -- files -------------------------------------------------------------------------------------------------------


def prepare(plan: Plan, out: Path, resume: bool) -> list[Outcome]:
    """The trials that the directory holds already; it is made when there is none.

    Raises:
        ConfigError: it cannot be used, or it holds another experiment, or one that is not to be carried on.

    """
    mark = out / "experiment.json"
    identity = plan.identity()
    try:
        (out / "trials").mkdir(parents=True, exist_ok=True)
        trials = sorted((out / "trials").glob("*.json"))
        before = json.loads(mark.read_text(encoding="utf-8")) if mark.exists() else None
        if before is not None and not _is_ours(before):
            raise ConfigError(f"--out {out}: experiment.json is not this program's; give another directory")
        if not trials:  # nothing came of what was begun here, if anything was
            content = {"format": FORMAT, "version": VERSION, **identity}
            mark.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
            return []
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror}; give a directory that can be made or written to") from None
    except ValueError as error:
        raise ConfigError(f"--out {out}: experiment.json is damaged ({error}); give another directory") from None
    if before is None:
        raise ConfigError(
            f"--out {out}: there are trials, but no experiment.json to say of what; give another directory"
        )
    if not resume:
        raise ConfigError(
            f"--out {out}: holds an experiment already; --resume carries it on, or give another directory"
        )
    was, now = (dict(_flat({key: tree.get(key) for key in identity})) for tree in (before, identity))
    for key in now | was:
        if was.get(key) != now.get(key):
            raise ConfigError(
                f"--resume: {out} was begun with {key.removeprefix('config.')}={was.get(key)}, not {now.get(key)}; "
                "repeat that, or give another directory"
            )
    return [load_outcome(path) for path in trials]


def _is_ours(before: Any) -> bool:
    """Whether this is what `prepare` writes."""
    return isinstance(before, dict) and before.get("format") == FORMAT and before.get("version") == VERSION


def _flat(tree: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of nested dictionaries, with the keys that lead to it."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield above + key, value


def save_outcome(out: Path, outcome: Outcome) -> None:
    """Write a trial to a file of its own, which holds a checked Q-table with the rest beside it."""
    about = {
        **outcome.table.about,
        "trial": outcome.trial,
        "complete": outcome.complete,
        "voided": outcome.voided,
        "learned": [[*one.start, one.time, one.success, one.optimal_time] for one in outcome.episodes],
        "paths": {str(number): path for number, path in outcome.paths.items()},
        "memory": outcome.memory,
    }
    qtable.save(out / "trials" / f"{outcome.trial:04d}.json", StoredTable(outcome.table.values, about))


def load_outcome(path: Path) -> Outcome:
    """A trial from its file.

    Raises:
        QTableError: it was cut off or altered, or is no trial.

    """
    again = "delete it, and it is done again"
    try:
        stored = qtable.load(path)
    except QTableError as error:
        raise QTableError(str(path), error.problem, again) from error
    about = dict(stored.about)
    try:
        episodes = [
            Episode(k, Start(bearing, heading), time, success, best)
            for k, (bearing, heading, time, success, best) in enumerate(about.pop("learned"), 1)
        ]
        paths = {int(number): [(x, y) for x, y in path] for number, path in about.pop("paths").items()}
        trial, complete, voided = about.pop("trial"), about.pop("complete"), about.pop("voided")
        memory = about.pop("memory")
    except (KeyError, TypeError, ValueError) as error:
        raise QTableError(str(path), f"is no trial: {error}", again) from error
    return Outcome(trial, episodes, complete, StoredTable(stored.values, about), memory, paths, voided)


def best(outcomes: Sequence[Outcome]) -> Outcome:
    """The trial that ended best: most successes, then least time over its last 10 episodes."""

    def merit(one: Outcome) -> tuple[int, float]:
        last = one.episodes[-LAST:]
        return sum(each.success for each in last), -sum(each.time for each in last) / max(1, len(last))

    return max(outcomes, key=merit)


def write(plan: Plan, out: Path, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The metrics, after writing them and everything else but the pictures.

    Raises:
        QTableError: the table cannot be written.
        OSError: nor the rest.

    """
    part = out / "learning.csv.part"
    with part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for outcome in outcomes:
            for one in outcome.episodes:
                row = (outcome.trial, one.number, *(round(x, 9) for x in (*one.start, one.time)), int(one.success))
                writer.writerow((*row, round(one.optimal_time, 9)))
    part.replace(out / "learning.csv")
    metrics = {
        "agent": plan.agent,
        "seed": plan.seed,
        "hal": plan.config.hal,
        "voided": sum(one.voided for one in outcomes),
        **summary([one.episodes for one in outcomes]),
    }
    part = out / "metrics.json.part"
    part.write_text(json.dumps(metrics, indent=1) + "\n", encoding="utf-8")
    part.replace(out / "metrics.json")
    if outcomes:
        chosen = best(outcomes)
        about = {**chosen.table.about, "seed": plan.seed, "trial": chosen.trial}
        qtable.save(out / "qtable.json", StoredTable(chosen.table.values, about))
    return metrics
