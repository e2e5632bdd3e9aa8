"""`txt1 board`: the simulated vehicle behind a line."""

import argparse
import asyncio
import os
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from functools import partial
from typing import Final

from txt1 import commands
from txt1.board.board import EVENTS, HABITS, Board, BoardEvent, DevicePlace
from txt1.board.original import OUTAGE
from txt1.board.ros_node import BoardNode, board_node
from txt1.commands import flag, say, takes, view_of
from txt1.config import Config, load
from txt1.kit import options
from txt1.kit.app import App, conclude, in_journal
from txt1.kit.far_end import FAR_END, listen
from txt1.link.base import Listener
from txt1.record.options import LOG, VIEW, live_view
from txt1.record.session import recording
from txt1.ros.options import ROS2
from txt1.tasks.fields import LOG as EVENT_LOG
from txt1.ui.terminal import Terminal

# V of each pack after the key b: bad
LOW_BATTERY: Final = 8.7
SHOWN: Final = {
    "q": "quit",
    "?": "help",
    "c": "centre button",
    "e": "ESC",
    "b": f"{LOW_BATTERY} V",
    "r": f"restart {OUTAGE} s",
    "space": "stop",
    "←→": "screen",
    "↑↓": "gains",
}
_STATES: Final = {"off": 0.0, "on": 1.0}
SWITCHED: Final = {
    "esc": "the ESC is",
    "encoders": "the encoders are",
    "right_encoder": "the right encoder is",
    "left_encoder": "the left encoder is",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `board`."""
    device = {"--port": takes("DEV", "a serial device, e.g. one end of a null-modem cable")}
    commands.add(parser.add_mutually_exclusive_group(required=True), FAR_END | device)
    commands.add(
        parser,
        options.CONFIGURATION
        | options.SEED
        | LOG
        | VIEW
        | ROS2
        | {
            "--tui": {
                "dest": "headless",
                "action": "store_false",
                "help": "show the board's screens, not status lines",
            },
            "--manual": flag("start in manual mode, which obeys PWM test"),
            "--as": {
                "dest": "habits",
                "choices": tuple(HABITS),
                "help": "behave like txt1's firmware, or like the boards of 2011 as observed",
            },
            "--event": takes(
                "T:NAME[=VALUE]",
                "let something happen at T s: centre, esc=off, encoders=off, right_encoder=off, left_encoder=off, "
                "battery=V, restart=S (an original board without power for S s); may be repeated",
                board_event,
                action="append",
                default=[],
            ),
            "--fault": takes(
                "KIND=VALUE",
                "put a fault on the line: drop, tear, duplicate (shares of the frames), flip (of the "
                "bits), split=true, merge, delay, jitter, stall, stall_every, cut (s); may be repeated",
                action="append",
                default=[],
            ),
            "--duration": takes("S", "end after S seconds", commands.positive),
            "--json": flag("no status lines; one JSON object at the end"),
        },
    )


def board_event(text: str) -> tuple[float, BoardEvent]:
    """Return the time in s and the event of a word; raises ArgumentTypeError."""
    time, _, event = text.partition(":")
    name, equals, value = event.partition("=")
    if name not in EVENTS or bool(equals) is (name == "centre"):
        raise argparse.ArgumentTypeError(f"'{text}' is no event, such as 12.5:centre, 20:esc=off or 30:restart=0.2")
    number = _STATES.get(value) if name in SWITCHED else commands.positive(value) if equals else 0.0
    if number is None:
        raise argparse.ArgumentTypeError(f"'{text}': {SWITCHED[name]} on or off")
    return commands.positive(time), BoardEvent(name, number)


def keys(board: Board) -> dict[str, Callable[[], None]]:
    """Return the keys that let events happen to the board."""
    vehicle = board.vehicle
    return {
        "e": lambda: board.happen(BoardEvent("esc", float(not vehicle.esc_on))),
        "b": lambda: board.happen(BoardEvent("battery", LOW_BATTERY if vehicle.faults.voltage is None else None)),
        "r": lambda: board.happen(BoardEvent("restart", OUTAGE)),
    }


async def _let_happen(board: Board, events: Sequence[tuple[float, BoardEvent]]) -> None:
    """Let the events happen at their times; raises CommandRefused for an event that cannot happen to this board."""
    for time, event in sorted(events):
        await asyncio.sleep(max(0.0, time - board.now))
        board.happen(event)
    # only an error ends the run
    await asyncio.Future()


def main(arguments: argparse.Namespace) -> int:
    """Run a virtual board until the duration is over, the operator quits or a signal comes."""
    faults = [f"board.fault.{fault}" for fault in arguments.fault]
    habits = {} if arguments.habits is None else {"board.habits": arguments.habits}
    given = habits | ({} if arguments.seed is None else {"seed": arguments.seed})
    config = load(arguments.config, [*arguments.set, *faults], os.environ, given).config
    options.warn_of_baud(config)
    node = board_node(arguments)
    app = App()
    app.run(_serve(app, arguments, config, node))
    return conclude(app, arguments.json)


async def _serve(app: App, arguments: argparse.Namespace, config: Config, node: BoardNode | None) -> None:
    view = await asyncio.to_thread(live_view, arguments)
    told = {"board": True, "duration": arguments.duration}
    board = Board(config, manual=arguments.manual)
    async with (
        recording(arguments.log, config, app.speed, told, say, view) as attach,
        AsyncExitStack() as beside,
    ):
        attach(board.runtime)
        app.subject = board
        listener: Listener
        if arguments.port is None:
            listener = await listen(arguments, board.paced)
        else:
            listener = place = DevicePlace(board, arguments.port)
            await place.open()
        try:
            say(f"a virtual board is at {listener.address}")
            await board.power_up()
            if node is not None:
                await beside.enter_async_context(node(board))
            if arguments.duration is not None:
                board.runtime.scheduler.end_at(arguments.duration)
            # the screens show them anyway
            if view_of(arguments) == "lines" and not in_journal():
                board.runtime.bus.subscribe(lambda topic, event, time: say(event.text), [EVENT_LOG])
            events = asyncio.ensure_future(_let_happen(board, arguments.event))
            terminal = partial(Terminal, board, beat=app.beat, shown=SHOWN, more=keys(board))
            try:
                await app.watch(board.runtime, terminal, view_of(arguments), events)
            finally:
                events.cancel()
        finally:
            await board.power_down()
            listener.close()
    # raises the TaskFault, if there was one
    await board.runtime.scheduler.ended
