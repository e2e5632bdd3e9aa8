"""`txt1 teach`: makes a policy from recordings in which a human drove."""

from __future__ import annotations

import argparse
from itertools import count as numbers
from pathlib import Path
from shutil import copyfile
from typing import Any, Final

from txt1.commands import OK, add, count, existing, flag, names, need, number, path, say, seed, takes
from txt1.errors import ConfigError

LAG_MAX: Final = 2.0
"""s; nobody drives with a longer reaction time."""


def _sensors(text: str) -> list[Any]:
    """Return the sensors in a word; raises ArgumentTypeError."""
    from txt1.teaching.features import KINDS
    from txt1.teaching.lessons import Ask

    found = []
    for each in names(text):
        kind, _, sensor = each.partition(":")
        if kind not in KINDS:
            raise argparse.ArgumentTypeError(f"'{each}' is none of {', '.join(KINDS)}, or KIND:NAME of a sensor")
        found.append(Ask(kind, sensor))
    if not found or found[0].kind == "odometry" or len({ask.kind for ask in found}) < len(found):
        raise argparse.ArgumentTypeError(f"'{text}': name a laser, a camera or a light first, and no kind twice")
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `teach`."""
    parser.epilog = (
        "'txt1 run --source FILE.onnx' drives by it. Take over by driving, let go, and record that with --log; "
        f"--more with --from then teaches it where it went wrong. {parser.epilog or ''}"
    )
    add(
        parser,
        {
            "files": takes("FILE", "recordings in which you drove, or tubs of donkeycar", existing, nargs="*"),
            "-o --output": takes("FILE.onnx", "the policy; a report is written beside it, FILE-report", path),
            "--see": takes(
                "SENSORS",
                "what it is to drive by: laser, camera, light, with commas for several, the first with the readings "
                "that it drives at; odometry besides; laser:NAME where there are several",
                _sensors,
            ),
            "--more": takes("FILE", "with --from: recordings of take-overs", existing, nargs="+", default=[]),
            "--from": takes("FILE.onnx", "the policy to teach further", existing, dest="before"),
            "--lag": takes("S", "reaction time of the human; 0.2 by default", number, default=0.2),
            "--robot": takes("NAME", "name of the robot, in a recording of several"),
            "--vehicle": takes("NAME", "the car of a tub of donkeycar; donkeycar by default", default="donkeycar"),
            "--by": takes("SOURCES", "treat these sources of commands as human, too", names, default=[]),
            "--networks": takes(
                "N", "number of networks; their disagreement is the doubt; 5 by default", count, default=5
            ),
            "--epochs": takes("N", "largest number of passes over all lessons; 60 by default", count, default=60),
            "--no-mirror": flag("do not mirror lessons, for example if cars have to keep to one side"),
            "--seed": takes("N", "repeats the training", seed, default=0),
            "--no-report": flag("write no report"),
        },
    )


def main(arguments: argparse.Namespace) -> int:
    """Read the recordings, teach, and write the policy."""
    need("teaching", "record", "mcap", "mcap_ros2")
    if arguments.before is None and (arguments.more or not arguments.files):
        raise ConfigError("teach: name recordings, or --more recordings --from policy.onnx")
    if arguments.before is not None and not (arguments.more or arguments.files):
        raise ConfigError("--from: add --more, the recordings that are to be learned from besides")
    from txt1.record.reader import check_own

    for file in arguments.files:
        check_own(file)
    if arguments.before is None and arguments.see is None:
        raise ConfigError("--see: name its sensors: laser, camera or light")
    if arguments.networks > 16:
        raise ConfigError("--networks: 16 at most")
    if not 0.0 <= arguments.lag <= LAG_MAX:
        raise ConfigError(f"--lag: {arguments.lag:g} s is no reaction time of a human; give 0 to {LAG_MAX:g}")
    output = _output(arguments.output or arguments.before, arguments.before)
    from txt1.teaching import teach as teaching
    from txt1.teaching.lessons import SECONDS_FEW, Ask, drive_in
    from txt1.teaching.policy import load
    from txt1.teaching.training import Progress, Recipe
    from txt1.trials.run import progress

    drives, asks = [], arguments.see
    if arguments.before is not None:
        before = load(arguments.before)
        asks = [Ask(sight.kind, sight.sensor) for sight in before.card.sees]
        if arguments.see is not None and [ask.kind for ask in arguments.see] != [ask.kind for ask in asks]:
            raise ConfigError("--see: a policy keeps its sensors; leave it out, or teach a new policy without --from")
        drives += teaching.earlier(before, arguments.by, arguments.lag)
    for file in (*arguments.files, *arguments.more):
        drives.append(drive_in(file, asks, arguments.by, arguments.robot, arguments.lag, arguments.vehicle))
    for drive in drives:
        print(*teaching.summary(drive), sep="\n", flush=True)
    seconds = sum(drive.taught.seconds for drive in drives)
    if seconds < SECONDS_FEW:
        print(f"drive longer: {seconds:.0f} s teach the places in them and little else; ten minutes are better")
    recipe = Recipe(
        members=arguments.networks, epochs=arguments.epochs, mirror=not arguments.no_mirror, seed=arguments.seed
    )
    with progress("teaching", 2.0) as bar:

        def told(what: str, done: Progress) -> None:
            whole = done.done + (what == "all lessons")
            bar.update(bar.task_ids[0], completed=whole, description=f"{what}, loss {done.loss:.4f}")

        lesson = teaching.teach(drives, recipe, _today(), told)
    results = lesson.policy.card.results
    print(
        f"held-out blocks: steering rms {results['steering_rms']:.4f} of full lock, correlation "
        f"{results['steering_correlation']:.3f}; always the mean would be {results['steering_deviation']:.4f}"
    )
    print(f"loss of each network, first and last epoch: {_ends(lesson.ensemble.curves)}")
    if output.exists():
        print(f"{_former(output)}: the policy as it was before")
    lesson.policy.save(output)
    card = lesson.policy.card
    print(f"{output}: {card.members} networks, {results['parameters']:.0f} numbers, weights {card.weights[:12]}")
    if not arguments.no_report:
        _report(lesson, output)
    return OK


def _output(output: Path | None, before: Path | None) -> Path:
    """Return where the policy is to be written; raises ConfigError: it cannot be, or another file is there."""
    if output is None or output.suffix != ".onnx":
        raise ConfigError("-o: name the policy to be written, FILE.onnx")
    if not output.parent.is_dir():
        raise ConfigError(f"-o: {output}: there is no folder {output.parent}; make it, or choose another")
    if output.exists() and (before is None or not output.samefile(before)):
        raise ConfigError(f"-o: there is a {output} already; choose another name, or teach it further by --from")
    return output


def _ends(curves: list[list[float]]) -> str:
    return ", ".join(f"{curve[0]:.4f} to {curve[-1]:.4f}" for curve in curves)


def _former(policy: Path) -> Path:
    """Copy a policy to the first unused name with a number; return it. Raises ConfigError."""
    names = (policy.with_name(f"{policy.stem}-{number}.onnx") for number in numbers(1))
    former = next(each for each in names if not each.exists())
    try:
        copyfile(policy, former)
    except OSError as error:
        raise ConfigError(f"{former}: cannot write it: {error.strerror}") from None
    return former


def _report(lesson: Any, output: Path) -> None:
    from txt1.errors import MissingExtra
    from txt1.teaching.report import write

    folder = output.with_name(f"{output.stem}-report")
    try:
        print(f"the report: {write(lesson, folder)}")
    except MissingExtra as error:
        say(str(error))
    except OSError as error:
        raise ConfigError(f"{folder}: cannot write it: {error.strerror}") from None


def _today() -> str:
    from datetime import UTC, datetime

    return datetime.now(UTC).date().isoformat()
