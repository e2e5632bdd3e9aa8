"""What a conformance suite finds, in words."""

from collections.abc import Iterable

from txt1.commands import FAULT, OK
from txt1.conformance import BROKEN


def print_verdicts(found: Iterable[tuple[str, str]]) -> int:
    """Print each promise of a conformance suite and its verdict, then the verdict on all; return the exit code."""
    broken = tried = 0
    for text, verdict in found:
        tried += 1
        broken += verdict.startswith(BROKEN)
        print(f"{text}: {verdict}")
    print(f"FAILED: {broken} of {tried} broken; see the lines with '{BROKEN}'" if broken else f"PASSED: {tried} checks")
    return FAULT if broken else OK
