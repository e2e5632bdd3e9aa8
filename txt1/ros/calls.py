"""What a node asks the robot to do, with an answer: both ends."""

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
    """The robot's end: does what is asked for, and keeps the answers until they are sent."""

    def __init__(self, functions: Mapping[str, Callable[..., object]]) -> None:
        self.answers: list[tuple[int, bool, str]] = []
        """Of which call, whether it was done, and if not why, else what it returned."""
        self._functions = functions
        self._tasks: dict[int, asyncio.Task[None]] = {}

    def take(self) -> list[tuple[int, bool, str]]:
        """The answers since the last time."""
        answers, self.answers = self.answers, []
        return answers

    def call(self, id: int, name: str, fields: Mapping[str, Any]) -> None:
        """Do something, and answer when it is done: the request of this name."""
        task = self._tasks[id] = asyncio.ensure_future(self._answer(id, name, fields))
        task.add_done_callback(lambda _: self._tasks.pop(id, None))

    def cancel(self, id: int) -> None:
        """End what is still being done, answered with False: the request of this name."""
        if id in self._tasks:
            self._tasks[id].cancel()

    def clear(self) -> None:
        """Nobody waits for answers any more."""
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
            # whatever a node asks for does not end the run
            self.answers.append((id, False, f"{type(error).__name__}: {error}"))
        except asyncio.CancelledError:
            self.answers.append((id, False, CANCELLED))
            raise


class Caller:
    """The node's end; a thread that takes the robot's messages hands answers to `answered`."""

    def __init__(self, robot: Connection) -> None:
        self._robot = robot
        self._ids = count(1)
        self._waiting: dict[int, tuple[threading.Event, list[Any]]] = {}

    def ask(self, name: str, **fields: Any) -> None:
        """Have the robot do something, and wait for no answer."""
        self._robot.request("call", id=next(self._ids), name=name, fields=fields)

    def call(self, name: str, **fields: Any) -> tuple[bool, str]:
        """Have the robot do something; whether it did, and if not why, else what it says."""
        return self._call(name, fields, ANSWER_PATIENCE, None)

    def watched(self, name: str, look: float, ends: Callable[[], bool], **fields: Any) -> tuple[bool, str]:
        """As `call`, for what takes long: every `look` s `ends` is asked whether it is to be cancelled."""
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
        """Hand answers to those who wait for them."""
        for number, done, text in answers:
            waiting = self._waiting.get(number)
            if waiting is not None:
                waiting[1].extend((done, text))
                waiting[0].set()
