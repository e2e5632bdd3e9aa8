"""How long the robot takes to stop, and that nothing is taken for a fault that is none: docs/stops.md.

Every case is a run in virtual time, seeded: what the speed was and at what instant it happened. ``neutral`` is the
time from the event until the outputs are neutral, or, to a board, until the first zeros are on the line; ``standing``
until the true speed of the simulated vehicle is below 0.05 m/s. `python -m benchmarks stops` writes the tables.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Collection
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from txt1 import run
from txt1.board import Board, BoardEvent
from txt1.config import load
from txt1.errors import LinkLost, NotArmed, StopNotVerified, TaskFault
from txt1.hal import serial
from txt1.hal.base import LINK
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel.loop import clock_of
from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import Switch
from txt1.robot import Robot
from txt1.sim.parameters import Faults

ENDLESS = ("sim.room.length=.inf", "sim.room.width=.inf")
KINDS = {"sim": (), "ours": ("board.habits=ours",), "original": ("board.habits=original",)}
STANDING = 0.05  # m/s: an original board reads 0 below 0.045, and its loops leave it creeping
CUT, DIES = "the board is silent", "the host of a virtual board"  # how rows of docs/safety.md begin
STOPS = "event", "neutral: median (worst)", "standing: median (worst)", "fastest", "still armed", "it took", "n"
HARMLESS_TITLES = "case", "taken for a stop that is none", "commanded and not moving", "n"
STEP = 0.01  # s between two looks
ROOT = Path(__file__).parents[1]
KEPT = ROOT / "out" / "stops.json"


class Result(NamedTuple):
    """Times in s from the event to neutral outputs and to standing; None: not within the limit. And what was told."""

    neutral: float | None
    standing: float | None
    stopped_by: str  # the strongest means that it took
    armed: bool
    reason: str
    fastest: float  # true, m/s, after the event


class Desk(NamedTuple):
    """A robot that drives, and the vehicle under it."""

    robot: Robot
    board: Board | None
    hal: SimHal
    rng: np.random.Generator
    zeros: list[float]  # times of the run at which a zero set-point went out

    async def drive(self, v: float, duration: float) -> None:
        """Drive, and go on asking."""
        with suppress(NotArmed):
            await self.robot.drive(v, 0.0, duration)
        self.robot.command(v, 0.0)

    @property
    def speed(self) -> float:
        """True, m/s."""
        return abs(self.hal.vehicle.motion[3])


Act = Callable[[Desk], Awaitable[None]]


@dataclass(frozen=True)
class Case:
    """Something that happens, in words as docs/safety.md has it, to a robot on this hardware."""

    name: str
    about: str
    kind: str
    event: Act
    before: Act | None = None  # done while it drives, in place of 1 to 2 s at 0.4 to 1 m/s
    unmended: bool = False  # without what recognises it: to see that it moves
    limit: float = 5.0
    row: str = ""  # how the row of docs/safety.md begins


@asynccontextmanager
async def desk(case: Case, seed: int) -> AsyncIterator[Desk]:
    """A robot that is armed and has its gains."""
    wire = case.kind != "sim"
    settings = [*ENDLESS, *KINDS[case.kind], *(("serial.port=virtual",) if wire else ())]
    config = load(None, [*settings, f"seed={seed}", f"hal={'serial' if wire else 'sim'}"]).config
    hal: Any = create(config)
    if case.unmended:
        hal.capabilities = replace(hal.capabilities, halt=False)
    zeros: list[float] = []
    with suppress(StopNotVerified, TaskFault):
        async with Robot.open(hal, config=config, arm=True) as robot:
            assert await robot.load_gains()
            board = hal.port.board if wire else None

            def line(topic: object, piece: tuple[str, bytes], time: float) -> None:
                if piece[0] == "out" and piece[1][2:8] == b"\x04\x67\0\0\0\0":
                    zeros.append(time)

            if wire:
                robot.runtime.bus.subscribe(line, [LINK])
            yield Desk(robot, board, board.runtime.hal if wire else hal, np.random.default_rng(seed), zeros)


async def once(case: Case, seed: int) -> Result:
    """What one run shows."""
    result: Result | None = None
    async with desk(case, seed) as on:
        if case.before is not None:
            await case.before(on)
        else:
            await on.drive(float(on.rng.uniform(0.4, 1.0)), float(on.rng.uniform(1.0, 2.0)))
        robot, began, neutral, standing, fastest = on.robot, on.robot.now, None, None, 0.0
        on.zeros.clear()
        await case.event(on)
        for _ in range(round(case.limit / STEP)):
            since = robot.now - began
            if neutral is None and (on.zeros or not on.hal.outputs.motor):
                neutral = on.zeros[0] - began if on.zeros else since
            fastest = max(fastest, on.speed)
            if on.speed >= STANDING:
                standing = None
            elif standing is None:
                standing = since
            await asyncio.sleep(STEP)
        watch = robot.runtime.watch
        means = "none" if watch is None else watch.standstill.failed.value
        result = Result(neutral, standing, means, robot.armed, robot.reason, fastest)
        on.hal.vehicle.state = on.hal.vehicle.state._replace(v=0.0)
    assert result is not None
    return result


def button(on: Desk) -> None:
    """Press the button on the board."""
    assert on.board is not None
    on.board.happen(BoardEvent("centre"))


async def manual(on: Desk) -> None:
    """Drive, and have somebody press the centre button."""
    v = float(on.rng.uniform(0.4, 1.0))
    await on.drive(v, float(on.rng.uniform(1.0, 2.0)))
    button(on)
    await on.drive(v, 0.2)


async def disarm(on: Desk) -> None:
    """Disarm."""
    on.robot.disarm()


async def stop(on: Desk) -> None:
    """Stop."""
    on.robot.stop()


async def nothing(on: Desk) -> None:
    """Command no more."""


async def cut(on: Desk) -> None:
    """Unplug the line."""
    assert on.board is not None and on.board.link is not None
    on.board.link.close()


async def dies(on: Desk) -> None:
    """Let the host fall silent without a farewell: it is not heard any more, and its line is up."""
    assert on.board is not None

    def silent(data: bytes) -> None:
        raise LinkLost("dead")

    on.robot.hal.link.write = silent  # type: ignore[attr-defined]


async def restart(on: Desk) -> None:
    """Take the power away for 0.2 s."""
    assert on.board is not None
    on.board.happen(BoardEvent("restart", 0.2))


async def at_rest(on: Desk) -> None:
    """Stand where the odometry began, or a little away from it."""
    if on.rng.random() < 0.5:
        await on.drive(0.3, float(on.rng.uniform(0.5, 1.5)))
    await on.drive(0.0, 2.0 + float(on.rng.uniform(0.0, 1.0)))


async def commands_again(on: Desk) -> None:
    """Restart, drive on, and have the gains sent again 3 s later."""
    await restart(on)
    await go(on)
    message = on.robot.config.loops().pid_set()
    asyncio.get_running_loop().call_later(3.0, lambda: on.robot.runtime.post(message, on.robot.now))


async def esc_off(on: Desk) -> None:
    """An earlier host has left the ESC off."""
    assert on.board is not None
    on.board.happen(BoardEvent("esc", 0.0))
    await asyncio.sleep(0.5)


async def go(on: Desk) -> None:
    """Command 0.4 m/s from now on."""

    async def driving(ticks: Ticks) -> None:
        async for _ in ticks:
            on.robot.command(0.4, 0.0)

    on.robot.add_task("go", 0.05, driving)


async def go_and_switch_on(on: Desk) -> None:
    """Do so, and have the ESC on 3 s later: by the robot where it has disarmed, else by hand."""
    await go(on)

    def switch_on() -> None:
        if on.robot.armed and on.board is not None:
            on.board.happen(BoardEvent("esc", 1.0))
        else:
            on.robot.switch_power(Switch.ESC, True)

    asyncio.get_running_loop().call_later(3.0, switch_on)


async def lose_encoder(on: Desk) -> None:
    """Break the right encoder."""
    on.hal.vehicle.faults = Faults(right_encoder=True)
    await keep(on)


async def low_battery(on: Desk) -> None:
    """Let the packs read what is bad."""
    on.hal.vehicle.faults = Faults(voltage=8.7)
    await keep(on)


async def keep(on: Desk) -> None:
    """Go on commanding."""

    async def driving(ticks: Ticks) -> None:
        async for _ in ticks:
            on.robot.command(0.6, 0.0)

    on.robot.add_task("go", 0.02, driving)


async def stall(on: Desk) -> None:
    """Hold up the event loop for six cycles."""
    await keep(on)
    clock_of(asyncio.get_running_loop()).spend(0.13)  # type: ignore[attr-defined]


async def bad_command(on: Desk) -> None:
    """Command what is no number, and nothing after it."""
    with suppress(Exception):
        on.robot.command(float("nan"), 0.0)


async def push(on: Desk) -> None:
    """Push the disarmed car for two seconds."""
    on.robot.disarm()
    await asyncio.sleep(2.0)
    v = float(on.rng.uniform(0.15, 0.8))
    for _ in range(200):
        on.hal.vehicle.state = on.hal.vehicle.state._replace(v=v)
        await asyncio.sleep(0.01)


async def slope(on: Desk) -> None:
    """Stop on a slope of up to two degrees, downwards or upwards."""
    gain = float(on.rng.uniform(-0.35, 0.35))
    on.robot.disarm()

    async def rolling(ticks: Ticks) -> None:
        async for _ in ticks:
            vehicle = on.hal.vehicle
            if vehicle.motion[3]:
                vehicle.state = vehicle.state._replace(v=vehicle.motion[3] + 0.02 * gain)

    on.robot.add_task("slope", 0.02, rolling)


async def block(on: Desk) -> None:
    """A wheel is blocked: no output moves the car."""
    vehicle = on.hal.vehicle
    vehicle.dynamics = (*vehicle.dynamics[:3], 0.0, *vehicle.dynamics[4:])
    await go(on)


async def slowly(on: Desk) -> None:
    """Drive at 0.04 m/s."""

    async def driving(ticks: Ticks) -> None:
        async for _ in ticks:
            on.robot.command(0.04, 0.0)

    on.robot.add_task("go", 0.05, driving)


async def rest(on: Desk) -> None:
    """Stand for a while."""
    await asyncio.sleep(float(on.rng.uniform(0.5, 1.5)))


CASES = (
    Case("stale", "a command goes stale", "sim", nothing, row="the command is older"),
    Case("nan", "a command is NaN", "sim", bad_command, row="a command is NaN"),
    Case("encoder", "an encoder falls silent", "sim", lose_encoder, row="an encoder is silent"),
    Case("missed", "the controller misses cycles", "sim", stall, row="the controller misses"),
    Case("battery", "batteries read 8.7 V", "sim", low_battery, limit=14.0, row="batteries bad"),
    Case("stop", "emergency stop", "sim", stop, row="emergency stop"),
    *(
        case
        for kind in ("ours", "original")
        for case in (
            Case(f"stop-{kind}", f"emergency stop, {kind} board", kind, stop),
            Case(f"stale-{kind}", f"a command goes stale, {kind} board", kind, nothing),
            Case(f"cut-{kind}", f"the line is unplugged, {kind} board", kind, cut, row=CUT if kind == "ours" else ""),
            Case(f"dies-{kind}", f"the host dies, {kind} board", kind, dies, row=DIES if kind == "ours" else ""),
        )
    ),
    Case("restart", "an original board restarts while it drives", "original", restart),
    Case("a1", "A1: manual mode, then disarm, original board", "original", disarm, manual, row="a stop that a board"),
    Case("a1-stop", "A1: manual mode, then emergency stop, original board", "original", stop, manual),
    Case("a1-stale", "A1: manual mode, then no commander, original board", "original", nothing, manual),
    Case("a1-unmended", "A1 without the watch", "original", disarm, manual, unmended=True),
    Case("a2", "A2: restart at rest, and driving on, original board", "original", commands_again, at_rest, limit=8.0),
    Case("a2-unmended", "A2 with no sign looked at", "original", commands_again, at_rest, limit=8.0, unmended=True),
    Case("a3", "A3: commanded with the ESC left off, original board", "original", go_and_switch_on, esc_off, limit=8.0),
    Case("a3-unmended", "A3 without the watch", "original", go_and_switch_on, esc_off, limit=8.0, unmended=True),
)
HARMLESS = tuple(
    Case(f"{name}-{kind}", f"{about}, {kind} board", kind, event, before)
    for kind in ("ours", "original")
    for name, about, event, before in (
        ("pushed", "pushed by hand", push, None),
        ("slope", "stopped on a slope", slope, None),
        ("blocked", "a blocked wheel", block, rest),
        ("slow", "driven at 0.04 m/s", slowly, rest),
    )
)


def results(case: Case, seeds: int) -> list[Result]:
    """What so many runs show."""
    with ExitStack() as blind:
        if case.unmended:
            blind.enter_context(mock.patch.object(serial, "at_origin", lambda pose: False))
            blind.enter_context(mock.patch.object(serial, "started_again", lambda before, after: False))
        return [run(once(case, seed), speed="max") for seed in range(seeds)]


def spread(times: list[float | None]) -> str:
    """Median and worst."""
    known = [time for time in times if time is not None]
    if len(known) < len(times):
        return f"{len(times) - len(known)} of {len(times)} do not"
    return f"{median(known):.2f} s ({max(known):.2f})"


def measure(case: Case, seeds: int) -> dict[str, str]:
    """A row of a table, and what docs/safety.md says of it."""
    found = results(case, seeds)
    if case in HARMLESS:
        escalated = sum(one.stopped_by != "none" for one in found)
        disarmed = sum("not moving" in one.reason for one in found)
        return {"row": f"| {case.about} | {escalated} | {disarmed} | {len(found)} |"}
    neutral, standing = spread([one.neutral for one in found]), spread([one.standing for one in found])
    means = "; ".join(sorted({one.stopped_by for one in found} - {"none"})) or "zeros"
    fastest, armed = max(one.fastest for one in found), sum(one.armed for one in found)
    cells = case.about, neutral, standing, f"{fastest:.2f} m/s", armed, means, len(found)
    return {
        "row": f"| {' | '.join(map(str, cells))} |",
        "safety": f"{neutral}; {standing}; n = {len(found)}",
    }


def main(quick: bool = False, seeds: int = 100, names: Collection[str] = ()) -> None:
    """Run all cases, or those named, keep what they show in out/stops.json, and write the tables of all that is there.

    A1 to A3 and what is no fault have `seeds` runs each, the others 40 %.
    """
    known: dict[str, dict[str, str]] = json.loads(KEPT.read_text()) if KEPT.exists() and names else {}
    for case in (*CASES, *HARMLESS):
        if not names or case.name in names:
            many = case in HARMLESS or case.name.startswith("a")
            known[case.name] = measure(case, 3 if quick else seeds if many else max(1, 2 * seeds // 5))
            print(known[case.name]["row"], flush=True)
    if not quick:
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps(known, indent=1))
        write(known)


def write(known: dict[str, dict[str, str]]) -> None:
    """Put the tables between the marks of docs/stops.md, and the times into that of docs/safety.md."""
    page = ROOT / "docs" / "stops.md"
    text = page.read_text()
    for mark, titles, cases in (("stops", STOPS, CASES), ("harmless", HARMLESS_TITLES, HARMLESS)):
        rows = [known[case.name]["row"] for case in cases if case.name in known]
        table = "\n".join(("| " + " | ".join(titles) + " |", "|---" * len(titles) + "|", *rows))
        begin, end = f"<!-- {mark} -->", f"<!-- /{mark} -->"
        text = text[: text.index(begin)] + f"{begin}\n{table}\n" + text[text.index(end) :]
    page.write_text(text)
    safety = ROOT / "docs" / "safety.md"
    lines = safety.read_text().splitlines()
    for case in CASES:
        for k, line in enumerate(lines):
            if case.row and case.name in known and line.startswith(f"| {case.row}"):
                lines[k] = " | ".join((*line.split(" | ")[:3], f"{known[case.name]['safety']} |"))
    safety.write_text("\n".join(lines) + "\n")
