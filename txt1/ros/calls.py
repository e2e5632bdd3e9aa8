"""Calls of a node to the robot, with an answer: both ends."""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from typing import TYPE_CHECKING, Any, Final

from txt1.errors import Txt1Error

if TYPE_CHECKING:
    from txt1.sidecar import Connection

CANCELLED: Final = "cancelled"
# s within which the robot answers
ANSWER_PATIENCE: Final = 10.0


class Calls:
    """The robot's end: carries out calls, and keeps their answers until they are sent."""

    def __init__(self, functions: Mapping[str, Callable[..., object]]) -> None:
        self.answers: list[tuple[int, bool, str]] = []
        """Answers: number of the call, whether it succeeded, and its result, or the reason for its failure."""
        self._functions = functions
        self._tasks: dict[int, asyncio.Task[None]] = {}

    def take(self) -> list[tuple[int, bool, str]]:
        """Return the answers since the last call of this method."""
        answers, self.answers = self.answers, []
        return answers

    def call(self, id: int, name: str, fields: Mapping[str, Any]) -> None:
        """Carry out a call, and answer when it is done; the request of this name."""
        task = self._tasks[id] = asyncio.ensure_future(self._answer(id, name, fields))
        task.add_done_callback(lambda _: self._tasks.pop(id, None))

    def cancel(self, id: int) -> None:
        """Cancel a call, which is answered with False; the request of this name."""
        if id in self._tasks:
            self._tasks[id].cancel()

    def clear(self) -> None:
        """Discard all answers: the node has gone."""
        for task in tuple(self._tasks.values()):
            task.cancel()
        self.answers.clear()

    async def _answer(self, id: int, name: str, fields: Mapping[str, Any]) -> None:
        try:
            told = self._functions[name](**fields)
            if inspect.isawaitable(told):
                told = await told
            self.answers.append((id, True, "" if told is None else str(told)))
        except Txt1Error as error:
            self.answers.append((id, False, str(error)))
        except Exception as error:
            # an error in a call does not end the run
            self.answers.append((id, False, f"{type(error).__name__}: {error}"))
        except asyncio.CancelledError:
            self.answers.append((id, False, CANCELLED))
            raise


class Caller:
    """The node's end. The thread that receives the robot's messages passes answers to `answered`."""

    def __init__(self, robot: Connection) -> None:
        self._robot = robot
        self._ids = count(1)
        self._waiting: dict[int, tuple[threading.Event, list[Any]]] = {}

    def ask(self, name: str, **fields: Any) -> None:
        """Send the robot a call without waiting for the answer."""
        self._robot.request("call", id=next(self._ids), name=name, fields=fields)

    def call(self, name: str, **fields: Any) -> tuple[bool, str]:
        """Call the robot; return whether it succeeded, and its result or the reason for its failure."""
        return self._call(name, fields, ANSWER_PATIENCE, None)

    def watched(self, name: str, look: float, ends: Callable[[], bool], **fields: Any) -> tuple[bool, str]:
        """Call as `call`, for long actions: every `look` s `ends` is asked whether to cancel."""
        return self._call(name, fields, look, ends)

    def _call(
        self, name: str, fields: Mapping[str, Any], look: float, ends: Callable[[], bool] | None
    ) -> tuple[bool, str]:
        number = next(self._ids)
        event, answer = self._waiting[number] = threading.Event(), []
        try:
            self._robot.request("call", id=number, name=name, fields=fields)
            while not event.wait(look):
                if ends is None:
                    return False, f"the robot did not answer within {look:g} s"
                if ends():
                    self._robot.request("cancel", id=number)
            return answer[0], answer[1]
        finally:
            del self._waiting[number]

    def answered(self, answers: Sequence[tuple[int, bool, str]]) -> None:
        """Pass answers to the waiting calls."""
        for number, done, text in answers:
            waiting = self._waiting.get(number)
            if waiting is not None:
                waiting[1].extend((done, text))
                waiting[0].set()
