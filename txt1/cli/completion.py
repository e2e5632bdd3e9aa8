"""`txt1 completion`: a script for the shell."""

import argparse

from txt1.cli import parser
from txt1.commands import OK


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shell's name."""
    parser.add_argument("shell", choices=("bash", "zsh"), help="for example: source <(txt1 completion bash)")


def main(arguments: argparse.Namespace) -> int:
    """Print the script that completes commands, actions and options."""
    # imported when used, so that the help appears at once
    import shtab

    print(shtab.complete(parser(), arguments.shell))
    return OK
