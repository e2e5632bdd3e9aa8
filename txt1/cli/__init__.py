"""The command line. Each command is a module, imported when it is used. Only this package ends the process."""

import argparse
import errno
import os
import re
import signal
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Final, NoReturn

from txt1 import additions
from txt1.commands import DISARMED, FAULT, OK, STDOUT, UNSTOPPED, USAGE
from txt1.errors import ConfigError, MissingExtra, NotArmed, StopNotVerified, Txt1Error
from txt1.version import __version__

EPILOG: Final = (
    "Exit codes: 0 as asked, 1 fault, 2 mistake in command line or configuration, or a file or an extra is not there, "
    "3 the safety gate disarmed the robot, 4 it did not stop when told to or was not seen to stand, 5 a guard failed, "
    "129/130/143 ended by SIGHUP/SIGINT/SIGTERM."
)
# of errors that end a command; an error of another kind is a fault
CODES: Final[dict[type[Exception], int]] = {
    StopNotVerified: UNSTOPPED,
    NotArmed: DISARMED,
    ConfigError: USAGE,
    MissingExtra: USAGE,
}

FIRST: Final = """\
txt1 runs a robot car: simulated here, or a real one behind a board.

  txt1 demo                     ninety seconds: it drives, learns, stops before a box
  txt1 run --practice           drive a simulated one: w s a d, SPACE stops, ? helps, q quits
  txt1 run --log drive.mcap     ... and record it; then: txt1 report drive.mcap
  txt1 experiment circle-fast   measure how well it drives
  txt1 doctor                   look for a real board, and for what is wrong with the line to it

All commands: txt1 --help. Of one of them: txt1 run --help.
"""
COMMANDS: Final = {
    "demo": "ninety seconds without a hand: it drives, learns, stops before a box, repeats a drive",
    "run": "run a robot, simulated or real",
    "config": "show or check a configuration",
    "world": "list maps and worlds, or draw one before anything drives in it",
    "hal": "list or check hardware layers",
    "sensor": "list or check sensors",
    "doctor": "look for what is wrong with the line to the board",
    "service": "have systemd start a robot at boot, watch over it and start it again",
    "device": "start a virtual device, with a simulated vehicle behind it",
    "sweep": "run a command with every combination of some settings, and put the results in one table",
    "decode": "print a capture of the line, a line per message and fault",
    "completion": "print a script that completes words in your shell",
}
"""Commands by name: a module of this package with `add_arguments(parser)` and `main` (arguments -> exit code)."""


def commands() -> dict[str, tuple[str, str]]:
    """Return the module and the line of help of every command: the package's own, then those of additions."""
    found = {name: (f"txt1.cli.{name}", about) for name, about in COMMANDS.items()}
    for addition in additions.known().values():
        for name, told in addition.commands.items():
            if name in found:
                raise ConfigError(
                    f"the addition '{addition.name}' brings a command '{name}', which there is already; uninstall it"
                )
            found[name] = told
    return found


def execute(argv: Sequence[str]) -> int:
    """Run a command given as words and return its exit code (see `EPILOG`)."""
    return told(lambda: _perform(argv))


def told(perform: Callable[[], int]) -> int:
    """Perform a command and return its exit code. An error is printed in one line."""
    code = OK
    try:
        try:
            code = _guarded(perform)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # the reader of the output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
    return code


def _perform(words: Sequence[str]) -> int:
    if not words:
        print(FIRST, end="")
        return OK
    arguments = parsed(words)
    return int(arguments.main(arguments))


def _guarded(perform: Callable[[], int]) -> int:
    try:
        return perform()
    except SystemExit as ended:
        # from argparse: a mistake, or the help
        return ended.code if isinstance(ended.code, int) else OK
    except BrokenPipeError:
        raise
    except (Txt1Error, OSError) as error:
        first = error.__cause__ if isinstance(error, StopNotVerified) else None
        if isinstance(first, Txt1Error | OSError):
            print(f"txt1: {_told(first)}", file=sys.stderr)
        elif isinstance(first, Exception):
            traceback.print_exception(first)
        print(f"txt1: {_told(error)}", file=sys.stderr)
        own = next((code for kind, code in CODES.items() if isinstance(error, kind)), FAULT)
        # the guards' module is imported only where there is one
        return int(getattr(error, "exit_code", own))
    except KeyboardInterrupt:
        # a second Ctrl-C during the stop after the first
        return 128 + signal.SIGINT


def _told(error: Txt1Error | OSError) -> str:
    """Return an error in words; an error of the operating system names its file, without the error's number."""
    if isinstance(error, Txt1Error) or not error.strerror:
        return str(error)
    remedy = "; make room on the disk" if error.errno == errno.ENOSPC else ""
    return f"{error.filename}: {error.strerror}{remedy}" if error.filename else f"{error.strerror}{remedy}"


class Parser(argparse.ArgumentParser):
    """argparse's parser; it reports mistakes in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the mistake and exit."""
        wrong = re.match(r"argument (?:COMMAND|ACTION): invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if wrong:
            choices = re.findall(r"[\w-]+", wrong[2])
            near = get_close_matches(wrong[1], choices, 1)
            few = f"; there are {', '.join(choices)}" if len(choices) <= 8 else ""
            message = f"there is no '{wrong[1]}'{f', did you mean {near[0]!r}?' if near else few}"
        self.exit(USAGE, f"txt1: {message}; see '{self.prog} --help'\n")


def parser(named: Collection[str] | None = None) -> argparse.ArgumentParser:
    """Return the parser. Only the named commands have their modules imported, so only their options are known.

    None means every command, including those of other packages' additions.
    """
    if named is None:
        additions.strangers()
    whole = Parser(prog="txt1", description="txt1 runs a robot car, simulated or real.", epilog=EPILOG)
    whole.add_argument("--version", action="version", version=f"txt1 {__version__}")
    owners = {command: addition.name for addition in additions.known().values() for command in addition.commands}
    parsers = whole.add_subparsers(required=True, metavar="COMMAND")
    for name, (place, about) in commands().items():
        command = parsers.add_parser(name, help=about, description=f"{about[0].upper()}{about[1:]}.", epilog=EPILOG)
        if named is None or name in named:
            with additions.blamed(owners.get(name, name), place):
                module = import_module(place)
            command.set_defaults(main=getattr(module, "main", None))
            module.add_arguments(command)
    whole.set_defaults(parsers=parsers.choices)
    return whole


def parsed(argv: Sequence[str]) -> argparse.Namespace:
    """Return the arguments of a command line; a mistake is printed and ends the process (SystemExit)."""
    words = _joined(argv)
    named = next((word for word in words if not word.startswith("-")), "")
    if named not in commands() or not {"-h", "--help"}.isdisjoint(words):
        find_strangers()
    if named not in commands():
        _refuse_missing([named])
    whole = parser({named})
    if not named and not {"-h", "--help"}.isdisjoint(words):
        whole.epilog = _epilog()
    arguments, unknown = whole.parse_known_args(words)
    if unknown and find_strangers():
        whole = parser({named})
        arguments, unknown = whole.parse_known_args(words)
    if unknown:
        _refuse_missing(unknown)
        command = whole.get_default("parsers").get(named, whole)
        actions = command.get_default("parsers") or {}
        asked = next((actions[word] for word in words if word in actions), command)
        late = "; options come first" if "--" in unknown else ""
        near = get_close_matches(unknown[0], [each for action in asked._actions for each in action.option_strings], 1)  # noqa: SLF001
        hint = f"; did you mean '{near[0]}'?" if near else ""
        asked.error(f"unrecognized arguments: {' '.join(unknown)}{hint}{late}")
    return arguments


def _refuse_missing(words: Sequence[str]) -> None:
    """Raise MissingPlugin if one of the words is a command or an option of a plug-in that is not installed."""
    from txt1.unknown import word

    if (error := word(words)) is not None:
        raise error


def _epilog() -> str:
    """Return the end of the program's help: exit codes, and the plug-ins that are not installed."""
    from txt1.unknown import absent

    return f"{EPILOG} Plug-ins that are not installed: {told}." if (told := absent()) else EPILOG


def find_strangers() -> bool:
    """Find the additions of other packages, so that their commands and options are known; warn of unusable ones.

    Returns whether there are any.
    """
    for reason in additions.strangers().wrong.values():
        print(f"txt1: {reason}", file=sys.stderr)
    return bool(additions.strangers().found)


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield the words of every command and of each of its actions, with the parser."""
    for name, command in parser().get_default("parsers").items():
        yield name, command
        for action, each in (command.get_default("parsers") or {}).items():
            yield f"{name} {action}", each


def _joined(argv: Sequence[str]) -> list[str]:
    """Join a negative value to its option, as argparse takes ``-0.5,0.4`` for another option."""
    words: list[str] = []
    for word in argv:
        if words and re.match(r"--[a-z-]+$", words[-1]) and re.match(r"-[\d.]", word):
            words[-1] += f"={word}"
        else:
            words.append(word)
    return words
