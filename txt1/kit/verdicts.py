"""The results of a conformance suite, in words."""

from collections.abc import Iterable

from txt1.commands import FAULT, OK
from txt1.conformance import BROKEN, SKIPPED


def print_verdicts(found: Iterable[tuple[str, str]]) -> int:
    """Print each promise of a conformance suite and its verdict, then the verdict on all; return the exit code."""
    broken = skipped = tried = 0
    for text, verdict in found:
        print(f"{text}: {verdict}")
        if verdict.startswith(SKIPPED):
            skipped += 1
            continue
        tried += 1
        broken += verdict.startswith(BROKEN)
    left_out = f"; {skipped} skipped, for the reasons above" if skipped else ""
    if broken:
        print(f"FAILED: {broken} of {tried} broken{left_out}; see the lines with '{BROKEN}'")
    else:
        print(f"PASSED: {tried} checks{left_out}")
    return FAULT if broken else OK
