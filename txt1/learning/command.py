"""`txt1 learn`: its words, its progress bar, and what it prints."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from txt1.command_line import DISARMED, count, natural, processors
from txt1.config import load
from txt1.errors import ConfigError, MissingExtra, NotArmed, Txt1Error
from txt1.kernel.loop import Speed
from txt1.learning import agents, experiment, plots
from txt1.learning.experiment import Plan
from txt1.learning.task import task_of
from txt1.learning.trial import Repetition


def add_command(
    commands: Any, add_config_arguments: Callable[[argparse.ArgumentParser], None], speed: Callable[[str], Speed]
) -> None:
    """Add the command `learn` to the parser's commands; the other two read what all commands have in common."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "learn", help="let the robot learn to find the light (thesis 5)",
        epilog="Ctrl-C keeps all that was learned; --resume carries on. What is learned, and how: learning in the "
        "configuration, e.g. --set learning.remedy=hold. A disarm ends it, as nobody is there to arm again: "
        "--resume --arm carries on. Exit codes as with run.",
    )  # fmt: skip
    parser.add_argument(
        "--agent", default="thesis", metavar="NAME", help=f"{' or '.join(agents.NAMES)}; thesis by default"
    )
    parser.add_argument("--trials", type=count, default=5, metavar="N", help="each from scratch; 5 by default")
    parser.add_argument("--reps", type=count, default=31, metavar="N", help="repetitions of each trial; 31 by default")
    parser.add_argument(
        "--seed", type=natural, default=0, metavar="N", help="repeats every random value of a simulation"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where tables, figures and pictures go")
    parser.add_argument("--resume", action="store_true", help="carry on what was begun in DIR")
    parser.add_argument(
        "--log", type=Path, metavar="FILE", help="record everything to this MCAP file; several trials to one each, "
        "FILE-trial-0001.mcap and so on",
    )  # fmt: skip
    parser.add_argument("--hal", metavar="NAME", help="hardware layer: sim, serial, or one from another package")
    parser.add_argument("--port", metavar="PORT", help="as with run")
    parser.add_argument(
        "--speed", type=speed, metavar="N|max",
        help="virtual time, N times as fast as real time or as fast as possible; max by default in simulation",
    )  # fmt: skip
    parser.add_argument("--jobs", type=count, metavar="N", help="processes; in simulation, by default one a processor")
    parser.add_argument("--arm", action="store_true", help="arm at the start; a simulation arms by itself")
    add_config_arguments(parser)
    parser.set_defaults(command=learn)


def learn(arguments: argparse.Namespace) -> int:
    """Do the trials and write what came of them; the exit code."""
    options: dict[str, Any] = {"seed": arguments.seed}
    options |= {} if arguments.hal is None else {"hal": arguments.hal}
    options |= {} if arguments.port is None else {"hal": arguments.hal or "serial", "serial.port": arguments.port}
    config = load(arguments.config, arguments.set, os.environ, options).config
    if arguments.port is not None and config.hal != "serial":
        raise ConfigError(f"--port {arguments.port}: only --hal serial has a port, not '{config.hal}'; leave one out")
    if arguments.agent not in agents.NAMES:
        raise ConfigError(f"--agent: there is no learner '{arguments.agent}', only {' and '.join(agents.NAMES)}")
    speed: Speed = arguments.speed
    if speed is None and config.hal == "sim":
        speed = "max"
    jobs = arguments.jobs or (processors() if speed == "max" else 1)
    plan = Plan(
        arguments.agent, arguments.trials, arguments.reps, arguments.seed, config, speed, jobs, arguments.arm,
        arguments.log,
    )  # fmt: skip

    console = Console(stderr=True)
    with _progress(console) as progress:
        bar = progress.add_task("", total=plan.trials * plan.repetitions, now="the robot gets ready")

        def watch(trial: int, one: Repetition) -> None:
            how = "reached the light" if one.success else "lost it"
            progress.update(bar, advance=1, now=f"trial {trial}, repetition {one.number}: {how} after {one.time:.1f} s")

        outcomes, ended = experiment.conduct(plan, arguments.out, arguments.resume, watch)
    if outcomes:
        _tell(experiment.write(plan, arguments.out, outcomes))
        if any(one.repetitions for one in outcomes):
            try:
                plots.draw(arguments.out, outcomes, experiment.best(outcomes), task_of(config))
            except MissingExtra as error:
                print(f"txt1: no pictures: {error}", file=sys.stderr)
    if ended is not None and (outcomes or not isinstance(ended, Txt1Error)):
        print(f"txt1: ended early; what was learned is in {arguments.out}, --resume carries on", file=sys.stderr)
    if isinstance(ended, NotArmed):
        print(f"txt1: the robot was stopped: {ended.reason}", file=sys.stderr)
        return DISARMED
    if isinstance(ended, Txt1Error):
        raise ended
    return 0 if ended is None else 128 + ended


def _progress(console: Console) -> Progress:
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[now]}"), TimeRemainingColumn())
    return Progress(*columns, console=console, disable=not console.is_terminal)


def _tell(metrics: dict[str, Any]) -> None:
    """Print the figures in a few lines."""
    for key, what in (("after_repetition_7", "after repetition 7"), ("last_10", "last 10 repetitions")):
        one = metrics.get(key, {})
        if one.get("repetitions"):
            print(
                f"{what:<20} mean {one['mean_time_s']:.2f} s, median {one['median_time_s']:.2f} s, success "
                f"{one['success']:.2%}; optimum {one['optimal_mean_time_s']:.2f} s, "
                f"regret {one['mean_regret_s']:.2f} s, ratio {one['ratio_to_optimum']:.3f}"
            )
    if "thesis_mean_time_s" in metrics:
        print(f"{'thesis':<20} mean {metrics['thesis_mean_time_s']} s after repetition 7")
    if "ratio_at_repetition" in metrics:
        print(f"{'ratio at repetition':<20} {json.dumps(metrics['ratio_at_repetition'])}")
