"""``python -m txt1`` and the program `txt1`. It lets a signal end the process without a traceback."""

import os
import signal
import sys
from io import TextIOWrapper
from types import FrameType
from typing import NoReturn


def leave(number: int, _: FrameType | None) -> NoReturn:
    """End the process at once. `txt1.kit.app` takes the signals instead while a robot has to be stopped first."""
    os._exit(128 + number)


SIGNALS = signal.SIGHUP, signal.SIGINT, signal.SIGTERM


def open_streams() -> None:
    """Open the null device for each closed standard stream.

    Otherwise a board's line could get the number of a standard stream, and receive its text.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - for as long as the process lives


def main() -> NoReturn:
    """Run the command given on the command line and exit with its code."""
    if os.getpid() == 1:
        from txt1.cli.init import serve

        sys.exit(serve())
    # before the imports, which take time
    for each in SIGNALS:
        signal.signal(each, leave)
    open_streams()
    for stream in (sys.stdout, sys.stderr):
        # a terminal that lacks a character, as under LC_ALL=C, shows ? instead
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    from txt1.cli import execute

    code = execute(sys.argv[1:])
    # all work is done; Python, while it ends, would let the signal kill it
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    sys.exit(code)


if __name__ == "__main__":
    main()
