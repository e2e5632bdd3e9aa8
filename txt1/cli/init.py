"""A small init for a container, where the robot's own process would have the number 1.

When process 1 ends, for any reason, Linux kills every other process of its namespace at once. This includes the guard
of a car's outputs, perhaps before the guard has put out neutral. So process 1 runs the command as a child, passes its
signals on, and ends only after all other processes have ended. If process 1 itself is killed from outside, nothing in
the container can help.
"""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from types import FrameType
from typing import Final

HANDED_ON: Final = signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2
# s for which other processes may go on after the command: a guard whose bus fails tries for a minute
END_WITHIN: Final = 90


def serve() -> int:
    """Run this command line as a child; return its exit code after all other processes have ended."""
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    # in its own group, which gets a terminal's Ctrl-C once
    child = subprocess.Popen([sys.executable, *sys.orig_argv[1:]], process_group=0)  # noqa: S603 - ourselves

    def hand_on(number: int, _: FrameType | None) -> None:
        with suppress(ProcessLookupError):
            os.kill(child.pid, number)

    for each in HANDED_ON:
        signal.signal(each, hand_on)
    if sys.stdin is not None and sys.stdin.isatty():
        with suppress(OSError):
            os.tcsetpgrp(sys.stdin.fileno(), child.pid)
    code = 0
    while True:
        try:
            ended, status = os.wait()
        except ChildProcessError:
            return code
        if ended == child.pid:
            code = os.waitstatus_to_exitcode(status)
            code = code if code >= 0 else 128 - code
            signal.signal(signal.SIGALRM, lambda *_, ends_with=code: os._exit(ends_with))
            signal.alarm(END_WITHIN)
            # screens and bridges end; a guard ignores the signal until its outputs are neutral
            with suppress(ProcessLookupError):
                os.kill(-1, signal.SIGTERM)
