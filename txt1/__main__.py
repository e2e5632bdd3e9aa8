"""``python -m txt1`` and the program `txt1`: from here on a signal ends it without a traceback."""

import os
import signal
import sys
from io import TextIOWrapper
from types import FrameType
from typing import NoReturn


def leave(number: int, _: FrameType | None) -> NoReturn:
    """End the process at once; where something has to be stopped first, `txt1.cli.app` takes the signals."""
    os._exit(128 + number)


SIGNALS = signal.SIGHUP, signal.SIGINT, signal.SIGTERM


def open_streams() -> None:
    """Open the null device for each standard stream that is closed: a board's line would get its number, and text."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - for as long as the process lives


def main() -> NoReturn:
    """Run the command given on the command line and exit with its code."""
    if os.getpid() == 1:
        from txt1.cli.init import serve

        sys.exit(serve())
    # before the imports, which take their time
    for each in SIGNALS:
        signal.signal(each, leave)
    open_streams()
    for stream in (sys.stdout, sys.stderr):
        # a terminal without a letter, such as LC_ALL=C's, shows ? for it
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    from txt1.cli import execute

    code = execute(sys.argv[1:])
    # all is done; Python, on its way out, would let the signal kill it
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    sys.exit(code)


if __name__ == "__main__":
    main()
