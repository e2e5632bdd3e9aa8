"""Many trials: over processes, into files, and carried on after an interruption.

A directory holds

    experiment.json      what is done: agent, seed, repetitions, settings
    trials/0001.json     each trial: its repetitions, its table, the paths of some of them
    qtable.json          the table of the best trial: most successes, then least time over its last 10 repetitions
    learning.csv         a line for each repetition
    metrics.json         what it all amounts to
    *.png                pictures, where matplotlib is installed

A trial in simulation repeats bit for bit from its seed. So a trial that was interrupted is done again from its start,
and the result is the very one of an uninterrupted run. A real robot does not repeat: there, the agent carries on from
what it had learned.
"""

from __future__ import annotations

import csv
import json
import multiprocessing
import queue
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.config import Config
from txt1.errors import ConfigError, QTableError
from txt1.kernel.loop import Speed
from txt1.learning import qtable
from txt1.learning.conduct import Outcome, on_robot
from txt1.learning.metrics import LAST, summary
from txt1.learning.qtable import StoredTable
from txt1.learning.trial import Repetition, Start

FORMAT: Final = "txt1 learning"
VERSION: Final = 1
COLUMNS: Final = ("trial", "repetition", "bearing_rad", "heading_rad", "time_s", "success", "optimal_time_s")
POLL: Final = 0.1
"""s of real time between two looks at what the processes have to tell."""


class Plan(NamedTuple):
    """What is to be done.

    Attributes:
        agent: name of the learner.
        trials: how many, each from scratch.
        repetitions: of each trial.
        seed: repeats every random value.
        config: of everything else.
        speed: of the robot's time.
        jobs: processes.
        arm: whether to arm a robot that does not arm by itself.

    """

    agent: str
    trials: int
    repetitions: int
    seed: int
    config: Config
    speed: Speed = "max"
    jobs: int = 1
    arm: bool = False

    @property
    def simulated(self) -> bool:
        """Whether trials repeat, and can be done side by side."""
        return self.config.hal == "sim" and self.config.learning.sensors == "sim"

    def keep_paths(self) -> set[int]:
        """Numbers of the repetitions whose paths are kept: the first, the thesis's 10th, the last."""
        return {1, min(10, self.repetitions), self.repetitions}

    def identity(self) -> dict[str, Any]:
        """What must be the same for one run to carry on where another ended; the number of trials may grow."""
        config = self.config.model_dump(mode="json", exclude={"seed"})
        return {"agent": self.agent, "repetitions": self.repetitions, "seed": self.seed, "config": config}


Watch = Callable[[int, Repetition], None]
"""Told each repetition as it ends, with the number of its trial."""


# -- running -----------------------------------------------------------------------------------------------------


def conduct(plan: Plan, out: Path, resume: bool, watch: Watch) -> tuple[list[Outcome], bool]:
    """What came of the trials, in their order, and whether all are complete; Ctrl-C ends it early, nothing is lost.

    Raises:
        ConfigError: the directory cannot be used, or holds another experiment.

    """
    done = prepare(plan, out, resume)
    complete = {one.trial: one for one in done if one.complete}
    for outcome in complete.values():
        for repetition in outcome.repetitions:
            watch(outcome.trial, repetition)
    missing = [number for number in range(1, plan.trials + 1) if number not in complete]
    begun = {} if plan.simulated else {one.trial: one for one in done if not one.complete}
    if plan.jobs > 1 and plan.simulated and len(missing) > 1:
        made = _side_by_side(plan, missing, out, watch)
    else:
        made = _one_by_one(plan, missing, begun, out, watch)
    outcomes = sorted([*complete.values(), *made], key=lambda one: one.trial)
    return outcomes, len(outcomes) >= plan.trials and all(one.complete for one in outcomes)


@contextmanager
def _stop_on_interrupt(stop: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C, and a request to end, call `stop` within the block."""
    before = {each: signal.signal(each, lambda *_: stop()) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _one_by_one(
    plan: Plan, numbers: Sequence[int], begun: dict[int, Outcome], out: Path, watch: Watch
) -> list[Outcome]:
    """The trials in this process."""
    stopped = False
    outcomes: list[Outcome] = []

    def stop() -> None:
        nonlocal stopped
        stopped = True

    with _stop_on_interrupt(stop):
        for number in numbers:
            before = begun.get(number)
            earlier = before.repetitions if before else []
            for repetition in earlier:
                watch(number, repetition)
            outcome = on_robot(
                plan.agent, plan.config, plan.seed, number, plan.repetitions, speed=plan.speed, arm=plan.arm,
                done=lambda repetition, number=number: watch(number, repetition),  # type: ignore[misc]
                keep_paths=plan.keep_paths(), stopped=lambda: stopped, earlier=earlier,
                memory=before.memory if before else None,
            )  # fmt: skip
            save_outcome(out, outcome)
            outcomes.append(outcome)
            if stopped:
                break
    return outcomes


_stop: Any = None
_news: Any = None


def _enter(stop: Any, news: Any) -> None:
    """Make a process ready to work."""
    global _stop, _news
    _stop, _news = stop, news


def _work(plan: Plan, number: int, out: Path) -> Outcome | None:
    """One trial in a process of its own; None when it was not begun."""
    if _stop.is_set():
        return None
    outcome = on_robot(
        plan.agent, plan.config, plan.seed, number, plan.repetitions, keep_paths=plan.keep_paths(),
        done=lambda repetition: _news.put((number, repetition)), stopped=_stop.is_set,
    )  # fmt: skip
    save_outcome(out, outcome)
    return outcome


def _side_by_side(plan: Plan, numbers: Sequence[int], out: Path, watch: Watch) -> list[Outcome]:
    """The trials in several processes."""
    context = multiprocessing.get_context("spawn")
    stop, news = context.Event(), context.Queue()

    def listen(timeout: float) -> None:
        try:
            while True:
                watch(*news.get(timeout=timeout))
                timeout = 0.0
        except queue.Empty:
            pass

    with _stop_on_interrupt(stop.set), ProcessPoolExecutor(plan.jobs, context, _enter, (stop, news)) as pool:
        # Ctrl-C is the parent's business: the processes are born deaf to it, as they inherit what is blocked here
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            futures: list[Future[Outcome | None]] = [pool.submit(_work, plan, number, out) for number in numbers]
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        try:
            while wait(futures, timeout=0.0).not_done:
                listen(POLL)
            listen(POLL)
            return [outcome for future in futures if (outcome := future.result()) is not None]
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


# -- files -------------------------------------------------------------------------------------------------------


def prepare(plan: Plan, out: Path, resume: bool) -> list[Outcome]:
    """The trials that the directory holds already; it is made when there is none.

    Raises:
        ConfigError: it cannot be used, or it holds another experiment, or one that is not to be carried on.

    """
    mark = out / "experiment.json"
    try:
        (out / "trials").mkdir(parents=True, exist_ok=True)
        before = json.loads(mark.read_text(encoding="utf-8")) if mark.exists() else None
        if before is None:
            content = {"format": FORMAT, "version": VERSION, **plan.identity()}
            mark.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror}; give a directory that can be made or written to") from None
    except ValueError as error:
        raise ConfigError(f"--out {out}: experiment.json is damaged ({error}); give another directory") from None
    if before is None:
        return []
    if not resume:
        raise ConfigError(
            f"--out {out}: holds an experiment already; --resume carries it on, or give another directory"
        )
    if not isinstance(before, dict) or before.get("format") != FORMAT or before.get("version") != VERSION:
        raise ConfigError(f"--out {out}: experiment.json is not this program's; give another directory")
    for key, value in plan.identity().items():
        if before.get(key) != value:
            what = f"{key} {before.get(key)!r}" if key != "config" else "another configuration"
            raise ConfigError(f"--resume: {out} was begun with {what}; repeat that, or give another directory")
    return [load_outcome(path) for path in sorted((out / "trials").glob("*.json"))]


def save_outcome(out: Path, outcome: Outcome) -> None:
    """Write a trial to a file of its own, which holds a checked Q-table with the rest beside it."""
    about = {
        **outcome.table.about,
        "trial": outcome.trial,
        "complete": outcome.complete,
        "voided": outcome.voided,
        "learned": [[*one.start, one.time, one.success, one.optimal_time] for one in outcome.repetitions],
        "paths": {str(number): path for number, path in outcome.paths.items()},
        "memory": outcome.memory,
    }
    qtable.save(out / "trials" / f"{outcome.trial:04d}.json", StoredTable(outcome.table.values, about))


def load_outcome(path: Path) -> Outcome:
    """A trial from its file.

    Raises:
        QTableError: it was cut off or altered, or is no trial.

    """
    stored = qtable.load(path)
    about = dict(stored.about)
    try:
        repetitions = [
            Repetition(k, Start(bearing, heading), time, success, best)
            for k, (bearing, heading, time, success, best) in enumerate(about.pop("learned"), 1)
        ]
        paths = {int(number): [(x, y) for x, y in path] for number, path in about.pop("paths").items()}
        trial, complete, voided = about.pop("trial"), about.pop("complete"), about.pop("voided")
        memory = about.pop("memory")
    except (KeyError, TypeError, ValueError) as error:
        raise QTableError(str(path), f"is no trial: {error}", "delete it, and it is done again") from error
    return Outcome(trial, repetitions, complete, StoredTable(stored.values, about), memory, paths, voided)


def best(outcomes: Sequence[Outcome]) -> Outcome:
    """The trial that ended best: most successes, then least time over its last 10 repetitions."""

    def merit(one: Outcome) -> tuple[int, float]:
        last = one.repetitions[-LAST:]
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
            for one in outcome.repetitions:
                row = (outcome.trial, one.number, *(round(x, 9) for x in (*one.start, one.time)), int(one.success))
                writer.writerow((*row, round(one.optimal_time, 9)))
    part.replace(out / "learning.csv")
    metrics = {
        "agent": plan.agent,
        "seed": plan.seed,
        "hal": plan.config.hal,
        "voided": sum(one.voided for one in outcomes),
        **summary([one.repetitions for one in outcomes]),
    }
    part = out / "metrics.json.part"
    part.write_text(json.dumps(metrics, indent=1) + "\n", encoding="utf-8")
    part.replace(out / "metrics.json")
    if outcomes:
        chosen = best(outcomes)
        about = {**chosen.table.about, "seed": plan.seed, "trial": chosen.trial}
        qtable.save(out / "qtable.json", StoredTable(chosen.table.values, about))
    return metrics
