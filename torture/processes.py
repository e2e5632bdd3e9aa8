"""Faults of processes, in real time: host and board, or what belongs to them, are killed, stopped or unplugged.

Each fault strikes at a random instant of a run of its own. What has to hold is looked at from the other side: the
vehicle stands in time and does not set off again by itself; the host disarms; a bridge or a full disk costs it nothing.
"""

import argparse
import asyncio
import json
import os
import pty
import random
import resource
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any, Final

from torture import fleets, page
from torture.struck_robot import ENDLESS, Broken, coasting
from txt1.board.board import Board
from txt1.config import load
from txt1.errors import StopNotVerified
from txt1.kernel.loop import run
from txt1.link.pty import listen_pty
from txt1.record.file_sink import parts
from txt1.record.reader import FilePass
from txt1.robot import Robot

ROOT: Final = Path(__file__).parents[1]
PLUGINS: Final = str(ROOT / "tests" / "plugins" / "site")
TICK: Final = 0.02
PATIENCE: Final = 60.0  # s for a process to start on a busy machine
LATE: Final = 0.5  # s that a busy machine may be late
STANDS: Final = 0.05  # m/s
LOST: Final = 0.47  # s after which a host knows that its board is gone, a tick included
TOLERANT: Final = ("--set", "safety.missed_ticks_max=25")  # a busy machine is no fault; a stopped process is one
ROOMS: Final = tuple(word for setting in ENDLESS for word in ("--set", setting))


class NotBegun(Exception):
    """The machine was too busy for the run to begin."""


@asynccontextmanager
async def program(*words: str, **options: Any) -> AsyncIterator[asyncio.subprocess.Process]:
    """A txt1 command in a process of its own, killed at the end."""
    nowhere = asyncio.subprocess.DEVNULL
    given = {"stdin": nowhere, "stdout": nowhere, "stderr": nowhere} | options
    started = await asyncio.create_subprocess_exec(sys.executable, "-m", "txt1", *words, **given)
    try:
        yield started
    finally:
        with suppress(ProcessLookupError):
            started.send_signal(signal.SIGCONT)
            started.kill()
        await started.wait()


async def until(condition: Callable[[], bool], patience: float, what: str) -> float:
    """How long it takes, s, until something is true."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    while not condition():
        if loop.time() - began > patience:
            if patience == PATIENCE:
                raise NotBegun(what)
            raise Broken(f"{what}: not within {patience:.2f} s")
        await asyncio.sleep(TICK / 2.0)
    return loop.time() - began


async def stays(condition: Callable[[], bool], duration: float, what: str) -> None:
    """See that something stays true for so many s."""
    ends = asyncio.get_running_loop().time() + duration
    while asyncio.get_running_loop().time() < ends:
        if not condition():
            raise Broken(what)
        await asyncio.sleep(TICK)


@asynccontextmanager
async def screens() -> AsyncIterator[dict[str, Any]]:
    """A terminal for a program, as the options with which to start it; what is drawn there is read and forgotten."""
    loop = asyncio.get_running_loop()
    outside, inside = pty.openpty()
    loop.add_reader(outside, lambda: _swallow(outside, loop))
    try:
        yield {"stdin": inside, "stdout": inside, "stderr": inside, "env": os.environ | {"TERM": "xterm"}}
    finally:
        loop.remove_reader(outside)
        os.close(outside)
        os.close(inside)


def _swallow(terminal: int, loop: asyncio.AbstractEventLoop) -> None:
    try:
        os.read(terminal, 65536)
    except OSError:
        loop.remove_reader(terminal)


# -- the host, seen from the board -------------------------------------------------------------------------------------


async def host(fault: str, rng: random.Random, folder: Path, seen: dict[str, float]) -> None:
    """Strike a host that drives; the time until its board's outputs are neutral, and until the vehicle stands, s."""
    config = load(None, ENDLESS, {}, {"seed": rng.randrange(1000)}).config
    board = Board(config)
    listener = listen_pty(str(folder / "board"), board.paced)
    await board.power_up()
    words = ["run", "--hal", "serial", "--port", str(folder / "board"), "--arm", "--drive", "0.6,0.3"]
    words += ["--duration", "60", *TOLERANT]
    options: dict[str, Any] = {}
    async with AsyncExitStack() as stack:
        stack.callback(listener.close)
        stack.push_async_callback(board.power_down)
        if fault == "screens killed":
            options = await stack.enter_async_context(screens())
        else:
            words += ["--headless", "--json"]
        process = await stack.enter_async_context(program(*words, **options))
        await until(lambda: board.vehicle.state.v > 0.4, PATIENCE, "the host does not drive")
        await asyncio.sleep(rng.uniform(0.2, 1.5))
        await until(lambda: board.vehicle.state.v > 0.4, PATIENCE, "it drives no more")  # a busy host may pause
        v = board.vehicle.state.v
        loop = asyncio.get_running_loop()
        began = loop.time()
        match fault:
            case "SIGKILL":
                process.kill()
            case "SIGTERM" | "SIGINT" | "SIGHUP":
                process.send_signal(getattr(signal, fault))
            case "SIGSTOP":
                process.send_signal(signal.SIGSTOP)
            case "unplugged":
                assert board.link is not None
                board.link.close()
            case "screens killed":
                for child in _children(process.pid):
                    os.kill(child, signal.SIGKILL)
        hal: Any = board.runtime.hal
        neutral = 0.0
        if fault == "unplugged":  # the board goes by its time-out
            neutral = await until(lambda: hal.outputs.motor == 0, 1.0 + LATE, "neutral outputs")
        elif fault == "screens killed":  # the host asks for zeros, and the board brakes
            neutral = await until(lambda: board.runtime.state.control.v == 0.0, 0.27 + LATE, "a set-point of 0")
        elif fault in ("SIGKILL", "SIGSTOP"):
            neutral = await until(lambda: hal.outputs.motor == 0, 0.27 + LATE, "neutral outputs")
        await until(lambda: abs(board.vehicle.state.v) < STANDS, coasting(v) + 1.0 + LATE, "standing")
        seen |= {"neutral": neutral, "standing": loop.time() - began}
        if fault == "SIGSTOP":
            await asyncio.sleep(rng.uniform(0.7, 1.5))
            if process.returncode is not None:
                raise Broken(f"the host had ended by itself, exit code {process.returncode}")
            process.send_signal(signal.SIGCONT)
        await stays(lambda: abs(board.vehicle.state.v) < STANDS, 2.5, "it set off again by itself")
        ended_by = fault
        if fault == "screens killed":  # the run goes on without them
            ended_by = "SIGTERM"
            process.send_signal(signal.SIGTERM)
        if ended_by in ("SIGTERM", "SIGINT", "SIGHUP"):
            code = await asyncio.wait_for(process.wait(), 20.0)
            if code not in (128 + getattr(signal, ended_by), 4):  # 4: on a machine too busy to see it stand
                raise Broken(f"exit code {code}")


# -- the board, seen from the host -------------------------------------------------------------------------------------


async def board(fault: str, rng: random.Random, folder: Path, seen: dict[str, float]) -> None:
    """Strike a board that is driven; the time until its host has disarmed, s."""
    path = folder / "board"
    words = ("board", "--pty", str(path), "--json", *ROOMS)
    async with program(*words) as process:
        await until(path.is_symlink, PATIENCE, "the board is not there")
        config = load(None, [f"serial.port={path}", "safety.missed_ticks_max=25"], {}, {"hal": "serial"}).config
        async with Robot.open(config=config, arm=True, patience=PATIENCE) as robot:
            await robot.load_gains(timeout=20.0)

            async def drive() -> None:
                while True:
                    robot.command(0.6, 0.3)
                    await asyncio.sleep(TICK)

            driving = asyncio.ensure_future(drive())
            try:
                await until(lambda: robot.odometry.v > 0.4, PATIENCE, "it does not drive")
                await asyncio.sleep(rng.uniform(0.2, 1.5))
                process.send_signal(signal.SIGSTOP if fault == "SIGSTOP" else signal.SIGKILL)
                seen["disarmed"] = await until(lambda: not robot.armed, LOST + LATE, "the host has not disarmed")
                if fault == "SIGSTOP":
                    await asyncio.sleep(rng.uniform(0.2, 1.5))
                    process.send_signal(signal.SIGCONT)
                    await stays(lambda: not robot.armed, 3.0, "it was armed again")
                    await until(lambda: robot.runtime.linked, 10.0, "the link is not back")
                    await until(lambda: abs(robot.odometry.v) < STANDS, 3.0, "standing")
                elif fault == "killed and started anew":
                    await process.wait()
                    async with program(*words):
                        await until(lambda: robot.runtime.linked, PATIENCE, "the link is not back")
                        await stays(lambda: not robot.armed and robot.odometry.v == 0.0, 2.0, "it moved, or was armed")
                else:
                    await stays(lambda: not robot.armed, 1.0, "it was armed again")
            finally:
                driving.cancel()


# -- what belongs to the host ------------------------------------------------------------------------------------------


def _children(process: int) -> list[int]:
    listed = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(process)], capture_output=True, text=True, check=False
    )
    return [int(line.split()[0]) for line in listed.stdout.splitlines() if "txt1.sidecar" in line]


ROTATION: Final = "recorder without room as the next file begins"
ROOMLESS: Final = {"recorder without room": 0.0, ROTATION: 0.3}
"""Faults of the recorder, and s after which its next file begins; 0: never."""


async def beside(fault: str, rng: random.Random, folder: Path, seen: dict[str, float]) -> None:
    """Strike the screens, a bridge or the recorder of a robot that drives: it goes on to its end."""
    duration = 6.0
    words = ["run", "--hal", "sim", "--drive", "0.5,0.3", "--duration", f"{duration:g}", *TOLERANT, *ROOMS]
    file = folder / "run.mcap"
    async with AsyncExitStack() as stack:
        options: dict[str, Any] = {}
        if fault == "screens stopped":
            options = await stack.enter_async_context(screens())
        else:
            words += ["--headless", "--json"]
        if fault in ROOMLESS:
            words += ["--log", str(file), "--set", f"record.rotate_time={ROOMLESS[fault]:g}"]
        elif fault.startswith("bridge"):
            paths = os.environ.get("PYTHONPATH", str(ROOT)), PLUGINS
            options["env"] = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
            words += ["--bridge", "pusher"]
        process = await stack.enter_async_context(program(*words, **options))
        if fault in ROOMLESS:
            await until(lambda: file.exists() and file.stat().st_size > 0, PATIENCE, "nothing is recorded")
        else:
            await until(lambda: bool(_children(process.pid)), PATIENCE, "there is no such process")
        await asyncio.sleep(rng.uniform(0.5, 0.6 * duration))
        if fault in ROOMLESS:  # no file can grow any more, as on a full disk
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
            if fault == ROTATION:
                await asyncio.sleep(1.0)
                resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        else:
            for child in _children(process.pid):
                os.kill(child, signal.SIGSTOP if "stopped" in fault else signal.SIGKILL)
        code = await asyncio.wait_for(process.wait(), duration + 30.0)
        if code not in ((0, 1) if fault == "recorder without room" else (0,)):
            raise Broken(f"exit code {code}")
        if fault == ROTATION:
            whole(file, duration)


def whole(file: Path, duration: float) -> None:
    """Check that all files of a recording are complete, and that the last goes on to the end of the run."""
    last = 0.0
    for each in parts(file):
        reading = FilePass(each)
        last = max(map(reading.run_time, reading), default=last)
        if not reading.complete or reading.damaged:
            raise Broken(f"{each.name} is not whole")
    if last < duration - 1.0:
        raise Broken(f"recorded up to {last:.1f} s of {duration:g} s, and there was room again")


FAULTS: Final[tuple[tuple[str, str], ...]] = (
    ("host", "SIGKILL"), ("host", "SIGSTOP"), ("host", "SIGTERM"), ("host", "SIGINT"), ("host", "SIGHUP"),
    ("host", "unplugged"), ("board", "SIGKILL"), ("board", "SIGSTOP"), ("board", "killed and started anew"),
    ("host", "screens killed"), ("beside", "screens stopped"), ("beside", "recorder without room"),
    ("beside", ROTATION), ("beside", "bridge killed"), ("beside", "bridge stopped"),
    *(("fleet", fault) for fault in fleets.FAULTS),
)  # fmt: skip
PLACES: Final = {"host": host, "board": board, "beside": beside, "fleet": fleets.strike}


def strike(number: int) -> dict[str, Any]:
    """One fault, its kind and instant by its number."""
    place, fault = FAULTS[number % len(FAULTS)]
    rng = random.Random(number)
    row: dict[str, Any] = {"number": number, "place": place, "fault": fault, "broken": ""}
    with tempfile.TemporaryDirectory() as folder:
        seen: dict[str, float] = {}
        try:
            for _ in range(3):
                with suppress(NotBegun):
                    run(PLACES[place](fault, rng, Path(tempfile.mkdtemp(dir=folder)), seen))
                    break
            else:
                row["broken"] = "the run has not begun in three attempts"
        except StopNotVerified:
            pass  # the host says so of a board that is gone
        except Exception as error:
            row["broken"] = f"{type(error).__name__}: {error}"
    return row | seen


def main(words: Sequence[str] | None = None) -> int:
    """Strike so often; 1 if something broke."""
    parser = argparse.ArgumentParser(prog="python -m torture processes", description=__doc__)
    parser.add_argument("--faults", type=int, default=200, help="in all, with those that are there already")
    parser.add_argument("--jobs", type=int, default=2, help="at a time")
    parser.add_argument("--minutes", type=float, help="end after so many; the same command goes on")
    parser.add_argument("--kept", type=Path, default=Path("out/torture/processes.jsonl"), help="what came out so far")
    parser.add_argument("--one", type=int, metavar="N", help="only the fault of this number")
    parser.add_argument("--page", action="store_true", help="write the table into docs/results/reliability.md")
    options = parser.parse_args(words)
    if options.one is not None:
        row = strike(options.one)
        print(json.dumps(row))
        return 1 if row["broken"] else 0
    options.kept.parent.mkdir(parents=True, exist_ok=True)
    lines = options.kept.read_text().splitlines() if options.kept.exists() else []
    rows = {row["number"]: row for row in map(json.loads, lines)}
    left = [number for number in range(options.faults) if number not in rows]
    asyncio.run(_strike_all(left, rows, options))
    text = table(list(rows.values()))
    print(text)
    if options.page:
        page.write("processes", text)
    return 1 if any(row["broken"] for row in rows.values()) else 0


async def _strike_all(left: list[int], rows: dict[int, dict[str, Any]], options: argparse.Namespace) -> None:
    loop = asyncio.get_running_loop()
    ends = None if options.minutes is None else loop.time() + 60.0 * options.minutes

    async def work() -> None:
        while left and (ends is None or loop.time() < ends):
            number = left.pop(0)
            words = (sys.executable, "-m", "torture", "processes", "--one", str(number))
            process = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
            said, _ = await process.communicate()
            row = rows[number] = json.loads(said.splitlines()[-1])
            with options.kept.open("a") as file:
                print(json.dumps(row), file=file)
            if row["broken"]:
                print(
                    f"{row['place']}, {row['fault']}: {row['broken']}\n  {' '.join(('python', *words[1:]))}", flush=True
                )

    await asyncio.gather(*(work() for _ in range(options.jobs)))


def table(rows: Sequence[dict[str, Any]]) -> str:
    """What came out, in Markdown; times in s."""
    lines = [
        "| struck | fault | broken | s until neutral, disarmed | s until standing |",
        "|---|---|--:|--:|--:|",
    ]
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["place"], row["fault"]].append(row)
    for place, fault in FAULTS:
        group = groups[place, fault]
        first = [row.get("neutral", row.get("disarmed", 0.0)) for row in group if not row["broken"]]
        stood = [row["standing"] for row in group if "standing" in row]
        broken = sum(bool(row["broken"]) for row in group)
        where = {"beside": fault.split()[0]}.get(place, place)
        lines.append(f"| {where} | {fault} | {broken}/{len(group)} | {_times(first)} | {_times(stood)} |")
    return "\n".join(lines)


def _times(values: Sequence[float]) -> str:
    return f"{median(values):.2f}, worst {max(values):.2f}" if any(values) else "-"


if __name__ == "__main__":
    sys.exit(main())
