"""What a car does when something fails while it drives: ``python -m benchmarks.board_faults``, in virtual time.

Each car is a simulated one on a board's serial line, ours or one with the habits of the originals. It drives straight
on. Then its encoders lose their power, its line is disturbed for a while, or it is stopped while something has failed.
Counted is what the true car does from then on.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from itertools import product
from math import hypot
from pathlib import Path
from typing import Any, Final, NamedTuple

from rigs import page_parts
from txt1.board.board import Board, BoardEvent
from txt1.errors import NotArmed, StopNotVerified
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.sim.vehicle import Vehicle

WIRE: Final = ("serial.port=virtual", "sim.room.length=.inf", "sim.room.width=.inf")
BOARDS: Final[Mapping[str, tuple[str, ...]]] = {
    "ours": WIRE,
    "original": (*WIRE, "board.habits=original"),
}
NAMES: Final = {"ours": "board as ours", "original": "board as the originals"}
STANDS: Final = 0.05
"""m/s; a slower car counts as standing."""
SPEEDS: Final = (0.1, 0.3, 0.6, 1.0)
"""m/s at which encoders are lost."""
LATER: Final = tuple(0.002 * k for k in range(25))
"""s after the same start at which they are lost: over one cycle of an original board's loops and host."""
GAPS: Final = (0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)
"""s for which nothing arrives at the board."""


class Course(NamedTuple):
    """What the true car did since: way, m; s until it stood for good; its largest speed, m/s."""

    way: float
    seconds: float
    fastest: float


class Lost(NamedTuple):
    """What came of lost encoders: the car's course, whether the ESC is on then, and why the robot was disarmed."""

    course: Course
    esc: bool
    reason: str


class Through(NamedTuple):
    """A hold through a gap of the line: the car's course, whether the hold has ended, and the speed in the end, m/s."""

    course: Course
    ended: bool
    last: float


@asynccontextmanager
async def on_board(board: str) -> AsyncIterator[tuple[Robot, Board]]:
    """A robot with this board, ready to drive; whether its last stop was seen does not matter."""
    with suppress(StopNotVerified):
        async with Robot.open("serial", settings=BOARDS[board], seed=1, arm=True) as robot:
            await robot.load_gains()
            yield robot, robot.hal.port.board  # type: ignore[attr-defined]


async def watch(clock: Board | Robot, vehicle: Vehicle, duration: float) -> Course:
    """Watch the true car for so many s of this clock."""
    vehicle.advance_to(clock.now)
    began, (x, y) = clock.now, vehicle.motion[:2]
    way = seconds = fastest = 0.0
    for _ in range(round(duration / 0.01)):
        await asyncio.sleep(0.01)
        vehicle.advance_to(clock.now)
        speed = abs(vehicle.motion[3])
        way += hypot(vehicle.motion[0] - x, vehicle.motion[1] - y)
        x, y = vehicle.motion[:2]
        fastest = max(fastest, speed)
        if speed >= STANDS:
            seconds = clock.now - began
    return Course(way, seconds, fastest)


# -- encoders that lose their power -------------------------------------------------------------------------------


async def lose_encoders(
    board: str, v: float, event: str, later: float, then: Callable[[Robot, Board], Any] | None = None
) -> Lost:
    """Drive, let the encoders go, watch for four seconds, and do something then."""
    async with on_board(board) as (robot, at):
        await robot.drive(v, 0.0, 2.0 + later)
        driving = asyncio.ensure_future(robot.drive(v, 0.0, 4.0))
        at.happen(BoardEvent(event, 0.0))
        course = await watch(at, at.vehicle, 4.0)
        await _disarmed(driving)
        lost = Lost(course, at.vehicle.esc_on, robot.reason)
        if then is not None:
            await then(robot, at)
    return lost


async def lose_simulated_encoders(v: float, later: float) -> Lost:
    """Do the same with a simulated car whose loops are in this host."""
    async with Robot.open("sim", settings=WIRE[1:], seed=1, arm=True) as robot:
        await robot.load_gains()
        await robot.drive(v, 0.0, 2.0 + later)
        vehicle: Vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
        driving = asyncio.ensure_future(robot.drive(v, 0.0, 4.0))
        vehicle.atx_on = False
        course = await watch(robot, vehicle, 4.0)
        await _disarmed(driving)
        return Lost(course, vehicle.esc_on, robot.reason)


async def _disarmed(driving: asyncio.Future[None]) -> None:
    with suppress(NotArmed):
        await driving
        raise AssertionError("the robot was not disarmed")


def ways_unseen() -> str:
    """The longest way after both encoders are lost, by hardware and speed."""
    rows = [
        (NAMES[board], [max(_run(lose_encoders(board, v, "encoders", s)).course.way for s in LATER) for v in SPEEDS])
        for board in ("original", "ours")
    ]
    rows.append(
        (
            "simulation, loops in the host",
            [max(_run(lose_simulated_encoders(v, s)).course.way for s in LATER) for v in SPEEDS],
        )
    )
    head = ("both encoders are lost at", *(f"{v:g} m/s" for v in SPEEDS))
    text = (
        f"Way until it stands, the longest of {len(LATER)} drives each, which differ by {LATER[1] * 1e3:g} ms in when."
    )
    return f"{_table(head, [(name, *(f'{way:.2f} m' for way in ways)) for name, ways in rows])}\n\n{text}"


# -- a line that is disturbed -------------------------------------------------------------------------------------


def silence(robot: Robot) -> Callable[[], None]:
    """Let nothing go to the board any more, as a host that hangs, is killed, or has a cut line; return what ends it."""
    line: Any = robot.hal.line  # type: ignore[attr-defined]
    send = line.send
    line.send = lambda data: None

    def end() -> None:
        line.send = send

    return end


async def disturb(robot: Robot, duration: float) -> None:
    """Let nothing arrive at the board for so many s, and come back."""
    end = silence(robot)
    await asyncio.sleep(duration)
    end()


class Hold:
    """Commands a speed 20 times a second by this source, whatever comes of it; a hand's zero lets go."""

    def __init__(self, robot: Robot, source: Any, v: float) -> None:
        self.v = v
        self._source = source
        self._hand = source.name in ("keys", "gamepad", "web")
        robot.add_task(f"hold {source.name}", 0.05, self._repeat)

    async def _repeat(self, ticks: Ticks) -> None:
        async for _ in ticks:
            if not self._hand:
                self._source.command(self.v, 0.0)
            elif self.v:
                self._source.hold(self.v, 0.0)
            else:
                self._source.release()


async def through_a_gap(board: str, v: float, duration: float) -> Through:
    """Hold a key through a gap of the line, and for 3 s after it."""
    async with on_board(board) as (robot, at):
        Hold(robot, robot.source("keys"), v)
        await asyncio.sleep(3.0)
        gap = asyncio.ensure_future(disturb(robot, duration))
        course = await watch(at, at.vehicle, duration + 3.0)
        await gap
        told = any("has to let go" in event.text for event in robot.runtime.state.events)
        return Through(course, told or not robot.armed, abs(at.vehicle.motion[3]))


def speeds_after_gaps() -> str:
    """The largest speed through and after gaps, by board and command."""
    speeds = SPEEDS[1:]
    rows = []
    for board in ("original", "ours"):
        found = [[_run(through_a_gap(board, v, gap)) for gap in GAPS] for v in speeds]
        rows.append((NAMES[board], *(f"{max(each.course.fastest for each in some):.2f} m/s" for some in found)))
    head = ("the key asks for", *(f"{v:g} m/s" for v in speeds))
    text = (
        f"Largest true speed in gaps of {GAPS[0]:g} to {GAPS[-1]:g} s, {len(GAPS)} of them, and in the 3 s after each."
    )
    return f"{_table(head, rows)}\n\n{text}"


# -- stops while something has failed -----------------------------------------------------------------------------


def _dead_encoders(robot: Robot, board: Board) -> None:
    board.happen(BoardEvent("encoders", 0.0))


def _sagging(robot: Robot, board: Board) -> None:
    board.happen(BoardEvent("battery", 8.0))


def _hung(robot: Robot, board: Board) -> None:
    silence(robot)


def _pull(robot: Robot, board: Board) -> None:
    board.vehicle.esc_on = board.vehicle.atx_on = False


Does = Callable[[Robot, Board], object]
FAULTS: Final[Mapping[str, Does]] = {"encoders dead": _dead_encoders, "battery sagging": _sagging, "host hung": _hung}
STOPS: Final[Mapping[str, Does]] = {
    "stop at the gate": lambda robot, board: robot.stop(),
    "board's time-out": _hung,
    "plug pulled": _pull,
}


async def stop_despite(board: str, stop: str, fault: str) -> Course:
    """Drive at 0.6 m/s, let something fail, and stop at once; the course of the 8 s from then on."""
    async with on_board(board) as (robot, at):
        await robot.drive(0.6, 0.0, 2.0)
        robot.command(0.6, 0.0)
        FAULTS[fault](robot, at)
        STOPS[stop](robot, at)
        return await watch(at, at.vehicle, 8.0)


def ways_despite() -> str:
    """The way and time of each stop while something has failed, by board."""
    rows = []
    for stop, board in product(STOPS, ("original", "ours")):
        courses = [_run(stop_despite(board, stop, fault)) for fault in FAULTS]
        rows.append((stop, NAMES[board], *(f"{course.way:.2f} m, {course.seconds:.2f} s" for course in courses)))
    text = "From 0.6 m/s, one drive each: the way, and the time until the car is slower than 0.05 m/s for good."
    return f"{_table(('stop', 'hardware', *FAULTS), rows)}\n\n{text}"


# -- the tables ---------------------------------------------------------------------------------------------------

PARTS: Final = {
    "dead encoders": (ways_unseen, Path("docs/stops.md")),
    "gaps of the line": (speeds_after_gaps, Path("docs/safety.md")),
    "stops despite faults": (ways_despite, Path("docs/safety.md")),
}


def _run(scene: Any) -> Any:
    return run(scene, speed="max")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Measure, print, and write the pages."""
    parser = argparse.ArgumentParser(prog="benchmarks.board_faults", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"which: {', '.join(PARTS)}; default all")
    parser.add_argument("--page", action="store_true", help="write the tables to docs/safety.md and docs/stops.md")
    arguments = parser.parse_args()
    for name, (measure, page) in PARTS.items():
        if arguments.parts and name not in arguments.parts:
            continue
        text = measure()
        print(f"{text}\n", flush=True)
        if arguments.page:
            page_parts.write(page, name, text, "benchmarks.board_faults")


if __name__ == "__main__":
    main()
