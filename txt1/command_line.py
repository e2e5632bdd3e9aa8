"""What the commands have in common: exit codes, the signals that end them, numbers in their words, processors."""

from __future__ import annotations

import argparse
import os
import signal
from math import isfinite
from typing import Final

OK, FAULT, USAGE, DISARMED = 0, 1, 2, 3
"""Exit codes: as asked, a fault, a mistake of the user's, stopped by the safety gate."""

SIGNALS: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
"""They end a command, with 128 and their number as its exit code."""


def number(text: str) -> float:
    """The finite number that a word is; raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not finite")
    return value


def positive(text: str) -> float:
    """The positive number that a word is; raises ArgumentTypeError."""
    value = number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not positive")
    return value


def natural(text: str) -> int:
    """The whole number from 0 that a word is; raises ArgumentTypeError."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0")
    return int(text)


def count(text: str) -> int:
    """The whole number from 1 that a word is; raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1")
    return int(text)


def processors() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
