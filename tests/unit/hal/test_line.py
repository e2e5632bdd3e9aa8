"""The line to a motor controller: when its device is found, has settled, is lost, and what is told meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest

from txt1.errors import HalError
from txt1.hal.base import BoardLink
from txt1.hal.line import Line
from txt1.kernel.loop import VirtualTimeLoop
from txt1.link.base import End, Link


class Wire(Link):
    """A line that notes what is sent."""

    desk: Desk

    def _send(self, data: bytes) -> None:
        self.desk.sent.append((round(self.desk.loop.time(), 6), data))

    def _let_go(self) -> None:
        pass


class Desk:
    """A line, its port, and a clock."""

    address = "desk"

    def __init__(self) -> None:
        self.loop = VirtualTimeLoop()
        self.sent: list[tuple[float, bytes]] = []
        self.line = Line(self, lambda end: end, "answers", lambda: None, lambda data: None, hal="vesc")
        self.began = 0.0

    async def open(self, end: End) -> Link:
        wire = Wire("desk", end)
        wire.desk = self
        end.connected(wire)
        return wire

    async def close(self) -> None:
        pass

    def do(self, what: Callable[[], Any] | Coroutine[Any, Any, Any]) -> Any:
        async def doing() -> Any:
            return await what if asyncio.iscoroutine(what) else what()  # type: ignore[operator]

        return self.loop.run_until_complete(doing())

    def at(self, seconds: float) -> BoardLink:
        """The report at this time after the line was opened."""
        self.do(asyncio.sleep(max(0.0, self.began + seconds - self.loop.time())))
        report: BoardLink = self.do(lambda: self.line.report(seconds, {}))
        return report

    def hears(self, data: bytes, seconds: float) -> None:
        self.at(seconds)
        self.do(lambda: self.line.received(data))

    def answered(self, seconds: float) -> None:
        self.at(seconds)
        self.do(self.line.heard)


@pytest.fixture
def desk() -> Iterator[Desk]:
    """A line that has just been opened."""
    made = Desk()
    made.do(made.line.open())
    made.began = made.loop.time()
    yield made
    made.do(made.line.close())
    made.loop.close()


def test_a_device_gets_a_set_point_after_0_5_s_of_answers_and_is_lost_after_0_3_s(
    desk: Desk,
) -> None:
    for tenth in range(11):
        desk.answered(0.1 * tenth)
        assert desk.at(0.1 * tenth + 0.01).ready is (tenth >= 5)
    assert desk.at(1.29)[:3] == (True, 0, "")
    lost = desk.at(1.31)
    assert lost[:3] == (False, 1, "link lost: no answers for 0.3 s")
    assert (lost.gains, lost.connected) == (True, True)
    desk.answered(1.4)
    assert not desk.at(1.65).ready, "it has to settle again"


def test_strange_bytes_are_told_after_a_second_and_silence_after_three(desk: Desk) -> None:
    desk.hears(b'{"T":1001,"L":0,"R":0,"v":1200}\r\n', 0.5)
    assert "Waveshare" not in desk.at(0.99).text
    assert "Waveshare" in desk.at(1.01).text
    desk.line.tell("something newer")
    assert desk.at(2.0).text == "something newer", "it is told once"


def test_of_a_silent_line_it_is_told_after_three_seconds_how_to_look(desk: Desk) -> None:
    assert "doctor" not in desk.at(2.99).text
    assert "txt1 doctor --port desk" in desk.at(3.01).text
    desk.line.tell("something newer")
    assert desk.at(9.0).text == "something newer"


@pytest.mark.parametrize(
    ("error", "words"),
    [(HalError("no such device"), "^no such device$"), (ValueError("bad"), "the link to desk failed: ValueError")],
)
def test_a_failure_ends_the_run_with_its_own_words(desk: Desk, error: Exception, words: str) -> None:
    desk.at(0.1)
    desk.line.fail(error)
    with pytest.raises(HalError, match=words):
        desk.at(0.2)


def test_the_farewell_is_sent_three_times_within_a_moment(desk: Desk) -> None:
    desk.at(1.0)
    desk.do(desk.line.close(b"stop"))
    began = desk.sent[0][0]
    assert [(round(time - began, 6), data) for time, data in desk.sent] == [
        (0.0, b"stop"),
        (0.02, b"stop"),
        (0.04, b"stop"),
    ]
    assert desk.loop.time() - began == pytest.approx(0.06)
