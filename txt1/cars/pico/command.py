"""`txt1 firmware`: puts the firmware on a Raspberry Pi Pico, and shows its health."""

from __future__ import annotations

import argparse
import asyncio
from typing import Final

from txt1.cars.pico.installer import LOG, OverMpremote, digests, install, listen, release
from txt1.commands import FAULT, count, say
from txt1.kit.app import App
from txt1.link.ports import only_candidate

RESTART: Final = 3.0
"""s that a board takes until its firmware answers."""
RESET: Final = "import machine\nmachine.reset()"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    for name, main, about in (
        ("install", put, "copy the firmware to a Pico on which MicroPython runs, verify it and start it"),
        ("update", renew, "the same for a board that has our firmware already"),
        ("check", check, "show the program on the board and its faults"),
        ("log", show_log, "print the last fault that the firmware noted"),
    ):
        action = actions.add_parser(name, help=about)
        action.add_argument("--port", metavar="DEV", help="the board's port; by default the only port")
        action.add_argument("--baud", type=count, default=57600, metavar="N", help="57600 by default; USB takes any")
        action.set_defaults(main=main)


def put(arguments: argparse.Namespace) -> int:
    """Install the firmware and print the copied files."""
    return _install(arguments, fresh=True)


def renew(arguments: argparse.Namespace) -> int:
    """Install the firmware on a board that has it already."""
    return _install(arguments, fresh=False)


def _install(arguments: argparse.Namespace, *, fresh: bool) -> int:
    port = arguments.port or only_candidate()
    board = OverMpremote(port)

    async def work() -> None:
        await release(port, arguments.baud)
        if not fresh and (await asyncio.to_thread(digests, board, ["main.py"]))["main.py"] is None:
            app.code = FAULT
            say(f"{port}: there is no firmware to update; 'txt1 firmware install' puts it there")
            return
        done = await asyncio.to_thread(install, board, lambda name: say(f"copying {name}"))
        await asyncio.to_thread(_reset, board)
        await asyncio.sleep(RESTART)
        heard = await listen(port, arguments.baud)
        print(f"{port}: {len(done.copied)} files copied and verified, {len(done.same)} were the same already")
        if heard.identity is None:
            app.code = FAULT
            say(f"{port}: it does not answer after its restart; 'txt1 firmware log' shows its last fault")
        else:
            print(f"{port}: {heard.identity} answers; its settings are as they were")

    app = App()
    return app.run(work())


def _reset(board: OverMpremote) -> None:
    """Restart the board; the connection breaks in the middle of the command."""
    try:
        board.run(RESET)
    except Exception as error:
        # mpremote reports the lost board in several ways
        say(f"restarting ({error.__class__.__name__})")


def check(arguments: argparse.Namespace) -> int:
    """Print the program on the board and its faults."""
    port = arguments.port or only_candidate()

    async def work() -> None:
        heard = await listen(port, arguments.baud)
        if heard.identity is not None:
            print(f"{port}: {heard.identity}")
            print("'txt1 doctor' looks at the line; 'txt1 firmware update' compares every file")
            return
        app.code = FAULT
        if heard.odometry or heard.batteries:
            say(f"{port}: a board without txt1's firmware answers, such as an original board")
        elif heard.octets:
            say(f"{port}: {heard.octets} bytes came that are no answer; is it MicroPython without our firmware?")
        else:
            say(f"{port}: nothing answers; 'txt1 firmware install' puts the firmware there")

    app = App()
    return app.run(work())


def show_log(arguments: argparse.Namespace) -> int:
    """Print the last fault."""
    port = arguments.port or only_candidate()
    board = OverMpremote(port)

    async def work() -> None:
        await release(port, arguments.baud)
        print((await asyncio.to_thread(board.run, LOG)).strip())

    app = App()
    return app.run(work())
