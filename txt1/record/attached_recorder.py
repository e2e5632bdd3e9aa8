"""A recorder that watches a robot from before its first tick until after its stop."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from math import inf

from txt1.commands import say
from txt1.control.holding import PAUSE, Hold
from txt1.driver import CommandSource
from txt1.record.options import RecordingAsked
from txt1.record.session import recording
from txt1.robot import Robot
from txt1.runtime import Runtime


@asynccontextmanager
async def watch(runtime: Runtime, asked: RecordingAsked) -> AsyncIterator[None]:
    """Record, and show live, as long as the block is at work; raises as `txt1.record.session.recording`."""
    async with recording(asked.file, runtime.config, asked.speed, asked.about, say, asked.view) as attach:
        attach(runtime)
        yield


@asynccontextmanager
async def beside(robot: Robot, asked: RecordingAsked) -> AsyncIterator[None]:
    """Let the live view drive, if it may."""
    if asked.view is not None:
        asked.view.drive(PanelHand(robot, robot.source("view")).drive, robot.config.hand())
    yield


class PanelHand:
    """The hand at the live view's panel, which sends a velocity again and again while a button or a stick is held.

    A zero, or a pause, is a release. The first velocity after it is a fresh press, and another velocity than before is
    a sign of a hand.
    """

    def __init__(self, robot: Robot, source: CommandSource) -> None:
        self._robot, self._source, self._hold = robot, source, Hold()
        self._velocity, self._spoke = (0.0, 0.0), -inf

    def drive(self, v: float, omega: float, age: float) -> None:
        """Command m/s and rad/s; the panel's message is `age` s old."""
        now, before = self._robot.now, self._velocity
        if now - self._spoke > PAUSE:
            before = (0.0, 0.0)
        self._velocity, self._spoke = (v, omega), now
        if self._velocity == (0.0, 0.0) or before == (0.0, 0.0):
            self._source.release()
        if self._velocity == (0.0, 0.0):
            return
        if before == (0.0, 0.0):
            self._hold.press(0, now)
        elif self._velocity != before:
            self._hold.sign(0, now)
        if self._hold.drives(now) is not None:
            self._source.hold(v, omega, max(0.0, now - age))
        elif self._source.drives:
            self._source.release()
