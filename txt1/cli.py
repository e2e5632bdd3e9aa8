"""The command line. Nothing else in the package ends the process.

Exit codes: 0 the run ended as asked; 1 a fault: the hardware or a task failed, or the terminal was lost; 2 a mistake
in the command line or the configuration; 3 the safety gate disarmed the robot during the run; 129, 130 and 143 ended
by SIGHUP, SIGINT (Ctrl-C) and SIGTERM, outputs neutral.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import select
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from functools import partial
from math import isfinite
from typing import Any, NoReturn

from txt1 import __version__
from txt1.config import Config, LoadedConfig, flatten, load, origin_of
from txt1.control.limits import Fault
from txt1.errors import CaptureError, ConfigError, HalError, Txt1Error
from txt1.hal.conformance import BROKEN, verdicts
from txt1.hal.registry import create, names
from txt1.kernel.loop import Speed, run
from txt1.kernel.scheduler import Ticks
from txt1.kernel.statistics import TaskStatistics
from txt1.protocol import listing
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role
from txt1.robot import REFRESH, Robot
from txt1.ui.terminal import Terminal

OK, FAULT, USAGE, DISARMED = 0, 1, 2, 3
STDOUT = 1
CHUNK = 1 << 16
"""Bytes of a capture that are read at a time."""
SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
BEAT_MIN = 0.005
"""Shortest time between two heartbeats of the drawing process, s."""
DISARMING = (Fault.LINK, Fault.MISSED, Fault.RUNAWAY, Fault.ODOMETRY, Fault.BATTERY)


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
    run_parser.add_argument("--hal", metavar="NAME", help="hardware layer, e.g. sim")
    run_parser.add_argument("--seed", type=int, metavar="N", help="repeats every random value of a simulation")
    run_parser.add_argument("--duration", type=_positive, metavar="S", help="end after S seconds of the robot's time")
    run_parser.add_argument(
        "--speed", type=_speed, metavar="N|max",
        help="virtual time, N times as fast as real time or as fast as possible; simulation only",
    )  # fmt: skip
    run_parser.add_argument("--headless", action="store_true", help="no screens; one status line a second")
    run_parser.add_argument("--json", action="store_true", help="no screens; one JSON object at the end")
    run_parser.add_argument(
        "--drive", type=_velocity, metavar="V,OMEGA", help="command this velocity throughout: m/s, rad/s"
    )
    arming = run_parser.add_mutually_exclusive_group()
    arming.add_argument("--arm", action="store_true", default=None, help="arm at the start")
    arming.add_argument("--no-arm", action="store_false", dest="arm", help="do not arm, not even in simulation")
    run_parser.set_defaults(command=run_robot)

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

    hal_parser = commands.add_parser("hal", help="list or check hardware layers")
    actions = hal_parser.add_subparsers(required=True, metavar="ACTION")
    actions.add_parser("list", help="print the names of those that are installed").set_defaults(command=list_hals)
    check = actions.add_parser("check", help="run one through the conformance suite; wheels off the ground, it drives")
    check.add_argument("name", metavar="NAME")
    _add_config_arguments(check)
    check.set_defaults(command=check_hal)
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


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not finite")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not positive")
    return value


def _speed(text: str) -> Speed:
    return "max" if text == "max" else _positive(text)


def _velocity(text: str) -> tuple[float, float]:
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not V,OMEGA, for example 0.5,0.3")
    return _number(parts[0]), _number(parts[1])


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
    for text, verdict in verdicts(lambda: create(config)):
        kept = kept and not verdict.startswith(BROKEN)
        print(f"{text}: {verdict}")
    return OK if kept else FAULT


# -- txt1 run --------------------------------------------------------------------------------------------------


def run_robot(arguments: argparse.Namespace) -> int:
    """Run the robot until the duration is over, the operator quits or a signal comes."""
    options = {name: value for name in ("hal", "seed") if (value := getattr(arguments, name)) is not None}
    loaded = load(arguments.config, arguments.set, os.environ, options)
    speed: Speed = arguments.speed
    ending = _Ending()
    with suppress(asyncio.CancelledError):
        run(_run(arguments, loaded, ending), speed=speed)
    if ending.report is not None:
        print(json.dumps(ending.report))
    if ending.code == DISARMED:
        print(f"txt1: the robot was stopped: {ending.reason or 'see the counters'}", file=sys.stderr)
    return ending.code


class _Ending:
    """How a run ended."""

    def __init__(self) -> None:
        self.code = OK
        self.reason = ""
        self.robot: Robot | None = None
        self.report: dict[str, Any] | None = None

    def interrupt(self, number: signal.Signals, main: asyncio.Task[Any], loop: asyncio.AbstractEventLoop) -> None:
        """End the run because of a signal; a second one is not caught any more."""
        self.code = 128 + number
        if self.robot is not None:
            self.robot.disarm("ended by a signal")
        for each in SIGNALS:
            loop.remove_signal_handler(each)
        main.cancel()


async def _run(arguments: argparse.Namespace, loaded: LoadedConfig, ending: _Ending) -> None:
    loop, main_task = asyncio.get_running_loop(), asyncio.current_task()
    assert main_task is not None
    for number in SIGNALS:
        loop.add_signal_handler(number, partial(ending.interrupt, number, main_task, loop))
    async with Robot.open(config=loaded.config, arm=arguments.arm) as robot:
        ending.robot = robot
        if not await robot.load_gains():
            raise HalError("the board did not accept the gains; check control.linear and control.angular")
        if arguments.drive is not None:
            robot.add_task("script", REFRESH, partial(_script, robot=robot, velocity=arguments.drive))
        if arguments.duration is not None:
            robot.runtime.scheduler.end_at(arguments.duration)
        try:
            await _watch(robot, arguments, loaded.config, ending)
        finally:  # an interrupted run has its report, too
            ending.reason = robot.reason
            if arguments.json:
                ending.report = report(robot)
        if ending.code == OK and any(robot.runtime.gate.counts[fault] for fault in DISARMING):
            ending.code = DISARMED


async def _script(ticks: Ticks, robot: Robot, velocity: tuple[float, float]) -> None:
    """Command a constant velocity."""
    async for _ in ticks:
        robot.command(*velocity)


async def _watch(robot: Robot, arguments: argparse.Namespace, config: Config, ending: _Ending) -> None:
    """Let the operator see and drive the robot until the run ends."""
    ended = robot.runtime.scheduler.ended
    if arguments.json:
        await asyncio.wait({ended})
        return
    screens = not arguments.headless and arguments.speed != "max" and sys.stdin.isatty() and sys.stdout.isatty()
    if screens:
        robot.runtime.watched = True
        beat = max(0.05 / max(arguments.speed or 1.0, 1.0), BEAT_MIN)
        teleop, radius_min = config.teleop, config.geometry.radius_min
        async with Terminal(robot, beat, teleop.speed, teleop.turn, radius_min) as terminal:
            operator = asyncio.ensure_future(terminal.wait())
            await _first_of(ended, operator)
            quit_by_operator = operator.done() and operator.result() == "quit"
            operator.cancel()
            robot.disarm("the run has ended")  # before the screens are put away, which takes its time
        if quit_by_operator or ended.done():
            return
        print("txt1: the terminal was lost and the robot disarmed; Ctrl-C ends the run", file=sys.stderr)
        ending.code = FAULT
    lines = asyncio.ensure_future(_status_lines(robot))
    await _first_of(ended, lines)
    if lines.done():
        lines.result()
    lines.cancel()


async def _first_of(*futures: asyncio.Future[Any]) -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)


async def _status_lines(robot: Robot) -> None:
    """Print one status line a second; a reader that has stopped reading misses some, it never holds up the robot."""
    sys.stdout.flush()
    while True:
        _, writable, _ = select.select([], [STDOUT], [], 0.0)  # a pipe is writable while a line fits
        if writable:
            os.write(STDOUT, f"{status_line(robot)}\n".encode())
        await asyncio.sleep(1.0)


def status_line(robot: Robot) -> str:
    """The robot's state in one line."""
    x, y, theta, v, omega = robot.odometry
    state = "armed" if robot.armed else f"disarmed: {robot.reason}"
    battery = "-" if robot.battery.battery1 is None else f"{robot.battery.battery1:.2f} V"
    return (
        f"t={robot.now:8.2f} s  x={x:+.3f} m  y={y:+.3f} m  theta={theta:+.3f} rad  "
        f"v={v:+.3f} m/s  omega={omega:+.3f} rad/s  battery={battery}  {state}"
    )


def report(robot: Robot) -> dict[str, Any]:
    """What `run --json` prints. Of it, `wall_time_s` and `run_time_s` are measured on the wall clock."""
    battery = robot.battery
    return {
        "sim_time_s": round(robot.now, 9),
        "wall_time_s": robot.runtime.scheduler.wall_time,
        "seed": robot.config.seed,
        "tasks": {name: _task_report(task) for name, task in robot.runtime.statistics().items()},
        "odometry": robot.odometry._asdict(),
        "battery": {**battery._asdict(), "state": battery.state and battery.state.value},
        "armed": robot.armed,
        "faults": robot.faults,
    }


def _task_report(task: TaskStatistics) -> dict[str, Any]:
    return {
        "cycles": task.cycles,
        "misses": task.misses,
        "lateness_s": task.lateness.percentiles()._asdict(),
        "run_time_s": task.run_time.percentiles()._asdict(),
    }
