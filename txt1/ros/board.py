"""A virtual board's end of its node of ROS 2: it tells everything, and takes what somebody at the board could do.

It takes no velocities: those come from the host at its line.
"""

from __future__ import annotations

from collections.abc import Callable

from txt1.board.board import Board, BoardEvent
from txt1.errors import Txt1Error
from txt1.hal.base import Button
from txt1.ros.calls import Calls
from txt1.ros.publisher import Publisher
from txt1.sidecar import Request


class BoardDesk:
    """Hands out messages, and does what is asked for."""

    offers = ("arm", "disarm", "stop", "manual", "power_esc", "place")
    """What the node serves."""

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
        """All messages since the last time, and answers; None when there is nothing."""
        return self._feed.line({"answers": self._calls.take()})

    def request(self, request: Request) -> None:
        """Do what is asked for, or tell why not."""
        do = self._requests.get(request.name)
        try:
            if do is not None:
                do(**request.fields)
        except Txt1Error as error:
            self.say(f": {error}")
        except Exception as error:
            # whatever it asks for, the node lives on
            self.say(f": request '{request.name}' failed: {type(error).__name__}: {error}")

    def say(self, text: str) -> None:
        """Add a line about the node to the event log."""
        self._board.tell(f"ROS{text}")

    def lost(self) -> None:
        """The node has gone: collect nothing."""
        self._feed.end()
        self._calls.clear()

    def _manual(self, manual: bool) -> None:
        if (self._board.runtime.state.panel.manual is True) is not manual:
            self._board.press(Button.CENTRE)
