"""`txt1 replay`: a recording on the screens again, or its inputs through the tasks again."""

from __future__ import annotations

import argparse

from txt1.cli.exit_codes import FAULT, OK
from txt1.cli.options import existing, positive
from txt1.kernel.loop import run
from txt1.record.session import MODULES, need


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording and how it is to be shown."""
    parser.add_argument("file", type=existing, metavar="FILE")
    parser.add_argument("--verify", action="store_true", help="run the recorded inputs through the tasks and compare")
    parser.add_argument("--speed", type=positive, default=1.0, metavar="N", help="as a multiple of real time")
    parser.add_argument("--from", type=float, dest="start", metavar="S", help="begin at this time of the run")
    parser.add_argument("--loop", action="store_true", help="begin anew at the end")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Show a recording on the screens, or run it again and say where it first differs."""
    need("txt1 replay", "record", *MODULES)
    if not arguments.verify:
        from txt1.record.snapshots import Snapshots
        from txt1.ui.replay import play

        run(play(Snapshots(arguments.file), arguments.speed, arguments.start, arguments.loop))
        return OK
    from txt1.record.verify import verify

    compared, difference = verify(arguments.file)
    print(f"{arguments.file}: {difference or f'no difference in {compared} messages'}")
    return OK if difference is None else FAULT
