"""A robot with its web page in a process of its own, so that nothing a benchmark does holds it up."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, Final, NamedTuple

from rigs.live_browser import Live, Sample, live
from txt1.robot import Robot

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
PATIENCE: Final = 120.0  # s that it has to answer: it starts on a busy machine, too


class Look(NamedTuple):
    """What has come since the last look: set-points tick by tick; and of the whole run cycles, and those missed."""

    samples: list[Sample]
    cycles: int
    misses: int
    lateness: float  # s, the 99th percentile of the controller's


class Car:
    """The robot from outside."""

    def __init__(self, line: Connection) -> None:
        self._line = line
        self.port, self.pid = self._answer()  # of the page's server

    @property
    def url(self) -> str:
        """Of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def look(self) -> Look:
        """What has come since the last look."""
        self._line.send("look")
        found: Look = self._answer()
        return found

    def _answer(self) -> Any:
        if not self._line.poll(PATIENCE):
            raise TimeoutError(f"the robot's process has not answered in {PATIENCE:g} s")
        return self._line.recv()


@contextmanager
def car(*, realtime: bool = False) -> Iterator[Car]:
    """A robot in an endless room, armed; with `realtime` its loop goes before all other programs."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_be, args=(there, realtime))
    process.start()
    there.close()
    try:
        yield Car(here)
    finally:
        here.close()  # and it ends
        process.join(PATIENCE)


def _be(line: Connection, realtime: bool) -> None:
    """The robot's process: what it is asked for, until the other end goes."""
    with live(ENDLESS, realtime=realtime) as robot:
        line.send((robot.port, robot.pid))
        try:
            while line.recv():
                line.send(robot.call(lambda _: _look(robot)))
        except EOFError:
            pass


def _look(live: Live) -> Look:
    """Hand over what was kept; called in the robot's loop."""
    statistics = _controller(live.robot)
    samples, live.samples = live.samples, []
    return Look(samples, statistics.cycles, statistics.misses, statistics.lateness.percentiles().p99)


def _controller(robot: Robot) -> Any:
    return robot.runtime.statistics()["controller"]
