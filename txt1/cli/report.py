"""`txt1 report`: a recording as a picture and one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from txt1.cli.exit_codes import OK
from txt1.cli.options import existing
from txt1.record.session import MODULES, need


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording and the names of what is drawn."""
    parser.add_argument("file", type=existing, metavar="FILE")
    parser.add_argument("-o", "--output", type=Path, metavar="STEM", help="STEM.png and STEM.html; FILE without .mcap")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Draw a recording."""
    need("txt1 report", "record", *MODULES)
    need("txt1 report", "plots", "matplotlib")
    from txt1.record.report import report

    for path in report(arguments.file, arguments.output or arguments.file.with_suffix("")):
        print(path)
    return OK
