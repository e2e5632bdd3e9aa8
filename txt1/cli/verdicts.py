"""What a conformance suite finds, in words."""

from collections.abc import Iterable

from txt1.commands import FAULT, OK
from txt1.conformance import BROKEN


def print_verdicts(found: Iterable[tuple[str, str]]) -> int:
    """Print each promise of a conformance suite and its verdict; the exit code."""
    kept = True
    for text, verdict in found:
        kept = kept and not verdict.startswith(BROKEN)
        print(f"{text}: {verdict}")
    return OK if kept else FAULT
