"""The command line. Nothing else in the package ends the process.

Exit codes: 0 the run ended as asked; 1 a fault: the hardware or a task failed, or the terminal was lost; 2 a mistake
in the command line or the configuration; 3 the safety gate disarmed the robot during the run; 129, 130 and 143 ended
by SIGHUP, SIGINT (Ctrl-C) and SIGTERM, outputs neutral.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

from txt1 import __version__, doctor, session
from txt1.board import VIRTUAL, create_hal, on_device, on_pty, on_tcp, port_of
from txt1.command_line import DISARMED, FAULT, OK, USAGE, number, positive
from txt1.config import Config, flatten, load, origin_of
from txt1.conformance import BROKEN
from txt1.errors import CaptureError, ConfigError, Txt1Error
from txt1.experiments.command import add_commands as add_experiment_commands
from txt1.hal.conformance import verdicts
from txt1.hal.link import baud_warning
from txt1.hal.ports import only_candidate
from txt1.hal.registry import names
from txt1.kernel.loop import Speed, run
from txt1.learning.command import add_command as add_learning_command
from txt1.protocol import listing
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role
from txt1.record import command as record_command
from txt1.session import Ending, Plan, View

STDOUT = 1
CHUNK = 1 << 16
"""Bytes of a capture that are read at a time."""


def main() -> NoReturn:
    """Run the command given on the command line and exit with its code."""
    sys.exit(execute(sys.argv[1:]))


def execute(argv: Sequence[str]) -> int:
    """The exit code of a command given as words."""
    arguments = _parser().parse_args(argv)
    try:
        code: int = arguments.command(arguments)
        sys.stdout.flush()
        return code
    except ConfigError as error:
        return _complain(error, USAGE)
    except Txt1Error as error:
        return _complain(error, FAULT)
    except BrokenPipeError:  # whoever read the output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
        return FAULT
    except OSError as error:
        return _complain(error, FAULT)
    except KeyboardInterrupt:  # a second Ctrl-C while the first one's stop was under way
        return 128 + signal.SIGINT


def _complain(error: Exception, code: int) -> int:
    print(f"txt1: {error}", file=sys.stderr)
    return code


# -- the words -------------------------------------------------------------------------------------------------


class _Parser(argparse.ArgumentParser):
    """argparse's parser, with mistakes told in one line."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and exit with code 2."""
        self.exit(USAGE, f"txt1: {message}; see '{self.prog} --help'\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="txt1", description="The runtime of the TXT-1 laboratory robot.", epilog=_EXIT_CODES)
    parser.add_argument("--version", action="version", version=f"txt1 {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run_parser = commands.add_parser("run", help="run the robot, on the desk or on the floor", epilog=_EXIT_CODES)
    _add_config_arguments(run_parser)
    run_parser.add_argument("--hal", metavar="NAME", help="hardware layer: sim, serial, or one from another package")
    run_parser.add_argument(
        "--port", metavar="PORT",
        help="where the board is (--hal serial): a device, socket://HOST:PORT, or virtual for one in this process; "
        "left out, the only device there is",
    )  # fmt: skip
    run_parser.add_argument("--baud", type=int, metavar="N", help="bits a second of the line, 57600 by default")
    run_parser.add_argument("--seed", type=int, metavar="N", help="repeats every random value of a simulation")
    run_parser.add_argument("--duration", type=positive, metavar="S", help="end after S seconds of the robot's time")
    run_parser.add_argument(
        "--speed", type=_speed, metavar="N|max",
        help="virtual time, N times as fast as real time or as fast as possible; simulation only",
    )  # fmt: skip
    run_parser.add_argument("--headless", action="store_true", help="no screens; one status line a second")
    run_parser.add_argument("--json", action="store_true", help="no screens; one JSON object at the end")
    _add_log_argument(run_parser)
    _add_view_arguments(run_parser)
    run_parser.add_argument("--view-control", action="store_true", help="let the live view's teleop panel drive")
    script = run_parser.add_mutually_exclusive_group()
    script.add_argument(
        "--drive", type=_velocity, metavar="V,OMEGA", help="command this velocity throughout: m/s, rad/s"
    )
    script.add_argument("--learn", metavar="AGENT", help="let this learner learn to find the light (see txt1 learn)")
    script.add_argument("--policy", type=Path, metavar="FILE", help="drive to the light by a learned qtable.json")
    arming = run_parser.add_mutually_exclusive_group()
    arming.add_argument("--arm", action="store_true", default=None, help="arm at the start")
    arming.add_argument("--no-arm", action="store_false", dest="arm", help="do not arm, not even in simulation")
    run_parser.set_defaults(command=run_robot)

    board_parser = commands.add_parser(
        "board", help="be a board: the simulated vehicle behind a line, for --hal serial or any other host",
        epilog=_EXIT_CODES,
    )  # fmt: skip
    _add_config_arguments(board_parser)
    place = board_parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--pty", metavar="PATH", help="a pseudo-terminal with a link to it at PATH")
    place.add_argument("--port", metavar="DEV", help="a serial device, e.g. one end of a null-modem cable")
    place.add_argument("--tcp", type=_host_and_port, metavar="[HOST:]PORT", help="a TCP port; HOST is 127.0.0.1")
    board_parser.add_argument("--tui", action="store_true", help="show the board's screens")
    board_parser.add_argument("--manual", action="store_true", help="start in manual mode, which obeys PWM test")
    board_parser.add_argument(
        "--fault", action="append", default=[], metavar="KIND=VALUE",
        help="put a fault on the line: drop, duplicate (shares of the frames), flip (of the bits), split=true, delay, "
        "jitter, stall, stall_every, cut (s); may be repeated",
    )  # fmt: skip
    board_parser.add_argument("--seed", type=int, metavar="N", help="repeats every random value")
    board_parser.add_argument("--duration", type=positive, metavar="S", help="end after S seconds")
    _add_log_argument(board_parser)
    _add_view_arguments(board_parser)
    board_parser.add_argument("--json", action="store_true", help="no status lines; one JSON object at the end")
    board_parser.set_defaults(command=run_board, headless=True)

    doctor_parser = commands.add_parser("doctor", help="look for what is wrong with the line to the board")
    _add_config_arguments(doctor_parser)
    doctor_parser.add_argument("--port", metavar="PORT", help="as with run; left out, the only device there is")
    doctor_parser.add_argument("--baud", type=int, metavar="N", help="bits a second of the line, 57600 by default")
    doctor_parser.add_argument("--duration", type=positive, default=5.0, metavar="S", help="of listening; 5 by default")
    doctor_parser.set_defaults(command=examine_line)

    config_parser = commands.add_parser("config", help="show or check a configuration")
    actions = config_parser.add_subparsers(required=True, metavar="ACTION")
    show = actions.add_parser("show", help="print every value in force and where it came from")
    _add_config_arguments(show)
    show.set_defaults(command=show_config)
    check = actions.add_parser("check", help="say whether a file is a valid configuration")
    check.add_argument("file", metavar="FILE")
    check.set_defaults(command=check_config)

    decode_parser = commands.add_parser("decode", help="print a capture of the line, a line per message and fault")
    decode_parser.add_argument("file", metavar="FILE", help="the captured bytes; - for standard input")
    decode_parser.add_argument("--role", choices=("host", "board"), required=True, help="whose receiver read them")
    decode_parser.add_argument("--hex", action="store_true", help="the file is hexadecimal text")
    decode_parser.add_argument("--json", action="store_true", help="one JSON object a line")
    decode_parser.set_defaults(command=decode_capture)

    record_command.add_commands(commands)

    hal_parser = commands.add_parser("hal", help="list or check hardware layers")
    actions = hal_parser.add_subparsers(required=True, metavar="ACTION")
    actions.add_parser("list", help="print the names of those that are installed").set_defaults(command=list_hals)
    check = actions.add_parser("check", help="run one through the conformance suite; wheels off the ground, it drives")
    check.add_argument("name", metavar="NAME")
    _add_config_arguments(check)
    check.set_defaults(command=check_hal)
    add_experiment_commands(commands, _add_config_arguments, _speed)
    add_learning_command(commands, _add_config_arguments, _speed)
    return parser


_EXIT_CODES = (
    "Exit codes: 0 ended as asked, 1 fault, 2 mistake in command line or configuration, "
    "3 the safety gate disarmed the robot, 129/130/143 ended by SIGHUP/SIGINT/SIGTERM."
)


def _add_config_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", metavar="FILE", help="YAML file, e.g. config/txt1.yaml")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE",
        help="set one value, e.g. --set control.linear.kp=9; may be repeated",
    )  # fmt: skip


def _add_log_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--log", type=Path, metavar="FILE", help="record everything to this MCAP file")


def _add_view_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--view", nargs="?", type=_host_and_port, const=("127.0.0.1", 8765), metavar="[HOST:]PORT",
        help="serve the Foxglove protocol; 127.0.0.1:8765, and other than loopback addresses with a token only",
    )  # fmt: skip
    parser.add_argument(
        "--view-token", type=Path, metavar="FILE",
        help="clients have to present the token in FILE, which is made if there is none: ws://HOST:PORT/?token=TOKEN",
    )  # fmt: skip


def _require_view(arguments: argparse.Namespace, *options: str) -> None:
    """Nothing happens unless an option about the live view is given without one."""
    for option in options:
        if arguments.view is None and getattr(arguments, option):
            raise ConfigError(f"--{option.replace('_', '-')}: there is no live view; add --view")


def _speed(text: str) -> Speed:
    return "max" if text == "max" else positive(text)


def _host_and_port(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not HOST:PORT, for example 127.0.0.1:5701")
    return host.strip("[]") or "127.0.0.1", int(port)


def _velocity(text: str) -> tuple[float, float]:
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not V,OMEGA, for example 0.5,0.3")
    return number(parts[0]), number(parts[1])


# -- txt1 config -----------------------------------------------------------------------------------------------


def show_config(arguments: argparse.Namespace) -> int:
    """Print the effective configuration, every value with its origin."""
    loaded = load(arguments.config, arguments.set, os.environ)
    rows = [(f"{key}:", json.dumps(value), origin_of(key, loaded.origins)) for key, value in flatten(loaded.config)]
    key_width = max(len(key) for key, _, _ in rows)
    value_width = max((len(value) for _, value, _ in rows if len(value) <= 24), default=0)
    for key, value, origin in rows:
        print(f"{key:<{key_width}}  {value:<{value_width}}  # {origin}")
    return OK


def check_config(arguments: argparse.Namespace) -> int:
    """Say whether a file is a valid configuration."""
    load(arguments.file)
    print(f"{arguments.file}: valid")
    return OK


# -- txt1 decode -----------------------------------------------------------------------------------------------


def decode_capture(arguments: argparse.Namespace) -> int:
    """Print a capture of the line as one line per message and fault, and a summary on standard error."""
    decoder = Decoder(Role.HOST if arguments.role == "host" else Role.BOARD)
    show = listing.as_json if arguments.json else listing.describe
    try:
        with ExitStack() as stack:
            file = sys.stdin.buffer if arguments.file == "-" else stack.enter_context(open(arguments.file, "rb"))
            lines = (line.decode("ascii", "replace") for line in file)
            reads = listing.read_hex(lines) if arguments.hex else iter(lambda: file.read(CHUNK), b"")
            for offset, event in listing.decode(decoder, reads):
                print(show(offset, event))
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            raise
        raise ConfigError(f"{arguments.file}: cannot read the capture: {error.strerror}") from None
    except CaptureError as error:
        raise ConfigError(f"{arguments.file}: {error}; without --hex the file is read as raw bytes") from None
    print(listing.summary(decoder), file=sys.stderr)
    return OK


# -- txt1 hal --------------------------------------------------------------------------------------------------


def list_hals(arguments: argparse.Namespace) -> int:
    """Print the names of the hardware layers that are installed."""
    del arguments
    print("\n".join(names()))
    return OK


def check_hal(arguments: argparse.Namespace) -> int:
    """Run a hardware layer through the conformance suite."""
    config = load(arguments.config, arguments.set, os.environ, {"hal": arguments.name}).config
    kept = True
    for text, verdict in verdicts(lambda: create_hal(config)):
        kept = kept and not verdict.startswith(BROKEN)
        print(f"{text}: {verdict}")
    return OK if kept else FAULT


# -- txt1 run --------------------------------------------------------------------------------------------------


def run_robot(arguments: argparse.Namespace) -> int:
    """Run the robot until the duration is over, the operator quits or a signal comes."""
    options = {name: value for name in ("hal", "seed") if (value := getattr(arguments, name)) is not None}
    options |= {f"serial.{name}": value for name in ("port", "baud") if (value := getattr(arguments, name)) is not None}
    if arguments.hal is None and {"serial.port", "serial.baud"} & options.keys():
        options["hal"] = "serial"
    config = load(arguments.config, arguments.set, os.environ, options).config
    if config.hal == "serial":
        _warn_of_baud(config)
    elif "serial.port" in options:
        raise ConfigError(f"--port {arguments.port}: only --hal serial has a port, not '{config.hal}'; leave one out")
    plan = Plan(
        arguments.speed, arguments.duration, _view(arguments), arguments.arm, arguments.drive, arguments.log,
        arguments.learn, arguments.policy, arguments.view, arguments.view_control, arguments.view_token,
    )  # fmt: skip
    _require_view(arguments, "view_control", "view_token")
    return _conclude(session.run_robot(config, plan), arguments)


def _warn_of_baud(config: Config) -> None:
    warning = baud_warning(config.serial.baud)
    if warning is not None:
        print(f"txt1: serial.baud: {warning}", file=sys.stderr)


def _view(arguments: argparse.Namespace) -> View:
    return "nothing" if arguments.json else "lines" if arguments.headless else "screens"


def _conclude(ending: Ending, arguments: argparse.Namespace) -> int:
    """Print what remains to be said; the exit code."""
    if arguments.json and ending.report is not None:
        print(json.dumps(ending.report))
    if ending.code == DISARMED:
        print(f"txt1: the robot was stopped: {ending.reason or 'see the counters'}", file=sys.stderr)
    return ending.code


# -- txt1 board ------------------------------------------------------------------------------------------------


def run_board(arguments: argparse.Namespace) -> int:
    """Run a virtual board until the duration is over, the operator quits or a signal comes."""
    options = {} if arguments.seed is None else {"seed": arguments.seed}
    faults = [f"board.fault.{fault}" for fault in arguments.fault]
    config = load(arguments.config, [*arguments.set, *faults], os.environ, options).config
    _warn_of_baud(config)
    if arguments.pty is not None:
        place = on_pty(config, arguments.pty)
    elif arguments.tcp is not None:
        place = on_tcp(config, *arguments.tcp)
    else:
        place = on_device(config, arguments.port)
    _require_view(arguments, "view_token")
    plan = Plan(
        duration=arguments.duration, view="screens" if arguments.tui else _view(arguments), log=arguments.log,
        serve=arguments.view, serve_token=arguments.view_token,
    )  # fmt: skip
    return _conclude(session.run_board(config, plan, place, manual=arguments.manual), arguments)


# -- txt1 doctor -----------------------------------------------------------------------------------------------


def examine_line(arguments: argparse.Namespace) -> int:
    """Say in words what is wrong with the ports and the line to the board."""
    options = {f"serial.{name}": value for name in ("port", "baud") if (value := getattr(arguments, name)) is not None}
    config = load(arguments.config, arguments.set, os.environ, options | {"hal": "serial"}).config
    found: list[bool] = []
    if config.serial.port is None:
        found = [_say(remark) for remark in doctor.ports()]
        options["serial.port"] = only_candidate()
        config = load(arguments.config, arguments.set, os.environ, options | {"hal": "serial"}).config
    port = port_of(config)
    _warn_of_baud(config)
    print(f"talking to {port.address} at {config.serial.baud} baud; set-points are 0, so nothing moves")
    speed: Speed = "max" if config.serial.port == VIRTUAL else None
    findings = run(doctor.examine(port, config.loops().pid_set(), arguments.duration), speed=speed)
    found += [_say(remark) for remark in doctor.remarks(findings, config.serial.baud)]
    print("all is well" if all(found) else "see the lines marked with !")
    return OK if all(found) else FAULT


def _say(remark: doctor.Remark) -> bool:
    """Print a remark; whether what it says is well."""
    print(f"{' ' if remark.well else '!'} {remark.subject:<9} {remark.text}")
    return remark.well
