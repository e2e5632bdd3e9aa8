"""`txt1 sweep`: runs a command with every combination of some settings, on many processors; the result is a table."""

import argparse
import csv
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from txt1 import commands
from txt1.cli import execute, parsed
from txt1.commands import FAULT, OK, flag, path, say, takes
from txt1.errors import ConfigError
from txt1.experiments import run_folder
from txt1.kernel.clock import stopwatch_ns
from txt1.trials.provenance import provenance
from txt1.trials.run import Rows, run
from txt1.trials.workers import OPTIONS, workers_of

# in a trial's words it stands for a folder of its own, whose metrics.json is the result
OUT: Final = "{out}"
# the processor's times, which never repeat
MEASURED: Final = ("wall", "run_time", "lateness", "tasks.")
# common to all trials; sweep.json has it
TOLD_ONCE: Final = ("provenance.", "settings.")
# results as they come
ROWS: Final = "rows.jsonl"
# all results in order, at the end
TABLE: Final = "table.csv"
ABOUT: Final = "sweep.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `sweep`."""
    parser.epilog = (
        f"For example: txt1 sweep seed=1..100 control.linear.kp=9,11 -- run --json --drive 0.5,0 --duration 10, or "
        f"txt1 sweep seed=1..1000 -- learn --trials 1 --jobs 1 --out {OUT}. {parser.epilog}"
    )
    commands.add(
        parser,
        {
            "words": {
                "nargs": "+",
                "metavar": "PARAM=VALUES | COMMAND",
                "help": "after the options: settings and values (1,2,5 or 1..100), --, a command that prints JSON, or "
                f"writes metrics.json into {OUT}",
            },
            "--out": takes("DIR", "folder for the table; by default out/sweep", path, default=Path("out/sweep")),
            "--resume": flag("continue the results in DIR"),
        }
        | OPTIONS,
    )


def main(arguments: argparse.Namespace) -> int:
    """Do all missing trials, and write the table."""
    given = list(itertools.takewhile(lambda word: "=" in word, arguments.words))
    command = arguments.words[len(given) :]
    if not given or not command:
        raise ConfigError("sweep: give settings with their values, then --, then a command; see 'txt1 sweep --help'")
    # a mistake in the command is reported once, before any file is made
    parsed([word.replace(OUT, "out") for word in command])
    trials = dict(enumerate(combinations(dict(map(_setting, given)))))
    about = {"settings": given, "command": command, **provenance()}
    done = _begun(arguments.out, about, arguments.resume)
    missing = {
        number: [*command, *(word for pair in own.items() for word in ("--set", "=".join(pair)))]
        for number, own in trials.items()
        if number not in done
    }
    began, rows = stopwatch_ns(), Rows(arguments.out / ROWS)

    def keep(number: int, result: dict[str, Any]) -> None:
        done[number] = result
        rows.add({"trial": number, **result})

    code = run(trial, missing, workers_of(arguments), keep, bar="sweep")
    write_table(arguments.out / TABLE, trials, done)
    elapsed = (stopwatch_ns() - began) / 1e9
    say(f"{len(done)} of {len(trials)} trials, {len(missing)} asked for, in {elapsed:.1f} s: {arguments.out / TABLE}")
    if code != OK:
        return code
    failed = [number for number, result in done.items() if result["code"] != OK]
    if failed:
        say(f"{len(failed)} trials ended with another exit code than 0, the first is {min(failed)}")
    return FAULT if failed else OK


def trial(words: Sequence[str]) -> dict[str, Any]:
    """Run a command of these words; return its exit code, and its output or measurements."""
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()) as printed:
        out = Path(folder, "out")
        code = execute([word.replace(OUT, str(out)) for word in words])
        measured = out / "metrics.json"
        shown = measured.read_text(encoding="utf-8") if measured.exists() else printed.getvalue()
    try:
        result = json.loads(shown)
    except ValueError:
        result = None
    return {"code": code, "result": result}


def combinations(settings: Mapping[str, list[str]]) -> Iterator[dict[str, str]]:
    """Yield every combination of the values of some settings; the last setting changes fastest."""
    for values in itertools.product(*settings.values()):
        yield dict(zip(settings, values, strict=True))


def _setting(word: str) -> tuple[str, list[str]]:
    """Return a setting's key and its values; raises ConfigError."""
    key, _, text = word.partition("=")
    first, dots, last = text.partition("..")
    if dots and first.lstrip("-").isdecimal() and last.lstrip("-").isdecimal():
        values = [str(number) for number in range(int(first), int(last) + 1)]
    else:
        values = [value for value in text.split(",") if value]
    if not key or not values:
        raise ConfigError(f"sweep: '{word}' is not PARAM=VALUES, for example seed=1..100 or control.linear.kp=9,11")
    return key, values


def _begun(folder: Path, about: Mapping[str, Any], resume: bool) -> dict[int, dict[str, Any]]:
    """Return the existing results; raises ConfigError: the folder is taken, or holds another sweep."""
    file = folder / ABOUT
    if file.exists():
        if not resume:
            raise ConfigError(f"{folder}: there is a sweep in it; --resume carries it on, --out names another folder")
        if json.loads(file.read_text(encoding="utf-8")) != json.loads(json.dumps(about)):
            raise ConfigError(f"{folder}: another sweep, or a sweep of other code; choose another folder with --out")
    run_folder.make(folder)
    file.write_text(json.dumps(about, indent=1), encoding="utf-8")
    return {row.pop("trial"): row for row in Rows(folder / ROWS).read()}


def write_table(file: Path, trials: Mapping[int, Mapping[str, str]], done: Mapping[int, Mapping[str, Any]]) -> None:
    """Write a row for each finished trial, by number: settings, exit code, every number of its result that repeats."""
    rows = [{"trial": n, **trials[n], "code": done[n]["code"], **dict(_flat(done[n]["result"]))} for n in sorted(done)]
    columns = dict.fromkeys(name for row in rows for name in row)
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, list(columns))
        writer.writeheader()
        writer.writerows(rows)


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, int | float | str):
        repeats = not any(part in f"{path}." for part in MEASURED)
        if repeats and not path.startswith(TOLD_ONCE):
            yield path, value
