"""`txt1 report`: a recording as a picture and one page, or in numbers that its owner may give away."""

import argparse
from pathlib import Path

from txt1.commands import OK, add, busy, flag, names, need, say, takes
from txt1.errors import ConfigError
from txt1.record.options import ONE_ROBOT, RECORDING


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording, the pictures' names, and what is shared."""
    add(
        parser,
        RECORDING
        | ONE_ROBOT
        | {
            "-o --output": takes("STEM", "STEM.png and STEM.html; FILE without .mcap", _stem),
            "--share": flag("write STEM-share.json for others instead, without names, places and pictures"),
            "--with": takes("KIND,...", "with --share: names, places, pictures too", names, default=[], dest="kinds"),
        },
    )


def _stem(text: str) -> Path:
    """Return the name that both files begin with: `text`, without the ending of either; raises ArgumentTypeError."""
    path = Path(text)
    if path.name in ("", ".."):
        raise argparse.ArgumentTypeError(f"'{text}' names no file; give a name such as first")
    return path.with_suffix("") if path.suffix in (".png", ".html") else path


def main(arguments: argparse.Namespace) -> int:
    """Draw a recording, or write what is shared of it."""
    need("txt1 report", "plots", "matplotlib")
    stem = arguments.output or arguments.file.with_suffix("")
    if arguments.share:
        from txt1.record.share import KINDS, share

        if wrong := [kind for kind in arguments.kinds if kind not in KINDS]:
            raise ConfigError(f"--with {wrong[0]}: give {', '.join(KINDS)}")
        print(share(arguments.file, stem.with_name(f"{stem.name}-share.json"), arguments.robot, arguments.kinds))
        say("read it before you send it: it holds all that is shared")
        return OK
    if arguments.kinds:
        raise ConfigError("--with: what is shared beside the numbers; add --share")
    from txt1.record.report import report

    with busy(f"drawing {arguments.file}"):
        paths = report(arguments.file, stem, arguments.robot)
    print(*paths, sep="\n")
    return OK
