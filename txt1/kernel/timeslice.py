"""The length of a thread's turns on the processor; on Linux from 6.12 on, any thread may choose it for itself.

A thread with shorter turns than the running thread interrupts it when woken. Otherwise it would wait for the end of
that turn, 3 to 4 ms. It gets no larger share of the processor, and needs no privilege. The threads and processes that
it starts have ordinary turns again: beside another thread with short turns the kernel wakes it about 1 ms late.
"""

import ctypes
import os
import platform
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

# ns, the shortest there is
SLICE_MIN_NS: Final = 100_000

# sched_setattr(2): size, policy, flags, niceness, ..., turn in ns, ...
_ATTRIBUTES: Final = struct.Struct("=IIQiIQQQ")
# SCHED_FLAG_RESET_ON_FORK: what the thread starts has ordinary turns, and a niceness of 0 if its own is below
_RESET_ON_FORK: Final = 1
# of the system call
_NUMBERS: Final = {"x86_64": 314, "aarch64": 274, "riscv64": 274, "armv7l": 380}


def short() -> None:
    """Give the calling thread short turns, unless it has another scheduling policy than the ordinary."""
    if sys.platform == "linux" and os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER:
        with suppress(OSError):
            _set(0, os.getpriority(os.PRIO_PROCESS, 0), SLICE_MIN_NS, _RESET_ON_FORK)


def ordinary(process: int, niceness: int, session: bool = False) -> None:
    """Give all threads of another process ordinary turns and this niceness, or the caller's if that is larger.

    `session`: the process leads a session of its own; so does its share of the processor, where the system divides the
    processor among sessions.
    """
    niceness = max(niceness, os.getpriority(os.PRIO_PROCESS, 0))
    for thread in _threads(process):
        # it has ended
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, niceness)
            if sys.platform == "linux":
                _set(thread, niceness, 0)
    if session:
        with suppress(OSError):
            Path(f"/proc/{process}/autogroup").write_text(str(niceness), encoding="ascii")


def _threads(process: int) -> list[int]:
    """Return the ids of a process's threads. Only on Linux does each of them have a niceness of its own."""
    try:
        return [int(each.name) for each in Path(f"/proc/{process}/task").iterdir()]
    except OSError:
        return [process]


def _set(thread: int, niceness: int, turn: int, flags: int = 0) -> None:
    """Make the system call; an older kernel refuses it or takes no notice of the turn."""
    number = _NUMBERS.get(platform.machine())
    if number is not None:
        attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, os.SCHED_OTHER, flags, niceness, 0, turn, 0, 0)
        ctypes.CDLL(None).syscall(number, thread, attributes, 0)
