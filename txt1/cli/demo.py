"""`txt1 demo`: runs commands that every user may type, and shows each command first."""

import argparse
import shlex
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from txt1.cli import execute
from txt1.commands import DISARMED, OK, add, path, say, takes, unused
from txt1.experiments import run_folder
from txt1.installing import installs
from txt1.kit.options import SEED
from txt1.record.session import MODULES
from txt1.ui import tty


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder for results, and the seed."""
    about = "folder for recordings and pictures; by default out/demo, then out/demo-2 and so on"
    add(parser, {"--out": takes("DIR", about, path)} | SEED)


def main(arguments: argparse.Namespace) -> int:
    """Drive, learn, and show the result; return the exit code of the first command that failed."""
    out = arguments.out or unused(Path("out/demo"))
    for about, words in steps(out, str(arguments.seed or 1), screens=tty.drawable()):
        print(f"\n{about}\n\n    txt1 {shlex.join(words)}\n", flush=True)
        code = execute(words)
        if code != OK:
            if code == DISARMED:
                say("the demo ended early; if this computer is busy with other programs, end them and run it again")
            return code
    print(f"\nThat was all; everything is in {out}. Drive yourself: txt1 run")
    return OK


def steps(out: Path, seed: str, screens: bool) -> Iterator[tuple[str, list[str]]]:
    """Yield each command's words, and a sentence about it; without screens all commands run in virtual time."""
    recorded = all(find_spec(module) for module in MODULES)
    watched = ["--seed", seed, "--screen", "5"] if screens else ["--seed", seed, "--headless", "--speed", "max"]

    def log(name: str) -> list[str]:
        return ["--log", str(out / name)] if recorded else []

    run_folder.make(out)
    yield (
        "1. It drives: half a metre and 0.4 radians a second (on the screens: arrow keys, ? for help, q goes on).",
        [
            "run",
            *watched,
            "--duration",
            "12",
            "--drive",
            "0.5,0.4",
            "--set",
            "sim.start=[0,-1.2,0]",
            *log("circle.mcap"),
        ],
    )
    learned = out / "learned"
    yield (
        "2. It learns to find a light, 31 times from another place, as fast as this computer can.",
        ["learn", "--trials", "1", "--episodes", "31", "--seed", seed, "--out", str(learned)],
    )
    yield (
        "3. It drives to the light by what it learned.",
        ["run", *watched, "--duration", "25", "--policy", str(learned / "qtable.json"), *log("light.mcap")],
    )
    if recorded and find_spec("matplotlib"):
        yield "4. It draws that drive: open the page in a browser.", ["report", str(out / "light.mcap")]
    else:
        print(f"\nWith {installs('record,plots')} the demo would record its drives, too, and draw them.")
