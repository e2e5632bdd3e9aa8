"""`txt1 learn`: its options, its progress, and its report."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from txt1.commands import DISARMED, OK, add, count, flag, path, say, takes, unused
from txt1.errors import MissingExtra, NotArmed, Txt1Error
from txt1.installing import installs_plugin
from txt1.kit.options import ARM, ROBOT, loaded, robot_speed
from txt1.learning import experiment, plots
from txt1.learning.best_time import known_floor
from txt1.learning.command.trials import conduct
from txt1.learning.experiment import THESIS_MEAN, Plan
from txt1.learning.registry import LEARNERS, make
from txt1.learning.settings import refuse_unread
from txt1.learning.trial import Episode, task_of
from txt1.learning.world_presets import OWN, in_world
from txt1.record.options import LOG
from txt1.trials.run import progress
from txt1.trials.workers import OPTIONS, workers_of
from txt1.unknown import missing


def _moved(study: str) -> dict[str, Any]:
    """Return argparse's settings for an option that is refused because a study has replaced it."""

    def refuse(word: str) -> None:
        raise argparse.ArgumentTypeError(f"is in the plug-in txt1-learners: python -m txt1_learners.studies {study}")

    return takes("", argparse.SUPPRESS, refuse, nargs="?", const="")


def _agents() -> str:
    """Return the help of `--agent`: the installed learners, and the command that installs the others."""
    absent = missing(LEARNERS.group, LEARNERS.names())
    more = dict.fromkeys(map(installs_plugin, absent.values()))
    others = f"; {', '.join(absent)} after {' and '.join(more)}" if absent else ""
    return f"{' or '.join(LEARNERS.names())}; thesis by default{others}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `learn`."""
    parser.epilog = (
        "Ctrl-C keeps all that was learned; --resume continues. Settings are under learning in the "
        "configuration, e.g. --set learning.thesis.remedy=hold. A disarm ends it, because nobody can arm again: "
        f"--resume --arm continues. Several trials are recorded to FILE-trial-0001.mcap and so on. {parser.epilog}"
    )
    add(
        parser,
        {
            "--agent": takes("NAME", _agents()),
            "--trials": takes("N", "number of trials, each from scratch; 5 by default", count, default=5),
            "--episodes": takes("N", "episodes of each trial; 31 by default", count, default=31),
            "--out": takes(
                "DIR", "where tables and pictures go; out/learn when left out, or out/learn-2 and so on", path
            ),
            "--resume": flag("continue the results in DIR"),
            "--no-pictures": flag("draw no pictures; in a sweep of many trials they would take most of the time"),
            "--worlds": _moved("worlds DIR"),
            "--world": takes(
                "NAME",
                "a world by its name (txt1 world list), or a .yaml; thesis learns in thesis-simulation by default",
            ),
            "--compare": _moved("compare FILE"),
            "--floor": _moved("floor"),
        }
        | OPTIONS
        | LOG
        | ROBOT
        | ARM,
    )


def main(arguments: argparse.Namespace) -> int:
    """Do the trials and write their results; return the exit code."""
    name = arguments.agent or "thesis"
    refuse_unread(arguments.set, name)
    world = _world(arguments, name)
    config = loaded(in_world(arguments, world)).config
    # refuses a wrong name or options at once
    make(name, config, np.random.default_rng(0))
    speed = robot_speed(arguments, config)
    plan = Plan(
        name,
        arguments.trials,
        arguments.episodes,
        config.seed,
        config,
        speed,
        bool(arguments.arm),
        arguments.log,
    )
    machines = workers_of(arguments, alone=speed != "max" and not arguments.jobs)

    if world is not None:
        say(f"in the world {world}")
    out = arguments.out or (Path("out/learn") if arguments.resume else unused(Path("out/learn")))
    with progress("the robot gets ready", plan.trials * plan.episodes) as bar:

        def watch(trial: int, one: Episode) -> None:
            how = "reached the light" if one.success else "lost it"
            now = f"trial {trial}, episode {one.number}: {how} after {one.time:.1f} s"
            bar.update(bar.task_ids[0], advance=1, description=now)

        results, ended = conduct(plan, out, arguments.resume, watch, machines)
    if results:
        _tell(experiment.write(plan, out, results), beside_thesis=name == "thesis" and world == OWN[name])
        # after a signal they would take longer than anybody waits
        if any(one.episodes for one in results) and not arguments.no_pictures and not isinstance(ended, int):
            try:
                plots.draw(out, results, experiment.best(results), task_of(config), known_floor(config))
            except MissingExtra as error:
                say(f"no pictures: {error}")
    if ended is not None and (results or not isinstance(ended, Txt1Error)):
        say(f"ended early; what was learned is in {out}, --out {out} --resume carries on and draws it")
    if isinstance(ended, NotArmed):
        say(f"the robot was stopped: {ended.reason}")
        return DISARMED
    if isinstance(ended, Txt1Error):
        raise ended
    return OK if ended is None else 128 + ended


def _world(arguments: argparse.Namespace, learner: str) -> str | None:
    """Return the name of the world, None without one; default worlds are for simulations only."""
    name: str | None = arguments.world
    simulated = arguments.hal in (None, "sim") and arguments.port is None
    return OWN.get(learner) if name is None and arguments.config is None and simulated else name


def _tell(metrics: dict[str, Any], *, beside_thesis: bool) -> None:
    """Print the figures in a few lines; the thesis has a figure for its simulation alone."""
    last = metrics["last_10"]["episodes"] // metrics["trials"]
    names = "after episode 7", f"last {last} episodes" if last > 1 else "the one episode"
    for what, one in zip(names, (metrics["after_episode_7"], metrics["last_10"]), strict=True):
        if not one["episodes"]:
            continue
        print(f"{what:<20} success {one['success']:.2%}, {one['failures']} of {one['episodes']} failed", end="")
        if "mean_time_s" not in one:
            print()
            continue
        least = one["ratio_to_floor"]
        print(
            f"; the successes: mean {one['mean_time_s']:.2f} s, median {one['median_time_s']:.2f} s, optimum "
            f"{one['optimal_mean_time_s']:.2f} s, ratio {one['ratio_to_optimum']:.3f}, to the floor "
            f"{'not known (python -m txt1_learners.studies floor)' if least is None else f'{least:.3f}'}"
        )
    if beside_thesis:
        if (of_all := metrics["after_episode_7"].get("mean_time_of_all_s")) is not None:
            print(f"{'all after episode 7':<20} mean {of_all:.2f} s, failures with their time")
        print(
            f"{'the thesis reports':<20} mean {THESIS_MEAN} s, of all after episode 7, in this simulation (fig. 5.10)"
        )
    known = [f"{episode}: {ratio:.3f}" for episode, ratio in metrics["ratio_at_episode"].items() if ratio is not None]
    if known:
        print(f"{'ratio at episode':<20} {', '.join(known)}")
