"""Python's garbage collector while robots run. The first run sets it, the last run resets it."""

import gc
from typing import Final

# new objects after which it looks for cycles while a robot runs: seldom, as the tasks make no cycles
COLLECT_AFTER: Final = 50_000

_runs = 0
_freezes = False
_before = gc.get_threshold()


def begin(*, real_time: bool) -> None:
    """Let the collector run seldom; each call needs a later call of `end`.

    In real time the objects that exist when the first run begins are frozen: so the collector never looks through them
    in the middle of a cycle. In virtual time lateness does not exist, and freezing would take as long as ten seconds of
    the run. If the program has frozen objects itself, they stay frozen.
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
    """Note the end of a run; after the last run the collector is as before."""
    global _runs
    _runs -= 1
    if _runs == 0:
        if _freezes:
            gc.unfreeze()
        gc.set_threshold(*_before)
