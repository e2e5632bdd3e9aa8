"""A small init for a container, where the robot's own process would have the number 1.

When process 1 ends, however it does, Linux kills all others of its namespace at once: also the guard of a car's
outputs, perhaps before it has put out neutral. So process 1 runs the command as a child, hands on its signals, and ends
only after all others have ended. Nothing in the container helps when process 1 itself is killed from outside.
"""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from types import FrameType
from typing import Final

HANDED_ON: Final = signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2
# s that others may take to end after the command: a guard whose bus fails tries for a minute
END_WITHIN: Final = 90


def serve() -> int:
    """Run this very command line as a child, and return its exit code when nobody else is left."""
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    # in a group of its own, which a terminal's Ctrl-C reaches once
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
            # screens and bridges end; a guard ignores it until the outputs are neutral
            with suppress(ProcessLookupError):
                os.kill(-1, signal.SIGTERM)
