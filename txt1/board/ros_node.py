"""A virtual board's end of its node of ROS 2: it sends all telemetry, and takes actions of a person at the board.

It takes no velocities: they come from the host on its line.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Any

from txt1.board.board import Board, BoardEvent
from txt1.errors import ConfigError, Txt1Error
from txt1.hal.base import Button
from txt1.ros.calls import Calls
from txt1.ros.node import node_beside
from txt1.ros.publisher import Publisher
from txt1.ros.robot_node import NODE, ros2_python
from txt1.sidecar import Request

BoardNode = Callable[[Board], AbstractAsyncContextManager[Any]]
"""Makes a board a node of ROS until the block is left."""


class BoardDesk:
    """Sends messages, and carries out requests."""

    offers = ("arm", "disarm", "stop", "manual", "power_esc", "place")
    """Services of the node."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._feed = Publisher(board.runtime, self.say)
        self._calls = Calls(
            {
                "arm": board.arm,
                "disarm": lambda: board.disarm("disarmed by ROS"),
                "stop": board.stop,
                "manual": self._manual,
                "power": lambda switch, on: board.happen(BoardEvent(switch, float(on))),
                "place": board.runtime.place,
            }
        )
        self._requests: dict[str, Callable[..., object]] = {
            "begin": self._feed.begin,
            "missing": self._feed.missing,
            "call": self._calls.call,
            "cancel": self._calls.cancel,
        }

    def telemetry(self) -> bytes | None:
        """Return all messages since the last call, and answers; None if there are none."""
        return self._feed.line({"answers": self._calls.take()})

    def request(self, request: Request) -> None:
        """Carry out a request, or tell why not."""
        do = self._requests.get(request.name)
        try:
            if do is not None:
                do(**request.fields)
        except Txt1Error as error:
            self.say(f": {error}")
        except Exception as error:
            # no request ends the node
            self.say(f": request '{request.name}' failed: {type(error).__name__}: {error}")

    def say(self, text: str) -> None:
        """Add a line about the node to the event log."""
        self._board.tell(f"ROS{text}")

    def lost(self) -> None:
        """Note that the node has gone, and collect nothing."""
        self._feed.end()
        self._calls.clear()

    def _manual(self, manual: bool) -> None:
        if (self._board.runtime.state.panel.manual is True) is not manual:
            self._board.press(Button.CENTRE)


def board_node(arguments: argparse.Namespace) -> BoardNode | None:
    """Return the function that makes a virtual board a node of ROS 2, None if not requested; raises ConfigError
    without ROS 2.
    """
    if not arguments.ros2:
        if arguments.ros2_namespace or arguments.ros2_best_effort:
            raise ConfigError("--ros2-namespace, --ros2-best-effort: there is no node; add --ros2")
        return None
    python = ros2_python()

    def node(board: Board) -> AbstractAsyncContextManager[Any]:
        desk = BoardDesk(board)
        options = {
            "name": "txt1_board",
            "namespace": arguments.ros2_namespace or "",
            "offers": desk.offers,
            "best_effort": arguments.ros2_best_effort,
        }
        return node_beside(board.runtime, desk, NODE, python, options)

    return node
