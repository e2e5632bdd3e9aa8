"""Studies of the learners: `python -m txt1_learners.studies worlds|compare|thesis|obstacles|floor`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from txt1 import cli
from txt1.commands import OK, add_actions, busy, count, flag, names, path, say, takes, unused
from txt1.kit.options import CONFIGURATION, SEED, VEHICLE, loaded
from txt1.learning.registry import LEARNERS, make
from txt1.learning.trial import starts, task_of
from txt1.learning.world_presets import in_world
from txt1.trials.run import run
from txt1.trials.workers import OPTIONS, workers_of
from txt1_learners.studies import compare, contenders, suite, thesis
from txt1_learners.studies import obstacles as among
from txt1_learners.studies.contenders import ALL
from txt1_learners.studies.floor import floor_of
from txt1_learners.studies.suite import Each

TRIALS = {
    "--trials": takes("N", "number of trials, each from scratch; 5 by default", count, default=5),
    "--episodes": takes("N", "episodes of each trial; 31 by default", count, default=31),
}
CAR = CONFIGURATION | SEED | VEHICLE


def main(words: Sequence[str]) -> int:
    """Do a study; the exit code, as of `txt1`."""
    parser = cli.Parser(prog="python -m txt1_learners.studies", description=__doc__, epilog=cli.EPILOG)
    add_actions(parser, ACTIONS)

    def perform() -> int:
        arguments = parser.parse_args(words)
        return int(arguments.main(arguments))

    return cli.told(perform)


def floor(arguments: argparse.Namespace) -> int:
    """Compute the best time from every start with full knowledge, beside the geometric optimum."""
    config = loaded(arguments).config
    with busy("searching the best plan for each bearing of the light"):
        least_of, task = floor_of(config), task_of(config)
    print("trial,episode,bearing_rad,heading_rad,optimal_time_s,floor_s")
    sums = np.zeros(4)
    for trial in range(1, arguments.trials + 1):
        for episode, start in enumerate(starts(config.seed, trial, arguments.episodes), 1):
            best, least = start.optimal_time(task), least_of.time(start)
            print(f"{trial},{episode},{start.bearing:.6f},{start.heading:.6f},{best:.4f},{least:.1f}")
            sums += best, least, least_of.exact(start), least_of.way(start)
    best, least, exact, way = sums
    parts = (exact - way / task.speed, way / task.speed - best, least - exact)
    slow, longer, seldom = (f"{each / best:.2%}" for each in parts)
    say(
        f"floor {least / best:.4f} times the geometric optimum: {slow} of it are run-up and speed, {longer} a longer "
        f"way, {seldom} that the goal is looked for at decisions; a third piece of a plan still brought "
        f"{least_of.gap:.3%}{'' if least_of.exists else '; from some bearings the goal cannot be reached'}"
    )
    return OK


def worlds(arguments: argparse.Namespace) -> int:
    """Have learners learn in a suite of worlds, and make a table learner x world."""
    config = loaded(argparse.Namespace(**vars(arguments), config=None)).config
    for name in arguments.agent:
        make(name, config, np.random.default_rng(0))  # refuses a wrong name or options before anything begins
    some = suite.worlds(arguments.worlds, arguments.set, arguments.world)
    if not arguments.world:
        some += suite.drawn(config, config.seed)
    out = arguments.out or (Path("out/worlds") if arguments.resume else unused(Path("out/worlds")))

    def tell(result: dict[str, Any]) -> None:
        print(f"{result['agent']:<8} {result['world']:<20} {suite.cell(suite.figures(result))}", flush=True)

    lines = len(arguments.agent) * len(some)
    say(f"a line a learner and world, {lines} in all; Ctrl-C ends it, --out {out} --resume carries on")
    _, code = suite.run_all(
        some,
        arguments.agent,
        arguments.trials,
        arguments.episodes,
        config.seed,
        out,
        _each(arguments),
        arguments.resume,
        tell,
    )
    say(f"the table is in {out / 'table.md'}, the raw results beside it")
    return code


def comparison(arguments: argparse.Namespace) -> int:
    """Compare contenders in one world, per seconds driven."""
    config, file = loaded(in_world(arguments, arguments.world)).config, arguments.file.with_suffix(".jsonl")

    def tell(line: dict[str, Any]) -> None:
        print(f"{line['contender']:<10} trial {line['trial']:<4} {contenders.told(line)}", flush=True)

    _, code = compare.compare(
        file, arguments.agent, config, arguments.trials, arguments.episodes, config.seed, _each(arguments), tell
    )
    print(file.with_suffix(".md").read_text(encoding="utf-8"))
    say(f"raw results in {file}, the table and a figure beside it")
    return code


def readings(arguments: argparse.Namespace) -> int:
    """Do the thesis's simulation by each reading of its text, beside the 7.165 s that it reports."""
    file, seed = arguments.file.with_suffix(".jsonl"), 0 if arguments.seed is None else arguments.seed
    code = thesis.study(file, arguments.trials, seed, _each(arguments), say)
    print(file.with_suffix(".md").read_text(encoding="utf-8"))
    return code


def obstacles(arguments: argparse.Namespace) -> int:
    """Have the pilot learn among posts and boxes, beside a planner that knows the map."""
    config, file = loaded(arguments).config, arguments.file.with_suffix(".jsonl")
    code = among.study(
        file,
        config,
        arguments.worlds,
        arguments.episodes,
        config.seed,
        _each(arguments),
        lambda text: print(text, flush=True),
    )
    print(file.with_suffix(".md").read_text(encoding="utf-8"))
    return code


def _each(arguments: argparse.Namespace) -> Each:
    """Return the runner of trials, where they were asked to be done."""
    return lambda work, trials, keep: run(work, trials, workers_of(arguments), keep)


ACTIONS = {
    "worlds": (
        worlds,
        {
            "worlds": takes(
                "WORLDS", "usual, hostile, or a folder with a .yaml a world; four more are drawn by --seed", str
            ),
            "--world": takes("NAMES", "only these of them, separated by commas; none is drawn then", names, default=[]),
            "--agent": takes(
                "NAMES", f"of {', '.join(LEARNERS.names())}; thesis by default", names, default=["thesis"]
            ),
            "--out": takes("DIR", "where results go; out/worlds when left out, or out/worlds-2 and so on", path),
            "--resume": flag("continue the results in DIR"),
            "--set": CONFIGURATION["--set"],
        }
        | TRIALS
        | OPTIONS
        | SEED,
    ),
    "compare": (
        comparison,
        {
            "file": takes("FILE", "raw results in FILE.jsonl, carried on when it is there; a table and a figure", path),
            "--agent": takes("NAMES", f"of {', '.join(ALL)}; all by default", names, default=list(ALL)),
            "--world": takes("NAME", "a world by its name (txt1 world list), or a .yaml"),
        }
        | TRIALS
        | OPTIONS
        | CAR,
    ),
    "thesis": (
        readings,
        {
            "file": takes("FILE", "raw results in FILE.jsonl, carried on when it is there; and a table", path),
            "--trials": takes("N", "trials of each reading; 100 by default", count, default=100),
        }
        | OPTIONS
        | SEED,
    ),
    "obstacles": (
        obstacles,
        {
            "file": takes(
                "FILE", "raw results in FILE.jsonl, carried on when it is there; and what they come to", path
            ),
            "--worlds": takes("N", "number of worlds, which the seed draws; 323 by default", count, default=323),
            "--episodes": TRIALS["--episodes"],
        }
        | OPTIONS
        | CAR,
    ),
    "floor": (floor, TRIALS | CAR),
}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
