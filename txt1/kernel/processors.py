"""The processors that this process may use."""

import os


def processors() -> int:
    """Return their number."""
    # not on macOS
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
