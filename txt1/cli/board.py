"""`txt1 board`: the simulated vehicle behind a line."""

import argparse
import os
from functools import partial

from txt1.board import Board, DevicePlace
from txt1.cli import options
from txt1.cli.app import App, conclude, live_view, say, view_of
from txt1.cli.options import flag, takes
from txt1.config import Config, load
from txt1.link.base import Listener
from txt1.link.pty import listen_pty
from txt1.link.tcp import listen_tcp
from txt1.ui.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `board` takes."""
    options.add(parser.add_mutually_exclusive_group(required=True), {
        "--pty": takes("PATH", "a pseudo-terminal with a link to it at PATH"),
        "--port": takes("DEV", "a serial device, e.g. one end of a null-modem cable"),
        "--tcp": takes("[HOST:]PORT", "a TCP port; HOST is 127.0.0.1", options.host_and_port),
    })  # fmt: skip
    options.add(parser, options.CONFIGURATION | options.SEED | options.LOG | options.VIEW | {
        "--tui": {"dest": "headless", "action": "store_false", "help": "show the board's screens, not status lines"},
        "--manual": flag("start in manual mode, which obeys PWM test"),
        "--fault": takes(
            "KIND=VALUE", "put a fault on the line: drop, duplicate (shares of the frames), flip (of the bits), "
            "split=true, delay, jitter, stall, stall_every, cut (s); may be repeated", action="append", default=[],
        ),
        "--duration": takes("S", "end after S seconds", options.positive),
        "--json": flag("no status lines; one JSON object at the end"),
    })  # fmt: skip


def main(arguments: argparse.Namespace) -> int:
    """Run a virtual board until the duration is over, the operator quits or a signal comes."""
    faults = [f"board.fault.{fault}" for fault in arguments.fault]
    given = {} if arguments.seed is None else {"seed": arguments.seed}
    config = load(arguments.config, [*arguments.set, *faults], os.environ, given).config
    options.warn_of_baud(config)
    app = App()
    app.run(_serve(app, arguments, config))
    return conclude(app, arguments.json)


async def _serve(app: App, arguments: argparse.Namespace, config: Config) -> None:
    view = await live_view(arguments)
    told = {"board": True, "duration": arguments.duration}
    async with app.board(Board(config, manual=arguments.manual), log=arguments.log, about=told, view=view) as board:
        listener: Listener
        if arguments.pty is not None:
            listener = listen_pty(arguments.pty, board.paced)
        elif arguments.tcp is not None:
            host, port = arguments.tcp
            listener = await listen_tcp(host, port, board.paced)
        else:
            listener = place = DevicePlace(board, arguments.port)
            await place.open()
        try:
            say(f"a virtual board is at {listener.address}")
            await board.power_up()
            if arguments.duration is not None:
                board.runtime.scheduler.end_at(arguments.duration)
            await app.watch(board.runtime, partial(Terminal, board, beat=app.beat), view_of(arguments))
        finally:
            await board.power_down()
            listener.close()
