"""How long the robot takes to stop, and that nothing is taken for a fault that is none: docs/results/stops.md.

Every case is a run in virtual time, seeded: what the speed was and at what instant it happened. ``neutral`` is the
time from the event until the outputs are neutral for good, or, to a board, until zeros go out on the line and nothing
else any more; ``standing`` until the true speed of the simulated vehicle stays below 0.05 m/s. `python -m benchmarks
stops` writes the tables, and the measured column of docs/safety.md; its rows of processes, which take real time, are
from what `python -m torture processes` has kept.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple
from unittest import mock

import numpy as np

from rigs import page_parts
from txt1 import run
from txt1.board.board import Board, BoardEvent
from txt1.config import load
from txt1.errors import CommandRefused, HalError, LinkLost, NotArmed, StopNotVerified, TaskFault
from txt1.hal import restarts, serial
from txt1.hal.base import LINK, Inputs, Outputs
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel.loop import clock_of
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import WheelOdometry
from txt1.protocol.layout import encode
from txt1.protocol.messages import Switch, Velocity
from txt1.robot import Robot
from txt1.sim.parameters import Faults
from txt1.tasks.controller import CONTROL_PERIOD

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
KINDS: Final = {"sim": (), "ours": ("board.habits=ours",), "original": ("board.habits=original",)}
WORDS: Final = {"sim": "simulation", "ours": "board as ours", "original": "board as the originals"}
STANDING: Final = 0.05  # m/s: an original board reads 0 below 0.045, and its loops leave it creeping
STOPS: Final = (
    "event",
    "on",
    "neutral: median (worst)",
    "standing: median (worst)",
    "fastest",
    "still armed",
    "it took",
    "n",
)
HARMLESS_TITLES: Final = "case", "on", "taken for a stop that is none", "commanded and not moving", "n"
STEP: Final = 0.01  # s between two looks
ROOT: Final = Path(__file__).parents[1]
KEPT: Final = ROOT / "out" / "stops.json"
PROCESSES: Final = ROOT / "out" / "torture" / "processes.jsonl"
ZERO: Final = encode(Velocity(0.0, 0.0))[:4]  # how every Velocity begins


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
    sent: list[tuple[float, bool]]  # each Velocity on the line: s of the run, whether it moves anything

    async def drive(self, v: float, duration: float) -> None:
        """Drive, and go on asking."""
        with suppress(NotArmed):
            await self.robot.drive(v, 0.0, duration)
        self.robot.command(v, 0.0)

    @property
    def speed(self) -> float:
        """True, m/s."""
        return abs(self.hal.vehicle.motion[3])

    def insist(self, v: float, period: float = 0.02) -> None:
        """Command a speed from now on, m/s, whatever happens."""

        async def driving(ticks: Ticks) -> None:
            async for _ in ticks:
                self.robot.command(v, 0.0)

        self.robot.add_task("go", period, driving)


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
    limit: float = 5.0  # s for which it is looked at
    row: str = ""  # how the row of docs/safety.md begins
    told: str = ""  # what the row says of this case beside its hardware
    settings: tuple[str, ...] = ENDLESS
    by_output: bool = False  # the board does not obey zeros on the line: its output counts
    own_odometry: bool = False  # the simulated hardware computes the odometry, as boards do, and no ticks are seen

    @property
    def key(self) -> str:
        """Its name among those of all hardware."""
        return f"{self.name}-{self.kind}"


def with_own_odometry(hal: Any) -> None:
    """Let simulated hardware compute its odometry itself, every 20 ms."""
    read, wheels, told, at = hal.read, WheelOdometry(hal.vehicle.body), Inputs(), -1.0
    hal.capabilities = replace(hal.capabilities, ticks=False, odometry=True)

    def reading(now: float) -> Inputs:
        nonlocal told, at
        inputs: Inputs = read(now)
        if now >= at + CONTROL_PERIOD - 1e-9:
            at = now
            assert inputs.ticks is not None
            wheels.step(inputs.ticks, now)
            told = inputs._replace(ticks=None, odometry=wheels.odometry, odometry_time=now)
        return told

    hal.read = reading


@asynccontextmanager
async def desk(case: Case, seed: int) -> AsyncIterator[Desk]:
    """A robot that is armed and has its gains."""
    wire = case.kind != "sim"
    settings = [*case.settings, *KINDS[case.kind], *(("serial.port=virtual",) if wire else ())]
    config = load(None, [*settings, f"seed={seed}", f"hal={'serial' if wire else 'sim'}"]).config
    hal: Any = create(config)
    if case.unmended:
        hal.capabilities = replace(hal.capabilities, halt=False)
    if case.own_odometry:
        with_own_odometry(hal)
    sent: list[tuple[float, bool]] = []
    with suppress(StopNotVerified, TaskFault):
        async with Robot.open(hal, config=config, arm=True) as robot:
            assert await robot.load_gains()
            board = hal.port.board if wire else None

            def line(topic: object, piece: tuple[str, bytes], time: float) -> None:
                if piece[0] == "out" and piece[1].startswith(ZERO):
                    sent.append((time, any(piece[1][4:8])))

            if wire:
                robot.runtime.bus.subscribe(line, [LINK])
            yield Desk(robot, board, hal if board is None else board.runtime.hal, np.random.default_rng(seed), sent)


async def look(on: Desk, limit: float, by_output: bool) -> Result:
    """See what comes of an event, from now on and for so many s."""
    robot, loop, runs = on.robot, asyncio.get_running_loop(), on.board or on.robot
    began, start = robot.now, loop.time()
    driven, still, fastest = 0.0, None, 0.0  # since the event: outputs seen to move it last, standing since, m/s
    on.sent.clear()
    for _ in range(round(limit / STEP)):
        since = loop.time() - start
        on.hal.vehicle.advance_to(runs.now)  # also when the run has ended
        if on.hal.outputs.motor:
            driven = since + STEP
        fastest = max(fastest, on.speed)
        still = None if on.speed >= STANDING else since if still is None else still
        await asyncio.sleep(STEP)
    moved = max((k for k, (_, moves) in enumerate(on.sent) if moves), default=-1)
    zeros = next((max(0.0, time - began) for time, _ in on.sent[moved + 1 :]), None)
    neutral = driven if driven < limit - STEP else None
    if zeros is not None and not by_output:
        neutral = zeros if neutral is None else min(zeros, neutral)
    watch = robot.runtime.watch
    means = "none" if watch is None else watch.standstill.failed.value
    return Result(neutral, still, means, robot.armed, robot.reason, fastest)


async def once(case: Case, seed: int) -> Result:
    """What one run shows."""
    looking: asyncio.Future[Result] | None = None
    async with desk(case, seed) as on:
        if case.before is not None:
            await case.before(on)
        else:
            await on.drive(float(on.rng.uniform(0.4, 1.0)), float(on.rng.uniform(1.0, 2.0)))
        looking = asyncio.ensure_future(look(on, case.limit, case.by_output))
        await asyncio.sleep(0.0)  # it has begun
        await case.event(on)
        await asyncio.wait([looking])
        on.hal.vehicle.state = on.hal.vehicle.state._replace(v=0.0)
    assert looking is not None
    return await looking


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
    """Unplug the line, and leave it so."""
    assert on.board is not None and on.board.link is not None

    async def gone(end: object) -> None:
        raise HalError("unplugged")

    on.robot.hal.port.open = gone  # type: ignore[attr-defined]
    on.board.link.close()


async def mute(on: Desk) -> None:
    """Let nothing that the board says be heard any more; its line is up, and it hears its host."""
    assert on.board is not None
    on.board.link.write = lambda data: None  # type: ignore[union-attr, method-assign]
    on.insist(0.6)


async def dies(on: Desk) -> None:
    """Let the host fall silent without a farewell: it is not heard any more, and its line is up."""
    assert on.board is not None

    def silent(data: bytes) -> None:
        raise LinkLost("dead")

    on.robot.hal.line.link.write = silent  # type: ignore[attr-defined]


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

    on.insist(0.4, 0.05)


async def go_and_switch_on(on: Desk) -> None:
    """Do so, and have the ESC on 3 s later: by the robot where it has disarmed, else by hand."""
    await go(on)

    def switch_on() -> None:
        if on.robot.armed and on.board is not None:
            on.board.happen(BoardEvent("esc", 1.0))
        else:
            on.robot.switch_power(Switch.ESC, True)

    asyncio.get_running_loop().call_later(3.0, switch_on)


async def go_until_switched_on_by_hand(on: Desk) -> None:
    """Command 0.4 m/s until the robot disarms, and have somebody switch the ESC on 4 s later."""
    await go(on)
    board = on.board
    assert board is not None
    asyncio.get_running_loop().call_later(5.0, lambda: board.happen(BoardEvent("esc", 1.0)))


async def hanging(on: Desk) -> None:
    """Do so, and have the motor's output hang whatever it is told."""
    await manual(on)
    hal: Any = on.hal

    def hung(outputs: Outputs, now: float) -> None:
        hal.vehicle.advance_to(now)
        hal.outputs = outputs

    hal.write = hung


async def lose_encoder(on: Desk) -> None:
    """Break the right encoder."""
    on.hal.vehicle.faults = Faults(right_encoder=True)
    on.insist(0.6)


async def lose_encoders(on: Desk) -> None:
    """Take the power from both encoders."""
    on.hal.vehicle.faults = Faults(right_encoder=True, left_encoder=True)
    on.insist(0.6)


async def reverse_encoder(on: Desk) -> None:
    """Let the left encoder count the other way."""
    hal: Any = on.hal
    read = hal.read

    def reading(now: float) -> Inputs:
        inputs: Inputs = read(now)
        return inputs if inputs.ticks is None else inputs._replace(ticks=(inputs.ticks[0], -inputs.ticks[1]))

    hal.read = reading
    on.insist(0.6)


async def contradict(on: Desk) -> None:
    """Offer combined odometry that says standstill."""
    on.insist(0.6)

    async def offering(ticks: Ticks) -> None:
        async for _ in ticks:
            on.robot.combined_odometry(0.0, 0.0, 0.0, 0.0, 0.0)

    on.robot.add_task("offer", 0.05, offering)


async def lose_odometry(on: Desk) -> None:
    """Let no odometry come any more."""
    hal: Any = on.hal
    told = hal.read(on.robot.now)
    hal.read = lambda now: told
    on.insist(0.6)


async def low_battery(on: Desk) -> None:
    """Let the packs read a voltage that is bad."""
    on.hal.vehicle.faults = Faults(voltage=8.7)
    on.insist(0.6)


async def stall(on: Desk) -> None:
    """Hold up the event loop for six cycles."""
    on.insist(0.6)
    clock_of(asyncio.get_running_loop()).spend(0.13)  # type: ignore[attr-defined]


async def sleep(on: Desk) -> None:
    """Wake up from a suspension of an hour."""
    on.insist(0.6)
    on.robot.runtime.slept(3600.0)


async def fall_silent(on: Desk) -> None:
    """Let no message of any host reach the tasks any more."""
    on.robot.runtime.post = lambda message, time: None  # type: ignore[method-assign]
    on.insist(0.6)


async def bad_command(on: Desk) -> None:
    """Command what is no number, again and again."""

    async def driving(ticks: Ticks) -> None:
        async for _ in ticks:
            with suppress(CommandRefused):
                on.robot.command(float("nan"), 0.0)

    on.robot.add_task("go", 0.02, driving)


async def fail(on: Desk) -> None:
    """Let a task of the user's raise."""
    on.insist(0.6)

    async def clumsy(ticks: Ticks) -> None:
        async for _ in ticks:
            raise ZeroDivisionError

    on.robot.add_task("clumsy", 0.02, clumsy)


async def to_the_wall(on: Desk) -> None:
    """Drive until it touches the wall, and drive on."""
    on.insist(0.6)
    while on.hal.blocked_by() is None:
        await asyncio.sleep(STEP)


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
    on.insist(0.04, 0.05)


async def rest(on: Desk) -> None:
    """Stand for a while."""
    await asyncio.sleep(float(on.rng.uniform(0.5, 1.5)))


EACH: Final = tuple(KINDS)
BOARDS: Final = ("ours", "original")
MANUAL: Final[dict[str, Any]] = {"before": manual, "by_output": True}
STALE, SILENT, ENCODER, BLIND, AGAINST = (
    "the command is older",
    "the host is silent",
    "an encoder is silent",
    "all encoders read 0",
    "the wheels turn",
)
MISSED, CUT, UNOBEYED, UNMOVED = (
    "the controller misses",
    "the board is silent",
    "a board does not obey a stop",
    "commanded at 0.1",
)


def on_each(kinds: Iterable[str], name: str, about: str, event: Act, row: str = "", **options: Any) -> Iterator[Case]:
    """The same case on several kinds of hardware."""
    return (Case(name, about, kind, event, row=row, **options) for kind in kinds)


CASES: Final = (
    *on_each(EACH, "stale", "a command goes stale", nothing, STALE),
    *on_each(EACH, "nan", "commands are NaN", bad_command, "a command is NaN"),
    *on_each(("sim",), "silent", "the host falls silent", fall_silent, SILENT),
    *on_each(EACH, "encoder", "an encoder falls silent", lose_encoder, ENCODER),
    *on_each(EACH, "blind", "both encoders lose power", lose_encoders, BLIND),
    *on_each(EACH, "reversed", "an encoder counts backwards", reverse_encoder, AGAINST),
    *on_each(
        ("sim", "ours"), "contradicted", "combined odometry says 0", contradict, AGAINST, told="combined odometry"
    ),
    *on_each(
        ("sim",), "odometry", "no odometry comes any more", lose_odometry, "odometry is older", own_odometry=True
    ),
    *on_each(("sim",), "missed", "the controller misses cycles", stall, MISSED),
    *on_each(BOARDS, "slept", "the computer wakes up", sleep, "the computer was suspended"),
    *on_each(BOARDS, "mute", "the board falls silent", mute, CUT, told="silent"),
    *on_each(BOARDS, "cut", "the line is unplugged", cut, CUT, told="unplugged"),
    *on_each(("original",), "restart", "the board restarts while it drives", restart, CUT, told="restarts"),
    *on_each(BOARDS, "a1", "A1: manual mode, then disarm", disarm, UNOBEYED, told="manual mode", **MANUAL),
    *on_each(("original",), "a1-stop", "A1: manual mode, then emergency stop", stop, **MANUAL),
    *on_each(("original",), "a1-stale", "A1: manual mode, then no commander", nothing, **MANUAL),
    *on_each(
        ("original",), "a1-hangs", "manual mode, and the output hangs", disarm, UNOBEYED,
        told="and its output hangs", **(MANUAL | {"before": hanging}),
    ),
    *on_each(("original",), "a1-unmended", "A1 without the watch", disarm, unmended=True, **MANUAL),
    *on_each(BOARDS, "unmoved", "commanded, and a wheel is blocked", block, UNMOVED, before=rest, told="blocked wheel"),
    *on_each(
        ("original",), "a2", "A2: restart at rest, and driving on", commands_again, before=at_rest, limit=8.0,
    ),
    *on_each(
        ("original",), "a2-unmended", "A2 with no sign looked at", commands_again, before=at_rest, limit=8.0,
        unmended=True,
    ),
    *on_each(
        ("original",), "a3", "A3: commanded with the ESC left off", go_and_switch_on, UNMOVED, before=esc_off,
        limit=8.0, told="ESC off",
    ),
    *on_each(
        ("original",), "a3-hand", "A3, and somebody switches the ESC on", go_until_switched_on_by_hand, UNMOVED,
        before=esc_off, limit=8.0, told="ESC off, then on by hand",
    ),
    *on_each(
        ("original",), "a3-unmended", "A3 without the watch", go_and_switch_on, before=esc_off, limit=8.0,
        unmended=True,
    ),
    *on_each(BOARDS, "dies", "the host dies", dies, "the host of a virtual board"),
    *on_each(
        ("ours",), "wall", "it has run into a wall", nothing, "a virtual board stops", before=to_the_wall, settings=(),
    ),
    *on_each(EACH, "battery", "batteries read 8.7 V", low_battery, "batteries bad", limit=14.0),
    *on_each(EACH, "task", "a task raises", fail, "a task raises"),
    *on_each(EACH, "stop", "emergency stop", stop, "emergency stop"),
)  # fmt: skip
HARMLESS: Final = tuple(
    case
    for name, about, event, before in (
        ("pushed", "pushed by hand", push, None),
        ("slope", "stopped on a slope", slope, None),
        ("blocked", "a blocked wheel", block, rest),
        ("slow", "driven at 0.04 m/s", slowly, rest),
    )
    for case in on_each(BOARDS, name, about, event, before=before)
)


def results(case: Case, seeds: int) -> list[Result]:
    """What so many runs show."""
    with ExitStack() as blind:
        if case.unmended:
            blind.enter_context(mock.patch.object(restarts, "at_origin", lambda pose: False))
            blind.enter_context(mock.patch.object(serial, "started_again", lambda before, after: False))
        return [run(once(case, seed), speed="max") for seed in range(seeds)]


def spread(times: Iterable[float | None]) -> str:
    """Median and worst, s."""
    every = list(times)
    known = [time for time in every if time is not None]
    if len(known) < len(every):
        return f"{len(every) - len(known)} of {len(every)} do not"
    return f"{median(known):.2f} ({max(known):.2f})"


def worst(times: str) -> str:
    """Return the worst of each "median (worst)" in a text."""
    return re.sub(r"[\d.]+ \(([\d.]+)\)", r"\1", times)


def measure(case: Case, seeds: int) -> dict[str, Any]:
    """A row of a table, and what docs/safety.md says of it."""
    found = results(case, seeds)
    if case in HARMLESS:
        escalated = sum(one.stopped_by != "none" for one in found)
        disarmed = sum("not moving" in one.reason for one in found)
        return {"n": len(found), "row": _line(case.about, WORDS[case.kind], escalated, disarmed, len(found))}
    neutral, standing = spread(one.neutral for one in found), spread(one.standing for one in found)
    means = "; ".join(sorted({one.stopped_by for one in found} - {"none"})) or "zeros"
    fastest, armed = max(one.fastest for one in found), sum(one.armed for one in found)
    cells = case.about, WORDS[case.kind], neutral, standing, f"{fastest:.2f} m/s", armed, means, len(found)
    return {"n": len(found), "row": _line(*cells), "safety": f"{neutral}; {standing}"}


def _line(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def main(quick: bool = False, seeds: int = 100, names: Collection[str] = ()) -> None:
    """Run all cases that out/stops.json does not have with so many seeds, and those named; then write the tables.

    Take the file away to measure everything anew.
    """
    known: dict[str, dict[str, Any]] = json.loads(KEPT.read_text()) if KEPT.exists() and not quick else {}
    for case in (*CASES, *HARMLESS):
        if case.name in names or (not names and known.get(case.key, {}).get("n") != seeds):
            known[case.key] = measure(case, 3 if quick else seeds)
            print(known[case.key]["row"], flush=True)
            if not quick:
                KEPT.parent.mkdir(exist_ok=True)
                KEPT.write_text(json.dumps(known, indent=1))
    if not quick:
        write(known)


def write(known: dict[str, dict[str, Any]]) -> None:
    """Put the tables between the marks of docs/results/stops.md, and the times into that of docs/safety.md."""
    page = ROOT / "docs" / "results" / "stops.md"
    for part, titles, cases in (("stops", STOPS, CASES), ("harmless", HARMLESS_TITLES, HARMLESS)):
        head = (_line(*titles), "|---" * len(titles) + "|")
        every = [case for case in cases if case.key in known]
        KEPT.with_name(f"{part}.md").write_text("\n".join((*head, *(known[case.key]["row"] for case in every))))
        # those with a row of docs/safety.md have their times there
        rows = [known[case.key]["row"] for case in every if not case.row]
        page_parts.write(page, part, "\n".join((*head, *rows)), "benchmarks.stops")
    safety = ROOT / "docs" / "safety.md"
    lines = safety.read_text().splitlines()
    measured = of_processes()
    for case in CASES:
        if case.row and case.key in known:
            what = f"{WORDS[case.kind].removeprefix('board as ')}{', ' if case.told else ''}{case.told}"
            said = f"{what}: {worst(known[case.key]['safety'])}"
            measured.setdefault(case.row, []).append(said)
    for row, cells in measured.items():
        places = [k for k, line in enumerate(lines) if line.startswith(f"| {row}")]
        if len(places) != 1:
            raise ValueError(f"{safety}: {len(places)} rows begin with {row!r}; one has to")
        lines[places[0]] = " | ".join((*lines[places[0]].split(" | ")[:3], f"{'<br>'.join(cells)} |"))
    safety.write_text("\n".join(lines) + "\n")


def of_processes() -> dict[str, list[str]]:
    """What the rows of docs/safety.md on processes say: real time, a board as ours behind a pseudo-terminal."""
    rows = [json.loads(line) for line in PROCESSES.read_text().splitlines()] if PROCESSES.exists() else []
    said = {}
    for row, fault in (("the drawing process dies", "screens killed"), ("the robot process dies", "SIGKILL")):
        found = [each for each in rows if each["fault"] == fault and "neutral" in each and not each["broken"]]
        if found:
            neutral, standing = (spread(each[name] for each in found) for name in ("neutral", "standing"))
            said[row] = [f"ours, in real time: {worst(f'{neutral}; {standing}')}"]
    return said
