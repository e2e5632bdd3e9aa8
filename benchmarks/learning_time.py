"""How long the thesis's whole experiment takes, 5 trials of 31 episodes, through the real tasks on one processor."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Final

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.config import load
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.learning.command.trials import conduct
from txt1.learning.experiment import Plan

LIMIT: Final = 10.0
"""s, at most."""


def main(*, quick: bool) -> None:
    """Print the experiment's time, and that of the command with its start and its pictures."""
    rounds, trials = (1, 1) if quick else (5, 5)
    results = interleave(rounds, {"experiment": lambda: experiment(trials), "command": lambda: command(trials)})
    rows = []
    for name, seconds in results.items():
        limit = ("", "") if quick else (f"{LIMIT:.0f}", verdict(median(seconds) <= LIMIT))
        rows.append((name, spread(seconds, 1), *limit))
    table(
        f"Seconds for {trials} of the thesis's trials, {rounds} interleaved rounds",
        ("", "median (smallest .. largest)", "limit", ""),
        rows,
    )


def experiment(trials: int) -> float:
    """One round of the experiment alone, s."""
    plan = Plan("thesis", trials, 31, 1, load(overrides=["seed=1"]).config)
    with tempfile.TemporaryDirectory() as directory:
        began = stopwatch_ns()
        conduct(plan, Path(directory, "out"), False, lambda trial, one: None)
        return (stopwatch_ns() - began) / NS_PER_S


def command(trials: int) -> float:
    """One round of `txt1 learn`, with the interpreter's start and the pictures, s."""
    with tempfile.TemporaryDirectory() as directory:
        words = [
            "learn",
            "--agent",
            "thesis",
            "--trials",
            str(trials),
            "--episodes",
            "31",
            "--seed",
            "1",
            "--jobs",
            "1",
        ]
        began = stopwatch_ns()
        subprocess.run(
            [sys.executable, "-m", "txt1", *words, "--out", str(Path(directory, "out"))],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        return (stopwatch_ns() - began) / NS_PER_S
