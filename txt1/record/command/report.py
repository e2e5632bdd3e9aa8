"""`txt1 report`: a recording as a picture and one page."""

import argparse
from pathlib import Path

from txt1.commands import OK, add, busy, need, takes
from txt1.record.options import ONE_ROBOT, RECORDING


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording and the pictures' names."""
    add(
        parser,
        RECORDING | ONE_ROBOT | {"-o --output": takes("STEM", "STEM.png and STEM.html; FILE without .mcap", _stem)},
    )


def _stem(text: str) -> Path:
    """Return the name that both files begin with: `text`, without the ending of either; raises ArgumentTypeError."""
    path = Path(text)
    if path.name in ("", ".."):
        raise argparse.ArgumentTypeError(f"'{text}' names no file; give a name such as first")
    return path.with_suffix("") if path.suffix in (".png", ".html") else path


def main(arguments: argparse.Namespace) -> int:
    """Draw a recording."""
    need("txt1 report", "plots", "matplotlib")
    from txt1.record.report import report

    with busy(f"drawing {arguments.file}"):
        paths = report(arguments.file, arguments.output or arguments.file.with_suffix(""), arguments.robot)
    print(*paths, sep="\n")
    return OK
