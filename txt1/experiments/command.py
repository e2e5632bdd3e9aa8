"""`txt1 experiment` and `txt1 tune`: the words, the runs, and what is printed."""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from txt1.board import VIRTUAL
from txt1.command_line import DISARMED, FAULT, OK, SIGNALS, count
from txt1.config import Config, load
from txt1.config.schema import ControlConfig, GainsConfig, GainSetConfig
from txt1.errors import CommandRefused, ConfigError, NotArmed
from txt1.experiments import figures, metrics, report, run_folder
from txt1.experiments.identify import identify, require_pwm_and_ticks, try_out
from txt1.experiments.plant import Plant
from txt1.experiments.profile import Profile, load_profile, names
from txt1.experiments.recording import mean_of
from txt1.experiments.run_folder import FIGURE, Run
from txt1.experiments.runner import END_OF_PROFILE, INTERRUPTED, Experiment, Outcome, ready
from txt1.experiments.tune import propose
from txt1.kernel.loop import Speed, run
from txt1.record.session import recording
from txt1.robot import Robot

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
"""The thesis's hall is larger than its learning room: without a word about the room there are no walls."""

BAR_PERIOD: Final = 0.25
"""s between two looks of the progress bar."""


class Driven(NamedTuple):
    """A run of an experiment that has ended.

    Attributes:
        outcome: what was measured; None when nothing was.
        code: exit code.

    """

    outcome: Outcome | None
    code: int


# -- the words -------------------------------------------------------------------------------------------------

AddArguments = Callable[[argparse.ArgumentParser], None]


def add_commands(
    commands: argparse._SubParsersAction[Any], add_config_arguments: AddArguments, speed: Callable[[str], Speed]
) -> None:
    """Add `experiment` and `tune` to the command line."""
    experiment = commands.add_parser(
        "experiment", help="drive one of the thesis's tests, or your own, and measure it; or compare two runs"
    )
    experiment.add_argument(
        "what", metavar="NAME|FILE.yaml|compare",
        help=f"{', '.join(names())}; a profile of your own; or compare, with the folders of two runs",
    )  # fmt: skip
    experiment.add_argument("runs", nargs="*", type=Path, metavar="FOLDER", help="of the runs to compare")
    _add_robot_arguments(experiment, add_config_arguments, speed)
    experiment.add_argument("--out", type=Path, metavar="DIR", help="of the results; out/NAME when left out")
    experiment.add_argument("--log", type=Path, metavar="FILE", help="record everything to this MCAP file, too")
    experiment.add_argument("--label", metavar="TEXT", help="names the run in figures and tables")
    experiment.add_argument("--no-safe-end", action="store_true", help="drive on when the batteries' time is over")
    experiment.add_argument("--no-figure", action="store_true", help="draw nothing; needs no matplotlib")
    experiment.add_argument("--json", action="store_true", help="print the metrics as one JSON object")
    experiment.set_defaults(command=experiment_command)

    tune_parser = commands.add_parser(
        "tune", help="identify the vehicle from a short drive, propose gains, and try them on the drive tests"
    )
    _add_robot_arguments(tune_parser, add_config_arguments, speed)
    tune_parser.add_argument("--out", type=Path, metavar="DIR", help="write tables and figures of old and new there")
    tune_parser.add_argument("--write", type=Path, metavar="FILE", help="write the gains to this YAML file")
    tune_parser.add_argument(
        "--no-trial", action="store_true", help="propose only; do not drive the tests with old and new gains"
    )
    tune_parser.add_argument(
        "--repeats", type=count, default=10, metavar="N", help="runs of a test whose mean is judged"
    )
    tune_parser.set_defaults(command=tune_command)


def _add_robot_arguments(
    parser: argparse.ArgumentParser, add_config_arguments: AddArguments, speed: Callable[[str], Speed]
) -> None:
    add_config_arguments(parser)
    parser.add_argument("--hal", metavar="NAME", help="hardware layer: sim, serial, or one from another package")
    parser.add_argument("--port", metavar="PORT", help="where the board is (--hal serial), as with run")
    parser.add_argument("--baud", type=int, metavar="N", help="bits a second of the line, 57600 by default")
    parser.add_argument("--seed", type=int, metavar="N", help="repeats every random value of a simulation")
    parser.add_argument(
        "--speed", type=speed, metavar="N|max",
        help="virtual time, N times as fast as real time; a simulation runs as fast as possible when left out",
    )  # fmt: skip
    parser.add_argument(
        "--arm", action="store_true", default=None, help="arm at the start; a simulation arms by itself"
    )


def configure(arguments: argparse.Namespace) -> tuple[Config, Speed]:
    """The configuration of the robot that the words ask for, and the speed of its time."""
    options = {name: value for name in ("hal", "seed") if (value := getattr(arguments, name)) is not None}
    options |= {f"serial.{name}": value for name in ("port", "baud") if (value := getattr(arguments, name)) is not None}
    loaded = load(arguments.config, arguments.set, os.environ, options)
    if not any(key.startswith("sim.room") for key in loaded.origins):
        loaded = load(arguments.config, [*ENDLESS, *arguments.set], os.environ, options)
    config = loaded.config
    simulated = config.hal == "sim" or (config.hal == "serial" and config.serial.port == VIRTUAL)
    speed: Speed = "max" if simulated and arguments.speed is None else arguments.speed
    return config, speed


# -- txt1 experiment -------------------------------------------------------------------------------------------


def experiment_command(arguments: argparse.Namespace) -> int:
    """Drive an experiment, or compare two runs; the exit code."""
    if arguments.what == "compare":
        return _compare(arguments)
    if arguments.runs:
        raise ConfigError(f"{arguments.runs[0]}: only 'compare' takes folders; --out says where the results go")
    profile = load_profile(arguments.what)
    if not arguments.no_figure:
        figures.available()  # said before the robot has driven for 46 minutes
    config, speed = configure(arguments)
    name = Path(arguments.what).stem
    folder = run_folder.make(arguments.out or Path("out") / name)
    _say(f"driving {name}; Ctrl-C stops it and keeps what was measured")
    driven = drive(
        config, profile, speed, safe_end=not arguments.no_safe_end, arm=arguments.arm, log=arguments.log, bar=name
    )
    if driven.outcome is None or not len(driven.outcome.recording):
        _say("it was over before anything was measured")
        return driven.code or FAULT
    label = arguments.label or _label(config)
    result = Run(label, profile, driven.outcome.recording, metrics.measure(driven.outcome, profile))
    run_folder.write(result, folder)
    if not arguments.no_figure:
        figures.draw([result], folder / FIGURE)
    if arguments.json:
        print(json.dumps(result.metrics))
    else:
        report.show([result], Console())
        drawn = [] if arguments.no_figure else [FIGURE]
        print(f"{folder}: {', '.join([*run_folder.FILES, *drawn])}")
    return driven.code


def _compare(arguments: argparse.Namespace) -> int:
    if len(arguments.runs) != 2:
        raise ConfigError(f"compare: takes the folders of two runs, not {len(arguments.runs)}")
    runs = run_folder.alike([run_folder.read(folder) for folder in arguments.runs])
    kinds = [result.profile.figure for result in runs]
    if kinds[0] != kinds[1]:
        raise ConfigError(f"compare: the runs are of different kinds, {kinds[0]} and {kinds[1]}; take two of one kind")
    if runs[0].label == runs[1].label:
        runs = [result._replace(label=str(folder)) for result, folder in zip(runs, arguments.runs, strict=True)]
    if not arguments.no_figure:
        folder = run_folder.make(arguments.out or Path("out") / "compare")
        figures.draw(runs, folder / FIGURE)
    if arguments.json:
        print(json.dumps({result.label: result.metrics for result in runs}))
    else:
        report.show(runs, Console(), with_differences=True)
        if not arguments.no_figure:
            print(folder / FIGURE)
    return OK


def _label(config: Config) -> str:
    return "sim" if config.hal == "sim" else f"{config.hal} {config.serial.port or ''}".strip()


# -- txt1 tune -------------------------------------------------------------------------------------------------

TESTS: Final = ("linear-steps", "angular-steps")
"""The drive tests on which gains are compared."""


def tune_command(arguments: argparse.Namespace) -> int:
    """Identify the vehicle, propose gains, compare them with the old ones; the exit code."""
    config, speed = configure(arguments)
    if arguments.out is not None:
        figures.available()
        run_folder.make(arguments.out)
    if arguments.write is not None:
        run_folder.make(arguments.write.parent)
    _say("trying out the vehicle, for a minute of its time")
    plant: Plant | None = None

    async def try_it() -> None:
        nonlocal plant
        async with Robot.open(config=config, arm=arguments.arm) as robot:
            require_pwm_and_ticks(robot.hal)
            await ready(robot)
            plant = identify(await try_out(robot))

    code = _until_signal(try_it(), speed)
    if plant is None:
        return code
    print(
        f"speed: {1000.0 * plant.speed_gain:.4f} mm/s per count beyond a dead band of {plant.dead_band:.0f} counts, "
        f"lag {plant.time_constant:.3f} s\n"
        f"steering: {1e6 * plant.steering_gain:.1f} mrad/m per 1000 counts, lag {plant.steering_lag:.3f} s"
    )
    _say("trying gains on its model")
    old = config.control
    proposal = propose(plant, config.geometry, old.linear.gains(), old.schedule(), config.safety.motor_max)
    new = ControlConfig(
        linear=GainsConfig(**proposal.linear._asdict()),
        angular=tuple(GainSetConfig(v_max=each.v_max, **each.gains._asdict()) for each in proposal.angular),
    )
    text = gains_file(new)
    print(text)
    if not arguments.no_trial:
        for test in TESTS:
            runs = []
            for label, control in (("old gains", old), ("new gains", new)):
                driven = _repeated(config.model_copy(update={"control": control}), test, speed, label, arguments)
                if isinstance(driven, int):
                    return driven
                runs.append(driven)
            report.show(runs, Console())
            if arguments.out is not None:
                for result in runs:
                    run_folder.write(result, arguments.out / f"{test}-{result.label.split()[0]}")
                figures.draw(runs, arguments.out / f"{test}.svg")
                figures.draw_steps(runs, arguments.out / f"{test}-steps.svg")
    if arguments.write is not None:
        arguments.write.write_text(text)
        print(f"{arguments.write}: written; use it with --config")
    return OK


def _repeated(config: Config, test: str, speed: Speed, label: str, arguments: argparse.Namespace) -> Run | int:
    """Several runs of a test as one, their seeds differing as what the floor does differs; an exit code: interrupted.

    Raises:
        CommandRefused: a run ended early.

    """
    profile = load_profile(test)
    outcomes = []
    for number in range(arguments.repeats):
        seeded = config.model_copy(update={"seed": config.seed + number})
        bar = f"{test}, {label}, {number + 1} of {arguments.repeats}"
        driven = drive(seeded, profile, speed, arm=arguments.arm, bar=bar)
        if driven.outcome is None or driven.outcome.stopped_by == INTERRUPTED:
            return driven.code
        if driven.outcome.stopped_by != END_OF_PROFILE:
            raise CommandRefused(
                f"{test} with {label} was ended by {driven.outcome.stopped_by}, so there is nothing to compare; "
                "--no-trial leaves these drives out"
            )
        outcomes.append(driven.outcome)
    return repeated(label, profile, outcomes)


def repeated(label: str, profile: Profile, outcomes: Sequence[Outcome]) -> Run:
    """Several runs of a profile as one: their mean, and what its steps look like."""
    recordings = [outcome.recording for outcome in outcomes]
    mean = outcomes[0]._replace(recording=mean_of(recordings))
    steps = [step._asdict() for step in metrics.repeated_steps(recordings)]
    return Run(label, profile, mean.recording, metrics.measure(mean, profile) | {"steps": steps})


def gains_file(control: ControlConfig) -> str:
    """Gains as a configuration file."""
    linear, sets = control.linear, control.angular
    lines = [
        "control:",
        f"  linear: {{kp: {linear.kp:g}, ki: {linear.ki:g}, kd: {linear.kd:g}}}",
        "  angular:",
        *(f"    - {{v_max: {s.v_max:g}, kp: {s.kp:g}, ki: {s.ki:g}, kd: {s.kd:g}}}" for s in sets),
    ]
    return "\n".join(lines) + "\n"


# -- driving ---------------------------------------------------------------------------------------------------


def drive(
    config: Config,
    profile: Profile,
    speed: Speed,
    *,
    safe_end: bool = True,
    arm: bool | None = None,
    log: Path | None = None,
    bar: str = "",
) -> Driven:
    """What came of an experiment; a signal ends it and keeps what was measured.

    Args:
        config: of the robot.
        profile: what to drive.
        speed: of its time (see `txt1.kernel.loop.run`).
        safe_end: whether it stops by itself when no time is left on its batteries.
        arm: whether to arm; None leaves it to ``safety.auto_arm``.
        log: the file to record to.
        bar: name for a progress bar on a terminal; none when empty.

    """
    experiment: Experiment | None = None

    async def main() -> None:
        nonlocal experiment
        told: dict[str, object] = {"experiment": profile.title}
        async with (
            recording(log, config, speed, told, _say) as attach,
            Robot.open(config=config, arm=arm, attach=attach) as robot,
        ):
            if not robot.armed:
                raise NotArmed(f"{robot.reason or 'not armed yet'}; on the command line --arm does it")
            await ready(robot)
            experiment = Experiment(robot, profile, safe_end=safe_end)
            with _progress_bar(experiment, bar):
                await experiment.run()

    code = _until_signal(main(), speed)
    if experiment is None:
        return Driven(None, code)
    outcome = experiment.outcome()
    if code == OK and outcome.stopped_by.startswith("the safety gate"):
        print(f"txt1: the robot was stopped by {outcome.stopped_by}", file=sys.stderr)
        code = DISARMED
    return Driven(outcome, code)


def _until_signal(work: Coroutine[Any, Any, None], speed: Speed) -> int:
    """Run it until it ends or a signal cancels it; the exit code."""
    code = OK

    async def main() -> None:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None

        def interrupt(number: signal.Signals) -> None:
            nonlocal code
            code = 128 + number
            for each in SIGNALS:  # a second one is not caught any more
                loop.remove_signal_handler(each)
            task.cancel()

        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                loop.add_signal_handler(number, partial(interrupt, number))
        await work

    try:
        run(main(), speed=speed)
    except asyncio.CancelledError:
        if code == OK:
            raise
    return code


@contextmanager
def _progress_bar(experiment: Experiment, name: str) -> Iterator[None]:
    """A bar on standard error while the block runs, drawn by a thread of its own: the robot waits for no terminal."""
    if not name or not sys.stderr.isatty():
        yield
        return
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(),
        console=Console(stderr=True), auto_refresh=False, transient=True,
    )  # fmt: skip
    task = bar.add_task(name, total=1.0)
    over = threading.Event()

    def draw() -> None:
        with bar:
            while not over.wait(BAR_PERIOD):
                bar.update(task, completed=experiment.progress)
                bar.refresh()

    drawer = threading.Thread(target=draw, name="txt1 progress bar", daemon=True)
    drawer.start()
    try:
        yield
    finally:
        over.set()
        drawer.join(1.0)


def _say(text: str) -> None:
    print(f"txt1: {text}", file=sys.stderr)
