"""Real-time scheduling for the event loop's thread, as far as the system grants it; undone at the end.

The process's other threads and its children leave its processor to it. But a thread that holds Python's interpreter
lock keeps the loop waiting, even while another program keeps that thread from its processor: for 13 ms once in an hour
of load. So the recorder's and the live view's threads also run before other programs; they need the lock only for
moments. A user's threads may compute without end, so they only get a larger share of the processor.
"""

from __future__ import annotations

import ctypes
import os
import resource
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

# as good as any other application's priority, and below the kernel's own threads
FIFO: Final = 50
# how the names of txt1's own threads begin
HELPERS: Final = "txt1 "
# priority of txt1's own threads
HELPERS_FIFO: Final = 1
# of the other threads
OTHERS_NICENESS: Final = -10
# s after which new threads and children have to leave the loop's processor
SWEEP: Final = 1.0

# MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT: pages are locked once they are used
_LOCK_TOUCHED: Final = 1 | 2 | 4
_CAP_IPC_LOCK: Final = 1 << 14
_CAP_SYS_NICE: Final = 1 << 23

REMEDY: Final = (
    "to be granted it, put the lines '@realtime - rtprio 50', '@realtime - memlock unlimited' and '@realtime - nice "
    f"{OTHERS_NICENESS}' into /etc/security/limits.d/txt1.conf, join with 'sudo groupadd -f realtime && sudo usermod "
    "-aG realtime $USER' and log in again; a systemd unit has LimitRTPRIO=50 and LimitMEMLOCK=infinity"
)


class Granted(NamedTuple):
    """The system's answer: the SCHED_FIFO priority, whether memory is locked, and the processor; None: not granted."""

    fifo: int | None = None
    locked: bool = False
    processor: int | None = None

    def __str__(self) -> str:
        fifo = "no SCHED_FIFO" if self.fifo is None else f"SCHED_FIFO {self.fifo}"
        locked = "memory locked" if self.locked else "memory not locked"
        alone = "no processor of its own" if self.processor is None else f"processor {self.processor} of its own"
        return f"{fifo}, {locked}, {alone}"

    @property
    def missing(self) -> bool:
        """Whether the system could grant more."""
        return self.fifo is None or not self.locked


def grantable() -> Granted:
    """Return the rights that would be granted; nothing is changed."""
    if sys.platform != "linux":
        return Granted()
    spare = os.sched_getaffinity(0)
    fifo = FIFO if _capable(_CAP_SYS_NICE) else min(FIFO, resource.getrlimit(resource.RLIMIT_RTPRIO)[1])
    return Granted(fifo or None, _may_lock(), max(spare) if len(spare) > 1 else None)


@contextmanager
def realtime() -> Iterator[RealTime]:
    """Ask for all rights, for the calling thread; on leaving the block, whatever the reason, all is as before."""
    if sys.platform != "linux":
        yield RealTime(Granted(), set())
        return
    asked, before = grantable(), os.sched_getaffinity(0)
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    system = ctypes.CDLL(None, use_errno=True)
    fifo, locked = asked.fifo, False
    given = RealTime(asked, before)
    try:
        if fifo is not None:
            try:
                _raise_limit(resource.RLIMIT_RTPRIO)
                os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(fifo))
            except OSError:
                # a control group without real-time share, a container's filter
                fifo = None
        if asked.locked:
            _raise_limit(resource.RLIMIT_MEMLOCK)
            locked = system.mlockall(_LOCK_TOUCHED) == 0
        processor = asked.processor
        if processor is not None:
            os.sched_setaffinity(0, {processor})
        given.granted = Granted(fifo, locked, processor)
        given.sweep()
        yield given
    finally:
        if locked:
            system.munlockall()
        os.sched_setaffinity(0, before)
        given.give_back()
        if fifo is not None:
            try:
                os.sched_setscheduler(0, policy, parameters)
            except PermissionError:
                # only root may take the flag back; it has no effect at ordinary priorities
                os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)


class RealTime:
    """The granted rights in use: `granted` names them; `sweep` has to be called every `SWEEP` s."""

    def __init__(self, granted: Granted, processors: set[int]) -> None:
        self.granted = granted
        self._all = processors
        self._others = processors - {granted.processor}
        # niceness before, of other threads by their ids
        self._swept: dict[int, int] = {}

    def sweep(self) -> None:
        """Keep the process's other threads and its children off the loop's processor."""
        if sys.platform != "linux" or not self._others:
            return
        loop = threading.get_native_id()
        ours = {each.native_id for each in threading.enumerate() if each.name.startswith(HELPERS)}
        for thread in _ids(Path("/proc/self/task")):
            if thread != loop and thread not in self._swept:
                # the thread has ended
                with suppress(OSError):
                    self._swept[thread] = os.getpriority(os.PRIO_PROCESS, thread)
                    os.sched_setaffinity(thread, self._others)
                    # the flag: a process it starts has the ordinary niceness again
                    if thread in ours and self.granted.fifo is not None:
                        policy, priority = os.SCHED_FIFO, HELPERS_FIFO
                    else:
                        policy, priority = os.SCHED_OTHER, 0
                    os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
                    os.setpriority(os.PRIO_PROCESS, thread, OTHERS_NICENESS)
            with suppress(OSError):
                for child in map(int, Path(f"/proc/self/task/{thread}/children").read_text().split()):
                    self._leave(child)

    def _leave(self, process: int) -> None:
        """Make all threads of a child process leave the loop's processor."""
        for thread in _ids(Path(f"/proc/{process}/task")):
            if self.granted.processor in os.sched_getaffinity(thread):
                os.sched_setaffinity(thread, self._others)

    def give_back(self) -> None:
        """Restore the other threads."""
        for thread, niceness in self._swept.items():
            with suppress(OSError):
                os.sched_setaffinity(thread, self._all)
                os.sched_setscheduler(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
                os.setpriority(os.PRIO_PROCESS, thread, niceness)
        self._swept.clear()


def _ids(directory: Path) -> list[int]:
    return [int(each.name) for each in directory.iterdir()]


def _capable(capability: int) -> bool:
    """Whether this process has a capability, which root usually has."""
    for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) & capability)
    return False


def _may_lock() -> bool:
    """Whether all memory may be locked: under a limit, locking would make later requests for memory fail."""
    return _capable(_CAP_IPC_LOCK) or resource.getrlimit(resource.RLIMIT_MEMLOCK)[1] == resource.RLIM_INFINITY


def _raise_limit(limit: int) -> None:
    """Raise a limit to the hard limit."""
    hard = resource.getrlimit(limit)[1]
    resource.setrlimit(limit, (hard, hard))
