"""`txt1 tune`: identifies the vehicle, proposes gains, and tests them on the drive tests."""

import argparse
from functools import partial
from typing import Final

from rich.console import Console

from txt1.commands import OK, add, count, flag, path, say, takes
from txt1.config import Config
from txt1.config.schema import ControlConfig, GainsConfig, GainSetConfig
from txt1.errors import CommandRefused
from txt1.experiments import figures, report, run_folder
from txt1.experiments.command.experiment import configure, drive_all, repeated
from txt1.experiments.identify import Plant, identify, try_out
from txt1.experiments.profile import load_profile
from txt1.experiments.run_folder import Run
from txt1.experiments.runner import END_OF_PROFILE, INTERRUPTED
from txt1.experiments.tune import CANDIDATES, angular_gains, linear_gains
from txt1.kernel.loop import Speed
from txt1.kit.app import App, get_ready
from txt1.kit.options import ARM, ROBOT
from txt1.trials.run import progress
from txt1.trials.workers import OPTIONS, Workers, workers_of

# tests on which gains are compared
TESTS: Final = ("linear-steps", "angular-steps")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tune`."""
    add(
        parser,
        ROBOT
        | ARM
        | OPTIONS
        | {
            "--out": takes("DIR", "write tables and figures of old and new there", path),
            "--write": takes("FILE", "write the gains to this YAML file", path),
            "--no-trial": flag("propose only; do not drive the tests with old and new gains"),
            "--repeats": takes("N", "number of runs of each test; their mean is judged", count, default=10),
        },
    )


def main(arguments: argparse.Namespace) -> int:
    """Identify the vehicle, propose gains, compare them with the old gains; return the exit code."""
    config, speed = configure(arguments)
    machines = workers_of(arguments, alone=config.hal != "sim" or speed != "max")
    if arguments.out is not None:
        figures.available()
        run_folder.make(arguments.out)
    if arguments.write is not None:
        run_folder.make(arguments.write.parent)
    say("trying out the vehicle, for a minute of its time")
    plant: Plant | None = None
    app = App(speed)

    async def try_it() -> None:
        nonlocal plant
        async with app.robot(config) as robot:
            await get_ready(robot, arguments.arm)
            plant = identify(await try_out(robot))

    code = app.run(try_it())
    if plant is None:
        return code
    print(
        f"speed: {1000.0 * plant.speed_gain:.4f} mm/s per count beyond a dead band of {plant.dead_band:.0f} counts, "
        f"lag {plant.time_constant:.3f} s\n"
        f"steering: {1e6 * plant.steering_gain:.1f} mrad/m per 1000 counts, lag {plant.steering_lag:.3f} s"
    )
    new = _proposed(plant, config)
    text = gains_file(new)
    print(text)
    if not arguments.no_trial:
        for test in TESTS:
            interrupted = _compared(config, new, test, speed, arguments, machines)
            if interrupted is not None:
                return interrupted
    if arguments.write is not None:
        arguments.write.write_text(text)
        print(f"{arguments.write}: written; use it with --config")
    return OK


def _proposed(plant: Plant, config: Config) -> ControlConfig:
    """Return the best gains on the model of the vehicle; the search begins with the configured gains."""
    old, motor_max = config.control, config.safety.motor_max
    with progress("trying gains on its model", CANDIDATES) as bar:
        tried = partial(bar.advance, bar.task_ids[0])
        linear = linear_gains(plant, config.geometry, old.linear.gains(), motor_max, tried)
        angular = angular_gains(plant, config.geometry, old.schedule(), tried)
    return ControlConfig(
        linear=GainsConfig(**linear._asdict()),
        angular=tuple(GainSetConfig(v_max=each.v_max, **each.gains._asdict()) for each in angular),
    )


def _compared(
    config: Config, new: ControlConfig, test: str, speed: Speed, arguments: argparse.Namespace, machines: Workers
) -> int | None:
    """Drive a test with the configured and the new gains, and show both; return an exit code if interrupted."""
    runs = []
    for label, control in (("old gains", config.control), ("new gains", new)):
        driven = _repeated(config.model_copy(update={"control": control}), test, speed, label, arguments, machines)
        if isinstance(driven, int):
            return driven
        runs.append(driven)
    report.show(runs, Console())
    if arguments.out is not None:
        for result in runs:
            run_folder.write(result, arguments.out / f"{test}-{result.label.split()[0]}")
        figures.draw(runs, arguments.out / f"{test}.svg")
        figures.draw(runs, arguments.out / f"{test}-steps.svg", "steps")
    return None


def _repeated(
    config: Config, test: str, speed: Speed, label: str, arguments: argparse.Namespace, machines: Workers
) -> Run | int:
    """Return several runs of a test as a single run, with seeds that differ like the floor; or an exit code if
    interrupted.
    """
    profile, seeds = load_profile(test), range(config.seed, config.seed + arguments.repeats)
    outcomes, code = drive_all(config, profile, speed, seeds, machines, arm=arguments.arm, bar=f"{test}, {label}")
    for outcome in outcomes:
        if outcome.stopped_by not in (END_OF_PROFILE, INTERRUPTED):
            raise CommandRefused(
                f"{test} with {label} was ended by {outcome.stopped_by}, so there is nothing to compare; "
                "--no-trial leaves these drives out"
            )
    return repeated(label, profile, outcomes) if code == OK and outcomes else code


def gains_file(control: ControlConfig) -> str:
    """Return gains as a configuration file."""
    linear, sets = control.linear, control.angular
    angular = (f"    - {{v_max: {s.v_max:g}, kp: {s.kp:g}, ki: {s.ki:g}, kd: {s.kd:g}}}\n" for s in sets)
    first = f"control:\n  linear: {{kp: {linear.kp:g}, ki: {linear.ki:g}, kd: {linear.kd:g}}}\n  angular:\n"
    return first + "".join(angular)
