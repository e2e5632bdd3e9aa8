"""`txt1 decode`: prints a capture of the line, a line of text for each message and fault."""

import argparse
import json
import sys
from contextlib import ExitStack

from txt1.commands import OK, add, flag, takes
from txt1.errors import CaptureError, ConfigError
from txt1.protocol import capture
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role

# bytes of a capture that are read at once
READ_BYTES = 1 << 16


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the capture and its format."""
    add(
        parser,
        {
            "file": takes("FILE", "the captured bytes; - for standard input"),
            "--role": {"choices": ("host", "board"), "required": True, "help": "end of the line that received them"},
            "--hex": flag("the file is hexadecimal text"),
            "--json": flag("one JSON object a line"),
        },
    )


def main(arguments: argparse.Namespace) -> int:
    """Print a capture, and a summary on standard error."""
    decoder = Decoder(Role.HOST if arguments.role == "host" else Role.BOARD)
    try:
        with ExitStack() as stack:
            file = sys.stdin.buffer if arguments.file == "-" else stack.enter_context(open(arguments.file, "rb"))
            lines = (line.decode("ascii", "replace") for line in file)
            reads = capture.read_hex(lines) if arguments.hex else iter(lambda: file.read(READ_BYTES), b"")
            for offset, event in capture.decode(decoder, reads):
                print(json.dumps(capture.as_dict(offset, event)) if arguments.json else capture.describe(offset, event))
    except BrokenPipeError:
        raise
    except OSError as error:
        raise ConfigError(f"{arguments.file}: cannot read the capture: {error.strerror}; check the name") from None
    except CaptureError as error:
        raise ConfigError(f"{arguments.file}: {error}; without --hex the file is read as raw bytes") from None
    print(capture.summary(decoder), file=sys.stderr)
    return OK
