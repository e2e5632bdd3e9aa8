"""Python's garbage collector while robots run. The process has one: the first run sets it, the last one resets it."""

import gc
from typing import Final

COLLECT_AFTER: Final = 50_000
"""New objects after which it looks for cycles while a robot runs: the tasks make none, so seldom."""

_runs = 0
_freezes = False
_before = gc.get_threshold()


def begin(*, real_time: bool) -> None:
    """Let the collector run seldom; for every call there is one of `end`.

    In real time what exists when the first run begins stays: the collector need not look through it in the middle of a
    cycle. In virtual time nobody is late, and looking through it now would take as long as ten seconds of the run. A
    program that has frozen what it has itself keeps it so.
    """
    global _runs, _before, _freezes
    if _runs == 0:
        _before = gc.get_threshold()
        gc.set_threshold(COLLECT_AFTER, *_before[1:])
        _freezes = real_time and not gc.get_freeze_count()
        if real_time:
            gc.collect()
        if _freezes:
            gc.freeze()
    _runs += 1


def end() -> None:
    """One run has ended; after the last one the collector is as it was."""
    global _runs
    _runs -= 1
    if _runs == 0:
        if _freezes:
            gc.unfreeze()
        gc.set_threshold(*_before)
