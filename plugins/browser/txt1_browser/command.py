"""The command ``txt1 browser``: a folder of files that drives robots in a web browser."""

import argparse
from pathlib import Path

from txt1.commands import OK, existing, path, say
from txt1_browser.site import PYODIDE, build


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    commands = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    make = commands.add_parser("build", help="make the folder, which any server of plain files can serve")
    make.add_argument("-o", "--output", type=path, default=Path("site"), metavar="FOLDER", help="the folder; site")
    make.add_argument(
        "--pyodide", type=existing, metavar="PLACE",
        help=f"folder or package of Pyodide {PYODIDE}, in place of npm's",
    )  # fmt: skip


def main(arguments: argparse.Namespace) -> int:
    """Make the folder."""
    size = build(arguments.output, arguments.pyodide, say)
    say(f"{arguments.output} has {size / 1e6:.1f} MB; python -m http.server --directory {arguments.output} serves it")
    return OK
