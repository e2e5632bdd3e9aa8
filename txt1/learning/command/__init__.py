"""`txt1 learn`: its progress, and what it prints."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from txt1.cli.options import ARM, ROBOT, loaded, robot_speed
from txt1.cli.workers import OPTIONS, workers_of
from txt1.commands import DISARMED, OK, add, busy, count, flag, path, say, signals_to, takes, unused
from txt1.config import Config
from txt1.errors import MissingExtra, NotArmed, Txt1Error
from txt1.learning import compare, experiment, plots, suite
from txt1.learning.agents import LEARNERS, make
from txt1.learning.best_time import floor_of, known_floor
from txt1.learning.command.trials import conduct
from txt1.learning.experiment import Plan
from txt1.learning.suite import Each
from txt1.learning.trial import Episode, starts, task_of
from txt1.record.options import LOG


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `learn` takes."""
    parser.epilog = (
        "Ctrl-C keeps all that was learned; --resume continues. Settings are under learning in the "
        "configuration, e.g. --set learning.thesis.remedy=hold. A disarm ends it, because nobody can arm again: "
        f"--resume --arm continues. Several trials are recorded to FILE-trial-0001.mcap and so on. {parser.epilog}"
    )
    add(parser, {
        "--agent": takes("NAME", f"{' or '.join(LEARNERS.names())}; thesis by default"),
        "--trials": takes("N", "number of trials, each from scratch; 5 by default", count, default=5),
        "--episodes": takes("N", "episodes of each trial; 31 by default", count, default=31),
        "--out": takes("DIR", "where tables and pictures go; out/learn when left out, or out/learn-2 and so on", path),
        "--resume": flag("continue the results in DIR"),
        "--no-pictures": flag("draw no pictures; in a sweep of many trials they would take most of the time"),
        "--worlds": takes("DIR", "learn in all worlds of DIR (config/worlds), and in four drawn by --seed", path),
        "--world": takes("NAMES", "only these of them, separated by commas"),
        "--compare": takes("FILE", "contenders in one world, per seconds driven: raw results in FILE.jsonl, carried on "
                           f"when it is there; those of --agent, or {', '.join(compare.ALL)}", path),
        "--floor": flag("only compute the floor: the best time from every start with full knowledge"),
    } | OPTIONS | LOG | ROBOT | ARM)  # fmt: skip


def main(arguments: argparse.Namespace) -> int:
    """Do the trials and write what came of them; the exit code."""
    config = loaded(arguments).config
    if arguments.floor:
        return _floor(config, arguments.trials, arguments.episodes)
    if arguments.compare:
        return _compare(arguments, config)
    if arguments.worlds:
        return _worlds(arguments, config)
    name = arguments.agent or "thesis"
    make(name, config, np.random.default_rng(0))  # refuses a wrong name or options before anything begins
    speed = robot_speed(arguments, config)
    plan = Plan(
        name, arguments.trials, arguments.episodes, config.seed, config, speed,
        bool(arguments.arm), arguments.log,
    )  # fmt: skip
    machines = workers_of(arguments, alone=speed != "max" and not arguments.jobs)

    out = arguments.out or (Path("out/learn") if arguments.resume else unused(Path("out/learn")))
    console = Console(stderr=True)
    columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[now]}"), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("", total=plan.trials * plan.episodes, now="the robot gets ready")

        def watch(trial: int, one: Episode) -> None:
            how = "reached the light" if one.success else "lost it"
            progress.update(bar, advance=1, now=f"trial {trial}, episode {one.number}: {how} after {one.time:.1f} s")

        results, ended = conduct(plan, out, arguments.resume, watch, machines)
    if results:
        _tell(experiment.write(plan, out, results))
        if any(one.episodes for one in results) and not arguments.no_pictures:
            try:
                plots.draw(out, results, experiment.best(results), task_of(config), known_floor(config))
            except MissingExtra as error:
                say(f"no pictures: {error}")
    if ended is not None and (results or not isinstance(ended, Txt1Error)):
        say(f"ended early; what was learned is in {out}, --out {out} --resume carries on")
    if isinstance(ended, NotArmed):
        say(f"the robot was stopped: {ended.reason}")
        return DISARMED
    if isinstance(ended, Txt1Error):
        raise ended
    return OK if ended is None else 128 + ended


def _tell(metrics: dict[str, Any]) -> None:
    """Print the figures in a few lines."""
    for key, what in (("after_episode_7", "after episode 7"), ("last_10", "last 10 episodes")):
        one = metrics.get(key, {})
        if not one.get("episodes"):
            continue
        if key == "last_10" and one["episodes"] < 10 * metrics.get("trials", 1):
            last = one["episodes"] // max(1, metrics.get("trials", 1))
            what = f"last {last} episodes" if last > 1 else "the one episode"
        print(f"{what:<20} success {one['success']:.2%}, {one['failures']} of {one['episodes']} failed", end="")
        if "mean_time_s" not in one:
            print()
            continue
        least = one["ratio_to_floor"]
        print(
            f"; the successes: mean {one['mean_time_s']:.2f} s, median {one['median_time_s']:.2f} s, optimum "
            f"{one['optimal_mean_time_s']:.2f} s, ratio {one['ratio_to_optimum']:.3f}, to the floor "
            f"{'not known (txt1 learn --floor)' if least is None else f'{least:.3f}'}"
        )
    if "thesis_mean_time_s" in metrics:
        print(f"{'thesis':<20} mean {metrics['thesis_mean_time_s']} s after episode 7")
    known = {episode: ratio for episode, ratio in metrics.get("ratio_at_episode", {}).items() if ratio is not None}
    if known:
        print(f"{'ratio at episode':<20} {', '.join(f'{episode}: {ratio:.3f}' for episode, ratio in known.items())}")


def _floor(config: Config, trials: int, episodes: int) -> int:
    """Print the floor beside the geometric optimum, for every start."""
    with busy("searching the best plan for each bearing of the light"):
        floor, task = floor_of(config), task_of(config)
    print("trial,episode,bearing_rad,heading_rad,optimal_time_s,floor_s")
    sums = np.zeros(4)
    for trial in range(1, trials + 1):
        for episode, start in enumerate(starts(config.seed, trial, episodes), 1):
            best, least = start.optimal_time(task), floor.time(start)
            print(f"{trial},{episode},{start.bearing:.6f},{start.heading:.6f},{best:.4f},{least:.1f}")
            sums += best, least, floor.exact(start), floor.way(start)
    best, least, exact, way = sums
    parts = (exact - way / task.speed, way / task.speed - best, least - exact)
    slow, longer, seldom = (f"{each / best:.2%}" for each in parts)
    say(
        f"floor {least / best:.4f} times the geometric optimum: {slow} of it are run-up and speed, {longer} a longer "
        f"way, {seldom} that the goal is looked for at decisions; a third piece of a plan still brought {floor.gap:.3%}"
        f"{'' if floor.exists else '; from some bearings the goal cannot be reached'}"
    )
    return OK


def _worlds(arguments: argparse.Namespace, config: Config) -> int:
    """Have learners learn in a suite of worlds; the exit code."""
    agents = (arguments.agent or "thesis").split(",")
    for name in agents:
        make(name, config, np.random.default_rng(0))
    names = arguments.world.split(",") if arguments.world else []
    some = suite.worlds(arguments.worlds, arguments.set or [], names)
    if not names:
        some += suite.drawn(config, config.seed)
    out = arguments.out or (Path("out/worlds") if arguments.resume else unused(Path("out/worlds")))

    def tell(result: dict[str, Any]) -> None:
        print(f"{result['agent']:<8} {result['world']:<20} {suite.cell(suite.figures(result))}", flush=True)

    lines = len(agents) * len(some)
    say(f"a line a learner and world, {lines} in all; Ctrl-C ends it, --out {out} --resume carries on")
    with _elsewhere(arguments) as (each, came):
        suite.run_all(
            some, agents, arguments.trials, arguments.episodes, config.seed, out, each, bool(arguments.resume), tell
        )
    say(f"the table is in {out / 'table.md'}, the raw results beside it")
    return 128 + came[0] if came else OK


def _compare(arguments: argparse.Namespace, config: Config) -> int:
    """Compare contenders; the exit code."""
    names = arguments.agent.split(",") if arguments.agent else compare.ALL
    file = arguments.compare.with_suffix(".jsonl")

    def tell(line: dict[str, Any]) -> None:
        print(f"{line['contender']:<10} trial {line['trial']:<4} {compare.told(line)}", flush=True)

    with _elsewhere(arguments) as (each, came):
        compare.compare(file, names, config, arguments.trials, arguments.episodes, config.seed, each, tell)
    print(file.with_suffix(".md").read_text(encoding="utf-8"))
    say(f"raw results in {file}, the table and a figure beside it")
    return 128 + came[0] if came else OK


@contextmanager
def _elsewhere(arguments: argparse.Namespace) -> Iterator[tuple[Each, list[int]]]:
    """Do work where it was asked for, until it is done or a signal has come, which then is in the list."""
    came: list[int] = []
    machines = workers_of(arguments)
    with signals_to(lambda number, _: came.append(number)):
        yield lambda work, texts: machines.each(work, texts, lambda: bool(came)), came
