"""`txt1 experiment`: drives a test of the thesis and measures it, or compares runs."""

import argparse
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.progress import TaskProgressColumn, TimeElapsedColumn

from txt1.commands import DISARMED, FAULT, OK, add, count, flag, path, say, takes, unused
from txt1.config import Config
from txt1.errors import ConfigError
from txt1.experiments import figures, metrics, report, run_folder
from txt1.experiments.profile import EXAMPLE, Profile, load_profile, names
from txt1.experiments.recording import mean_of
from txt1.experiments.run_folder import FIGURE, Run
from txt1.experiments.runner import ANOTHER, Experiment, Outcome, outcome_of
from txt1.kernel.loop import Speed
from txt1.kit.app import App, get_ready
from txt1.kit.options import ARM, ROBOT, loaded, robot_speed
from txt1.record.options import LOG, to_file
from txt1.trials.run import progress, run
from txt1.trials.workers import OPTIONS, Workers, workers_of

# the thesis's hall is larger than its learning room
ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiment`."""
    kinds = f"{', '.join(names())}; a file of your own, {EXAMPLE}; or compare, with the folders of two to four runs"
    add(
        parser,
        {
            "what": takes("NAME|FILE.yaml|compare", kinds),
            "runs": takes("FOLDER", "folders of the runs to compare", path, nargs="*"),
            "--out": takes("DIR", "folder for the results; by default out/NAME, then out/NAME-2 and so on", path),
            "--label": takes("TEXT", "names the run in figures and tables"),
            "--repeats": takes(
                "N", "number of runs, simulated with consecutive seeds; their mean is reported", count, default=1
            ),
            "--no-safe-end": flag("continue to drive when the batteries' safe time is over"),
            "--no-figure": flag("draw nothing; needs no matplotlib"),
            "--json": flag("print the metrics as one JSON object"),
        }
        | OPTIONS
        | ROBOT
        | ARM
        | LOG,
    )


def configure(arguments: argparse.Namespace) -> tuple[Config, Speed]:
    """Return the robot's configuration, without walls unless they are set, and the speed of its time."""
    config = loaded(arguments)
    if not any(key.startswith("sim.room") for key in config.origins):
        config = loaded(arguments, ENDLESS)
    return config.config, robot_speed(arguments, config.config)


def main(arguments: argparse.Namespace) -> int:
    """Drive an experiment, or compare runs; return the exit code."""
    if arguments.what == "compare":
        return _compare(arguments)
    if arguments.runs:
        raise ConfigError(f"{arguments.runs[0]}: only 'compare' takes folders; --out says where the results go")
    profile = load_profile(arguments.what)
    if not arguments.no_figure:
        # reported before the robot has driven for 46 minutes
        figures.available()
    config, speed = configure(arguments)
    name = Path(arguments.what).stem
    folder = run_folder.make(arguments.out or unused(Path("out") / name))
    say(f"driving {name}; Ctrl-C stops it and keeps the measurements")
    safe_end, machines = not arguments.no_safe_end, workers_of(arguments, alone=config.hal != "sim" or speed != "max")
    if arguments.repeats > 1 or machines.cluster is not None:
        if arguments.log is not None:
            raise ConfigError("--log: records one run in this process; leave out --repeats and --dask")
        seeds = range(config.seed, config.seed + arguments.repeats)
        outcomes, code = drive_all(
            config, profile, speed, seeds, machines, safe_end=safe_end, arm=arguments.arm, bar=name
        )
    else:
        outcome, code = drive(config, profile, speed, safe_end=safe_end, arm=arguments.arm, log=arguments.log, bar=name)
        outcomes = [] if outcome is None else [outcome]
    if not outcomes or not all(len(each.recording) for each in outcomes):
        say("it was over before anything was measured")
        return code or FAULT
    label = arguments.label or ("sim" if config.hal == "sim" else f"{config.hal} {config.serial.port or ''}".strip())
    result = repeated(label, profile, outcomes)
    run_folder.write(result, folder)
    # from an earlier run
    (folder / FIGURE).unlink(missing_ok=True)
    if not arguments.no_figure:
        figures.draw([result], folder / FIGURE)
    if arguments.json:
        print(json.dumps(result.metrics))
    else:
        report.show([result], Console())
        drawn = [] if arguments.no_figure else [FIGURE]
        print(f"{folder}: {', '.join([*run_folder.FILES, *drawn])}")
    return code


def _compare(arguments: argparse.Namespace) -> int:
    if not 2 <= len(arguments.runs) <= len(figures.COLOURS):
        raise ConfigError(f"compare: takes the folders of two to four runs, not of {len(arguments.runs)}")
    runs = run_folder.alike([run_folder.read(folder) for folder in arguments.runs])
    kinds = sorted({result.profile.figure for result in runs})
    if len(kinds) > 1:
        raise ConfigError(f"compare: the runs are of different kinds, {' and '.join(kinds)}; take runs of one kind")
    if len({result.label for result in runs}) < len(runs):
        runs = [result._replace(label=str(folder)) for result, folder in zip(runs, arguments.runs, strict=True)]
    if not arguments.no_figure:
        folder = run_folder.make(arguments.out or unused(Path("out") / "compare"))
        figures.draw(runs, folder / FIGURE)
    if arguments.json:
        print(json.dumps({result.label: result.metrics for result in runs}))
    else:
        report.show(runs, Console(), with_differences=True)
        if not arguments.no_figure:
            print(folder / FIGURE)
    return OK


def drive(
    config: Config,
    profile: Profile,
    speed: Speed,
    *,
    safe_end: bool = True,
    arm: bool | None = None,
    log: Path | None = None,
    bar: str = "",
) -> tuple[Outcome | None, int]:
    """Drive an experiment; return its outcome, None if nothing was measured, and the exit code.

    A signal ends it; the measurements are kept. `safe_end`: it ends by itself when no time is left on its batteries.
    `arm` None leaves arming to ``safety.auto_arm``. `bar` names a progress bar on a terminal; none when empty.
    """
    app = App(speed)
    experiment: Experiment | None = None

    async def work() -> None:
        nonlocal experiment
        async with app.robot(config, additions=to_file(log, {"experiment": profile.title}, speed)) as robot:
            await get_ready(robot, arm)
            experiment = Experiment(robot, profile, safe_end=safe_end, progressed=partial(setattr, task, "completed"))
            await experiment.run()

    with progress(bar, 1.0, TaskProgressColumn(), TimeElapsedColumn()) as shown:
        # a task writes it, so the robot does not wait for a lock
        (task,) = shown.tasks
        code = app.run(work())
    if experiment is None:
        return None, code
    outcome = experiment.outcome()
    if code == OK and outcome.stopped_by.startswith(("the safety gate", ANOTHER)):
        say(f"the robot was stopped by {outcome.stopped_by}")
        code = FAULT if outcome.stopped_by.startswith(ANOTHER) else DISARMED
    return outcome, code


def drive_all(
    config: Config,
    profile: Profile,
    speed: Speed,
    seeds: Sequence[int],
    machines: Workers,
    *,
    safe_end: bool = True,
    arm: bool | None = None,
    bar: str = "",
) -> tuple[list[Outcome], int]:
    """Drive an experiment with each of these seeds; return the outcomes up to the first bad exit code, and the
    exit code.

    Outcomes are in the order of the seeds. A signal ends it.
    """
    done: dict[int, tuple[Outcome | None, int]] = {}
    if machines.many:
        given = profile.model_dump(mode="json"), config.model_dump(mode="json"), safe_end, arm
        told = {seed: [*given, seed] for seed in seeds}
        code = run(driven, told, machines, lambda seed, outcome: done.update({seed: outcome}), bar=bar)
        if code != OK:
            return [], code
        done = {seed: (None if told is None else outcome_of(told), code) for seed, (told, code) in done.items()}
    else:
        for number, seed in enumerate(seeds, 1):
            seeded, name = config.model_copy(update={"seed": seed}), f"{bar}, {number} of {len(seeds)}"
            done[seed] = drive(seeded, profile, speed, safe_end=safe_end, arm=arm, bar=name)
            if done[seed][1] != OK:
                break
    outcomes = []
    for outcome, code in (done[seed] for seed in seeds if seed in done):
        if outcome is not None:
            outcomes.append(outcome)
        if code != OK:
            return outcomes, code
    return outcomes, OK


def driven(told: Sequence[Any]) -> list[Any]:
    """Drive an experiment in simulation as fast as possible; return its outcome and exit code. JSON values both."""
    profile, config, safe_end, arm, seed = told
    seeded = Config.model_validate(config).model_copy(update={"seed": seed})
    outcome, code = drive(seeded, Profile.model_validate(profile), "max", safe_end=safe_end, arm=arm)
    return [None if outcome is None else outcome.json(), code]


def repeated(label: str, profile: Profile, outcomes: Sequence[Outcome]) -> Run:
    """Return several runs of a profile as a single run: their mean, and the statistics of its steps."""
    if len(outcomes) == 1:
        return Run(label, profile, outcomes[0].recording, metrics.measure(outcomes[0], profile))
    recordings = [outcome.recording for outcome in outcomes]
    mean = outcomes[0]._replace(recording=mean_of(recordings))
    steps = [step._asdict() for step in metrics.repeated_steps(recordings)]
    return Run(label, profile, mean.recording, metrics.measure(mean, profile) | {"steps": steps})
